"""Which triangle a point lies in, whatever triangles there are: they may overlap, be turned over or have no area."""

from __future__ import annotations

import numpy as np

from ffsi.files.arrays import Floats, Ints

_TOLERANCE = 1e-8  # in barycentric coordinates: how far outside of a triangle still counts as on its edge
_AT_A_TIME = 2_000_000  # pairs of a point and a triangle


class Finder:
    """Finds triangles by a grid with about as many cells as triangles; each cell knows those whose boxes touch it."""

    def __init__(self, corners: Floats) -> None:
        """Sort triangles into the grid.

        Args:
            corners: (n, 3, 2) coordinates, in any unit.

        Raises:
            ValueError: a coordinate is not finite.
        """
        if not np.isfinite(corners).all():
            raise ValueError("a node of the mesh has a coordinate that is not finite")
        self._corners = corners
        low, high = corners.min(axis=1), corners.max(axis=1)
        self._low = low.min(axis=0) if len(low) else np.zeros(2)
        size = high.max(axis=0) - self._low if len(high) else np.zeros(2)
        self._low = self._low - _TOLERANCE * size
        size = (1 + 2 * _TOLERANCE) * size
        ratio = size[0] / size[1] if size.all() else 1.0
        count = np.sqrt(len(corners) * np.array([ratio, 1 / ratio]))
        self._count = np.clip(count, 1, max(len(corners), 1)).astype(np.int64)
        self._step = np.where(size > 0, size / self._count, 1.0)
        margin = _TOLERANCE * (high - low)
        first, last = self._place(low - margin), self._place(high + margin)
        wide, tall = (last - first + 1).T
        triangle, k = _expand(wide * tall)
        cell = self._number(first[triangle] + np.column_stack([k % wide[triangle], k // wide[triangle]]))
        self._triangles = triangle[np.argsort(cell, kind="stable")]
        self._starts = np.searchsorted(np.sort(cell), np.arange(self._count.prod() + 1))

    def _place(self, at: Floats) -> Ints:
        """Return column and row (m, 2) of points, of those outside the nearest ones."""
        return np.clip((at - self._low) / self._step, 0, self._count - 1).astype(np.int64)

    def _number(self, place: Ints) -> Ints:
        return np.asarray(place[:, 0] + self._count[0] * place[:, 1])

    def find(self, at: Floats) -> tuple[Ints, Floats]:
        """Return the triangle of each point (m,), -1 outside of all, and barycentric coordinates in it, (m, 3).

        Of several triangles it is the one in which the point lies deepest.

        Args:
            at: (m, 2) points in the unit of the corners; one that is not finite lies outside.
        """
        found, barycentric = np.full(len(at), -1, dtype=np.int64), np.zeros((len(at), 3))
        inside = np.flatnonzero(np.isfinite(at).all(axis=1))
        cell = self._number(self._place(at[inside]))
        counts = self._starts[cell + 1] - self._starts[cell]
        parts = np.cumsum(counts) // _AT_A_TIME
        for part in np.unique(parts):
            points, start, count = inside[parts == part], self._starts[cell[parts == part]], counts[parts == part]
            point, k = _expand(count)
            triangle = self._triangles[start[point] + k]
            coordinates = self._barycentric(at[points[point]], triangle)
            depth = coordinates.min(axis=1)
            order = np.lexsort((-depth, point))
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


def _expand(counts: Ints) -> tuple[Ints, Ints]:
    """Return i and k of all pairs with k < counts[i]."""
    i = np.repeat(np.arange(len(counts)), counts)
    return i, np.arange(len(i)) - np.repeat(np.cumsum(counts) - counts, counts)
