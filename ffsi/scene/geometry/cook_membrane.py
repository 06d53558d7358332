"""Cook's membrane: a tapered panel, clamped on the left and sheared on the right."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.boundaries import CLAMPED, LOADED, OUTER, Boundary
from ffsi.scene.geometry.base import ElementSizes, GeometryBase, Physics
from ffsi.scene.units import Coordinate, Length


class CookMembrane(GeometryBase):
    """Quadrilateral (0, 0), (width, rise), (width, rise + right_height), (0, left_height); solid ``membrane``.

    The left side is clamped, the right side loaded, the others are free.
    """

    sized_by: ClassVar[str] = "left_height"
    default_sizes: ClassVar[ElementSizes] = ElementSizes(growth=0.4, far_size=2.1, body_size=2.1, corner_size=0.1)

    kind: Literal["cook"] = Field("cook", description="name of the geometry")
    width: Length = Field(48.0, description="distance of the right side from the left side, m")
    left_height: Length = Field(44.0, description="length of the left side, m")
    rise: Coordinate = Field(44.0, description="y of the right side's lower end, m")
    right_height: Length = Field(16.0, description="length of the right side, m")

    @property
    def solid_names(self) -> tuple[str, ...]:
        """The membrane."""
        return ("membrane",)

    @property
    def tip_point(self) -> tuple[float, float]:
        """Upper end of the right side, m."""
        return (self.width, self.rise + self.right_height)

    def exact_areas(self, physics: Physics) -> dict[str, float]:
        """Return the area in m^2 of "membrane"."""
        return {"membrane": self.width * (self.left_height + self.right_height) / 2}

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return the clamped, the loaded and the two free sides."""
        lower = math.hypot(self.width, self.rise)
        upper = math.hypot(self.width, self.rise + self.right_height - self.left_height)
        return [
            Boundary("clamped_side", CLAMPED, "clamped", self.left_height),
            Boundary("free_sides", OUTER, "free", lower + upper),
            Boundary("loaded_side", LOADED, "loaded", self.right_height),
        ]
