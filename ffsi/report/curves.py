"""Curves and heat maps of the points of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from ffsi.files.errors import InputError
from ffsi.report.tables import in_words, label, value_text, words
from ffsi.result.pictures import FAINT
from ffsi.result.views import INK
from ffsi.script.quantities import QUANTITIES
from ffsi.text import listed, nearest

LINES = ("#1b5e9b", "#c8553d", "#3d8b5f", "#8a5a9e", "#b08a1e", "#4a5560", "#2a9aa8", "#a6456b")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
MOST = len(LINES)
"""Lines that a legend tells apart; more of them are told apart by a scale of colours."""
NOT_CONVERGED = "not converged"
FAILURE: dict[str, Any] = {
    "linestyle": "none",
    "marker": "x",
    "markersize": 7,
    "markeredgewidth": 1.8,
    "label": NOT_CONVERGED,
}
_PARTS = ("", "_mean", "_last")  # what stands for a quantity: its value, that of the last period, the last one
_STYLES = ("-", "--", ":")
_BINS = 5
_WHOLE = 20  # range of whole numbers below which an axis shows these only
_DECADES = 50.0  # quotient of the largest and the smallest value above which an axis is logarithmic
_CELLS = 80  # of a heat map, at most, that have their number in them

# Title, axis label, and the columns with their names in the legend.
Panel = tuple[str, str, dict[str, str]]
AXES = {"N/m": "force per depth (N/m)", "m": "displacement (m)", "1": "min J"}
DRAWN = [quantity for quantity in QUANTITIES if quantity.plot]
PANELS: tuple[Panel, ...] = tuple(
    (plot, AXES[lines[0].unit], {line.name: in_words(line.words) for line in lines})
    for plot, lines in ((plot, list(lines)) for plot, lines in groupby(DRAWN, lambda quantity: quantity.plot))
)


def plot(table: pd.DataFrame, x: str, y: str, by: str | None = None, units: Mapping[str, str] | None = None) -> Figure:
    """Draw one column of a sweep's table over another one; crosses on the axis are points that did not converge.

    Args:
        table: a sweep's table (`sweep.csv`).
        x: column along the axis: numbers, or texts and truth values, which stand side by side.
        y: column of numbers, or a quantity of runs in time: its mean over the last period where there is one, else its
            last value, with thin lines from the smallest to the largest.
        by: column with one line for each of its values: up to `MOST` in a legend, more by a scale of colours.
        units: SI unit of each column; by default those of the quantities and of the scene's keys.

    Raises:
        InputError: there is no such column, or y holds no number.
    """
    shown = column(table, y)
    for name in (x, y if shown is None else shown, *([by] if by is not None else [])):
        if name not in table:
            guess = nearest(name, map(str, table))
            hint = f' (did you mean "{guess}"?)' if guess else f"; there is {listed(table)}"
            raise InputError(f"the table has no column {name!r}{hint}")
    if shown is None or not pd.api.types.is_numeric_dtype(table[shown]) or table[shown].dtype == bool:
        raise InputError(f"the column {shown or y!r} holds no numbers to draw")
    figure, (axes,) = _grid(1)
    several = _panel(axes, table, x, {shown: ""}, by, units)
    dress(axes, "", label(x, units), label(shown, units))
    if several:
        legend(axes, by, units)
    return figure


def column(table: pd.DataFrame, quantity: str) -> str | None:
    """Return the column that stands for a quantity: itself, its mean, or its last value; None without any."""
    for name in (quantity + part for part in _PARTS):
        if name in table and table[name].notna().any():
            return name
    return quantity if quantity in table else None


def sweep_curves(table: pd.DataFrame, keys: Sequence[str], units: Mapping[str, str] | None = None) -> Figure | None:
    """Draw forces, displacements and min J over the last varied key that takes several values.

    Args:
        table: a sweep's table (`sweep.csv`).
        keys: the varied keys.
        units: as in `plot`.

    Returns:
        The figure, or None if there is nothing to draw, or so many values change at once that lines say nothing.
        Points that did not converge are marked on the axis.
    """
    several = _several(table, keys)
    panels = _with_values(PANELS, table)
    if not several or not panels or (len(several) > 2 and not is_product(table, several)):
        return None
    along, by = several[-1], several[0] if len(several) == 2 else None
    if len(several) > 2:
        by = ", ".join(map(words, several[:-1]))
        table = table.assign(**{by: [", ".join(map(value_text, row)) for row in table[several[:-1]].to_numpy()]})
    figure, grid = _grid(len(panels))
    for axes, (title, name, columns) in zip(grid, panels, strict=True):
        if _panel(axes, table, along, columns, by, units):
            legend(axes, by, units)
        dress(axes, title, label(along, units), name)
    return figure


def heat_maps(table: pd.DataFrame, keys: Sequence[str], units: Mapping[str, str] | None = None) -> Figure | None:
    """Draw the same quantities over the two varied keys of a product, one map for each; None of anything else."""
    several = _several(table, keys)
    names = [name for _, _, columns in _with_values(PANELS, table) for name in columns]
    if len(several) != 2 or not names or not is_product(table, several):
        return None
    figure, grid = _grid(len(names))
    for axes, name in zip(grid, names, strict=True):
        _cells(figure, axes, table, several[1], several[0], name, units)
        axes.set_title(label(name, units), loc="left", fontsize=11, color=INK)
    return figure


def is_product(table: pd.DataFrame, keys: Sequence[str]) -> bool:
    """Return whether a table has one point for every combination of the values of its keys."""
    count = np.prod([table[key].nunique(dropna=False) for key in keys])
    return bool(count == len(table) == len(table.drop_duplicates(list(keys))))


def main_effects(table: pd.DataFrame, keys: Sequence[str], units: Mapping[str, str] | None = None) -> Figure | None:
    """Draw quantities over every varied key: all points, and the mean of those with the same value (or in one fifth).

    Args:
        table: a sweep's table (`sweep.csv`) of a design in which several keys change at once.
        keys: the varied keys.
        units: as in `plot`.

    Returns:
        One row of panels per quantity, one column per key; None if there is nothing to draw.
    """
    several = _several(table, keys)
    names = [next(iter(columns)) for _, _, columns in _with_values(PANELS, table)][:4]
    if len(several) < 2 or not names:
        return None
    solved = table[table["status"] == "converged"]
    figure = Figure(figsize=(11, 2.7 * len(names)), layout="constrained", facecolor="white")
    grid = figure.subplots(len(names), len(several), squeeze=False, sharey="row", sharex="col")
    for i, j in np.ndindex(grid.shape):
        axes: Axes = grid.item(i, j)
        key, name = several[j], names[i]
        at, texts = positions(table[key])
        here = at[solved.index]
        axes.plot(here, solved[name], linestyle="none", marker="o", markersize=4, color=LINES[0], alpha=0.45)
        bins = pd.cut(here, _BINS) if texts is None and here.nunique() > 2 * _BINS else here
        means = pd.DataFrame({"x": here, "y": solved[name]}).groupby(bins, observed=True).mean()
        axes.plot(means["x"], means["y"], color=LINES[1], linewidth=1.6, marker="D", markersize=4.5)
        _mark_failures(axes, table, at, INK)
        _categories(axes, texts)
        axes.ticklabel_format(axis="y", scilimits=(-4, 5), useMathText=True, useOffset=False)
        dress(axes, "", label(key, units) if i == len(names) - 1 else "", label(name, units) if j == 0 else "")
    return figure


def sensitivity_bars(logarithmic: Mapping[str, Mapping[str, float]]) -> Figure:
    """Draw p/J dJ/dp of quantities by parameters as bars, one panel for each quantity."""
    figure, grid = _grid(len(logarithmic))
    for axes, (name, of) in zip(grid, logarithmic.items(), strict=False):
        keys = sorted(of, key=lambda key: abs(of[key]))
        axes.barh(keys, [of[key] for key in keys], color=LINES[0])
        axes.axvline(0, color=INK, linewidth=0.8)
        dress(axes, name, "p/J dJ/dp", "")
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
    together = pd.concat([table.assign(_sweep=name) for name, table in tables.items()], ignore_index=True)
    shown = _with_values(panels, together)
    if not shown:
        return None
    figure, grid = _grid(len(shown))
    for axes, (title, name, columns) in zip(grid, shown, strict=True):
        _panel(axes, together, along, columns, "_sweep", dashed=True)
        dress(axes, title, label(along), name)
        axes.sharex(grid[0])
    entries = _entries(grid)
    if len(entries) > 1:
        figure.legend(
            entries.values(), entries.keys(), loc="outside lower center", ncols=len(entries), frameon=False,
            fontsize=9, labelcolor=INK,
        )  # fmt: skip
    return figure


def positions(values: pd.Series[Any]) -> tuple[pd.Series[float], list[str] | None]:
    """Return where values lie on an axis, and the texts of those that stand side by side; None of numbers."""
    if pd.api.types.is_numeric_dtype(values) and values.dtype != bool and values.notna().all():
        return values.astype(float), None
    texts = values.map(value_text)
    order = list(dict.fromkeys(texts))
    return texts.map(order.index).astype(float), order


def _several(table: pd.DataFrame, keys: Sequence[str]) -> list[str]:
    return [key for key in keys if table[key].nunique(dropna=False) > 1]


def _grid(count: int) -> tuple[Figure, list[Axes]]:
    rows = (count + 1) // 2
    figure = Figure(figsize=(11 if count > 1 else 7.5, 3.5 * rows + 0.9 * (count == 1)), layout="constrained")
    figure.set_facecolor("white")
    grid = list(np.ravel(figure.subplots(rows, min(2, count), squeeze=False)))
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def _with_values(panels: Sequence[Panel], table: pd.DataFrame) -> list[Panel]:
    solved = table[table["status"] == "converged"]
    return [(title, name, wanted) for title, name, columns in panels if (wanted := _present(solved, columns))]


def _present(table: pd.DataFrame, columns: dict[str, str]) -> dict[str, str]:
    there = {column(table, name): text for name, text in columns.items()}
    found = {name: text for name, text in there.items() if name is not None and table[name].notna().any()}
    if {"min_jacobian_fluid", "min_jacobian_solid"} & set(found):
        found.pop("min_jacobian", None)
    return found


def _panel(
    axes: Axes,
    table: pd.DataFrame,
    along: str,
    columns: Mapping[str, str],
    by: str | None,
    units: Mapping[str, str] | None = None,
    *,
    dashed: bool = False,
) -> bool:
    """Draw the lines of one panel, one for each column and each value of `by`; return whether they need a legend."""
    at, texts = positions(table[along])
    table = table.assign(_at=at)
    group, names = positions(table[by]) if by is not None else (pd.Series(0.0, table.index), None)
    values = sorted(group.unique())
    several, scale = len(values) > 1, None
    if several and len(values) * len(columns) > MOST:
        scale = (LogNorm if names is None and _spans_decades(group) else Normalize)(min(values), max(values))
    for i, value in enumerate(values):
        part = table[group == value].sort_values("_at")
        solved = part[part["status"] == "converged"] if "status" in part else part
        name = "" if by is None or scale else names[int(value)] if names is not None else value_text(value)
        for j, (shown, text) in enumerate(columns.items()):
            if not solved[shown].notna().any():
                continue
            number = i if several else j
            colour = LINES[number % MOST] if scale is None else colormaps["viridis"](scale(value))
            axes.plot(
                solved["_at"], solved[shown], color=colour, linewidth=1.5, markersize=4.5,
                label=", ".join(each for each in (text if len(columns) > 1 else "", name) if each),
                linestyle="--" if dashed and i else _STYLES[j % 3] if several else "-",
                marker=MARKERS[number % MOST] if scale is None else "o",
            )  # fmt: skip
            if f"{shown}_error" in solved:
                bars = solved[f"{shown}_error"]
                axes.errorbar(
                    solved["_at"], solved[shown], bars, fmt="none", ecolor=colour, capsize=2.5, elinewidth=0.8
                )
            ends = [f"{shown.rpartition('_')[0]}_{end}" for end in ("min", "max")]
            if shown.endswith(_PARTS[1:]) and set(ends) <= set(part):
                axes.vlines(solved["_at"], solved[ends[0]], solved[ends[1]], color=colour, linewidth=0.8, alpha=0.7)
        _mark_failures(axes, part, part["_at"], LINES[i % MOST] if several and scale is None else INK)
    if scale is not None:
        assert by is not None and axes.figure is not None
        bar = axes.get_figure().colorbar(ScalarMappable(scale, "viridis"), ax=axes, pad=0.02)  # type: ignore[union-attr]
        bar.set_label(label(by, units), color=INK, fontsize=9)
        bar.ax.tick_params(colors=INK, labelsize=8)
        if names is not None:
            shown_at = np.unique(np.linspace(0, len(names) - 1, 2 * MOST).round().astype(int))
            bar.set_ticks(shown_at.tolist(), labels=[names[k] for k in shown_at])
    axes.ticklabel_format(axis="y", scilimits=(-4, 5), useMathText=True, useOffset=False)
    _categories(axes, texts)
    if texts is None and _spans_decades(at):
        axes.set_xscale("log")
    elif texts is None and (at % 1 == 0).all() and at.max() - at.min() < _WHOLE:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if any(name.startswith("min_jacobian") for name in columns):
        axes.axhline(0, color=LINES[1], linewidth=0.8, linestyle=":")
    return len(columns) > 1 or (several and scale is None) or NOT_CONVERGED in _entries([axes])


def _spans_decades(values: pd.Series[float]) -> bool:
    return bool(values.min() > 0 and values.max() > _DECADES * values.min())


def _categories(axes: Axes, texts: Sequence[str] | None) -> None:
    if texts is not None:
        steep = sum(map(len, texts)) > 50
        axes.set_xticks(range(len(texts)), texts, rotation=30 if steep else 0, ha="right" if steep else "center")
        axes.set_xlim(-0.5, len(texts) - 0.5)


def _mark_failures(axes: Axes, table: pd.DataFrame, at: pd.Series[float], colour: str) -> None:
    """Mark the points that failed on the axis; those that were not tried because of them are left out."""
    failed = at[_failed(table)]
    if not failed.empty:
        zero = np.zeros(len(failed))
        axes.plot(failed, zero, color=colour, transform=axes.get_xaxis_transform(), clip_on=False, zorder=4, **FAILURE)


def _failed(table: pd.DataFrame) -> pd.Series[bool]:
    failed = table["status"] != "converged" if "status" in table else pd.Series(False, table.index)
    return failed & (table["failure"] != "not-reached") if "failure" in table else failed


def _cells(
    figure: Figure, axes: Axes, table: pd.DataFrame, x: str, y: str, value: str, units: Mapping[str, str] | None
) -> None:
    places: list[NDArray[np.intp]] = []
    for key, tick, axis in ((x, axes.set_xticks, 30), (y, axes.set_yticks, 0)):
        at, texts = positions(table[key])
        every = np.unique(at)
        places.append(np.searchsorted(every, at))
        names = texts if texts is not None else [value_text(each) for each in every]
        tick(range(len(names)), names, rotation=axis if sum(map(len, names)) > 40 else 0)
    grid = np.full((int(places[1].max()) + 1, int(places[0].max()) + 1), np.nan)
    solved = (table["status"] == "converged").to_numpy() if "status" in table else np.full(len(table), True)
    grid[places[1][solved], places[0][solved]] = table[value].to_numpy(dtype=float)[solved]
    colours = axes.imshow(grid, origin="lower", aspect="auto", cmap="viridis")
    failed = _failed(table).to_numpy()
    axes.plot(places[0][failed], places[1][failed], color=INK, **FAILURE)
    if grid.size <= _CELLS:
        middle = (np.nanmin(grid) + np.nanmax(grid)) / 2
        for i, j in np.argwhere(np.isfinite(grid)):
            shade = INK if grid[i, j] > middle else "white"
            axes.text(j, i, f"{grid[i, j]:.3g}", ha="center", va="center", fontsize=8, color=shade)
    else:
        bar = figure.colorbar(colours, ax=axes, pad=0.02)
        bar.ax.tick_params(colors=INK, labelsize=8)
    dress(axes, "", label(x, units), label(y, units))
    axes.grid(False)


def dress(axes: Axes, title: str, x: str, y: str) -> None:
    """Give axes their title, their labels and the look of all curves."""
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


def legend(axes: Axes, by: str | None = None, units: Mapping[str, str] | None = None) -> None:
    """Put the legend below the curves, where it covers none of them."""
    if entries := _entries([axes]):
        heading = label(by, units) if by is not None and list(entries) != [NOT_CONVERGED] else None
        axes.legend(
            entries.values(), entries.keys(), title=heading, frameon=False,
            fontsize=9, title_fontsize=9, labelcolor=INK, ncols=min(4, len(entries)), loc="upper center",
            bbox_to_anchor=(0.5, -0.2),
        )  # fmt: skip


def _entries(grid: Sequence[Axes]) -> dict[str, Artist]:
    """Return the legend's entries, each once, the mark of failures last."""
    found: dict[str, Artist] = {}
    for axes in grid:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            if name and not name.startswith("_"):
                found.setdefault(name, handle)
    if found.pop(NOT_CONVERGED, None) is not None:
        found[NOT_CONVERGED] = Line2D([], [], color=INK, **FAILURE)
    return found
