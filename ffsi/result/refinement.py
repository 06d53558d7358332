"""Series of meshes: the order with which a quantity converges, its limit, and how far the finest value is off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.optimize import brentq

from ffsi.result.quantities import flatten
from ffsi.result.result import PlainResult

LEVEL = "mesh.level"
_ORDERS = (0.05, 12.0)
_BELIEVED = 2.0
"""The largest order that a bar relies on: a larger one is an accident of three values."""
_SAFETY = 1.25


@dataclass(frozen=True)
class Refinement:
    """What a quantity does on finer and finer meshes.

    Attributes:
        values: from the coarsest to the finest mesh, in the quantity's unit.
        order: p of an error C h^p, by the three finest; None where the differences do not fall by a power of h.
        limit: what the values tend to with that order; None likewise.
        bar: of the finest value: Roache's grid convergence index, 1.25 |f - m|/(r^p - 1) with f the finest value, m the
            one before, r the ratio of their h, and p at most 2; without an order all that the three values differ by.
    """

    values: tuple[float, ...]
    order: float | None
    limit: float | None
    bar: float


def refinement(h: Sequence[float], values: Sequence[float]) -> Refinement:
    """Judge values on meshes of sizes h, at least three, from coarse to fine; h in any unit."""
    last = list(values[-3:])
    found = limit(h, values)
    if found is None:
        return Refinement(tuple(values), None, None, max(last) - min(last))
    order = min(found[0], _BELIEVED)
    bar = _SAFETY * abs(last[2] - last[1]) / ((h[-2] / h[-1]) ** order - 1.0)
    return Refinement(tuple(values), *found, bar)


def limit(h: Sequence[float], values: Sequence[float]) -> tuple[float, float] | None:
    """Return the order p and the limit of values whose error is C h^p, from the three finest meshes.

    Args:
        h: sizes of the meshes, from coarse to fine, in any unit.
        values: one for each.

    Returns:
        None if the differences do not fall by a power of h between 0.05 and 12.
    """
    (coarse, middle, fine), (c, m, f) = h[-3:], values[-3:]
    if not (coarse > middle > fine > 0) or m == f or (c - m) / (m - f) <= 0:
        return None

    def misses(p: float) -> float:
        return float((coarse**p - middle**p) / (middle**p - fine**p) - (c - m) / (m - f))

    if misses(_ORDERS[0]) * misses(_ORDERS[1]) > 0:
        return None
    order = float(brentq(misses, *_ORDERS))
    return order, f - (m - f) / ((middle / fine) ** order - 1.0)


def of_results(results: Sequence[PlainResult]) -> tuple[list[int], list[float], Mapping[str, Refinement]] | None:
    """Return triangles, h = 1/sqrt(triangles) and the refinement of every quantity of solved runs on several meshes.

    None with fewer than three runs, or two of equal meshes.
    """
    solved = sorted((item for item in results if item.converged), key=lambda item: int(item.data["triangles"]))
    triangles = [int(item.data["triangles"]) for item in solved]
    if len(solved) < 3 or len(set(triangles)) < len(solved):
        return None
    h = [1 / math.sqrt(count) for count in triangles]
    found = [flatten(item.quantities) for item in solved]
    names = [name for name in found[0] if all(name in each for each in found)]
    names = [name for name in names if not name.endswith(("_x", "_y")) and not name.startswith("min_jacobian")]
    return triangles, h, {name: refinement(h, [each[name] for each in found]) for name in names}
