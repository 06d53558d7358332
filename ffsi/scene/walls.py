"""Walls of the fluid that move along themselves: a lid, a belt, a cylinder that turns."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator

from ffsi.files.arrays import Floats
from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import Boundary
from ffsi.scene.errors import Problem, join, names, nearest, short
from ffsi.scene.expressions import Expression, ExpressionError
from ffsi.scene.geometry import GeometryBase, MeshGeometry
from ffsi.scene.units import Coordinate, Quantity

TIME = ("t",)
_THROUGH = 1e-6
"""Part of the speed of a wall that may go through it."""


def readable(text: str | None) -> str | None:
    """Return the text of a waveform, for a validator; refuse one that is no formula in t."""
    try:
        if text is not None:
            Expression.parse(text, TIME)
    except ExpressionError as error:
        refuse([Problem("", f"{error}; accepted: a formula in t", short(text))])
    return text


class Wall(Table):
    """How a wall moves: V + Omega e_z x (X - c), in time times the inflow's ramp and the waveform.

    It has to move along itself: no fluid goes through it.
    """

    velocity_x: Annotated[float, Quantity("m/s")] = Field(0.0, description="x component of the velocity V, m/s")
    velocity_y: Annotated[float, Quantity("m/s")] = Field(0.0, description="y component of the velocity V, m/s")
    rotation: Annotated[float, Quantity("1/s")] = Field(
        0.0, description="angular velocity Omega, counter-clockwise, in radians per second, 1/s"
    )
    centre_x: Coordinate = Field(0.0, description="x of the centre c of the rotation, m")
    centre_y: Coordinate = Field(0.0, description="y of the centre c of the rotation, m")
    waveform: str | None = Field(
        None,
        description='dimensionless formula in t (s), a factor on the velocity, such as "1" for a constant one; that of '
        "the inflow if absent; needs a table time",
    )

    _readable = field_validator("waveform")(readable)

    @property
    def expression(self) -> Expression | None:
        """The waveform as a formula in t (s), dimensionless; None: that of the inflow."""
        return None if self.waveform is None else Expression.parse(self.waveform, TIME)

    def velocity(self, points: Floats) -> Floats:
        """Return the velocity (n, 2) in m/s at points (n, 2) in m, without the factors of time."""
        arm = points - np.array([self.centre_x, self.centre_y])
        turning = self.rotation * arm[:, ::-1] * np.array([-1.0, 1.0])
        return np.asarray(np.array([self.velocity_x, self.velocity_y]) + turning)


def named(table: Mapping[str, Any], of_scene: str, role: str, key: str) -> Mapping[str, Any]:
    """Return the table of a scene with names in `boundaries.ROLE` that have a table `OF_SCENE.NAME` in geometry.KEY."""
    geometry, walls = table.get("geometry"), table.get(of_scene)
    if not isinstance(geometry, Mapping) or not isinstance(walls, Mapping):
        return table
    boundaries, moving = geometry.get("boundaries"), geometry.get(key, {})
    if not isinstance(boundaries, Mapping) or not isinstance(moving, Mapping):
        return table
    given = boundaries.get(role)
    resting = list(given) if isinstance(given, list | tuple) else [given]
    found = [
        name for name in walls if name in resting and name not in moving and isinstance(walls[name], Mapping | Table)
    ]
    if not found:
        return table
    left = [name for name in resting if name not in found]
    others = {name: value for name, value in boundaries.items() if name != role}
    boundaries = {**others, **({role: left} if left else {})}
    chosen = {**moving, **dict(zip(found, found, strict=True))}
    return {**table, "geometry": {**geometry, "boundaries": boundaries, key: chosen}}


def wall_problems(
    walls: Mapping[str, Wall], geometry: GeometryBase, outline: list[Boundary], steady: bool
) -> Iterator[Problem]:
    """Yield what is wrong with the walls of a scene; keys are those of the scene."""
    own = isinstance(geometry, MeshGeometry)
    known = list(geometry.moving) if isinstance(geometry, MeshGeometry) else sorted(_able(outline, geometry))
    for name in walls:
        if name not in known:
            able = [*known, *(geometry.boundaries.walls or ())] if isinstance(geometry, MeshGeometry) else known
            text = f"no wall that can move; accepted: {names(able)}" if able else "not accepted: no wall here can move"
            yield Problem(f"walls.{name}", text, None, nearest(name, able))
        elif walls[name].waveform is not None and steady:
            text = "only accepted in a scene with a table time (time.step and time.end)"
            yield Problem(f"walls.{name}.waveform", text, short(walls[name].waveform))
    for name in known if own else ():
        if name not in walls:
            yield Problem(f"walls.{name}", "missing; geometry.moving names a wall that moves")
    for boundary in outline:
        wall = (boundary.moving or "") if own else boundary.name
        if wall in walls and wall in known:
            yield from _through(wall, walls[wall], boundary, geometry)


def _able(outline: list[Boundary], geometry: GeometryBase) -> list[str]:
    """Return the walls of a built-in geometry that can move along themselves: whole circles, and those along x."""
    straight = geometry.kind in ("channel", "channel-cylinder", "flap-channel")
    return [
        b.name
        for b in outline
        if b.role == "no-slip"
        and (math.isclose(b.exact_length, math.tau * b.circle[2]) if b.circle else straight and b.name == "walls")
    ]


def _through(name: str, wall: Wall, boundary: Boundary, geometry: GeometryBase) -> Iterator[Problem]:
    text = "it would move through itself, and fluid through it; accepted: a velocity along the wall"
    if isinstance(geometry, MeshGeometry):
        start, end = geometry.ends_of(boundary.label).transpose(1, 0, 2)
        mean = (wall.velocity(start) + 4 * wall.velocity((start + end) / 2) + wall.velocity(end)) / 6
        across = np.abs((mean * (end - start)[:, ::-1] * [1.0, -1.0]).sum(axis=1)) / np.hypot(*(end - start).T)
        if (across > _THROUGH * np.hypot(*mean.T).max()).any():
            x, y = (start[across.argmax()] + end[across.argmax()]) / 2
            yield Problem(f"walls.{name}", f"at ({x:.6g}, {y:.6g}) m {text}")
    elif boundary.circle is not None:
        for key, value, want in zip(
            ("centre_x", "centre_y"), (wall.centre_x, wall.centre_y), boundary.circle[:2], strict=True
        ):
            if abs(value - want) > _THROUGH * boundary.circle[2]:
                yield Problem(join("walls", f"{name}.{key}"), f"{text}: {short(want)} m", f"{short(value)} m")
        for key in ("velocity_x", "velocity_y"):
            if getattr(wall, key):
                yield Problem(
                    f"walls.{name}.{key}", f"{text}, of a circle a rotation", f"{short(getattr(wall, key))} m/s"
                )
    else:
        for key in ("velocity_y", "rotation"):
            if getattr(wall, key):
                yield Problem(f"walls.{name}.{key}", f"{text}, here velocity_x", short(getattr(wall, key)))
