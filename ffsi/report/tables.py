"""Tables of text for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from ffsi.result.quantities import unit


@dataclass
class Rows:
    """A table of text; `numeric` says which columns are aligned to the right."""

    head: Sequence[str]
    body: list[list[str]]
    numeric: Sequence[bool]


def with_unit(text: str, quantity: str) -> str:
    """Return a heading with the unit of a quantity behind it, unless that is 1."""
    named = unit(quantity)
    return f"{text} ({named})" if named != "1" else text


def cell(value: Any, form: str) -> str:
    """Return a number in a format, another value as it is, nothing for what is missing."""
    if value is None or (isinstance(value, float) and pd.isna(value)):
        return ""
    return format(value, form) if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)
