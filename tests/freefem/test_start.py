"""Runs in time that start from formulas or a result: exact motions, runs cut in two, other meshes, wrong scripts."""

import numpy as np
import pytest
from own_mesh import checked, scene_on, write_mesh
from structured import structured_mesh
from test_walls import channel, flap, state_of

from ffsi.freefem import FreeFEMError
from ffsi.result.study_definition import define
from ffsi.run.one_scene import solve
from ffsi.scene import SceneError, load_scene, with_values

SLOW = {"inflow": {"mean_velocity": 0.3, "profile": "6*y*(1-y)"}, "mesh_motion": {"kind": "hyperelastic"}}
K = 0.02


def start_of(result) -> float:
    return result.data["check"]["start_difference"]


@pytest.fixture(scope="module")
def steady(tmp_path_factory):
    """A block that bends in a steady flow."""
    folder = tmp_path_factory.mktemp("steady")
    result = solve(flap(folder, False, **SLOW), folder / "run")
    assert result.checked and np.abs(state_of(result)[1].u).max() > 0.02
    return result


def test_a_steady_state_stays_and_its_folder_needs_no_other(steady, tmp_path):
    time = {"step": K, "end": 5 * K, "initial": str(steady.directory)}
    scene = with_values(steady.scene, {"time": time})
    result = solve(scene, tmp_path / "run")
    assert result.checked and start_of(result) < 1e-10
    history = result.history
    for name in ("drag", "tip_ux", "tip_uy"):
        np.testing.assert_allclose(history[name], steady.quantities[name], rtol=1e-7)
    assert load_scene(tmp_path / "run/scene.toml") == scene
    assert define(scene, {})["initial"] == scene.time.initial_state.digest  # a sweep is that of this state


def test_it_starts_on_another_mesh(steady, tmp_path):
    time = {"step": K, "end": 2 * K, "initial": str(steady.directory)}
    result = solve(with_values(steady.scene, {"time": time, "mesh.level": 1}), tmp_path / "run")
    assert result.checked and start_of(result) < 1e-8
    assert result.history["tip_ux"].iloc[0] == pytest.approx(steady.quantities["tip_ux"], rel=0.02)


@pytest.mark.parametrize("law", ["compressible", "mixed"])
def test_a_run_cut_in_two_is_the_same(law, tmp_path):
    """By backward Euler, which knows of the state before alone."""
    mixed = {"material": "neo-hookean", "density": 3.0, "lame_mu": 15, "poisson_ratio": 0.45, "formulation": "mixed"}
    tables = {"solid": {"block": mixed}} if law == "mixed" else {}
    time = {"step": K, "end": 6 * K, "scheme": "backward-euler"}
    scene = flap(tmp_path, False, **SLOW, **tables, time=time, solver={"step_tolerance": 1e-11})
    whole = solve(scene, tmp_path / "whole")
    first = solve(with_values(scene, {"time.end": 3 * K}), tmp_path / "first")
    second = with_values(scene, {"time.end": 3 * K, "time.initial": str(first.directory)})
    last = solve(second, tmp_path / "second")
    assert whole.checked and last.checked and start_of(last) < 1e-10
    for name in ("drag", "tip_ux", "tip_uy", "kinetic"):
        np.testing.assert_allclose(last.history[name], whole.history[name][3:], rtol=1e-7)


def block(folder, **tables):
    """A block of rubber that nothing holds."""
    grid = np.linspace(0, 1, 5)
    path = write_mesh(
        folder / "block.msh", structured_mesh(grid, grid, lambda x, y: 2, lambda x, y: 1), {"rubber": 2}, {"all": 1}
    )
    law = {"material": "st-venant-kirchhoff", "density": 3.0, "young_modulus": 40.0, "poisson_ratio": 0.3}
    solver = {"step_tolerance": 1e-12}
    return scene_on(path, {"free": "all"}, {"rubber": "rubber"}, solid={"rubber": law}, solver=solver, **tables)


FLIGHT = {"velocity_x": "3", "velocity_y": "-2", "displacement_x": "0.25", "displacement_y": "0"}


def test_a_block_flies_on(tmp_path):
    result = solve(block(tmp_path, time={"step": K, "end": 5 * K}, start=FLIGHT), tmp_path / "run")
    assert result.checked and start_of(result) < 1e-12
    _, state = state_of(result)
    np.testing.assert_allclose(state.u, np.broadcast_to([0.25 + 3 * 5 * K, -2 * 5 * K], state.u.shape), atol=1e-10)


def test_a_stretched_block_swings_with_the_energy_that_it_has(tmp_path):
    start = {"displacement_x": "0.1*x", "velocity_y": "0.5*y"}
    result = solve(block(tmp_path, time={"step": K, "end": 5 * K}, start=start), tmp_path / "run")
    assert result.checked and start_of(result) < 1e-12
    history = result.history
    assert history["elastic"].iloc[-1] < -1e-3  # less than at the start
    assert history["work"].iloc[0] == pytest.approx(0.5 * 3 * 0.25 / 3, rel=1e-9)


def test_a_flow_goes_on(tmp_path):
    start = {"velocity_x": "6*1.5*y*(1-y)"}
    inflow = {"mean_velocity": 1.5}
    scene = channel(tmp_path, {"walls": ["low", "high"]}, inflow=inflow, start=start, time={"step": 0.1, "end": 0.3})
    result = checked(scene, tmp_path / "run")
    mesh, state = state_of(result)
    y = mesh.p2_coordinates[:, 1]
    np.testing.assert_allclose(state.v[:, 0], 9 * y * (1 - y), rtol=0, atol=1e-9)


# A wrong script does not pass.
WRONG = {
    "state": ("there[][Vi(i/6, i%6)] = field[node];", "there[][Vi(i/6, i%6)] = 1.0001*field[node];"),
    "mesh": ("X(uxFrom:uyTo) = moved;\n  }", "}"),
}


@pytest.mark.parametrize("name", ["state", "mesh"])
def test_a_wrong_start_is_caught(name, steady, tmp_path, broken_script):
    broken_script(*WRONG[name])
    time = {"step": K, "end": 2 * K, "initial": str(steady.directory)}
    level = {"mesh.level": 1} if name == "mesh" else {}  # on its own mesh it follows already
    result = solve(with_values(steady.scene, {"time": time, **level}), tmp_path / "run")
    assert not result.checked
    assert "start_difference" in result.reason


REFUSED = [
    ({"time.initial": "nowhere"}, r'time\.initial = ".*nowhere": no state of a run: .*; accepted: the folder of a run'),
    ({"start.velocity_x": "z"}, r"start\.velocity_x"),
    ({"start.velosity_x": "y"}, r"start\.velosity_x.*did you mean .start.velocity_x"),
    ({"time": None}, r"start: only accepted in a scene with a table time"),
]


@pytest.mark.parametrize(("values", "text"), REFUSED)
def test_refused(values, text, tmp_path):
    scene = block(tmp_path, time={"step": K, "end": K}, start=FLIGHT)
    with pytest.raises(SceneError, match=text):
        with_values(scene, values)


def test_a_state_of_another_domain_is_refused(steady, tmp_path):
    scene = block(tmp_path, time={"step": K, "end": K})
    with pytest.raises(SceneError, match=r"time\.initial: another domain: the areas of its regions are 2\.5, 0\.375 m"):
        with_values(scene, {"time.initial": str(steady.directory)})
    both = with_values(steady.scene, {"time": {"step": K, "end": K}})
    with pytest.raises(SceneError, match=r"start: not accepted beside time\.initial"):
        with_values(both, {"time.initial": str(steady.directory), "start.velocity_x": "1"})


@pytest.mark.parametrize(
    ("name", "key", "value"), [("cylinder-2d1", "cylinder_x", 0.21), ("flap-neo-hookean", "flap_left", 0.501)]
)
def test_a_part_at_another_place_is_another_domain_of_the_same_areas(name, key, value, solved, tmp_path, broken_script):
    time = {"step": K, "end": K, "initial": str(solved(name, "mesh.level=0").directory)}
    scene = with_values(load_scene(name, ["mesh.level=0", f"geometry.{key}={value}"]), {"time": time})
    with pytest.raises(FreeFEMError, match=r"time\.initial is the state of another domain"):
        solve(scene, tmp_path / "run")
    if scene.solid:
        broken_script("if (Elsewhere(Th, Ti) || Elsewhere(Ti, Th))", "if (0)")
        found = solve(with_values(scene, {"geometry.flap_left": 1.2}), tmp_path / "run")
        assert "start_difference: " in found.reason
