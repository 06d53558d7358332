"""Fully developed flow between two concentric circular walls, of any viscosity law, and how a widening changes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid, simpson
from scipy.optimize import root

from ffsi.files.arrays import Floats
from ffsi.scene.fluids import IncompressibleFluid
from studies.verification.plane_channel import shear_rate, stress

_POINTS = 801  # odd, for Simpson's rule


@dataclass(frozen=True)
class BentFlow:
    """Flow along concentric circles, per metre of depth.

    Attributes:
        gradient: -dp/dtheta, Pa/rad; the same at every radius.
        inner: shear stress at the inner wall, Pa.
        outer: shear stress at the outer wall, Pa.
        radius: (n,) radii from wall to wall, m.
        velocity: (n,) there, m/s.
    """

    gradient: float
    inner: float
    outer: float
    radius: Floats
    velocity: Floats


def bent_flow(
    fluid: IncompressibleFluid, inner: float, outer: float, flow_rate: float, widening: float = 0.0
) -> BentFlow:
    """Return the flow with a given rate.

    The azimuthal momentum, d(r^2 tau)/dr = r dp/dtheta, gives tau = P/2 + C/r^2 with P = dp/dtheta; the shear rate is
    g = r d(v/r)/dr, with mu(|g|) g = tau. P and C follow from v = 0 at both walls and from the flow rate.

    In a channel that slowly widens, blood is slowed down, and where it narrows accelerated: along a streamline v is
    inverse to the width h, so that the acceleration is -v^2 h'/(r h). To first order, with v of the flow without it,
    this adds -rho h'/h int r v^2 dr to r^2 tau.

    Args:
        fluid: density and viscosity law.
        inner: radius of the inner wall, m.
        outer: radius of the outer wall, m.
        flow_rate: per metre of depth, m^2/s, positive.
        widening: h'/h, the change of the width with the angle over the width, 1/rad.

    Raises:
        ValueError: the radii or the rate make no such flow.
        RuntimeError: no solution was found.
    """
    if not (0 < inner < outer and flow_rate > 0):
        raise ValueError(f"no flow of {flow_rate} m^2/s between the radii {inner} and {outer} m")
    r = np.linspace(inner, outer, _POINTS)
    flow = _flow(fluid, r, flow_rate, np.zeros_like(r))
    if widening:
        slowed = cumulative_trapezoid(r * flow.velocity**2, r, initial=0)
        flow = _flow(fluid, r, flow_rate, -fluid.density * widening * slowed / r**2)
    return flow


def _flow(fluid: IncompressibleFluid, r: Floats, flow_rate: float, inertia: Floats) -> BentFlow:
    """Return the flow with the stress tau = P/2 + C/r^2 + inertia, (n,) Pa at the radii (n,) in m."""
    width = float(r[-1] - r[0])
    scale = float(stress(fluid, np.array(6 * flow_rate / width**2)))  # wall shear stress of a plane Newtonian flow

    def stresses(ends: Floats) -> tuple[float, Floats]:
        """Return P/2 and tau (Pa) from the stresses at the inner and outer wall, multiples of the scale."""
        first, second = scale * ends - inertia[[0, -1]]
        c = (first - second) / (r[0] ** -2 - r[-1] ** -2)
        half = first - c / r[0] ** 2
        return float(half), half + c / r**2 + inertia

    def missed(ends: Floats) -> list[float]:
        """Return what velocity at the outer wall and flow rate miss, both dimensionless."""
        rate = shear_rate(fluid, stresses(ends)[1])
        turn = simpson(rate / r, x=r)  # v/r at the outer wall
        flow = (r[-1] ** 2 * turn - simpson(rate * r, x=r)) / 2  # int v dr = int r (v/r) dr, by parts
        return [turn * r[-1] * width / flow_rate, flow / flow_rate - 1]

    found = root(missed, [1.0, -1.0], tol=1e-12)
    if np.abs(missed(found.x)).max() > 1e-9:
        raise RuntimeError(f"no fully developed flow between the radii {r[0]} and {r[-1]} m: {found.message}")
    half, tau = stresses(found.x)
    velocity = r * cumulative_trapezoid(shear_rate(fluid, tau) / r, r, initial=0)
    return BentFlow(-2 * half, float(tau[0]), float(-tau[-1]), r, velocity)
