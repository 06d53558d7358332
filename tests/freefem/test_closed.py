"""Fluids that nothing lets out: exact flows, what a balloon takes in, wrong scripts, what is refused."""

import numpy as np
import pytest
from own_mesh import checked, scene_on, write_mesh
from scipy.optimize import brentq
from structured import structured_mesh
from test_walls import RUBBER, WATER, state_of

from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.solve import solve as solve_again
from ffsi.reference.system import System
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, SceneError, load_scene
from ffsi.scene.meshes.topology import cross

RHO, MU, LENGTH, LEVEL = WATER["density"], WATER["viscosity"], 3.0, 0.7
NAMES = {"left": 1, "right": 2, "low": 3, "high": 4, "ends": 6, "outside": 7}
SIDES = ["left", "right", "low", "high"]
TIME = {"step": 0.02, "end": 0.2}


def box(folder, boundaries, *, lid: bool = False, **tables) -> Scene:
    """A box [0, 3] x [0, 1], with an elastic lid on it or without."""
    x, y = np.linspace(0, LENGTH, 13), np.array([0, 0.2, 0.4, 0.6, 0.8, 1, *([1.1] if lid else [])])

    def label(x, y):
        side = 1 if x == 0 else 2
        return {0.0: 3, 1.0: 4, 1.1: 7}.get(y) or (6 if y > 1 else side)

    mesh = structured_mesh(x, y, lambda x, y: 1 if y < 1 else 2, label)
    path = write_mesh(folder / "box.msh", mesh, {"water": 1, "lid": 2}, NAMES)
    regions = {"fluid": "water"} | ({"lid": "lid"} if lid else {})
    solids = {"solid": {"lid": RUBBER}} if lid else {}
    return scene_on(path, boundaries, regions, **{"fluid": WATER, **solids, **tables})


@pytest.mark.parametrize("time", [{}, {"time": TIME}], ids=["steady", "in time"])
def test_a_fluid_at_rest_has_its_weight(time, tmp_path):
    gravity = {"x": 0.5, "y": -2.0}
    scene = box(tmp_path, {"walls": SIDES}, fluid={**WATER, "mean_pressure": LEVEL}, gravity=gravity, **time)
    result = checked(scene, tmp_path / "run")
    mesh, state = state_of(result)
    np.testing.assert_allclose(state.v, 0, atol=1e-10)
    pressure = LEVEL + RHO * (mesh.vertices - [LENGTH / 2, 0.5]) @ [gravity["x"], gravity["y"]]
    np.testing.assert_allclose(state.p, pressure, rtol=0, atol=1e-9)
    assert load_scene(tmp_path / "run/scene.toml") == scene
    assert not {"flow_rate_in", "flow_rate_out", "mass_balance"} & set(result.quantities)


def through(folder, **tables) -> Scene:
    """Poiseuille's flow, in through one end and out through the other."""
    inlets = {"left": {"mean_velocity": 1.0}, "right": {"mean_velocity": 1.0, "profile": "-6*y*(H-y)/H^2"}}
    return box(folder, {"inlet": ["left", "right"], "walls": ["low", "high"]}, **{"inlet": inlets, **tables})


def test_what_comes_in_goes_out_at_the_other_inlet(tmp_path):
    result = checked(through(tmp_path, fluid={**WATER, "mean_pressure": LEVEL}), tmp_path / "run", error=True)
    assert result.data["errors"]["drag"]["bar"] < 1e-12  # P2 holds the flow
    mesh, state = state_of(result)
    x, y = mesh.p2_coordinates.T
    np.testing.assert_allclose(state.v, np.column_stack([6 * y * (1 - y), 0 * x]), rtol=0, atol=1e-9)
    pressure = LEVEL + 12 * MU * (LENGTH / 2 - mesh.vertices[:, 0])
    np.testing.assert_allclose(state.p, pressure, rtol=0, atol=1e-8)


def test_a_cavity_under_a_lid_is_what_the_checker_finds_by_itself(tmp_path):
    scene = box(tmp_path, {"walls": SIDES}, walls={"high": {"velocity_x": 1.0}}, lid=False)
    result = solve(scene, tmp_path / "run", sensitivities=True, error=True)
    assert result.checked and result.data["check"]["errors_difference"] < 1e-8, result.reason
    assert scene.fluid.mean_pressure == 0
    mesh, state = state_of(result)
    found = solve_again(System.build(problem_from_scene(result.scene), mesh)).state
    np.testing.assert_allclose(state.v, found.v, rtol=0, atol=1e-8)
    np.testing.assert_allclose(state.p, found.p, rtol=0, atol=1e-7 * np.abs(found.p).max())


def test_the_level_of_the_pressure_lifts_an_elastic_lid(tmp_path):
    sides = {"walls": "low", "symmetry": ["left", "right", "ends"]}
    fluid = {**WATER, "mean_pressure": LEVEL}
    result = solve(box(tmp_path, sides | {"clamped": "outside"}, lid=True, fluid=fluid), tmp_path / "run", error=True)
    assert result.checked and result.data["errors"]["tip_uy"]["bar"] < 1e-12, result.reason
    mu, lam = 40 / 2.6, 40 * 0.3 / (1.3 * 0.4)
    stretch = brentq(lambda f: mu * (f - 1 / f) + lam * np.log(f) / f + LEVEL, 0.5, 1)  # of a layer of 0.1
    assert state_of(result)[1].u[:, 1].max() == pytest.approx(0.1 * (1 - stretch), rel=1e-9)


def test_a_traction_presses_a_lid_on_a_flow(tmp_path):
    sides = {"inlet": "left", "outlet": "right", "walls": "low", "clamped": "ends", "loaded": "outside"}
    flow = {"inflow": {"mean_velocity": 0.1}, "outlet": {"kind": "do-nothing"}, "traction": {"y": -0.4}}
    result = solve(box(tmp_path, sides, lid=True, **flow), tmp_path / "run")
    assert result.checked and state_of(result)[1].u[:, 1].min() < -1e-3


@pytest.mark.parametrize("kind", ["linear-elastic", "hyperelastic"])
def test_a_balloon_holds_what_comes_in(kind, tmp_path):
    sides = {"inlet": "left", "walls": ["right", "low"], "clamped": "ends"}
    inflow = {"mean_velocity": 0.3, "profile": "uniform", "waveform": "sin(9*t)"}
    tables = {"time": {"step": 0.005, "end": 0.1}, "inflow": inflow, "mesh_motion": {"kind": kind}}
    result = checked(box(tmp_path, sides, lid=True, **tables), tmp_path / "run")
    mesh, state = state_of(result)
    corners = (mesh.p2_coordinates + state.u)[mesh.p2[mesh.region == 1]]  # both sides of each quadratic triangle
    area = sum(
        (4 * (cross(a, m) + cross(m, b)) - cross(a, b)).sum() / 6
        for a, m, b in ((corners[:, i], corners[:, 3 + (i + 2) % 3], corners[:, (i + 1) % 3]) for i in range(3))
    )
    came = 0.3 * (1 - np.cos(0.9)) / 9
    assert area - LENGTH == pytest.approx(came, rel=2e-3)


def test_a_wrong_level_is_caught(tmp_path, broken_script):
    broken_script("- loadFactor*fluidMeanPressure", "+ loadFactor*fluidMeanPressure")
    assert not solve(through(tmp_path, fluid={**WATER, "mean_pressure": LEVEL}), tmp_path / "run").checked


BOTH = {"walls": ["right", "low", "high"], "inlet": "left"}
REFUSED = [
    (BOTH, {"inflow": {"mean_velocity": 1}}, r"geometry\.boundaries\.outlet: 1 m\^2/s enter a closed fluid; accepted"),
    (BOTH, {"inflow": {"mean_velocity": 1, "waveform": "t"}, "time": TIME},
     r"outlet: 0\.2 m\^2/s enter a closed fluid at t = 0\.2 s"),
    ({"walls": ["right", "low", "high"], "outlet": "left"},
     {"outlet": {"kind": "do-nothing"}, "fluid": {**WATER, "mean_pressure": 1}},
     r"fluid\.mean_pressure = 1 Pa: only accepted in a closed fluid"),
    ({"walls": SIDES}, {"inflow": {"mean_velocity": 1}}, r"inflow: not accepted: geometry\.boundaries has no inlet"),
    ({"walls": ["left", "right"], "slip": ["low", "high"]},
     {"walls": {"left": {"displacement_x": "0.1*t"}}, "time": TIME},
     r"outlet: 0\.1 m\^2/s enter a closed fluid at t = 0 s"),
]  # fmt: skip


@pytest.mark.parametrize(("sides", "tables", "text"), REFUSED)
def test_refused(sides, tables, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        box(tmp_path, sides, **tables)


def test_a_wall_may_move_in_a_closed_fluid_that_keeps_its_volume(tmp_path):
    sides = {"walls": ["left", "right"], "slip": ["low", "high"]}
    walls = {"left": {"displacement_x": "0.1*(1-cos(5*t))*(y-0.5)"}}
    result = checked(box(tmp_path, sides, walls=walls, time=TIME), tmp_path / "run")
    assert np.abs(state_of(result)[1].v[:, 0]).max() == pytest.approx(0.25 * np.sin(1), rel=1e-8)
