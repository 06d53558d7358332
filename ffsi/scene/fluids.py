"""The fluid: density and viscosity law."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from ffsi.files.arrays import Floats
from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, short
from ffsi.scene.units import (
    Consistency,
    Density,
    NonNegativeModulus,
    PositiveNumber,
    Quantity,
    ShearRate,
    SquaredTime,
    Stress,
    Viscosity,
)

_CarreauExponent = Annotated[float, Quantity("1", at_least=-0.5, below=0.0)]


class IncompressibleFluid(Table, ABC):
    """An incompressible fluid; a viscosity law derives from it and adds its constants.

    A law's `law` field is its name. g is the shear rate, g^2 = 2 D:D with the rate of deformation D.
    """

    density: Density = Field(description="density, kg/m^3")
    mean_pressure: Stress | None = Field(
        None, description="mean of p over a closed fluid whose pressure nothing else says, 0 if absent there, Pa"
    )

    @abstractmethod
    def apparent_viscosity(self, shear_rate: Floats) -> Floats:
        """Return the dynamic viscosity (n,) in Pa s at shear rates (n,) in 1/s, for what is evaluated after a run."""


class Newtonian(IncompressibleFluid):
    """A fluid of constant viscosity."""

    viscosity: Viscosity = Field(description="dynamic viscosity, Pa s")
    law: Literal["newtonian"] = Field("newtonian", description='viscosity law: "newtonian"')

    def apparent_viscosity(self, shear_rate: Floats) -> Floats:
        """Return the viscosity."""
        return np.full(np.shape(shear_rate), self.viscosity)


class Carreau(IncompressibleFluid):
    """Shear-thinning fluid: mu = mu_inf + (mu_0 - mu_inf) (1 + K g^2)^n; by default blood (Johnston et al. 2004)."""

    viscosity_zero: Viscosity = Field(0.056, description="dynamic viscosity mu_0 at rest, Pa s")
    viscosity_infinity: Viscosity = Field(0.00345, description="dynamic viscosity mu_inf at large shear rates, Pa s")
    time_constant_squared: SquaredTime = Field(10.976, description="constant K, the square of a time, s^2")
    exponent: _CarreauExponent = Field(-0.3216, description="exponent n of 1 + K g^2, dimensionless")
    law: Literal["carreau"] = Field("carreau", description='viscosity law: "carreau"')

    @model_validator(mode="after")
    def _thins(self) -> Self:
        if self.viscosity_zero < self.viscosity_infinity:
            text = f"must be at least viscosity_infinity = {short(self.viscosity_infinity)} Pa s"
            refuse([Problem("viscosity_zero", text, f"{short(self.viscosity_zero)} Pa s")])
        return self

    def apparent_viscosity(self, shear_rate: Floats) -> Floats:
        """Return mu(g)."""
        thinning = (1 + self.time_constant_squared * shear_rate**2) ** self.exponent
        return np.asarray(self.viscosity_infinity + (self.viscosity_zero - self.viscosity_infinity) * thinning)


class PowerLaw(IncompressibleFluid):
    """Power law, regularised at rest: mu = c (g^2 + e^2)^((m-1)/2), shear-thinning for m below 1."""

    consistency: Consistency = Field(description="consistency c, Pa s^m")
    exponent: PositiveNumber = Field(description="exponent m of the shear stress c g^m, dimensionless")
    regularisation: ShearRate = Field(0.01, description="shear rate e below which the viscosity levels off, 1/s")
    law: Literal["power-law"] = Field("power-law", description='viscosity law: "power-law"')

    def apparent_viscosity(self, shear_rate: Floats) -> Floats:
        """Return mu(g)."""
        return np.asarray(self.consistency * np.hypot(shear_rate, self.regularisation) ** (self.exponent - 1))


class Casson(IncompressibleFluid):
    """Casson's law, regularised at rest: mu = (sqrt(mu_inf) + sqrt(tau_y) (g^2 + e^2)^(-1/4))^2."""

    yield_stress: NonNegativeModulus = Field(description="yield stress tau_y, Pa")
    viscosity_infinity: Viscosity = Field(description="dynamic viscosity mu_inf at large shear rates, Pa s")
    regularisation: ShearRate = Field(0.01, description="shear rate e below which the viscosity levels off, 1/s")
    law: Literal["casson"] = Field("casson", description='viscosity law: "casson"')

    def apparent_viscosity(self, shear_rate: Floats) -> Floats:
        """Return mu(g)."""
        yielding = np.sqrt(self.yield_stress / np.hypot(shear_rate, self.regularisation))
        return np.asarray((np.sqrt(self.viscosity_infinity) + yielding) ** 2)


def _default_law(fluid: Any) -> Any:
    return {"law": "newtonian", **fluid} if isinstance(fluid, Mapping) else fluid


Fluid = Annotated[Newtonian | Carreau | PowerLaw | Casson, Field(discriminator="law"), BeforeValidator(_default_law)]
LAWS: dict[str, type[IncompressibleFluid]] = {
    name: law for law in get_args(get_args(Fluid)[0]) for name in get_args(law.model_fields["law"].annotation)
}
