"""What every geometry offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import Boundary, Role
from ffsi.scene.errors import Problem, number_text, short

Physics = Literal["fluid", "solid", "fsi"]


@dataclass(frozen=True)
class ElementSizes:
    """Element sizes at mesh level 0.

    Args:
        growth: largest increase of the element size per unit length, dimensionless.
        far_size: size away from the bodies, m.
        body_size: size along the bodies, m.
        corner_size: size at the corners of the bodies, m.
    """

    growth: float
    far_size: float
    body_size: float
    corner_size: float

    def times(self, factor: float) -> ElementSizes:
        """Return the sizes of the same mesh in a domain that is larger by a factor."""
        sizes = (self.far_size, self.body_size, self.corner_size)
        return ElementSizes(self.growth, *(factor * size for size in sizes))


@dataclass(frozen=True)
class Inlet:
    """The straight boundary through which the fluid enters.

    Args:
        start: the end (x, y) of it from which it runs along `inward` turned by +90 degrees, m; s = 0 there.
        inward: unit vector (x, y) into the fluid.
        height: its length H, m.
    """

    start: tuple[float, float]
    inward: tuple[float, float]
    height: float


class GeometryBase(Table, ABC):
    """A reference domain; lengths in m.

    Raises:
        SceneError: the parts do not fit together.
    """

    default_sizes: ClassVar[ElementSizes | None]
    """Element sizes that are not given, for the default lengths; None where a file holds the mesh."""
    sized_by: ClassVar[str]
    """Key of the length with which they grow; the script measures all lengths by it. A mesh of a file has none."""
    free_names: ClassVar[bool] = False
    """Whether the solids have names that a user chose."""
    adapted: ClassVar[bool] = True
    """Whether the mesh is adapted to the element sizes after the template has made a first one."""
    optional_solids: ClassVar[tuple[str, ...]] = ()
    """Names of solids that are there only if the geometry's table of the same name is given."""

    @property
    @abstractmethod
    def solid_names(self) -> tuple[str, ...]:
        """Names of the solids that the geometry can hold, in the order of their regions."""

    @property
    @abstractmethod
    def tip_point(self) -> tuple[float, float] | None:
        """Reference point (x, y) in m where tip_ux and tip_uy are taken; None if nothing can move."""

    @property
    def sizes(self) -> ElementSizes | None:
        """Element sizes where a scene gives none; None where a file holds the mesh."""
        return self.default_sizes and self.default_sizes.times(self.size)

    @property
    def size(self) -> float:
        """The length `sized_by` in units of its default, dimensionless."""
        return float(getattr(self, self.sized_by) / type(self).model_fields[self.sized_by].default)

    @property
    def probe_points(self) -> dict[str, tuple[float, float]]:
        """Further reference points (x, y) in m by name, where NAME_ux and NAME_uy are taken."""
        return {}

    @abstractmethod
    def exact_areas(self, physics: Physics) -> dict[str, float]:
        """Return the area in m^2 of every region, in the regions' order: "fluid", then the solids by name.

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

    def steady_problems(self) -> list[Problem]:
        """Return what a scene that is steady lacks; keys are those of the scene."""
        return []

    @model_validator(mode="after")
    def _fits(self) -> Self:
        refuse(self.problems())
        return self

    def _keep(self, areas: dict[str, float], physics: Physics) -> dict[str, float]:
        unwanted = {"fluid": self.solid_names, "solid": ("fluid",), "fsi": ()}[physics]
        return {name: area for name, area in areas.items() if name not in unwanted}

    def _not_below(self, key: str, value: float, limit: float, limit_text: str) -> list[Problem]:
        """Return a problem of ``key`` unless value < limit."""
        if value < limit:
            return []
        return [Problem(key, f"must be less than {limit_text} = {number_text(limit)} m", f"{short(value)} m")]

    def _not_above(self, key: str, value: float, limit: float, limit_text: str) -> list[Problem]:
        """Return a problem of ``key`` unless value > limit."""
        if value > limit:
            return []
        return [Problem(key, f"must be greater than {limit_text} = {number_text(limit)} m", f"{short(value)} m")]


class ChannelGeometry(GeometryBase):
    """A reference domain with a channel, which can hold a fluid."""

    @property
    @abstractmethod
    def inlet(self) -> Inlet:
        """Where the fluid enters; the mesh template gives the script the same as inletX, ..., inletHeight."""

    @property
    @abstractmethod
    def outlet_points(self) -> list[tuple[float, float]]:
        """Points (x, y) of the outlet in m, the ends of a straight one."""

    @property
    def bluff(self) -> bool:
        """Whether a body stands in the flow, from which vortices may come."""
        return False

    @property
    @abstractmethod
    def reference_length(self) -> float:
        """Length in m that the force coefficients take by default."""


def surface_role(physics: Physics) -> Role:
    """Return the role of a body's surface: interface, rigid wall or free side."""
    roles: dict[Physics, Role] = {"fsi": "interface", "fluid": "no-slip", "solid": "free"}
    return roles[physics]
