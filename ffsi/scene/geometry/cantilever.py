"""A straight cantilever with a load on its end face."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.boundaries import CLAMPED, LOADED, OUTER, Boundary
from ffsi.scene.geometry.base import ElementSizes, GeometryBase, Physics
from ffsi.scene.units import Length


class Cantilever(GeometryBase):
    """Rectangle [0, length] x [0, thickness]; solid ``beam``.

    The end x = 0 is clamped, the end x = length loaded, the long sides are free.
    """

    # For the default length and thickness: two elements across at level 0.
    sized_by: ClassVar[str] = "thickness"
    default_sizes: ClassVar[ElementSizes] = ElementSizes(growth=0.5, far_size=0.005, body_size=0.005, corner_size=0.002)

    kind: Literal["cantilever"] = Field("cantilever", description="name of the geometry")
    length: Length = Field(1.0, description="length, m")
    thickness: Length = Field(0.01, description="thickness, m")

    @property
    def solid_names(self) -> tuple[str, ...]:
        """The beam."""
        return ("beam",)

    @property
    def tip_point(self) -> tuple[float, float]:
        """Middle of the loaded end, m."""
        return (self.length, self.thickness / 2)

    def exact_areas(self, physics: Physics) -> dict[str, float]:
        """Return the area in m^2 of "beam"."""
        return {"beam": self.length * self.thickness}

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return the clamped end, the loaded end and the two free sides."""
        return [
            Boundary("clamped_side", CLAMPED, "clamped", self.thickness),
            Boundary("free_sides", OUTER, "free", 2 * self.length),
            Boundary("loaded_side", LOADED, "loaded", self.thickness),
        ]
