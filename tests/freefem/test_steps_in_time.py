"""Steps in time: chosen by their local error, and the balance of the energy over them."""

import numpy as np
import pandas as pd
import pytest
from conftest import PLAIN

from ffsi.hemodynamics.result import Result
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, load_scene

SWING = ["mesh.level=0", "time.end=0.4", "time.stop=end"]


def swing(tmp_path, name: str, *settings: str) -> Result:
    """CSM3, the beam that falls under gravity, over its first 0.4 s."""
    return solve(load_scene("turek-csm3", [*SWING, *PLAIN, *settings]), tmp_path / name)


@pytest.fixture(scope="module")
def fine(tmp_path_factory) -> Result:
    return swing(tmp_path_factory.mktemp("fine"), "run", "time.step=0.0025")


@pytest.fixture(scope="module")
def coarse(tmp_path_factory) -> Result:
    return swing(tmp_path_factory.mktemp("coarse"), "run", "time.step=0.01")


def error(result: Result, fine: Result) -> float:
    """Largest difference of u_y from the fine run, relative to the largest u_y, at the result's own times."""
    history, exact = result.history, fine.history
    at = np.interp(history["time"], exact["time"], exact["tip_uy"])
    return float(np.abs(history["tip_uy"] - at).max() / np.abs(at).max())


def test_ordinary_steps_are_kept_for_the_checker(fine):
    """Eight to sixteen, all over the run: of each stretch the step with the most iterations, the first of equals."""
    rows = pd.read_csv(fine.directory / "steps.csv", skipinitialspace=True)
    ordinary = rows[rows["tolerance"] > 0]
    assert ordinary["tolerance"].between(1e-6, fine.scene.solver.step_tolerance).all()
    assert len(rows) == len(ordinary) + 1  # and the end
    iterations = fine.history["iterations"].iloc[:-1].set_axis(range(1, len(fine.history)))
    stretches = [iterations.iloc[start : start + 16] for start in range(0, len(iterations), 16)]
    assert 8 <= len(stretches) <= 16 and ordinary["step"].tolist() == [part.idxmax() for part in stretches]
    assert any(part.min() < part.max() for part in stretches)


def test_steps_follow_the_accepted_error_and_hit_the_outputs(tmp_path, fine):
    words = "time={{step=0.05, end=0.2, adaptive=true, error={}, output_interval=0.1}}"
    runs = [swing(tmp_path, f"error-{tolerance}", words.format(tolerance)) for tolerance in (1e-2, 1e-3)]
    for run in runs:
        assert run.converged, run.reason
        times = [step.time for step in run.saved_steps]
        np.testing.assert_allclose(times, [0.1, 0.2], rtol=1e-12)
        assert run.history["step"].max() <= 0.05 * (1 + 1e-9)
    coarse, sharp = runs
    assert len(sharp.history) > 2 * len(coarse.history)
    assert np.ptp(sharp.history["step"]) > 1e-4  # chosen, not one for all
    assert error(sharp, fine) < min(0.005, 0.7 * error(coarse, fine))


def test_the_energy_of_a_swinging_beam_is_the_work_of_gravity(coarse, fine):
    left = [abs(run.data["time"]["energy"]["imbalance"]) for run in (coarse, fine)]
    assert left[1] < 2e-4
    assert left[0] > 3 * left[1]  # an error of the steps, nothing that is forgotten
    assert coarse.data["time"]["energy"]["elastic"] > 100 * abs(coarse.data["time"]["energy"]["dissipated"])


def test_the_energy_of_a_flow_around_a_beam(tmp_path):
    scene = load_scene(
        "turek-fsi3", ["mesh.level=0", "time.step=0.01", "time.end=0.3", "time.stop=end", "inflow.ramp=0.25", *PLAIN]
    )
    energy = solve(scene, tmp_path / "run").data["time"]["energy"]
    assert energy["kinetic"] > 0.8 * energy["work"] > 0 and energy["dissipated"] > 0 and abs(energy["imbalance"]) < 5e-3


def test_no_sliver_is_left_before_the_end(tmp_path):
    """A step that does not quite divide the time: the last one is longer, and the checker knows such steps."""
    step = 0.4 / 20.0005
    run = swing(tmp_path, "run", f"time.step={step!r}")
    assert run.converged, run.reason
    lengths = run.history["step"].to_numpy()
    assert len(lengths) == 20 and step * 1.0001 < lengths.max() == lengths[-1] < step * 1.001


def test_no_sliver_is_left_between_an_output_and_the_end(tmp_path):
    run = swing(tmp_path, "run", "time={step=0.01, end=0.1000001, output_interval=0.1}", "time.stop=end")
    assert run.converged, run.reason
    assert len(run.history) == 10 and run.history["time"].iloc[-1] == run.scene.time.end


@pytest.mark.parametrize("waveform", ["sin(2 * pi * t / 0.2)", "sin(pi * t / 0.2)^2"])
def test_an_inflow_that_passes_through_zero_is_checked(tmp_path, waveform):
    """What is prescribed then is rounding, and no measure of a deviation."""
    scene = Scene.model_validate({
        "name": "to-and-fro",
        "geometry": {"kind": "channel", "length": 8e-3, "height": 2e-3},
        "mesh": {"level": 0},
        "fluid": {"density": 1060.0, "viscosity": 3.5e-3},
        "inflow": {"mean_velocity": 0.02, "waveform": waveform},
        "outlet": {"kind": "do-nothing"},
        "time": {"step": 0.01, "end": 0.2, "output_interval": 0.1},
        "output": {"pictures": False, "vtu": False},
    })  # fmt: skip
    run = solve(scene, tmp_path / "run")
    assert run.converged, run.reason
    assert abs(run.scene.inflow.factor(np.array([0.2]))[0]) < 1e-15


def test_steps_that_are_too_large_are_said(tmp_path, coarse, fine):
    assert fine.warnings == []
    large = swing(tmp_path, "large", "time.step=0.08")
    print(f"errors {error(coarse, fine):.1e}, {error(large, fine):.1e}; {large.warnings}")
    assert error(coarse, fine) < 0.02 < error(large, fine) and coarse.warnings == [] and large.warnings
    assert all("time.step = " in text for text in large.warnings)
