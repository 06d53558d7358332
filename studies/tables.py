"""Tables of text for a terminal and for Markdown, their columns as data; how numbers stand in them; curves."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter
from rich.console import Console
from rich.table import Table
from rich.text import Text

NOTHING = "–"


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    head: str  # its heading
    # Key of a row, or a function of the row; text stays as it is, what is missing is a dash.
    of: str | Callable[[Any], Any]
    form: str = "{}"  # of a number, as of `str.format`; `%`: in percent
    bound: float = math.inf  # largest accepted size; `!` marks a number that misses it, or is NaN
    least: float = -math.inf  # smallest accepted value

    def cell(self, row: Any) -> str:
        """Return what stands in a row's cell."""
        value = self.of(row) if callable(self.of) else row.get(self.of)
        if value is None or isinstance(value, str):
            return NOTHING if value is None else value
        text = percent(value) if self.form == "%" else number(value, self.form)
        free = math.isinf(self.bound) and math.isinf(self.least)
        return text if free or (abs(value) <= self.bound and value >= self.least) else f"{text} !"


def columns(text: str) -> list[Column]:
    """Return columns from a text such as `level | u_x in m = tip_ux :.5g | error :% < 0.01`: head, key, form, bound."""
    found = []
    for item in text.split("|"):
        name, _, form = item.partition(" :")
        form, _, bound = form.strip().partition(" < ")
        head, _, key = name.strip().partition(" = ")
        form = form if form == "%" else f"{{:{form}}}"
        found.append(bounded(head, key or head, float(bound), form) if bound else Column(head, key or head, form))
    return found


def bounded(head: str, of: str | Callable[[Any], Any], bound: float, form: str = "%") -> Column:
    """Return a column whose heading tells its bound."""
    return Column(f"{head} (< {f'{100 * bound:g} %' if form == '%' else f'{bound:g}'})", of, form, bound)


@dataclass(frozen=True)
class TextTable:
    """A table of text; the first `left` columns are aligned to the left."""

    head: Sequence[str]
    body: Sequence[Sequence[str]]
    left: int = 1
    title: str = ""

    def markdown(self) -> str:
        """Return the table in Markdown."""
        marks = ["---" if i < self.left else "---:" for i in range(len(self.head))]
        return "\n".join(f"| {' | '.join(row)} |" for row in [self.head, marks, *self.body])

    def print(self) -> None:
        """Print the table on stdout."""
        table = Table(box=None, pad_edge=False, header_style="bold", title=self.title or None, title_justify="left")
        for i, name in enumerate(self.head):
            table.add_column(Text(name), justify="left" if i < self.left else "right", no_wrap=True)
        for row in self.body:
            table.add_row(*map(Text, row))
        console = Console(highlight=False)
        (console if console.is_terminal else Console(highlight=False, width=200)).print(table)


def table(rows: Iterable[Any], columns: Sequence[Column], left: int = 1, title: str = "") -> TextTable:
    """Return the table that columns make of rows."""
    body = [[column.cell(row) for column in columns] for row in rows]
    return TextTable([column.head for column in columns], body, left, title)


def number(value: Any, form: str = "{:.1f}") -> str:
    """Return a formatted number, or a dash if there is none."""
    return NOTHING if value is None or pd.isna(value) else form.format(value)


def markdown(parts: Iterable[str | TextTable]) -> str:
    """Return texts and tables in Markdown."""
    return "\n\n".join(part if isinstance(part, str) else part.markdown() for part in parts)


_DOCUMENTS = Environment(
    loader=FileSystemLoader(Path(__file__).with_name("documents")), undefined=StrictUndefined, trim_blocks=True,
    lstrip_blocks=True, finalize=lambda value: value.markdown() if isinstance(value, TextTable) else value,
)  # fmt: skip
_DOCUMENTS.filters |= {"paragraphs": markdown, "number": number}


def document(name: str, **values: Any) -> str:
    """Return the Markdown that the template `documents/NAME.md.j2` makes of values, tables and numbers among them."""
    text = _DOCUMENTS.get_template(f"{name}.md.j2").render(values)
    return re.sub(r"\n{3,}", "\n\n", text).strip()


def percent(error: float) -> str:
    """Return a relative error in percent: three decimals, more where two digits need them."""
    if math.isnan(error):
        return NOTHING
    decimals = 3 if abs(error) < 1e-10 else min(max(3, 1 - math.floor(math.log10(100 * abs(error)))), 8)
    return f"{100 * error:+.{decimals}f} %"


def unsigned(difference: float) -> str:
    """Return the size of a relative difference in percent, without its sign."""
    return percent(abs(difference)).removeprefix("+")


def logarithmic(axes: Axes) -> None:
    """Where there are curves, make both axes logarithmic."""
    if axes.lines:
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
