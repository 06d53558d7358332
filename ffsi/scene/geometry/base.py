"""What every geometry offers."""

import functools
from abc import ABC, abstractmethod
from collections.abc import Collection, Set
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import INLET, OUTLET, Boundary, Role
from ffsi.scene.boundaries import Inlet as Inlet
from ffsi.scene.errors import Problem, number_text, short
from ffsi.scene.units import Length

Physics = Literal["fluid", "solid", "fsi"]
Corners = list[tuple[float, float]]
"""Of a polygon, counter-clockwise."""


class GeometryBase(Table, ABC):
    """A reference domain; lengths in m.

    Raises:
        SceneError: the parts do not fit together.
    """

    default_sizes: ClassVar[dict[str, float] | None]
    """Element sizes by key (m; growth dimensionless) for the default lengths; None where a file holds the mesh."""
    sized_by: ClassVar[str]
    """Key of the length with which they grow; the script measures all lengths by it. A mesh of a file has none."""
    solids: ClassVar[tuple[str, ...]] = ()
    """Names of the solids in the order of their regions; where a table has the name, only with that table."""

    kind: str

    @property
    def solid_names(self) -> tuple[str, ...]:
        """Names of the solids that the geometry can hold, in the order of their regions."""
        return tuple(name for name in self.solids if getattr(self, name, True) is not None)

    @property
    def tip_point(self) -> tuple[float, float] | None:
        """Reference point (x, y) in m where tip_ux and tip_uy are taken; None if nothing can move."""
        return None

    @property
    def size(self) -> float:
        """The length `sized_by` in units of its default, dimensionless."""
        return float(getattr(self, self.sized_by) / type(self).model_fields[self.sized_by].default)

    @property
    def sizes(self) -> dict[str, float] | None:
        """Element sizes where a scene gives none, m (growth dimensionless); None where a file holds the mesh."""
        sizes = self.default_sizes
        return sizes and {key: size if key == "growth" else self.size * size for key, size in sizes.items()}

    @property
    def probe_points(self) -> dict[str, tuple[float, float]]:
        """Further reference points (x, y) in m by name, where NAME_ux and NAME_uy are taken."""
        return {}

    @property
    def bodies(self) -> list[Corners]:
        """Convex polygons that the solids consist of, m; none where a solid has another shape."""
        return []

    @property
    @abstractmethod
    def areas(self) -> dict[str, float]:
        """Area in m^2 of every region, in the regions' order: "fluid", then the solids by name.

        Arcs count as arcs, so a mesh of straight triangles differs by O(h^2).
        """

    @abstractmethod
    def outline(self, physics: Physics) -> list[Boundary]:
        """Return the boundaries that the physics has."""

    def problems(self) -> list[Problem]:
        """Return what does not fit together."""
        return []

    def scene_problems(self, solids: Collection[str], has_fluid: bool) -> list[Problem]:
        """Return what a scene with these solids, with or without a fluid, lacks; keys are those of the scene."""
        return []

    def steady_problems(self, springs: Set[str]) -> list[Problem]:
        """Return what a scene that is steady lacks; keys are those of the scene. `springs`: loads with a
        stiffness, and "" for a support with one."""
        return []

    @model_validator(mode="after")
    def _fits(self) -> Self:
        refuse(self.problems())
        return self

    def _bound(self, key: str, than: Literal["less", "greater"], limit: float, words: str) -> list[Problem]:
        """Return a problem of the length at a dotted key unless it is less, or greater, than a limit in m."""
        value: Any = functools.reduce(getattr, key.split("."), self)
        if value < limit if than == "less" else value > limit:
            return []
        return [Problem(key, f"must be {than} than {words} = {number_text(limit)} m", f"{short(value)} m")]


class ChannelGeometry(GeometryBase):
    """A reference domain with a channel, which can hold a fluid."""

    @property
    @abstractmethod
    def inlet(self) -> Inlet:
        """Where the fluid enters; the mesh template gives the script the same as inletX, ..., inletHeight."""

    @property
    def named_inlets(self) -> dict[str, Inlet]:
        """The inlets by the name of their boundary."""
        return {"inlet": self.inlet}

    @property
    @abstractmethod
    def outlet_points(self) -> list[tuple[float, float]]:
        """Points (x, y) of the outlet in m, the ends of a straight one."""

    @property
    def bluff(self) -> bool:
        """Whether a body stands in the flow, from which vortices may come."""
        return False

    @property
    def reference_length(self) -> float:
        """Length in m that the force coefficients take by default: that of the inlet."""
        return self.inlet.height


class StraightChannel(ChannelGeometry):
    """A channel [0, length] x [0, height] with the inlet on its left and the outlet on its right."""

    length: Length = Field(description="length of the channel, m")
    height: Length = Field(description="height of the channel, m")

    @property
    def inlet(self) -> Inlet:
        """The left end."""
        return Inlet(start=(0.0, 0.0), inward=(1.0, 0.0), height=self.height)

    @property
    def outlet_points(self) -> list[tuple[float, float]]:
        """The ends of the right end, m."""
        return [(self.length, 0.0), (self.length, self.height)]

    @property
    def ends(self) -> list[Boundary]:
        """Inlet and outlet."""
        return [Boundary("inlet", INLET, "inlet", self.height), Boundary("outlet", OUTLET, "outlet", self.height)]


def rectangle(left: float, right: float, low: float, high: float) -> Corners:
    """Return the corners of a rectangle."""
    return [(left, low), (right, low), (right, high), (left, high)]


def surface_role(physics: Physics) -> Role:
    """Return the role of a body's surface: interface, rigid wall or free side."""
    roles: dict[Physics, Role] = {"fsi": "interface", "fluid": "no-slip", "solid": "free"}
    return roles[physics]
