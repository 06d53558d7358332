"""Every key that a scene can have, from the models themselves: `ffsi keys`, docs/scene.md."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, cast, get_args, get_origin

from pydantic import BeforeValidator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from ffsi.scene.errors import join, names, number_text, short
from ffsi.scene.geometry import ChannelGeometry, GeometryBase
from ffsi.scene.model import Scene
from ffsi.scene.numerics import SIZES
from ffsi.scene.together import OF_FLUID
from ffsi.scene.units import Count, Quantity
from ffsi.scene.validation import Model, literals, models, of_field, unit
from ffsi.scene.validation import members as split

NEEDED = "needed"
_TYPES: dict[Any, str] = {str: "text", bool: "true or false"}


@dataclass(frozen=True)
class Key:
    """One key of a scene.

    Args:
        key: dotted key; NAME stands for a name that the scene chooses.
        only: what must be chosen for it, such as ``geometry.kind = "channel"``; empty where it is always there.
        type: what its value is, in words.
        unit: SI unit of a plain number, empty without one.
        default: value where the scene has none, as TOML writes it; "needed", or empty for none.
        range: values that are accepted, empty for all.
        meaning: one sentence.
        value: value in a scene, as TOML writes it; empty where it has none, and where no scene was asked.
    """

    key: str
    only: str
    type: str
    unit: str
    default: str
    range: str
    meaning: str
    value: str = ""

    @property
    def accepted(self) -> str:
        """What is accepted, in words."""
        return self.range if self.type == "text" and self.range else f"{self.type} {self.range}".rstrip()


def scene_keys(pattern: str = "*", scene: Scene | None = None) -> list[Key]:
    """Return every key, or those of a table (`outlet`) or a pattern (`*velocity`), in the order of the models.

    With a scene, only those that go with its geometry, materials and laws, under its own names, and with its values.
    """
    return [
        item
        for item in (_keys(Scene, "", "") if scene is None else _keys_of(scene))
        if fnmatchcase(item.key, pattern)
        or item.key.startswith(f"{pattern}.")
        or fnmatchcase(pattern, item.key.replace("NAME", "*"))
    ]


def _keys_of(scene: Scene) -> Iterator[Key]:
    table = scene.model_dump()
    named = {"solid": list(scene.geometry.solid_names)}
    for item in _keys(Scene, "", ""):
        if item.key.partition(".")[0] in OF_FLUID and not isinstance(scene.geometry, ChannelGeometry):
            continue
        before, is_named, _ = item.key.partition(".NAME")
        several = [""]
        if is_named:
            tables = _at(table, before) or {"NAME": {}}
            several = named.get(before, [n for n in tables if before != "outlet" or isinstance(tables[n], Mapping)])
        for name in several:
            key, (chosen, _, choice) = item.key.replace("NAME", name), item.only.replace("NAME", name).partition(" = ")
            if not chosen or _toml(_at(table, chosen)) == choice:
                yield replace(item, key=key, value=_toml(_at(table, key)))


def _at(table: Any, key: str) -> Any:
    """Return the value at a dotted key of nested tables; None if there is none."""
    for name in key.split("."):
        table = table.get(name) if isinstance(table, Mapping) else None
    return table


def markdown() -> str:
    """Return one table for each table of a scene, and one for each kind of it."""
    parts: dict[tuple[str, str], list[Key]] = {}
    for item in scene_keys():
        parts.setdefault((item.key.partition(".")[0] if "." in item.key else "", item.only), []).append(item)
    lines = []
    for (table, only), items in parts.items():
        lines += [f"### {only or (f'[{table}]' if table else 'The scene')}", ""]
        lines += ["| key | type | unit | default | range | meaning |", "| --- | --- | --- | --- | --- | --- |"]
        for item in items:
            default = f"`{item.default}`" if item.default not in ("", NEEDED) else item.default
            cells = (f"`{item.key}`", item.type, item.unit, default, item.range, item.meaning)
            lines.append(f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |")
        lines.append("")
    return "\n".join([*lines, *_sizes()]) + "\n"


def _sizes() -> list[str]:
    """Return the table of the element sizes that a scene has where it gives none."""
    lines = ["### Element sizes that are not given", ""]
    lines += [f"| geometry.kind | for | {' | '.join(f'`mesh.{name}`' for name in SIZES)} |"]
    lines += ["| --- | --- |" + " ---: |" * len(SIZES)]
    for geometry in models(Scene.model_fields["geometry"].annotation):
        if issubclass(geometry, GeometryBase) and (sizes := geometry.default_sizes) is not None:
            (kind,) = literals(geometry.model_fields["kind"].annotation)
            length = geometry.model_fields[geometry.sized_by].default
            known = f" = {number_text(1.0 if length is PydanticUndefined else length)} m"
            cells = " | ".join(number_text(sizes[name]) for name in SIZES)
            lines.append(f"| `{kind}` | `{geometry.sized_by}`{known} | {cells} |")
    return lines


def _keys(model: Model, prefix: str, only: str, chosen_by: str = "") -> Iterator[Key]:
    for name, field in model.model_fields.items():
        if name == chosen_by:
            continue
        key, (members, metadata) = join(prefix, name), of_field(field)
        is_dict = [get_args(member) for member in members if get_origin(member) is dict]
        if is_dict and (one := [table for member in members for table in models(member)]):
            yield from _keys(one[0], key, only)  # one table, or several by name
        if is_dict:
            key = join(key, "NAME")
            members, metadata = split(is_dict[0][1])
        tables = [table for member in members for table in models(member)]
        if not tables:
            yield _leaf(key, only, field, members, metadata, named=bool(is_dict))
        if len(tables) == 1:
            yield from _keys(tables[0], key, only)
        elif tables:
            yield from _choice(key, field, tables, metadata)


def _choice(key: str, field: FieldInfo, tables: list[Model], metadata: list[Any]) -> Iterator[Key]:
    """Yield the key that chooses one of several tables, then those of each."""
    tag = next(str(item.discriminator) for item in (*metadata, field) if getattr(item, "discriminator", None))
    kinds = {literals(table.model_fields[tag].annotation)[0]: table for table in tables}
    filled: dict[str, Any] = next(
        (cast(Any, item.func)({}) for item in metadata if isinstance(item, BeforeValidator)), {}
    )
    default = _toml(filled[tag]) if tag in filled else NEEDED
    meaning = str(tables[0].model_fields[tag].description).partition(":")[0]
    yield Key(join(key, tag), "", "text", "", default, names(kinds), meaning)
    for kind, table in kinds.items():
        yield from _keys(table, key, f'{join(key, tag)} = "{kind}"', tag)


def _leaf(key: str, only: str, field: FieldInfo, members: list[Any], metadata: list[Any], *, named: bool) -> Key:
    words = [word for member in members for word in literals(member)]
    rule = next((item for item in metadata if hasattr(item, "accepted")), None)
    match rule:
        case Count():
            kind, limits = "whole number", f"{rule.at_least} to {rule.at_most}"
        case Quantity():
            kind, limits = "number", rule.range
        case None if words:
            kind, limits = "text", names(words)
        case None if any(get_origin(member) is tuple for member in members):
            kind, limits = "list of numbers", ""
        case None:
            kind, limits = next(_TYPES[member] for member in members if member in _TYPES), ""
        case _:
            kind, limits = rule.accepted, ""
    meaning = inspect.cleandoc(field.description or "")
    for ending in (f", {unit(field)}", ", dimensionless", " (dimensionless)", " (true or false)"):
        meaning = meaning.removesuffix(ending)
    default = "" if named else NEEDED if field.default is PydanticUndefined else _toml(field.default)
    return Key(key, only, kind, unit(field), default, limits, meaning)


def _toml(value: Any) -> str:
    return "" if value is None else short(value)
