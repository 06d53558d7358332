"""The boundaries of a scene's reference domain: label, role, body part, circle, exact length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Role = Literal["inlet", "outlet", "no-slip", "interface", "clamped", "free", "loaded", "supported"]

INLET, OUTLET, WALLS, CYLINDER, SURFACE, CLAMPED, OUTER, LEFT_LIP, RIGHT_LIP, ROOF, ROOF_ENDS, LOADED = range(1, 13)
INNER_WALL, OUTER_WALL, DOME_WALL, SUPPORTED = range(13, 17)
STRUTS = 20  # the first strut of a stent, the others follow
PARTS = 40  # the first body part in a mesh of the user's own, the others follow


@dataclass(frozen=True)
class Boundary:
    """One labelled boundary of the reference domain.

    Args:
        name: what it is, such as "inlet" or "surface".
        label: edge label in the mesh (table in docs/formats.md).
        role: condition on it (docs/theory.md).
        part: body part on which the fluid's force is reported, None if there is none.
        circle: centre x, centre y and radius in m of a boundary that is an arc, None if it is straight.
        exact_length: length of the exact curve, m.
        curved: whether vertices lie on a curve that is no single circle; `circle` says where it is one.
        outer: whether it is the outer side of a wall, which is `supported` instead of `free` in a scene with a support.
    """

    name: str
    label: int
    role: Role
    exact_length: float
    part: str | None = None
    circle: tuple[float, float, float] | None = None
    curved: bool = False
    outer: bool = False
