"""A channel around a cylinder, with or without a beam behind it (Turek and Hron 2006; Schaefer and Turek 1996)."""

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from ffsi.scene.base import Table
from ffsi.scene.boundaries import CLAMPED, CYLINDER, SURFACE, WALLS, Boundary
from ffsi.scene.errors import Problem
from ffsi.scene.geometry.base import Corners, Physics, StraightChannel, rectangle, surface_role
from ffsi.scene.units import Coordinate, Length


class Beam(Table):
    """The beam behind the cylinder, centred at cylinder_y."""

    length: Length = Field(0.35, description="length from the cylinder's rearmost point to the end face, m")
    thickness: Length = Field(0.02, description="thickness, m")


class ChannelCylinder(StraightChannel):
    """Channel [0, length] x [0, height] around a cylinder; solid ``beam`` where `beam` is given."""

    solids: ClassVar[tuple[str, ...]] = ("beam",)
    sized_by: ClassVar[str] = "cylinder_radius"
    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.75, far_size=0.09, body_size=0.014, corner_size=0.003)

    kind: Literal["channel-cylinder"] = Field("channel-cylinder", description="name of the geometry")
    length: Length = Field(2.5, description="length of the channel, m")
    height: Length = Field(0.41, description="height of the channel, m")
    cylinder_x: Coordinate = Field(0.2, description="x of the cylinder's centre, m")
    cylinder_y: Coordinate = Field(0.2, description="y of the cylinder's centre, m")
    cylinder_radius: Length = Field(0.05, description="radius of the cylinder, m")
    beam: Beam | None = Field(None, description="beam behind the cylinder (length and thickness in m); none if absent")

    def problems(self) -> list[Problem]:
        """Return what does not fit: cylinder inside the channel, beam thinner than the cylinder and in the channel."""
        radius = self.cylinder_radius
        found = [
            *self._bound("cylinder_x", "greater", radius, "cylinder_radius"),
            *self._bound("cylinder_x", "less", self.length - radius, "length - cylinder_radius"),
            *self._bound("cylinder_y", "greater", radius, "cylinder_radius"),
            *self._bound("cylinder_y", "less", self.height - radius, "height - cylinder_radius"),
        ]
        if self.beam is not None:
            room = self.length - self.cylinder_x - radius
            found += [
                *self._bound("beam.thickness", "less", 1.96 * radius, "0.98 of the cylinder's diameter"),
                *self._bound("beam.length", "less", room, "length - cylinder_x - cylinder_radius"),
            ]
        return found

    @property
    def bluff(self) -> bool:
        """The cylinder stands in the flow."""
        return True

    @property
    def tip_point(self) -> tuple[float, float] | None:
        """Middle of the beam's end face, m; None without a beam."""
        if self.beam is None:
            return None
        return (self.cylinder_x + self.cylinder_radius + self.beam.length, self.cylinder_y)

    @property
    def reference_length(self) -> float:
        """Diameter of the cylinder, m."""
        return 2 * self.cylinder_radius

    @property
    def root_half_angle(self) -> float:
        """Half of the angle under which the cylinder's centre sees the beam's root, radians; 0 without a beam."""
        return 0.0 if self.beam is None else np.arcsin(self.beam.thickness / (2 * self.cylinder_radius))

    @property
    def beam_side_length(self) -> float:
        """Length of the beam's upper (and lower) side from the cylinder to the end face, m; 0 without a beam."""
        if self.beam is None:
            return 0.0
        side: float = self.cylinder_radius * (1 - np.cos(self.root_half_angle)) + self.beam.length
        return side

    @property
    def bodies(self) -> list[Corners]:
        """The beam from the cylinder's rearmost point on, m."""
        if self.beam is None:
            return []
        rear, half = self.cylinder_x + self.cylinder_radius, self.beam.thickness / 2
        return [rectangle(rear, rear + self.beam.length, self.cylinder_y - half, self.cylinder_y + half)]

    @property
    def areas(self) -> dict[str, float]:
        """Areas in m^2 of "fluid" and "beam" (which ends at the root arc)."""
        radius, angle = self.cylinder_radius, self.root_half_angle
        areas = {"fluid": self.length * self.height - math.pi * radius**2}
        if self.beam is not None:
            under_root = radius**2 * (angle + np.sin(angle) * np.cos(angle))
            areas["beam"] = self.beam.thickness * (radius + self.beam.length) - under_root
            areas["fluid"] -= areas["beam"]
        return areas

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet, walls, the wetted arc of the cylinder, the beam's surface and its root arc."""
        radius, angle = self.cylinder_radius, self.root_half_angle
        circle = (self.cylinder_x, self.cylinder_y, radius)
        found = []
        if physics != "solid":
            found += [
                *self.ends,
                Boundary("walls", WALLS, "no-slip", 2 * self.length),
                Boundary("cylinder", CYLINDER, "no-slip", 2 * (math.pi - angle) * radius, "cylinder", circle),
            ]
        if self.beam is not None:
            wet = 2 * self.beam_side_length + self.beam.thickness
            part = None if physics == "solid" else "beam"
            found.append(Boundary("surface", SURFACE, surface_role(physics), wet, part))
            if physics != "fluid":
                found.append(Boundary("root", CLAMPED, "clamped", 2 * angle * radius, circle=circle))
        return found
