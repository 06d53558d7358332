"""Tables of text for a terminal and for Markdown, and how numbers stand in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

NOTHING = "–"


@dataclass
class TextTable:
    """A table of text for a terminal or Markdown; the first `left` columns are aligned to the left."""

    head: Sequence[str]
    left: int = 1
    title: str = ""
    body: list[list[str]] = field(default_factory=list)

    def add(self, *cells: str) -> None:
        """Append a row.

        Raises:
            ValueError: another number of cells than columns.
        """
        if len(cells) != len(self.head):
            raise ValueError(f"{len(cells)} cells for {len(self.head)} columns")
        self.body.append(list(cells))

    def markdown(self) -> str:
        """Return the table in Markdown."""
        marks = ["---" if i < self.left else "---:" for i in range(len(self.head))]
        return "\n".join(f"| {' | '.join(row)} |" for row in [list(self.head), marks, *self.body])

    def print(self) -> None:
        """Print the table on stdout."""
        table = Table(box=None, pad_edge=False, header_style="bold", title=self.title or None, title_justify="left")
        for i, name in enumerate(self.head):
            table.add_column(Text(name), justify="left" if i < self.left else "right", no_wrap=True)
        for row in self.body:
            table.add_row(*(Text(cell) for cell in row))
        console = Console(highlight=False)
        (console if console.is_terminal else Console(highlight=False, width=200)).print(table)


def percent(error: float) -> str:
    """Return a relative error in percent: three decimals, more where two digits need them."""
    if math.isnan(error):
        return NOTHING
    decimals = 3 if abs(error) < 1e-10 else min(max(3, 1 - math.floor(math.log10(100 * abs(error)))), 8)
    return f"{100 * error:+.{decimals}f} %"


def size(difference: float) -> str:
    """Return the size of a relative difference in percent, without its sign."""
    return percent(abs(difference)).removeprefix("+")


def number(value: Any, form: str = "{:.1f}") -> str:
    """Return a formatted number, or a dash if there is none."""
    return NOTHING if value is None or pd.isna(value) else form.format(value)
