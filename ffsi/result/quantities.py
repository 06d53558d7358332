"""Names of quantities: their units, flat forms and published values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ffsi.result.published import Reference

CHECKED = (
    *("momentum", "continuity", "incompressibility", "kinematics", "mesh_motion", "dirichlet"),
    *("drag_difference", "lift_difference", "coefficient_difference", "outlet_difference", "wall_difference"),
    "quantities_difference",
)

UNITS = {
    "drag": "N/m",
    "lift": "N/m",
    "pressure_drop": "Pa",
    "pressure_difference": "Pa",
    "outlet_pressure": "Pa",
    "flow_rate_in": "m²/s",
    "flow_rate_out": "m²/s",
    "dome_inflow": "m²/s",
    "dome_area": "m²",
    "turnover_time": "s",
    "dome_displacement_max": "m",
}
FAMILIES = {
    "drag_coefficient": "1",
    "lift_coefficient": "1",
    "drag_": "N/m",
    "lift_": "N/m",
    "wss_": "Pa",
    "tawss_": "Pa",
    "rrt_": "1/Pa",
    "effective_stress_": "Pa",
}
"""Units of quantities that exist for several parts, by how their names begin."""


def flatten(quantities: Mapping[str, Any]) -> dict[str, float]:
    """Turn `{"drag": {"mean": 1, ...}}` into `{"drag_mean": 1, ...}`; leave plain numbers; drop what is no number."""
    flat: dict[str, float] = {}
    for key, value in quantities.items():
        if isinstance(value, Mapping):
            flat.update({f"{key}_{part}": float(item) for part, item in value.items() if item is not None})
        elif isinstance(value, (int, float)):
            flat[key] = float(value)
    return flat


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
    quantity = quantity.removeprefix("reached_")
    if quantity.endswith("_frequency"):
        return "Hz"
    if quantity.endswith("_change"):
        return "1"
    name = quantity.removesuffix("_mean").removesuffix("_amplitude")
    for start, name_unit in FAMILIES.items():
        if name.startswith(start):
            return name_unit
    return "m" if name.endswith(("_ux", "_uy", "_x", "_y")) else UNITS.get(name, "1")
