"""Boundaries along which fluid, solids and mesh slide: what is left of vectors and equations at their nodes."""

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, RawMesh

_PARALLEL = 1e-8


def node_normals(mesh: RawMesh, labels: list[int]) -> tuple[Floats, NDArray[np.bool_]]:
    """Unit normals of edges with some labels at their P2 nodes, (n2, 2), zero elsewhere; and where two of them meet.

    The second array (n2,) is true at nodes of edges that are not parallel. The sign of a normal has no meaning.
    """
    chosen = np.isin(mesh.label, labels)
    start, end = mesh.vertices[mesh.edges[chosen]].transpose(1, 0, 2)
    normals = (end - start)[:, ::-1] * [1.0, -1.0] / np.hypot(*(end - start).T)[:, None]
    found, corner = np.zeros((mesh.n_p2, 2)), np.zeros(mesh.n_p2, dtype=np.bool_)
    for nodes, normal in zip(mesh.edge_nodes[chosen], normals, strict=True):
        known = found[nodes]
        corner[nodes] |= np.abs(known[:, 0] * normal[1] - known[:, 1] * normal[0]) > _PARALLEL
        found[nodes] = normal
    return found, corner


def along(vectors: Floats, normals: Floats) -> Floats:
    """Vectors (n, 2) without their part along normals (n, 2) that are unit vectors, or zero where all is left."""
    return vectors - across(vectors, normals) if normals.any() else vectors


def across(vectors: Floats, normals: Floats) -> Floats:
    """The part of vectors (n, 2) along normals (n, 2), zero where these are."""
    return np.asarray((vectors * normals).sum(axis=1, keepdims=True) * normals)
