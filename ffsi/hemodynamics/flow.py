"""Flow rates: through inlet and outlet, and through the neck of an aneurysm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ffsi.files.arrays import RawMesh, RawState
from ffsi.hemodynamics.walls import wall_points
from ffsi.result.fields import Fields
from ffsi.scene.boundaries import DOME_WALL, INLET, OUTLET

_NECK_POINTS = 2001
_ROUNDING = 1e-9


def flow_rate(mesh: RawMesh, state: RawState, label: int) -> float:
    """Return the flow rate out of the fluid through a boundary that does not move, m^2/s; exact for quadratic v."""
    points = wall_points(mesh, [label])
    nodes = np.column_stack([points.ends, points.middle])
    normal_velocity = np.einsum("nai,ni->na", state.v[nodes], points.normal)
    return float((normal_velocity @ np.array([1, 1, 4]) / 6) @ points.length)


def rates(
    mesh: RawMesh,
    state: RawState,
    viscosity: float,
    inlets: Sequence[int] = (INLET,),
    outlets: Sequence[int] = (OUTLET,),
) -> dict[str, float]:
    """Return the flow rates in and out through labels, m^2/s, and their difference relative to the larger one, if any.

    Of a fluid at rest both are rounding: that of its pressure, whose smallest flow p H^2/mu (through the inlet) times
    a small factor is the least that the difference is related to. `viscosity` is that of the fluid at rest, Pa s.
    """
    into = sum((0.0 - flow_rate(mesh, state, label) for label in inlets), 0.0)  # not -0.0 of a rest
    out = sum((flow_rate(mesh, state, label) for label in outlets), 0.0)
    height = float(wall_points(mesh, list(inlets)).length.sum())
    rounding = _ROUNDING * float(np.abs(state.p).max()) * height**2 / viscosity
    scale = float(np.max([abs(into), abs(out), rounding]))  # unlike max(), it passes a NaN on
    found = {"flow_rate_in": into} if len(inlets) else {}
    found |= {"flow_rate_out": out} if len(outlets) else {}
    return found | ({"mass_balance": (into - out) / (scale or 1.0)} if len(found) > 1 else {})


def dome_flow(mesh: RawMesh, state: RawState, fields: Fields) -> dict[str, float]:
    """Return what comes through the straight line between the neck's ends, where the deformed walls have them.

    `dome_inflow` (m^2/s) is the rate into the dome, which crosses the line elsewhere than that out of it, `dome_area`
    (m^2), and with an inflow `turnover_time` (s), in which it fills the dome once. The line must not move with the
    mesh: how the mesh follows the walls is no part of the flow. `fields` are those of the state.
    """
    dome = wall_points(mesh, [DOME_WALL])
    at = mesh.p2_coordinates + state.u
    start, end = at[dome.ends[0, 0]], at[dome.ends[-1, 1]]
    share = np.linspace(0, 1, _NECK_POINTS)[:, None]
    found = replace(fields, points=fields.deformed).sample(start + share * (end - start))
    # Within a strut nothing flows; the ends lie on the mesh up to rounding.
    outside = np.isnan(found["region"])[:, None]
    velocity = np.where(outside, 0.0, np.column_stack([found["vx"], found["vy"]]))
    mean = (velocity[1:] + velocity[:-1]) / 2
    step = (end - start) / (_NECK_POINTS - 1)
    through = mean[:, 0] * step[1] - mean[:, 1] * step[0]  # from upstream to downstream the dome lies to the right
    outline = at[np.column_stack([dome.ends[:, 0], dome.middle]).ravel()]
    x, y = np.concatenate([outline, end[None]]).T
    area = abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2
    inflow = float(np.maximum(through, 0).sum())
    flow = {"dome_inflow": inflow, "dome_area": area}
    return flow | {"turnover_time": area / inflow} if inflow != 0 else flow
