"""Curves: quantities over a sweep's parameter or over time, and Newton's history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ffsi.result.pictures import FAINT, INK
from ffsi.result.quantities import QUANTITIES

LINES = ("#1b5e9b", "#c8553d", "#3d8b5f", "#8a5a9e", "#b08a1e", "#4a5560")
MARKERS = ("o", "s", "^", "D", "v", "P")
NOT_CONVERGED = "not converged"
FAILURE: dict[str, Any] = {
    "linestyle": "none",
    "marker": "x",
    "markersize": 7,
    "markeredgewidth": 1.8,
    "label": NOT_CONVERGED,
}
LABELS = {
    "inflow.mean_velocity": "mean inflow velocity (m/s)",
    "mesh.level": "mesh level",
    "fluid.viscosity": "dynamic viscosity (Pa s)",
    "fluid.density": "fluid density (kg/m³)",
}


def _in_legend(words: str) -> str:
    return f"${words}$" if "_" in words else words


# Title, axis label, and the columns with their names in the legend.
Panel = tuple[str, str, dict[str, str]]
AXES = {"N/m": "force per depth (N/m)", "m": "displacement (m)", "1": "min J"}
_DRAWN = [quantity for quantity in QUANTITIES if quantity.plot]
PANELS: tuple[Panel, ...] = tuple(
    (plot, AXES[lines[0].unit], {line.name: _in_legend(line.words) for line in lines})
    for plot, lines in ((plot, list(lines)) for plot, lines in groupby(_DRAWN, lambda quantity: quantity.plot))
)
# Over time: title, axis label, column.
TIME_PANELS = tuple(
    (f"{item.plot} {_in_legend(item.words)}" if item.unit == "m" else item.plot, AXES[item.unit], item.name)
    for item in _DRAWN
    if "sweep" in item.tables
)
ZOOMED = 2
"""Periods in the enlarged part of a history."""


def sweep_curves(table: pd.DataFrame, keys: Sequence[str]) -> Figure | None:
    """Draw forces, displacements and min J over the last varied key that takes several values.

    Args:
        table: a sweep's table (`sweep.csv`).
        keys: the varied keys.

    Returns:
        The figure, or None if there is nothing to draw. Points that did not converge are marked on the axis.
    """
    along = next((key for key in reversed(keys) if table[key].nunique() > 1), None)
    panels = _with_values(PANELS, table)
    if along is None or not panels:
        return None
    groups = _groups(table, [key for key in keys if key != along and table[key].nunique() > 1])
    figure, grid = _grid(len(panels))
    for axes, (title, label, columns) in zip(grid, panels, strict=True):
        if _panel(axes, groups, along, columns):
            _legend(axes)
        _dress(axes, title, LABELS.get(along, along), label)
    return figure


def compare_sweeps(tables: Mapping[str, pd.DataFrame], along: str, panels: Sequence[Panel]) -> Figure | None:
    """Draw the same quantities of several sweeps, each panel with one line per sweep and a common legend below.

    Args:
        tables: the sweeps' tables (`sweep.csv`) by their name in the legend; the lines after the first are dashed.
        along: the varied key.
        panels: title, axis label and the one column of each panel.

    Returns:
        The figure, or None if there is nothing to draw. Points that did not converge are marked on the axis.
    """
    shown = _with_values(panels, pd.concat(tables.values()))
    if not shown:
        return None
    figure, grid = _grid(len(shown))
    for axes, (title, label, columns) in zip(grid, shown, strict=True):
        _panel(axes, list(tables.items()), along, columns, dashed=True)
        _dress(axes, title, LABELS.get(along, along), label)
        axes.sharex(grid[0])
    entries = _entries(grid)
    if len(entries) > 1:
        figure.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=len(entries), frameon=False,
            fontsize=9, labelcolor=INK,
        )  # fmt: skip
    return figure


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
            _dress(axes, title if axes is row[0] else "", "time (s)" if number == len(panels) else "", label)
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
    _dress(axes, "Newton's method", "iteration", "relative residual")
    _legend(axes)
    return figure


def _grid(count: int) -> tuple[Figure, list[Axes]]:
    rows = (count + 1) // 2
    figure = Figure(figsize=(11, 3.5 * rows), layout="constrained", facecolor="white")
    grid = list(np.ravel(figure.subplots(rows, min(2, count), squeeze=False)))
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def _with_values(panels: Sequence[Panel], table: pd.DataFrame) -> list[Panel]:
    solved = table[table["status"] == "converged"]
    return [(title, label, wanted) for title, label, columns in panels if (wanted := _present(solved, columns))]


def _panel(
    axes: Axes,
    groups: Sequence[tuple[str, pd.DataFrame]],
    along: str,
    columns: dict[str, str],
    *,
    dashed: bool = False,
) -> bool:
    """Draw the lines of one panel; return whether they need a legend."""
    several = len(groups) > 1
    for i, (group, table) in enumerate(groups):
        table = table.sort_values(along)
        solved = table[table["status"] == "converged"]
        there = {column: name for column, name in columns.items() if column in table}
        for j, (column, name) in enumerate(there.items()):
            label = ", ".join(part for part in (name if len(columns) > 1 else "", group) if part)
            number = i if several else j
            line = ("-", "--", ":")[j % 3] if several else "-"
            axes.plot(
                solved[along], solved[column], color=LINES[number % len(LINES)], label=label, linewidth=1.5,
                linestyle="--" if dashed and i else line, marker=MARKERS[number % len(MARKERS)], markersize=4.5,
            )  # fmt: skip
        if there:
            _mark_failures(axes, table, along, LINES[i % len(LINES)] if several else INK)
    axes.ticklabel_format(axis="y", scilimits=(-4, 5), useMathText=True)
    if any(name.startswith("min_jacobian") for name in columns):
        axes.axhline(0, color=LINES[1], linewidth=0.8, linestyle=":")
    return len(columns) > 1 or several or NOT_CONVERGED in _entries([axes])


def _mark_failures(axes: Axes, table: pd.DataFrame, along: str, colour: str) -> None:
    """Mark the points that failed on the axis; those that were not tried because of them are left out."""
    failed = table[table["status"] != "converged"]
    if "failure" in failed:
        failed = failed[failed["failure"] != "not-reached"]
    if not failed.empty:
        at = np.zeros(len(failed))
        axes.plot(
            failed[along], at, color=colour, transform=axes.get_xaxis_transform(), clip_on=False, zorder=4, **FAILURE
        )


def _present(table: pd.DataFrame, columns: dict[str, str]) -> dict[str, str]:
    found = {column: name for column, name in columns.items() if column in table and table[column].notna().any()}
    if {"min_jacobian_fluid", "min_jacobian_solid"} & set(found):
        found.pop("min_jacobian", None)
    return found


def _groups(table: pd.DataFrame, others: Sequence[str]) -> list[tuple[str, pd.DataFrame]]:
    if not others:
        return [("", table)]
    groups = []
    for values, part in table.groupby(list(others), sort=False):
        groups.append((", ".join(f"{key} = {value:g}" for key, value in zip(others, values, strict=True)), part))
    return groups


def _dress(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.set_xlabel(x, color=INK)
    axes.set_ylabel(y, color=INK)
    axes.tick_params(colors=INK, labelsize=9, width=0.6)
    axes.grid(True, color="#e3e6ea", linewidth=0.7)
    axes.set_axisbelow(True)
    for name, side in axes.spines.items():
        side.set_visible(name in ("left", "bottom"))
        side.set_color(FAINT)
        side.set_linewidth(0.7)


def _legend(axes: Axes) -> None:
    if entries := _entries([axes]):
        axes.legend(entries.values(), entries.keys(), frameon=False, fontsize=9, labelcolor=INK)


def _entries(grid: Sequence[Axes]) -> dict[str, Artist]:
    """Return the legend's entries, each once, the mark of failures last."""
    found: dict[str, Artist] = {}
    for axes in grid:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            if label and not label.startswith("_"):
                found.setdefault(label, handle)
    if found.pop(NOT_CONVERGED, None) is not None:
        found[NOT_CONVERGED] = Line2D([], [], color=INK, **FAILURE)
    return found
