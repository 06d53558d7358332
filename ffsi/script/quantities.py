"""The registry of quantities: name, unit, words, tables and plots, and the formulas of what scripts report by it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ffsi.scene import Boundary, Scene, boundaries
from ffsi.scene.geometry.channel_cylinder import ChannelCylinder


@dataclass(frozen=True)
class Quantity:
    """A quantity of a result, and where people see it.

    Attributes:
        name: as in `result.json`; with a part of the scene behind it (`drag_beam`, `wss_mean_dome`), it is the same.
        unit: `1` without dimension.
        words: what legends and heads of tables call it.
        plot: title of the plot in which it is a line; empty: of none.
        tables: `sweep` that of the terminal, `points` that of the report; `flow`, `walls` and `parts` those of blood.
        formula: FreeFEM text of its value in SI with the names of edp/lib (`output.idp`), for a script to report; empty
            where the library does so by itself, or where it is computed after the run.
        where: whether a scene has it, by its formula.
        history: whether a script in time reports it after every step, too.
    """

    name: str
    unit: str
    words: str = ""
    plot: str = ""
    tables: tuple[str, ...] = ()
    formula: str = ""
    where: Callable[[Scene], bool] = lambda scene: True
    history: bool = False


def _has_fluid(scene: Scene) -> bool:
    return scene.fluid is not None


def _has_velocity_inlet(scene: Scene) -> bool:
    return {"inlet", "outlet"} <= {side.role for side in boundaries(scene)}


def _has_whole_cylinder(scene: Scene) -> bool:
    return _has_fluid(scene) and isinstance(scene.geometry, ChannelCylinder) and scene.geometry.beam is None


_DROP = " - ".join(f"int1d(Th, {end})(p)/int1d(Th, {end})(1.)" for end in ("inletLabels", "outletLabels"))
_BOTH, _POINTS, _FLOW, _PARTS = ("sweep", "points"), ("points",), ("flow",), ("parts",)
_TIP, _ROOF, _JACOBIAN = "Tip displacement", "Displacement of the roof's middle", "Smallest J = det F"
_FLOW_THROUGH, _RESERVOIR, _PRESSURE_AT = (
    Quantity("flow_through", "m²/s", tables=_FLOW),
    Quantity("windkessel", "Pa", tables=_FLOW),
    Quantity("pressure_at", "Pa", tables=_FLOW),
)
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
    Quantity(
        "pressure_difference",
        "Pa",
        "Δp",
        formula="unitPressure*(p(cx-cr, cy) - p(cx+cr, cy))",  # front less back
        where=_has_whole_cylinder,
    ),
    Quantity("outlet_pressure", "Pa"),
    Quantity("flow_rate_in", "m²/s", tables=_FLOW),
    Quantity("flow_rate_out", "m²/s", tables=_FLOW),
    Quantity("mass_balance", "1", tables=_FLOW),
    Quantity("pressure_drop", "Pa", tables=_FLOW, formula=f"unitPressure*({_DROP})", where=_has_velocity_inlet),
    _FLOW_THROUGH,
    _PRESSURE_AT,
    _RESERVOIR,
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


def reported(scene: Scene) -> list[Quantity]:
    """Return the quantities that the scene's script reports by their formulas."""
    found = [quantity for quantity in QUANTITIES if quantity.formula and quantity.where(scene)]
    return [*found, *(quantity for side in boundaries(scene) if side.opening for quantity in _of_opening(scene, side))]


def _of_opening(scene: Scene, side: Boundary) -> list[Quantity]:
    """Return the flow rate through one of several inlets (inwards) or outlets (outwards), and its mean pressure."""
    sign, name, on = "-" if side.opening in scene.inlet else "", f"_{side.opening}", f"int1d(Th, {side.label})"
    flow = f"{sign}unitVelocity*unitLength*{on}(vx*N.x+vy*N.y)"
    found = [
        replace(_FLOW_THROUGH, name=_FLOW_THROUGH.name + name, formula=flow, history=True),
        replace(_PRESSURE_AT, name=_PRESSURE_AT.name + name, formula=f"unitPressure*{on}(p)/{on}(1.)", history=True),
    ]
    if scene.time and side.opening in scene.outlets and scene.outlets[side.opening].law.stores:
        number = [each.label for each in boundaries(scene) if each.role == "outlet"].index(side.label)
        formula = f"unitPressure*openingReservoir[{number}]"
        found.append(replace(_RESERVOIR, name=_RESERVOIR.name + name, formula=formula, history=True))
    return found
