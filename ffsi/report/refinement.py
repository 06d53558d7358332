"""Series of meshes in a report: the order with which quantities converge, what they tend to, and a picture of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

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
    units = ", ".join(sorted({unit(name) for name in lines}))
    return rows, _picture(h, lines, "Distance from the extrapolated value", "h = 1/√triangles", f"distance ({units})")


def adapted(made: Mapping[str, Any]) -> tuple[Rows, Figure | None]:
    """Return the table and the picture of the meshes that were made for quantities, a result's `adaptation`.

    The picture has the sizes of the estimated errors by unknowns, relative to the values, and the tolerance.
    """
    names, body = list(made["rounds"][0]["quantities"]), []
    lines: dict[str, np.ndarray] = {name: np.full(len(made["rounds"]), np.nan) for name in names}
    for i, step in enumerate(made["rounds"]):
        body.append([f"{step['unknowns']:.0f}", f"{step['triangles']:.0f}"])
        for name, found in step["quantities"].items():
            bar = f" ± {found['bar']:.2g} ({found['estimate']:+.2g})" if "bar" in found else ""
            body[-1].append(f"{found['value']:.7g}{bar}")
            if bar and found["value"]:
                lines[name][i] = abs(found["estimate"] / found["value"]) or np.nan
    heads = [f"{words(name)} ({unit(name)})" if unit(name) else words(name) for name in names]
    note = "A row for each mesh: values, their error bars and, in brackets, estimated errors; value + error is better."
    rows = Rows(["unknowns", "triangles", *heads], body, [True] * (2 + len(names)), "Meshes made for quantities", note)
    figure = _picture([step["unknowns"] for step in made["rounds"]], lines, "Estimated errors", "unknowns", "relative")
    if figure is not None and made["tolerance"]:
        figure.axes[0].axhline(made["tolerance"], color="#777", linewidth=0.8)
    return rows, figure


def _picture(x: Sequence[float], lines: dict[str, np.ndarray], title: str, along: str, measured: str) -> Figure | None:
    shown = {name: errors for name, errors in list(lines.items())[:MOST] if np.isfinite(errors).any()}
    if not shown:
        return None
    figure = Figure(figsize=(7.5, 4.4), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    for i, (name, errors) in enumerate(shown.items()):
        axes.loglog(x, errors, color=LINES[i], marker=MARKERS[i], markersize=4.5, linewidth=1.4, label=words(name))
    dress(axes, title, along, measured)
    legend(axes)
    return figure
