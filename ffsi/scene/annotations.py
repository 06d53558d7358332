"""What the annotation of a field says: its alternatives, and what is accepted."""

from __future__ import annotations

import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from ffsi.scene.units import Quantity


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
