"""The steady flow in an aneurysm's vessel, far from the dome, beside the fully developed flow in a bent channel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.hemodynamics.aneurysm import AneurysmState
from ffsi.hemodynamics.result import Result
from ffsi.scene.fluids import IncompressibleFluid
from studies.verification.exact_flows import BentFlow, Measured, bent_flow, worst

RANGES = {"upstream": (103.0, 110.0), "downstream": (152.0, 160.0)}
"""Angles around the origin in degrees; the inlet is at 90, the neck from 126.5 to 141.4, the outlet at 180."""
SLOWED = "_slowed"
"""Ending of the quantities that are compared with a flow which the widening of the lumen slows down."""
_STEP = np.radians(1.5)  # of the widening's difference quotient
_ANGLES, _ITERATIONS = 6, 30


@dataclass(frozen=True)
class Lumen:
    """The lumen of a steady state, on the deformed mesh; `flow_rate` through the vessel in m^2/s."""

    state: AneurysmState
    fluid: IncompressibleFluid
    flow_rate: float

    @cached_property
    def lines(self) -> dict[str, tuple[Floats, Floats]]:
        """Angles (rad, increasing) and radii (m) of the vertices of the wall "inner" and of the wall "dome"."""
        frame, place = self.state.wall, self.state.mesh.p2_coordinates + self.state.state.u
        found = {}
        for line in ("inner", "dome"):
            nodes = np.unique(self.state.points.ends[frame["line"].to_numpy() == line])
            x, y = place[nodes].T
            order = np.argsort(np.arctan2(y, x))
            found[line] = np.arctan2(y, x)[order], np.hypot(x, y)[order]
        return found

    def radii(self, angle: float) -> tuple[float, float]:
        """Return the radii (m) of the walls on the ray at an angle (rad)."""
        inner, outer = (float(np.interp(angle, *self.lines[line])) for line in ("inner", "dome"))
        return inner, outer

    def widening(self, angle: float) -> float:
        """Return the change of the width with the angle (rad) over the width, 1/rad."""
        before, after = (float(np.diff(self.radii(angle + step))[0]) for step in (-_STEP, _STEP))
        return float(np.log(after / before) / (2 * _STEP))

    def flow(self, angle: float, slowed: bool) -> BentFlow:
        """Return the developed flow between the walls at an angle (rad), slowed down by their widening or not."""
        return bent_flow(self.fluid, *self.radii(angle), self.flow_rate, self.widening(angle) if slowed else 0.0)

    def pressure(self, angle: float) -> float:
        """Return the pressure (Pa) in the middle of the lumen on the ray at an angle (rad)."""
        target = np.mean(self.radii(angle)) * np.array([[np.cos(angle), np.sin(angle)]])
        place = target
        for _ in range(_ITERATIONS):  # fields are sampled in the reference configuration
            found = self.state.fields.sample(place)
            place = target - np.column_stack([found["ux"], found["uy"]])
        return float(self.state.fields.sample(place)["p"][0])

    def stress(self, line: str, wall: str, limits: tuple[float, float], slowed: bool) -> Measured:
        """Return the shear stress (Pa) of a wall's edges between two angles (rad) that is farthest off."""
        state = self.state
        x, y = (state.mesh.p2_coordinates + state.state.u)[state.points.middle].T
        angle, frame = np.arctan2(y, x), state.wall
        own = (frame["line"].to_numpy() == line) & (angle > limits[0]) & (angle < limits[1])
        exact = [getattr(self.flow(float(at), slowed), wall) for at in angle[own]]
        return worst(frame["wss"].to_numpy()[own], np.array(exact))


def far_flow(result: Result) -> dict[str, Measured]:
    """Return pressure differences over `RANGES` and the wall shear stress where it is farthest off, both in Pa.

    `upstream_pressure`, `upstream_inner`, `upstream_outer`, `downstream_...`, beside the developed flow between the
    deformed walls; with elastic walls also `..._slowed`, beside the flow that their widening slows down.
    """
    assert result.scene.fluid is not None
    lumen = Lumen(result.aneurysm, result.scene.fluid, result.quantities["flow_rate_in"])
    found = {}
    for ending in ("", SLOWED) if result.scene.solid else ("",):
        for name, limits in RANGES.items():
            first, last = np.radians(limits)
            x, weight = np.polynomial.legendre.leggauss(_ANGLES)
            angles = (first + last) / 2 + (last - first) / 2 * x
            gradients = [lumen.flow(float(angle), bool(ending)).gradient for angle in angles]
            exact = float(weight @ gradients) * (last - first) / 2
            drop = lumen.pressure(float(first)) - lumen.pressure(float(last))
            found[f"{name}_pressure{ending}"] = Measured(drop, exact)
            for line, wall in (("inner", "inner"), ("dome", "outer")):
                found[f"{name}_{wall}{ending}"] = lumen.stress(line, wall, (first, last), bool(ending))
    return found
