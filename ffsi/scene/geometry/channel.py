"""A plain channel between two rigid walls (Poiseuille and Womersley flow)."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.boundaries import WALLS, Boundary
from ffsi.scene.geometry.base import Physics, StraightChannel


class Channel(StraightChannel):
    """Channel [0, length] x [0, height] without a body; its rigid walls are the part ``walls``.

    Rows and columns of triangles: the rows are `mesh.body_size` high at the walls and up to `mesh.far_size` in the
    middle, the columns as long as `mesh.far_size`.
    """

    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.01, far_size=0.4, body_size=0.035, corner_size=0.035)
    """For a height of 1 m. A developed flow changes across the channel only: long triangles, equal rows."""
    sized_by: ClassVar[str] = "height"

    kind: Literal["channel"] = Field("channel", description="name of the geometry")

    @property
    def size(self) -> float:
        """Height in units of 1 m, dimensionless."""
        return self.height

    @property
    def areas(self) -> dict[str, float]:
        """Area in m^2 of "fluid"."""
        return {"fluid": self.length * self.height}

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet and the two walls."""
        return [*self.ends, Boundary("walls", WALLS, "no-slip", 2 * self.length, "walls")]
