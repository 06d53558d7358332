"""The history of a run in time: one row of numbers for every step, complete and in order; and what follows from it."""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ffsi.files.reading import LONGEST_TABLE, read_text
from ffsi.reference.conditions import Outlet
from ffsi.reference.step import Step

# A time is the sum of the steps before it: its rounding, and this part of the step, may be missing.
_SAME = 1e-9
_EPSILON = 2.0**-52
# Columns that nobody recomputes, with the reason.
UNCHECKED = {
    "iterations": "says how the step was solved",
    "factorized": "says how the step was solved",
    "seconds": "says how the step was solved",
    "work": "a sum over all steps, whose terms belong to the energy balance of the script and to no result",
}


@dataclass(frozen=True)
class History:
    """What a run says of every step, by column; row n, from 1, is step n."""

    path: Path
    columns: dict[str, list[float]]

    @classmethod
    def read(cls, path: Path) -> "History":
        """Read ``history.csv``.

        Raises ``ValueError`` with the number of the row where one is missing, twice there or out of order, or a cell is
        no finite number; and ``OSError`` if there is no such file.
        """
        text = read_text(path, LONGEST_TABLE)
        try:
            head, *rows = csv.reader(io.StringIO(text, newline=""))
        except (csv.Error, ValueError) as error:
            raise ValueError(f"{path}: no table ({error})") from error
        names = [name.strip() for name in head]
        if missing := {"time", "step"} - set(names):
            raise ValueError(f"{path}: no column {', '.join(sorted(missing))}")
        if len(set(names)) < len(names):
            raise ValueError(f"{path}: a column is there twice")
        numbers = [_numbers(path, number, names, row) for number, row in enumerate(rows, start=1)]
        found = cls(path, {name: [row[i] for row in numbers] for i, name in enumerate(names)})
        found._refuse_gaps()
        return found

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.columns["time"])

    def row(self, number: int) -> dict[str, float]:
        """Return the numbers of a step, from 1, by column. Raises ``ValueError`` if there is no such step."""
        if not 0 < number <= len(self):
            raise ValueError(f"{self.path}: no step {number}, the last is {len(self)}")
        return {name: column[number - 1] for name, column in self.columns.items()}

    def quantities(self, number: int) -> dict[str, float]:
        """Return what a step, from 1, reports of its end. Raises ``ValueError`` if there is no such step."""
        return {name: value for name, value in self.row(number).items() if name not in {"time", "step", *UNCHECKED}}

    def before(self, number: int) -> dict[str, float]:
        """Return the row before a step, zeros before the first one."""
        return self.row(number - 1) if number > 1 else dict.fromkeys(self.columns, 0.0)

    def refuse_other(self, number: int, step: Step) -> None:
        """Raise ``ValueError`` if a step is not the one of its row."""
        row = self.row(number)
        if abs(row["step"] - step.k) > _SAME * step.k or not self._same_time(row["time"], step.time, step.k):
            raise ValueError(
                f"{self.path}: row {number} is a step of {row['step']!r} s that ends at {row['time']!r} s; "
                f"the one that was checked has {step.k!r} s and ends at {step.time!r} s"
            )

    def _refuse_gaps(self) -> None:
        before = 0.0
        for number, (time, step) in enumerate(zip(self.columns["time"], self.columns["step"], strict=True), start=1):
            if not step > 0.0:
                raise ValueError(f"{self.path}: row {number}: a step of {step!r} s")
            if not self._same_time(time, before + step, step):
                raise ValueError(
                    f"{self.path}: row {number}: a step of {step!r} s from {before!r} s does not end at {time!r} s; "
                    "a row is missing, changed or there twice"
                )
            before = time

    @staticmethod
    def _same_time(one: float, other: float, step: float) -> bool:
        return abs(one - other) <= _SAME * step + 4.0 * _EPSILON * abs(other)


def _numbers(path: Path, number: int, names: Sequence[str], row: Sequence[str]) -> list[float]:
    if len(row) != len(names):
        raise ValueError(f"{path}: row {number} has {len(row)} cells, the head {len(names)}")
    found = []
    for name, cell in zip(names, row, strict=True):
        try:
            found.append(float(cell))
        except ValueError:
            found.append(math.nan)
        if not math.isfinite(found[-1]):
            raise ValueError(f"{path}: row {number}: {name} = {cell!r} is no finite number")
    return found


def reservoirs(outlets: Sequence[Outlet], history: History, thetas: Sequence[float]) -> list[float]:
    """Pressure of the reservoir before the first step, which starts from rest, and after each, (steps + 1,) Pa.

    It follows from the flow rates in the history; ``outlets`` and ``thetas`` are outlet and weight in each step. Raises
    ``ValueError`` if the history has no flow rates.
    """
    outlet = outlets[0]
    flow_rate = f"flow_through_{outlet.name}" if outlet.name else "flow_rate_out"
    if missing := {flow_rate, *({"outlet_pressure"} if not outlet.name else ())} - history.columns.keys():
        raise ValueError(f"{history.path}: no column {', '.join(sorted(missing))}")
    flow, times = history.columns[flow_rate], zip(history.columns["step"], history.columns["time"], strict=True)
    found, old = [outlet.pressure_at(0.0)], 0.0
    if not outlet.stores:
        return found * (len(flow) + 1)
    for number, ((k, time), new) in enumerate(zip(times, flow, strict=True)):
        step = Step(k, thetas[number], time)
        found.append(float(outlets[number].reservoir_after(step, new, old, found[-1])))
        old = new
    return found
