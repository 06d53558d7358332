"""Momentum and kinematics of a system on its triangles and sides, steady or of the system's time step.

What is assembled and what is differentiated both come from here. Local unknowns u, v are (n, k, 2), p is (n, 3).
"""

from collections.abc import Mapping

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawState
from ffsi.reference import terms
from ffsi.reference.conditions import Load, Outlet, Support
from ffsi.reference.elements import gauss_rule
from ffsi.reference.materials import Array
from ffsi.reference.problem import Fluid
from ffsi.reference.system import FluidPart, Sides, SolidPart, System


def fluid_momentum(system: System, fluid: FluidPart, u: Array, v: Array, flow: terms.Flow) -> Mapping[str, Array]:
    """Terms on each fluid triangle, (n, 6, 2); ``flow`` is that of u, v (n, 6, 2)."""
    gravity, elements = system.problem.gravity, fluid.elements
    if (increment := system.increment) is None:
        return terms.fluid_momentum(fluid.law, gravity, elements, flow)
    step, before = increment.step, flow_of(fluid, increment.old)
    mesh_velocity = elements.basis @ step.rate(u, increment.old.u[elements.nodes])
    return terms.fluid_step(fluid.law, gravity, elements, step, flow, before, mesh_velocity)


def solid_momentum(system: System, solid: SolidPart, u: Array, v: Array, p: Array) -> Mapping[str, Array]:
    """Terms on each triangle of a solid, (n, 6, 2), with its own pressure p (n, 3), or (n, 0) if it has none."""
    gravity, elements = system.problem.gravity, solid.elements
    if (increment := system.increment) is None:
        return terms.solid_momentum(solid.law, gravity, elements, u, p)
    old, nodes = increment.old, elements.nodes
    before, old_p = terms.Motion(old.u[nodes], old.v[nodes]), solid_pressure(solid, old)
    return terms.solid_step(solid.law, gravity, elements, increment.step, terms.Motion(u, v), before, p, old_p)


def solid_pressure(solid: SolidPart, state: RawState) -> Floats:
    """Pressure at the vertices of the solid's triangles, (n, 3) pascals; (n, 0) for a solid without one."""
    if solid.pressure is None:
        return np.zeros((len(solid.elements), 0))
    return np.asarray(state.ps[solid.pressure][solid.elements.vertices])


def outlet(system: System, law: Fluid, outlet: Outlet, sides: Sides, v: Array) -> Mapping[str, Array]:
    """Terms on the sides of the outlet, (n, 3, 2), with nodal velocities (n, 3, 2), but for the pressure."""

    def at(v: Array) -> dict[str, Array]:
        found = {}
        if outlet.kind != "zero-traction":
            found["outlet"] = terms.outlet(law.viscosity.outlet, v)
        if outlet.backflow:
            found["backflow"] = terms.backflow(outlet.backflow * law.density, sides.normal, v)
        return found

    now = at(v)
    if (increment := system.increment) is None:
        return now
    before = at(increment.old.v[sides.nodes])
    return {name: increment.step.mean(term, before[name]) for name, term in now.items()}


def outlet_pressure(system: System, outlet: Outlet, sides: Sides, v: Array) -> Array:
    """Work of the pressure at the outlet on its sides, (n, 3, 2); every velocity there has a part in it."""
    flow = terms.outlet_flow(sides.normal, v)
    if (increment := system.increment) is None:
        pressure = outlet.steady(flow)
    else:
        old_flow = terms.outlet_flow(sides.normal, increment.old.v[sides.nodes])
        pressure = outlet.during(increment.step, flow, old_flow, increment.reservoirs.get(outlet.name, 0.0))
    return terms.outlet_pressure(sides.normal, pressure)


def column_pressure(system: System, law: Fluid, sides: Sides) -> Array:
    """Work of the pressure of a column of fluid behind the outlet on its sides, (n, 3, 2); they do not move."""
    points = gauss_rule(3)[0]
    start = system.mesh.p2_coordinates[sides.nodes[:, 0]]
    places = start[:, None] + points[:, None] * sides.tangent[:, None]
    gravity = np.array(system.problem.gravity)
    highest = (system.mesh.p2_coordinates[sides.nodes] @ gravity).min(initial=np.inf)
    return terms.outlet_pressure(sides.normal, law.density * (places @ gravity - highest))


def support(system: System, held: Support, edges: Ints, u: Array, v: Array) -> Array:
    """Support of the edges with P2 nodes (n, 3), ends and middle, (n, 3, 2)."""
    start, end = system.mesh.p2_coordinates[edges[:, :2]].transpose(1, 0, 2)
    length = np.hypot(*(end - start).T)
    if (increment := system.increment) is None:
        return terms.support(held, length, u, np.zeros_like(v))
    step, old = increment.step, increment.old
    return terms.support(held, length, step.mean(u, old.u[edges]), step.mean(v, old.v[edges]))


def load(system: System, acting: Load, sides: Sides, u: Array) -> Array:
    """Work of a load on sides of a solid with nodal displacements u (n, 3, 2), (n, 3, 2); in a step that in between."""
    nodes, time = sides.nodes, 0.0
    if (increment := system.increment) is not None:
        u, time = increment.step.mean(u, increment.old.u[nodes]), increment.step.between
    factor = 1.0 if increment is None else acting.factor(time)
    ends = system.mesh.p2_coordinates[nodes] + (u if acting.follows else np.zeros_like(u))
    x, y = acting.traction
    dead = terms.traction((factor * x, factor * y), np.hypot(*sides.tangent.T))
    return dead - terms.side_pressure(ends, factor * acting.pressure)


def supports(system: System) -> list[tuple[Support, Ints]]:
    """What holds boundaries elastically, each with the P2 nodes (n, 3) of its edges."""
    mesh, common = system.mesh, system.problem.support
    found = [(common, mesh.edge_nodes[np.isin(mesh.label, system.problem.labels("supported"))])] if common else []
    return found + [(load.held, sides.nodes) for load, sides in system.loaded if load.held is not None]


def kinematics(system: System, nodes: Ints, u: Array, v: Array) -> Array:
    """What must vanish at nodes of a solid, m/s in the shape of u and v there: v, in a time step du/dt - v."""
    if (increment := system.increment) is None:
        return v
    step, old = increment.step, increment.old
    return step.rate(u, old.u[nodes]) - step.mean(v, old.v[nodes])


def stress_work(system: System, state: RawState, fluid_size: Floats, size: Floats) -> dict[str, tuple[float, float]]:
    """Work of the solids' and of the fluid's stress in a time step, J per metre depth, and the size of what is summed.

    ``elastic`` is that on the displacement, ``dissipated`` that on the mean of both velocities. The sizes (n2, 2) are
    those of the momentum of the fluid and of all: what cancels in a stress is more than what is left of it, and a small
    change of a large displacement has the rounding of that.
    """
    if (increment := system.increment) is None:
        return {}
    step, old = increment.step, increment.old
    moved, travelled = state.u - old.u, step.k * step.mean(state.v, old.v)
    elastic = dissipated = 0.0
    for solid in system.solids.values():
        nodes = solid.elements.nodes
        local = solid_momentum(system, solid, state.u[nodes], state.v[nodes], solid_pressure(solid, state))
        if (rate := solid.law.mass_damping) != 0.0:
            mean = solid.elements.basis @ step.mean(state.v, old.v)[nodes]
            power = rate * solid.law.density * (mean**2).sum(axis=-1) * solid.elements.weights
            dissipated += step.k * float(power.sum())
        elastic += sum(float((local[name] * moved[nodes]).sum()) for name in local.keys() - {"gravity", "inertia"})
    if (fluid := system.fluid) is not None:
        nodes = fluid.elements.nodes
        local = fluid_momentum(system, fluid, state.u[nodes], state.v[nodes], flow_of(fluid, state))
        dissipated += sum(float((local[name] * travelled[nodes]).sum()) for name in ("pressure", "viscosity"))
    return {
        "elastic": (elastic, float(((size - fluid_size) * (np.abs(state.u) + np.abs(old.u))).sum())),
        "dissipated": (dissipated, float((fluid_size * np.abs(travelled)).sum())),
    }


def flow_of(fluid: FluidPart, state: RawState) -> terms.Flow:
    """Return the flow of a state at the quadrature points."""
    elements, nodes = fluid.elements, fluid.elements.nodes
    return terms.Flow.at_points(elements, state.u[nodes], state.v[nodes], state.p[elements.vertices])
