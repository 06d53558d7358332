"""Words and tables for standard output: on a terminal as rich draws them, else as they are, without loading rich."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # takes longer to load than a small scene's check
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text


class Words(str):
    """Words without markup, in a style of rich's."""

    def __new__(cls, words: str, style: str = "", **options: Any) -> Words:
        """Take the words, a style, and what else `rich.text.Text` accepts."""
        made = super().__new__(cls, words)
        made.style, made.options = style, options
        return made

    style: str
    options: dict[str, Any]

    def __rich__(self) -> Text:
        """Return what a terminal shows."""
        from rich.text import Text

        return Text(str(self), style=self.style, **self.options)


class Table:
    """A table without lines: columns with headings, cells of one line each."""

    def __init__(self) -> None:
        """Begin without columns."""
        self.columns: list[tuple[str, bool, bool]] = []
        self.rows: list[Sequence[str]] = []

    def add_column(self, heading: str, *, right: bool = False, no_wrap: bool = False) -> None:
        """Add a column, to the `right` or to the left; `no_wrap`: a narrow terminal does not break its cells."""
        self.columns.append((heading, right, no_wrap))

    def add_row(self, *cells: str) -> None:
        """Add a row; cells that are missing stay empty."""
        self.rows.append([*cells, *[""] * (len(self.columns) - len(cells))])

    def __str__(self) -> str:
        """Return the lines, however wide."""
        lines = [[heading for heading, *_ in self.columns], *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        sides = [str.rjust if right else str.ljust for _, right, _ in self.columns]
        return "\n".join(
            "  ".join(side(cell, width) for side, cell, width in zip(sides, line, widths, strict=True)).rstrip()
            for line in lines
        )

    def __rich__(self) -> RichTable:
        """Return what a terminal shows."""
        table = new_rich_table()
        for heading, right, no_wrap in self.columns:
            table.add_column(Words(heading), justify="right" if right else "left", no_wrap=no_wrap)
        for row in self.rows:
            table.add_row(*row)
        return table


def new_rich_table(**options: Any) -> RichTable:
    """Return a table of rich's without lines, for cells that are long texts."""
    from rich.table import Table

    return Table(**{"box": None, "pad_edge": False, "header_style": "bold", **options})


class _File:
    """Standard output that is no terminal."""

    def print(self, *parts: Any, **options: Any) -> None:
        """Print words and tables in one line, with blanks between; what is rich's own as rich does, 160 wide."""
        if all(isinstance(part, (str, Table)) for part in parts):
            sys.stdout.write(" ".join(map(str, parts)) + "\n")
        else:
            from rich.console import Console

            Console(highlight=False, width=160).print(*parts, **options)


def stdout() -> Console | _File:
    """Return where results are printed."""
    if not (sys.stdout.isatty() or os.environ.get("FORCE_COLOR") or os.environ.get("TTY_COMPATIBLE") == "1"):
        return _File()
    from rich.console import Console

    return Console(highlight=False)
