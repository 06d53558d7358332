"""Series of meshes in a report: the order with which quantities converge, what they tend to, and a picture of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ffsi.hemodynamics.result import Result
from ffsi.report.curves import LINES, MARKERS, MOST, dress, legend
from ffsi.report.tables import Rows, cell, words
from ffsi.result import refinement
from ffsi.result.published import references_for
from ffsi.result.quantities import published_value, unit


def series(results: Sequence[Result]) -> tuple[Rows, Figure | None] | None:
    """Return the table and the picture of solved runs that differ in their mesh only; None with fewer than three."""
    if (known := refinement.of_results(results)) is None:
        return None
    triangles, h, found = known
    published = references_for(results[0].scene)
    body, lines = [], {}
    for name, item in found.items():
        reference = published_value(name, published)
        body.append(
            [
                words(name), unit(name), *(f"{value:.6g}" for value in item.values),
                *(("", "") if item.order is None else (f"{item.order:.2f}", f"{item.limit:.6g}")), f"{item.bar:.2g}",
                *([cell(reference and reference[0], ".6g")] if published else []),
            ]
        )  # fmt: skip
        if item.limit is not None:
            lines[name] = np.abs(np.array(item.values) - item.limit)
    head = ["quantity", "unit", *(f"{count} triangles" for count in triangles)]
    head += ["order", "extrapolated", "error bar of the finest", *(["published"] if published else [])]
    note = (
        "Order and extrapolated value follow from the three finest meshes, h = 1/√triangles; they are empty where the "
        "differences do not fall by a power of h. The error bar is an estimate: Roache's grid convergence index with "
        "an order of at most 2, or without an order all that the three values differ by."
    )
    rows = Rows(head, body, [False, False, *[True] * (len(head) - 2)], "Refinement of the mesh", note)
    return rows, _picture(h, lines)


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
