"""Sizes of the single contributions to a row, before they cancel: a part of them is rounding, whatever is left.

Every size follows from the problem and the state, in their units.
"""

import numpy as np

from ffsi.files.arrays import Floats, RawState, distinct
from ffsi.reference import momentum
from ffsi.reference.elements import Elements, scatter
from ffsi.reference.relative import largest
from ffsi.reference.system import FluidPart, SolidPart, System

# Below this part of the contributions that cancel in it, a scale is rounding: times the tolerance, 1e-8, some rounding
# errors.
ROUNDING = 1e-7
# The same of rows whose terms all vanish in an even field, a plug flow or a mesh that is stretched: times the tolerance
# what the steps of a run are solved to, some 1e-13 of the velocity and 1e-12 of the mesh's displacement.
EVEN = 1e-4
# A solver balances pressures and loads to more digits than the tolerance asks for. What this part of them would drive
# alone is no motion of a fluid into which nothing comes.
_UNBALANCED = 1e-4
# Prescribed velocities below this part of the mean one are an inflow that passes through zero.
_PASSING = 1e-10


def idle(system: System, fluid: FluidPart, state: RawState) -> tuple[Floats, Floats]:
    """Return scales of what rounding drives in a fluid's triangles: speed (n,) m/s and force (n,) N per metre depth.

    A fluid into which nothing comes has no velocity of its own; both are zero where something comes in.
    """
    elements, rows = fluid.elements, system.rows
    prescribed = float(np.abs(rows.prescribed.v[rows.v_given]).max(initial=0.0))
    if prescribed > _PASSING * abs(system.problem.mean_velocity or 0.0):
        return np.zeros(len(elements)), np.zeros(len(elements))
    width = np.sqrt(elements.area)
    wet = state.p[distinct(elements.vertices)]
    loads = [float((_solid(solid, state) / np.sqrt(solid.elements.area)).max()) for solid in system.solids.values()]
    pressure = ROUNDING * (float(np.abs(wet).max()) + sum(loads))
    resistance = _viscosity(fluid, state)
    if (increment := system.increment) is not None:
        resistance = resistance + fluid.law.density * elements.area / increment.step.k
    driven = pressure + _UNBALANCED * float(np.abs(wet - reference_pressure(fluid, state)).max())
    return driven * width / resistance, pressure * width


def reference_pressure(fluid: FluidPart, state: RawState) -> float:
    """Mean pressure: a constant one does no work on a fluid that fills a room, however high it is."""
    elements = fluid.elements
    return float(elements.area @ state.p[elements.vertices].mean(axis=1) / elements.area.sum())


def travelled(system: System, *, terms: bool = False) -> list[float]:
    """Largest u, v so far of walls that the mesh follows; with ``terms`` of what cancels in them.

    That is no less: where a wall comes back the terms of its motion cancel, those of a spline from the start.
    """
    mesh, increment = system.mesh, system.increment
    values = [[0.0, 0.0]]
    for b in system.problem.boundaries:
        if increment is not None and b.displacement and b.motion:
            points = mesh.p2_coordinates[distinct(mesh.edge_nodes[mesh.label == b.label])]
            end = max(increment.step.time, b.sampled if terms else 0.0)
            for t in np.linspace(0.0, end, 33).tolist():
                values.append([float(np.abs(of(points, t)).max()) for of in (b.displacement, b.motion)])
    return [largest(column) for column in zip(*values, strict=True)]


def unknown_sizes(system: System, state: RawState) -> tuple[float, float, float, float]:
    """Sizes of u, v, p and ps, in their units; zero where nothing gives one.

    Of v the largest velocity V of the fields and of the displacement, the mean velocity of the inflow and that so far
    of walls that the mesh follows at least; of u its way V k in a step, or the extent of a steady scene; of p the
    largest pressure, rho V^2 at least, and of ps that or its own largest.
    """
    densities = [part.law.density for part in ([system.fluid] if system.fluid else []) + list(system.solids.values())]
    states, speeds = [state], [abs(system.problem.mean_velocity or 0.0)]
    way = float(np.ptp(system.mesh.vertices, axis=0).max())
    if (increment := system.increment) is not None:
        states.append(increment.old)
        speeds.append(travelled(system)[1])
        speeds.append(float(np.abs((state.u - increment.old.u) / increment.step.k).max()))
    speed = largest([*speeds, *(float(np.abs(each.v).max()) for each in states)])
    if increment is not None:
        way = speed * increment.step.k
    pressure = largest([max(densities) * speed**2, *(float(np.abs(each.p).max(initial=0.0)) for each in states)])
    solid_pressure = largest([pressure, *(float(np.abs(each.ps).max(initial=0.0)) for each in states)])
    return way, speed, pressure, solid_pressure


def momentum_sizes(system: System, state: RawState) -> tuple[Floats, Floats]:
    """Size of the single nodal contributions to a momentum row, (n2, 2) N per metre depth: of the fluid, and of all.

    Of a time step the contributions of both ends. The displacement of a solid has the rounding of the largest one: in
    a linear system with all unknowns the noise of one is that of all.
    """
    states = [state] if system.increment is None else [state, system.increment.old]
    fluid, solids = np.zeros_like(state.u), np.zeros_like(state.u)
    if (part := system.fluid) is not None:
        fluid += sum(_fluid(system, part, each) for each in states) + _inertia(system, part, states)
    for solid in system.solids.values():
        size = np.sum([_solid(solid, each) for each in states], axis=0)
        solids += spread(size, solid.elements, system.mesh.n_p2) + _inertia(system, solid, states)
    return fluid, fluid + solids


def _inertia(system: System, part: FluidPart | SolidPart, states: list[RawState]) -> Floats:
    """Size of what cancels in the difference quotient of v in a time step, (n2, 2); zero in a steady system.

    It covers the convection by the mesh velocity too, as long as a step moves the mesh by less than a triangle.
    """
    if (increment := system.increment) is None:
        return np.zeros_like(states[0].u)
    speed = np.sum([largest_on(each.v, part.elements) for each in states], axis=0)
    return spread(part.law.density / increment.step.k * speed * part.elements.area, part.elements, system.mesh.n_p2)


def _fluid(system: System, fluid: FluidPart, state: RawState) -> Floats:
    """Size of the single nodal contributions to a fluid momentum row, (n2, 2)."""
    elements, density = fluid.elements, fluid.law.density
    speed, width = largest_on(state.v, elements), np.sqrt(elements.area)
    pressure = np.abs(state.p[elements.vertices]).max(axis=1)
    weight = density * float(np.hypot(*system.problem.gravity)) * elements.area
    size = _viscosity(fluid, state) * speed + density * speed**2 * width + pressure * width + weight
    return spread(size, elements, len(state.u))


def _solid(solid: SolidPart, state: RawState) -> Floats:
    """Size of the single nodal contributions to a momentum row in each triangle of a solid, (n,)."""
    elements, material, moved = solid.elements, solid.law.mixed_material, float(np.abs(state.u).max())
    if material is None:
        return np.full(len(elements), solid.law.material.stiffness * moved)
    pressure = np.abs(momentum.solid_pressure(solid, state)).max(axis=1)
    return np.asarray(material.base_stiffness * moved + pressure * np.sqrt(elements.area))


def _viscosity(fluid: FluidPart, state: RawState) -> Floats:
    """Largest viscosity in each triangle of the fluid, (n,) Pa s."""
    return np.asarray(momentum.flow_of(fluid, state).viscosity(fluid.law.viscosity).max(axis=1), dtype=np.float64)


def largest_on(values: Floats, elements: Elements) -> Floats:
    """Largest absolute nodal component on each triangle, (n,)."""
    return np.asarray(np.abs(values[elements.nodes]).max(axis=(1, 2)))


def flux_sizes(speed: Floats, elements: Elements, nv: int) -> Floats:
    """Size of the single contributions to a row that balances fluxes of the size ``speed`` (n,), (nv, 1)."""
    size = speed * np.sqrt(elements.area)
    return scatter(np.repeat(size[:, None, None], 3, axis=1), elements.vertices, nv)


def spread(size: Floats, elements: Elements, n2: int) -> Floats:
    """Add one number per triangle, (n,), to all its P2 nodes and both components; (n2, 2)."""
    return scatter(np.repeat(size[:, None, None], 6, axis=1).repeat(2, axis=2), elements.nodes, n2)
