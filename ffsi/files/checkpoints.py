"""The checkpoints of a computation in time (docs/formats.md), and what is taken back to one."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import RawFileError, read_arrays
from ffsi.files.cycles import cycles_until
from ffsi.files.history import lines_of, read_history, rows_until
from ffsi.files.steps import read_saved_steps

logger = logging.getLogger(__name__)

CHECKPOINT_VERSION = 7

# Arrays of the last states, for each set of kept factors and each second difference of earlier states, of the wall
# shear stress, where it is summed, and of the ordinary steps that are kept for the check.
_STATES, _PER_FACTORS, _PER_PAST, _WALL, _KEPT = 4, 3, 2, 4, 5


@dataclass(frozen=True)
class Checkpoint:
    """A complete checkpoint: its file, the number of the last step before it, and the time in s at that step's end."""

    path: Path
    step: int
    time: float


def keep_checkpoint(checkpoint: Checkpoint) -> Path:
    """Give a checkpoint the name that the script does not write to first; return its file."""
    kept = checkpoint.path.with_name(folder.CHECKPOINTS[-1])
    if checkpoint.path != kept:
        checkpoint.path.replace(kept)
    return kept


def cut_back(directory: Path, step: int) -> None:
    """Take everything after a step out of the tables, and states and cycles written after it out of the folder."""
    lines = lines_of(directory / folder.TIME_HISTORY)
    folder.write_text(directory / folder.TIME_HISTORY, "".join(lines[: step + 1]))
    for name in (folder.HISTORY, folder.STEPS):
        head, *rows = lines_of(directory / name) or [""]
        folder.write_text(directory / name, head + "".join(rows_until(rows, step)))
    kept = {name for saved in read_saved_steps(directory) for name in (saved.old, saved.new)}
    kept |= {*cycles_until(directory, float(read_history(directory)["time"].iloc[-1]))}
    for path in (*directory.glob(folder.STATES), *directory.glob(folder.WALL_CYCLES)):
        if path.name not in kept:
            path.unlink()


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
        len(head) > 11
        and int(head[0]) == CHECKPOINT_VERSION
        and len(arrays) - _STATES - _PER_FACTORS * int(head[5]) - _PER_PAST * int(head[11]) - _KEPT in (0, _WALL)
        and mark.tolist() == [int(head[1])]
        and all(len(state) == int(head[2]) and bool(np.isfinite(state).all()) for state in states)
    )
    return Checkpoint(path, int(head[1]), float(times[0])) if whole else None
