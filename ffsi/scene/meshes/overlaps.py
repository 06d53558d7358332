"""Triangles that lie on each other without sharing an edge: what the topology does not tell.

Neighbours lie on different sides of their common edge, so the number of triangles over a point is the winding number
of the outer edges around it. It is nowhere above 1 if these edges meet at common nodes only, do not cross there, and no
piece of them lies within the mesh: three checks of the outer edges alone, exact for any shape of the triangles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ffsi.scene.errors import short
from ffsi.scene.meshes.errors import MeshError, fault, place
from ffsi.scene.meshes.topology import ON_EDGE, Topology

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def refuse_overlaps(topology: Topology, titles: list[str]) -> None:
    """Refuse triangles that overlap.

    Args:
        topology: the mesh, without folds, nodes at the same place and hanging nodes.
        titles: (nt,) what messages call the region of each triangle.

    Raises:
        MeshError: there are such triangles.
    """
    outer = np.flatnonzero(topology.right < 0)
    edges = topology.left[0][outer]
    ends = topology.points[edges]
    crossing = _crossing(edges, ends)
    if crossing is not None:
        first, second, point = crossing
        pair = topology.left[1][outer[[first, second]]]
        raise _overlap(topology, titles, point, int(pair[0]), int(pair[1]))
    inside = _crossing_at_node(edges, ends)
    if inside is None:
        inside = _within(edges, ends)
    if inside is not None:
        edge, point = inside
        triangle = int(topology.left[1][outer[edge]])
        raise _overlap(topology, titles, point, triangle, _triangle_over(topology, point, triangle))


def _crossing(edges: Ints, ends: Floats) -> tuple[int, int, Floats] | None:
    """Return two edges that cross between their ends, and where; None if there are none.

    Edges of about the same length have a tree of their own: a few long ones do not make all neighbourhoods large.
    """
    middle, half = ends.mean(axis=1), 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    level = np.ceil(np.log2(half))
    for value in np.unique(level):
        members = np.flatnonzero(level == value)
        others = np.flatnonzero(level <= value)
        near = KDTree(middle[members]).query_ball_point(middle[others], half[others] + half[members].max())
        first = np.repeat(others, [len(found) for found in near])
        second = members[np.concatenate(near).astype(np.int64)]
        apart = (edges[first][:, :, None] != edges[second][:, None, :]).all(axis=(1, 2))
        first, second = first[apart], second[apart]
        a, b = _sides(ends[first], ends[second]), _sides(ends[second], ends[first])
        # Ends that lie on an edge are those of hanging nodes, which have a message of their own.
        cross = (a.prod(axis=1) < 0) & (b.prod(axis=1) < 0) & (np.abs([a, b]) > ON_EDGE).all(axis=(0, 2))
        if cross.any():
            k = int(np.argmax(cross))
            (start, end), (s, t) = ends[second[k]], a[k]
            return int(first[k]), int(second[k]), start + (end - start) * s / (s - t)
    return None


def _sides(edges: Floats, others: Floats) -> Floats:
    """Return how far the ends of others (n, 2, 2) are on the left of edges (n, 2, 2), in lengths of the edge (n, 2)."""
    along = (edges[:, 1] - edges[:, 0])[:, None]
    offset = others - edges[:, :1]
    return np.asarray(_cross(along, offset) / (along**2).sum(axis=2))


def _crossing_at_node(edges: Ints, ends: Floats) -> tuple[int, Floats] | None:
    """Return an edge that starts within the triangles around its first node, and a point of it near there."""
    count = len(edges)
    node = edges.T.ravel()
    along = np.concatenate([ends[:, 1] - ends[:, 0], ends[:, 0] - ends[:, 1]])
    order = np.lexsort((np.arctan2(along[:, 1], along[:, 0]), node))
    node, leaves = node[order], order < count
    # Counter-clockwise around a node triangles begin at an edge that leaves it and end at one that arrives.
    twice = (node[1:] == node[:-1]) & leaves[1:] & leaves[:-1]
    if not twice.any():
        return None
    edge = int(order[1:][twice][0])
    return edge, ends[edge, 0] + 1e-3 * along[edge]


def _within(edges: Ints, ends: Floats) -> tuple[int, Floats] | None:
    """Return an edge with triangles on its right, and its middle; edges do not cross, so one of each piece tells."""
    _, node = np.unique(edges, return_inverse=True)
    pairs = node.reshape(-1, 2).T
    size = int(pairs.max()) + 1
    piece = connected_components(coo_array((np.ones(len(edges)), tuple(pairs)), shape=(size, size)), directed=False)[1]
    for edge in np.unique(piece[pairs[0]], return_index=True)[1].tolist():
        middle = ends[edge].mean(axis=0)
        a, b = (ends[:, k] - middle for k in range(2))
        angle = np.arctan2(_cross(a, b), (a * b).sum(axis=1))
        angle[edge] = 0.0  # between pi on its left and -pi on its right: half a turn more than around the right side
        if angle.sum() > 2 * np.pi:
            return edge, middle
    return None


def _triangle_over(topology: Topology, point: Floats, other_than: int) -> int:
    """Return the triangle in which a point (2,) lies deepest, apart from one."""
    corners = topology.points[topology.triangles]
    following = np.roll(corners, -1, axis=1)
    depth = _cross(following - corners, point - corners).min(axis=1) / _cross(
        corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    )
    depth[other_than] = -np.inf
    return int(np.argmax(depth))


def _overlap(topology: Topology, titles: list[str], point: Floats, first: int, second: int) -> MeshError:
    rounding = 1e-12 * np.abs(topology.points).max()
    where = place(np.where(np.abs(point) < rounding, 0.0, point), topology.unit)
    what = " and ".join(
        f"one of {short(titles[t])} with the corners {topology.triangle_at(t)}" for t in (first, second)
    )
    accepted = "accepted: regions that cover each place once and share the nodes of their boundaries (in Gmsh: "
    return fault(f"two triangles overlap at {where}, {what}; {accepted}BooleanFragments)")


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
