"""The fluid and the solids: densities and constitutive laws."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, number_text, short
from ffsi.scene.units import Density, Modulus, NonNegativeModulus, Quantity, Stress, Viscosity

ELASTIC_PAIRS: tuple[tuple[str, str], ...] = (
    ("lame_lambda", "lame_mu"),
    ("young_modulus", "poisson_ratio"),
    ("lame_mu", "poisson_ratio"),
)
ELASTIC_CONSTANTS: tuple[str, ...] = ("lame_lambda", "lame_mu", "young_modulus", "poisson_ratio")

PAIRS_TEXT = ", ".join(f"({first}, {second})" for first, second in ELASTIC_PAIRS)
PoissonRatio = Annotated[float, Quantity("1", above=-1.0, below=0.5)]


class Fluid(Table):
    """An incompressible fluid."""

    density: Density = Field(description="density, kg/m^3")
    viscosity: Viscosity = Field(description="dynamic viscosity, Pa s")
    law: Literal["newtonian"] = Field("newtonian", description='viscosity law: "newtonian"')


class Elastic(Table):
    """A solid with a density."""

    density: Density = Field(description="density in the reference configuration, kg/m^3")


class CompressibleElastic(Elastic):
    """A solid with two elastic constants: exactly one pair of `ELASTIC_PAIRS`."""

    lame_lambda: Stress | None = Field(None, description="first Lame constant, Pa")
    lame_mu: Modulus | None = Field(None, description="second Lame constant (shear modulus), Pa")
    young_modulus: Modulus | None = Field(None, description="Young's modulus, Pa")
    poisson_ratio: PoissonRatio | None = Field(None, description="Poisson's ratio, dimensionless")

    @property
    def elastic_pair(self) -> tuple[str, str]:
        """Names of the two constants that are given."""
        return next(pair for pair in ELASTIC_PAIRS if set(pair) == set(self._given()))

    @property
    def lame(self) -> tuple[float, float]:
        """Lame constants (lambda, mu), Pa."""
        nu = self.poisson_ratio
        if nu is None:
            assert self.lame_lambda is not None and self.lame_mu is not None
            return self.lame_lambda, self.lame_mu
        if self.lame_mu is not None:
            mu = self.lame_mu
        else:
            assert self.young_modulus is not None
            mu = self.young_modulus / (2 * (1 + nu))
        return 2 * mu * nu / (1 - 2 * nu), mu

    @property
    def young_poisson(self) -> tuple[float, float]:
        """Young's modulus in Pa and Poisson's ratio."""
        if self.young_modulus is not None and self.poisson_ratio is not None:
            return self.young_modulus, self.poisson_ratio
        lmbda, mu = self.lame
        nu = lmbda / (2 * (lmbda + mu)) if self.poisson_ratio is None else self.poisson_ratio
        return 2 * mu * (1 + nu), nu

    def _given(self) -> list[str]:
        return [name for name in ELASTIC_CONSTANTS if getattr(self, name) is not None]

    @model_validator(mode="after")
    def _one_complete_pair(self) -> Self:
        refuse(pair_problems(self._given()))
        if self.lame_lambda is not None and self.lame_mu is not None and not self.lame_lambda > -2 / 3 * self.lame_mu:
            limit = number_text(-2 / 3 * self.lame_mu)
            text = f"must be greater than -2/3 lame_mu = {limit} Pa (Poisson's ratio above -1)"
            refuse([Problem("lame_lambda", text, f"{short(self.lame_lambda)} Pa")])
        return self


def pair_problems(given: list[str]) -> list[Problem]:
    """Return what is wrong with a choice of elastic constants: exactly one pair of `ELASTIC_PAIRS` is accepted."""
    if any(set(pair) == set(given) for pair in ELASTIC_PAIRS):
        return []
    accepted = f"accepted is exactly one pair of {PAIRS_TEXT}"
    if not given:
        return [Problem("lame_lambda", f"the elastic constants are missing; {accepted}")]
    if len(given) == 1:
        partners = [name for pair in ELASTIC_PAIRS if given[0] in pair for name in pair if name != given[0]]
        return [Problem(partners[0], f"missing beside {given[0]}; {accepted}")]
    return [Problem(given[-1], f"given beside {' and '.join(given[:-1])}; {accepted}")]


class StVenantKirchhoff(CompressibleElastic):
    """St. Venant-Kirchhoff solid: S = lambda tr(E) I + 2 mu E, plane strain."""

    material: Literal["st-venant-kirchhoff"] = Field(description='material law: "st-venant-kirchhoff"')


class NeoHookean(CompressibleElastic):
    """Compressible neo-Hookean solid: W = mu/2 (I1 - 3 - 2 ln J) + lambda/2 (ln J)^2, plane strain."""

    material: Literal["neo-hookean"] = Field(description='material law: "neo-hookean"')


class MooneyRivlin(Elastic):
    """Compressible Mooney-Rivlin solid, plane strain.

    W = C10 (J^(-2/3) I1 - 3) + C01 (J^(-4/3) I2 - 3) + K/2 (J - 1)^2. Poisson's ratio may be far below zero:
    nothing ties the bulk modulus to the others.
    """

    c10: NonNegativeModulus = Field(description="constant C10 of the first invariant, Pa")
    c01: NonNegativeModulus = Field(description="constant C01 of the second invariant, Pa")
    bulk_modulus: Modulus = Field(description="bulk modulus K, Pa")
    material: Literal["mooney-rivlin"] = Field(description='material law: "mooney-rivlin"')

    @property
    def lame(self) -> tuple[float, float]:
        """Lame constants (lambda, mu) at rest, Pa."""
        mu = 2 * (self.c10 + self.c01)
        return self.bulk_modulus - 2 / 3 * mu, mu

    @property
    def young_poisson(self) -> tuple[float, float]:
        """Young's modulus in Pa and Poisson's ratio at rest."""
        bulk, mu = self.bulk_modulus, self.lame[1]
        return 9 * bulk * mu / (3 * bulk + mu), (3 * bulk - 2 * mu) / (2 * (3 * bulk + mu))

    @model_validator(mode="after")
    def _resists_shear(self) -> Self:
        if not self.c10 + self.c01 > 0:
            refuse([Problem("c10", "c10 + c01 must be greater than 0 Pa", f"{short(self.c10)} Pa")])
        return self


Solid = Annotated[StVenantKirchhoff | NeoHookean | MooneyRivlin, Field(discriminator="material")]
MATERIALS: dict[str, type[Elastic]] = {
    "st-venant-kirchhoff": StVenantKirchhoff,
    "neo-hookean": NeoHookean,
    "mooney-rivlin": MooneyRivlin,
}
