"""Every quantity of a state that a script reports, from its raw unknowns: forces, displacements, pressures, smallest J.

Each comes with its size, that of what it is made of: a small part of it is rounding, and no difference.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsi.files.arrays import Floats, RawState, distinct
from ffsi.reference import momentum, terms
from ffsi.reference.elements import Elements
from ffsi.reference.forces import Forces, coefficient_scale
from ffsi.reference.materials import IDENTITY, determinant, double_dot
from ffsi.reference.relative import relative
from ffsi.reference.sizes import momentum_sizes
from ffsi.reference.system import System, place_in_solids

# Part of its size below which a quantity is rounding: times the tolerance, 1e-8, some rounding errors.
_ROUNDING = 1e-7
# Likewise of a force or a mean pressure, sums over many triangles or edges.
_OF_SUMS = 1e-6
# Likewise of a displacement inside a triangle, which may be 0 by symmetry: its place in it has the rounding of
# coordinates as large as the domain, hundreds of triangles.
_IN_A_TRIANGLE = 1e-5
# Two determinants whose difference is below this part of |F|^2 are equal: either is the smallest.
_TIE = 1e-12
# The ends of a diameter are vertices of the circle up to this part of its radius.
_ON_CIRCLE = 1e-6
# Likewise at the outlet: what is below is a difference of larger numbers.
_DIFFERENCE = 1e-4
_COMPONENTS = ("x", "y")


@dataclass(frozen=True)
class Quantity:
    """A recomputed ``value``, in SI, and the ``scale`` of its differences, in its unit."""

    value: float
    scale: float

    @classmethod
    def of(cls, value: float, size: float, rounding: float = _ROUNDING) -> "Quantity":
        """Return the quantity that is a sum of numbers as large as ``size``, the ``rounding`` part of it at least."""
        return cls(float(value), max(abs(float(value)), rounding * float(size)))

    def difference(self, reported: float) -> float:
        """Relative difference from what is reported."""
        return relative(reported - self.value, self.scale)


def recompute(
    system: System, state: RawState, forces: Forces, reported: Mapping[str, float] | None = None
) -> dict[str, Quantity]:
    """Return every quantity of ``state`` by the name that a script gives it; ``forces`` are those of the state.

    Several points may have the smallest J: of these the place is that nearest to the ``reported`` one.
    """
    found = _forces(system, forces) | _pressures(system, state) | _displacements(system, state)
    return found | _jacobians(system, state, reported or {})


def energies(system: System, state: RawState, before: Mapping[str, float]) -> dict[str, Quantity]:
    """Energies at the end of a time step, J per metre depth: the kinetic one, and the sums over all steps.

    ``before`` are the sums ``elastic`` and ``dissipated`` at its start; no other sum is recomputed.
    """
    kinetic = 0.0
    for part in ([system.fluid] if system.fluid else []) + list(system.solids.values()):
        elements, weights = part.elements, part.elements.weights
        if part is system.fluid:
            weights = _determinants(elements, state)[0] * weights
        squared_speed = ((elements.basis @ state.v[elements.nodes]) ** 2).sum(axis=-1)
        kinetic += 0.5 * part.law.density * float((squared_speed * weights).sum())
    found = {"kinetic": Quantity.of(kinetic, kinetic)}
    for name, (work, size) in momentum.stress_work(system, state, *momentum_sizes(system, state)).items():
        if name in before:
            found[name] = Quantity.of(before[name] + work, abs(before[name]) + size)
    return found


def _forces(system: System, forces: Forces) -> dict[str, Quantity]:
    """Drag and lift of each part and of all, in both forms, N per metre depth, and their coefficients."""
    if forces.total is None:
        return {}
    found: dict[str, Quantity] = {}
    parts = forces.parts.items() if len(forces.parts) > 1 else ()
    for name, force in [("", forces.total), *((f"_{name}", part) for name, part in parts)]:
        for form, values in (("", force.residual), ("_surface", force.surface)):
            for component, value in zip(("drag", "lift"), values.tolist(), strict=True):
                found[f"{component}{name}{form}"] = Quantity.of(value, force.size, _OF_SUMS)
    if unit := coefficient_scale(system):
        for name in ("drag", "lift"):
            found[f"{name}_coefficient"] = Quantity(found[name].value / unit, found[name].scale / unit)
    return found


def _pressures(system: System, state: RawState) -> dict[str, Quantity]:
    """Mean pressure at the inlet less that at the outlet; front less back of a whole cylinder."""
    if system.fluid is None:
        return {}
    size = float(np.abs(state.p).max())
    found = {}
    inlet, outlet = system.problem.labels("inlet"), system.problem.labels("outlet")
    if inlet and outlet:
        drop = _mean_pressure(system, state, inlet) - _mean_pressure(system, state, outlet)
        found["pressure_drop"] = Quantity.of(drop, size, _OF_SUMS)
    for boundary in system.problem.boundaries:
        if boundary.opening is not None:
            sides = system.fluid.sides.select(system.fluid.sides.label == boundary.label)
            flow = float(terms.outlet_flow(sides.normal, state.v[sides.nodes]))
            through = float(abs(state.v[sides.nodes]).max() * abs(sides.normal).sum())
            name, sign = boundary.opening
            found[f"flow_through_{name}"] = Quantity.of(sign * flow, through, _DIFFERENCE)
            own, increment = boundary.outlet, system.increment
            if own is not None and own.stores and increment is not None:
                old = increment.reservoirs[name]
                before = sign * float(terms.outlet_flow(sides.normal, increment.old.v[sides.nodes]))
                new = float(own.reservoir_after(increment.step, flow, before, old))
                found[f"windkessel_{name}"] = Quantity.of(new, max(abs(old), abs(new)), _DIFFERENCE)
            found[f"pressure_at_{name}"] = Quantity.of(_mean_pressure(system, state, [boundary.label]), size, _OF_SUMS)
        if boundary.name == "cylinder" and boundary.circle is not None:
            x, y, radius = boundary.circle
            wet = distinct(system.mesh.edges[system.mesh.label == boundary.label])
            off = [system.mesh.vertices[wet] - [x + side * radius, y] for side in (-1.0, 1.0)]
            ends = [wet[np.hypot(*each.T) <= _ON_CIRCLE * radius] for each in off]
            if all(len(end) for end in ends):  # what is fixed to the cylinder covers its back
                found["pressure_difference"] = Quantity.of(state.p[ends[0][0]] - state.p[ends[1][0]], size)
    return found


def _mean_pressure(system: System, state: RawState, labels: Sequence[int]) -> float:
    edges = system.mesh.edges[np.isin(system.mesh.label, labels)]
    start, end = system.mesh.vertices[edges].transpose(1, 0, 2)
    length = np.hypot(*(end - start).T)
    return float(length @ state.p[edges].mean(axis=1) / length.sum())


def _displacements(system: System, state: RawState) -> dict[str, Quantity]:
    """Displacement at the points that the problem names, in m."""
    size, found = float(np.abs(state.u).max()), {}
    for name, point in system.problem.points.items():
        nodes, basis = place_in_solids(system, point)
        displacement = basis @ state.u[nodes]
        for component, value in zip(_COMPONENTS, displacement.tolist(), strict=True):
            found[f"{name}_u{component}"] = Quantity.of(value, size, _IN_A_TRIANGLE)
    return found


def _jacobians(system: System, state: RawState, reported: Mapping[str, float]) -> dict[str, Quantity]:
    """Smallest J = det F of all, of the fluid and of the solids where there are both, and where each solid has it."""
    names = system.problem.names
    solids = {names.get(region, f"region {region}"): solid.elements for region, solid in system.solids.items()}
    fluid = {"fluid": system.fluid.elements} if system.fluid is not None else {}
    smallest = {name: _smallest(system, elements, state, name, reported) for name, elements in (fluid | solids).items()}
    groups = {"": [*smallest]}
    moves = system.fluid is not None and system.fluid.motion is not None
    if moves:
        groups |= {"_fluid": ["fluid"]} | ({"_solid": [*solids]} if solids else {})
    found = {}
    for ending, members in groups.items():
        value, size, _ = smallest[members[int(np.argmin([smallest[name][0] for name in members]))]]
        found[f"min_jacobian{ending}"] = Quantity.of(value, size)
    if solids or moves:
        extent = float(np.ptp(system.mesh.vertices, axis=0).max())
        for name, (_, _, place) in smallest.items():
            for component, value in zip(_COMPONENTS, place.tolist(), strict=True):
                found[f"min_jacobian_{name}_{component}"] = Quantity(value, max(extent, abs(value)))
    return found


def _smallest(
    system: System, elements: Elements, state: RawState, name: str, reported: Mapping[str, float]
) -> tuple[float, float, Floats]:
    """Smallest det F at the quadrature points, the size of its terms, and where: of equals, where it is reported."""
    jacobian, size = _determinants(elements, state)
    lowest = jacobian.argmin()
    equal = np.flatnonzero((jacobian <= jacobian.ravel()[lowest] + _TIE * size).ravel())
    triangle, point = np.divmod(equal, jacobian.shape[1])
    places = np.einsum("na,nai->ni", elements.p1[point], system.mesh.vertices[elements.vertices[triangle]])
    told = np.array([_number(reported.get(f"min_jacobian_{name}_{component}")) for component in _COMPONENTS])
    distance = np.hypot(*(places - told).T)
    nearest = 0 if np.isnan(distance).any() else int(distance.argmin())
    return float(jacobian.ravel()[lowest]), float(size.ravel()[lowest]), places[nearest]


def _determinants(elements: Elements, state: RawState) -> tuple[Floats, Floats]:
    """Det F and |F|^2 at the quadrature points, (n, 7)."""
    deformation = IDENTITY + terms.gradient_of(state.u[elements.nodes], elements.gradients)
    return np.real(determinant(deformation)), np.real(double_dot(deformation, deformation))


def at_outlet(system: System, state: RawState) -> dict[str, Quantity]:
    """Return what a state has at an outlet with a pressure, by name; nothing without one.

    The flow rate out, m2/s, and the pressure, Pa, those at the end of a step; of a Windkessel in a step that of the
    reservoir at both ends, Pa.
    """
    outlet = system.problem.outlet
    if system.fluid is None or outlet is None or not outlet.presses:
        return {}
    ((_, sides),) = system.outlets

    def flow_of(v: Floats) -> float:
        return float(terms.outlet_flow(sides.normal, v[sides.nodes]))

    flow = flow_of(state.v)
    through = float(abs(state.v[sides.nodes]).max() * abs(sides.normal).sum())
    found = {"flow_rate_out": Quantity.of(flow, through, _DIFFERENCE)}
    if (increment := system.increment) is None:
        size = abs(outlet.pressure) + (outlet.resistance + outlet.distal) * through
        return found | {"outlet_pressure": Quantity.of(float(outlet.steady(flow)), size, _DIFFERENCE)}
    step, old, new = increment.step, increment.reservoirs.get("", 0.0), 0.0
    if outlet.stores:
        new = float(outlet.reservoir_after(step, flow, flow_of(increment.old.v), old))
        size = max(abs(old), abs(new))
        ends = zip(("windkessel_old", "windkessel_new"), (old, new), strict=True)
        found |= {name: Quantity.of(pressure, size, _DIFFERENCE) for name, pressure in ends}
    size = abs(outlet.pressure_at(step.time)) + abs(new) + outlet.resistance * through
    return found | {"outlet_pressure": Quantity.of(outlet.at_end(step, flow, new), size, _DIFFERENCE)}


# Comparison -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Difference:
    """The worst quantity: its relative ``difference``, and ``words`` that name it and both values."""

    difference: float
    words: str


def compare(found: Mapping[str, Quantity], reported: Mapping[str, Any], needed: Collection[str] = ()) -> Difference:
    """Return the worst of the reported quantities.

    One that is not recomputed, and one of the ``needed`` that is not reported, differs infinitely.
    """
    worst = Difference(0.0, "")
    for name in [*reported, *(name for name in needed if name not in reported)]:
        if name not in found:
            now = Difference(math.inf, f"{name} is reported, which nobody recomputes")
        elif name not in reported:
            now = Difference(math.inf, f"{name} is not reported, recomputed {found[name].value:.12g}")
        else:
            value = _number(reported[name])
            words = f"{name} is reported as {reported[name]!r}, recomputed {found[name].value:.12g}"
            now = Difference(found[name].difference(value), words)
        if not now.difference <= worst.difference and not math.isnan(worst.difference):
            worst = now
    return worst


def _number(value: Any) -> float:
    """Value of a number, NaN of anything else."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
