"""Edges of a triangle mesh, and the checks that need no names: areas, overlaps, hanging and double nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ffsi.files.arrays import Floats, Ints
from ffsi.scene.errors import count, fault, names, place, short

Flags = NDArray[np.bool_]

FLAT = 1e-8
"""A triangle whose area is below this part of the square of its longest side has none."""
CLOSE = 1e-9
"""Nodes nearer than this part of the domain's size are at the same place."""
ON_EDGE = 1e-6
"""A node nearer to an edge than this part of the edge's length lies on it."""
ROUNDING = 1e-11
"""What overlaps by less than this part of the mesh's area does not."""


def cross(a: Floats, b: Floats) -> Floats:
    """Return the products a x b (...,) of vectors (..., 2), positive where b points to the left of a."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def areas(points: Floats, triangles: Ints) -> Floats:
    """Return the areas (nt,) of triangles, below zero where they run clockwise."""
    corners = points[triangles]
    return 0.5 * cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@dataclass(frozen=True)
class Topology:
    """Triangles (nt, 3) that run counter-clockwise, and their edges; each point (n, 2), in a unit, is used by one."""

    points: Floats
    triangles: Ints
    unit: str

    @cached_property
    def sides(self) -> Ints:
        """(3 nt, 2) the sides of all triangles, each with its triangle on the left; side k of triangle t is 3 t + k."""
        return np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2).reshape(-1, 2)

    @cached_property
    def unique(self) -> tuple[Ints, Ints, Ints]:
        """(ne,) keys of the edges in ascending order, (3 nt,) the edge of each side, (ne,) number of sides per edge."""
        keys = self.keys(self.sides)
        found, edge_of_side, counts = np.unique(keys, return_inverse=True, return_counts=True)
        return found, edge_of_side.ravel(), counts

    def keys(self, pairs: Ints) -> Ints:
        """Return one number per pair of points (k, 2), the same in both directions."""
        return np.asarray(pairs.min(axis=1) * len(self.points) + pairs.max(axis=1))

    @cached_property
    def left(self) -> tuple[Ints, Ints]:
        """(ne, 2) the edges in the direction of a triangle on their left, and that triangle (ne,)."""
        _, edge_of_side, counts = self.unique
        side = np.full(len(counts), -1, dtype=np.int64)
        side[edge_of_side[::-1]] = np.arange(len(edge_of_side))[::-1]
        return self.sides[side], side // 3

    @cached_property
    def right(self) -> Ints:
        """(ne,) the triangle on the other side of each edge, -1 at the domain's boundary."""
        _, edge_of_side, _ = self.unique
        triangle = np.full(len(self.left[1]), -1, dtype=np.int64)
        owner = np.repeat(np.arange(len(self.triangles)), 3)
        other = owner != self.left[1][edge_of_side]
        triangle[edge_of_side[other]] = owner[other]
        return triangle

    @cached_property
    def neighbours(self) -> Ints:
        """(k, 2) the triangles on both sides of each inner edge."""
        return np.stack([self.left[1], self.right], axis=1)[self.right >= 0]

    @cached_property
    def middles(self) -> Floats:
        """(ne, 2) the middles of the edges."""
        return np.asarray(self.points[self.left[0]].mean(axis=1))

    @cached_property
    def lengths(self) -> Floats:
        """(ne,) the lengths of the edges."""
        edges = self.points[self.left[0]]
        return np.asarray(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))

    def find(self, pairs: Ints) -> Ints:
        """Return the numbers of the edges between pairs of points (k, 2), -1 where there is no such edge."""
        known, keys = self.unique[0], self.keys(pairs)
        position = np.minimum(np.searchsorted(known, keys), len(known) - 1)
        return np.where(known[position] == keys, position, -1)

    def components(self, chosen: Flags) -> Ints:
        """Return, for each chosen triangle, the number of its part; parts are connected by common edges."""
        a, b = (np.cumsum(chosen) - 1)[self.neighbours[chosen[self.neighbours].all(axis=1)]].T
        size = int(chosen.sum())
        graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(size, size))
        return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)

    def at(self, point: int) -> str:
        """Return a point's place in words."""
        return place(self.points[point], self.unit)

    def triangle_at(self, triangle: int) -> str:
        """Return the corners of a triangle in words."""
        return ", ".join(self.at(point) for point in self.triangles[triangle])


def counter_clockwise(points: Floats, triangles: Ints, unit: str) -> tuple[Topology, Flags]:
    """Turn all triangles counter-clockwise (how a file writes a surface has no meaning); tell which (nt,) were turned.

    Raises:
        SceneError: a triangle has no area.
    """
    corners, area = points[triangles], areas(points, triangles)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = np.flatnonzero(np.abs(area) <= FLAT * longest**2)
    turned = area < 0
    topology = Topology(points, np.where(turned[:, None], triangles[:, ::-1], triangles), unit)
    if flat.size:
        where = topology.triangle_at(flat[0])
        raise fault(f"{count(flat.size, 'triangle')} without area, the first with the corners {where}")
    return topology, turned


def refuse_folds(topology: Topology, turned: Flags, region: Ints) -> None:
    """Refuse more than two triangles at an edge, folds, and single inverted triangles.

    An inverted triangle runs the other way round than most others of its region (nt,); turned: (nt,) which triangles
    run clockwise in the file.

    Raises:
        SceneError: there are such triangles.
    """
    _, edge_of_side, at_edge = topology.unique
    if (at_edge > 2).any():
        where = place(topology.middles[np.argmax(at_edge > 2)], topology.unit)
        raise fault(f"more than two triangles share the edge at {where}")
    unusual = turned != (2 * np.bincount(region, turned) > np.bincount(region))[region]
    # Where all triangles run counter-clockwise, two neighbours run through their edge in opposite directions.
    sides, edges = topology.sides, topology.left[0]
    owner = np.repeat(np.arange(len(topology.triangles)), 3)
    second = owner != topology.left[1][edge_of_side]
    same = second & (sides[:, 0] == edges[edge_of_side, 0])
    if same.any():
        side = int(np.argmax(same))
        pair = np.array([owner[side], topology.left[1][edge_of_side[side]]])
        where = topology.triangle_at(pair[np.argmax(unusual[pair])])
        raise fault(f"inverted triangle with the corners {where}: it overlaps its neighbours")
    _refuse_inverted(topology, turned, region, unusual)


def _refuse_inverted(topology: Topology, turned: Flags, region: Ints, unusual: Flags) -> None:
    """Refuse triangles that run the other way round than all their neighbours in the region.

    Not more: meshers write a whole surface clockwise where its outline was drawn so, also one of several in a region.
    """
    pairs = topology.neighbours
    pairs = pairs[region[pairs[:, 0]] == region[pairs[:, 1]]]
    differ = turned[pairs[:, 0]] != turned[pairs[:, 1]]
    size = len(region)
    neighbours, others = (np.bincount(chosen.ravel(), minlength=size) for chosen in (pairs, pairs[differ]))
    inverted = (neighbours > 0) & (others == neighbours)
    if not inverted.any():
        return
    inverted &= unusual | ~(inverted & unusual).any()
    ways = ["clockwise", "counter-clockwise"]
    triangle = int(np.argmax(inverted))
    if not turned[triangle]:
        ways.reverse()
    number = count(int(inverted.sum()), "inverted triangle")
    where = topology.triangle_at(triangle)
    raise fault(f"{number}, the first with the corners {where}: it runs {ways[0]}, its neighbours {ways[1]}")


def refuse_gaps(topology: Topology, titles: list[str]) -> None:
    """Refuse nodes at the same place, and nodes on the inside of another triangle's edge.

    Args:
        topology: the mesh.
        titles: (nt,) what messages call the region of each triangle.

    Raises:
        SceneError: there are such nodes.
    """
    points = topology.points
    outer = np.flatnonzero(topology.right < 0)
    rim = np.unique(topology.left[0][outer])
    tree = KDTree(points[rim])
    size = float(np.ptp(points, axis=0).max())
    twins = tree.query_pairs(CLOSE * size, output_type="ndarray")
    if len(twins):
        a, b = rim[twins[0]]
        where = f"{count(len(twins), 'place')} with two nodes, the first at {topology.at(a)}"
        both = sorted(_regions_at(topology, titles, a) | _regions_at(topology, titles, b))
        if len(both) > 1:
            text = f"the regions {names(both)} do not share the nodes of their common boundary"
            raise fault(f"{text}: {where} (in Gmsh: BooleanFragments, or Coherence Mesh)")
        raise fault(f"the mesh is cut: {where}")
    near = tree.query_ball_point(topology.middles[outer], 0.5 * topology.lengths[outer], return_sorted=True)
    hanging = [
        (int(node), int(edge))
        for edge, found in zip(outer, near, strict=True)
        for node in rim[found]
        if node not in topology.left[0][edge] and _distance(points, node, topology.left[0][edge]) < ON_EDGE
    ]
    if hanging:
        node, edge = hanging[0]
        ends = " and ".join(topology.at(end) for end in topology.left[0][edge])
        text = f"{count(len(hanging), 'hanging node')}, the first at {topology.at(node)}"
        raise fault(f"{text}, on the triangle side between {ends}, of which it is no end")


def _regions_at(topology: Topology, titles: list[str], point: int) -> set[str]:
    """Return the names of the regions that use a point."""
    return {titles[t] for t in np.flatnonzero((topology.triangles == point).any(axis=1))}


def _distance(points: Floats, node: int, edge: Ints) -> float:
    """Return how far a node is from the inside of an edge, in lengths of the edge."""
    start, along = points[edge[0]], points[edge[1]] - points[edge[0]]
    offset = points[node] - start
    square = float(along @ along)
    if not 0.0 < float(offset @ along) < square:
        return np.inf
    return abs(float(cross(along, offset))) / square


def refuse_overlaps(topology: Topology, titles: list[str]) -> None:
    """Refuse triangles that overlap, in a mesh without folds, nodes at the same place and hanging nodes.

    Raises:
        SceneError: there are such triangles, which messages call by the titles (nt,) of their regions.
    """
    import shapely

    # Neighbours lie on different sides of their common edge, so the number of triangles over a point is the winding
    # number of the outer edges around it. Where these do not cross, and what they enclose an odd number of times is as
    # large as all triangles together, it is nowhere above 1.
    outer = shapely.multilinestrings(topology.points[topology.left[0][topology.right < 0]])
    triangles = shapely.polygons(topology.points[topology.triangles])
    area = float(shapely.area(triangles).sum())
    if shapely.is_simple(outer) and abs(shapely.area(shapely.build_area(outer)) - area) <= ROUNDING * area:
        return
    first = int(np.argmin(shapely.is_empty(shapely.coverage_invalid_edges(triangles))))
    near = shapely.STRtree(triangles).query(triangles[first])
    common = shapely.intersection(triangles[first], triangles[near[near != first]])
    second = int(np.argmax(shapely.area(common)))
    point = np.ravel(shapely.get_coordinates(shapely.point_on_surface(common[second])))
    where = place(np.where(np.abs(point) < 1e-12 * np.abs(topology.points).max(), 0.0, point), topology.unit)
    what = " and ".join(
        f"one of {short(titles[t])} with the corners {topology.triangle_at(t)}"
        for t in (first, int(near[near != first][second]))
    )
    accepted = "accepted: regions that cover each place once and share the nodes of their boundaries (in Gmsh: "
    raise fault(f"two triangles overlap at {where}, {what}; {accepted}BooleanFragments)")
