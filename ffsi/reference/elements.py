"""Basis functions, quadrature rules and mapped triangles of the Taylor-Hood element.

The unit triangle has the vertices (0, 0), (1, 0), (0, 1). Local P2 node k is vertex k for k < 3 and the middle of the
side opposite to vertex k - 3 above; side k runs from vertex k + 1 to vertex k + 2 (modulo 3), counter-clockwise.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, Ints

# d(barycentric coordinates)/d(xi, eta) on the unit triangle.
_BARYCENTRIC_GRADIENT = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])


def barycentric(points: Floats) -> Floats:
    """Barycentric coordinates, which are the P1 basis, of points (n, 2) of the unit triangle; (n, 3)."""
    return np.column_stack([1.0 - points.sum(axis=1), points])


def p2_basis(points: Floats) -> Floats:
    """Values (n, 6) of the P2 Lagrange basis at points (n, 2) of the unit triangle."""
    b = barycentric(points)
    return np.hstack([b * (2.0 * b - 1.0), 4.0 * np.roll(b, -1, axis=1) * np.roll(b, -2, axis=1)])


def p2_gradients(points: Floats) -> Floats:
    """Derivatives (n, 6, 2) of the P2 basis by xi and eta at points (n, 2) of the unit triangle."""
    b = barycentric(points)[:, :, None]
    db = _BARYCENTRIC_GRADIENT[None]
    b1, b2 = np.roll(b, -1, axis=1), np.roll(b, -2, axis=1)
    db1, db2 = np.roll(db, -1, axis=1), np.roll(db, -2, axis=1)
    return np.concatenate([(4.0 * b - 1.0) * db, 4.0 * (b1 * db2 + b2 * db1)], axis=1)


def scatter(local: NDArray[Any], nodes: Ints, size: int) -> Floats:
    """Add local values (n, k, components) into nodes (n, k) of ``size`` nodes; (size, components)."""
    where = nodes.ravel()
    columns = [np.bincount(where, weights=column.ravel(), minlength=size) for column in np.moveaxis(local, -1, 0)]
    return np.column_stack(columns)


def radon_rule() -> tuple[Floats, Floats]:
    """Points (7, 2) and weights (7,) on the unit triangle, exact to degree 5; the weights add up to its area, 1/2.

    Source: J. Radon, Monatshefte fuer Mathematik 52 (1948); Stroud's T2:5-1.
    """
    root = np.sqrt(15.0)
    points, weights = [[1.0 / 3.0, 1.0 / 3.0]], [9.0 / 40.0]
    for sign in (-1.0, 1.0):
        near = (6.0 + sign * root) / 21.0
        far = 1.0 - 2.0 * near
        points += [[near, near], [far, near], [near, far]]
        weights += 3 * [(155.0 + sign * root) / 1200.0]
    return np.array(points), 0.5 * np.array(weights)


@cache  # 6 % of the time of a check of steps
def gauss_rule(n: int = 5) -> tuple[Floats, Floats]:
    """Gauss-Legendre points and weights (n,) on the interval [0, 1], exact to degree 2n - 1."""
    k = np.arange(1, n)  # eigenvalues of the recurrence (Golub, Welsch 1969); numpy.polynomial takes long to load
    points, vectors = np.linalg.eigh(np.diag(k / np.sqrt(4.0 * k**2 - 1.0), -1))
    points, weights = 0.5 * (points + 1.0), vectors[0] ** 2
    points.flags.writeable = weights.flags.writeable = False
    return points, weights


def side_points(s: Floats) -> Floats:
    """Points (3, n, 2) of the unit triangle at the parameters ``s`` in [0, 1] along each of its three sides."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    start, end = np.roll(corners, -1, axis=0), np.roll(corners, -2, axis=0)
    return np.asarray(start[:, None] + s[None, :, None] * (end - start)[:, None])


def line_basis(s: Floats) -> tuple[Floats, Floats]:
    """Quadratic basis on [0, 1] with nodes 0, 1, 1/2 in this order: values (n, 3) and derivatives by s (n, 3)."""
    values = np.column_stack([(1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0), 4.0 * s * (1.0 - s)])
    return values, np.column_stack([4.0 * s - 3.0, 4.0 * s - 1.0, 4.0 - 8.0 * s])


@dataclass(frozen=True)
class Elements:
    """Straight triangles, mapped from the unit triangle, with what integrals over them need.

    ``nodes`` (n, 6) P2 nodes, ``vertices`` (n, 3) P1 nodes, ``area`` (n,) square metres, ``inverse`` (n, 2, 2) the
    matrix d(xi, eta)/dX, ``weights`` (n, 7) of the Radon rule times the area element, ``gradients`` (n, 7, 6, 2) of the
    P2 basis by X at its points, ``basis`` (7, 6) and ``p1`` (7, 3) the values there.
    """

    nodes: Ints
    vertices: Ints
    area: Floats
    inverse: Floats
    weights: Floats
    gradients: Floats
    basis: Floats
    p1: Floats

    @classmethod
    def build(cls, coordinates: Floats, triangles: Ints, p2: Ints) -> "Elements":
        """Map the triangles (n, 3) of vertices with ``coordinates`` (nv, 2) and P2 nodes (n, 6).

        Raises ``ValueError`` if a triangle is degenerate or clockwise.
        """
        corners = coordinates[triangles]
        sides = corners[:, 1:] - corners[:, :1]  # row k is dX/d(xi, eta)_k
        determinant = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
        if not (determinant > 0.0).all():
            bad = int(np.argmin(determinant))
            raise ValueError(f"triangle with vertices {triangles[bad].tolist()} is degenerate or clockwise")
        inverse: Floats = np.linalg.inv(sides.transpose(0, 2, 1)).astype(np.float64)
        points, weights = radon_rule()
        return cls(
            nodes=p2,
            vertices=triangles,
            area=0.5 * determinant,
            inverse=inverse,
            weights=determinant[:, None] * weights,
            gradients=np.einsum("qak,tkj->tqaj", p2_gradients(points), inverse, optimize=True),
            basis=p2_basis(points),
            p1=barycentric(points),
        )

    def __len__(self) -> int:
        """Return the number of triangles."""
        return len(self.area)
