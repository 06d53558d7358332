"""Basis and quadrature are exact on the polynomials that they promise."""

from math import factorial

import numpy as np
import pytest

from ffsi.reference.elements import (
    Elements,
    barycentric,
    gauss_rule,
    line_basis,
    p2_basis,
    p2_gradients,
    radon_rule,
    side_points,
)

NODES = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5], [0, 0.5], [0.5, 0]], dtype=float)
RANDOM = np.random.default_rng(2).dirichlet(np.ones(3), size=20)[:, 1:]


def test_p2_basis_is_one_at_its_node_and_zero_at_the_others():
    np.testing.assert_array_equal(p2_basis(NODES), np.eye(6))


@pytest.mark.parametrize(("i", "j"), [(i, j) for i in range(3) for j in range(3 - i)])
def test_p2_basis_reproduces_monomials_and_their_derivatives(i, j):
    x, y = RANDOM.T
    nodal = NODES[:, 0] ** i * NODES[:, 1] ** j
    np.testing.assert_allclose(p2_basis(RANDOM) @ nodal, x**i * y**j, rtol=0, atol=4e-16)
    slopes = np.einsum("qak,a->qk", p2_gradients(RANDOM), nodal)
    expected = np.column_stack([i * x ** max(i - 1, 0) * y**j, j * x**i * y ** max(j - 1, 0)])
    np.testing.assert_allclose(slopes, expected, rtol=0, atol=2e-15)


@pytest.mark.parametrize(("i", "j"), [(i, j) for i in range(6) for j in range(6 - i)])
def test_radon_rule_is_exact_to_degree_five(i, j):
    points, weights = radon_rule()
    exact = factorial(i) * factorial(j) / factorial(i + j + 2)
    np.testing.assert_allclose(weights @ (points[:, 0] ** i * points[:, 1] ** j), exact, rtol=3e-15)


def test_radon_rule_has_seven_points_and_is_not_exact_to_degree_six():
    points, weights = radon_rule()
    assert points.shape == (7, 2) and abs(weights @ points[:, 0] ** 6 / (factorial(6) / factorial(8)) - 1.0) > 1e-4


@pytest.mark.parametrize("degree", range(10))
def test_gauss_rule_is_exact_to_degree_nine(degree):
    points, weights = gauss_rule()
    np.testing.assert_allclose(weights @ points**degree, 1.0 / (degree + 1), rtol=1e-14)


def test_basis_on_lines_and_triangles():
    s = np.linspace(0, 1, 7)
    values, slopes = line_basis(s)
    for side in range(3):
        start, end, middle = (side + 1) % 3, (side + 2) % 3, 3 + side
        points = side_points(s)[side]
        np.testing.assert_allclose(p2_basis(points)[:, [start, end, middle]], values, rtol=0, atol=1e-15)
        np.testing.assert_allclose(barycentric(points)[:, side], 0.0, atol=1e-16)
        along = p2_gradients(points) @ (points[-1] - points[0])
        np.testing.assert_allclose(along[:, [start, end, middle]], slopes, rtol=0, atol=3e-15)
    coordinates = np.array([[0.3, -0.2], [2.1, 0.4], [0.7, 1.9]])
    triangle, p2 = np.array([[0, 1, 2]]), np.array([[0, 1, 2, 3, 4, 5]])
    elements, nodes = Elements.build(coordinates, triangle, p2), barycentric(NODES) @ coordinates
    points, nodal = elements.p1 @ coordinates, nodes[:, 0] ** 2 - 3.0 * nodes[:, 0] * nodes[:, 1]
    expected = np.column_stack([2 * points[:, 0] - 3 * points[:, 1], -3 * points[:, 0]])
    np.testing.assert_allclose(np.einsum("qaj,a->qj", elements.gradients[0], nodal), expected, rtol=0, atol=2e-14)
    np.testing.assert_allclose(elements.weights.sum(), elements.area[0], rtol=1e-15)
    np.testing.assert_allclose(elements.area[0], 0.5 * (1.8 * 2.1 - 0.6 * 0.4), rtol=1e-15)
    with pytest.raises(ValueError, match=r"triangle with vertices \[0, 2, 1\] is degenerate or clockwise"):
        Elements.build(np.array([[0.0, 0], [1, 0], [0, 1]]), np.array([[0, 2, 1]]), np.arange(6)[None])
