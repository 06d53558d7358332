"""Real runs in time: killed and resumed, stopped, outputs at their times, and the files for the checker."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import PLAIN

import ffsi
from ffsi.cli.main import main
from ffsi.cli.show import summary
from ffsi.files import folder
from ffsi.files.manifest import Recorder
from ffsi.files.steps import read_steps
from ffsi.freefem import Event
from ffsi.hemodynamics.result import load_result
from ffsi.reference import check_run
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, load_scene
from ffsi.script.render import render

COMMAND = [sys.executable, "-c", "from ffsi.cli.main import main; main()"]
STEPS = [
    *("mesh.level=0", "time.step=0.01", "time.end=0.2", "time.stop=end"),
    *("time.output_interval=0.045", "time.checkpoint_interval=0.05"),
]
# Share of the steps after which the script is killed, and the part of a step that it is let go on; the first, which
# every call of the tests runs, behind two checkpoints.
MOMENTS = sorted(np.random.default_rng(20).uniform((0.0, 0.0), (0.85, 1.0), (5, 2)).tolist(), reverse=True)


def fsi3(*settings: str) -> Scene:
    return load_scene("turek-fsi3", [*STEPS, *PLAIN, *settings])


whole = pytest.fixture(lambda tmp_path_factory: solve(fsi3(), tmp_path_factory.mktemp("whole") / "run"), scope="module")


def wait_for_rows(history: Path, rows: float, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 60
    while not history.is_file() or len(history.read_text().splitlines()) <= rows:
        assert process.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.005)


def killed(out: Path, rows: int, case: str | Path, *settings: str) -> None:
    """Run a case and kill the whole process group with SIGKILL after so many rows of the history."""
    told = [item for word in settings for item in ("--set", word)]
    words = [*COMMAND, "run", str(case), *told, "--out", str(out)]
    process = subprocess.Popen(words, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    history = out / "history.csv"
    try:
        wait_for_rows(history, rows, process)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    for _ in range(200):  # the kernel kills FreeFEM with its parent
        before = history.read_bytes()
        time.sleep(0.05)
        if history.read_bytes() == before:
            return


def same(a: Path, b: Path) -> None:
    """Assert that two folders hold the same computation up to 1e-10, but for the seconds."""
    for name in ("history.csv", "newton.csv", "steps.csv"):
        one, other = (pd.read_csv(path / name).drop(columns="seconds", errors="ignore") for path in (a, b))
        words = one.select_dtypes(exclude="number").columns
        assert one[words].equals(other[words])
        np.testing.assert_allclose(one.drop(columns=words), other.drop(columns=words), rtol=1e-10, atol=1e-14)
    one, other = (sorted(path.name for path in folder.glob("state-*.bin")) for folder in (a, b))
    assert one == other


def test_a_whole_run_is_complete_and_its_saved_steps_solve_their_equations(whole):
    assert whole.converged, whole.reason
    assert whole.data["time"]["reached"] == pytest.approx(0.2, abs=1e-12)
    assert len(whole.history) == whole.data["time"]["steps"]
    assert list(whole.history) == [
        *("time", "step", "drag", "lift", "tip_ux", "tip_uy", "min_jacobian"),
        *("kinetic", "elastic", "dissipated", "work", "iterations", "factorized", "seconds"),
    ]  # fmt: skip
    np.testing.assert_allclose(whole.history["step"].cumsum(), whole.history["time"], rtol=1e-12)
    last, final = whole.history.iloc[-1], whole.last_quantities
    for name in ("drag", "lift", "tip_ux", "tip_uy", "min_jacobian"):
        assert last[name] == pytest.approx(final[name], rel=1e-6, abs=1e-12)
    times = [step.time for step in whole.saved_steps]
    assert times == pytest.approx([0.045, 0.09, 0.135, 0.18, 0.2], abs=1e-14)
    listed = read_steps(whole.directory)
    ordinary = [entry for entry in listed if entry.tolerance]
    assert len(ordinary) >= 8
    assert all(1e-6 <= entry.tolerance < whole.scene.solver.step_tolerance for entry in ordinary)
    entries = [entry for entry in listed if not entry.tolerance]
    for entry, row in zip(entries, whole.saved_steps, strict=True):
        at = whole.history.iloc[entry.step - 1]
        assert (at["time"], at["step"]) == pytest.approx((row.time, row.k), rel=1e-12)
        assert at["drag"] == pytest.approx(entry.quantities["drag"], rel=1e-12) and whole.scene.time is not None
        assert entry.theta == pytest.approx(whole.scene.time.theta_of(entry.k), rel=1e-12)
    assert {f"{row.new}" for row in whole.saved_steps} <= {path.name for path in whole.directory.iterdir()}
    report = check_run(whole.directory, whole.scene)
    assert report.passed, report.failures
    checked = [report.momentum, report.continuity, report.kinematics, report.mesh_motion, report.drag_difference]
    assert all(value is not None and value < 1e-9 for value in checked)
    assert 0 < report.step_error < 0.01  # of ordinary steps, over their tolerance


def test_no_second_is_counted_twice_or_forgotten(whole):
    timings = json.loads((whole.directory / "point-0001.json").read_text())["timings"]  # before Python adds its own
    parts = ("mesh", "operators", "residual", "jacobian", "factorize", "solve", "output")
    assert 0.93 * timings["script"] < sum(timings[part] for part in parts) < timings["script"]


def test_an_output_time_between_two_steps_is_hit(tmp_path):
    result = solve(fsi3("time.output_interval=0.025", "time.end=0.1"), tmp_path / "run")
    assert result.converged, result.reason
    assert [step.time for step in result.saved_steps] == pytest.approx([0.025, 0.05, 0.075, 0.1], abs=1e-14)
    assert result.history["step"].max() <= 0.01 + 1e-12 and result.history["step"].min() > 0.002


@pytest.mark.parametrize(("share", "late"), MOMENTS, ids=range(len(MOMENTS)))
def test_a_script_killed_at_any_moment_comes_to_the_same_when_it_goes_on(tmp_path, whole, installation, share, late):
    """Kill FreeFEM after a share of the steps and a part of the next one; Python has written nothing at the end."""
    out = tmp_path / "run"
    folder.prepare(out)
    (out / folder.SCRIPT).write_text(render(whole.scene, mumps=installation.has_mumps), encoding="utf-8")
    (out / folder.SCENE).write_text(whole.scene.to_toml(), encoding="utf-8")
    command = [installation.binary, "-nw", "-ns", "-v", "0", out / folder.SCRIPT, "-out", out]
    seconds = whole.history["seconds"]
    with (out / folder.LOG).open("w") as log:
        process = subprocess.Popen(command, env=installation.environment(), stdout=log, cwd=out)
        wait_for_rows(out / "history.csv", share * len(seconds), process)
        time.sleep(late * seconds.diff().median())
        assert process.poll() is None, "it ended before it could be killed"
        process.kill()
        process.wait()
    Recorder(out).look()  # as Python does that watches it
    rows = len((out / "history.csv").read_text().splitlines()) - 1
    assert rows < len(seconds)
    result = ffsi.resume(out)
    assert result.converged, result.reason
    if rows > 6:  # the first checkpoint is that of step 5
        assert "step=1 " not in (out / folder.LOG).read_text(), "it has started over"
    same(out, whole.directory)


def test_killed_twice(tmp_path, whole, capsys):
    killed(tmp_path / "run", 8, "turek-fsi3", *STEPS, *PLAIN)
    assert not (tmp_path / "run" / "result.json").exists()
    words = [*COMMAND, "run", "--resume", str(tmp_path / "run")]
    process = subprocess.Popen(words, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for_rows(tmp_path / "run" / "history.csv", 14, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    time.sleep(0.3)
    assert ffsi.resume(tmp_path / "run").converged
    same(tmp_path / "run", whole.directory)
    with pytest.raises(SystemExit) as stopped:
        main(words[-3:])
    assert stopped.value.code == 2 and "there is nothing to resume" in " ".join(capsys.readouterr().err.split())


def test_a_run_that_goes_on_with_another_inflow_and_step(tmp_path):
    """As with one formula that jumps there; killed on its way, too; no step passes by what holds in others."""
    run, jump = tmp_path / "run", "1 + min(max(1e9*(t - 0.1), 0), 1)"
    settings = ["time.output_interval=0.1", "time.checkpoint_interval=0.1"]
    once = solve(fsi3(*settings, f"inflow.waveform={jump}"), tmp_path / "once")
    solve(fsi3(*settings, "time.end=0.1"), run)
    changed = ['inflow.waveform="2"', "time.end=0.2", "time.checkpoint_interval=0.05"]
    words = [*COMMAND, "run", "--resume", str(run), *(word for text in changed for word in ("--set", text))]
    process = subprocess.Popen(words, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for_rows(run / "history.csv", 17, process)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    result = ffsi.resume(run)
    assert result.checked, result.reason
    same(run, once.directory)
    finer = ffsi.resume(run, end=0.23, values={"time.step": 0.005})
    assert finer.checked and finer.history["step"][20:].to_numpy() == pytest.approx(0.005)
    assert [each["step"] for each in finer.data["time"]["changed"]] == [10, 20]
    assert re.search(
        r"from t = 0.1 s on inflow.waveform = 2, .*; from t = 0.2 s on time.step = 0.005", str(summary(finer))
    )
    for earlier, text in (("000010", "dirichlet"), ("000020", "k = 0.01")):
        shutil.copytree(run, tmp_path / earlier)
        (tmp_path / earlier / f"scene-until-{earlier}.toml").unlink()
        try:
            failures = check_run(tmp_path / earlier, finer.scene).failures
        except ValueError as error:
            failures = [str(error)]
        assert text in " ".join(failures)


def test_the_stop_file_ends_a_run_cleanly_with_its_last_state(tmp_path):
    def stop(event: Event) -> None:
        if event.kind == "time" and event.integer("step") == 15:
            (tmp_path / "run" / "stop").write_text("1\n")

    result = solve(fsi3("time.end=30", "time.output_interval=10"), tmp_path / "run", on_event=stop)
    assert result.failure == "stopped", result.reason
    assert 0.15 <= result.data["time"]["reached"] < 1 and result.state_file == "point-0001.bin"
    steps = result.saved_steps
    assert [step.step for step in steps] == [len(result.history)]
    np.testing.assert_array_equal(result.fields.velocity, result.fields_of(steps[-1]).velocity)
    assert load_result(tmp_path / "run").failure == "stopped"


def test_it_stops_when_it_is_periodic(tmp_path, monkeypatch):
    monkeypatch.setattr("ffsi.run.watch.LOOK_EVERY", 0.2)
    steps = ["mesh.level=0", "time.step=0.04", "time.shift=0.1", "time.end=200"]
    result = solve(load_scene("turek-csm3", [*steps, *PLAIN]), tmp_path / "run")
    assert result.converged, result.reason
    time = result.data["time"]
    assert time["periodic"] and time["reached"] < 50
    assert result.quantities["tip_uy"]["frequency"] == pytest.approx(1.0995, rel=0.03)


def test_an_undamped_scheme_keeps_its_energy(tmp_path):
    """Nothing damps what a step lacks: solved as damped schemes are, the balance misses by 8e-6 of the work."""
    steps = ["mesh.level=0", "time.scheme=crank-nicolson", "time.step=0.02", "time.end=1"]
    history = solve(load_scene("turek-csm3", [*steps, *PLAIN]), tmp_path / "run").history
    stored = history["kinetic"] + history["elastic"] + history["dissipated"]
    assert (stored - history["work"]).abs().max() < 2e-6 * history["work"].abs().max()


def test_a_sweep_in_time_runs_every_point(tmp_path):
    scene = fsi3("time.end=0.02", "time.output_interval=0.02", "time.checkpoint_interval=0.02")
    table = ffsi.sweep(scene, {"fluid.viscosity": [1.0, 2.0]}, tmp_path / "sweep")
    assert table["status"].tolist() == ["converged"] * 2 and table["folder"].tolist() == ["chain-001", "chain-002"]
