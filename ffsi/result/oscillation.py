"""What a computation in time comes to: mean, amplitude and frequency of a periodic motion.

The rule is that of the benchmarks: over the last full period of a reference signal (the tip's u_y, or the lift) the
mean is (max + min)/2 and the amplitude (max - min)/2. A period runs from one crossing of the mean upwards to the next.
Maxima, minima and crossings lie between the time steps: they are those of polynomials fitted nearby.

Times are in s and may be unevenly spaced, values in any one unit, frequencies in Hz.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ffsi.files.arrays import Floats

if TYPE_CHECKING:
    import pandas as pd

BLOCK = 2
"""Periods of one of the two blocks that `periodic` compares."""

REFERENCES = ("tip_uy", "lift", "drag")
"""Signals whose last full period may count, by `reference_column`."""
ENERGIES = ("kinetic", "elastic", "dissipated", "work")
_NO_QUANTITIES = frozenset({"time", "step", "iterations", "factorized", "min_jacobian", "seconds", *ENERGIES})
# The largest change between two blocks that is periodic, of the amplitude and of the mean, relative to the amplitude.
_ACCEPTED = 0.02

# A crossing of the mean counts if the signal was this part of its amplitude below and is now as much above.
_THRESHOLD = 0.5
# Points within these parts of a period are fitted at a maximum (or minimum) and at a crossing.
_AT_PEAK, _AT_CROSSING = 0.085, 0.085
# An amplitude below this part of the largest value is rounding.
_ROUNDING = 1e-11
# A force below this part of another one is what steps leave that are solved to the default of solver.step_tolerance.
_UNSOLVED = 3e-5
_HARMONICS = 20
# Periods that differ by more than this part of their standard deviation do not repeat.
_DIFFERENT = 0.5
_PHASES = 129
# Parts of the whole, at its end, in which periods are looked for.
_PARTS = tuple(2.0 ** (power / 2) for power in range(-10, 1))


@dataclass(frozen=True)
class Oscillation:
    """The last full period of a signal, from `start` to `end` (s).

    `mean` is (max + min)/2 and `amplitude` (max - min)/2 in the signal's unit, `frequency` in Hz; they are NaN without
    a period, the frequency also of a constant signal. `reason` says why; it is empty if none is NaN.
    """

    mean: float
    amplitude: float
    frequency: float
    start: float = math.nan
    end: float = math.nan
    reason: str = ""

    def as_dict(self) -> dict[str, float]:
        """Return mean, amplitude (both in the signal's unit) and frequency (Hz) by name."""
        return {"mean": self.mean, "amplitude": self.amplitude, "frequency": self.frequency}


@dataclass(frozen=True)
class Periodicity:
    """Whether a motion is periodic; true or false as a condition.

    The changes of amplitude and mean are those from one block of periods to the next, relative to the later amplitude;
    NaN with too few periods. `reason` says why it is not periodic; it is empty if it is.
    """

    periodic: bool
    amplitude_change: float = math.nan
    mean_change: float = math.nan
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether the motion is periodic."""
        return self.periodic


def mean_amplitude_frequency(t: ArrayLike, y: ArrayLike, reference: ArrayLike | None = None) -> Oscillation:
    """Return mean, amplitude and frequency over the last full period.

    Args:
        t: times, s, increasing.
        y: values of the signal.
        reference: values of the signal whose last full period is taken; None: `y` itself.

    Returns:
        The oscillation. With a reference the frequency is that multiple of the reference's which is strongest in `y`:
        twice it for the drag of an oscillating beam. Without a full period, or where a step is longer than a quarter
        of it, all values are NaN, with the reason; what does not repeat from one period to the next has no frequency.

    Raises:
        ValueError: the arrays do not have the same length, a value is not finite, or the times do not increase.
    """
    times, values = _signal(t, y)
    _, other = _signal(t, y if reference is None else reference)
    crossings = _crossings(times, other, 2)
    if len(crossings) < 2:
        return Oscillation(math.nan, math.nan, math.nan, reason=_too_few(crossings, 1))
    start, end = float(crossings[-2]), float(crossings[-1])
    if text := _gap(times, start, end, end - start):
        return Oscillation(math.nan, math.nan, math.nan, reason=text)
    lowest, highest = _extrema(times, values, start, end)
    found = Oscillation((highest + lowest) / 2, (highest - lowest) / 2, 1.0 / (end - start), start, end)
    if found.amplitude <= _ROUNDING * float(np.abs(values).max()):
        return replace(found, frequency=math.nan, reason="the signal is constant")
    if not _repeats(times, values, start, end):
        return replace(found, frequency=math.nan, reason="the signal does not repeat from one period to the next")
    if reference is None:
        return found
    return replace(found, frequency=_strongest(times, values, start, end) / (end - start))


def periodic(t: ArrayLike, y: ArrayLike) -> Periodicity:
    """Return whether a motion has become periodic: two successive blocks of two periods each agree.

    Arguments and errors as `mean_amplitude_frequency`.
    """
    times, values = _signal(t, y)
    crossings = _crossings(times, values, 2 * BLOCK + 1)
    if len(crossings) < 2 * BLOCK + 1:
        return Periodicity(False, reason=_too_few(crossings, 2 * BLOCK))
    edges = [float(crossings[-1 - 2 * BLOCK]), float(crossings[-1 - BLOCK]), float(crossings[-1])]
    if text := _gap(times, edges[0], edges[2], (edges[2] - edges[0]) / (2 * BLOCK)):
        return Periodicity(False, reason=text)
    blocks = [_extrema(times, values, start, end) for start, end in itertools.pairwise(edges)]
    before, after = ((high - low) / 2 for low, high in blocks)
    amplitude = abs(after - before) / after
    mean = abs(sum(blocks[1]) - sum(blocks[0])) / 2 / after
    for name, change in (("amplitude", amplitude), ("mean", mean)):
        if not change < _ACCEPTED:
            text = f"the {name} changes by {100 * change:.2g} % of the amplitude, accepted: {100 * _ACCEPTED:.2g} %"
            return Periodicity(False, amplitude, mean, text)
    return Periodicity(True, amplitude, mean)


def blocks(t: ArrayLike, y: ArrayLike) -> list[Oscillation]:
    """Return the successive blocks of two periods, the last one ending at the last crossing of the mean.

    The first one begins where the amplitude has come to at least half of the final one; with too few periods there is
    none. Arguments and errors as `mean_amplitude_frequency`.
    """
    times, values = _signal(t, y)
    crossings = _crossings(times, values, len(times))
    edges = [float(edge) for edge in crossings[(len(crossings) - 1) % BLOCK :: BLOCK]]
    found = []
    for start, end in itertools.pairwise(edges):
        lowest, highest = _extrema(times, values, start, end, (end - start) / BLOCK)
        found.append(Oscillation((highest + lowest) / 2, (highest - lowest) / 2, BLOCK / (end - start), start, end))
    return found


def oscillations(history: pd.DataFrame) -> dict[str, Oscillation]:
    """Return the last full period, that of `reference_column` (without it each one's own), of every quantity by name.

    Args:
        history: one row per time step: the column `time` (s) and one for each quantity (SI); columns on the
            computation itself (`step`, `iterations`, ...) are left out.

    Raises:
        KeyError: the history has no column `time`.
        ValueError: as `mean_amplitude_frequency`.
    """
    t, reference = history["time"], reference_column(history)
    return {
        name: mean_amplitude_frequency(t, history[name], None if reference in (None, name) else history[reference])
        for name in map(str, history.columns)
        if name not in _NO_QUANTITIES
    }


def reference_column(history: pd.DataFrame) -> str | None:
    """Return the column whose period counts: `tip_uy`, without it `lift`; None without both.

    `drag`, where the lift is no more beside it than what ordinary steps leave unsolved: on the walls of a channel and
    on whatever else is symmetric. What the start has left does not count.
    """
    tip, lift, drag = REFERENCES
    if tip in history.columns or lift not in history.columns:
        return tip if tip in history.columns else None
    if drag in history.columns and len(history) and history[lift].notna().all():
        sizes = history[[lift, drag]][len(history) // 2 :].abs().max(skipna=False)
        if sizes[drag] > 0 and sizes[lift] <= _UNSOLVED * sizes[drag]:
            return drag
    return lift


# Crossings and extrema --------------------------------------------------------------------------------------------


def _signal(t: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    times, values = np.asarray(t, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if times.ndim != 1 or times.shape != values.shape:
        raise ValueError(f"times and values must be two lists of the same length, not {times.shape}, {values.shape}")
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise ValueError("a time or value is not finite")
    if (np.diff(times) <= 0.0).any():
        raise ValueError("the times do not increase")
    return times, values


def _gap(t: Floats, start: float, end: float, period: float) -> str:
    """Return in words that a step between two times (s) is too long for a period (s); empty if none is."""
    first, last = np.searchsorted(t, [start - period, end])
    longest = float(np.diff(t[max(first - 1, 0) : last + 1]).max(initial=0.0))
    return f"a step of {longest:.3g} s is too long for a period of {period:.3g} s" if longest > period / 4 else ""


def _repeats(t: Floats, y: Floats, start: float, end: float) -> bool:
    """Return whether y is much the same in the period before, or, where there is none, ends as it has begun."""
    phase = np.linspace(start, end, _PHASES)
    last, period = np.interp(phase, t, y), end - start
    if start - period < t[0]:
        return abs(float(last[-1] - last[0])) <= _DIFFERENT * float(np.ptp(last))
    before = np.interp(phase - period, t, y)
    return float(np.sqrt(np.mean((last - before) ** 2))) <= _DIFFERENT * float(np.std(last))


def _too_few(crossings: Floats, periods: int) -> str:
    found = max(len(crossings) - 1, 0)
    return f"{found} full period{'s' * (found != 1)} found, {periods} needed"


def _crossings(t: Floats, y: Floats, count: int) -> Floats:
    """Return the times at which y crosses its mean upwards, at the end of the signal.

    Of the parts at the end of the signal, each longer than the one before, the first with more than `count` crossings
    is taken: a drift at the start must not count. If none has them, it is that with most crossings.
    """
    if not len(t) or np.ptp(y) <= _ROUNDING * np.abs(y).max():
        return np.empty(0)
    best = np.empty(0)
    for part in _PARTS:
        first = int(np.searchsorted(t, t[-1] - part * (t[-1] - t[0])))
        if len(t) - first >= 4:
            found = _crossings_of(t[first:], y[first:])
            if len(found) > len(best) and _regular(found):
                best = found
            if len(best) > count:
                break
    return best


def _regular(crossings: Floats) -> bool:
    """Return whether no period is more than twice another: else it is noise or a drift that crosses the mean."""
    periods = np.diff(crossings)
    return not len(periods) or float(periods.max()) <= 2.0 * float(periods.min())


def _crossings_of(t: Floats, y: Floats) -> Floats:
    """Return the upward crossings of (max + min)/2, where max and min are those of the last period."""
    found = _places(y, float(y.max() + y.min()) / 2, float(np.ptp(y)) / 2)
    if len(found) >= 2:
        last = y[found[-2] : found[-1] + 2]
        found = _places(y, float(last.max() + last.min()) / 2, float(np.ptp(last)) / 2)
    if len(found) < 2:
        return t[found]
    last = y[found[-2] : found[-1] + 2]
    level, period = float(last.max() + last.min()) / 2, float(t[found[-1]] - t[found[-2]])
    # The mean of the maximum and the minimum themselves, not of the values beside them.
    lowest, highest = _extrema(t, y, float(t[found[-2]]), float(t[found[-2]]) + period, period)
    level = (lowest + highest) / 2
    return np.array([_crossing(t, y, place, level, period) for place in found])


def _places(y: Floats, level: float, amplitude: float) -> NDArray[np.intp]:
    """Return i for every crossing of the level upwards between i and i + 1: from well below it to well above."""
    side = np.where(y > level + _THRESHOLD * amplitude, 1, np.where(y < level - _THRESHOLD * amplitude, -1, 0))
    far = np.flatnonzero(side)
    rises = np.flatnonzero(np.diff(side[far]) > 0)
    places = []
    for before, after in zip(far[rises], far[rises + 1], strict=True):
        between = y[before : after + 1]
        up = before + np.flatnonzero((between[:-1] <= level) & (between[1:] > level))
        places.append(up[len(up) // 2])
    return np.array(places, dtype=np.intp)


def _crossing(t: Floats, y: Floats, place: int, level: float, period: float) -> float:
    """Return where y crosses the level near the points `place` and `place` + 1, s."""
    middle = t[place] + (t[place + 1] - t[place]) * (level - y[place]) / (y[place + 1] - y[place])
    near = np.flatnonzero(np.abs(t - middle) <= _AT_CROSSING * period)
    if len(near) < 5:
        near = np.arange(max(place - 1, 0), min(place + 3, len(t)))
    degree = min(3, len(near) - 1)
    x = (t[near] - middle) / period
    roots = np.roots(np.polyfit(x, y[near] - level, degree))
    real = roots[np.abs(roots.imag) < 1e-9 * (1.0 + np.abs(roots.real))].real
    root = float(real[np.argmin(np.abs(real))]) if len(real) else math.nan
    return float(middle + period * root) if abs(root) <= _AT_CROSSING else float(middle)


def _extrema(t: Floats, y: Floats, start: float, end: float, own: float | None = None) -> tuple[float, float]:
    """Return the smallest and the largest value of y from start to end, between the points, too.

    `own` is the period of y in s; None: that of its strongest harmonic.
    """
    inside = np.flatnonzero((t >= start) & (t <= end))
    if not len(inside):
        ends = np.interp([start, end], t, y)
        return float(ends.min()), float(ends.max())
    period = own or (end - start) / _strongest(t, y, start, end)
    low, high = inside[np.argmin(y[inside])], inside[np.argmax(y[inside])]
    return -_peak(t, -y, int(low), period), _peak(t, y, int(high), period)


def _peak(t: Floats, y: Floats, place: int, period: float) -> float:
    """Return the maximum near the point `place`, which no point around it exceeds."""
    if not 0 < place < len(t) - 1 or y[place] < max(y[place - 1], y[place + 1]):
        return float(y[place])
    near = np.flatnonzero(np.abs(t - t[place]) <= _AT_PEAK * period)
    degree = 4
    if len(near) < 7:
        near, degree = np.arange(place - 1, place + 2), 2
    x = (t[near] - t[place]) / period
    polynomial = np.polyfit(x, y[near] - y[place], degree)
    return float(y[place] + np.polyval(polynomial, np.linspace(x[0], x[-1], 401)).max())


def _strongest(t: Floats, y: Floats, start: float, end: float) -> int:
    """Return the number of the strongest harmonic of y from start to end, whose length is one period."""
    grid = start + (end - start) * np.arange(256) / 256
    values = np.interp(grid, t, y)
    size = np.abs(np.fft.rfft(values - values.mean()))[1 : _HARMONICS + 1]
    return int(np.argmax(size)) + 1
