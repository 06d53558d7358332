"""The plain channel: Poiseuille flow, the force on its walls steady and in time, pictures of a scene without a body."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pandas as pd
import pytest
from conftest import scene_of

import ffsi
from ffsi.scene import Scene

LENGTH, HEIGHT, DENSITY, VISCOSITY, MEAN = 16e-3, 2e-3, 1060.0, 0.00345, 0.05
SLOPE = 12 * VISCOSITY * MEAN / HEIGHT**2  # pressure gradient of Poiseuille flow


def channel(**tables: Any) -> Scene:
    """Return a vessel of 16 mm with Newtonian blood, at level 0, without pictures unless the tables say otherwise."""
    table = {
        "name": "channel", "geometry": {"kind": "channel", "length": LENGTH, "height": HEIGHT}, "mesh": {"level": 0},
        "fluid": {"density": DENSITY, "viscosity": VISCOSITY}, "inflow": {"mean_velocity": MEAN},
        "outlet": {"kind": "do-nothing"}, "output": {"pictures": False, "vtu": False},
    }  # fmt: skip
    return Scene.model_validate(table | tables)


@pytest.fixture(scope="module")
def steady(tmp_path_factory):
    return ffsi.solve(channel(output={}), tmp_path_factory.mktemp("channel") / "run")


def test_poiseuille_flow_is_exact_and_so_are_its_stresses(steady):
    assert steady.converged
    x, y = np.meshgrid(np.linspace(0, LENGTH, 9), np.linspace(0, HEIGHT, 11))
    found = steady.sample(np.column_stack([x.ravel(), y.ravel()]))
    velocity = 6 * MEAN * y * (HEIGHT - y) / HEIGHT**2
    np.testing.assert_allclose(found["vx"], velocity.ravel(), rtol=0, atol=1e-9 * MEAN)
    np.testing.assert_allclose(found["vy"], 0, rtol=0, atol=1e-9 * MEAN)
    np.testing.assert_allclose(found["p"], SLOPE * (LENGTH - x.ravel()), rtol=0, atol=1e-8 * SLOPE * LENGTH)
    values = steady.quantities
    assert values["pressure_drop"] == pytest.approx(SLOPE * LENGTH, rel=1e-8)
    assert values["drag"] == pytest.approx(SLOPE * LENGTH * HEIGHT, rel=1e-8)
    assert values["drag_surface"] == pytest.approx(values["drag"], rel=1e-8)
    assert abs(values["lift"]) < 1e-10 * values["drag"]
    assert values["drag_coefficient"] == pytest.approx(2 * values["drag"] / (DENSITY * MEAN**2 * HEIGHT), rel=1e-12)
    stress, values = 6 * VISCOSITY * MEAN / HEIGHT, steady.quantities
    assert [values[f"wss_{what}_walls"] for what in ("mean", "max", "min")] == pytest.approx([stress] * 3, rel=1e-8)
    assert values["flow_rate_in"] == pytest.approx(MEAN * HEIGHT, rel=1e-12) and abs(values["mass_balance"]) < 1e-12
    wall = pd.read_csv(steady.directory / "wall.csv")
    assert wall["wss_x"].to_numpy() == pytest.approx(stress, rel=1e-8)
    np.testing.assert_allclose(wall["pressure"], SLOPE * (LENGTH - wall["x"]), atol=1e-8 * SLOPE * LENGTH)
    written = meshio.read(steady.directory / "fields.vtu")
    on = np.isin(written.points[:, 1], (0.0, HEIGHT))
    field = written.point_data["wall_shear_stress"]
    np.testing.assert_allclose(field[on, 0], stress, rtol=1e-8)
    assert np.isnan(field[~on, :2]).all()
    assert {"velocity.png", "pressure.png", "fields.vtu"} <= {path.name for path in steady.directory.iterdir()}
    assert not (steady.directory / "displacement.png").exists()


def test_the_mesh_is_symmetric_and_has_no_triangle_with_all_vertices_on_the_boundary(steady):
    fields = steady.fields
    vertices = fields.points[np.unique(fields.cells[:, :3])]
    mirrored = np.column_stack([vertices[:, 0], HEIGHT - vertices[:, 1]])
    assert len(np.unique(np.round(np.concatenate([vertices, mirrored]) / 1e-10), axis=0)) == len(vertices)
    x, y = fields.points[fields.cells[:, :3]].T
    outside = (np.minimum(x, LENGTH - x) < 1e-9) | (np.minimum(y, HEIGHT - y) < 1e-9)
    assert not outside.all(axis=0).any()


def test_rows_grow_from_the_walls(tmp_path):
    sizes = {"level": 0, "body_size": 2e-5, "growth": 0.5, "far_size": 4e-4}
    points = ffsi.solve(channel(mesh=sizes), tmp_path / "run").fields.points
    rows = np.diff(np.unique(np.round(points[:, 1], 11))[::2])
    lower = rows[: len(rows) // 2]
    assert (np.diff(lower) > 0).all() and 0.7 * 2e-5 < lower[0] < 1.5 * 2e-5 and lower[-1] <= 4e-4
    np.testing.assert_allclose(rows, rows[::-1], rtol=1e-6)


@pytest.mark.parametrize("scheme", ["backward-euler", "shifted-crank-nicolson"])
def test_the_force_on_the_walls_in_time(scheme, tmp_path):
    """Walls touch inlet and outlet, whose traction in the step belongs to the force; the checker compares it."""
    time = {"step": 0.01, "end": 0.06, "output_interval": 0.03, "scheme": scheme}
    result = ffsi.solve(channel(time=time, inflow={"mean_velocity": MEAN, "ramp": 0.04}), tmp_path / "run")
    assert result.status == "converged", result.reason
    assert result.data["check"]["drag_difference"] < 1e-9
    last = result.data["time"]["last"]
    assert abs(last["mass_balance"]) < 1e-11 and last["wss_mean_walls"] > 0
    assert (result.directory / "wall.csv").is_file()


def test_a_pulsating_flow_is_periodic_by_the_drag(tmp_path):
    """The lift is what the steps leave unsolved: no period must be looked for in it."""
    result = ffsi.solve(
        channel(
            geometry={"kind": "channel", "length": 4 * HEIGHT, "height": HEIGHT},
            inflow={"mean_velocity": MEAN, "waveform": "1 + 0.75*sin(2*pi*t)"},
            time={"step": 0.05, "end": 20.0, "stop": "periodic"},
        ),
        tmp_path / "run",
    )
    assert result.status == "converged", result.reason
    assert result.data["time"]["periodic"]
    drag = result.quantities["drag"]
    assert drag["frequency"] == pytest.approx(1, rel=1e-3)
    assert drag["mean"] == pytest.approx(SLOPE * 4 * HEIGHT**2, rel=5e-3)


def test_the_force_on_a_flap_in_time(tmp_path):
    """It stands on the floor: the traction of the floor's first edges is taken off in a step, too."""
    time = ["time.step=0.05", "time.end=0.2", "inflow.ramp=0.5"]
    scene = scene_of("flap-svk", "mesh_motion.kind=harmonic", "inflow.mean_velocity=0.02", *time)
    result = ffsi.solve(scene, Path(tmp_path) / "run")
    assert result.status == "converged", result.reason
    assert result.data["check"]["lift_difference"] < 1e-8
