"""The triangle of a point, in every unit and among triangles that no plane mesh has."""

import numpy as np
import pytest
from matplotlib.tri import Triangulation

from ffsi.result.locating import Finder

TURNED = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]])


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_points_are_found_as_by_a_second_program(unit: float) -> None:
    """Triangles of very different sizes; a fifth of the points lie outside."""
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.random((300, 2)), 0.01 * rng.random((300, 2))])
    mesh, at = Triangulation(*points.T), 1.1 * rng.random((2000, 2))
    at[0] = points[mesh.triangles[7]].mean(axis=0)
    found, barycentric = Finder(unit * points[mesh.triangles]).find(unit * at)
    assert found.tolist() == mesh.get_trifinder()(*at.T).tolist()
    inside = found >= 0
    assert found[0] == 7 and 0.6 < inside.mean() < 0.95
    back = np.einsum("ij,ijk->ik", barycentric, points[mesh.triangles[found]])
    assert back[inside] == pytest.approx(at[inside], abs=1e-14)


def test_every_point_finds_a_triangle() -> None:
    corners = np.array([[[0, 0], [3, 0], [0, 1]], [[3, 0], [3, 1], [0, 1]]]) * 1e-7 + 0.1
    at = np.concatenate([corners.reshape(-1, 2), (corners[0] + np.roll(corners[0], 1, axis=0)) / 2])
    assert (Finder(corners).find(at)[0] >= 0).all()
    flat, large = np.array([[0.0, 0.0], [1.0, 1.0], [0.5, 0.5]]), 10 * TURNED - 1
    finder = Finder(np.array([TURNED, flat, large, large]))
    found, barycentric = finder.find(np.array([[0.3, 0.3], [-0.5, -0.5], [20.0, 0.0], [np.nan, 0.0]]))
    assert found.tolist() == [0, 2, -1, -1]  # the one in which it lies deepest; none
    assert barycentric[0] == pytest.approx([0.4, 0.3, 0.3])
    assert Finder(flat[None]).find(np.array([[0.5, 0.5]]))[0].tolist() == [-1]
    assert Finder(np.empty((0, 3, 2))).find(np.zeros((2, 2)))[0].tolist() == [-1, -1]


def test_many_points_are_found_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ffsi.result.locating._AT_A_TIME", 10)
    at = np.random.default_rng(1).random((100, 2))
    assert ((Finder(TURNED[None]).find(at)[0] == 0) == (at.sum(axis=1) <= 1)).all()


def test_a_node_that_is_nowhere_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        Finder(np.array([TURNED, [[np.nan, 0], [1, 0], [0, 1]]]))
