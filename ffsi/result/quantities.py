"""What the registry of quantities says of a name; the flat forms of quantities and their published values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from ffsi.result.published import Reference
from ffsi.script.quantities import QUANTITIES

CHECKED = (
    *("momentum", "continuity", "incompressibility", "kinematics", "mesh_motion", "dirichlet"),
    *("drag_difference", "lift_difference", "coefficient_difference", "outlet_difference", "wall_difference"),
    *("start_difference", "quantities_difference", "sensitivities_difference", "errors_difference"),
)


WORDS = {quantity.name: quantity.words for quantity in QUANTITIES}


def in_table(table: str) -> tuple[str, ...]:
    """Return the names of the quantities that a table has (`Quantity.tables`)."""
    return tuple(quantity.name for quantity in QUANTITIES if table in quantity.tables)


def check_maximum(data: Mapping[str, Any]) -> float:
    """Return the largest number of the independent checker in the content of a `result.json`; NaN if it did not run."""
    numbers = ((data.get("check") or {}).get(name) for name in CHECKED)
    return max((float(number) for number in numbers if isinstance(number, (int, float))), default=math.nan)


def flatten(quantities: Mapping[str, Any]) -> dict[str, float]:
    """Turn `{"drag": {"mean": 1, ...}}` into `{"drag_mean": 1, ...}`; leave plain numbers; drop what is no number."""
    flat: dict[str, float] = {}
    for key, value in quantities.items():
        if isinstance(value, Mapping):
            flat.update({f"{key}_{part}": float(item) for part, item in value.items() if item is not None})
        elif isinstance(value, (int, float)):
            flat[key] = float(value)
    return flat


def error_bar(name: str, data: Mapping[str, Any]) -> float | None:
    """Return the error bar of a (flattened) quantity in a content of `result.json`, of a last state too; or None."""
    errors = data.get("errors") or {}
    return (errors.get(name) or errors.get(f"{name}_last") or {}).get("bar")


def published_value(name: str, published: Mapping[str, Reference]) -> tuple[float, Reference] | None:
    """Return the published value that belongs to a (flattened) quantity's name, and where it is from; None without."""
    for ending, part in (("_amplitude", "amplitude"), ("_frequency", "frequency"), ("_mean", "mean"), ("", "mean")):
        reference = published.get(name.removesuffix(ending)) if name.endswith(ending) else None
        value = getattr(reference, part, None)
        if reference is not None and value is not None:
            return float(value), reference
    return None


def unit(quantity: str) -> str:
    """Return the unit of a (flattened) quantity's name, `1` if it has none."""
    quantity = quantity.removeprefix("reached_").removesuffix("_error")
    if quantity.endswith("_frequency"):
        return "Hz"
    if quantity.endswith("_change"):
        return "1"
    known = [item for item in QUANTITIES if f"{quantity}_".startswith(f"{item.name}_")]
    found = max(known, key=lambda item: len(item.name)).unit if known else "1"
    name = re.sub("_(mean|amplitude|last|min|max)$", "", quantity)
    return "m" if found == "1" and name.endswith(("_ux", "_uy", "_x", "_y")) else found
