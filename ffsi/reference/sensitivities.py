"""Derivatives of the quantities of a steady state by the parameters of its scene, with the checker's own Jacobian.

Along the solutions X(p) of R(X, p) = 0 the tangent solves R_X dX = -R_p, with R_X by complex steps. R_p, and the
quantities along (X + h dX, p + h), are differenced over four points, h a small part of the parameter.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ffsi.files.arrays import Floats, RawMesh, RawState
from ffsi.reference.forces import compute_forces
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.quantities import Quantity, at_outlet, recompute
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import Factors, jacobian_along, moved, residual_vector
from ffsi.reference.system import System
from ffsi.scene import Scene, with_values

_STEP = 3e-4
# Differences over four points, exact for polynomials of degree four.
_STENCIL = {1: 2 / 3, -1: -2 / 3, 2: -1 / 12, -2: 1 / 12}
# Logarithmic derivatives below this part of one are measured on it: times the tolerance that is rounding.
_SMALL = 1e-2
# Likewise of what is nothing but rounding, as the lift of a symmetric flow: its differences over a small step are more.
_OF_NOTHING = 1e2


def by_name(quantity: str, key: str) -> str:
    """Return the name of the derivative of a quantity by a parameter."""
    return f"{quantity} by {key}"


def derivatives(scene: Scene, mesh: RawMesh, state: RawState, keys: Iterable[str]) -> dict[str, Quantity]:
    """Return the derivative of every quantity by each of the parameters, in SI, by ``by_name``."""
    scene = scene.settled()
    system, known = System.build(problem_from_scene(scene), mesh), scene.parameters()
    values = values_of(system, state)
    factors, found = Factors.of(system, state), {}
    for key in keys:
        size = abs(known[key]) or 1.0
        h = _STEP * (min(size, 0.5 - known[key]) if key.endswith("poisson_ratio") else size)  # at 1/2 it is steep
        systems = {
            place: System.build(problem_from_scene(with_values(scene, {key: known[key] + place * h})), mesh)
            for place in _STENCIL
        }
        rows: Floats = np.zeros(sum(each.size for each in state.fields))
        for place, weight in _STENCIL.items():
            rows += weight / h * residual_vector(systems[place], state, compute_residual(systems[place], state))
        tangent = factors.solution(system, state, rows)
        left = rows + jacobian_along(system, state, tangent)  # what the elimination and sums of a matrix have lost
        tangent = moved(tangent, factors.solution(system, state, left.astype(np.float64)))
        ends = {place: values_of(systems[place], moved(state, tangent, place * h)) for place in _STENCIL}
        for name, quantity in values.items():
            part = _SMALL if abs(quantity.value) >= quantity.scale else _OF_NOTHING
            slope = sum(weight / h * ends[place][name].value for place, weight in _STENCIL.items())
            found[by_name(name, key)] = Quantity(slope, max(abs(slope), part * quantity.scale / size))
    return found


def flattened(reported: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a script reports, {key: {quantity: derivative}}, by the names of derivatives."""
    return {by_name(name, key): slope for key, slopes in reported.items() for name, slope in slopes.items()}


def values_of(system: System, state: RawState) -> dict[str, Quantity]:
    """Return every quantity of a steady state."""
    forces = compute_forces(system, state, compute_residual(system, state))
    return recompute(system, state, forces) | at_outlet(system, state)
