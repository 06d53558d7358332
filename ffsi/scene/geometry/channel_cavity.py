"""A channel over a cavity with a flexible floor (Tukovic et al. 2018)."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.boundaries import CLAMPED, LEFT_LIP, OUTER, RIGHT_LIP, SURFACE, WALLS, Boundary
from ffsi.scene.errors import Problem
from ffsi.scene.geometry.base import Corners, Physics, StraightChannel, rectangle, surface_role
from ffsi.scene.units import Length


class ChannelCavity(StraightChannel):
    """Channel [0, length] x [0, height] over a cavity with rounded lips and an elastic floor; solid ``floor``.

    The floor is [left, left + width] x [-depth - thickness, -depth], clamped at its two ends; its outer side is free.
    """

    solids: ClassVar[tuple[str, ...]] = ("floor",)
    sized_by: ClassVar[str] = "cavity_width"
    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.75, far_size=0.6, body_size=0.2, corner_size=0.08)

    kind: Literal["channel-cavity"] = Field("channel-cavity", description="name of the geometry")
    length: Length = Field(14.0, description="length of the channel, m")
    height: Length = Field(1.0, description="height of the channel, m")
    cavity_left: Length = Field(2.0, description="x of the cavity's left side, m")
    cavity_width: Length = Field(4.0, description="width of the cavity along the channel, m")
    cavity_depth: Length = Field(1.0, description="depth of the cavity below the channel, m")
    floor_thickness: Length = Field(0.4, description="thickness of the elastic floor, m")
    lip_radius: Length = Field(0.25, description="radius of the cavity's two rounded upper lips, m")

    def problems(self) -> list[Problem]:
        """Return what does not fit: the cavity with its lips inside the channel."""
        room = self.length - self.cavity_left - self.lip_radius
        found = self._bound("lip_radius", "less", self.cavity_depth, "cavity_depth")
        found += self._bound("lip_radius", "less", self.cavity_left, "cavity_left")
        along = self._bound("cavity_left", "less", self.length, "length")
        return found + (along or self._bound("cavity_width", "less", room, "length - cavity_left - lip_radius"))

    @property
    def tip_point(self) -> tuple[float, float]:
        """Middle of the floor's wet face, m."""
        return (self.cavity_left + self.cavity_width / 2, -self.cavity_depth)

    @property
    def bodies(self) -> list[Corners]:
        """The floor, m."""
        left, top = self.cavity_left, -self.cavity_depth
        return [rectangle(left, left + self.cavity_width, top - self.floor_thickness, top)]

    @property
    def areas(self) -> dict[str, float]:
        """Areas in m^2 of "fluid" and "floor"."""
        rounding = 2 * self.lip_radius**2 * (1 - math.pi / 4)
        fluid = self.length * self.height + self.cavity_width * self.cavity_depth + rounding
        return {"fluid": fluid, "floor": self.cavity_width * self.floor_thickness}

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet, straight walls, lips, the floor's wet face, its ends and its outer side."""
        radius = self.lip_radius
        part = None if physics == "solid" else "floor"
        found = [Boundary("surface", SURFACE, surface_role(physics), self.cavity_width, part)]
        if physics != "solid":
            right = self.cavity_left + self.cavity_width
            walls = 2 * self.length - self.cavity_width - 2 * radius + 2 * (self.cavity_depth - radius)
            arc = math.pi / 2 * radius
            found += [
                *self.ends,
                Boundary("walls", WALLS, "no-slip", walls),
                Boundary("left_lip", LEFT_LIP, "no-slip", arc, circle=(self.cavity_left - radius, -radius, radius)),
                Boundary("right_lip", RIGHT_LIP, "no-slip", arc, circle=(right + radius, -radius, radius)),
            ]
        if physics != "fluid":
            found += [
                Boundary("ends", CLAMPED, "clamped", 2 * self.floor_thickness),
                Boundary("outer_side", OUTER, "free", self.cavity_width, outer=True),
            ]
        return found
