"""A channel with an elastic flap standing on its floor."""

from collections.abc import Collection
from typing import ClassVar, Literal

from pydantic import Field

from ffsi.scene.base import Table
from ffsi.scene.boundaries import CLAMPED, OUTER, ROOF, ROOF_ENDS, SURFACE, WALLS, Boundary
from ffsi.scene.errors import Problem, names
from ffsi.scene.geometry.base import Corners, Physics, StraightChannel, rectangle, surface_role
from ffsi.scene.units import Length


class Roof(Table):
    """The elastic roof of the channel."""

    thickness: Length = Field(0.02, description="thickness, m")


class FlapChannel(StraightChannel):
    """Channel [0, length] x [0, height] with the flap [left, left + width] x [0, flap_height]; solid ``flap``.

    With `roof` the channel's upper side is the elastic strip [0, length] x [height, height + thickness], clamped at
    its two ends, with a free upper side; solid ``roof``.
    """

    solids: ClassVar[tuple[str, ...]] = ("flap", "roof")
    sized_by: ClassVar[str] = "flap_height"
    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.6, far_size=0.1, body_size=0.015, corner_size=0.008)

    kind: Literal["flap-channel"] = Field("flap-channel", description="name of the geometry")
    length: Length = Field(2.5, description="length of the channel, m")
    height: Length = Field(0.4, description="height of the channel, m")
    flap_left: Length = Field(0.5, description="x of the flap's left side, m")
    flap_width: Length = Field(0.04, description="width of the flap along the channel, m")
    flap_height: Length = Field(0.2, description="height of the flap, m")
    roof: Roof | None = Field(None, description="elastic roof (thickness in m); the roof is rigid if absent")

    def problems(self) -> list[Problem]:
        """Return what does not fit: the flap must stand inside the channel."""
        room = self.length - self.flap_left
        along = self._bound("flap_left", "less", self.length, "length")
        along = along or self._bound("flap_width", "less", room, "length - flap_left")
        return self._bound("flap_height", "less", self.height, "height") + along

    def scene_problems(self, solids: Collection[str], has_fluid: bool) -> list[Problem]:
        """Return what an elastic roof lacks: it needs both solids and the fluid between them."""
        if self.roof is None:
            return []
        text = f"missing; a scene with geometry.roof needs a fluid and the solids {names(self.solid_names)}"
        found = [] if has_fluid else [Problem("fluid", text)]
        return found + [Problem(f"solid.{name}", text) for name in self.solid_names if name not in solids]

    @property
    def bluff(self) -> bool:
        """The flap stands in the flow."""
        return True

    @property
    def tip_point(self) -> tuple[float, float]:
        """Middle of the flap's top, m."""
        return (self.flap_left + self.flap_width / 2, self.flap_height)

    @property
    def probe_points(self) -> dict[str, tuple[float, float]]:
        """Middle of the elastic roof's wet side, m."""
        return {} if self.roof is None else {"roof": (self.length / 2, self.height)}

    @property
    def bodies(self) -> list[Corners]:
        """Flap and elastic roof, m."""
        flap = rectangle(self.flap_left, self.flap_left + self.flap_width, 0.0, self.flap_height)
        roof = self.roof and rectangle(0.0, self.length, self.height, self.height + self.roof.thickness)
        return [flap, roof] if roof else [flap]

    @property
    def reference_length(self) -> float:
        """Height of the flap, m."""
        return self.flap_height

    @property
    def areas(self) -> dict[str, float]:
        """Areas in m^2 of "fluid", "flap" and, if it is elastic, "roof"."""
        flap = self.flap_width * self.flap_height
        areas = {"fluid": self.length * self.height - flap, "flap": flap}
        if self.roof is not None:
            areas["roof"] = self.length * self.roof.thickness
        return areas

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet, walls, the flap's surface and root, and the elastic roof's sides."""
        wet = 2 * self.flap_height + self.flap_width
        floor = self.length - self.flap_width
        found = [Boundary("surface", SURFACE, surface_role(physics), wet, None if physics == "solid" else "flap")]
        if physics != "solid":
            found += [
                *self.ends,
                Boundary("walls", WALLS, "no-slip", floor if self.roof else floor + self.length),
            ]
        if physics != "fluid":
            found.append(Boundary("root", CLAMPED, "clamped", self.flap_width))
        if self.roof is not None:
            found += [
                Boundary("roof", ROOF, "interface", self.length),
                Boundary("roof_ends", ROOF_ENDS, "clamped", 2 * self.roof.thickness),
                Boundary("outer_side", OUTER, "free", self.length, outer=True),
            ]
        return found
