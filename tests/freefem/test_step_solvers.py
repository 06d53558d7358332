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
from ffsi.scene import Scene, load_scene, with_values

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


RESUMED = {
    "a mesh that is not linear": (
        "turek-fsi3", "inflow.ramp=0.05", "mesh_motion.kind=hyperelastic", "time.step=0.01", "time.end=0.2",
        "time.checkpoint_interval=0.08",
    ),
    "steps by earlier ones": ("turek-csm3", "time.step=0.02", "time.end=1.3", "time.checkpoint_interval=0.6"),
}  # fmt: skip


@pytest.mark.parametrize("settings", RESUMED.values(), ids=RESUMED)
def test_a_run_resumes_to_the_last_digit(settings, tmp_path):
    whole = run(tmp_path / "run", *settings)
    expected = whole.history  # read from the folder that the run goes on in
    for name in ("result.json", "point-0001.json", "point-0001.bin"):
        (whole.directory / name).unlink()
    again = resume(whole.directory)
    assert again.checked
    said = ["seconds"]
    pd.testing.assert_frame_equal(again.history.drop(columns=said), expected.drop(columns=said), check_exact=True)


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


def test_a_correction_is_measured_by_its_root_mean_square_over_the_largest_velocity(tmp_path):
    """The first one of a solid that its weight sets off is its velocity."""
    folder = run(tmp_path / "run", "turek-csm3", "time.step=0.001", "time.end=0.001").directory
    v = read_state(folder / "point-0001.bin", read_mesh(folder / "mesh.bin")).v
    first = pd.read_csv(folder / "newton.csv")["correction"][0]
    assert first == pytest.approx(np.sqrt((v**2).mean()) / np.abs(v).max(), rel=1e-5)


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


@pytest.mark.parametrize("ramp", [(), ("inflow.ramp=0.5",)], ids=["at once", "ramp"])
def test_steps_follow_a_flow_and_not_its_pressure(ramp, solved):
    """That of a step stands for t_n + theta k: taken for that of t_n it made ten times as many steps, of any length."""
    steps = solved("cylinder-2d1", "inflow.mean_velocity=1", *ramp, "time={step=0.05, end=0.4, adaptive=true}").history
    assert len(steps) < 40 and (steps["step"].iloc[:-2].pct_change().dropna() > -0.4).all()


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


def test_no_sliver_is_left_before_the_end_or_behind_an_output(tmp_path):
    """A step that does not quite divide the time: the last one is longer, and the checker knows such steps."""
    step = 0.4 / 20.0005
    run = swing(tmp_path, "run", f"time.step={step!r}")
    assert run.converged, run.reason
    lengths = run.history["step"].to_numpy()
    assert len(lengths) == 20 and step * 1.0001 < lengths.max() == lengths[-1] < step * 1.001
    run = swing(tmp_path, "output", "time={step=0.01, end=0.1000001, output_interval=0.1}", "time.stop=end")
    assert run.converged, run.reason
    assert len(run.history) == 10 and run.history["time"].iloc[-1] == run.scene.time.end


@pytest.mark.parametrize("waveform", ["sin(2 * pi * t / 0.2)", "sin(pi * t / 0.2)^2"])
def test_an_inflow_that_passes_through_zero_is_checked_and_its_next_period_predicted(tmp_path, waveform):
    """What is prescribed then is rounding, and no measure of a deviation. The third period is known from the others."""
    scene = Scene.model_validate({
        "name": "to-and-fro", "geometry": {"kind": "channel", "length": 8e-3, "height": 2e-3}, "mesh": {"level": 0},
        "fluid": {"density": 1060.0, "viscosity": 3.5e-3}, "outlet": {"kind": "do-nothing"},
        "inflow": {"mean_velocity": 0.02, "waveform": waveform},
        "time": {"step": 0.01, "end": 0.6, "output_interval": 0.1},
        "output": {"pictures": False, "vtu": False},
    })  # fmt: skip
    run = solve(scene, tmp_path / "run")
    assert run.converged, run.reason
    assert abs(run.scene.inflow.factor(np.array([0.2]))[0]) < 1e-15
    first = pd.read_csv(run.directory / "newton.csv").groupby("step")["correction"].first()
    assert first.iloc[-20:].max() < 0.02  # lines and parabolas through the last states alone: 0.27 and more


def test_steps_that_are_too_large_are_said(tmp_path, coarse, fine):
    assert fine.warnings == []
    large = swing(tmp_path, "large", "time.step=0.08")
    print(f"errors {error(coarse, fine):.1e}, {error(large, fine):.1e}; {large.warnings}")
    assert error(coarse, fine) < 0.02 < error(large, fine) and coarse.warnings == [] and large.warnings
    assert all("time.step = " in text for text in large.warnings)
