"""A scene as a person reads it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from ffsi.scene.annotations import unit
from ffsi.scene.base import Table
from ffsi.scene.errors import join, short


def text(heading: str, scene: Table) -> str:
    """Return the heading, and one line for each table with its values and their units."""
    rows = list(_rows(scene))
    width = max(len(name) for name, _ in rows)
    return "\n".join([heading, *(f"  {name:<{width}}  {', '.join(values)}" for name, values in rows)])


def html(heading: str, scene: Table) -> str:
    """Return the same as HTML."""
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(", ".join(values))}</td></tr>'
        for name, values in _rows(scene)
    )
    return f"<p><b>{escape(heading)}</b></p><table>{rows}</table>"


def _rows(scene: Table) -> Iterator[tuple[str, list[str]]]:
    for name in type(scene).model_fields:
        value = getattr(scene, name)
        tables = value if isinstance(value, Mapping) else {"": value}
        for inner, table in tables.items():
            if isinstance(table, Table):
                yield join(name, inner), list(_values(table))


def _values(table: Table, prefix: str = "") -> Iterator[str]:
    for name, field in type(table).model_fields.items():
        key, value = join(prefix, name), getattr(table, name)
        if isinstance(value, Table):
            yield from _values(value, key)
        elif isinstance(value, Mapping):
            for inner, item in value.items():
                yield from _values(item, join(key, inner)) if isinstance(item, Table) else [_value(inner, item)]
        elif value is not None:
            yield f"{_value(key, value)} {unit(field)}".rstrip()


def _value(key: str, value: Any) -> str:
    return f"{key} {short(value)}"
