"""An aneurysm: a dome on the outside of a bent vessel, with elastic or rigid walls."""

import math
from collections.abc import Collection
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from ffsi.scene.base import Table
from ffsi.scene.boundaries import CLAMPED, DOME_WALL, INLET, INNER_WALL, OUTER, OUTER_WALL, OUTLET, STRUTS, Boundary
from ffsi.scene.errors import Problem, names
from ffsi.scene.geometry import dome
from ffsi.scene.geometry.base import ChannelGeometry, Inlet, Physics, surface_role
from ffsi.scene.units import Count, Length

MAX_STRUTS = 20


class Stent(Table):
    """Struts of a stent in the neck: rigid circles, equally spaced on the line between the neck's ends."""

    count: Annotated[int, Count(1, MAX_STRUTS)] = Field(5, description=f"number of struts, 1 to {MAX_STRUTS}")
    diameter: Length = Field(0.1e-3, description="diameter of a strut, m")


class Aneurysm(ChannelGeometry):
    """Quarter of a bent vessel (upper left quadrant, around the origin) with a dome; solids ``vessel`` and ``dome``.

    The lumen's outline (`ffsi/data/aneurysm.json`) has one length, `outer_radius`, in proportion to which it is drawn:
    inflow at x = 0 towards -x, outflow at y = 0 towards -y.
    The walls' end faces are clamped. ``vessel`` is the wall on both sides of the vessel's lumen, up to its outer radius
    also beside the dome; ``dome`` is the wall around the dome outside of that.
    """

    # Level 2: two elements through the walls. The corner is the singular one of the flow at the neck's ends.
    solids: ClassVar[tuple[str, ...]] = ("vessel", "dome")
    sized_by: ClassVar[str] = "outer_radius"
    default_sizes: ClassVar[dict[str, float]] = dict(growth=0.3, far_size=1e-3, body_size=0.44e-3, corner_size=0.015e-3)

    kind: Literal["aneurysm"] = Field("aneurysm", description="name of the geometry")
    outer_radius: Length = Field(8e-3, description="radius of the lumen's outer side; its outline grows with it, m")
    wall_thickness: Length = Field(0.25e-3, description="thickness of the vessel's wall, m")
    dome_wall_thickness: Length = Field(0.125e-3, description="thickness of the dome's wall, m")
    stent: Stent | None = Field(None, description="struts across the neck (count, diameter in m); none if absent")

    def problems(self) -> list[Problem]:
        """Return what does not fit: walls thinner than what they surround, struts beside each other in the neck."""
        inner, largest = self.radii[1], 0.3e-3 * self.size
        found = self._bound("wall_thickness", "less", inner / 12, "a twelfth of the lumen's inner radius")
        found += self._bound("dome_wall_thickness", "less", largest, "a quarter of the dome's radius")
        if self.stent is not None:
            room = 0.8 * self.neck_length / self.stent.count
            found += self._bound("stent.diameter", "less", room, "0.8 times the neck's length per strut")
        return found

    def scene_problems(self, solids: Collection[str], has_fluid: bool) -> list[Problem]:
        """Return what a scene lacks: the fluid, or one of the two walls where the other one is elastic."""
        found = [] if has_fluid else [Problem("fluid", f'missing; the geometry "{self.kind}" needs one')]
        if solids:
            text = f"missing; either both walls, {names(self.solid_names)}, are elastic or none"
            found += [Problem(f"solid.{name}", text) for name in self.solid_names if name not in solids]
        return found

    # The outline --------------------------------------------------------------------------------------------------

    @property
    def radii(self) -> tuple[float, float, float, float]:
        """Radii of the wall's inner side, of the lumen, and of the wall's outer side, m."""
        inner, outer = (radius * self.size for radius in dome.lumen().radii)
        return inner - self.wall_thickness, inner, outer, outer + self.wall_thickness

    @property
    def neck(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The neck's ends, where the dome leaves the vessel's lumen: upstream and downstream, m."""
        (x0, y0), (x1, y1) = (dome.lumen().outline[[0, -1]] * self.size).tolist()
        return (x0, y0), (x1, y1)

    @property
    def neck_length(self) -> float:
        """Distance of the neck's ends, m."""
        return math.dist(*self.neck)

    @property
    def neck_angles(self) -> tuple[float, float]:
        """Angles of the neck's ends around the origin, radians."""
        (x0, y0), (x1, y1) = self.neck
        return math.atan2(y0, x0), math.atan2(y1, x1)

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Where the walls have corners: the neck's ends, and where the dome's wall meets the vessel's, m."""
        outside, shell = self._drawn
        found = list(self.neck)
        for offset in (0.0, shell):
            at = dome.crossing(outside, offset)
            points = self.size * dome.curve(np.array([at.first, at.second]), offset)
            found += [(x, y) for x, y in points.tolist()]
        return found

    @property
    def _drawn(self) -> tuple[float, float]:
        """Radius of the wall's outer side and thickness of the dome's wall in the outline as it is drawn, m."""
        return self.radii[3] / self.size, self.dome_wall_thickness / self.size

    @property
    def sides(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where the round part of the dome begins, seen from the neck's two ends, m."""
        (x0, y0), (x1, y1) = (dome.lumen().outline[[3, -2]] * self.size).tolist()
        return (x0, y0), (x1, y1)

    @property
    def as_drawn(self) -> Self:
        """The aneurysm whose outline is that of the data, with the walls of this one: what the script's units see."""
        return self.model_copy(update={"outer_radius": type(self).model_fields["outer_radius"].default})

    @property
    def spline(self) -> dict[str, list[float]]:
        """The dome's curve for the script: `knot` and the coefficients `x3` to `x0`, `y3` to `y0` between them, m."""
        table = {
            f"{axis}{3 - i}": (row * self.size ** (i - 2)).tolist()
            for axis, rows in zip("xy", dome.coefficients(), strict=True)
            for i, row in enumerate(rows)
        }
        return {"knot": (dome.knots() * self.size).tolist(), **table}

    @property
    def inlet(self) -> Inlet:
        """The vessel's upper end."""
        _, inner, outer, _ = self.radii
        return Inlet(start=(0.0, outer), inward=(-1.0, 0.0), height=outer - inner)

    @property
    def outlet_points(self) -> list[tuple[float, float]]:
        """The ends of the vessel's lower end."""
        _, inner, outer, _ = self.radii
        return [(-outer, 0.0), (-inner, 0.0)]

    @property
    def tip_point(self) -> tuple[float, float]:
        """The point of the dome's outline that is farthest from the middle of the neck, m."""
        points = dome.lumen().outline * self.size
        x, y = points[int(np.hypot(*(points - np.mean(self.neck, axis=0)).T).argmax())].tolist()
        return x, y

    @property
    def struts(self) -> list[tuple[float, float, float]]:
        """Centre x, centre y and radius of the stent's struts, m."""
        if self.stent is None:
            return []
        start, end = np.array(self.neck)
        places = (np.arange(self.stent.count) + 0.5) / self.stent.count
        return [(x, y, self.stent.diameter / 2) for x, y in (start + places[:, None] * (end - start)).tolist()]

    @property
    def areas(self) -> dict[str, float]:
        """Areas in m^2 of "fluid", "vessel" and "dome", as sums of sectors around the origin."""
        dry_inner, inner, outer, dry_outer = self.radii
        start, end = self.neck_angles
        outside, offset = self._drawn
        wet = dome.crossing(outside)  # where the dome's curve leaves the vessel's wall
        dry = dome.crossing(outside, offset)
        whole, beyond, square = float(dome.knots()[-1]), math.pi / 2, self.size**2
        beside = (start - beyond) + (math.pi - end)
        fluid = outer**2 / 2 * beside + square * dome.measures(0.0, whole)[1] - inner**2 / 2 * beyond
        fluid -= sum(math.pi * radius**2 for *_, radius in self.struts)
        walls = dry_outer**2 / 2 * ((wet.first_angle - beyond) + (math.pi - wet.second_angle)) - outer**2 / 2 * beside
        walls -= square * (dome.measures(0.0, wet.first)[1] + dome.measures(wet.second, whole)[1])
        vessel = math.pi / 4 * (inner**2 - dry_inner**2) + walls
        shell = square * (dome.measures(dry.first, dry.second, offset)[1] - dome.measures(wet.first, wet.second)[1])
        feet = (dry.second_angle - wet.second_angle) + (wet.first_angle - dry.first_angle)
        return {"fluid": fluid, "vessel": vessel, "dome": shell - dry_outer**2 / 2 * feet}

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return inlet, outlet, the wet sides of the walls, struts, and the walls' end faces and outer sides."""
        dry_inner, inner, outer, dry_outer = self.radii
        start, end = self.neck_angles
        quarter = math.pi / 2
        role, along = surface_role(physics), dome.measures(0.0, float(dome.knots()[-1]))[0]
        found = [
            Boundary("inlet", INLET, "inlet", outer - inner),
            Boundary("outlet", OUTLET, "outlet", outer - inner),
            Boundary("inner_wall", INNER_WALL, role, quarter * inner, circle=(0.0, 0.0, inner)),
            Boundary("outer_wall", OUTER_WALL, role, (start + quarter - end) * outer, circle=(0.0, 0.0, outer)),
            Boundary("dome_wall", DOME_WALL, role, self.size * along, curved=True),
        ]
        for number, circle in enumerate(self.struts):
            length = 2 * math.pi * circle[2]
            found.append(Boundary(f"strut_{number + 1}", STRUTS + number, "no-slip", length, circle=circle))
        if physics == "fsi":
            drawn, offset = self._drawn
            dry = dome.crossing(drawn, offset)
            outside = self.size * dome.measures(dry.first, dry.second, offset)[0]
            outside += quarter * dry_inner + (dry.first_angle + quarter - dry.second_angle) * dry_outer
            found += [
                Boundary("wall_ends", CLAMPED, "clamped", 4 * self.wall_thickness),
                Boundary("outer_side", OUTER, "free", outside, curved=True, outer=True),
            ]
        return found
