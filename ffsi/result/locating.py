"""Which triangle a point lies in, whatever triangles there are: they may overlap, be turned over or have no area."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from ffsi.files.arrays import Floats, Ints

_TOLERANCE = 1e-8  # in barycentric coordinates: how far outside of a triangle still counts as on its edge
_AT_A_TIME = 100_000  # points
_FEW = 20_000_000  # points times triangles below which all are compared: that costs less than to load shapely


class Finder:
    """Finds triangles by a tree of their boxes."""

    def __init__(self, corners: Floats) -> None:
        """Make the tree of triangles with the corners (n, 3, 2), in any unit.

        Raises:
            ValueError: a coordinate is not finite.
        """
        if not np.isfinite(corners).all():
            raise ValueError("a node of the mesh has a coordinate that is not finite")
        self._corners = corners
        low, high = corners.min(axis=1), corners.max(axis=1)
        margin = 4 * _TOLERANCE * (high - low)
        self._low, self._high = low - margin, high + margin

    @cached_property
    def _tree(self) -> Any:
        import shapely

        return shapely.STRtree(shapely.box(*self._low.T, *self._high.T))

    def _boxes(self, at: Floats) -> tuple[Ints, Ints]:
        """Return pairs of a point and a triangle whose box it lies in."""
        if len(at) * len(self._corners) > _FEW:
            import shapely

            point, triangle = self._tree.query(shapely.points(at))
            return point, triangle
        (x, y), low, high = at.T[..., None], self._low.T, self._high.T
        point, triangle = np.nonzero((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]))
        return point, triangle

    def find(self, at: Floats) -> tuple[Ints, Floats]:
        """Return the triangle of each point (m,), -1 outside of all, and barycentric coordinates in it, (m, 3).

        Of several triangles it is the one in which the point lies deepest.

        Args:
            at: (m, 2) points in the unit of the corners; one that is not finite lies outside.
        """
        found, barycentric = np.full(len(at), -1, dtype=np.int64), np.zeros((len(at), 3))
        inside = np.flatnonzero(np.isfinite(at).all(axis=1))
        for first in range(0, len(inside), _AT_A_TIME):
            points = inside[first : first + _AT_A_TIME]
            point, triangle = self._boxes(at[points])
            coordinates = self._barycentric(at[points[point]], triangle)
            depth = coordinates.min(axis=1)
            order = np.lexsort((triangle, -depth, point))
            best = order[np.unique(point[order], return_index=True)[1]]
            best = best[depth[best] >= -_TOLERANCE]
            found[points[point[best]]], barycentric[points[point[best]]] = triangle[best], coordinates[best]
        return found, barycentric

    def _barycentric(self, at: Floats, triangle: Ints) -> Floats:
        origin, first, second = self._corners[triangle].transpose(1, 0, 2)
        a, b, d = first - origin, second - origin, at - origin
        area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            l1 = (d[:, 0] * b[:, 1] - d[:, 1] * b[:, 0]) / area
            l2 = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / area
        coordinates = np.stack([1 - l1 - l2, l1, l2], axis=1)
        coordinates[~np.isfinite(coordinates).all(axis=1)] = -np.inf  # without an area nothing is inside
        return coordinates
