"""Walls of the fluid that move: along themselves (a lid, a belt, a cylinder that turns) or with the mesh (a piston)."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from ffsi.files.arrays import Floats
from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import Boundary
from ffsi.scene.errors import Problem, SceneError, join, names, nearest, short
from ffsi.scene.expressions import Expression, ExpressionError
from ffsi.scene.geometry import GeometryBase, MeshGeometry
from ffsi.scene.samples import FEWEST, MOST
from ffsi.scene.units import Coordinate, Number, Quantity
from ffsi.scene.waveforms import read_samples

TIME = ("t",)
PLACE = ("x", "y", "t")
_REST = 1e-12
_OFF = 1e-9
"""Part of the largest displacement by which rounding may take a spline off its samples."""
_THROUGH = 1e-6
"""Part of the speed of a wall that may go through it."""


def _motion(text: str | None) -> str | None:
    """Return the text of a displacement; refuse one that is no formula in x, y and t with a derivative by t."""
    try:
        if text is not None:
            Expression.parse(text, PLACE).derivative("t")
    except ExpressionError as error:
        refuse([Problem("", f"{error}; accepted: a smooth formula in x, y and t", short(text))])
    return text


def readable(text: str | None, *, variables: tuple[str, ...] = TIME, said: str = "t") -> str | None:
    """Return the text of a formula, for a validator; refuse one that is none in these variables, as they are said."""
    try:
        if text is not None:
            Expression.parse(text, variables)
    except ExpressionError as error:
        refuse([Problem("", f"{error}; accepted: a formula in {said}", short(text))])
    return text


class Motion(Table):
    """A displacement at times; a cubic spline between them, at rest at first."""

    at: tuple[Number, ...] = Field(description="numbers of s, from 0, increasing, dimensionless")
    x: tuple[Number, ...] = Field(description="numbers of m, the x components, 0 at first, dimensionless")
    y: tuple[Number, ...] = Field(description="numbers of m, the y components, 0 at first, dimensionless")
    angle: tuple[Number, ...] | None = Field(
        None, description="numbers of rad, the rotation about the centre, counter-clockwise, 0 at first, dimensionless"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not FEWEST <= len(self.at) <= MOST:
            refuse([Problem("at", f"accepted: {FEWEST} to {MOST} numbers", short(len(self.at)))])
        if (np.diff(self.at) <= 0).any() or self.at[0] != 0:
            refuse([Problem("at", "accepted: increasing numbers from 0 on", short(self.at[0]))])
        for key, values in self.columns.items():
            if len(values) != len(self.at) or values[0] != 0:
                text = f"accepted: as many numbers as at, {len(self.at)}, the first 0"
                refuse([Problem(key, text, short(values[0]) if values else None)])
        return self

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """The samples by their names."""
        return {"x": self.x, "y": self.y, **({} if self.angle is None else {"angle": self.angle})}


class Wall(Table):
    """How a wall moves: V + Omega e_z x (X - c), in time times the inflow's ramp and the waveform.

    It has to move along itself: no fluid goes through it. Or it has a displacement, which the mesh follows: its
    velocity is the rate of that.
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

    displacement_x: str | None = Field(
        None, description="formula in x, y (m) and t (s): x component of the displacement in m, 0 at t = 0"
    )
    displacement_y: str | None = Field(
        None, description="formula in x, y (m) and t (s): y component of the displacement in m, 0 at t = 0"
    )

    displacement_file: str | None = Field(
        None,
        description="or a CSV file of the displacement of a rigid body, columns t (s), x, y (m) and, if it turns about "
        "the centre, angle (rad), from 0 at t = 0 to time.end, a cubic spline between; beside the scene's file",
    )
    displacement_samples: Motion | None = Field(None, description="the displacement of such a file")

    _readable = field_validator("waveform")(readable)
    _smooth = field_validator("displacement_x", "displacement_y")(_motion)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        formulas = self.displacement_x is not None or self.displacement_y is not None
        given = ["displacement_x, displacement_y"] if formulas else []
        given += [key for key in ("displacement_file", "displacement_samples") if getattr(self, key) is not None]
        if len(given) > 1:
            refuse([Problem(given[1], f"{' and '.join(given)} are given; accepted: one of them")])
        if self.displacement_file is not None:
            try:
                columns = read_samples(Path(self.displacement_file), ["t", "x", "y"], FEWEST, "angle")
            except ValueError as error:
                refuse([Problem("displacement_file", str(error), short(self.displacement_file))])
            try:
                names_of = ("at", "x", "y", "angle")[: len(columns)]
                samples = Motion.model_validate(dict(zip(names_of, (c.tolist() for c in columns), strict=True)))
            except SceneError as error:
                refuse([replace(problem, key=f"displacement_samples.{problem.key}") for problem in error.problems])
            self.fill(displacement_file=None, displacement_samples=samples)
        return self

    @property
    def displaced(self) -> bool:
        """Whether the mesh moves with it."""
        given = (self.displacement_x, self.displacement_y, self.displacement_samples)
        return any(each is not None for each in given)

    @property
    def displacement(self) -> tuple[Expression, Expression]:
        """The displacement (x, y) as formulas in x, y (m) and t (s), m; zero along an axis that has none."""
        if (samples := self.displacement_samples) is not None:
            x, y = (Expression.spline(samples.at, values, ("t", "x", "y")) for values in (samples.x, samples.y))
            if samples.angle is None:
                return x, y
            angle = Expression.spline(samples.at, samples.angle, TIME).text
            along, up = f"(x - ({self.centre_x!r}))", f"(y - ({self.centre_y!r}))"
            less, sine = f"(cos({angle}) - 1)", f"sin({angle})"
            return x.plus(f"{less}*{along} - {sine}*{up}"), y.plus(f"{sine}*{along} + {less}*{up}")
        x, y = (Expression.parse(text or "0", PLACE) for text in (self.displacement_x, self.displacement_y))
        return x, y

    @property
    def expression(self) -> Expression | None:
        """The waveform as a formula in t (s), dimensionless; None: that of the inflow."""
        return None if self.waveform is None else Expression.parse(self.waveform, TIME)

    def movement(self, points: Floats, end: float) -> tuple[Floats, Floats]:
        """Return displacement and rate (2, 101, n), m and m/s, at points (n, 2) m and 101 times from 0 to ``end`` s."""
        place = {"x": points[:, 0], "y": points[:, 1], "t": np.linspace(0.0, end, 101)[:, None]}
        values, rates = ([f.evaluate(**place) for f in each] for each in (
            self.displacement, [axis.derivative("t") for axis in self.displacement]
        ))  # fmt: skip
        return np.array(values), np.array(rates)

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
    walls: Mapping[str, Wall], geometry: GeometryBase, outline: list[Boundary], end: float | None
) -> Iterator[Problem]:
    """Yield what is wrong with the walls of a scene, steady or to an ``end`` in s; keys are those of the scene."""
    own = isinstance(geometry, MeshGeometry)
    known = list(geometry.moving) if isinstance(geometry, MeshGeometry) else sorted(_able(outline, geometry))
    for name in walls:
        if name not in known:
            able = [*known, *(geometry.boundaries.walls or ())] if isinstance(geometry, MeshGeometry) else known
            text = f"no wall that can move; accepted: {names(able)}" if able else "not accepted: no wall here can move"
            yield Problem(f"walls.{name}", text, None, nearest(name, able))
        elif end is None:
            text = "only accepted in a scene with a table time (time.step and time.end)"
            for key in ("waveform", "displacement_x", "displacement_y", "displacement_samples"):
                if (value := getattr(walls[name], key)) is not None:
                    yield Problem(f"walls.{name}.{key}", text, short(value) if isinstance(value, str) else None)
    for name in known if own else ():
        if name not in walls:
            yield Problem(f"walls.{name}", "missing; geometry.moving names a wall that moves")
    for boundary in outline:
        wall = (boundary.moving or "") if own else boundary.name
        if wall in walls and wall in known:
            moves = walls[wall].displaced
            yield from (_displacement_problems(wall, walls[wall], boundary, geometry, end) if moves else [])
            yield from (() if moves else _through(wall, walls[wall], boundary, geometry))


def _displacement_problems(
    name: str, wall: Wall, boundary: Boundary, geometry: GeometryBase, end: float | None
) -> Iterator[Problem]:
    for key in ("velocity_x", "velocity_y", "rotation", "waveform"):
        if getattr(wall, key):
            text = "not accepted beside a displacement, whose rate is the velocity"
            yield Problem(f"walls.{name}.{key}", text, short(getattr(wall, key)))
    if (samples := wall.displacement_samples) is not None and end is not None and samples.at[-1] < end * (1 - 1e-9):
        text = f"ends at t = {short(samples.at[-1])} s; accepted: at time.end or later, {short(end)} s"
        yield Problem(f"walls.{name}.displacement_samples.at", text)
        return
    points = points_of(boundary, geometry)
    if points is None:
        yield Problem(f"walls.{name}", f'the wall "{name}" of this geometry can have no displacement')
        return
    values, rates = wall.movement(points, end or 0.0)
    for axis, (key, formula) in enumerate(zip(("displacement_x", "displacement_y"), wall.displacement, strict=True)):
        first = np.abs(values[axis, 0]).max()
        if not (np.isfinite(values[axis]).all() and np.isfinite(rates[axis]).all()):
            text = "it or its rate is not defined everywhere from t = 0 to time.end"
            yield Problem(f"walls.{name}.{key}", text, short(formula.text))
        elif samples is None and first > _REST * np.ptp(points, axis=0).max():
            yield Problem(f"walls.{name}.{key}", f"it is not 0 at t = 0 but {first:.3g} m", short(formula.text))
    if samples is None:
        return
    for key, given in samples.columns.items():
        off = np.abs(Expression.spline(samples.at, given, TIME).evaluate(t=np.array(samples.at)) - given)
        if off.max() > _OFF * np.abs(given).max():
            text = f"too rough for their distances: a spline misses them by {off.max():.1g}"
            yield Problem(f"walls.{name}.displacement_samples.{key}", f"{text}; accepted: a smooth motion")


def points_of(boundary: Boundary, geometry: GeometryBase) -> Floats | None:
    """Return points (n, 2) m of a wall that can have a displacement; None of one that cannot."""
    if isinstance(geometry, MeshGeometry):
        return geometry.ends_of(boundary.label).reshape(-1, 2)
    if boundary.circle is None:
        return None
    angle = np.linspace(0.0, math.tau, 33)
    return np.array(boundary.circle[:2]) + boundary.circle[2] * np.column_stack([np.cos(angle), np.sin(angle)])


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
