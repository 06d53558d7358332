"""Effective (von Mises) stress in the walls, from the Cauchy stress in plane strain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, RawMesh, RawState
from ffsi.reference.from_scene import material_of
from ffsi.reference.materials import IDENTITY, SplitMaterial, dilatation, stress_across, transpose
from ffsi.result.gradients import NODES, mean_at_nodes, node_gradients
from ffsi.scene import Scene
from ffsi.scene.materials import Elastic

_SIDES = np.array([[1, 3, 2], [2, 4, 0], [0, 5, 1]])  # start, middle and end of its edges
_PIECES = 20  # of an edge, in which the end of a zone is looked for


def cauchy_stress(law: Elastic, gradient: Floats, pressure: Floats | None = None) -> Floats:
    """Return the Cauchy stress (n, 3, 3) in Pa of a solid, in plane stress per reference thickness; NaN where J <= 0.

    It is that of the checker's material, from grad u (n, 2, 2) and the pressure (n,) Pa of a mixed solid: P F^T / J,
    F = diag(I + grad u, 1), and across the plane the derivative of its energy. Raises ValueError if the checker does
    not know the material, or the energy of it is one of the plane alone.
    """
    material = material_of(law)
    first_piola, energy = material.first_piola, material.energy
    if pressure is not None:
        assert isinstance(material, SplitMaterial)
        first_piola, energy = material.base_stress, material.base_energy
    stress = np.zeros((len(gradient), 3, 3))
    stress[:, :2, :2] = first_piola(gradient) @ transpose(IDENTITY + gradient)
    if getattr(law, "plane", "strain") == "strain":
        stress[:, 2, 2] = stress_across(energy, gradient)
    stress /= 1.0 + np.real(dilatation(gradient))[:, None, None]
    if pressure is not None:
        stress -= pressure[:, None, None] * np.eye(3)
    return stress


def von_mises(stress: Floats) -> Floats:
    """Return the effective stress (n,) in Pa: the root of 3/2 s:s, s the deviator of a stress (n, 3, 3)."""
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    return np.asarray(np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator)))


def effective_stress(scene: Scene, mesh: RawMesh, state: RawState) -> dict[str, Floats]:
    """Return the effective stress of each solid at the P2 nodes, (n2,) Pa, NaN outside of it.

    At a node it is the mean over the solid's triangles around it, weighted by their areas.
    """
    found = {}
    mixed = iter(range(len(state.ps)))
    for region, (name, law) in enumerate(scene.solid.items(), start=2):
        triangles = np.flatnonzero(mesh.region == region)
        corners = mesh.vertices[mesh.triangles[triangles]]
        gradient, area = node_gradients(corners)
        nodes = mesh.p2[triangles]
        deformation = np.einsum("tai,tmaj->tmij", state.u[nodes], gradient)
        pressure = None
        if law.mixed:
            pressure = (state.ps[next(mixed)][mesh.triangles[triangles]] @ NODES.T).ravel()
        stress = von_mises(cauchy_stress(law, deformation.reshape(-1, 2, 2), pressure))
        found[name] = mean_at_nodes(nodes, stress.reshape(-1, 6), area, mesh.n_p2)
    return found


def largest_beyond(
    mesh: RawMesh, inside: NDArray[np.bool_], values: Floats, beyond: Callable[[Floats], Floats]
) -> float:
    """Return the largest value on those parts of the triangles' edges that lie beyond a zone.

    Towards a corner the stress rises up to the zone's end: the largest value at a node would depend on how near to it a
    node happens to lie. So edges are cut there. It is NaN if a value is; ValueError is raised if nothing lies beyond.

    `inside` (n_triangles,) tells which triangles count, `values` (n2,) are quadratic along an edge, and `beyond` maps
    reference points (..., 2) to how far they are beyond the zone's end, negative in it.
    """
    nodes = mesh.p2[inside]
    edge = nodes[:, _SIDES].reshape(-1, 3)
    position, at = mesh.p2_coordinates, values[edge]
    share = np.linspace(0, 1, _PIECES + 1)
    distance = beyond(position[edge[:, :1]] + share[:, None] * (position[edge[:, 2:]] - position[edge[:, :1]]))
    found = _along(at[:, None], share)[distance >= 0]
    number, piece = np.nonzero(distance[:, :-1] * distance[:, 1:] < 0)
    first, last = distance[number, piece], distance[number, piece + 1]
    crossing = _along(at[number], share[piece] + first / (first - last) / _PIECES)
    if not found.size:
        raise ValueError("no edge lies beyond the zone around the corners")
    return float(np.concatenate([found, crossing]).max())


def _along(at: Floats, share: Floats) -> Floats:
    """Return the quadratic function with values (..., 3) at start, middle and end of an edge, at shares of it."""
    start, middle, end = np.moveaxis(at, -1, 0)
    return np.asarray(
        start * (1 - share) * (1 - 2 * share) + 4 * middle * share * (1 - share) + end * share * (2 * share - 1)
    )
