"""Derivatives of quadratic functions at the nodes of their triangles, and their means over the triangles around."""

from __future__ import annotations

import numpy as np

from ffsi.files.arrays import Floats, Ints
from ffsi.result.fields import FLUID, Fields

# Barycentric coordinates of the nodes of a quadratic triangle: vertices, then the middles opposite to them.
NODES = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
_OPPOSITE = [0, 1, 2, 4, 5, 3]  # this order from VTK's


def vorticity(fields: Fields) -> Floats:
    """Return dv_y/dx - dv_x/dy (n,) in 1/s at the nodes, on the deformed mesh; NaN off the fluid."""
    cells = fields.cells[fields.region == FLUID][:, _OPPOSITE]
    slope, area = node_gradients(fields.points[cells[:, :3]])
    motion = np.eye(2) + np.einsum("tai,tmaj->tmij", fields.displacement[cells], slope)
    along_mesh = np.einsum("tai,tmaj->tmij", fields.velocity[cells], slope)
    (a, b), (c, d) = np.moveaxis(motion, (-2, -1), (0, 1))
    inverse = np.moveaxis(np.array([[d, -b], [-c, a]]), (0, 1), (-2, -1))
    with np.errstate(divide="ignore", invalid="ignore"):  # of a folded mesh
        gradient = along_mesh @ inverse / (a * d - b * c)[..., None, None]
    return mean_at_nodes(cells, gradient[..., 1, 0] - gradient[..., 0, 1], area, len(fields.points))


def node_gradients(corners: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives (t, 6 nodes, 6 functions, 2) of quadratic shape functions at the nodes, and the areas."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    slope = np.empty((len(corners), 3, 2))
    slope[:, 1] = np.column_stack([b[:, 1], -b[:, 0]]) / twice[:, None]
    slope[:, 2] = np.column_stack([-a[:, 1], a[:, 0]]) / twice[:, None]
    slope[:, 0] = -slope[:, 1] - slope[:, 2]
    by_barycentric = np.zeros((6, 6, 3))  # node, function, barycentric coordinate
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        by_barycentric[:, i, i] = 4 * NODES[:, i] - 1
        by_barycentric[:, 3 + i, j] = 4 * NODES[:, k]
        by_barycentric[:, 3 + i, k] = 4 * NODES[:, j]
    return np.einsum("mal,tlj->tmaj", by_barycentric, slope), np.abs(twice) / 2


def mean_at_nodes(nodes: Ints, values: Floats, area: Floats, count: int) -> Floats:
    """Return at every node (count,) the mean of values (t, 6) of the triangles around it, weighted by their areas.

    NaN at nodes of none of the triangles.
    """
    weight = np.repeat(area, 6)
    total = np.bincount(nodes.ravel(), weights=weight, minlength=count)
    summed = np.bincount(nodes.ravel(), weights=weight * values.ravel(), minlength=count)
    return np.asarray(summed / np.where(total > 0, total, np.nan))
