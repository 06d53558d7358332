"""Histories: quantities over time and over each other, their spectrum, energy; Newton's residuals."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ffsi.report.curves import AXES, DRAWN, LINES, dress, legend
from ffsi.report.tables import in_words
from ffsi.result.pictures import FAINT

# Over time: title, axis label, column.
TIME_PANELS = tuple(
    (f"{item.plot} {in_words(item.words)}" if item.unit == "m" else item.plot, AXES[item.unit], item.name)
    for item in DRAWN
    if "sweep" in item.tables
)
ZOOMED = 2
"""Periods in the enlarged part of a history."""


def time_history(history: pd.DataFrame, period: tuple[float, float] | None = None) -> Figure | None:
    """Draw drag, lift and tip displacement over time, and beside each the end of it enlarged.

    Args:
        history: one row per step: `time` (s) and the quantities in SI.
        period: start and end of the last period, s; None: there is none, and nothing is enlarged.

    Returns:
        The figure, or None if there is nothing to draw.
    """
    panels = [panel for panel in TIME_PANELS if panel[2] in history]
    if not panels or len(history) < 2:
        return None
    figure = Figure(figsize=(11, 2.5 * len(panels)), layout="constrained", facecolor="white")
    widths = [2.2, 1.0] if period else [1.0]
    grid = figure.subplots(len(panels), len(widths), squeeze=False, sharex="col", width_ratios=widths)
    for number, (row, (title, label, column)) in enumerate(zip(grid, panels, strict=True), start=1):
        for axes, part in zip(row, (history, _end(history, period)), strict=False):
            axes.plot(part["time"], part[column], color=LINES[0], linewidth=1.1)
            if period:
                axes.axvspan(*period, color=FAINT, alpha=0.15, linewidth=0)
            axes.ticklabel_format(axis="y", scilimits=(-4, 5), useMathText=True)
            dress(axes, title if axes is row[0] else "", "time (s)" if number == len(panels) else "", label)
    return figure


def _end(history: pd.DataFrame, period: tuple[float, float] | None) -> pd.DataFrame:
    """Return the last periods and what comes after them."""
    if period is None:
        return history
    start, end = period
    return history[history["time"] >= end - ZOOMED * (end - start)]


def newton_history(history: pd.DataFrame) -> Figure | None:
    """Draw Newton's relative residual over all iterations; dotted: a new mesh or load step; filled: new factors."""
    table = history[history["residual"] > 0].reset_index(drop=True)
    if table.empty:
        return None
    figure = Figure(figsize=(7.5, 3.3), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    steps = table[[name for name in ("load", "loadFactor", "stage") if name in table]]
    start = np.flatnonzero((steps != steps.shift()).any(axis=1))
    for begin, end in zip(start, [*start[1:], len(table)], strict=True):
        part = table.iloc[begin:end]
        axes.semilogy(part.index + 1, part["residual"], color=LINES[0], linewidth=1.4)
        if begin:
            axes.axvline(begin + 0.5, color=FAINT, linewidth=0.7, linestyle=":")
        if len(start) <= 8:
            text = f"{int(part['unknowns'].iloc[0])} unknowns"
            axes.annotate(
                text, (begin + 0.6, 0.04), xycoords=axes.get_xaxis_transform(), fontsize=8, color=FAINT, va="bottom"
            )
    fresh = table["factorized"] > 0
    at = table.index + 1
    axes.scatter(at[fresh], table["residual"][fresh], s=28, color=LINES[0], zorder=3, label="new factorisation")
    axes.scatter(
        at[~fresh],
        table["residual"][~fresh],
        s=28,
        facecolor="white",
        edgecolor=LINES[0],
        linewidth=1.2,
        zorder=3,
        label="factors kept",
    )
    axes.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    axes.set_xlim(0.5, len(table) + 0.5)
    axes.set_ylim(float(table["residual"].min()) / 5, float(table["residual"].max()) * 5)
    dress(axes, "Newton's method", "iteration", "relative residual")
    legend(axes)
    return figure
