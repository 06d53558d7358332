"""Flows between plane walls and concentric circles, of any viscosity law, or oscillating; numbers beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid, quad, simpson
from scipy.optimize import brentq, root

from ffsi.files.arrays import Floats
from ffsi.hemodynamics.aneurysm import AneurysmState
from ffsi.hemodynamics.result import Result
from ffsi.scene.fluids import IncompressibleFluid

_SMALLEST, _HALVINGS = 1e-9, 60
_POINTS = 801  # odd, for Simpson's rule

# Womersley's flow, in SI units: half the height is 3 times the thickness sqrt(nu / omega) of the layer that oscillates
# with the walls (Womersley's number).
HEIGHT, DENSITY, VISCOSITY, PERIOD, RATE, SWING = 1.0, 1.0, 0.1745, 1.0, 1.0, 0.75


@dataclass(frozen=True)
class Measured:
    """A number that was found, and its exact value or the one that it is compared with; both in one unit."""

    value: float
    reference: float = math.nan

    @property
    def error(self) -> float:
        """(value - reference) / |reference|; NaN without a reference."""
        return (self.value - self.reference) / abs(self.reference) if self.reference else math.nan


def worst(values: Floats, exact: float | Floats) -> Measured:
    """Return the value that is farthest from what it should be, relative to that; NaN without values."""
    if not len(values):
        return Measured(np.nan, np.nan)
    exact = np.broadcast_to(exact, values.shape)
    at = int(np.abs(values / exact - 1).argmax())
    return Measured(float(values[at]), float(exact[at]))


def stress(fluid: IncompressibleFluid, rate: Floats) -> Floats:
    """Return the shear stress mu(|g|) g in Pa at shear rates g, 1/s, of either sign."""
    return fluid.apparent_viscosity(np.abs(rate)) * rate


def shear_rate(fluid: IncompressibleFluid, shear_stress: Floats) -> Floats:
    """Return the shear rates (n,) in 1/s, with the sign of the stress, at shear stresses (n,) in Pa.

    By halving: the stress of every law grows with the rate.
    """
    size = np.abs(shear_stress)
    high = size / fluid.apparent_viscosity(np.zeros_like(size))
    while (low := stress(fluid, high) < size).any():
        high = np.where(low, 2 * high, high)
    lower = np.zeros_like(high)
    for _ in range(_HALVINGS):
        middle = (lower + high) / 2
        below = stress(fluid, middle) < size
        lower, high = np.where(below, middle, lower), np.where(below, high, middle)
    return np.asarray(np.copysign((lower + high) / 2, shear_stress))


def plane_flow(fluid: IncompressibleFluid, gradient: float, half_height: float) -> tuple[float, float]:
    """Return mean and largest velocity (m/s) of the flow that a pressure gradient drives, to ten digits.

    At the distance y from the middle the stress is f(g) = G y, g the shear rate: instead of g over y, f is integrated
    over g, which needs no inverse of the law. With G = -dp/dx > 0 in Pa/m, h half the height in m and g_w the rate at
    the wall,
    int_0^h g dy = g_w h - (1/G) int_0^g_w f dg, and int_0^h g y dy = g_w h^2/2 - 1/(2 G^2) int_0^g_w f^2 dg.
    """
    wall = gradient * half_height
    rate = float(shear_rate(fluid, np.array([wall]))[0])
    rate = brentq(lambda g: float(stress(fluid, np.array(g))) - wall, 0.5 * rate, 2 * rate, xtol=1e-300, rtol=1e-14)

    def over_rates(power: int) -> float:
        # In the logarithm of the rate: a law may change within a small part of them.
        def integrand(logarithm: float) -> float:
            g = np.exp(logarithm)
            return float(stress(fluid, np.array(g)) ** power * g)

        ends = np.log(_SMALLEST * rate), np.log(rate)
        return float(quad(integrand, *ends, epsabs=0, epsrel=1e-13, limit=500)[0])

    largest = rate * half_height - over_rates(1) / gradient
    return (rate * half_height**2 / 2 - over_rates(2) / (2 * gradient**2)) / half_height, largest


@dataclass(frozen=True)
class BentFlow:
    """Flow along concentric circles, per metre of depth."""

    gradient: float  # -dp/dtheta, Pa/rad; the same at every radius
    inner: float  # shear stress at the inner wall, Pa
    outer: float  # shear stress at the outer wall, Pa
    radius: Floats  # (n,) radii from wall to wall, m
    velocity: Floats  # (n,) there, m/s


def bent_flow(
    fluid: IncompressibleFluid, inner: float, outer: float, flow_rate: float, widening: float = 0.0
) -> BentFlow:
    """Return the flow between the radii `inner` and `outer` in m with a given rate in m^2/s.

    The azimuthal momentum, d(r^2 tau)/dr = r dp/dtheta, gives tau = P/2 + C/r^2 with P = dp/dtheta; the shear rate is
    g = r d(v/r)/dr, with mu(|g|) g = tau. P and C follow from v = 0 at both walls and from the flow rate.

    In a channel that slowly widens, blood is slowed down, and where it narrows accelerated: along a streamline v is
    inverse to the width h, so that the acceleration is -v^2 h'/(r h). To first order, with v of the flow without it,
    this adds -rho h'/h int r v^2 dr to r^2 tau. `widening` is h'/h, of the angle, in 1/rad.
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


def oscillating_flow(y: Floats, t: float) -> tuple[Floats, float]:
    """Return the velocity (m/s) at heights y (m) above the lower wall and -dp/dx (Pa/m) at the time t (s).

    The flow rate is RATE (1 + SWING sin(omega t)): Poiseuille's flow, and the real part of
    v = G / (i omega rho) (1 - cosh(b s) / cosh(b h)) e^(i omega t) with b^2 = i omega rho / mu, s = y - h, h half the
    height, for a pressure gradient G e^(i omega t).
    """
    omega, h = 2 * np.pi / PERIOD, HEIGHT / 2
    b = np.sqrt(1j * omega * DENSITY / VISCOSITY)
    per_gradient = (2 * h - 2 * np.tanh(b * h) / b) / (1j * omega * DENSITY)  # flow rate of G = 1
    gradient = -1j * SWING * RATE / per_gradient * np.exp(1j * omega * t)
    swing = gradient / (1j * omega * DENSITY) * (1 - np.cosh(b * (y - h)) / np.cosh(b * h))
    steady = 6 * RATE / HEIGHT**3 * y * (HEIGHT - y)
    return steady + swing.real, float(12 * VISCOSITY * RATE / HEIGHT**3 + gradient.real)


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
