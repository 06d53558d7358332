"""A channel with an elastic flap standing on its floor."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.boundaries import CLAMPED, INLET, OUTLET, SURFACE, WALLS, Boundary
from ffsi.scene.errors import Problem
from ffsi.scene.geometry.base import ElementSizes, GeometryBase, Physics, surface_role
from ffsi.scene.units import Length


class FlapChannel(GeometryBase):
    """Channel [0, length] x [0, height] with the flap [left, left + width] x [0, flap_height]; solid ``flap``."""

    default_sizes: ClassVar[ElementSizes] = ElementSizes(growth=0.6, far_size=0.1, body_size=0.015, corner_size=0.008)

    kind: Literal["flap-channel"] = Field("flap-channel", description="name of the geometry")
    length: Length = Field(2.5, description="length of the channel, m")
    height: Length = Field(0.4, description="height of the channel, m")
    flap_left: Length = Field(0.5, description="x of the flap's left side, m")
    flap_width: Length = Field(0.04, description="width of the flap along the channel, m")
    flap_height: Length = Field(0.2, description="height of the flap, m")

    def problems(self) -> list[Problem]:
        """Return what does not fit: the flap must stand inside the channel."""
        room = self.length - self.flap_left
        return [
            *self._not_below("flap_height", self.flap_height, self.height, "height"),
            *(
                self._not_below("flap_left", self.flap_left, self.length, "length")
                or self._not_below("flap_width", self.flap_width, room, "length - flap_left")
            ),
        ]

    @property
    def channel_height(self) -> float:
        """Height of the channel, m."""
        return self.height

    @property
    def solid_names(self) -> tuple[str, ...]:
        """The flap."""
        return ("flap",)

    @property
    def tip(self) -> tuple[float, float]:
        """Middle of the flap's top, m."""
        return (self.flap_left + self.flap_width / 2, self.flap_height)

    @property
    def reference_length(self) -> float:
        """Height of the flap, m."""
        return self.flap_height

    def exact_areas(self, physics: Physics) -> dict[str, float]:
        """Return the areas in m^2 of "fluid" and "flap"."""
        flap = self.flap_width * self.flap_height
        return self._keep({"fluid": self.length * self.height - flap, "flap": flap}, physics)

    def boundaries(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet, walls, the flap's surface and its root."""
        wet = 2 * self.flap_height + self.flap_width
        found = [Boundary("surface", SURFACE, surface_role(physics), wet, None if physics == "solid" else "flap")]
        if physics != "solid":
            found += [
                Boundary("inlet", INLET, "inlet", self.height),
                Boundary("outlet", OUTLET, "outlet", self.height),
                Boundary("walls", WALLS, "no-slip", 2 * self.length - self.flap_width),
            ]
        if physics != "fluid":
            found.append(Boundary("root", CLAMPED, "clamped", self.flap_width))
        return found
