"""Assembled residuals of a state, term by term, and their relative size per equation."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawState, distinct
from ffsi.reference import momentum, terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.elements import scatter
from ffsi.reference.materials import IDENTITY, Array, determinant
from ffsi.reference.problem import MeshMotion
from ffsi.reference.relative import largest, norm, relative
from ffsi.reference.sizes import (
    EVEN,
    ROUNDING,
    flux_sizes,
    idle,
    largest_on,
    momentum_sizes,
    reference_pressure,
    spread,
)
from ffsi.reference.slip import along
from ffsi.reference.system import FluidPart, Mask, Sides, System, place_in_solids

OUTLET = "outlet pressure"


@dataclass(frozen=True)
class Equation:
    """One assembled equation.

    ``terms`` by name and ``magnitude`` are (n, components) with n nodes; ``rows`` (n,) is true where the equation
    holds. ``magnitude`` is what a scale must not be less than: the size of what cancels inside a term, of which a part
    is rounding. ``parts`` of the rows have a scale of their own each (all together, if there is none), so that what is
    wrong in one is not lost beside the other. ``scales`` are the terms in the order in which they are measured.
    """

    terms: Mapping[str, Floats]
    rows: Mask
    magnitude: Floats
    parts: tuple[Mask, ...] = ()
    scales: Mapping[str, Floats] | None = None

    @property
    def residual(self) -> Floats:
        """Sum of all terms at all nodes, (n, components), also where the equation does not hold."""
        return np.asarray(np.sum(list(self.terms.values()), axis=0))

    def scale(self, rows: Mask) -> float:
        """Largest l2 norm over some rows of a single term, or of the magnitude."""
        measured = self.terms if self.scales is None else self.scales
        return largest(norm(each[rows]) for each in (*measured.values(), self.magnitude))

    @property
    def relative(self) -> float:
        """The l2 norm of the residual over the rows divided by the scale, the largest of all parts.

        Infinite if the residual is not a finite number.
        """
        found = self.residual
        worst = largest(relative(norm(found[rows]), self.scale(rows)) for rows in (self.parts or (self.rows,)))
        return worst if math.isfinite(worst) else math.inf


@dataclass(frozen=True)
class Residual:
    """Residual of a state, steady or at the end of a time step.

    ``equations`` by name: momentum, continuity, mesh_motion, incompressibility, those that the scene has; the nodes of
    the last one are those of all pressures of mixed solids, one after the other. ``kinematics`` what is left of the
    velocity in the solids (of a time step: less that of the displacement), relative to the largest velocity; None
    without a solid, and of a steady solid alone. ``fluid_force`` (n2, 2) the fluid's momentum alone, without outlet and
    sources, and ``fluid_size`` (n2, 2) the size of what is summed up in it, N per metre depth; ``min_jacobian`` the
    smallest det F at any quadrature point.
    """

    equations: dict[str, Equation]
    kinematics: float | None
    fluid_force: Floats
    fluid_size: Floats
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
    fluid_size, size = momentum_sizes(system, state)
    magnitude = ROUNDING * size
    total: dict[str, Floats] = {"gravity": np.zeros_like(state.u)}
    if system.fluid is not None:
        flow = momentum.flow_of(system.fluid, state)
        jacobians.append(flow.jacobian.min())
        nodes = system.fluid.elements.nodes
        local = momentum.fluid_momentum(system, system.fluid, state.u[nodes], state.v[nodes], flow)
        total = _scattered(local, nodes, system.mesh.n_p2)
        force = np.sum(list(total.values()), axis=0)
        rest_speed, rest_force = idle(system, system.fluid, state)
        magnitude += spread(rest_force, system.fluid.elements, len(state.u))
        equations["continuity"] = _continuity(system, system.fluid, flow, state, rest_speed)
        if system.fluid.motion is not None:
            equations["mesh_motion"] = _mesh_motion(system, system.fluid, system.fluid.motion, state)
    for region, solid in system.solids.items():
        nodes = solid.elements.nodes
        gradient = terms.gradient_of(state.u[nodes], solid.elements.gradients)
        jacobians.append(determinant(IDENTITY + gradient).min())
        p = momentum.solid_pressure(solid, state)
        local = momentum.solid_momentum(system, solid, state.u[nodes], state.v[nodes], p)
        for name, term in _scattered(local, nodes, system.mesh.n_p2).items():
            if name in ("gravity", "inertia"):  # one term each, fluid and solids together
                total[name] = total.get(name, 0.0) + term
            else:
                total[f"{name} in region {region}"] = term
    if system.problem.mixed_regions:
        equations["incompressibility"] = _incompressibility(system, state)
    total |= _loads(system, state)
    scales = _without_level(system, state, total)
    total, scales = ({k: along(term, system.rows.v_normal) for k, term in each.items()} for each in (total, scales))
    equations["momentum"] = Equation(total, system.rows.momentum, magnitude, _parts(system), scales)
    return Residual(equations, _kinematics(system, state), force, fluid_size, float(np.min(jacobians)))


def _parts(system: System) -> tuple[Mask, ...]:
    """Rows of the momentum inside of the fluid, and those of solids."""
    in_solid = np.zeros_like(system.rows.momentum)
    for solid in system.solids.values():
        in_solid[solid.elements.nodes] = True
    return system.rows.momentum & ~in_solid, system.rows.momentum & in_solid


def _refuse_other_sizes(system: System, state: RawState) -> None:
    n2, nv = system.mesh.n_p2, len(system.mesh.vertices)
    shapes = (state.u.shape, state.v.shape, state.p.shape)
    if shapes != ((n2, 2), (n2, 2), (nv,)) or state.ps.shape[1:] != (nv,):
        raise ValueError(f"state of shapes {(*shapes, state.ps.shape)} on a mesh of {n2} P2 and {nv} P1 nodes")
    if len(state.ps) != (expected := len(system.problem.mixed_regions)):
        raise ValueError(
            f"{system.problem.name}: the state has pressures of {len(state.ps)} mixed solids, the problem {expected}"
        )


def _scattered(local: Mapping[str, Array], nodes: Ints, size: int) -> dict[str, Floats]:
    """Assemble the terms of vectors (n, k, 2) or scalars (n, k)."""
    return {name: scatter(term if term.ndim == 3 else term[..., None], nodes, size) for name, term in local.items()}


def _without_level(system: System, state: RawState, total: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the momentum's terms with the mean pressure of the fluid taken from its inside to its boundary.

    Div cof F = 0: a constant pressure, however high, does nothing inside of the fluid, where it is no scale of the
    forces. What it does on the boundary is a term with the pressure behind the outlet, with which it is in balance.
    """
    if (fluid := system.fluid) is None:
        return dict(total)
    ends, increment = fluid.sides.nodes, system.increment
    u = state.u if increment is None else increment.step.mean(state.u, increment.old.u)
    on_sides = terms.side_pressure((system.mesh.p2_coordinates + u)[ends], reference_pressure(fluid, state))
    level = scatter(on_sides, ends, system.mesh.n_p2)
    return {**total, "pressure": total["pressure"] - level, OUTLET: total.get(OUTLET, 0.0) + level}


def _loads(system: System, state: RawState) -> dict[str, Floats]:
    """Momentum of the boundaries, and sources: what belongs neither to the fluid's force nor to a solid's stress."""
    loads: dict[str, Floats] = {}
    for outlet, sides in system.outlets:
        for name, term in _outlet(system, outlet, sides, state).items():
            loads[name] = loads.get(name, 0.0) + term
    for held, edges in momentum.supports(system):
        local = momentum.support(system, held, edges, state.u[edges], state.v[edges])
        loads["support"] = loads.get("support", 0.0) + scatter(local, edges, system.mesh.n_p2)
    if system.problem.labels("loaded"):
        loads["traction"] = _traction(system)
    for acting, sides in system.loaded:
        local = momentum.load(system, acting, sides, state.u[sides.nodes])
        loads["traction"] = loads["traction"] + scatter(local, sides.nodes, system.mesh.n_p2)
    for force in system.problem.point_forces:
        nodes, basis = place_in_solids(system, force.point)
        factor = 1.0 if system.increment is None else force.factor(system.increment.step.between)
        here = np.zeros((system.mesh.n_p2, 2))
        here[nodes] = -factor * basis[:, None] * np.array(force.force)
        loads["traction"] = loads.get("traction", 0.0) + here
    if system.problem.manufactured is not None:
        loads["source"] = system.problem.manufactured.force(system)
    return loads


def _outlet(system: System, outlet: Outlet, sides: Sides, state: RawState) -> dict[str, Floats]:
    assert system.fluid is not None
    law = system.fluid.law
    local = dict(momentum.outlet(system, law, outlet, sides, state.v[sides.nodes]))
    if outlet.presses:
        local[OUTLET] = momentum.outlet_pressure(system, outlet, sides, state.v[sides.nodes])
    if outlet.hydrostatic:
        local[OUTLET] = local.get(OUTLET, 0.0) + momentum.column_pressure(system, law, sides)
    return _scattered(local, sides.nodes, system.mesh.n_p2)


def _continuity(system: System, fluid: FluidPart, flow: terms.Flow, state: RawState, rest: Floats) -> Equation:
    elements, nv = fluid.elements, len(system.mesh.vertices)
    local = terms.continuity(elements, flow)
    assembled = _scattered(local, elements.vertices, nv)
    if (exact := system.problem.manufactured) is not None and exact.mass is not None:
        assembled["source"] = exact.mass(system)
    states = [state] if system.increment is None else [state, system.increment.old]
    speed = EVEN * np.sum([largest_on(each.v, elements) for each in states], axis=0) + rest
    return Equation(assembled, system.rows.continuity, flux_sizes(speed, elements, nv))


def _mesh_motion(system: System, fluid: FluidPart, motion: MeshMotion, state: RawState) -> Equation:
    elements, n2 = fluid.elements, system.mesh.n_p2
    local = terms.mesh_motion(motion, fluid.alpha, elements, state.u[elements.nodes])
    assembled = _scattered(local, elements.nodes, n2)
    if (exact := system.problem.manufactured) is not None and exact.motion is not None:
        assembled["source"] = exact.motion(system)
    stiffness = (2.0 + motion.divergence_weight) * fluid.alpha
    magnitude = EVEN * spread(stiffness * largest_on(state.u, elements), elements, n2)
    assembled = {name: along(term, system.rows.u_normal) for name, term in assembled.items()}
    return Equation(assembled, system.rows.mesh_motion, magnitude)


def _traction(system: System) -> Floats:
    mesh = system.mesh
    labels = [b.label for b in system.problem.boundaries if b.role == "loaded" and b.load is None]
    loaded = np.isin(mesh.label, labels)
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
        parts.append(_scattered(local, elements.vertices, nv))
    assembled = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    sizes = [flux_sizes(largest_on(state.u, solid.elements), solid.elements, nv) for solid in mixed]
    magnitude = ROUNDING * np.concatenate(sizes)
    return Equation(assembled, system.rows.incompressibility.ravel(), magnitude)


def _kinematics(system: System, state: RawState) -> float | None:
    if not system.solids or (system.fluid is None and system.increment is None):
        return None
    nodes = distinct(np.concatenate([solid.elements.nodes.ravel() for solid in system.solids.values()]))
    scale = float(np.hypot(*state.v.T).max())
    if system.fluid is not None:
        scale += largest(idle(system, system.fluid, state)[0])
    if (increment := system.increment) is not None:
        # In steady systems all nodes: the values that a boundary prescribes are zero too.
        nodes = nodes[system.rows.kinematics[nodes]]
        step, ends = increment.step, [state.u, increment.old.u]
        scale = largest([scale, *(np.abs(step.rate(*ends)[nodes]).ravel()), ROUNDING * np.abs(ends).max() / step.k])
    left = momentum.kinematics(system, nodes, state.u[nodes], state.v[nodes])
    return relative(largest(np.abs(left).ravel()), scale)
