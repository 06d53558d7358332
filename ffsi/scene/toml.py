"""From TOML text to tables and values."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from ffsi.scene.errors import Problem, SceneError
from ffsi.text import cut

MAX_KEYS, MAX_DEPTH = 5000, 20
_PLACE = re.compile(r"(.*) \(at (line \d+, column \d+|end of document)\)", re.DOTALL)


def parse_toml(text: str, source: str = "TOML") -> dict[str, Any]:
    """Return the tables of a TOML text.

    Args:
        text: the text.
        source: what the error calls it, such as the file's name.

    Raises:
        SceneError: the text is no TOML; the message has line and column.
    """
    try:
        table = tomllib.loads(text)
        reason = _excess(table)
    except tomllib.TOMLDecodeError as error:
        found = _PLACE.fullmatch(str(error))
        reason, place = found.groups() if found else (str(error), "end of document")
        if place == "end of document":
            place = f"line {text.count(chr(10)) + 1}, the end"
        raise SceneError([Problem(source, f"not valid TOML at {place}: {cut(reason, 300)}")]) from None
    except (ValueError, RecursionError):
        reason = "a number has too many digits, or the nesting is too deep"
    if reason:
        raise SceneError([Problem(source, f"not accepted: {reason}")])
    return table


def parse_value(text: str) -> Any:
    """Return the value that a TOML text stands for, such as ``3``, ``"text"`` or ``{x = 1}``.

    Raises:
        ValueError: the text is no single TOML value, or one that no scene has.
    """
    try:
        table = tomllib.loads(f"value = {text}")
    except RecursionError:
        raise ValueError("the nesting is too deep") from None
    if set(table) != {"value"}:
        raise ValueError("more than one value")
    if reason := _excess(table):
        raise ValueError(reason)
    return table["value"]


def _excess(table: Mapping[str, Any]) -> str | None:
    """Return what is too much in tables and lists: what handles them later goes through them again and again."""
    level: list[Any] = [table]
    for _ in range(MAX_DEPTH):
        inner = [list(item.values()) if isinstance(item, dict) else item for item in level]
        if sum(len(values) for item, values in zip(level, inner, strict=True) if isinstance(item, dict)) > MAX_KEYS:
            return f"more than {MAX_KEYS} keys"
        level = [value for values in inner for value in values if isinstance(value, dict | list)]
        if not level:
            return None
    return f"more than {MAX_DEPTH} tables or lists within each other"
