"""Fully developed flow between two plane walls, of any viscosity law: the shear stress is linear in the distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from ffsi.files.arrays import Floats
from ffsi.scene.fluids import IncompressibleFluid

_SMALLEST, _HALVINGS = 1e-9, 60


@dataclass(frozen=True)
class PlaneFlow:
    """Fully developed flow between two walls that are twice `half_height` apart.

    Attributes:
        gradient: -dp/dx, Pa/m.
        half_height: half the distance of the walls, m.
        mean: mean velocity, m/s.
        largest: velocity in the middle, m/s.
    """

    gradient: float
    half_height: float
    mean: float
    largest: float

    @property
    def wall_shear_stress(self) -> float:
        """Shear stress at the walls, Pa."""
        return self.gradient * self.half_height


def plane_flow(fluid: IncompressibleFluid, gradient: float, half_height: float) -> PlaneFlow:
    """Return the flow that a pressure gradient drives, to ten digits.

    At the distance y from the middle the stress is f(g) = G y, g the shear rate: instead of g over y, f is integrated
    over g, which needs no inverse of the law. With h half the height and g_w the rate at the wall,
    int_0^h g dy = g_w h - (1/G) int_0^g_w f dg, and int_0^h g y dy = g_w h^2/2 - 1/(2 G^2) int_0^g_w f^2 dg.

    Args:
        fluid: its viscosity law.
        gradient: G = -dp/dx, Pa/m, positive.
        half_height: h, m.
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
    mean = (rate * half_height**2 / 2 - over_rates(2) / (2 * gradient**2)) / half_height
    return PlaneFlow(gradient, half_height, mean, largest)


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
