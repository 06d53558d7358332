"""Small structured meshes, so that cases can be solved without a mesh generator."""

from collections.abc import Callable

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawMesh


def structured_mesh(
    x: Floats, y: Floats, region: Callable[[float, float], int], label: Callable[[float, float], int]
) -> RawMesh:
    """Split the rectangles between grid lines x (nx + 1,) and y (ny + 1,), metres, into two triangles each.

    ``region`` maps the centre of a rectangle to its region, 0 for a hole; ``label`` maps the middle of an edge on the
    outer boundary or between two regions to its label. The diagonals alternate, so that with even nx and ny no
    corner triangle has two sides on the boundary, where its velocities would leave a pressure undetermined.
    """
    triangles, regions = _triangles(x, y, region)
    used, renumbered = np.unique(triangles, return_inverse=True)
    triangles = renumbered.reshape(-1, 3)
    grid = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    vertices = grid[used]
    p2, sides = _quadratic_nodes(triangles, len(vertices))
    edges = _outline(sides, triangles, regions)
    middles = vertices[edges].mean(axis=1)
    labels = np.array([label(*middle) for middle in middles.tolist()], dtype=np.int64)
    return RawMesh(vertices, triangles, regions, edges, labels, p2)


def _triangles(x: Floats, y: Floats, region: Callable[[float, float], int]) -> tuple[Ints, Ints]:
    """Counter-clockwise triangles of the grid and their regions, holes left out."""
    triangles, regions = [], []
    for j in range(len(y) - 1):
        for i in range(len(x) - 1):
            number, a = region(0.5 * (x[i] + x[i + 1]), 0.5 * (y[j] + y[j + 1])), j * len(x) + i
            b, c, d = a + 1, a + 1 + len(x), a + len(x)
            if number:
                triangles += [[a, b, c], [a, c, d]] if (i + j) % 2 == 0 else [[a, b, d], [b, c, d]]
                regions += [number, number]
    return np.array(triangles), np.array(regions)


def _quadratic_nodes(triangles: Ints, nv: int) -> tuple[Ints, Ints]:
    """P2 numbers (nt, 6), mid-edge nodes behind the vertices, and the number (nt, 3) of each side's edge."""
    start, end = np.roll(triangles, -1, axis=1), np.roll(triangles, -2, axis=1)
    _, sides = np.unique(np.minimum(start, end) * nv + np.maximum(start, end), return_inverse=True)
    sides = sides.reshape(-1, 3)
    return np.hstack([triangles, nv + sides]), sides


def _outline(sides: Ints, triangles: Ints, regions: Ints) -> Ints:
    """Vertices (ne, 2) of the edges that have one triangle, or triangles of two regions."""
    count = np.bincount(sides.ravel())
    total = np.bincount(sides.ravel(), weights=np.repeat(regions, 3))
    square = np.bincount(sides.ravel(), weights=np.repeat(regions**2, 3))
    chosen = (count == 1) | (count * square != total**2)
    _, first = np.unique(sides, return_index=True)
    element, side = np.divmod(first[chosen], 3)
    return np.column_stack([triangles[element, (side + 1) % 3], triangles[element, (side + 2) % 3]])
