"""Inlets and outlets of the fluid: what is wrong with their tables, the only ones or several by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ffsi.scene.errors import Problem, names, nearest, short
from ffsi.scene.flow import Inflow, Inlet, mean_of_profile, velocity_problems, with_mean_velocity
from ffsi.scene.geometry import ChannelGeometry, GeometryBase, MeshGeometry
from ffsi.scene.materials import Solid
from ffsi.scene.outlet import Outlet
from ffsi.scene.time import Time
from ffsi.scene.walls import Wall

_NO_TIME = "only accepted in a scene with a table time (time.step and time.end)"
_ALONG_AXIS = 1e-9
_LEAK = 1e-9
"""Part of a flow that is rounding."""
_BEYOND = 0.01
"""Part of an inlet by which a measured profile may be longer."""


def inflow_problems(inflow: Inflow, height: float, time: Time | None, table: str) -> Iterator[Problem]:
    """Yield what is wrong with an inflow of a ``table`` through an inlet of a height, m."""
    samples = inflow.profile_samples
    if samples and not (-_BEYOND * height <= samples.at[0] and samples.at[-1] <= (1 + _BEYOND) * height):
        reach = f"reaches from {short(samples.at[0])} to {short(samples.at[-1])} m"
        text = f"{reach}; accepted: 0 to {short(height)} m, the inlet"
        yield Problem(f"{table}.profile_samples.at", text)
    y = np.linspace(0.0, height, 201)
    bad = y[~np.isfinite(inflow.expression.evaluate(y=y, H=height))]
    if bad.size:
        text = f"not finite at y = {bad[0]:.4g} m; accepted: a formula that is defined for y from 0 to H"
        yield Problem(f"{table}.profile", text, short(inflow.profile))
    elif inflow.mean_velocity is None:
        yield from velocity_problems(inflow, height, table)
    if time is None:
        for key in ("ramp", "waveform", "series"):
            if (value := getattr(inflow, key)) is not None:
                yield Problem(f"{table}.{key}", _NO_TIME, short(value) + (" s" if key == "ramp" else ""))
        return
    t = np.linspace(0.0, time.end, 2001)
    bad = t[~np.isfinite(inflow.factor(t))]
    if bad.size and inflow.fourier is None:
        text = f"not finite at t = {bad[0]:.4g} s; accepted: a formula that is defined for t from 0 to time.end"
        yield Problem(f"{table}.waveform", text, short(inflow.waveform))


def closed_problems(
    solids: Mapping[str, Solid],
    inflow: Inflow | None,
    inlets: Mapping[str, Inlet],
    walls: Mapping[str, Wall],
    geometry: GeometryBase,
    time: Time | None,
) -> Iterator[Problem]:
    """Yield what is wrong with a fluid that has no natural condition: what comes in must have where to go."""
    if not isinstance(geometry, MeshGeometry):
        return
    if time is not None and solids:
        free = any(side.role not in ("clamped", "interface") for side in geometry.outline("solid"))
        if not free and all(solid.incompressible for solid in solids.values()):
            text = "nothing says the level of its pressure in a closed fluid; accepted: a compressible solid"
            yield Problem(f"solid.{next(iter(solids))}.formulation", f"{text}, or one with another boundary")
        return
    end = time.end if time else 0.0
    t = np.linspace(0.0, end, 101)
    flows = []  # into the fluid
    for name, place in geometry.named_inlets.items():
        each = inlets.get(name) if name else inflow
        if each is not None:
            known = with_mean_velocity(each, place.height) if each.mean_velocity is None else each
            area = mean_of_profile(known, place.height) * place.height
            flows.append((known.mean_velocity or 0.0) * area * each.factor(t))
    for side in geometry.outline("fluid"):
        if (wall := walls.get(side.moving or "")) is not None and wall.displaced:
            start, last = geometry.ends_of(side.label).transpose(1, 0, 2)
            points = np.stack([start, (start + last) / 2, last])
            movement = wall.movement(points.reshape(-1, 2), end)
            moved, v = (each.reshape(2, len(t), *points.shape[:2]) for each in movement)
            x, middle, y = (points.transpose(2, 0, 1)[:, None] + moved).transpose(2, 0, 1, 3)
            along = (4 * middle - 3 * x - y, 4 * (y - x), x - 4 * middle + 3 * y)  # Simpson's rule is exact
            flows += [*(sum(n[0] * v[1, :, i] - n[1] * v[0, :, i] for i, n in enumerate(along)) / 6).T]
    total = np.sum(flows, axis=0) if flows else np.zeros(len(t))
    if (np.abs(total) > _LEAK * np.abs(flows).max(initial=0.0)).any():
        i = int(np.abs(total).argmax())
        text = f"{total[i]:.4g} m^2/s enter a closed fluid{f' at t = {t[i]:.4g} s' if time else ''}"
        yield Problem("geometry.boundaries.outlet", f"{text}; accepted: an outlet, or a pressure at an inlet")


def opening_problems(
    inlets: Mapping[str, Inlet], outlets: Mapping[str, Outlet], geometry: GeometryBase, time: Time | None, weight: bool
) -> Iterator[Problem]:
    """Yield what is wrong with several inlets and outlets; ``weight``: whether the scene has gravity."""
    if not isinstance(geometry, ChannelGeometry):
        return
    yield from _name_problems("inlet", inlets, geometry)
    yield from _name_problems("outlet", outlets, geometry)
    for name in inlets.keys() & outlets.keys():
        yield Problem(f"outlet.{name}", "an inlet has this name; accepted: a name of its own")
    for name in inlets.keys() & geometry.named_inlets.keys():
        inlet, place = inlets[name], geometry.named_inlets[name]
        yield from inflow_problems(inlet, place.height, time, f"inlet.{name}")
        if inlet.direction == "normal" and min(map(abs, place.inward)) > _ALONG_AXIS:
            text = "only accepted at an inlet that is parallel to an axis"
            yield Problem(f"inlet.{name}.direction", text, short(inlet.direction))
    for name, outlet in outlets.items():
        if outlet.hydrostatic and not weight:
            yield Problem(f"outlet.{name}.hydrostatic", "only accepted in a scene with a table gravity", "true")


def _name_problems(role: str, tables: Mapping[str, object], geometry: ChannelGeometry) -> Iterator[Problem]:
    """Yield the tables without a boundary, and boundaries without a table."""
    own = isinstance(geometry, MeshGeometry)
    known = list(getattr(geometry, f"{role}s")) if own else [role]
    able = [*known, *(getattr(geometry.boundaries, role) or ())] if isinstance(geometry, MeshGeometry) else known
    for name in tables:
        if name in able and name not in known:
            text = f"is no name; give it one: {role}s = {{some_name = {name}}} in geometry, not boundaries.{role}"
            yield Problem(f"{role}.{name}", text)
        elif name not in known:
            text = f"no {role} of this name; accepted: {names(able)}"
            yield Problem(f"{role}.{name}", text, None, nearest(name, able))
    for name in known if own else ():
        if name not in tables:
            yield Problem(f"{role}.{name}", f"missing; geometry.{role}s names one of several {role}s")


def with_mean_velocities(inlets: Mapping[str, Inlet], geometry: ChannelGeometry) -> dict[str, Inlet]:
    """Return the inlets with mean_velocity in the place of peak_velocity or flow_rate."""
    return {
        name: inlet
        if inlet.mean_velocity is not None or inlet.pressure is not None
        else with_mean_velocity(inlet, geometry.named_inlets[name].height)
        for name, inlet in inlets.items()
    }
