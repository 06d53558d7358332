"""Assembled residuals of a state, term by term, and their relative size per equation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ffsi.rawfiles import Floats, Ints, RawState
from ffsi.reference import terms
from ffsi.reference.elements import Elements
from ffsi.reference.materials import IDENTITY, determinant
from ffsi.reference.problem import MeshMotion
from ffsi.reference.system import FluidPart, Mask, SolidPart, System

# A scale below this fraction of the values that cancel in it is rounding: an equation whose terms all vanish (the
# continuity of Poiseuille flow) is then measured against those values; their rounding is about 1e-9 of such a scale.
_ROUNDING_FRACTION = 1e-7


@dataclass(frozen=True)
class Equation:
    """One assembled equation.

    ``terms`` by name and ``magnitude`` are (n, components) with n nodes; ``rows`` (n,) is true where the equation
    holds. ``magnitude`` is the size of what cancels inside a term, by which rounding is judged.
    """

    terms: Mapping[str, Floats]
    rows: Mask
    magnitude: Floats

    @property
    def residual(self) -> Floats:
        """Sum of all terms at all nodes, (n, components), also where the equation does not hold."""
        total: Floats = np.sum(list(self.terms.values()), axis=0)
        return total

    @property
    def scale(self) -> float:
        """Largest l2 norm over the rows of a single term."""
        largest = max(float(np.linalg.norm(term[self.rows])) for term in self.terms.values())
        return max(largest, _ROUNDING_FRACTION * float(np.linalg.norm(self.magnitude[self.rows])))

    @property
    def relative(self) -> float:
        """The l2 norm of the residual over the rows divided by the scale; 0 if every term is zero.

        Infinite if the residual is not a finite number.
        """
        norm = float(np.linalg.norm(self.residual[self.rows]))
        if not math.isfinite(norm):
            return math.inf
        return norm / self.scale if norm > 0.0 else 0.0


def scatter(local: Floats, nodes: Ints, size: int) -> Floats:
    """Add local values (n, k, components) into nodes (n, k) of ``size`` nodes; (size, components)."""
    where = nodes.ravel()
    columns = [np.bincount(where, weights=column.ravel(), minlength=size) for column in np.moveaxis(local, -1, 0)]
    return np.column_stack(columns)


@dataclass(frozen=True)
class Residual:
    """Residual of a state.

    ``equations`` by name: momentum, continuity, mesh_motion, those that the scene has; ``kinematics`` the largest
    velocity in the solids relative to the largest velocity, None without both fluid and solid; ``fluid_force`` (n2, 2)
    the fluid's momentum alone, without the outlet term, N per metre depth; ``min_jacobian`` the smallest det F at any
    quadrature point.
    """

    equations: dict[str, Equation]
    kinematics: float | None
    fluid_force: Floats
    min_jacobian: float

    @property
    def relative(self) -> dict[str, float]:
        """Relative residual of every equation that the scene has."""
        result = {name: equation.relative for name, equation in self.equations.items()}
        return result if self.kinematics is None else result | {"kinematics": self.kinematics}


def compute_residual(system: System, state: RawState) -> Residual:
    """Assemble every term of every equation for ``state`` (u, v (n2, 2), p (nv,)).

    Raises ``ValueError`` if the sizes of the state do not fit the mesh.
    """
    n2, nv = system.mesh.n_p2, len(system.mesh.vertices)
    shapes = (state.u.shape, state.v.shape, state.p.shape)
    if shapes != ((n2, 2), (n2, 2), (nv,)):
        raise ValueError(f"state of shapes {shapes} on a mesh of {n2} P2 and {nv} P1 nodes")
    total = {"gravity": np.zeros((n2, 2))}
    magnitude, force = np.zeros((n2, 2)), np.zeros((n2, 2))
    equations: dict[str, Equation] = {}
    jacobians = []
    if system.fluid is not None:
        flow = _flow(system.fluid, state)
        jacobians.append(flow.jacobian.min())
        total = _fluid_momentum(system, system.fluid, flow)
        force = np.sum(list(total.values()), axis=0)
        magnitude += _fluid_magnitude(system.fluid, state)
        if system.problem.outlet == "do-nothing":
            total["outlet"] = _outlet(system, system.fluid, state)
        equations["continuity"] = _continuity(system, system.fluid, flow, state)
        if system.fluid.motion is not None:
            equations["mesh_motion"] = _mesh_motion(system, system.fluid, system.fluid.motion, state)
    for region, solid in system.solids.items():
        jacobians.append(_smallest_jacobian(solid, state))
        local = _solid_momentum(system, solid, state)
        total[f"stress in region {region}"] = local["stress"]
        total["gravity"] = total["gravity"] + local["gravity"]
        magnitude += _spread(solid.law.material.stiffness * _largest(state.u, solid.elements), solid.elements, n2)
    equations["momentum"] = Equation(total, system.rows.momentum, magnitude)
    return Residual(equations, _kinematics(system, state), force, float(min(jacobians)))


def _flow(fluid: FluidPart, state: RawState) -> terms.Flow:
    nodes = fluid.elements.nodes
    return terms.Flow.at_points(fluid.elements, state.u[nodes], state.v[nodes], state.p[fluid.elements.vertices])


def _fluid_momentum(system: System, fluid: FluidPart, flow: terms.Flow) -> dict[str, Floats]:
    local = terms.fluid_momentum(fluid.law, system.problem.gravity, fluid.elements, flow)
    return {name: scatter(term, fluid.elements.nodes, system.mesh.n_p2) for name, term in local.items()}


def _outlet(system: System, fluid: FluidPart, state: RawState) -> Floats:
    nodes = fluid.sides.nodes[np.isin(fluid.sides.label, system.problem.labels("outlet"))]
    return scatter(terms.outlet(fluid.law.viscosity, state.v[nodes]), nodes, system.mesh.n_p2)


def _continuity(system: System, fluid: FluidPart, flow: terms.Flow, state: RawState) -> Equation:
    elements, nv = fluid.elements, len(system.mesh.vertices)
    local = terms.continuity(elements, flow)
    assembled = {name: scatter(term[..., None], elements.vertices, nv) for name, term in local.items()}
    fluxes = _largest(state.v, elements) * np.sqrt(elements.area)
    magnitude = scatter(np.repeat(fluxes[:, None, None], 3, axis=1), elements.vertices, nv)
    return Equation(assembled, system.rows.continuity, magnitude)


def _mesh_motion(system: System, fluid: FluidPart, motion: MeshMotion, state: RawState) -> Equation:
    elements, n2 = fluid.elements, system.mesh.n_p2
    local = terms.mesh_motion(motion, fluid.alpha, elements, state.u[elements.nodes])
    assembled = {name: scatter(term, elements.nodes, n2) for name, term in local.items()}
    magnitude = _spread(fluid.alpha * _largest(state.u, elements), elements, n2)
    return Equation(assembled, system.rows.mesh_motion, magnitude)


def _solid_momentum(system: System, solid: SolidPart, state: RawState) -> dict[str, Floats]:
    nodes = solid.elements.nodes
    local = terms.solid_momentum(solid.law, system.problem.gravity, solid.elements, state.u[nodes])
    return {name: scatter(term, nodes, system.mesh.n_p2) for name, term in local.items()}


def _smallest_jacobian(solid: SolidPart, state: RawState) -> float:
    gradient = terms.gradient_of(state.u[solid.elements.nodes], solid.elements.gradients)
    return float(determinant(IDENTITY + gradient).min())


def _kinematics(system: System, state: RawState) -> float | None:
    if system.fluid is None or not system.solids:
        return None
    nodes = np.concatenate([solid.elements.nodes.ravel() for solid in system.solids.values()])
    largest = float(np.hypot(*state.v.T).max())
    return float(np.abs(state.v[nodes]).max()) / (largest or 1.0)


def _fluid_magnitude(fluid: FluidPart, state: RawState) -> Floats:
    """Size of the single nodal contributions to a fluid momentum row, (n2, 2)."""
    elements, law = fluid.elements, fluid.law
    speed, width = _largest(state.v, elements), np.sqrt(elements.area)
    pressure = np.abs(state.p[elements.vertices]).max(axis=1)
    size = law.viscosity * speed + law.density * speed**2 * width + pressure * width
    return _spread(size, elements, len(state.u))


def _largest(values: Floats, elements: Elements) -> Floats:
    """Largest absolute nodal component on each triangle, (n,)."""
    largest: Floats = np.abs(values[elements.nodes]).max(axis=(1, 2))
    return largest


def _spread(size: Floats, elements: Elements, n2: int) -> Floats:
    """Add one number per triangle, (n,), to all its P2 nodes and both components; (n2, 2)."""
    return scatter(np.repeat(size[:, None, None], 6, axis=1).repeat(2, axis=2), elements.nodes, n2)
