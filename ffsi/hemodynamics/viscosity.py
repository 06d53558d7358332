"""The viscosity of a fluid at a shear rate, for what is evaluated after the run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ffsi.scene.fluids import Carreau, Casson, IncompressibleFluid, Newtonian, PowerLaw

Floats = NDArray[np.float64]


def apparent_viscosity(fluid: IncompressibleFluid, shear_rate: Floats) -> Floats:
    """Return the dynamic viscosity (n,) in Pa s at shear rates (n,) in 1/s.

    Raises:
        TypeError: the fluid's law is not known here.
    """
    squared = np.asarray(shear_rate, dtype=float) ** 2
    match fluid:
        case Newtonian():
            return np.full(squared.shape, fluid.viscosity)
        case Carreau():
            at_rest = fluid.viscosity_zero - fluid.viscosity_infinity
            thinning = (1 + fluid.time_constant_squared * squared) ** fluid.exponent
            return np.asarray(fluid.viscosity_infinity + at_rest * thinning)
        case PowerLaw():
            return np.asarray(fluid.consistency * (squared + fluid.regularisation**2) ** ((fluid.exponent - 1) / 2))
        case Casson():
            yielding = np.sqrt(fluid.yield_stress) * (squared + fluid.regularisation**2) ** -0.25
            return np.asarray((np.sqrt(fluid.viscosity_infinity) + yielding) ** 2)
    raise TypeError(f"no viscosity for {type(fluid).__name__}")
