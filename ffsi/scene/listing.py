"""The tables of a scene as lines of text that a person reads."""

from collections.abc import Iterator, Mapping

from ffsi.scene.base import Table
from ffsi.scene.errors import join, short
from ffsi.scene.validation import unit


def rows(scene: Table) -> Iterator[tuple[str, str]]:
    """Yield the name of each table of a scene, and its values with their units."""
    for name in type(scene).model_fields:
        value = getattr(scene, name)
        tables = value if isinstance(value, Mapping) else {"": value}
        for inner, table in tables.items():
            if isinstance(table, Table):
                yield join(name, inner), ", ".join(_values(table))


def _values(table: Table, prefix: str = "") -> Iterator[str]:
    for name, field in type(table).model_fields.items():
        key, value = join(prefix, name), getattr(table, name)
        if isinstance(value, Table):
            yield from _values(value, key)
        elif isinstance(value, Mapping):
            for inner, item in value.items():
                yield from _values(item, join(key, inner)) if isinstance(item, Table) else [f"{inner} {short(item)}"]
        elif value is not None:
            yield f"{key} {short(value)} {unit(field)}".rstrip()
