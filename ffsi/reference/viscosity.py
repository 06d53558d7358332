"""Viscosity laws of the fluid: the dynamic viscosity, pascal seconds, as a function of the squared shear rate.

Formulas: docs/theory.md, "Blood". All are analytic, so that a complex step passes through.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ffsi.reference.materials import Array


class Viscosity(ABC):
    """A generalised Newtonian law."""

    @abstractmethod
    def at(self, squared_rate: Array) -> Array:
        """Dynamic viscosity, Pa s, at squared shear rates g^2 = 2 D:D, 1/s^2, of any shape."""

    @property
    @abstractmethod
    def outlet(self) -> float:
        """The constant viscosity, Pa s, of the do-nothing outlet and of Womersley's profile: the law's smallest."""


@dataclass(frozen=True)
class Newtonian(Viscosity):
    """A constant viscosity ``mu``, Pa s."""

    mu: float

    def at(self, squared_rate: Array) -> Array:
        """Return mu everywhere."""
        return np.full_like(squared_rate, self.mu)

    @property
    def outlet(self) -> float:
        """The viscosity itself."""
        return self.mu


@dataclass(frozen=True)
class Carreau(Viscosity):
    """From ``rest`` at g = 0 to ``infinity`` at large g, both Pa s, by the factor (1 + K g^2)^n, K in s^2."""

    rest: float
    infinity: float
    squared_time: float
    exponent: float

    def at(self, squared_rate: Array) -> Array:
        """Return mu_inf + (mu_0 - mu_inf) (1 + K g^2)^n."""
        factor = np.exp(self.exponent * np.log(1.0 + self.squared_time * squared_rate))
        return np.asarray(factor * self.rest + (1.0 - factor) * self.infinity)

    @property
    def outlet(self) -> float:
        """That at large shear rates."""
        return self.infinity


@dataclass(frozen=True)
class PowerLaw(Viscosity):
    """``consistency`` c (Pa s^m) times g^(m-1); below the shear rate ``smallest`` (1/s) it levels off."""

    consistency: float
    exponent: float
    smallest: float

    def at(self, squared_rate: Array) -> Array:
        """Return c (g^2 + e^2)^((m-1)/2)."""
        rate = np.sqrt(squared_rate + self.smallest**2)
        return np.asarray(self.consistency * rate ** (self.exponent - 1.0))

    @property
    def outlet(self) -> float:
        """The smallest one: none at large shear rates of a shear-thinning fluid, else that at rest."""
        return 0.0 if self.exponent < 1.0 else float(self.at(np.array(0.0)))


@dataclass(frozen=True)
class Casson(Viscosity):
    """A ``yield_stress`` (Pa) and ``infinity`` (Pa s) at large g; below ``smallest`` (1/s) it levels off."""

    yield_stress: float
    infinity: float
    smallest: float

    def at(self, squared_rate: Array) -> Array:
        """Return (sqrt(mu_inf) + sqrt(tau_y) (g^2 + e^2)^(-1/4))^2."""
        rate = np.sqrt(squared_rate + self.smallest**2)
        return np.asarray((math.sqrt(self.infinity) + np.sqrt(self.yield_stress / rate)) ** 2)

    @property
    def outlet(self) -> float:
        """That at large shear rates."""
        return self.infinity
