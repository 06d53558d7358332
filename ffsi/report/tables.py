"""Tables of text for the report, and names of their columns as people read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import pandas as pd

from ffsi.result.quantities import unit
from ffsi.scene.keys import scene_keys
from ffsi.script.quantities import QUANTITIES
from ffsi.text import cut

LABELS = {
    "inflow.mean_velocity": "mean inflow velocity",
    "fluid.viscosity": "dynamic viscosity",
    "fluid.density": "fluid density",
}
_ENDINGS = {"mean": "mean", "amplitude": "amplitude", "frequency": "frequency", "last": "last", "min": "smallest",
            "max": "largest"}  # fmt: skip


@dataclass
class Rows:
    """A table of text.

    Attributes:
        head: names of the columns.
        body: the cells.
        numeric: which columns are aligned to the right.
        title: heading.
        note: text below it.
        file: name and text of the file that it was made of, to be saved from the report; empty without.
        folded: whether a reader opens it first.
    """

    kind: ClassVar[str] = "rows"
    head: Sequence[str]
    body: list[list[str]]
    numeric: Sequence[bool]
    title: str = ""
    note: str = ""
    file: tuple[str, str] = ("", "")
    folded: bool = False


def with_unit(text: str, quantity: str) -> str:
    """Return a heading with the unit of a quantity behind it, unless that is 1."""
    named = unit(quantity)
    return f"{text} ({named})" if named != "1" else text


def cell(value: Any, form: str) -> str:
    """Return a number in a format, another value as it is, nothing for what is missing."""
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return ""
    return format(value, form) if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)


@cache
def about_key(key: str) -> tuple[str, str]:
    """Return the SI unit of a scene's dotted key, empty without one, and its meaning."""
    found = scene_keys(key)
    return next((item.unit for item in found if item.unit not in ("", "1")), ""), found[0].meaning if found else ""


def words(column: str) -> str:
    """Return what people call a column of a sweep's table: a scene's dotted key, or a quantity."""
    if "." in column or column in LABELS:
        return LABELS.get(column, column.removeprefix("solid.").replace(".", " ").replace("_", " "))
    stem, _, ending = column.rpartition("_")
    if stem and ending in _ENDINGS:
        return f"{words(stem)}, {_ENDINGS[ending]}"
    found = next((item for item in QUANTITIES if item.name == column), None)
    if found is None or not found.plot or found.plot.lower() == found.words:
        return column.replace("_", " ")
    return f"{found.plot[0].lower()}{found.plot[1:]} {found.words}".replace("det F all", "det F")


def label(column: str, units: Mapping[str, str] | None = None) -> str:
    """Return the same with the unit in brackets, unless that is 1; units of columns that are not given are known."""
    known = (units or {}).get(column) or (about_key(column)[0] if "." in column else unit(column))
    return words(column) if known in ("", "1") else f"{words(column)} ({known})"


def in_words(text: str) -> str:
    """Return a symbol with an index as a formula."""
    return f"${text}$" if "_" in text else text


def value_text(value: Any) -> str:
    """Return a varied value as a legend or a heading shows it: a number, a text, a truth value, or that it is unset."""
    if value is None or value is pd.NA or (isinstance(value, float) and pd.isna(value)):
        return "unset"
    if isinstance(value, bool) or type(value).__name__ == "bool_":
        return str(bool(value)).lower()
    return (
        f"{value:g}"
        if hasattr(value, "__float__") and not isinstance(value, str)
        else cut(value, 60).replace("$", r"\$")
    )
