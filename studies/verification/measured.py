"""Numbers beside what they should be, and the rows, columns and tables in which they stand."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

from ffsi.files.arrays import Floats
from studies.tables import NOTHING, TextTable, percent

SECONDS = "seconds"
_Part = Literal["value", "reference", "error"]


@dataclass(frozen=True)
class Measured:
    """A number that was found, and its exact value or the one that it is compared with; both in one unit."""

    value: float
    reference: float = math.nan

    @property
    def error(self) -> float:
        """(value - reference) / |reference|; NaN without a reference."""
        return (self.value - self.reference) / abs(self.reference) if self.reference else math.nan


def worst(values: Floats, exact: float | Floats) -> Measured:
    """Return the value that is farthest from what it should be, relative to that; NaN without values."""
    if not len(values):
        return Measured(np.nan, np.nan)
    exact = np.broadcast_to(exact, values.shape)
    at = int(np.abs(values / exact - 1).argmax())
    return Measured(float(values[at]), float(exact[at]))


@dataclass(frozen=True)
class Row:
    """What one run, or several, come to.

    Attributes:
        group: the group of rows that it belongs to.
        case: name of the run.
        labels: what its first cells say.
        level: mesh level.
        numbers: by quantity.
        failure: empty, or why there are hardly any numbers, as `Result.failure`.
    """

    group: str
    case: str
    labels: tuple[str, ...]
    level: int
    numbers: Mapping[str, Measured] = field(default_factory=dict)
    failure: str = ""


@dataclass(frozen=True)
class Column:
    """A quantity in a table.

    Attributes:
        quantity: its name.
        title: the heading; the bound is added.
        part: what of the quantity is shown, and bounded.
        form: of the text, as of `str.format`; empty: percent.
        bound: largest accepted size, if any.
        least: smallest accepted value, if any.
    """

    quantity: str
    title: str
    part: _Part = "value"
    form: str = ""
    bound: float = math.inf
    least: float = -math.inf

    @property
    def head(self) -> str:
        """Title with its bound."""
        if math.isinf(self.bound):
            return self.title if math.isinf(self.least) else f"{self.title} (≥ {self.least:g})"
        return f"{self.title} (< {f'{self.bound:g}' if self.form else f'{100 * self.bound:g} %'})"

    def cell(self, row: Row) -> str:
        """Return the number as text, with `!` if it misses the bound; a dash if there is none."""
        if self.quantity == SECONDS and row.failure:
            return f"failed ({row.failure})"
        number = row.numbers.get(self.quantity)
        if number is None:
            return NOTHING
        shown = getattr(number, self.part)
        text = self.form.format(shown) if self.form else percent(shown)
        return text if self.keeps(number) else f"{text} !"

    def keeps(self, number: Measured) -> bool:
        """Whether a number keeps the bound; NaN keeps none."""
        shown = getattr(number, self.part)
        free = math.isinf(self.bound) and math.isinf(self.least)
        return free or (abs(shown) <= self.bound and shown >= self.least)


@dataclass(frozen=True)
class MeasuredTable:
    """A table of one group of rows.

    Attributes:
        group: its rows.
        text: what stands above it, in Markdown.
        labels: headings of the first cells.
        columns: the others.
        finest: whether a short version has the rows of the finest mesh only.
    """

    group: str
    text: str
    labels: tuple[str, ...]
    columns: Sequence[Column]
    finest: bool = False

    def of(self, rows: Iterable[Row], *, short: bool = False) -> TextTable:
        """Return the table of those rows of its group that failed or have one of its quantities."""
        own = [row for row in rows if row.group == self.group]
        own = [row for row in own if row.failure or any(item.quantity in row.numbers for item in self.columns)]
        if short and self.finest:
            own = [row for row in own if row.level == max(row.level for row in own)]
        head = [*self.labels, *(column.head for column in self.columns)]
        table = TextTable(head, title=self.text)
        for row in own:
            table.add(*row.labels, *(column.cell(row) for column in self.columns))
        return table


def to_frame(rows: Iterable[Row], tables: Iterable[MeasuredTable]) -> pd.DataFrame:
    """Return one line per row and quantity; a row without numbers has one line.

    Columns: `group`, `case`, `level`, `failure`, `quantity`, `value`, `reference`, `error`, and `bound`, the largest
    accepted size of the error or, without a reference, of the value; NaN where there is none.
    """
    bounds = {
        (table.group, column.quantity): column.bound
        for table in tables
        for column in table.columns
        if math.isfinite(column.bound)
    }
    lines = []
    for row in rows:
        common = {"group": row.group, "case": row.case, "level": row.level, "failure": row.failure}
        lines += [
            {
                **common, "quantity": name, "value": number.value, "reference": number.reference,
                "error": number.error, "bound": bounds.get((row.group, name), math.nan),
            }
            for name, number in row.numbers.items()
        ] or [common]  # fmt: skip
    return pd.DataFrame(lines)
