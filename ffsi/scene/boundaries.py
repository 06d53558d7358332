"""The boundaries of a scene's reference domain: label, role, body part, circle, exact length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Role = Literal["inlet", "outlet", "no-slip", "interface", "clamped", "free", "loaded", "supported", "slip"]

INLET, OUTLET, WALLS, CYLINDER, SURFACE, CLAMPED, OUTER, LEFT_LIP, RIGHT_LIP, ROOF, ROOF_ENDS, LOADED = range(1, 13)
INNER_WALL, OUTER_WALL, DOME_WALL, SUPPORTED, SLIP_X, SLIP_Y, SLIP = range(13, 20)
STRUTS = 20  # the first strut of a stent, the others follow
LOADS = 20  # the first load in a mesh of the user's own, the others follow
MOVING = 30  # the first moving wall in a mesh of the user's own, the others follow
PARTS = 40  # the first body part in a mesh of the user's own, the others follow
INLETS, OUTLETS, OPENINGS_END = 1000, 1100, 1200  # the first of several inlets, and outlets, there, the others follow


@dataclass(frozen=True)
class Boundary:
    """One labelled boundary of the reference domain.

    It has the length of the exact curve, m, and perhaps a body part, on which the fluid's force is reported. An arc has
    a circle: centre x, y and radius, m; `curved` are vertices on other curves; no-slip ones are bent onto them. The
    outer side of a wall is `supported` instead of `free` in a scene with a support; a no-slip one may be `moving`, a
    loaded one have a `load`, one of several inlets or outlets be an `opening`, as the tables of these names in the
    scene's `walls`, `loads`, `inlet` and `outlet` say; an inlet with a pressure has the role `outlet`. Labels:
    docs/formats.md, roles: docs/theory.md.
    """

    name: str
    label: int
    role: Role
    exact_length: float
    part: str | None = None
    circle: tuple[float, float, float] | None = None
    curved: bool = False
    outer: bool = False
    moving: str | None = None
    load: str | None = None
    opening: str | None = None


@dataclass(frozen=True)
class Inlet:
    """The straight boundary through which the fluid enters.

    It begins (s = 0) at start (x, y), m, and runs along the unit vector inward, turned by +90 degrees, for height H, m.
    """

    start: tuple[float, float]
    inward: tuple[float, float]
    height: float
