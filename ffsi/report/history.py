"""Histories: quantities over time and over each other, their spectrum, energy; Newton's residuals."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ffsi.files.arrays import Floats
from ffsi.report.curves import AXES, DRAWN, LINES, dress, legend
from ffsi.report.tables import in_words, label
from ffsi.result.oscillation import reference_column
from ffsi.result.pictures import FAINT
from ffsi.result.quantities import unit

# Over time: title, axis label, column.
TIME_PANELS = tuple(
    (f"{item.plot} {in_words(item.words)}" if item.unit == "m" else item.plot, AXES[item.unit], item.name)
    for item in DRAWN
    if "sweep" in item.tables
)
ZOOMED = 2
"""Periods in the enlarged part of a history."""
SHOWN = 10
"""Periods, at most, in the phase plane and the spectrum."""
_FEWEST, _LOWEST = 16, 1e-6
MOTION_TEXT = (
    "Phase plane of the signal that tells a period, one signal over the other (red: the end), and the spectrum of the "
    f"first through a Hann window; of a periodic motion its last {SHOWN} periods."
)
ENERGY_TEXT = (
    "Kinetic energy, and elastic, dissipated and supplied energy since the start; the imbalance is the error of the "
    "steps in time and of the flow's mesh."
)


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
    for number, (row, (title, name, column)) in enumerate(zip(grid, panels, strict=True), start=1):
        for axes, part in zip(row, (history, _end(history, period)), strict=False):
            axes.plot(part["time"], part[column], color=LINES[0], linewidth=1.1)
            if period:
                axes.axvspan(*period, color=FAINT, alpha=0.15, linewidth=0)
            axes.ticklabel_format(axis="y", scilimits=(-4, 5), useMathText=True, useOffset=False)
            dress(axes, title if axes is row[0] else "", "time (s)" if number == len(panels) else "", name)
    return figure


def motion(history: pd.DataFrame, period: tuple[float, float] | None = None) -> Figure | None:
    """Draw the phase plane of the signal that tells a period, lift over drag, and the spectrum of the signal.

    Args:
        history: one row per step: `time` (s) and the quantities in SI.
        period: start and end of the last period, s: of what comes before its last `SHOWN` periods nothing is drawn.

    Returns:
        The figure, or None with too few steps, or without a signal.
    """
    name = reference_column(history)
    if period is not None:
        history = history[history["time"] >= period[1] - SHOWN * (period[1] - period[0])]
    if name is None or len(history) < _FEWEST:
        return None
    t, y = history["time"].to_numpy(dtype=float), history[name].to_numpy(dtype=float)
    planes = [(y, np.gradient(y, t), label(name), f"its rate ({unit(name)}/s)", "Phase plane")]
    pair = next((pair for pair in (("tip_ux", "tip_uy"), ("drag", "lift")) if set(pair) <= set(history)), None)
    if pair is not None:
        first, second = (history[each].to_numpy(dtype=float) for each in pair)
        planes.append((first, second, label(pair[0]), label(pair[1]), "One over the other"))
    figure = Figure(figsize=(11, 3.6), layout="constrained", facecolor="white")
    *axes_of_planes, last = figure.subplots(1, len(planes) + 1)
    for axes, (across, up, x, above, title) in zip(axes_of_planes, planes, strict=True):
        axes.plot(across, up, color=LINES[0], linewidth=0.9)
        axes.plot(across[-1], up[-1], color=LINES[1], marker="o", markersize=5)
        axes.ticklabel_format(axis="both", scilimits=(-3, 4), useMathText=True)
        dress(axes, title, x, above)
    last.semilogy(*spectrum(t, y), color=LINES[0], linewidth=1.1)
    dress(last, "Spectrum", "frequency (Hz)", f"amplitude ({unit(name)})")
    return figure


def spectrum(t: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return frequencies (Hz) and the amplitudes there of a signal without its mean, through a Hann window.

    Only frequencies up to those of ten steps, and at least `_LOWEST` of the largest amplitude.
    """
    even = np.linspace(t[0], t[-1], len(t))
    values = np.interp(even, t, y)
    window = np.hanning(len(values))
    sizes = np.abs(np.fft.rfft((values - values.mean()) * window)) * 2 / window.sum()
    frequencies = np.fft.rfftfreq(len(values), even[1] - even[0])
    shown = slice(1, max(len(frequencies) // 5, 4))
    return frequencies[shown], np.maximum(sizes[shown], _LOWEST * sizes.max() or 1e-300)


def energy(history: pd.DataFrame) -> Figure | None:
    """Draw where the energy went, J per metre of depth, and what the balance misses; None without the columns."""
    if history.empty or not {"kinetic", "elastic", "dissipated", "work"} <= set(history):
        return None
    figure = Figure(figsize=(11, 3.8), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    left = history["kinetic"] + history["elastic"] + history["dissipated"] - history["work"]
    parts = {name: history[name] for name in ("work", "kinetic", "elastic", "dissipated")} | {"imbalance": left}
    for i, (name, values) in enumerate(parts.items()):
        axes.plot(history["time"], values, color=LINES[i], linewidth=1.2, label=name, linestyle="-" if i else "--")
    axes.ticklabel_format(axis="y", scilimits=(-4, 5), useMathText=True, useOffset=False)
    dress(axes, "Energy", "time (s)", "energy per depth (J/m)")
    legend(axes)
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
