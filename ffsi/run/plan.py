"""How the points of a study are put into chains: what shares script and mesh, in an order to go on from."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ffsi.result.study_definition import Values
from ffsi.scene import Scene, with_values
from ffsi.script.render import parameters
from ffsi.script.walls import is_fixed

Piece = list[Values]
"""Points that one FreeFEM process solves in this order."""

_SHORTEST, _LONGEST = 3, 200
"""Points of a piece: of fewer, reaching the first one costs more than a second process gains; of more, memory."""
_ORDERED_BY_DISTANCE = 2_000


def plan(scene: Scene, points: Sequence[Values], workers: int = 1) -> list[Piece]:
    """Split points into pieces.

    Points with the same script and mesh differ in run-time parameters only. They are ordered so that the next one is
    near, and cut into as many pieces as there are workers where that pays. In time every point is a piece of its own.

    Args:
        scene: where all other values come from.
        points: values that the scene accepts.
        workers: processes at a time.
    """
    if scene.time is not None:
        return [[values] for values in points]
    groups: dict[tuple[Any, ...], Piece] = {}
    along: dict[tuple[Any, ...], list[str]] = {}
    for values in points:
        texts = tuple((k, v if isinstance(v, str) or is_fixed(k, v) else None) for k, v in values.items())
        if texts not in along:
            along[texts] = run_time_keys(scene, values)
        fixed = tuple(sorted((key, value) for key, value in values.items() if key not in along[texts]))
        groups.setdefault((texts, fixed, formulations(scene, values)), []).append(values)
    pieces = []
    for (texts, *_), group in groups.items():
        group = in_order(group, along[texts])
        share = max(1, round(workers * len(group) / len(points)))
        count = max(math.ceil(len(group) / _LONGEST), min(share, len(group) // _SHORTEST), 1) if along[texts] else 0
        bounds = np.linspace(0, len(group), (count or len(group)) + 1).round().astype(int)
        pieces += [group[i:j] for i, j in itertools.pairwise(bounds)]
    return pieces


def run_time_keys(scene: Scene, values: Values) -> list[str]:
    """Return those keys of a point that can vary between the points of one process: same mesh, same script."""
    kinds = {parameter.key: parameter.kind for parameter in parameters(with_values(scene, values))}
    return [key for key in values if kinds.get(key) == 1]


def formulations(scene: Scene, values: Values) -> tuple[str, ...]:
    """Return the formulations of the solids at a point: where the scene states none they follow the values."""
    follow = any("formulation" not in solid.model_fields_set for solid in scene.solid.values())
    if follow and any(key.startswith("solid.") for key in values):
        scene = with_values(scene, values)
    return tuple(scene.formulations)


def in_order(group: Sequence[Values], keys: Sequence[str], first: int | None = None) -> Piece:
    """Return points so that each is followed by the nearest of the rest, in parts of the range of each key.

    Args:
        group: the points.
        keys: that vary between them.
        first: the first one; None: that of the smallest values.
    """
    if not keys:
        return list(group)
    at = scaled(group, keys)
    left = [int(i) for i in np.lexsort(at.T[::-1])]
    if len(group) > _ORDERED_BY_DISTANCE:
        return [group[i] for i in left]
    order = [left.pop(left.index(first) if first is not None else 0)]
    while left:
        distances = ((at[left] - at[order[-1]]) ** 2).sum(axis=1)
        order.append(left.pop(int(np.argmin(distances))))
    return [group[i] for i in order]


def beyond(values: Values, failed: Values, solved: Values) -> bool:
    """Return whether the way from a solved point to `values` leads through a failed one: all differ in one key."""
    keys = [key for key in solved if solved[key] != failed.get(key)]
    if len(keys) != 1 or any(values.get(key) != failed.get(key) for key in (*solved, *values) if key not in keys):
        return False
    at, wall, start = (point[keys[0]] for point in (values, failed, solved))
    numbers = not any(isinstance(value, str) for value in (at, wall, start))
    return numbers and (float(wall) - float(start)) * (float(at) - float(wall)) > 0


def nearest(values: Values, others: Sequence[Values], keys: Sequence[str]) -> Values:
    """Return the one of the others that is nearest to a point, in parts of the range of each key."""
    at = scaled([values, *others], keys)
    return others[int(np.argmin(((at[1:] - at[0]) ** 2).sum(axis=1)))]


def scaled(group: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> NDArray[np.float64]:
    """Return the values of keys, one row per point, from 0 (the smallest) to 1."""
    at = np.array([[float(values[key]) for key in keys] for values in group])
    width = np.ptp(at, axis=0)
    found: NDArray[np.float64] = (at - at.min(axis=0)) / np.where(width > 0, width, 1.0)
    return found
