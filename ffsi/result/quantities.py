"""The registry of quantities: name, unit, words, tables and plots; their flat forms and published values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ffsi.result.published import Reference

CHECKED = (
    *("momentum", "continuity", "incompressibility", "kinematics", "mesh_motion", "dirichlet"),
    *("drag_difference", "lift_difference", "coefficient_difference", "outlet_difference", "wall_difference"),
    "quantities_difference",
)


@dataclass(frozen=True)
class Quantity:
    """A quantity of a result, and where people see it.

    Attributes:
        name: as in `result.json`; with a part of the scene behind it (`drag_beam`, `wss_mean_dome`), it is the same.
        unit: `1` without dimension.
        words: what legends and heads of tables call it.
        plot: title of the plot in which it is a line; empty: of none.
        tables: `sweep` that of the terminal, `points` that of the report; `flow`, `walls` and `parts` those of blood.
    """

    name: str
    unit: str
    words: str = ""
    plot: str = ""
    tables: tuple[str, ...] = ()


_BOTH, _POINTS, _FLOW, _PARTS = ("sweep", "points"), ("points",), ("flow",), ("parts",)
_TIP, _ROOF, _JACOBIAN = "Tip displacement", "Displacement of the roof's middle", "Smallest J = det F"
QUANTITIES = (
    Quantity("drag", "N/m", "drag", "Drag", _BOTH),
    Quantity("lift", "N/m", "lift", "Lift", _BOTH),
    Quantity("drag_coefficient", "1", "drag", tables=_POINTS),
    Quantity("lift_coefficient", "1", "lift", tables=_POINTS),
    Quantity("tip_ux", "m", "u_x", _TIP, _BOTH),
    Quantity("tip_uy", "m", "u_y", _TIP, _BOTH),
    Quantity("roof_ux", "m", "u_x", _ROOF, _POINTS),
    Quantity("roof_uy", "m", "u_y", _ROOF, _POINTS),
    Quantity("min_jacobian_fluid", "1", "fluid mesh", _JACOBIAN),
    Quantity("min_jacobian_solid", "1", "solid", _JACOBIAN),
    Quantity("min_jacobian", "1", "all", _JACOBIAN, ("sweep",)),
    Quantity("pressure_difference", "Pa", "Δp"),
    Quantity("outlet_pressure", "Pa"),
    Quantity("flow_rate_in", "m²/s", tables=_FLOW),
    Quantity("flow_rate_out", "m²/s", tables=_FLOW),
    Quantity("mass_balance", "1", tables=_FLOW),
    Quantity("pressure_drop", "Pa", tables=_FLOW),
    Quantity("dome_inflow", "m²/s", tables=_FLOW),
    Quantity("dome_area", "m²", tables=_FLOW),
    Quantity("turnover_time", "s", tables=_FLOW),
    Quantity("effective_stress_max", "Pa", tables=("walls",)),
    Quantity("dome_displacement_max", "m", tables=("walls",)),
    Quantity("wss", "Pa", "WSS", tables=_PARTS),
    Quantity("tawss", "Pa", "TAWSS", tables=_PARTS),
    Quantity("osi", "1", "OSI", tables=_PARTS),
    Quantity("rrt", "1/Pa", "RRT", tables=_PARTS),
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
    name = re.sub("_(mean|amplitude|last|min|max)$", "", quantity)
    known = [item for item in QUANTITIES if f"{name}_".startswith(f"{item.name}_")]
    found = max(known, key=lambda item: len(item.name)).unit if known else "1"
    return "m" if found == "1" and name.endswith(("_ux", "_uy", "_x", "_y")) else found
