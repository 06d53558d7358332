"""The shapes of the JSON files in a run folder (docs/formats.md): what reads them must not trip over a wrong type."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ffsi.files.errors import InputError
from ffsi.files.reading import read_json
from ffsi.text import cut

_TEXTS = ("case", "status", "reason", "failure", "old", "new")
_WHOLE = ("point", "step", "steps", "triangles", "unknowns")
_REAL = ("level", "time", "k", "theta", "reached", "end", "seconds")
_FLAT = ("newton", "timings", "check", "energy", "last", "smallest", "largest", "windkessel")  # names and numbers
_TABLES = (*_FLAT, "varied", "quantities", "parameters", "freefem", "regions", "boundaries", "files")
_LISTS = ("check_failures", "warnings", "cycles", "points", "not_evaluated")
_NEVER_ABSENT = ("case", "status", "point", "steps", "points", "old", "new", "parameters", "k", "theta")


def read_table(path: Path) -> dict[str, Any]:
    """Read a JSON object of a run folder; raises InputError and OSError as `refuse_other_types` and `read_json`."""
    data: dict[str, Any] = read_json(path)
    refuse_other_types(path, data)
    return data


def refuse_other_types(path: Path, data: Any) -> None:
    """Raise InputError, with file, key, value and what it should be, for no table or known keys of another type."""
    if not isinstance(data, Mapping):
        raise InputError(f"{path} holds no JSON object")
    for key, value in data.items():
        expected = _expected(key, value)
        if expected:
            raise InputError(f"{path} is damaged: {cut(key)} is {cut(repr(value), 60)}, not {expected}")
    if isinstance(data.get("time"), Mapping):
        refuse_other_types(path, data["time"])


def _expected(key: str, value: Any) -> str:
    """Return what a value should be instead; empty if it may be what it is."""
    if value is None:
        return "what it is needed for" if key in _NEVER_ABSENT else ""
    if key in _TEXTS:
        return "" if isinstance(value, str) else "a text"
    if key in _WHOLE:
        return "" if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else "a whole number"
    if key in _REAL and not isinstance(value, Mapping):
        return "" if _is_number(value) else "a number"
    if key in _LISTS:
        return "" if isinstance(value, list) else "a list"
    if key in _TABLES or key == "reached":
        if not isinstance(value, Mapping):
            return "a table"
        if key in ("boundaries", "files") and not all(isinstance(item, Mapping) for item in value.values()):
            return "a table of tables"
        if (key in _FLAT or key == "reached") and not all(item is None or _is_number(item) for item in value.values()):
            return "a table of numbers"
        if key == "quantities" and not all(map(_is_quantity, value.values())):
            return "a table of numbers"
        if key == "parameters" and not all(isinstance(item, int | float | str) for item in value.values()):
            return "a table of numbers and words"
    return ""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_quantity(value: Any) -> bool:
    """Tell whether a value is a number or none, or, in time, a table of such."""
    parts = list(value.values()) if isinstance(value, Mapping) else [value]
    return all(part is None or _is_number(part) for part in parts)
