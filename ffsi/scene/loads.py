"""Loads on boundaries of solids."""

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Self

import numpy as np
from pydantic import Field, StrictBool, field_validator, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import Boundary
from ffsi.scene.errors import Problem, join, names, nearest, number_text, short
from ffsi.scene.expressions import Expression
from ffsi.scene.geometry import GeometryBase, MeshGeometry
from ffsi.scene.geometry.base import Corners
from ffsi.scene.geometry.mesh import NAME, NAMES
from ffsi.scene.samples import Samples, samples_of
from ffsi.scene.time import Time
from ffsi.scene.units import Coordinate, FoundationDamping, FoundationStiffness, LineForce, Stress
from ffsi.scene.walls import TIME, readable

WAVES = ("waveform", "waveform_file", "waveform_samples")


class Driven(Table):
    """What acts on a solid, in time times a waveform."""

    waveform: str | None = Field(
        None, description="dimensionless formula in t (s), a factor on the load, 1 if absent; needs a table time"
    )

    waveform_file: str | None = Field(
        None,
        description="or a CSV file with the factor, columns t (s) and value, straight lines between; beside the "
        "scene's file",
    )
    waveform_samples: Samples | None = Field(None, description="the factor of such a file, at t in s, dimensionless")

    _readable = field_validator("waveform")(readable)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        given = [key for key in WAVES if getattr(self, key) is not None]
        if len(given) > 1:
            refuse([Problem(given[0], f"{' and '.join(given)} are given; accepted: one of {', '.join(WAVES)}")])
        if self.waveform_file is not None:
            self.fill(**samples_of(self.waveform_file, "waveform", "t"))
        return self

    @property
    def expression(self) -> Expression:
        """The waveform as a formula in t (s), dimensionless."""
        if self.waveform_samples is not None:
            return self.waveform_samples.expression(*TIME)
        return Expression.parse("1" if self.waveform is None else self.waveform, TIME)


class Load(Driven):
    """Traction and pressure on a boundary of a solid, in time times the waveform; spring and damper that hold it."""

    traction_x: Stress = Field(0.0, description="x component of the dead traction, per reference length, Pa")
    traction_y: Stress = Field(0.0, description="y component of the dead traction, per reference length, Pa")
    pressure: Stress = Field(0.0, description="pressure on the boundary, against its outward normal, Pa")
    stiffness: FoundationStiffness | None = Field(
        None, description="of a spring against the displacement, per reference length, Pa/m"
    )
    damping: FoundationDamping | None = Field(
        None, description="of a damper against the velocity, per reference length, needs a table time, Pa s/m"
    )
    following: StrictBool = Field(
        True,
        description="whether the pressure follows the surface, its normal and its length (true or false)",
    )

    @property
    def springs(self) -> bool:
        """Whether a spring or a damper holds the boundary."""
        return self.stiffness is not None or self.damping is not None


class PointForce(Driven):
    """A dead force at a point of a solid, in time times the waveform; under it u has no limit on finer meshes."""

    x: Coordinate = Field(description="x of the point, on the reference domain, in or on a solid, m")
    y: Coordinate = Field(description="y of the point, m")
    force_x: LineForce = Field(0.0, description="x component of the force, per metre of depth, N/m")
    force_y: LineForce = Field(0.0, description="y component of the force, per metre of depth, N/m")


def load_problems(
    loads: Mapping[str, Load], geometry: GeometryBase, outline: list[Boundary], time: Time | None, supported: bool
) -> Iterator[Problem]:
    """Yield what is wrong with the loads of a scene; keys are those of the scene."""
    own = isinstance(geometry, MeshGeometry)
    able = [side.name for side in outline if side.role == "free" and not (supported and side.outer)]
    known = list(geometry.loads) if isinstance(geometry, MeshGeometry) else able
    hint = " (geometry.boundaries.loaded or geometry.loads)" if own else ""
    for name, load in loads.items():
        if name not in known:
            accepted = f"accepted: {names(known)}" if known else "the scene has none"
            text = f"no boundary of a solid that can be loaded{hint}; {accepted}"
            yield Problem(f"loads.{name}", text, None, nearest(name, known))
        else:
            yield from _driven_problems(load, f"loads.{name}", time)
    for name in known if own else ():
        if name not in loads:
            yield Problem(f"loads.{name}", "missing; geometry.loads names a boundary with a load")


def point_force_problems(
    forces: Mapping[str, PointForce], geometry: GeometryBase, solids: Collection[str], time: Time | None
) -> Iterator[Problem]:
    """Yield what is wrong with the point forces of a scene with these solids; keys are those of the scene."""
    for name, force in forces.items():
        own = isinstance(geometry, MeshGeometry)
        if not (geometry.solid_names if own else geometry.bodies and solids):
            yield Problem(f"point_forces.{name}", "only accepted in a solid, of this geometry in none")
            continue
        if not NAME.fullmatch(name):
            yield Problem(join("point_forces", name), NAMES)
        if isinstance(geometry, MeshGeometry):
            yield from geometry.outside_solids(f"point_forces.{name}", force.x, force.y)
        elif not any(_inside(corners, force.x, force.y) for corners in geometry.bodies):
            reach = [point for corners in geometry.bodies for point in corners]
            x, y = ([min(values), max(values)] for values in zip(*reach, strict=True))
            text = (
                f"must lie in a solid; the solids lie in x from {x[0]:g} to {x[1]:g} m, y from {y[0]:g} to {y[1]:g} m"
            )
            yield Problem(f"point_forces.{name}", text, f"({number_text(force.x)}, {number_text(force.y)}) m")
        yield from _driven_problems(force, f"point_forces.{name}", time)


def _inside(corners: Corners, x: float, y: float) -> bool:
    """Return whether a point lies in a polygon, rounding aside."""
    ends = zip(corners, [*corners[1:], corners[0]], strict=True)
    return all(
        (b - a) * (y - c) - (d - c) * (x - a) >= -1e-9 * math.hypot(b - a, d - c) ** 2 for (a, c), (b, d) in ends
    )


def _driven_problems(load: Driven, key: str, time: Time | None) -> Iterator[Problem]:
    given = [name for name in (*WAVES, "damping") if getattr(load, name, None) is not None]
    if time is None and given:
        yield Problem(f"{key}.{given[0]}", "only accepted in a scene with a table time (time.step and time.end)")
    elif time is not None:
        t = np.linspace(0.0, time.end, 2001)
        if (bad := t[~np.isfinite(load.expression.evaluate(t=t))]).size:
            text = f"not finite at t = {bad[0]:.4g} s; accepted: a formula that is defined for t from 0 to time.end"
            yield Problem(f"{key}.waveform", text, short(load.waveform))
