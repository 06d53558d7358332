"""Solids without a fluid: a straight cantilever, and Cook's membrane."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ffsi.scene.boundaries import CLAMPED, LOADED, OUTER, Boundary
from ffsi.scene.geometry.base import Corners, GeometryBase, Physics, rectangle
from ffsi.scene.units import Coordinate, Length


class Cantilever(GeometryBase):
    """A cantilever with a load on its end face: rectangle [0, length] x [0, thickness]; solid ``beam``.

    The end x = 0 is clamped, the end x = length loaded, the long sides are free.
    """

    # For the default length and thickness: two elements across at level 0.
    solids: ClassVar[tuple[str, ...]] = ("beam",)
    sized_by: ClassVar[str] = "thickness"
    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.5, far_size=0.005, body_size=0.005, corner_size=0.002)

    kind: Literal["cantilever"] = Field("cantilever", description="name of the geometry")
    length: Length = Field(1.0, description="length, m")
    thickness: Length = Field(0.01, description="thickness, m")

    @property
    def tip_point(self) -> tuple[float, float]:
        """Middle of the loaded end, m."""
        return (self.length, self.thickness / 2)

    @property
    def areas(self) -> dict[str, float]:
        """Area in m^2 of "beam"."""
        return {"beam": self.length * self.thickness}

    @property
    def bodies(self) -> list[Corners]:
        """The beam, m."""
        return [rectangle(0.0, self.length, 0.0, self.thickness)]

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return the clamped end, the loaded end and the two free sides."""
        return [
            Boundary("clamped_side", CLAMPED, "clamped", self.thickness),
            Boundary("free_sides", OUTER, "free", 2 * self.length),
            Boundary("loaded_side", LOADED, "loaded", self.thickness),
        ]


class CookMembrane(GeometryBase):
    """A tapered panel (0, 0), (width, rise), (width, rise + right_height), (0, left_height); solid ``membrane``.

    The left side is clamped, the right side loaded, the others are free.
    """

    solids: ClassVar[tuple[str, ...]] = ("membrane",)
    sized_by: ClassVar[str] = "left_height"
    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.4, far_size=2.1, body_size=2.1, corner_size=0.1)

    kind: Literal["cook"] = Field("cook", description="name of the geometry")
    width: Length = Field(48.0, description="distance of the right side from the left side, m")
    left_height: Length = Field(44.0, description="length of the left side, m")
    rise: Coordinate = Field(44.0, description="y of the right side's lower end, m")
    right_height: Length = Field(16.0, description="length of the right side, m")

    @property
    def tip_point(self) -> tuple[float, float]:
        """Upper end of the right side, m."""
        return (self.width, self.rise + self.right_height)

    @property
    def areas(self) -> dict[str, float]:
        """Area in m^2 of "membrane"."""
        return {"membrane": self.width * (self.left_height + self.right_height) / 2}

    @property
    def bodies(self) -> list[Corners]:
        """The panel, m."""
        right = [(self.width, self.rise), (self.width, self.rise + self.right_height)]
        return [[(0.0, 0.0), *right, (0.0, self.left_height)]]

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return the clamped, the loaded and the two free sides."""
        lower = np.sqrt(self.width**2 + self.rise**2)
        upper = np.sqrt(self.width**2 + (self.rise + self.right_height - self.left_height) ** 2)
        return [
            Boundary("clamped_side", CLAMPED, "clamped", self.left_height),
            Boundary("free_sides", OUTER, "free", lower + upper),
            Boundary("loaded_side", LOADED, "loaded", self.right_height),
        ]
