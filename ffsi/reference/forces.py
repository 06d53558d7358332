"""Force of the fluid on body parts, as a surface integral and from the residual (docs/theory.md, "Forces")."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats, RawState
from ffsi.reference import terms
from ffsi.reference.elements import barycentric, gauss_rule, line_basis, p2_basis, p2_gradients, side_points
from ffsi.reference.materials import Array
from ffsi.reference.residual import Residual
from ffsi.reference.system import FluidPart, Sides, System


@dataclass(frozen=True)
class Force:
    """Force (2,) in newtons per metre depth of the fluid on a part, in its two forms; ``size`` of what is summed."""

    surface: Floats
    residual: Floats
    size: float


@dataclass(frozen=True)
class Forces:
    """Forces on each named part and on all of them together; ``total`` is None where nothing wet has a part."""

    parts: dict[str, Force]
    total: Force | None


def compute_forces(system: System, state: RawState, residual: Residual) -> Forces:
    """Compute the forces of ``state`` on every part that touches the fluid; ``residual`` is that of the same state.

    In the system of a time step ``state`` is the new one and the residual form has the momentum of the step. The force
    on all parts is computed for the union of their labels, since neighbouring parts share a node.
    """
    fluid = system.fluid
    if fluid is None:
        return Forces({}, None)
    wet = {name: labels for name, labels in system.problem.parts().items() if np.isin(fluid.sides.label, labels).any()}
    if not wet:
        return Forces({}, None)
    union = [label for labels in wet.values() for label in labels]
    parts = {name: _force(system, fluid, state, residual, labels) for name, labels in wet.items()}
    return Forces(parts, _force(system, fluid, state, residual, union))


def coefficient_scale(system: System) -> float | None:
    """Force of coefficient one, rho U^2 L / 2 in newtons per metre depth; None where the scene lacks U or L."""
    problem = system.problem
    if problem.fluid is None or not problem.mean_velocity or not problem.reference_length:
        return None
    return 0.5 * problem.fluid.density * problem.mean_velocity**2 * problem.reference_length


def _force(system: System, fluid: FluidPart, state: RawState, residual: Residual, labels: Sequence[int]) -> Force:
    sides = fluid.sides
    on_part = np.isin(sides.label, labels)
    part = sides.select(on_part)
    phi = np.zeros(len(state.u))
    phi[part.nodes] = 1.0
    touching = phi[sides.nodes].any(axis=1)
    rest = sides.select(touching & ~on_part)
    phi_rest = phi[rest.nodes] @ line_basis(gauss_rule()[0])[0].T
    forces = side_forces(rest, _balanced_stress(system, fluid, rest, state))
    if slip := system.problem.labels("slip"):
        slides = np.isin(rest.label, slip)
        normal = rest.normal[slides] / np.hypot(*rest.normal[slides].T)[:, None]
        forces[slides] = np.einsum("nqi,ni,nj->nqj", forces[slides], normal, normal)
    carried = np.einsum("nqi,nq->i", forces, phi_rest)
    new = side_flow(fluid, part, state)
    stress = new.pressure_flux + new.viscous_flux(fluid.law.viscosity)
    return Force(
        surface=-side_forces(part, stress).sum(axis=(0, 1)),
        residual=-(phi @ residual.fluid_force - carried),
        size=float((phi @ residual.fluid_size).max()),
    )


def _balanced_stress(system: System, fluid: FluidPart, sides: Sides, state: RawState) -> Array:
    """Stress at the Gauss points of sides as the momentum has it, that of both ends of a time step."""
    new = side_flow(fluid, sides, state)
    if (increment := system.increment) is None:
        return new.pressure_flux + new.viscous_flux(fluid.law.viscosity)
    old = side_flow(fluid, sides, increment.old)
    fluxes = terms.step_fluxes(fluid.law, increment.step, new, old)
    return fluxes["pressure"] + fluxes["viscosity"]


def side_forces(sides: Sides, stress: Array) -> Floats:
    """P N dS of stresses (n, 5, 2, 2) at the five Gauss points of each side, weights included, (n, 5, 2) N per metre.

    N points out of the fluid.
    """
    return np.asarray(np.einsum("nqij,nj,q->nqi", stress, sides.normal, gauss_rule()[1]))


def side_flow(fluid: FluidPart, sides: Sides, state: RawState, at: Floats | None = None) -> terms.Flow:
    """Flow at the five Gauss points of each side, taken from the fluid triangle of the side.

    ``at`` (n,) gives other points, from 0 at the start of the side to 1 at its end.
    """
    elements = fluid.elements
    points = side_points(gauss_rule()[0] if at is None else at)
    flat = points.reshape(-1, 2)
    shape = points.shape[:2]
    slopes = p2_gradients(flat).reshape(*shape, 6, 2)[sides.side]
    gradients = np.einsum("nqak,nkj->nqaj", slopes, elements.inverse[sides.element], optimize=True)
    nodes, vertices = elements.nodes[sides.element], elements.vertices[sides.element]
    u, v, p = state.u[nodes], state.v[nodes], state.p[vertices]
    velocity = p2_basis(flat).reshape(*shape, 6)[sides.side] @ v
    pressure = np.einsum("nqa,na->nq", barycentric(flat).reshape(*shape, 3)[sides.side], p)
    return terms.Flow.evaluate(gradients, velocity, pressure, u, v)
