"""TOML text to tables and back."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

import tomli_w

from ffsi.scene.errors import Problem, SceneError

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
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = _PLACE.fullmatch(str(error))
        reason, place = found.groups() if found else (str(error), "end of document")
        if place == "end of document":
            place = f"line {text.count(chr(10)) + 1}, the end"
        printable = "".join(character if character.isprintable() else "?" for character in reason)
        raise SceneError([Problem(source, f"not valid TOML at {place}: {printable}")]) from None
    except (ValueError, RecursionError):
        reason = "not accepted: a number has too many digits, or the nesting is too deep"
        raise SceneError([Problem(source, reason)]) from None


def write_toml(table: Mapping[str, Any]) -> str:
    """Return the tables as TOML text."""
    return tomli_w.dumps(table)
