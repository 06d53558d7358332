"""What the models say of their fields, and from pydantic's validation errors to problems in the words of the scene."""

from __future__ import annotations

import re
import types
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ffsi.scene.errors import SHOWN_PROBLEMS, Problem, join, names, nearest, short
from ffsi.scene.units import Quantity

Model = type[BaseModel]

# The keys that choose one model of a union.
_TAGS = ("kind", "material", "law")


# What the annotation of a field says ---------------------------------------------------------------------------------


def members(annotation: Any) -> tuple[list[Any], list[Any]]:
    """Return the alternatives of an annotation without None, and what `Annotated` adds to them."""
    if get_origin(annotation) is Annotated:
        inner, *said = get_args(annotation)
        found, more = members(inner)
        return found, [*said, *more]
    if get_origin(annotation) in (Union, types.UnionType):
        parts = [members(part) for part in get_args(annotation) if part is not types.NoneType]
        return [item for found, _ in parts for item in found], [item for _, more in parts for item in more]
    return [annotation], []


def of_field(field: FieldInfo) -> tuple[list[Any], list[Any]]:
    """Return the same of a field of a model."""
    found, said = members(field.annotation)
    return found, [*field.metadata, *said]


def literals(annotation: Any) -> list[str]:
    """Return the names of a `Literal`; of anything else none."""
    return list(get_args(annotation)) if get_origin(annotation) is Literal else []


def unit(field: FieldInfo) -> str:
    """Return the SI unit of a number; empty for one without dimension and for everything else."""
    found = next((item.unit for item in of_field(field)[1] if isinstance(item, Quantity)), "1")
    return "" if found == "1" else found


# Errors --------------------------------------------------------------------------------------------------------------


def scene_problems(error: ValidationError, root: Model) -> list[Problem]:
    """Return the problems that a validation error of the model ``root`` stands for; of very many the first."""
    details = error.errors(include_url=False)
    found = [problem for detail in details[:SHOWN_PROBLEMS] for problem in _problems(detail, root)]
    if len(details) > SHOWN_PROBLEMS:  # each would be compared with every name that there is
        found.append(Problem("scene", f"and {len(details) - SHOWN_PROBLEMS} more problems"))
    return found


def _problems(detail: ErrorDetails, root: Model) -> list[Problem]:
    kind, location, value = detail["type"], detail["loc"], detail["input"]
    context: dict[str, Any] = dict(detail.get("ctx", {}))
    key, table = _locate(root, location)
    match kind:
        case "problems":
            problems: Sequence[Problem] = context["problems"]
            return [problem.below(key) for problem in problems]
        case "missing":
            field = table.model_fields.get(str(location[-1])) if table else None
            meaning = field.description if field and field.description else "a value is needed"
            return [Problem(key, f"missing; {meaning}")]
        case "extra_forbidden":
            return [_unknown_key(key, value, table, root, _models_at(root, location[:-2]))]
        case "literal_error":
            return [_unknown_name(key, value, _quoted(str(context["expected"])))]
        case "union_tag_invalid":
            tag = context["discriminator"].strip("'")
            given = value.get(tag) if isinstance(value, dict) else context["tag"]
            return [_unknown_name(join(key, tag), given, _quoted(str(context["expected_tags"])))]
        case "union_tag_not_found":
            tag = context["discriminator"].strip("'")
            accepted = [name for model in _models_at(root, location) for name in _literals(model, tag)]
            return [Problem(join(key, tag), f"missing; accepted: {names(accepted)}")]
        case "model_type" | "model_attributes_type" | "dict_type":
            return [Problem(key or "scene", "must be a table of keys and values", short(value))]
        case "bool_type":
            return [Problem(key, "accepted: true or false", short(value))]
        case "string_type":
            return [Problem(key, "accepted: text in quotes", short(value))]
        case _:
            return [Problem(key, detail["msg"].removeprefix("Value error, "), short(value))]


def _unknown_name(key: str, value: Any, accepted: list[str]) -> Problem:
    guess = nearest(value, accepted) if isinstance(value, str) else None
    return Problem(key, f"accepted: {names(accepted)}", short(value), guess)


def _unknown_key(key: str, value: Any, table: Model | None, root: Model, above: Sequence[Model]) -> Problem:
    """Return the problem of a key that a table of the root does not have; above it several, if it is one of a union."""
    prefix, _, name = key.rpartition(".")
    siblings = list(table.model_fields) if table else []
    where = f'"{prefix}"' if prefix else "the scene"
    if table and len(above) > 1:
        tags = [f'{tag} "{literals[0]}"' for tag in _TAGS if len(literals := _literals(table, tag)) == 1]
        where += f" with the {tags[0]}" if tags else ""
        if any(name in other.model_fields for other in above):
            # Right for another one of the union: a name that looks alike is not what was meant.
            return Problem(key, f"unknown key; {where} has {names(siblings)}", short(value))
    guess = nearest(name, siblings)
    if guess is not None:
        guess = join(prefix, guess)
    else:
        # Below the prefix another one of the union may have keys that this table does not know.
        elsewhere = [full for full in _all_keys(root) if not (prefix and full.startswith(f"{prefix}."))]
        own = _all_keys(table, prefix) if table else ()
        by_name = {full.rpartition(".")[2]: full for full in (*own, *elsewhere)}
        found = nearest(name, by_name)
        guess = by_name[found] if found else None
    return Problem(key, f"unknown key; {where} has {names(siblings)}", short(value), guess)


def _quoted(text: str) -> list[str]:
    return re.findall(r"'([^']*)'", text)


# Walking along a location through the models ------------------------------------------------------------------


def models(annotation: Any) -> list[Model]:
    """Return the models among the alternatives of an annotation."""
    return [member for member in members(annotation)[0] if isinstance(member, type) and issubclass(member, BaseModel)]


def _literals(model: Model, field: str) -> list[str]:
    return literals(model.model_fields[field].annotation) if field in model.model_fields else []


def _walk(root: Model, location: tuple[int | str, ...]) -> Iterator[tuple[list[str], list[Model]]]:
    """Yield the dotted key and the possible models after each step; tags of unions are no keys."""
    key: list[str] = []
    annotation: Any = root
    yield key, models(annotation)
    for item in location:
        found = models(annotation)
        tagged = [model for model in found if any(item in _literals(model, tag) for tag in _TAGS)]
        if found and (several := _tables(annotation)):  # the tag of a union of one table and several
            annotation = several[0] if item == "several" else found[0]
        elif len(found) > 1 and tagged:
            annotation = tagged[0]
        else:
            key = [*key, str(item)]
            if found:
                field = found[0].model_fields.get(str(item)) if len(found) == 1 else None
                annotation = field.annotation if field else None
            else:
                tables = _tables(annotation)
                annotation = get_args(tables[0])[1] if tables else None
        yield key, models(annotation)


def _tables(annotation: Any) -> list[Any]:
    return [member for member in members(annotation)[0] if get_origin(member) is dict]


def _locate(root: Model, location: tuple[int | str, ...]) -> tuple[str, Model | None]:
    """Return the dotted key of a location and the model that holds its last item."""
    steps = list(_walk(root, location))
    holders = steps[-2][1] if len(steps) > 1 else steps[0][1]
    return ".".join(steps[-1][0]), holders[0] if len(holders) == 1 else None


def _models_at(root: Model, location: tuple[int | str, ...]) -> list[Model]:
    return list(_walk(root, location))[-1][1]


def _all_keys(model: Model, prefix: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield join(prefix, name)
        for inner in models(field.annotation):
            yield from _all_keys(inner, join(prefix, name))
