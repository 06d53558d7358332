"""Elastic materials, each from its strain energy per reference area W(F) in plane strain.

The argument everywhere is the displacement gradient H = F - I, not F: near rest F^T F - I loses all digits of a small
strain, H + H^T + H^T H does not. A new material is one subclass of ``Material``: ``energy``, its derivative
``first_piola``, and ``stiffness``; or of ``SplitMaterial``, if it shall be usable with a pressure of its own too. All
formulas are analytic in H, so that a complex step passes through them.

The energy also takes H with a stretch across the plane: (..., 3, 3) with H_13, H_23, H_31 and H_32 zero. Its derivative
by H_33 is the stress across the plane (``stress_across``), which no law of the plane alone knows.
"""

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Real values, or complex ones where a complex step differentiates the residual.
Array = NDArray[np.inexact[Any]]

IDENTITY = np.eye(2)

_STEP = 1e-30  # of the derivative across the plane
_SAME = 1e-10
# The same stretches in all directions of space: an isotropic body cannot tell them apart.
_STRETCHES = tuple(itertools.permutations((0.2, -0.1, 0.0)))
# What turns inside out has no logarithm: the stress is not a number, and no warning.
_QUIET = np.errstate(divide="ignore", over="ignore", invalid="ignore")
_PLANE_ALONE = "the energy of this material is one of the plane alone: the stress across the plane is not known"


def trace(tensor: Array) -> Array:
    """Trace over the last two axes, (..., 2, 2) or (..., 3, 3) to (...)."""
    return np.asarray(np.einsum("...ii->...", tensor))


def double_dot(first: Array, second: Array) -> Array:
    """Product a_ij b_ij over the last two axes, without conjugation, (..., n, n) to (...)."""
    return np.asarray(np.einsum("...ij,...ij->...", first, second))


def transpose(tensor: Array) -> Array:
    """Swap the last two axes."""
    return np.swapaxes(tensor, -1, -2)


def cofactor(tensor: Array) -> Array:
    """Cofactor matrix det(F) F^-T of (..., 2, 2) tensors."""
    result = np.empty_like(tensor)
    result[..., 0, 0], result[..., 0, 1] = tensor[..., 1, 1], -tensor[..., 1, 0]
    result[..., 1, 0], result[..., 1, 1] = -tensor[..., 0, 1], tensor[..., 0, 0]
    return result


def determinant(tensor: Array) -> Array:
    """Determinant of the part of tensors in the plane."""
    return np.asarray(tensor[..., 0, 0] * tensor[..., 1, 1] - tensor[..., 0, 1] * tensor[..., 1, 0])


def dilatation(gradient: Array) -> Array:
    """J - 1 of the displacement gradient (..., 2, 2), or of one with a stretch across the plane, (...)."""
    plane: Array = gradient[..., 0, 0] + gradient[..., 1, 1] + determinant(gradient)
    if gradient.shape[-1] == 2:
        return plane
    across = gradient[..., 2, 2]
    return plane + across + plane * across


def stress_across(energy: Callable[[Array], Array], gradient: Array) -> Array:
    """Stress dW/dF33 across the plane in plane strain, (...), by a complex step of the energy; no number where J <= 0.

    ``gradient`` is the displacement gradient (..., 2, 2). Raises ``ValueError`` if the energy is one of the plane
    alone: of the same stretches in other directions it must be the same.
    """
    stretches = np.array(_STRETCHES)
    try:
        same = energy(stretches[:, :, None] * np.eye(3))
    except (ValueError, IndexError) as error:  # shapes that do not fit together
        raise ValueError(f"{_PLANE_ALONE} ({error})") from error
    if not np.ptp(same) <= _SAME * np.abs(same).max():
        raise ValueError(_PLANE_ALONE)
    body = np.zeros((*gradient.shape[:-2], 3, 3), dtype=complex)
    body[..., :2, :2] = gradient
    body[..., 2, 2] = _STEP * 1j
    return np.where(dilatation(gradient) > -1.0, energy(body).imag / _STEP, np.nan)


class Material(ABC):
    """A hyperelastic law; tensors are (..., 2, 2), energies and moduli in pascals."""

    @abstractmethod
    def energy(self, gradient: Array) -> Array:
        """Strain energy per reference volume, (...), of the displacement gradient (..., 2, 2) or (..., 3, 3)."""

    @abstractmethod
    def first_piola(self, gradient: Array) -> Array:
        """First Piola-Kirchhoff stress dW/dF, (..., 2, 2), of the displacement gradient."""

    @property
    @abstractmethod
    def stiffness(self) -> float:
        """P-wave modulus at rest, which measures rounding errors of the stress."""


class SplitMaterial(Material):
    """A law W = W_0(F) + kappa U(J) whose part U can be handed over to a pressure p = -kappa U'(J) as an unknown.

    With d(U) = U'(J) cof F : dF the stress is P = dW_0/dF + kappa U' cof F = dW_0/dF - p cof F. U'' = 1 at rest, so
    that kappa is the whole resistance of U to a change of volume. Of an incompressible solid only W_0 is used.
    """

    @abstractmethod
    def base_energy(self, gradient: Array) -> Array:
        """Part W_0 of the strain energy, (...), of the displacement gradient (..., 2, 2) or (..., 3, 3)."""

    @abstractmethod
    def base_stress(self, gradient: Array) -> Array:
        """Stress dW_0/dF, (..., 2, 2), of the displacement gradient; zero at rest."""

    @abstractmethod
    def volume_energy(self, change: Array) -> Array:
        """U of the change of volume J - 1, (...)."""

    @abstractmethod
    def volume_slope(self, change: Array) -> Array:
        """U' of the change of volume J - 1, (...)."""

    @property
    @abstractmethod
    def volume_modulus(self) -> float:
        """Modulus kappa, pascals; infinite for an incompressible solid."""

    @property
    @abstractmethod
    def base_stiffness(self) -> float:
        """P-wave modulus of W_0 at rest, pascals."""

    def energy(self, gradient: Array) -> Array:
        """Sum of both parts of the strain energy."""
        return self.base_energy(gradient) + self.volume_modulus * self.volume_energy(dilatation(gradient))

    @_QUIET
    def volume_stress(self, gradient: Array) -> Array:
        """Stress kappa U' cof F, (..., 2, 2), of the displacement gradient."""
        slope = self.volume_modulus * self.volume_slope(dilatation(gradient))
        return slope[..., None, None] * cofactor(IDENTITY + gradient)

    @_QUIET
    def first_piola(self, gradient: Array) -> Array:
        """Sum of both parts of the stress."""
        return self.base_stress(gradient) + self.volume_stress(gradient)

    @property
    def stiffness(self) -> float:
        """Sum of both parts of the modulus."""
        return self.base_stiffness + self.volume_modulus


@dataclass(frozen=True)
class StVenantKirchhoff(Material):
    """St. Venant-Kirchhoff in plane strain, W = lambda/2 (tr E)^2 + mu tr E^2.

    With the invariants i1 = tr(C - I) = 2 tr E and tr (C - I)^2 = 4 tr E^2 of the right Cauchy-Green tensor C, the
    energy is W = lambda/8 i1^2 + mu/4 tr (C - I)^2. Since d(i1) = 2 F : dF and d(tr (C - I)^2) = 4 F (C - I) : dF with
    F (C - I) = (b - I) F, its derivative is P = [lambda/2 i1 I + mu (b - I)] F with the left Cauchy-Green tensor
    b = F F^T.
    """

    lame_lambda: float
    lame_mu: float

    def energy(self, gradient: Array) -> Array:
        """Strain energy from the invariants of C - I."""
        strain = _strain(gradient)
        energy = self.lame_lambda / 8.0 * trace(strain) ** 2 + self.lame_mu / 4.0 * double_dot(strain, strain)
        return np.asarray(energy)

    def first_piola(self, gradient: Array) -> Array:
        """Stress from the left Cauchy-Green tensor; tr(b - I) = tr(C - I)."""
        left = gradient + transpose(gradient) + gradient @ transpose(gradient)
        inner = self.lame_mu * left + 0.5 * self.lame_lambda * trace(left)[..., None, None] * IDENTITY
        return np.asarray(inner @ (IDENTITY + gradient))

    @property
    def stiffness(self) -> float:
        """Return lambda + 2 mu."""
        return self.lame_lambda + 2.0 * self.lame_mu


@dataclass(frozen=True)
class LinearElastic(Material):
    """Linear elastic solid of small strains, W = lambda/2 (div u)^2 + mu e : e, e the symmetric part of grad u."""

    lame_lambda: float
    lame_mu: float

    def energy(self, gradient: Array) -> Array:
        """Strain energy: e : e is half of H : H + H : H^T of the displacement gradient H."""
        symmetric = double_dot(gradient, gradient) + double_dot(gradient, transpose(gradient))
        return np.asarray(0.5 * self.lame_lambda * trace(gradient) ** 2 + 0.5 * self.lame_mu * symmetric)

    def first_piola(self, gradient: Array) -> Array:
        """Stress, which is symmetric."""
        volume = self.lame_lambda * trace(gradient)[..., None, None] * IDENTITY
        return np.asarray(volume + self.lame_mu * (gradient + transpose(gradient)))

    @property
    def stiffness(self) -> float:
        """Return lambda + 2 mu."""
        return self.lame_lambda + 2.0 * self.lame_mu


@dataclass(frozen=True)
class NeoHookean(SplitMaterial):
    """Neo-Hookean solid in plane strain, W_0 = mu/2 (I1 - 3 - 2 ln J), kappa = lambda, U = (ln J)^2 / 2.

    C33 = 1 makes I1 - 3 = |F|^2 - 2. Its derivative is 2 F and that of ln J is F^-T, so dW_0/dF = mu (F - F^-T); and
    U' = ln J / J. Not a number where J <= 0.
    """

    lame_lambda: float
    lame_mu: float

    def base_energy(self, gradient: Array) -> Array:
        """W_0 from I1 - 3 and ln J."""
        return self.lame_mu * (0.5 * _first_invariant(gradient) - _log_jacobian(gradient))

    def base_stress(self, gradient: Array) -> Array:
        """Stress of the shear modulus."""
        return self.lame_mu * _excess(gradient)

    @_QUIET
    def volume_energy(self, change: Array) -> Array:
        """Half the square of ln J."""
        return np.asarray(0.5 * np.log1p(change) ** 2)

    @_QUIET
    def volume_slope(self, change: Array) -> Array:
        """The quotient ln J / J."""
        return np.asarray(np.log1p(change) / (1.0 + change))

    @property
    def volume_modulus(self) -> float:
        """Return lambda."""
        return self.lame_lambda

    @property
    def base_stiffness(self) -> float:
        """Return 2 mu."""
        return 2.0 * self.lame_mu


@dataclass(frozen=True)
class MooneyRivlin(SplitMaterial):
    """Mooney-Rivlin solid, W_0 = C10 (J^(-2/3) I1 - 3) + C01 (J^(-4/3) I2 - 3), kappa = K, U = (J - 1)^2 / 2.

    I1 = 3 + i1 with i1 = tr(C - I) and I2 = 3 + i2 with i2 = 2 i1 + (i1^2 - tr (C - I)^2)/2. In plane strain C33 = 1:
    i1 = |F|^2 - 2 and i2 = i1 + j, j = J^2 - 1. Their derivatives are 2 F and 2 F + 2 J^2 F^-T, that of a power is
    d(J^a) = a J^a F^-T : dF. So

        d(J^(-2/3) I1) = 2 J^(-2/3) [F - (1 + i1/3) F^-T]             = 2 J^(-2/3) [(F - F^-T) - i1/3 F^-T]
        d(J^(-4/3) I2) = 2 J^(-4/3) [F + (J^2 - 2 - 2/3 i2) F^-T]     = 2 J^(-4/3) [(F - F^-T) + (j - 2 i1)/3 F^-T]

    where every term is of the order of the strain: the two stresses of 2 C10 and 2 C01 that cancel at rest do not
    appear. Not a number where J <= 0.
    """

    c10: float
    c01: float
    bulk_modulus: float

    def base_energy(self, gradient: Array) -> Array:
        """W_0 by J^a (3 + i) - 3 = (J^a - 1)(3 + i) + i."""
        log, first, strain = _log_jacobian(gradient), _first_invariant(gradient), _strain(gradient)
        second = 2.0 * first + (first**2 - double_dot(strain, strain)) / 2.0
        parts = [np.expm1(-a / 3.0 * log) * (3.0 + i) + i for a, i in ((2.0, first), (4.0, second))]
        return np.asarray(self.c10 * parts[0] + self.c01 * parts[1])

    @_QUIET
    def base_stress(self, gradient: Array) -> Array:
        """Sum of the parts of C10 and C01."""
        change, first = dilatation(gradient)[..., None, None], _first_invariant(gradient)[..., None, None]
        power = np.exp(-2.0 / 3.0 * _log_jacobian(gradient))[..., None, None]
        excess, inverse = _excess(gradient), _inverse_transposed(gradient)
        of_c01 = excess + (change * (2.0 + change) - 2.0 * first) / 3.0 * inverse
        of_c10 = excess - first / 3.0 * inverse
        return np.asarray(2.0 * self.c10 * power * of_c10 + 2.0 * self.c01 * power**2 * of_c01)

    def volume_energy(self, change: Array) -> Array:
        """Half the square of J - 1."""
        return np.asarray(0.5 * change**2)

    def volume_slope(self, change: Array) -> Array:
        """The change of volume itself."""
        return change

    @property
    def volume_modulus(self) -> float:
        """Return K."""
        return self.bulk_modulus

    @property
    def base_stiffness(self) -> float:
        """Return 4/3 mu with mu = 2 (C10 + C01)."""
        return 8.0 / 3.0 * (self.c10 + self.c01)


@_QUIET
def _log_jacobian(gradient: Array) -> Array:
    """ln J of the displacement gradient, (...); not a number where J < 0."""
    return np.log1p(dilatation(gradient))


def _strain(gradient: Array) -> Array:
    """C - I of the displacement gradient, twice Green's strain."""
    return gradient + transpose(gradient) + transpose(gradient) @ gradient


def _first_invariant(gradient: Array) -> Array:
    """I1 - 3 = tr(C - I) = 2 tr H + H : H of the displacement gradient H, (...)."""
    return 2.0 * trace(gradient) + double_dot(gradient, gradient)


@_QUIET
def _inverse_transposed(gradient: Array) -> Array:
    """F^-T = cof F / J of the displacement gradient, (..., 2, 2)."""
    return cofactor(IDENTITY + gradient) / (1.0 + dilatation(gradient)[..., None, None])


@_QUIET
def _excess(gradient: Array) -> Array:
    """F - F^-T of the displacement gradient H, (..., 2, 2).

    Written ((J - 1) F + H - cof H) / J, because cof F = I + cof H in 2D: so small H keep their digits.
    """
    change = dilatation(gradient)[..., None, None]
    return (change * (IDENTITY + gradient) + gradient - cofactor(gradient)) / (1.0 + change)
