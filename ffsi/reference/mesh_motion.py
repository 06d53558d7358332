"""Equations of the mesh motion: P_m of each kind by its parts, (..., 2, 2), from grad u; docs/theory.md."""

from collections.abc import Callable

import numpy as np

from ffsi.reference.materials import IDENTITY, Array, NeoHookean, trace, transpose


def harmonic(gradient: Array, beta: float) -> dict[str, Array]:
    """The derivatives by x, those by y, and the divergence term.

    They are split by derivative and not by component: without the divergence term each component is an equation of its
    own, so its whole term vanishes at the solution and would be no scale.
    """
    along_x, along_y = gradient * np.array([1.0, 0.0]), gradient * np.array([0.0, 1.0])
    return {"d/dx": along_x, "d/dy": along_y, "divergence": beta * trace(gradient)[..., None, None] * IDENTITY}


def linear_elastic(gradient: Array, beta: float) -> dict[str, Array]:
    """Those of ``harmonic``, and the transposed gradient."""
    return harmonic(gradient, beta) | {"transposed": transpose(gradient)}


def hyperelastic(gradient: Array, beta: float) -> dict[str, Array]:
    """Stress of a neo-Hookean solid by its parts, F - F^-T and beta ln J F^-T, not a number where J <= 0."""
    solid = NeoHookean(beta, 1.0)
    return {"shape": solid.base_stress(gradient), "volume": solid.volume_stress(gradient)}


# By the kind of a scene's mesh motion.
MOTIONS: dict[str, Callable[[Array, float], dict[str, Array]]] = {
    "harmonic": harmonic,
    "linear-elastic": linear_elastic,
    "hyperelastic": hyperelastic,
}
