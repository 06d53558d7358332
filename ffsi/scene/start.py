"""How a computation in time starts, unless from rest: formulas for u and v, or the result of another one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import Field, field_validator

from ffsi.files.arrays import Floats
from ffsi.files.initial import Initial
from ffsi.scene.base import Table
from ffsi.scene.errors import Problem, short
from ffsi.scene.expressions import Expression
from ffsi.scene.walls import readable

PLACE = ("x", "y")
_SAME = 0.02
"""Part of an area by which polygons around one arc may differ."""


class Start(Table):
    """Velocity and displacement at t = 0, formulas in the reference coordinates x and y, m; 0 if absent."""

    velocity_x: str | None = Field(None, description="x component of the velocity v, a formula in x and y (m), in m/s")
    velocity_y: str | None = Field(None, description="y component of the velocity v, likewise, in m/s")
    displacement_x: str | None = Field(
        None, description="x component of the solids' displacement u, likewise, in m; the fluid's mesh follows"
    )
    displacement_y: str | None = Field(None, description="y component of the solids' displacement u, likewise, in m")

    @field_validator("*")
    @classmethod
    def _readable(cls, text: str | None) -> str | None:
        return readable(text, variables=PLACE, said="x and y")

    def expression(self, key: str) -> Expression:
        """Return a component as a formula in x and y, in SI."""
        return Expression.parse(getattr(self, key) or "0", PLACE)


def start_problems(
    start: Start | None, initial: Initial | None, areas: dict[str, float], mixed: int, has_solid: bool, stores: bool
) -> Iterator[Problem]:
    """Yield what is wrong with the start of a scene in time with regions of these areas, m^2, in their order.

    ``mixed``: number of solids with a pressure of their own; ``stores``: whether fluid is stored behind an outlet.
    """
    if start is not None and initial is not None:
        yield Problem("start", "not accepted beside time.initial: either formulas or a result")
    if start is not None and not has_solid:
        for key in ("displacement_x", "displacement_y"):
            if (text := getattr(start, key)) is not None:
                yield Problem(f"start.{key}", "only accepted in a scene with a solid", short(text))
    if stores and (start is not None or initial is not None):
        key = "start" if initial is None else "time.initial"
        yield Problem(key, "not accepted with a Windkessel, whose pressure at the start nobody knows")
    if initial is None:
        return
    found = _areas(initial)
    if len(found) != len(areas) or not np.allclose(found, [*areas.values()], rtol=_SAME, atol=0):
        ours, its = (", ".join(f"{area:.6g}" for area in each) for each in (areas.values(), found))
        yield Problem("time.initial", f"another domain: the areas of its regions are {its} m^2, those here {ours} m^2")
    elif len(initial.state.ps) != mixed:
        text = f"it has {len(initial.state.ps)} solids with a pressure of their own, this scene has {mixed}"
        yield Problem("time.initial", f"{text}; accepted: the same formulations")


def _areas(initial: Initial) -> Floats:
    mesh = initial.mesh
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    size = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    return np.array([size[mesh.region == number].sum() for number in np.unique(mesh.region)])
