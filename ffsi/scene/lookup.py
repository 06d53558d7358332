"""One value of a scene by its dotted key: what is accepted for it, and its unit."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from typing import Any, get_args, get_origin

from pydantic.fields import FieldInfo

from ffsi.scene.base import Table
from ffsi.scene.model import Scene
from ffsi.scene.units import Count, Quantity
from ffsi.scene.validation import members, of_field

Scalar = float | int | bool | str


def plain(value: Any) -> Any:
    """Return numbers, texts and truth values of numpy, pandas and the standard library as Python's own.

    A float of fewer digits than Python's is what it prints: numpy.float32(0.02) becomes 0.02.
    """
    if isinstance(value, Decimal):
        return float(value)
    if getattr(value, "ndim", None) == 0 and hasattr(value, "dtype") and hasattr(value, "item"):
        return float(str(value)) if str(value.dtype) in ("float16", "float32") else value.item()
    return value


def rules(key: str) -> list[Quantity | Count]:
    """Return what the models accept for a number under a dotted key, of each kind of table that has it."""
    return [rule for field in fields(key) for rule in of_field(field)[1] if isinstance(rule, Quantity | Count)]


def fields(key: str) -> list[FieldInfo]:
    """Return the fields under a dotted key, of each kind of table that has it: of every material, say."""
    tables: list[Any] = [Scene]
    *path, last = key.split(".")
    for name in path:
        found: list[Any] = []
        for table in tables:
            if get_origin(table) is dict:  # of solids, say: any name
                found += members(get_args(table)[1])[0]
            elif name in table.model_fields:
                found += of_field(table.model_fields[name])[0]
        tables = [item for item in found if get_origin(item) is dict or _is_table(item)]
    return [table.model_fields[last] for table in tables if _is_table(table) and last in table.model_fields]


def unit_of(key: str) -> str:
    """Return the SI unit of the number under a dotted key; empty without one, and for texts."""
    unit = next((rule.unit for rule in rules(key) if isinstance(rule, Quantity)), "1")
    return "" if unit == "1" else unit


def given(table: Mapping[str, Any], key: str) -> Any:
    """Return what stands under a dotted key in nested tables; None if nothing does."""
    found: Any = table
    for name in key.split("."):
        found = found.get(name) if isinstance(found, Mapping) else None
    return found


def _is_table(item: Any) -> bool:
    return isinstance(item, type) and issubclass(item, Table)
