"""The steps of a computation in time whose states were saved (`steps.csv`, docs/formats.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.history import lines_of, read_rows, rows_until

WINDKESSEL = ("windkessel_old", "windkessel_new")


@dataclass(frozen=True)
class SavedStep:
    """A step, number ``step`` from 1, whose states were written: one to be drawn, and to be checked.

    It ends at ``time`` s, is ``k`` s long, and ``theta`` is the weight of its end; ``old`` and ``new`` are the names of
    the files with the states at its start and end. ``quantities``: drag and lift at its end, N/m; none without a fluid.
    ``windkessel``: pressure of the outlet's compliance at both, Pa; None without a Windkessel. ``tolerance`` of an
    ordinary step, which is only to be checked: at most `solver.step_tolerance`; 0 where it was solved to round-off.
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


def read_steps(directory: Path) -> list[SavedStep]:
    """Return the steps that `steps.csv` lists, in time; raises InputError if it is missing or damaged."""
    path = directory / folder.STEPS
    found = {}
    for row in read_rows(path).to_dict("records"):
        try:
            forces = {str(name): float(row[name]) for name in ("drag", "lift") if math.isfinite(float(row[name]))}
            state = tuple(float(row[name]) for name in WINDKESSEL if name in row)
            step = SavedStep(
                int(row["step"]), float(row["time"]), float(row["k"]), float(row["theta"]), str(row["old"]),
                str(row["new"]), forces, state if len(state) == 2 else None,
                float(row.get("tolerance", 0.0)),
            )  # fmt: skip
        except (KeyError, ValueError) as error:
            raise InputError(f"{path} is damaged: {error}") from error
        found[step.step] = step  # once more after a run that went on
    return sorted(found.values(), key=lambda step: step.step)  # ordinary steps stand behind the others


def read_saved_steps(directory: Path) -> list[SavedStep]:
    """Return the steps that `steps.csv` lists and whose states are there, in time; none if there is no such file."""
    steps = read_steps(directory) if (directory / folder.STEPS).is_file() else []
    return [step for step in steps if (directory / step.old).is_file() and (directory / step.new).is_file()]


def states_until(directory: Path, step: int) -> list[str]:
    """Return the names of the states that `steps.csv` lists up to a step, whether they are there or not."""
    _, *rows = lines_of(directory / folder.STEPS) or [""]
    return [name for row in rows_until(rows, step) for name in row.split(",")[4:6]]
