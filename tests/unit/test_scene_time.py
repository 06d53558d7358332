"""Scenes in time."""

import math
import tomllib

import numpy as np
import pytest

from ffsi.scene import CASES, Scene, load_scene, with_values
from ffsi.scene.time import Time


def test_theta_of_the_schemes() -> None:
    assert Time(step="5 ms", end=1).theta_of(0.005) == 0.505 and Time(step=0.1, end=1, shift=2).theta_of(0.1) == 0.7
    assert Time(step=0.1, end=1, shift=2).theta_of(0.05) == 0.6 and Time(step=10, end=10).theta_of(10) == 1.0
    assert Time(step=0.1, end=1, shift=0).theta_of(0.1) == 0.5
    assert Time(step=0.1, end=1, scheme="crank-nicolson").theta_of(0.1) == 0.5
    assert Time(step=0.1, end=1, scheme="backward-euler").theta_of(0.01) == 1.0


@pytest.mark.parametrize("case", CASES.steady)
def test_steady_scenes_know_nothing_of_time(case: str) -> None:
    scene = CASES[case]
    table = tomllib.loads(scene.to_toml())
    assert "time" not in table and not {"ramp", "waveform"} & table.get("inflow", {}).keys()
    assert not {"step", "step_tolerance"} & table["solver"].keys() and scene.solver.step is None
    assert not any(key.startswith("time.") or "step" in key or "ramp" in key for key in scene.parameters())


def test_a_steady_scene_becomes_one_in_time_and_back() -> None:
    steady = CASES["turek-fsi1"]
    scene = with_values(steady, {"time.step": "10 ms", "time.end": 2, "inflow.ramp": 1})
    assert (scene.solver.step, scene.solver.step_tolerance) == ("condensed", 3e-5) and not scene.steady
    assert Scene.from_toml(scene.to_toml()) == scene
    changed = with_values(scene, {"solver.step": "newton", "solver.step_tolerance": 1e-8})
    assert (changed.solver.step, changed.solver.step_tolerance) == ("newton", 1e-8)
    back = with_values(scene, {"time": None, "inflow.ramp": None, "solver.step": None, "solver.step_tolerance": None})
    assert back == steady
    # What matters in time only does not stand in the way of a steady computation.
    assert with_values(scene, {"time": None, "inflow.ramp": None}).solver.step == "condensed"


@pytest.mark.parametrize("case", ["cook", "cantilever", "turek-cfd1", "turek-csm1", "cavity-flexible-floor"])
def test_every_physics_can_be_in_time(case: str) -> None:
    scene = load_scene(case, ["time={step=0.1, end=1, stop='periodic', adaptive=true, output_interval=0.5}"])
    assert scene.time is not None and scene.time.stop == "periodic" and Scene.from_toml(scene.to_toml()) == scene


def test_mixed_solids_and_inflow_in_time() -> None:
    values = {"time.step": 0.1, "time.end": 1, "mesh_motion.kind": "linear-elastic", "solid.flap.formulation": "mixed"}
    scene = with_values(CASES["flap-neo-hookean"], values)
    assert scene.solid["flap"].mixed and scene.time is not None
    inflow = CASES["turek-fsi3"].inflow
    assert inflow is not None
    np.testing.assert_allclose(inflow.factor([0.0, 0.5, 1.0, 2.0, 9.0]), [0, (1 - math.sqrt(0.5)) / 2, 0.5, 1, 1])
    assert inflow.waveform_expression.to_freefem() == "1.0"
    beating = load_scene("turek-cfd3", ["inflow.waveform=1 + 0.2*sin(2*pi*t)^2"]).inflow
    assert beating is not None
    t = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(
        beating.factor(t), np.where(t < 2, (1 - np.cos(np.pi * t / 2)) / 2, 1) * (1 + 0.2 * np.sin(2 * np.pi * t) ** 2)
    )
    assert beating.waveform_expression.to_freefem() == "1.0 + 0.2 * sin(2.0 * pi * t) ^ 2.0"
    assert beating.waveform_expression.to_freefem({"t": "time"}) == "1.0 + 0.2 * sin(2.0 * pi * time) ^ 2.0"
    without = load_scene("cylinder-2d1", ["time={step=0.1, end=1}", "inflow.waveform='2'"]).inflow
    assert without is not None
    np.testing.assert_array_equal(without.factor([0.0, 1.0]), [2.0, 2.0])
    assert without.factor(0.5).shape == ()
