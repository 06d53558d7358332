"""Waveforms of the inflow that are Fourier series: the named ones, and those of a table of samples."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ffsi.files.reading import MEGABYTE, frame_of, read_text
from ffsi.text import listed

COLUMNS = ["t", "value"]
FEWEST_ROWS = 4
_SAMPLES = 8192


@dataclass(frozen=True)
class Fourier:
    """A periodic waveform: sum over k = 0 .. n of cosine[k] cos(k w t) + sine[k] sin(k w t), w = 2 pi / period.

    Args:
        period: s.
        cosine: a_0 (the mean) to a_n.
        sine: b_0 to b_n; b_0 has no meaning and is 0.
    """

    period: float
    cosine: tuple[float, ...]
    sine: tuple[float, ...]

    def __call__(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return the values at the times t (s)."""
        angle = np.multiply.outer(np.asarray(t, dtype=np.float64) * (2 * np.pi / self.period), range(len(self.cosine)))
        return np.asarray(np.cos(angle) @ np.array(self.cosine) + np.sin(angle) @ np.array(self.sine))


@cache
def named_waveforms() -> dict[str, Fourier]:
    """Return the waveforms of ffsi/data/waveforms.toml by name, each divided by its mean."""
    text = files("ffsi").joinpath("data/waveforms.toml").read_text(encoding="utf-8")
    found = {}
    for name, table in tomllib.loads(text).items():
        mean = table["cosine"][0]
        cosine, sine = (tuple(value / mean for value in table[key]) for key in ("cosine", "sine"))
        found[name] = Fourier(table["period"], cosine, sine)
    return found


def read_waveform(path: Path, harmonics: int, period: float | None = None) -> Fourier:
    """Return the Fourier series of the samples in a CSV file with the columns t (s) and value.

    The waveform is the polygon through the samples, which cover one period. Without a period the last row is its end
    and repeats the first value; with one, the polygon closes where the first value comes again.

    Args:
        path: the file.
        harmonics: number of terms after the mean.
        period: s.

    Raises:
        ValueError: in words: the file cannot be read, or its samples are no period of a waveform.
    """
    times, values = read_samples(path)
    length = times[-1] - times[0]
    if period is None:
        if abs(values[-1] - values[0]) > 0.01 * np.ptp(values):
            text = f"the last value {values[-1]:g} does not repeat the first one {values[0]:g}"
            raise ValueError(f"{text}; needed, unless inflow.period says how long a period is")
        period = float(length)
    elif length > period * (1 + 1e-9):
        raise ValueError(f"the times cover {length:g} s, more than inflow.period = {period:g} s")
    at = np.arange(_SAMPLES) * (period / _SAMPLES)
    inside = (times - times[0]) < period * (1 - 1e-9)
    polygon = np.interp(at, times[inside], values[inside], period=period)
    terms = np.fft.rfft(polygon)[: harmonics + 1] / _SAMPLES
    terms[1:] *= 2
    return Fourier(period, tuple(terms.real.tolist()), tuple((-terms.imag).tolist()))


def read_samples(
    path: Path, columns: Sequence[str] = COLUMNS, fewest: int = FEWEST_ROWS, more: str = ""
) -> tuple[NDArray[np.float64], ...]:
    """Return the columns of a CSV file, of which the first increases; behind them it can have one ``more``.

    Raises:
        ValueError: in words: the file cannot be read, or is no such table.
    """
    import pandas as pd

    try:
        text = read_text(path, MEGABYTE)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from None
    try:
        table = frame_of(text, comment="#")
    except ValueError as error:
        raise ValueError(f"no table: {str(error).splitlines()[0]}") from None
    table.columns = table.columns.str.strip()
    if list(table.columns) not in ([*columns], [*columns, more]):
        others = f", with or without {more}" if more else ""
        raise ValueError(f"the columns are {listed(table.columns)}; accepted: {', '.join(columns)}{others}")
    if len(table) < fewest:
        raise ValueError(f"{len(table)} rows; at least {fewest} are needed")
    numbers = table.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
    if bad.size:
        raise ValueError(f"row {bad[0] + 1} holds no two finite numbers")
    late = np.flatnonzero(np.diff(numbers[:, 0]) <= 0)
    if late.size:
        what = "times" if columns[0] == "t" else f"values of {columns[0]}"
        raise ValueError(f"the {what} must increase; that of row {late[0] + 2} does not")
    return tuple(numbers.T)
