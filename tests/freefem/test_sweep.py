"""Sweeps with the real FreeFEM: one process and one mesh for a chain, and what is said about a point that fails."""

import itertools
import re

import numpy as np
import pandas as pd
import pytest
from conftest import scene_of

from ffsi.files.arrays import read_mesh
from ffsi.hemodynamics.result import load_results
from ffsi.run.sweep import sweep

VELOCITY, VISCOSITY = "inflow.mean_velocity", "fluid.viscosity"
VELOCITIES = [0.03, 0.06, 0.09, 0.12]


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder, events = tmp_path_factory.mktemp("sweep") / "flap", []
    table = sweep(scene_of("flap-svk"), {VELOCITY: VELOCITIES}, folder, on_event=events.append)
    return table, folder, events


def test_one_row_per_point_of_one_process_and_one_mesh(swept, solved):
    table, folder, _ = swept
    assert table[VELOCITY].tolist() == VELOCITIES and table["status"].tolist() == ["converged"] * 4
    assert table["point"].tolist() == [1, 2, 3, 4]
    written = pd.read_csv(folder / "sweep.csv", keep_default_na=False)
    assert written["drag"].tolist() == table["drag"].tolist()
    table, folder, events = swept
    assert table["folder"].unique().tolist() == ["chain-001"]
    assert [event.kind for event in events].count("start") == 1 and [event.kind for event in events].count("mesh") == 1
    assert [event.integer("point") for event in events if event.kind == "point"] == [1, 2, 3, 4]
    assert len(list(folder.rglob("mesh.bin"))) == 1
    assert sorted(path.name for path in folder.rglob("point-*.bin")) == [f"point-{i:04d}.bin" for i in (1, 2, 3, 4)]
    table = swept[0]
    for quantity, sign in (("tip_ux", 1), ("tip_uy", -1), ("drag", 1), ("lift", -1), ("min_jacobian_fluid", -1)):
        values = sign * table[quantity].to_numpy()
        assert (np.diff(values) > 0).all(), quantity
    # Weak flows: the displacement follows the force, drag is nearly proportional to the velocity.
    assert 2 < table["drag"][1] / table["drag"][0] < 3
    table, folder, _ = swept
    assert table["check_maximum"].notna().all() and (table["check_maximum"] < 1e-8).all()
    for result in load_results(folder):
        assert result.converged and result.data["check"]["momentum"] < 1e-8
    table, single = swept[0], solved("flap-svk")
    assert single.parameters[VELOCITY] == 0.12
    for quantity in ("drag", "lift", "tip_ux", "tip_uy", "min_jacobian"):
        assert table[quantity].iloc[-1] == pytest.approx(single.quantities[quantity], rel=1e-7)


def test_the_next_point_starts_from_the_one_before(swept):
    for result, velocity in zip(load_results(swept[1]), VELOCITIES, strict=True):
        assert result.parameters[VELOCITY] == velocity and result.scene.inflow.mean_velocity == velocity
    history = pd.read_csv(swept[1] / "chain-001" / "newton.csv")
    assert history["point"].unique().tolist() == [1, 2, 3, 4] and history["stage"].unique().tolist() == [1]
    # Nothing is loaded from zero again, and the first residual of a point is not that of rest.
    later = history[history["point"] > 1]
    assert (later["load"] == 1).all()
    started = later[later["iteration"] == 0]
    assert (started["min_jacobian"] < 0.99).all()


def test_two_parameters(tmp_path):
    scene = scene_of("flap-svk")
    grid = {VISCOSITY: [1e-3, 2e-3], VELOCITY: [0.02, 0.04]}
    table = sweep(scene, grid, tmp_path / "sweep", jobs=2)
    assert table[[VISCOSITY, VELOCITY]].to_numpy().tolist() == [
        list(pair) for pair in itertools.product(*grid.values())
    ]
    assert table["status"].tolist() == ["converged"] * 4 and table["folder"].tolist() == ["chain-001"] * 4
    assert (table["check_maximum"] < 1e-8).all()
    # A flow of twice the viscosity drags more.
    assert (table["drag"].to_numpy()[2:] > table["drag"].to_numpy()[:2]).all()
    meshes = [read_mesh(path) for path in sorted((tmp_path / "sweep").rglob("mesh.bin"))]
    assert len(meshes) == 1


@pytest.fixture(scope="module")
def collapsed(tmp_path_factory):
    """A finely resolved root: St. Venant-Kirchhoff collapses there between 0.06 and 0.12 m/s."""
    folder = tmp_path_factory.mktemp("sweep") / "collapse"
    table = sweep(scene_of("flap-svk", "mesh.root_size=0.0025"), {VELOCITY: [0.06, 0.12]}, folder)
    return table, folder


def test_a_collapsed_solid_is_named_with_its_place(collapsed):
    table, _ = collapsed
    assert table["status"].tolist() == ["converged", "failed"] and table["failure"].tolist() == ["", "not-converged"]
    reason = table["reason"][1]
    found = re.search(r"the solid flap has collapsed at \(([-0-9.e]+), ([-0-9.e]+)\): J = ([0-9.]+)", reason)
    assert found, reason
    x, y, jacobian = map(float, found.groups())
    assert abs(x - 0.54) < 5e-3 and 0 <= y < 5e-3  # the rear corner of the root, which is pressed
    assert 0 < jacobian < 1 / 3**0.5


def test_what_was_solved_before_the_collapse_is_kept(collapsed):
    table, folder = collapsed
    assert (folder / "chain-001" / "point-0001.bin").is_file() and (folder / "chain-001" / "failed.bin").is_file()
    assert table["check_maximum"][0] < 1e-8
    # The row of the failed point has no quantities; what was reached, between the two velocities, has its own columns.
    assert np.isnan(table["tip_ux"][1:]).all() and table["tip_ux"][0] < table["reached_tip_ux"][1]
    assert 0.06 < table[f"reached_{VELOCITY}"][1] < 0.12 and table["reached_load"][1] == 1
    assert np.isnan(table["reached_tip_ux"][0])


def test_points_that_failed_are_not_tried_again(collapsed):
    before, folder = collapsed
    chains = sorted(path.name for path in folder.iterdir())
    after = sweep(scene_of("flap-svk", "mesh.root_size=0.0025"), {VELOCITY: [0.06, 0.12]}, folder)
    assert sorted(path.name for path in folder.iterdir()) == chains
    assert after["reason"].tolist() == before["reason"].tolist()
