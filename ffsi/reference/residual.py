"""Assembled residuals of a state, term by term, and their relative size per equation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ffsi.rawfiles import Floats, RawState
from ffsi.reference import momentum, sources, terms
from ffsi.reference.assembly import scatter
from ffsi.reference.conditions import Outlet
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


@dataclass(frozen=True)
class Residual:
    """Residual of a state, steady or at the end of a time step.

    ``equations`` by name: momentum, continuity, mesh_motion, incompressibility, those that the scene has; the nodes of
    the last one are those of all pressures of mixed solids, one after the other. ``kinematics`` what is left of the
    velocity in the solids (of a time step: less that of the displacement), relative to the largest velocity; None
    without a solid, and of a steady solid alone. ``fluid_force`` (n2, 2) the fluid's momentum alone, without outlet and
    sources, N per metre depth; ``min_jacobian`` the smallest det F at any quadrature point.
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
    """Assemble every term of every equation for ``state`` (u, v (n2, 2), p (nv,), ps (number of mixed solids, nv)).

    In the system of a time step ``state`` is the new one. Raises ``ValueError`` if the sizes of a state do not fit the
    mesh or the number of mixed solids.
    """
    _refuse_other_sizes(system, state)
    if system.increment is not None:
        _refuse_other_sizes(system, system.increment.old)
    equations: dict[str, Equation] = {}
    jacobians, force = [], np.zeros_like(state.u)
    total: dict[str, Floats] = {"gravity": np.zeros_like(state.u)}
    if system.fluid is not None:
        flow = _flow(system.fluid, state)
        jacobians.append(flow.jacobian.min())
        total = _fluid_momentum(system, system.fluid, state, flow)
        force = np.sum(list(total.values()), axis=0)
        equations["continuity"] = _continuity(system, system.fluid, flow, state)
        if system.fluid.motion is not None:
            equations["mesh_motion"] = _mesh_motion(system, system.fluid, system.fluid.motion, state)
    for region, solid in system.solids.items():
        jacobians.append(_smallest_jacobian(solid, state))
        for name, term in _solid_momentum(system, solid, state).items():
            if name in ("gravity", "inertia"):  # one term each, fluid and solids together
                total[name] = total.get(name, 0.0) + term
            else:
                total[f"{name} in region {region}"] = term
    if system.problem.mixed_regions:
        equations["incompressibility"] = _incompressibility(system, state)
    total |= _loads(system, state)
    equations["momentum"] = Equation(total, system.rows.momentum, _magnitude(system, state))
    return Residual(equations, _kinematics(system, state), force, float(min(jacobians)))


def _refuse_other_sizes(system: System, state: RawState) -> None:
    n2, nv = system.mesh.n_p2, len(system.mesh.vertices)
    shapes = (state.u.shape, state.v.shape, state.p.shape)
    if shapes != ((n2, 2), (n2, 2), (nv,)) or state.ps.shape[1:] != (nv,):
        raise ValueError(f"state of shapes {(*shapes, state.ps.shape)} on a mesh of {n2} P2 and {nv} P1 nodes")
    if len(state.ps) != (expected := len(system.problem.mixed_regions)):
        raise ValueError(
            f"{system.problem.name}: the state has pressures of {len(state.ps)} mixed solids, the problem {expected}"
        )


def _flow(fluid: FluidPart, state: RawState) -> terms.Flow:
    nodes = fluid.elements.nodes
    return terms.Flow.at_points(fluid.elements, state.u[nodes], state.v[nodes], state.p[fluid.elements.vertices])


def _fluid_momentum(system: System, fluid: FluidPart, state: RawState, flow: terms.Flow) -> dict[str, Floats]:
    nodes = fluid.elements.nodes
    local = momentum.fluid_momentum(system, fluid, state.u[nodes], state.v[nodes], flow)
    return {name: scatter(term, nodes, system.mesh.n_p2) for name, term in local.items()}


def _loads(system: System, state: RawState) -> dict[str, Floats]:
    """Momentum of the boundaries, and sources: what belongs neither to the fluid's force nor to a solid's stress."""
    loads: dict[str, Floats] = {}
    if system.fluid is not None and system.problem.outlet is not None:
        loads |= _outlet(system, system.fluid, system.problem.outlet, state)
    if system.problem.support is not None:
        edges = momentum.supported_edges(system)
        local = momentum.support(system, system.problem.support, edges, state.u[edges], state.v[edges])
        loads["support"] = scatter(local, edges, system.mesh.n_p2)
    if system.problem.labels("loaded"):
        loads["traction"] = _traction(system)
    if system.problem.manufactured is not None:
        loads["source"] = sources.momentum_source(system, system.problem.manufactured)
    return loads


def _outlet(system: System, fluid: FluidPart, outlet: Outlet, state: RawState) -> dict[str, Floats]:
    sides = momentum.outlet_sides(system, fluid)
    local = dict(momentum.outlet(system, fluid.law, outlet, sides, state.v[sides.nodes]))
    if outlet.presses:
        local["outlet pressure"] = momentum.outlet_pressure(system, outlet, sides, state.v[sides.nodes])
    return {name: scatter(term, sides.nodes, system.mesh.n_p2) for name, term in local.items()}


def _continuity(system: System, fluid: FluidPart, flow: terms.Flow, state: RawState) -> Equation:
    elements, nv = fluid.elements, len(system.mesh.vertices)
    local = terms.continuity(elements, flow)
    assembled = {name: scatter(term[..., None], elements.vertices, nv) for name, term in local.items()}
    if (exact := system.problem.manufactured) is not None and exact.mass is not None:
        assembled["source"] = sources.mass_source(system, exact.mass)
    return Equation(assembled, system.rows.continuity, _fluxes(state.v, elements, nv))


def _mesh_motion(system: System, fluid: FluidPart, motion: MeshMotion, state: RawState) -> Equation:
    elements, n2 = fluid.elements, system.mesh.n_p2
    local = terms.mesh_motion(motion, fluid.alpha, elements, state.u[elements.nodes])
    assembled = {name: scatter(term, elements.nodes, n2) for name, term in local.items()}
    magnitude = _spread(fluid.alpha * _largest(state.u, elements), elements, n2)
    return Equation(assembled, system.rows.mesh_motion, magnitude)


def _solid_momentum(system: System, solid: SolidPart, state: RawState) -> dict[str, Floats]:
    nodes = solid.elements.nodes
    p = momentum.solid_pressure(solid, state)
    local = momentum.solid_momentum(system, solid, state.u[nodes], state.v[nodes], p)
    return {name: scatter(term, nodes, system.mesh.n_p2) for name, term in local.items()}


def _traction(system: System) -> Floats:
    mesh = system.mesh
    loaded = np.isin(mesh.label, system.problem.labels("loaded"))
    start, end = mesh.vertices[mesh.edges[loaded]].transpose(1, 0, 2)
    length = np.hypot(*(end - start).T)
    return scatter(terms.traction(system.problem.traction, length), mesh.edge_nodes[loaded], mesh.n_p2)


def _incompressibility(system: System, state: RawState) -> Equation:
    """Volume of all mixed solids: the nodes of their pressures, one solid after the other."""
    mixed, nv = [system.solids[region] for region in system.problem.mixed_regions], state.ps.shape[1]
    parts = []
    for solid in mixed:
        elements, u, p = solid.elements, state.u[solid.elements.nodes], momentum.solid_pressure(solid, state)
        local = terms.incompressibility(solid.law, elements, u, p)
        parts.append({name: scatter(term[..., None], elements.vertices, nv) for name, term in local.items()})
    assembled = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    magnitude = np.concatenate([_fluxes(state.u, solid.elements, nv) for solid in mixed])
    return Equation(assembled, system.rows.incompressibility.ravel(), magnitude)


def _smallest_jacobian(solid: SolidPart, state: RawState) -> float:
    gradient = terms.gradient_of(state.u[solid.elements.nodes], solid.elements.gradients)
    return float(determinant(IDENTITY + gradient).min())


def _kinematics(system: System, state: RawState) -> float | None:
    if not system.solids or (system.fluid is None and system.increment is None):
        return None
    if system.increment is None:
        # All nodes: the values that a boundary prescribes are zero too.
        nodes = np.concatenate([solid.elements.nodes.ravel() for solid in system.solids.values()])
    else:
        nodes = np.flatnonzero(system.rows.kinematics)
    left = momentum.kinematics(system, nodes, state.u[nodes], state.v[nodes])
    largest = float(np.hypot(*state.v.T).max())
    return float(np.abs(left).max(initial=0.0)) / (largest or 1.0)


def _magnitude(system: System, state: RawState) -> Floats:
    """Size of the single nodal contributions to a momentum row, (n2, 2)."""
    total = np.zeros_like(state.u)
    states = [state] if system.increment is None else [state, system.increment.old]
    for each in states:
        if system.fluid is not None:
            total += _fluid_magnitude(system.fluid, each)
        for solid in system.solids.values():
            total += _solid_magnitude(solid, each)
    return total + _inertia_magnitude(system, state)


def _inertia_magnitude(system: System, state: RawState) -> Floats:
    """Size of what cancels in the difference quotient of v in a time step, (n2, 2); zero in a steady system.

    It covers the convection by the mesh velocity too, as long as a step moves the mesh by less than a triangle.
    """
    total = np.zeros_like(state.u)
    if (increment := system.increment) is None:
        return total
    parts: list[FluidPart | SolidPart] = [*([system.fluid] if system.fluid else []), *system.solids.values()]
    for part in parts:
        speed = _largest(state.v, part.elements) + _largest(increment.old.v, part.elements)
        size = part.law.density / increment.step.k * speed * part.elements.area
        total += _spread(size, part.elements, len(total))
    return total


def _fluid_magnitude(fluid: FluidPart, state: RawState) -> Floats:
    """Size of the single nodal contributions to a fluid momentum row, (n2, 2)."""
    elements, law = fluid.elements, fluid.law
    viscosity = _flow(fluid, state).viscosity(law.viscosity).max(axis=1)
    speed, width = _largest(state.v, elements), np.sqrt(elements.area)
    pressure = np.abs(state.p[elements.vertices]).max(axis=1)
    size = viscosity * speed + law.density * speed**2 * width + pressure * width
    return _spread(size, elements, len(state.u))


def _solid_magnitude(solid: SolidPart, state: RawState) -> Floats:
    """Size of the single nodal contributions to a solid's momentum row, (n2, 2)."""
    elements, material = solid.elements, solid.law.mixed_material
    strain = _largest(state.u, elements)
    if material is None:
        size = solid.law.material.stiffness * strain
    else:
        pressure = np.abs(momentum.solid_pressure(solid, state)).max(axis=1)
        size = material.base_stiffness * strain + pressure * np.sqrt(elements.area)
    return _spread(size, elements, len(state.u))


def _largest(values: Floats, elements: Elements) -> Floats:
    """Largest absolute nodal component on each triangle, (n,)."""
    largest: Floats = np.abs(values[elements.nodes]).max(axis=(1, 2))
    return largest


def _fluxes(values: Floats, elements: Elements, nv: int) -> Floats:
    """Size of the single contributions to a row that balances the fluxes of a P2 vector, (nv, 1)."""
    size = _largest(values, elements) * np.sqrt(elements.area)
    return scatter(np.repeat(size[:, None, None], 3, axis=1), elements.vertices, nv)


def _spread(size: Floats, elements: Elements, n2: int) -> Floats:
    """Add one number per triangle, (n,), to all its P2 nodes and both components; (n2, 2)."""
    return scatter(np.repeat(size[:, None, None], 6, axis=1).repeat(2, axis=2), elements.nodes, n2)
