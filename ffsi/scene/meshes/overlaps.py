"""Triangles that lie on each other without sharing an edge: what the topology does not tell."""

from __future__ import annotations

import numpy as np

from ffsi.scene.errors import short
from ffsi.scene.meshes.errors import fault, place
from ffsi.scene.meshes.topology import Topology

ROUNDING = 1e-11
"""What overlaps by less than this part of the mesh's area does not."""


def refuse_overlaps(topology: Topology, titles: list[str]) -> None:
    """Refuse triangles that overlap.

    Args:
        topology: the mesh, without folds, nodes at the same place and hanging nodes.
        titles: (nt,) what messages call the region of each triangle.

    Raises:
        MeshError: there are such triangles.
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
