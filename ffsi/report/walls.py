"""Pictures of vessels: the stress in their walls, curves along them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ffsi.files.arrays import Floats
from ffsi.report.curves import LINES
from ffsi.result.fields import FLUID, Fields
from ffsi.result.pictures import FAINT, canvas, colour_bar, split_triangles
from ffsi.result.views import INK, outline

_FLAT = 1e-4


def wall_stress(fields: Fields, stress: Floats, top: float, title: str = "") -> Figure:
    """Draw the effective stress in the deformed walls; dashed: the walls at rest.

    Args:
        fields: the fields.
        stress: (n,) effective stress at the nodes, Pa.
        top: end of the range of colours, Pa; what lies above, at corners, has the colour of the end.
        title: heading.
    """
    figure, axes = canvas(title, (fields.deformed.min(axis=0), fields.deformed.max(axis=0)))
    walls = fields.region != FLUID
    colours = axes.tripcolor(
        split_triangles(fields, walls), stress, shading="gouraud", cmap="inferno", vmin=0, vmax=top, rasterized=True
    )
    for region in np.unique(fields.region[walls]).tolist():
        axes.add_collection(LineCollection(outline(fields, fields.region == region), colors=INK, linewidths=0.5))
    before = replace(fields, displacement=np.zeros_like(fields.displacement))
    axes.add_collection(LineCollection(outline(before, walls), colors=FAINT, linewidths=0.6, linestyles="dashed"))
    colour_bar(figure, axes, colours, "effective stress (Pa)")
    return figure


OVER_DECADES = ("wss", "tawss", "rrt")
"""Columns of `Result.wall` whose values on an aneurysm's walls span decades."""
OUTER_WALL = "distance along the outer wall from the inlet (mm); grey: dome, beige: neck"


def outer_wall(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of `Result.wall` on an aneurysm's outer wall, from the inlet through the dome to the outlet."""
    return table[table["line"] == "dome"]


def along_walls(
    tables: Mapping[str, pd.DataFrame],
    panels: Sequence[tuple[str, str]],
    title: str = "",
    logarithmic: Collection[str] = (),
    along: str = OUTER_WALL,
) -> Figure:
    """Draw quantities along walls over their arc length.

    Args:
        tables: rows of `Result.wall` on one line, in one cycle, by their name in the legend; a single one needs none.
        panels: column and axis label of each panel.
        title: heading.
        logarithmic: columns whose axis is.
        along: label of the arc length, mm; the default is that of `outer_wall`, whose parts are shaded.
    """
    figure = Figure(figsize=(9.0, 0.9 + 2.9 * len(panels)), layout="constrained", facecolor="white")
    grid = np.atleast_1d(figure.subplots(len(panels), 1, sharex=True))
    for axes, (column, label) in zip(grid, panels, strict=True):
        for i, (name, shown) in enumerate(tables.items()):
            axes.plot(
                1e3 * shown["arc"], shown[column], color=LINES[i % len(LINES)], linewidth=1.3, label=name,
                linestyle=("-", "--", "-.", ":")[i % 4],
            )  # fmt: skip
        first = next(iter(tables.values()))
        for part, shade in (("dome", "#eef2f6"), ("neck", "#f7efe6")) if along == OUTER_WALL else ():
            for start, end in _stretches(first, part):
                axes.axvspan(1e3 * start, 1e3 * end, color=shade, zorder=0)
        axes.set_ylabel(label, color=INK)
        axes.tick_params(colors=INK, labelsize=9, width=0.6)
        axes.margins(x=0)
        low, high = axes.get_ylim()
        if high - low < _FLAT * max(abs(low), abs(high)):  # constant up to rounding
            middle = (low + high) / 2
            axes.set_ylim(middle - 0.1 * abs(middle), middle + 0.1 * abs(middle))
        if column in logarithmic:
            axes.set_yscale("log")
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    grid[0].set_title(title, loc="left", fontsize=11, color=INK)
    grid[-1].set_xlabel(along, color=INK)
    if len(tables) > 1:
        figure.legend(
            *grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False, fontsize=9,
            labelcolor=INK,
        )  # fmt: skip
    return figure


def _stretches(table: pd.DataFrame, part: str) -> list[tuple[float, float]]:
    """Return the start and end (m) of each stretch of a line that belongs to a part."""
    arc, on = table["arc"].to_numpy(), (table["part"] == part).to_numpy()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    return [(float(arc[i]), float(arc[j - 1])) for i, j in zip(edges[::2], edges[1::2], strict=True)]
