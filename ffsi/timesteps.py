"""Files of a computation in time (docs/formats.md): its history, the steps with saved states, its checkpoints."""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ffsi import folder
from ffsi.folder import InputError
from ffsi.rawfiles import RawFileError, read_arrays
from ffsi.reading import LONGEST_TABLE, read_text

logger = logging.getLogger(__name__)

CHECKPOINT_VERSION = 3
_STATES, _PER_FACTORS = 4, 3  # arrays of the last states, and for each set of kept factors
_WALL = 4  # arrays of the wall shear stress, where it is summed
_KEPT = 5  # arrays of the ordinary steps that are kept for the check
_SAME = 1e-9
_WINDKESSEL = ("windkessel_old", "windkessel_new")


@dataclass(frozen=True)
class Checkpoint:
    """A complete checkpoint: its file, the number of the last step before it, and the time in s at that step's end."""

    path: Path
    step: int
    time: float


@dataclass(frozen=True)
class SavedStep:
    """A step whose states were written: one to be drawn, and to be checked.

    Attributes:
        step: its number, from 1.
        time: at its end, s.
        k: its length, s.
        theta: weight of its end, dimensionless.
        old: name of the file with the state at its start.
        new: name of the file with the state at its end.
        quantities: drag and lift at its end, N/m; none without a fluid.
        windkessel: pressure of the outlet's compliance at its start and at its end, Pa; None without a Windkessel.
        tolerance: of an ordinary step, which is only to be checked, `solver.step_tolerance`; 0 where the step was
            solved to round-off.
    """

    step: int
    time: float
    k: float
    theta: float
    old: str
    new: str
    quantities: dict[str, float]
    windkessel: tuple[float, float] | None = None
    tolerance: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of `steps.json`."""
        entry = {key: value for key, value in vars(self).items() if key not in ("windkessel", "tolerance")}
        if self.tolerance != 0.0:
            entry["tolerance"] = self.tolerance
        return entry if self.windkessel is None else entry | dict(zip(_WINDKESSEL, self.windkessel, strict=True))


def read_history(directory: Path) -> pd.DataFrame:
    """Return `history.csv`: one row per step.

    Columns `time`, `step` (the length of the step), both s, `drag`, `lift` (N/m, with a fluid), `tip_ux`, `tip_uy` (m,
    with a solid), `min_jacobian`, `iterations`, `factorized` (both numbers of the step) and `seconds` (since the start
    of the process). A line that was cut off by a kill is left out.

    Raises:
        InputError: the file is missing or damaged.
    """
    return _read_table(directory / folder.TIME_HISTORY)


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


def read_saved_steps(directory: Path) -> list[SavedStep]:
    """Return the steps whose states were written, in time; none if there is no `steps.csv`.

    Raises:
        InputError: the file is damaged.
    """
    path = directory / folder.STEPS
    if not path.is_file():
        return []
    table = _read_table(path)
    found = []
    for row in table.to_dict("records"):
        try:
            forces = {str(name): float(row[name]) for name in ("drag", "lift") if math.isfinite(float(row[name]))}
            state = tuple(float(row[name]) for name in _WINDKESSEL if name in row)
            found.append(
                SavedStep(
                    int(row["step"]), float(row["time"]), float(row["k"]), float(row["theta"]), str(row["old"]),
                    str(row["new"]), forces, state if len(state) == 2 else None,
                    float(row.get("tolerance", 0.0)),
                )
            )  # fmt: skip
        except (KeyError, ValueError) as error:
            raise InputError(f"{path} is damaged: {error}") from error
    # Ordinary steps stand behind the others, and once more after a run that went on.
    steps = sorted({step.step: step for step in found}.values(), key=lambda step: step.step)
    return [step for step in steps if (directory / step.old).is_file() and (directory / step.new).is_file()]


def write_steps_json(directory: Path) -> None:
    """Turn `steps.csv` into `steps.json`, which the checker reads."""
    entries = [step.as_dict() for step in read_saved_steps(directory)]
    folder.write_text(directory / folder.STEPS_JSON, folder.to_json(entries))


def states_until(directory: Path, step: int) -> list[str]:
    """Return the names of the states that `steps.csv` lists up to a step, whether they are there or not."""
    _, *rows = _lines(directory / folder.STEPS) or [""]
    return [name for row in _until(rows, step) for name in row.split(",")[4:6]]


def cycles_until(directory: Path, time: float) -> list[str]:
    """Return the names of the files of cycles that end by a time in s."""
    return sorted(path.name for path in directory.glob(folder.WALL_CYCLES) if _cycle_end(path) <= time * (1 + _SAME))


def keep_checkpoint(checkpoint: Checkpoint) -> Path:
    """Give a checkpoint the name that the script does not write to first; return its file."""
    kept = checkpoint.path.with_name(folder.CHECKPOINTS[-1])
    if checkpoint.path != kept:
        checkpoint.path.replace(kept)
    return kept


def cut_back(directory: Path, step: int) -> None:
    """Take everything after a step out of the tables, and states and cycles written after it out of the folder."""
    lines = _lines(directory / folder.TIME_HISTORY)
    folder.write_text(directory / folder.TIME_HISTORY, "".join(lines[: step + 1]))
    for name in (folder.HISTORY, folder.STEPS):
        head, *rows = _lines(directory / name) or [""]
        folder.write_text(directory / name, head + "".join(_until(rows, step)))
    kept = {name for saved in read_saved_steps(directory) for name in (saved.old, saved.new)}
    for path in directory.glob(folder.STATES):
        if path.name not in kept:
            path.unlink()
    reached = float(read_history(directory)["time"].iloc[-1])
    cycles = cycles_until(directory, reached)
    for path in directory.glob(folder.WALL_CYCLES):
        if path.name not in cycles:
            path.unlink()


def _cycle_end(path: Path) -> float:
    """Return the time (s) at which the cycle of a file ends; infinity if it was cut off by a kill."""
    from ffsi.hemodynamics.indices import read_cycle

    try:
        return read_cycle(path).end
    except InputError as error:
        logger.debug("%s", error)
        return math.inf


def read_checkpoint(path: Path) -> Checkpoint | None:
    """Return a checkpoint; None if it is missing or not complete."""
    if not path.is_file():
        return None
    try:
        head, times, *arrays, mark = read_arrays(path, (int, float), more=int)  # all values have eight bytes
    except (RawFileError, ValueError) as error:  # half written when the run was killed
        logger.debug("%s", error)
        return None
    states = [array.view(np.float64) for array in arrays[:_STATES]]
    whole = (
        len(head) > 5
        and int(head[0]) == CHECKPOINT_VERSION
        and len(arrays) - _STATES - _PER_FACTORS * int(head[5]) - _KEPT in (0, _WALL)
        and mark.tolist() == [int(head[1])]
        and all(len(state) == int(head[2]) and bool(np.isfinite(state).all()) for state in states)
    )
    return Checkpoint(path, int(head[1]), float(times[0])) if whole else None


def _read_table(path: Path) -> pd.DataFrame:
    lines = _lines(path)
    if not lines:
        raise InputError(f"{path} is missing or empty")
    try:
        return pd.read_csv(io.StringIO("".join(lines)), skipinitialspace=True)
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}") from error


def _lines(path: Path) -> list[str]:
    """Return the complete lines of a file, none if it is not there."""
    if not path.is_file():
        return []
    lines = read_text(path, LONGEST_TABLE).splitlines(keepends=True)
    return lines if not lines or lines[-1].endswith("\n") else lines[:-1]


def _until(rows: Sequence[str], step: int) -> Iterator[str]:
    """Yield the rows up to a step; ordinary steps, which a run writes at its end, stand behind later ones."""
    last = 0.0
    for row in rows:
        number = _number(row)
        if not last <= number <= step:
            return
        last = number
        yield row


def _number(row: str) -> float:
    """Return the number of the step at the start of a row; infinity if there is none."""
    try:
        return int(row.partition(",")[0])
    except ValueError:
        return math.inf
