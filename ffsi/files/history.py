"""Files of a computation in time (docs/formats.md): its history, the steps with saved states, its checkpoints."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.reading import LONGEST_TABLE, frame_of, read_text

if TYPE_CHECKING:
    import pandas as pd

logger = logging.getLogger(__name__)

_SAME = 1e-9


def read_history(directory: Path) -> pd.DataFrame:
    """Return `history.csv`: one row per step.

    Columns `time`, `step` (the length of the step), both s, `drag`, `lift` (N/m, with a fluid), `tip_ux`, `tip_uy` (m,
    with a solid), `min_jacobian`, `iterations`, `factorized` (both numbers of the step) and `seconds` (since the start
    of the process). A line that was cut off by a kill is left out. Raises InputError as `read_rows`.
    """
    return read_rows(directory / folder.TIME_HISTORY)


def flaw(history: pd.DataFrame) -> str:
    """Return why a history is no sequence of steps, each from where the one before ended; empty if it is one."""
    try:
        numbers = history.to_numpy(dtype=np.float64)
        times, steps = history["time"].to_numpy(dtype=np.float64), history["step"].to_numpy(dtype=np.float64)
    except (KeyError, ValueError) as error:
        return f"a value is no number ({error})"
    if not len(times):
        return "no step"
    if not np.isfinite(numbers).all():
        return f"step {1 + int(np.argwhere(~np.isfinite(numbers))[0][0])} has a value that is not finite"
    gaps = np.abs(np.diff(times, prepend=0.0) - steps) > _SAME * times[-1]
    if gaps.any() or not (steps > 0).all():
        wrong = int(np.flatnonzero(gaps | ~(steps > 0))[0])
        return f"step {1 + wrong} does not begin where the one before ends"
    return ""


def seconds_of_steps(history: pd.DataFrame) -> pd.Series[float]:
    """Return the seconds that each step took, of the process that made it.

    The first step of every process is left out: its seconds contain the mesh and the operators.
    """
    seconds = history["seconds"].astype(float).diff()
    return seconds[seconds >= 0.0]


def seconds_of_run(history: pd.DataFrame) -> float:
    """Return the seconds of all the processes that made a history, one after the other; 0 without steps."""
    seconds = history["seconds"].astype(float)
    return float(seconds[~(seconds.shift(-1) >= seconds)].sum())


def read_rows(path: Path) -> pd.DataFrame:
    """Return the complete rows of a table; raises InputError if the file is missing, empty or damaged."""
    lines = lines_of(path)
    if not lines:
        raise InputError(f"{path} is missing or empty")
    try:
        return frame_of("".join(lines))
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}") from error


def lines_of(path: Path) -> list[str]:
    """Return the complete lines of a file, none if it is not there."""
    if not path.is_file():
        return []
    lines = read_text(path, LONGEST_TABLE).splitlines(keepends=True)
    return lines if not lines or lines[-1].endswith("\n") else lines[:-1]


def rows_until(rows: Sequence[str], step: int) -> Iterator[str]:
    """Yield the rows up to a step; ordinary steps, which a run writes at its end, stand behind later ones."""
    last = 0
    for row in rows:
        try:
            number = int(row.partition(",")[0])
        except ValueError:
            return
        if not last <= number <= step:
            return
        last = number
        yield row
