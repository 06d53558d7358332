"""The solids: densities and constitutive laws."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self, get_args

from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, number_text, short
from ffsi.scene.json_schema import absent, equals, every, given, one_of, when
from ffsi.scene.units import Modulus, NonNegativeDensity, NonNegativeModulus, Quantity, ShearRate, Stress, Viscosity

ELASTIC_PAIRS: tuple[tuple[str, str], ...] = (
    ("lame_lambda", "lame_mu"),
    ("young_modulus", "poisson_ratio"),
    ("lame_mu", "poisson_ratio"),
)
ELASTIC_CONSTANTS: tuple[str, ...] = ("lame_lambda", "lame_mu", "young_modulus", "poisson_ratio")

NEARLY_INCOMPRESSIBLE = 0.49
"""Poisson's ratio from which on a solid that can have a pressure of its own has one unless its formulation is given."""

PAIRS_TEXT = ", ".join(f"({first}, {second})" for first, second in ELASTIC_PAIRS)
PoissonRatio = Annotated[float, Quantity("1", above=-1.0, below=0.5)]


class Elastic(Table, ABC):
    """A solid with a density; a material derives from it, adds its constants and states `lame`.

    A material's `material` field is its name. Numbers that are fields become parameters of the scene.
    """

    volume_constants: ClassVar[tuple[str, ...]] = ()
    """Names of the constants that an incompressible solid does not have."""

    density: NonNegativeDensity = Field(
        description="density in the reference configuration, 0 of a solid without inertia, kg/m^3"
    )
    viscosity: Viscosity | None = Field(
        None, description="Kelvin-Voigt viscosity eta of the further stress S = eta dE/dt, needs a table time, Pa s"
    )
    mass_damping: ShearRate | None = Field(
        None, description="factor a of Rayleigh's damping force -a rho v per volume, needs a table time, 1/s"
    )

    @property
    def mixed(self) -> bool:
        """Whether the solid has a pressure of its own as an unknown."""
        return getattr(self, "formulation", "displacement") != "displacement"

    @property
    def incompressible(self) -> bool:
        """Whether J = 1."""
        return getattr(self, "formulation", "displacement") == "incompressible"

    @property
    @abstractmethod
    def lame(self) -> tuple[float, float]:
        """Lame constants (lambda, mu) at rest, Pa; lambda is infinite where J = 1."""

    @property
    def young_poisson(self) -> tuple[float, float]:
        """Young's modulus in Pa and Poisson's ratio, both at rest."""
        lame_lambda, mu = self.lame
        nu = 0.5 if math.isinf(lame_lambda) else lame_lambda / (2 * (lame_lambda + mu))
        return 2 * mu * (1 + nu), nu

    @property
    def elastic_constants(self) -> dict[str, float]:
        """All elastic constants at rest, in Pa (Poisson's ratio dimensionless); infinite where J = 1 makes them so."""
        young, nu = self.young_poisson
        lame_lambda, mu = self.lame
        return {
            "young_modulus": young,
            "poisson_ratio": nu,
            "lame_lambda": lame_lambda,
            "lame_mu": mu,
            "bulk_modulus": lame_lambda + 2 / 3 * mu,
        }


class WithFormulation(Elastic):
    """A solid that can have a pressure of its own."""

    follows: ClassVar[tuple[str, ...]] = ("formulation",)

    formulation: Literal["displacement", "mixed", "incompressible"] = Field(
        "displacement",
        description='"displacement" (unknown u only), "mixed" (u and the solid\'s pressure, any compressibility '
        'without locking) or "incompressible" (J = 1 with the solid\'s pressure); if absent "displacement", '
        f'and "mixed" from a Poisson\'s ratio of {NEARLY_INCOMPRESSIBLE} on',
    )

    @model_validator(mode="after")
    def _choose(self) -> Self:
        # Beyond rounding: 0.49 itself also where it is given by Lame's constants.
        if "formulation" not in self.model_fields_set and self.young_poisson[1] > NEARLY_INCOMPRESSIBLE - 1e-9:
            self.fill(formulation="mixed")
        return self


class CompressibleElastic(Elastic):
    """A solid with two elastic constants: exactly one pair of `ELASTIC_PAIRS`."""

    model_config = ConfigDict(json_schema_extra=one_of(ELASTIC_PAIRS))

    lame_lambda: Stress | None = Field(None, description="first Lame constant, Pa")
    lame_mu: Modulus | None = Field(None, description="second Lame constant (shear modulus), Pa")
    young_modulus: Modulus | None = Field(None, description="Young's modulus, Pa")
    poisson_ratio: PoissonRatio | None = Field(None, description="Poisson's ratio, dimensionless")

    @property
    def given_constants(self) -> tuple[str, ...]:
        """Names of the elastic constants that are given, in the order of `ELASTIC_CONSTANTS`."""
        return tuple(name for name in ELASTIC_CONSTANTS if getattr(self, name) is not None)

    @property
    def lame(self) -> tuple[float, float]:
        """Lame constants (lambda, mu), Pa; lambda is infinite where J = 1."""
        nu = 0.5 if self.incompressible else self.poisson_ratio
        if self.lame_mu is not None:
            mu = self.lame_mu
        else:
            assert self.young_modulus is not None and nu is not None
            mu = self.young_modulus / (2 * (1 + nu))
        if self.incompressible:
            return math.inf, mu
        if nu is None:
            assert self.lame_lambda is not None
            return self.lame_lambda, mu
        return 2 * mu * nu / (1 - 2 * nu), mu

    @property
    def young_poisson(self) -> tuple[float, float]:
        """Young's modulus in Pa and Poisson's ratio."""
        young, nu = super().young_poisson
        return self.young_modulus or young, nu if self.poisson_ratio is None else self.poisson_ratio

    def constant_problems(self) -> list[Problem]:
        """Return what is wrong with the choice and the values of the elastic constants."""
        found = pair_problems(self.given_constants)
        if found or self.lame_lambda is None or self.lame_mu is None or self.lame_lambda > -2 / 3 * self.lame_mu:
            return found
        limit = number_text(-2 / 3 * self.lame_mu)
        text = f"must be greater than -2/3 lame_mu = {limit} Pa (Poisson's ratio above -1)"
        return [Problem("lame_lambda", text, f"{short(self.lame_lambda)} Pa")]

    @model_validator(mode="after")
    def _sound_constants(self) -> Self:
        refuse(self.constant_problems())
        return self


def pair_problems(given: Sequence[str]) -> list[Problem]:
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


class InPlane(CompressibleElastic):
    """A solid in plane strain or, per reference thickness, in plane stress."""

    plane: Literal["strain", "stress"] = Field(
        "strain", description='"strain" (no stretch across the plane) or "stress" (a thin plate: no stress across it)'
    )


class StVenantKirchhoff(InPlane):
    """St. Venant-Kirchhoff solid: S = lambda tr(E) I + 2 mu E."""

    material: Literal["st-venant-kirchhoff"] = Field(description='material law: "st-venant-kirchhoff"')


class LinearElastic(InPlane):
    """Linear elastic solid of small strains: P = lambda tr(e) I + 2 mu e, e = (grad u + (grad u)^T)/2."""

    material: Literal["linear-elastic"] = Field(description='material law: "linear-elastic"')


class NeoHookean(WithFormulation, CompressibleElastic):
    """Neo-Hookean solid: W = mu/2 (I1 - 3 - 2 ln J) + lambda/2 (ln J)^2, plane strain.

    Incompressible: W = mu/2 (I1 - 3) with J = 1, and exactly one constant, lame_mu or young_modulus = 3 lame_mu.
    """

    model_config = ConfigDict(
        json_schema_extra=when(
            equals("formulation", "incompressible"),
            every([one_of([["lame_mu"], ["young_modulus"]]), absent("lame_lambda", "poisson_ratio")]),
            one_of(ELASTIC_PAIRS),
        )
    )
    volume_constants: ClassVar[tuple[str, ...]] = ("lame_lambda", "poisson_ratio")

    material: Literal["neo-hookean"] = Field(description='material law: "neo-hookean"')

    def constant_problems(self) -> list[Problem]:
        """Return what is wrong with the choice and the values of the elastic constants."""
        if self.incompressible:
            return self._incompressible_problems()
        found = super().constant_problems()
        if self.mixed and not found and not self.lame[0] > 0:
            key, unit = ("poisson_ratio", "") if self.lame_lambda is None else ("lame_lambda", " Pa")
            text = (
                f'must be greater than 0{unit} with formulation = "mixed": the volume equation divides by lame_lambda'
            )
            found.append(Problem(key, text, short(getattr(self, key)) + unit))
        return found

    def _incompressible_problems(self) -> list[Problem]:
        unused = [name for name in self.given_constants if name in self.volume_constants]
        if unused:
            text = "Poisson's ratio is 1/2; give young_modulus or lame_mu"
            return [_not_incompressible(name, getattr(self, name), text) for name in unused]
        accepted = 'formulation = "incompressible" takes exactly one of lame_mu, young_modulus'
        if not self.given_constants:
            return [Problem("lame_mu", f"missing; {accepted}")]
        if len(self.given_constants) > 1:
            return [Problem("young_modulus", f"given beside lame_mu; {accepted}")]
        return []


class MooneyRivlin(WithFormulation):
    """Mooney-Rivlin solid, plane strain.

    W = C10 (J^(-2/3) I1 - 3) + C01 (J^(-4/3) I2 - 3) + K/2 (J - 1)^2. Poisson's ratio may be far below zero:
    nothing ties the bulk modulus to the others. Incompressible: J = 1, and no bulk modulus.
    """

    model_config = ConfigDict(
        json_schema_extra=when(equals("formulation", "incompressible"), absent("bulk_modulus"), given("bulk_modulus"))
    )
    volume_constants: ClassVar[tuple[str, ...]] = ("bulk_modulus",)

    c10: NonNegativeModulus = Field(description="constant C10 of the first invariant, Pa")
    c01: NonNegativeModulus = Field(description="constant C01 of the second invariant, Pa")
    bulk_modulus: Modulus | None = Field(None, description="bulk modulus K; none if incompressible, Pa")
    material: Literal["mooney-rivlin"] = Field(description='material law: "mooney-rivlin"')

    @field_validator("bulk_modulus")
    @classmethod
    def _unless_incompressible(cls, bulk_modulus: float | None, info: ValidationInfo) -> float | None:
        # Here and not in a validator of the whole, so that it is reported together with other missing constants.
        formulation = info.data.get("formulation")
        if formulation == "incompressible" and bulk_modulus is not None:
            refuse([_not_incompressible("", bulk_modulus, "it is infinite; leave it out")])
        if formulation in ("displacement", "mixed") and bulk_modulus is None:
            refuse([Problem("", 'missing; bulk modulus K, Pa (not needed with formulation = "incompressible")')])
        return bulk_modulus

    @property
    def lame(self) -> tuple[float, float]:
        """Lame constants (lambda, mu) at rest, Pa; lambda is infinite where J = 1."""
        mu = 2 * (self.c10 + self.c01)
        return math.inf if self.bulk_modulus is None else self.bulk_modulus - 2 / 3 * mu, mu

    @property
    def young_poisson(self) -> tuple[float, float]:
        """Young's modulus in Pa and Poisson's ratio at rest."""
        bulk, mu = self.bulk_modulus, self.lame[1]
        if bulk is None:
            return 3 * mu, 0.5
        return 9 * bulk * mu / (3 * bulk + mu), (3 * bulk - 2 * mu) / (2 * (3 * bulk + mu))

    @model_validator(mode="after")
    def _resists_shear(self) -> Self:
        if not self.c10 + self.c01 > 0:
            refuse([Problem("c10", "c10 + c01 must be greater than 0 Pa", f"{short(self.c10)} Pa")])
        return self


def _not_incompressible(key: str, value: float, reason: str) -> Problem:
    text = f'not accepted with formulation = "incompressible": {reason}'
    return Problem(key, text, short(value) if key == "poisson_ratio" else f"{short(value)} Pa")


Solid = Annotated[StVenantKirchhoff | LinearElastic | NeoHookean | MooneyRivlin, Field(discriminator="material")]
MATERIALS: dict[str, type[Elastic]] = {
    name: law for law in get_args(get_args(Solid)[0]) for name in get_args(law.model_fields["material"].annotation)
}
