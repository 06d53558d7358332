"""The displacement of points that are no nodes: on an edge and inside a triangle, steady and in time."""

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from conftest import PLAIN
from unit.vessel_meshes import Drawing

from ffsi.files.arrays import read_mesh, read_state
from ffsi.hemodynamics.result import Result
from ffsi.run.one_scene import solve
from ffsi.scene import load_scene

# On the upper edge, on an edge between two triangles, within two triangles: all off the nodes and off the middles.
POINTS = {"upper": (1.3, 1.0), "between": (1.75, 0.25), "right": (1.6, 0.9), "left": (0.45, 0.15)}
IN_TIME = {"scheme": "backward-euler", "step": 0.05, "end": 0.15}


def run(folder: Path, tip: str, time: dict[str, object] | None = None) -> Result:
    """Solve for a block of four triangles under its weight, clamped on its left, with its tip at one of the points."""
    corners = np.array([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)], dtype=float)
    triangles = np.array([(0, 1, 3), (1, 4, 3), (1, 2, 4), (2, 5, 4)])
    names = {"block": (1, 2), "left": (2, 1)}
    Drawing(corners, triangles, np.ones(4, dtype=int), np.array([(0, 3)]), np.array([2]), names).write(
        folder / "block.msh"
    )
    probes = {name: dict(zip("xy", at, strict=True)) for name, at in POINTS.items() if name != tip}
    scene = {
        "name": "block",
        "geometry": {
            "kind": "mesh", "file": "block.msh", "regions": {"block": "block"}, "boundaries": {"clamped": "left"},
            "tip": dict(zip("xy", POINTS[tip], strict=True)), "probes": probes,
        },
        "solid": {
            "block": {"material": "st-venant-kirchhoff", "density": 1, "young_modulus": 50, "poisson_ratio": 0.3}
        },
        "gravity": {"x": 0.3, "y": -1},
    }  # fmt: skip
    (folder / "scene.toml").write_text(tomli_w.dumps(scene | ({"time": time} if time else {})))
    result = solve(load_scene(str(folder / "scene.toml"), ["mesh.level=0", *PLAIN]), folder / "run")
    assert result.converged, result.reason
    return result


def displacement(result: Result, at: tuple[float, float]) -> np.ndarray:
    """Return u at a point from the raw unknowns: the polynomial of degree two through a triangle's six nodes."""

    def powers(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)

    mesh = read_mesh(result.directory / "mesh.bin")
    u = read_state(result.directory / "point-0001.bin", mesh).u
    corners = mesh.vertices[mesh.triangles]
    sides = np.roll(corners, -1, axis=1) - corners
    across = sides[..., 0] * (at[1] - corners[..., 1]) - sides[..., 1] * (at[0] - corners[..., 0])
    nodes = mesh.p2[np.argmax(across.min(axis=1))]  # all turn to the left
    coefficients = np.linalg.solve(powers(*mesh.p2_coordinates[nodes].T), u[nodes])
    assert np.abs(coefficients[3:]).max() > 1e-3 * np.abs(coefficients[1:3]).max()  # none of them is linear
    return np.asarray(powers(*np.array(at)) @ coefficients)


def assert_at(result: Result, values: dict[str, float], name: str, at: tuple[float, float]) -> None:
    expected = displacement(result, at)
    assert [values[f"{name}_ux"], values[f"{name}_uy"]] == pytest.approx(expected.tolist(), rel=1e-10)


def test_steady(tmp_path: Path) -> None:
    result = run(tmp_path, "between")
    for name, at in POINTS.items():
        assert_at(result, result.quantities, "tip" if name == "between" else name, at)
        assert [result.at(*at)[name] for name in ("ux", "uy")] == pytest.approx(displacement(result, at), rel=1e-10)


@pytest.mark.parametrize("tip", POINTS)
def test_in_time(tmp_path: Path, tip: str) -> None:
    result = run(tmp_path, tip, IN_TIME)
    last = result.history.iloc[-1]
    assert last["time"] == pytest.approx(IN_TIME["end"])
    assert_at(result, dict(last), "tip", POINTS[tip])
    for name, at in POINTS.items():
        assert_at(result, result.last_quantities, "tip" if name == tip else name, at)
