"""A plain channel between two rigid walls (Poiseuille and Womersley flow)."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.boundaries import INLET, OUTLET, WALLS, Boundary
from ffsi.scene.geometry.base import ChannelGeometry, ElementSizes, Inlet, Physics
from ffsi.scene.units import Length


class Channel(ChannelGeometry):
    """Channel [0, length] x [0, height] without a body; its rigid walls are the part ``walls``.

    Rows and columns of triangles: the rows are `mesh.body_size` high at the walls and up to `mesh.far_size` in the
    middle, the columns as long as `mesh.far_size`.
    """

    default_sizes: ClassVar[ElementSizes] = ElementSizes(growth=0.01, far_size=0.4, body_size=0.035, corner_size=0.035)
    """For a height of 1 m. A developed flow changes across the channel only: long triangles, equal rows."""
    adapted: ClassVar[bool] = False
    sized_by: ClassVar[str] = "height"

    kind: Literal["channel"] = Field("channel", description="name of the geometry")
    length: Length = Field(description="length of the channel, m")
    height: Length = Field(description="height of the channel, m")

    @property
    def size(self) -> float:
        """Height in units of 1 m, dimensionless."""
        return self.height

    @property
    def inlet(self) -> Inlet:
        """The channel's left end."""
        return Inlet(start=(0.0, 0.0), inward=(1.0, 0.0), height=self.height)

    @property
    def outlet_points(self) -> list[tuple[float, float]]:
        """The ends of the channel's right end."""
        return [(self.length, 0.0), (self.length, self.height)]

    @property
    def solid_names(self) -> tuple[str, ...]:
        """No solid."""
        return ()

    @property
    def tip_point(self) -> None:
        """Nothing can move."""
        return None

    @property
    def reference_length(self) -> float:
        """Height of the channel, m."""
        return self.height

    def exact_areas(self, physics: Physics) -> dict[str, float]:
        """Return the area in m^2 of "fluid"."""
        return self._keep({"fluid": self.length * self.height}, physics)

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet and the two walls."""
        return [
            Boundary("inlet", INLET, "inlet", self.height),
            Boundary("outlet", OUTLET, "outlet", self.height),
            Boundary("walls", WALLS, "no-slip", 2 * self.length, "walls"),
        ]
