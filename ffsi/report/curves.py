"""Curves: quantities over a sweep's parameter, and Newton's history."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ffsi.report.figures import FAINT, INK

LINES = ("#1b5e9b", "#c8553d", "#3d8b5f", "#8a5a9e", "#b08a1e", "#4a5560")
MARKERS = ("o", "s", "^", "D", "v", "P")
LABELS = {
    "inflow.mean_velocity": "mean inflow velocity (m/s)",
    "mesh.level": "mesh level",
    "fluid.viscosity": "dynamic viscosity (Pa s)",
    "fluid.density": "fluid density (kg/m³)",
}
# Title, axis label, and the columns with their names in the legend.
PANELS: tuple[tuple[str, str, dict[str, str]], ...] = (
    ("Drag", "force per depth (N/m)", {"drag": "drag"}),
    ("Lift", "force per depth (N/m)", {"lift": "lift"}),
    ("Tip displacement", "displacement (m)", {"tip_ux": "$u_x$", "tip_uy": "$u_y$"}),
    (
        "Smallest J = det F",
        "min J",
        {"min_jacobian_fluid": "fluid mesh", "min_jacobian_solid": "solid", "min_jacobian": "all"},
    ),
)


def sweep_curves(table: pd.DataFrame, keys: Sequence[str]) -> Figure | None:
    """Draw drag, lift, tip displacement and min J over the last varied key that takes several values.

    Args:
        table: a sweep's table (`sweep.csv`).
        keys: the varied keys.

    Returns:
        The figure, or None if there is nothing to draw. Points that did not converge are marked on the axis.
    """
    along = next((key for key in reversed(keys) if table[key].nunique() > 1), None)
    solved = table[table["status"] == "converged"]
    panels = [
        (title, label, wanted)
        for title, label, columns in PANELS
        if (wanted := _present(solved, columns)) and not solved.empty
    ]
    if along is None or not panels:
        return None
    groups = _groups(table, [key for key in keys if key != along and table[key].nunique() > 1])
    rows = (len(panels) + 1) // 2
    figure = Figure(figsize=(11, 3.5 * rows), layout="constrained", facecolor="white")
    grid = np.atleast_1d(figure.subplots(rows, min(2, len(panels)), squeeze=False)).ravel()
    for axes, (title, label, columns) in zip(grid, panels, strict=False):
        _panel(axes, groups, along, columns)
        _dress(axes, title, LABELS.get(along, along), label)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    return figure


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


def _panel(axes: Axes, groups: Sequence[tuple[str, pd.DataFrame]], along: str, columns: dict[str, str]) -> None:
    several = len(groups) > 1
    for i, (group, table) in enumerate(groups):
        table = table.sort_values(along)
        failed = table[table["status"] != "converged"]
        solved = table[table["status"] == "converged"]
        for j, (column, name) in enumerate(columns.items()):
            label = ", ".join(part for part in (name if len(columns) > 1 else "", group) if part)
            colour = LINES[(i if several else j) % len(LINES)]
            style: dict[str, Any] = {
                "linestyle": ("-", "--", ":")[j % 3] if several else "-",
                "marker": MARKERS[(i if several else j) % len(MARKERS)],
            }
            axes.plot(solved[along], solved[column], color=colour, linewidth=1.5, markersize=4.5, label=label, **style)
        if not failed.empty:
            axes.plot(
                failed[along], np.zeros(len(failed)), transform=axes.get_xaxis_transform(), clip_on=False,
                linestyle="none", marker="x", color=INK, markersize=7, markeredgewidth=1.6,
                label="not converged" if i == 0 else "_",
            )  # fmt: skip
    if any("J" in name or name.startswith("min_jacobian") for name in columns):
        axes.axhline(0, color=LINES[1], linewidth=0.8, linestyle=":")
    if len(columns) > 1 or several or axes.get_legend_handles_labels()[1].count("not converged"):
        _legend(axes)


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
    handles, labels = axes.get_legend_handles_labels()
    known = {
        label: handle for handle, label in zip(handles, labels, strict=True) if label and not label.startswith("_")
    }
    if known:
        axes.legend(known.values(), known.keys(), frameon=False, fontsize=9, labelcolor=INK)
