"""Loads on boundaries of solids."""

from collections.abc import Iterator, Mapping
from typing import Self

import numpy as np
from pydantic import Field, StrictBool, field_validator, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import Boundary
from ffsi.scene.errors import Problem, names, nearest, short
from ffsi.scene.expressions import Expression
from ffsi.scene.geometry import GeometryBase, MeshGeometry
from ffsi.scene.samples import Samples, samples_of
from ffsi.scene.time import Time
from ffsi.scene.units import FoundationDamping, FoundationStiffness, Stress
from ffsi.scene.walls import TIME, readable

WAVES = ("waveform", "waveform_file", "waveform_samples")


class Load(Table):
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
    def springs(self) -> bool:
        """Whether a spring or a damper holds the boundary."""
        return self.stiffness is not None or self.damping is not None

    @property
    def expression(self) -> Expression:
        """The waveform as a formula in t (s), dimensionless."""
        if self.waveform_samples is not None:
            return self.waveform_samples.expression(*TIME)
        return Expression.parse("1" if self.waveform is None else self.waveform, TIME)


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
        elif time is None and (given := [key for key in (*WAVES, "damping") if getattr(load, key) is not None]):
            text = "only accepted in a scene with a table time (time.step and time.end)"
            yield Problem(f"loads.{name}.{given[0]}", text)
        elif time is not None:
            t = np.linspace(0.0, time.end, 2001)
            if (bad := t[~np.isfinite(load.expression.evaluate(t=t))]).size:
                text = f"not finite at t = {bad[0]:.4g} s; accepted: a formula that is defined for t from 0 to time.end"
                yield Problem(f"loads.{name}.waveform", text, short(load.waveform))
    for name in known if own else ():
        if name not in loads:
            yield Problem(f"loads.{name}", "missing; geometry.loads names a boundary with a load")
