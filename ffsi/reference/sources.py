"""Sources of manufactured solutions, assembled on the reference domain."""

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.reference import terms
from ffsi.reference.assembly import scatter
from ffsi.reference.elements import Elements, gauss_rule, line_basis
from ffsi.reference.problem import FLUID_REGION, Field, Manufactured
from ffsi.reference.system import Sides, System, outline


def momentum_source(system: System, exact: Manufactured) -> Floats:
    """Work of force and traction with the sign of the residual, (n2, 2) newtons per metre depth.

    In a time step it is the weighted mean of both ends, like any other force that depends on the time.
    """
    if (increment := system.increment) is None:
        return _momentum_source(system, exact, 0.0)
    step = increment.step
    return step.mean(_momentum_source(system, exact, step.time), _momentum_source(system, exact, step.start))


def mass_source(system: System, mass: Field) -> Floats:
    """Source of the continuity with the sign of the residual, (nv, 1) square metres per second; at the new time."""
    if system.fluid is None:
        raise ValueError(f"{system.problem.name}: a source of mass, but no fluid")
    elements, time = system.fluid.elements, system.increment.step.time if system.increment else 0.0
    points = _points(system, elements)
    density = mass(points.reshape(-1, 2), time).reshape(points.shape[:2])
    local = -(density * elements.weights) @ elements.p1
    return scatter(local[..., None], elements.vertices, len(system.mesh.vertices))


def _momentum_source(system: System, exact: Manufactured, time: float) -> Floats:
    total = np.zeros((system.mesh.n_p2, 2))
    parts = {FLUID_REGION: system.fluid.elements} if system.fluid else {}
    for region, elements in (parts | {region: solid.elements for region, solid in system.solids.items()}).items():
        points = _points(system, elements)
        force = exact.force[region](points.reshape(-1, 2), time).reshape(points.shape)
        total -= scatter(terms.against_value(force, elements), elements.nodes, len(total))
        sides = outline(system.mesh, region)
        total -= scatter(_traction(system, sides, exact.stress[region], time), sides.nodes, len(total))
    return total


def _traction(system: System, sides: Sides, stress: Field, time: float) -> Floats:
    """Work of P N on each side of a region's boundary, (n, 3, 2)."""
    parameters, weights = gauss_rule()
    start = system.mesh.p2_coordinates[sides.nodes[:, 0]]
    points = start[:, None] + parameters[:, None] * sides.tangent[:, None]
    tensor = stress(points.reshape(-1, 2), time).reshape(*points.shape, 2)
    result: Floats = np.einsum("q,qa,nqij,nj->nai", weights, line_basis(parameters)[0], tensor, sides.normal)
    return result


def _points(system: System, elements: Elements) -> Floats:
    """Quadrature points of the triangles, (n, 7, 2) metres."""
    points: Floats = elements.p1 @ system.mesh.vertices[elements.vertices]
    return points
