"""Steps in time: both solvers come to the same, and steps that cannot be done end well or clearly."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from conftest import PLAIN

from ffsi.files.arrays import read_mesh, read_state
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result, load_result
from ffsi.run.one_scene import resume, solve
from ffsi.scene import load_scene, with_values

SMALL = ["mesh.level=0", "mesh.size_factor=2", "time.stop=end", *PLAIN]
MIXED = '{material = "neo-hookean", density = 1000.0, lame_mu = 2e6, poisson_ratio = 0.4, formulation = "mixed"}'


def run(directory, case: str, *settings: str) -> Result:
    return solve(load_scene(case, [*SMALL, *settings]), directory)


@pytest.mark.parametrize("settings", [
    [], [f"solid.beam={MIXED}"], ["mesh_motion.kind=hyperelastic"],
], ids=["displacement", "mixed", "hyperelastic mesh"])  # fmt: skip
def test_both_solvers_give_the_same_history(tmp_path, settings):
    tolerance, step = 1e-8, 0.01
    steps = ["inflow.ramp=0.05", f"time.step={step}", "time.end=0.06", f"solver.step_tolerance={tolerance}"]
    condensed, newton = (
        run(tmp_path / name, "turek-fsi3", *steps, *settings, f"solver.step={name}") for name in ("condensed", "newton")
    )
    for result in (condensed, newton):
        assert result.converged, result.reason
    assert newton.data["newton"]["factorizations"] > 3 * condensed.data["newton"]["factorizations"]
    scene = condensed.scene
    assert scene.fluid and scene.inflow and scene.forces
    speed = scene.inflow.mean_velocity
    # What a correction of the size of the tolerance, a mean over the nodes, changes; locally it may be much larger.
    displacement = 100 * tolerance * speed * step
    force = 100 * tolerance * scene.fluid.density * speed**2 * scene.forces.reference_length
    for name, accepted in {"tip_ux": displacement, "tip_uy": displacement, "drag": force, "lift": force}.items():
        one, other = (result.history[name].to_numpy() for result in (condensed, newton))
        print(f"{name}: {np.abs(one - other).max():.1e} of {np.abs(one).max():.1e}, accepted {accepted:.1e}")
        assert np.abs(one - other).max() < accepted < 1e-3 * np.abs(one).max() and not np.array_equal(one, other)


def test_where_the_mesh_folds_the_run_starts_again_with_one_that_does_not(tmp_path, caplog):
    flow = ["inflow.mean_velocity=0.4", "inflow.ramp=1", "time={step=0.05,end=1}"]
    scene = with_values(load_scene("flap-neo-hookean", [*SMALL[:2], *PLAIN, *flow]), {"mesh_motion": None})
    assert scene.mesh_motion.kind == "linear-elastic"
    result = solve(scene, tmp_path / "run")
    assert result.checked
    assert result.scene.mesh_motion.kind == load_scene(tmp_path / "run/scene.toml").mesh_motion.kind == "hyperelastic"
    (note,) = [text for text in result.data["warnings"] if "mesh_motion" in text]
    assert "the fluid mesh folds at" in note and note in caplog.text
    stated = solve(with_values(scene, {"mesh_motion.kind": "linear-elastic"}), tmp_path / "stated")
    assert not stated.converged and stated.reason.endswith("mesh_motion.kind = hyperelastic goes further")


def test_a_run_with_a_mesh_that_is_not_linear_resumes_to_the_last_digit(tmp_path):
    settings = ["mesh_motion.kind=hyperelastic", "time.step=0.01", "time.end=0.2", "time.checkpoint_interval=0.08"]
    whole = run(tmp_path / "run", "turek-fsi3", "inflow.ramp=0.05", *settings)
    for name in ("result.json", "point-0001.json", "point-0001.bin"):
        (whole.directory / name).unlink()
    again = resume(whole.directory)
    assert again.checked
    said = ["seconds"]
    pd.testing.assert_frame_equal(again.history.drop(columns=said), whole.history.drop(columns=said), check_exact=True)


@pytest.mark.parametrize("interval", ["0.04", "10"], ids=["from a checkpoint", "without one"])
def test_a_finished_run_goes_on_to_a_later_end(interval, tmp_path):
    """It is the run that would have had this end, but for the steps that the first one shortened for its own."""
    settings = ["inflow.ramp=0.05", "time.step=0.01", f"time.checkpoint_interval={interval}"]
    first = run(tmp_path / "run", "turek-fsi3", *settings, "time.end=0.1")
    whole = run(tmp_path / "whole", "turek-fsi3", *settings, "time.end=0.16")
    with pytest.raises(InputError, match=r"time.end = 0.1 s: must be later than the end of the run, 0.1 s"):
        resume(first.directory, end=0.1)
    assert load_result(first.directory).converged
    longer = resume(first.directory, end=0.16)
    assert longer.checked and longer.scene.time.end == 0.16
    said = ["seconds"]
    expected = whole.history.drop(columns=said)
    pd.testing.assert_frame_equal(longer.history.drop(columns=said), expected, check_exact=interval == "10", rtol=1e-6)
    assert load_result(first.directory).data["quantities"].keys() == whole.data["quantities"].keys()
    with pytest.raises(InputError, match="nothing to resume"):
        resume(first.directory)


def assert_finite(result: Result) -> None:
    """Assert that no file holds a number that is none, and that the last state is that of the last step."""
    history = pd.read_csv(result.directory / "history.csv")
    assert np.isfinite(history.to_numpy(dtype=float)).all()
    assert (history["min_jacobian"] > result.scene.solver.minimum_jacobian).all()
    mesh, states = read_mesh(result.directory / "mesh.bin"), sorted(result.directory.glob("*.bin"))
    raw = [path for path in states if re.match(r"(state|point|failed)", path.name)]
    assert raw
    for path in raw:
        state = read_state(path, mesh)
        assert all(np.isfinite(getattr(state, field)).all() for field in ("u", "v", "p")), path.name
    for path in result.directory.glob("*.json"):
        assert not re.search(r"\b(nan|inf|infinity)\b", path.read_text(), re.IGNORECASE), path.name
    last = result.last_quantities
    assert all(np.isfinite(value) for value in last.values())
    assert last["tip_uy"] == pytest.approx(history["tip_uy"].iloc[-1], rel=1e-6)
    assert json.loads((result.directory / "result.json").read_text())["time"]["reached"] == history["time"].iloc[-1]


def test_a_far_too_large_step_becomes_a_smaller_one(tmp_path):
    result = run(tmp_path / "run", "turek-fsi3", "inflow.ramp=0.2", "time.step=0.5", "time.end=1")
    assert result.converged, result.reason
    assert result.data["time"]["reached"] == 1.0 and result.history["step"].iloc[0] < 0.5
    assert "step halved" in (tmp_path / "run/freefem.log").read_text()
    assert_finite(result)


FAILING = {
    "inflow": ("turek-fsi3", "inflow.mean_velocity=2000", "inflow.ramp=0.1", "time.step=0.005", "time.end=0.1"),
    "gravity": ("turek-csm3", "gravity.y=-20000", "time.step=0.05", "time.end=0.2"),
    # The heavy beam falls onto the channel's floor: there the fluid's mesh folds.
    "floor": ("turek-fsi2", "gravity.y=-30", "inflow.mean_velocity=0.1", "time.step=0.01", "time.end=0.6",
        "mesh_motion.kind=harmonic", "mesh_motion.divergence_weight=1"),
}  # fmt: skip

PLACE = {"inflow": "solid beam", "gravity": "solid beam", "floor": "fluid mesh"}


@pytest.mark.parametrize("case", FAILING)
def test_a_far_too_strong_load_fails_with_the_last_good_state(tmp_path, case):
    result = run(tmp_path / "run", *FAILING[case])
    assert result.failure == "not-converged"
    reached = result.history["time"].iloc[-1]
    found = re.fullmatch(r"the step from t = (\S+) s fails down to dt = (\S+) s: (.*)", result.reason)
    assert found, result.reason
    assert float(found[1]) == pytest.approx(reached, rel=1e-5)
    assert result.scene.time is not None and float(found[2]) < 2.01e-3 * result.scene.time.step
    assert "J = det F" in found[3]
    folds = re.search(r"the (?P<place>fluid mesh) folds at \(\S+, \S+\): J = (?P<J>[^;]+)", found[3])
    small = re.search(
        r"last good state: smallest J (?P<J>\S+), in the (?P<place>solid beam) at \(\S+, \S+\)$", found[3]
    )
    worst = folds or small
    assert worst, result.reason
    assert worst["place"] == PLACE[case]
    assert float(worst["J"]) == pytest.approx(result.history["min_jacobian"].iloc[-1], rel=1e-4)
    assert result.state_file == "failed.bin" and len(result.history) >= 1
    assert_finite(result)
