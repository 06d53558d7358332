"""Momentum and kinematics of a system on its triangles and sides, steady or of the system's time step.

What is assembled and what is differentiated both come from here. Local unknowns u, v are (n, k, 2), p is (n, 3).
"""

from collections.abc import Mapping

import numpy as np

from ffsi.rawfiles import Floats, Ints, RawState
from ffsi.reference import terms
from ffsi.reference.materials import Array
from ffsi.reference.system import FluidPart, SolidPart, System


def fluid_momentum(system: System, fluid: FluidPart, u: Array, v: Array, flow: terms.Flow) -> Mapping[str, Array]:
    """Terms on each fluid triangle, (n, 6, 2); ``flow`` is that of u, v (n, 6, 2)."""
    gravity, elements = system.problem.gravity, fluid.elements
    if (increment := system.increment) is None:
        return terms.fluid_momentum(fluid.law, gravity, elements, flow)
    step, before = increment.step, old_flow(fluid, increment.old)
    mesh_velocity = elements.basis @ step.rate(u, increment.old.u[elements.nodes])
    return terms.fluid_step(fluid.law, gravity, elements, step, flow, before, mesh_velocity)


def solid_momentum(system: System, solid: SolidPart, u: Array, v: Array, p: Array) -> Mapping[str, Array]:
    """Terms on each triangle of a solid, (n, 6, 2), with its own pressure p (n, 3), or (n, 0) if it has none."""
    gravity, elements = system.problem.gravity, solid.elements
    if (increment := system.increment) is None:
        return terms.solid_momentum(solid.law, gravity, elements, u, p)
    before, old_p = old_motion(increment.old, elements.nodes), solid_pressure(solid, increment.old)
    return terms.solid_step(solid.law, gravity, elements, increment.step, terms.Motion(u, v), before, p, old_p)


def solid_pressure(solid: SolidPart, state: RawState) -> Floats:
    """Pressure at the vertices of the solid's triangles, (n, 3) pascals; (n, 0) for a solid without one."""
    if solid.pressure is None:
        return np.zeros((len(solid.elements), 0))
    pressure: Floats = state.ps[solid.pressure][solid.elements.vertices]
    return pressure


def outlet(system: System, fluid: FluidPart, nodes: Ints, v: Array) -> Array:
    """Do-nothing outlet on sides with the P2 nodes (n, 3), (n, 3, 2)."""
    now = terms.outlet(fluid.law.viscosity.outlet, v)
    if (increment := system.increment) is None:
        return now
    return increment.step.mean(now, terms.outlet(fluid.law.viscosity.outlet, increment.old.v[nodes]))


def kinematics(system: System, nodes: Ints, u: Array, v: Array) -> Array:
    """What must vanish at nodes of a solid, metres per second, in the shape of u and v at ``nodes``."""
    if (increment := system.increment) is None:
        return v
    return terms.kinematics(increment.step, terms.Motion(u, v), old_motion(increment.old, nodes))


def old_motion(old: RawState, nodes: Ints) -> terms.Motion:
    """Return the nodal values of the state at the start of the step."""
    return terms.Motion(old.u[nodes], old.v[nodes])


def old_flow(fluid: FluidPart, old: RawState) -> terms.Flow:
    """Return the flow at the start of the step."""
    elements = fluid.elements
    return terms.Flow.at_points(elements, old.u[elements.nodes], old.v[elements.nodes], old.p[elements.vertices])
