"""Series of meshes: the order with which quantities converge, what they tend to, and a picture of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

from ffsi.hemodynamics.result import Result
from ffsi.report.curves import LINES, MARKERS, MOST, dress, legend
from ffsi.report.tables import Rows, cell, words
from ffsi.result.published import references_for
from ffsi.result.quantities import flatten, published_value, unit

LEVEL = "mesh.level"
_ORDERS = (0.05, 12.0)


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


def series(results: Sequence[Result]) -> tuple[Rows, Figure | None] | None:
    """Return the table and the picture of solved runs that differ in their mesh only; None with fewer than three."""
    solved = sorted((item for item in results if item.converged), key=lambda item: int(item.data["triangles"]))
    if len(solved) < 3 or len({item.data["triangles"] for item in solved}) < len(solved):
        return None
    h = [1 / math.sqrt(item.data["triangles"]) for item in solved]
    found = [flatten(item.quantities) for item in solved]
    published = references_for(solved[0].scene)
    names = [name for name in found[0] if all(name in each for each in found) and not name.endswith(("_x", "_y"))]
    body, lines = [], {}
    for name in names:
        values = [each[name] for each in found]
        tends = limit(h, values)
        known = published_value(name, published)
        body.append(
            [
                words(name), unit(name), *(f"{value:.6g}" for value in values),
                *((f"{tends[0]:.2f}", f"{tends[1]:.6g}", _percent(values[-1], tends[1])) if tends else ("", "", "")),
                *([cell(known and known[0], ".6g")] if published else []),
            ]
        )  # fmt: skip
        if tends:
            lines[name] = np.abs(np.array(values) - tends[1])
    head = ["quantity", "unit", *(f"{item.data['triangles']} triangles" for item in solved)]
    head += ["order", "extrapolated", "error of the finest", *(["published"] if published else [])]
    note = (
        "Order and extrapolated value follow from the three finest meshes, h = 1/√triangles; they are empty where the "
        "differences do not fall by a power of h."
    )
    rows = Rows(head, body, [False, False, *[True] * (len(head) - 2)], "Refinement of the mesh", note)
    return rows, _picture(h, lines)


def _percent(value: float, reference: float) -> str:
    return f"{100 * (value - reference) / abs(reference):+.3f} %" if reference else ""


def _picture(h: Sequence[float], lines: dict[str, np.ndarray]) -> Figure | None:
    shown = dict(list(lines.items())[:MOST])
    if not shown:
        return None
    figure = Figure(figsize=(7.5, 4.4), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    for i, (name, errors) in enumerate(shown.items()):
        axes.loglog(h, errors, color=LINES[i], marker=MARKERS[i], markersize=4.5, linewidth=1.4, label=words(name))
    units = {unit(name) for name in shown}
    dress(axes, "Distance from the extrapolated value", "h = 1/√triangles", f"distance ({', '.join(sorted(units))})")
    legend(axes)
    return figure
