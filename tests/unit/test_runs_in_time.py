"""Runs in time with a stand-in for the script: results, resuming, what is refused, words, reports and pictures."""

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from run_folders import given_state, make_run, report_text, structured_mesh
from test_cli import call
from time_folders import FREQUENCY, scene_in_time, signals

import ffsi
from ffsi.files import folder
from ffsi.files.checkpoints import CHECKPOINT_VERSION
from ffsi.files.errors import InputError
from ffsi.files.history import read_history
from ffsi.files.steps import SavedStep, read_steps
from ffsi.freefem import Event, FreeFEMError
from ffsi.hemodynamics.result import load_result
from ffsi.report import history as histories
from ffsi.report.animation import write_animation
from ffsi.result import in_time, oscillation, pictures, vtu
from ffsi.result.fields import Fields
from ffsi.result.in_time import PERIODS, settled
from ffsi.result.published import references
from ffsi.result.quantities import flatten, published_value
from ffsi.result.words import time_line
from ffsi.run import execute, one_scene, sweep
from ffsi.run.chain import run_chain
from ffsi.run.watch import Watch
from ffsi.scene import load_scene

pytestmark = pytest.mark.usefixtures("check", "in_an_empty_folder")

ROOT = Path(__file__).parents[2]


def files(directory):
    return {path.name for path in directory.iterdir()}


def die(in_time, directory, step, **options):
    """Run until the script dies after a step; the next one lives."""
    in_time.die = step
    with pytest.raises(FreeFEMError, match="killed"):
        one_scene.solve(scene_in_time(), directory, **options)
    in_time.die = None


def test_quantities_are_those_of_the_last_period(tmp_path, in_time):
    result = one_scene.solve(scene_in_time("time.end=3"), tmp_path / "run")
    assert result.converged and json.loads((tmp_path / "run" / "result.json").read_text()) == result.data
    found = result.quantities
    assert found["tip_uy"] == pytest.approx({"mean": 0.001, "amplitude": 0.03, "frequency": 1.0}, rel=5e-3)
    assert found["drag"] == pytest.approx({"mean": 400, "amplitude": 20, "frequency": 2.0}, rel=5e-3)
    unit = 0.5 * 1000 * 2.0**2 * 0.1
    assert found["lift_coefficient"]["amplitude"] == pytest.approx(150 / unit, rel=5e-3)
    assert found["min_jacobian"] == pytest.approx(0.4, abs=1e-3)
    assert set(found) == {
        *("drag", "lift", "tip_ux", "tip_uy", "drag_coefficient", "lift_coefficient", "min_jacobian"),
    }  # fmt: skip
    assert result.data["newton"] == {"iterations": 120, "factorizations": 6}
    time = result.data["time"]
    assert (time["reached"], time["end"], time["steps"], time["periodic"]) == (3.0, 3.0, 60, False)
    assert time["why_not"] == "tip_uy: 1 full period found, 4 needed" and time["last"] == result.last_quantities
    assert len(result.history) == 60 and result.history["tip_uy"].iloc[-1] == pytest.approx(signals(3.0)["tip_uy"])


def test_without_a_full_period_there_are_no_numbers_but_those_of_the_last_state(tmp_path, in_time):
    result = one_scene.solve(scene_in_time("time.end=0.5"), tmp_path / "run")
    assert result.quantities["drag"] == {"mean": None, "amplitude": None, "frequency": None}
    when, shown = result.shown_quantities
    assert when == "at t = 0.5 s" and shown["drag"] == result.data["time"]["last"]["drag"]
    assert list(flatten(result.quantities)) == ["min_jacobian"]


def test_the_steps_are_listed_for_the_checker_and_drawn(tmp_path, in_time):
    result = one_scene.solve(scene_in_time("output.vtu=true"), tmp_path / "run")
    entries = read_steps(tmp_path / "run")
    assert [entry.step for entry in entries] == [10, 20, 30, 40]
    forces = {"drag": signals(1.0)["drag"], "lift": signals(1.0)["lift"]}
    assert entries[1] == SavedStep(20, 1.0, 0.05, 0.55, "state-000019.bin", "state-000020.bin", forces)
    names = {"fields-000010.vtu", "fields-000020.vtu", "fields-000030.vtu", "fields-000040.vtu", "fields.pvd"}
    assert {name for name in files(tmp_path / "run") if name.startswith("fields")} == names
    assert [step.time for step in result.saved_steps] == [0.5, 1.0, 1.5, 2.0]
    np.testing.assert_array_equal(result.fields_at(1.4).velocity, result.fields_of(result.saved_steps[2]).velocity)


def test_a_failed_step_keeps_the_history_and_the_last_good_state(tmp_path, in_time, check):
    in_time.fail = 33
    result = one_scene.solve(scene_in_time("output.vtu=true"), tmp_path / "run")
    assert (result.status, result.failure, result.reason) == ("failed", "not-converged", "no step")
    assert result.data["time"]["reached"] == 1.6 and result.state_file == "failed.bin"
    assert {"fields.vtu", "fields-000030.vtu"} <= files(tmp_path / "run") and check.calls == []


def test_a_crash_is_raised_and_keeps_what_was_finished(tmp_path, in_time):
    die(in_time, tmp_path / "run", 27)
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert (data["failure"], data["time"]["steps"]) == ("crash", 27)
    assert len(load_result(tmp_path / "run").history) == 27


def test_a_crash_before_the_first_step(tmp_path, in_time, monkeypatch):
    def crash(*_, **__):
        raise FreeFEMError("crash", "at once")

    monkeypatch.setattr(execute, "run_script", crash)
    with pytest.raises(FreeFEMError, match="at once"):
        one_scene.solve(scene_in_time(), tmp_path / "run")
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert (data["quantities"], data["time"]["reached"], data["time"]["periodic"]) == ({}, 0.0, False)
    assert "at once" in report_text(tmp_path, tmp_path / "run")


def test_an_earlier_run_is_replaced(tmp_path, in_time):
    one_scene.solve(scene_in_time("output.vtu=true"), tmp_path / "run")
    one_scene.solve(scene_in_time("time.end=1", "time.output_interval=1"), tmp_path / "run")
    states = {name for name in files(tmp_path / "run") if name.startswith(("state", "fields"))}
    assert states == {"state-000019.bin", "state-000020.bin"} and in_time.first_steps == [1, 1]


def test_it_stops_when_it_is_periodic_but_need_not_be(tmp_path, in_time):
    result = one_scene.solve(scene_in_time("time.stop=periodic", "time.end=50"), tmp_path / "run")
    assert result.converged
    time = result.data["time"]
    assert time["periodic"] and time["why_not"] == "" and 0.1 + PERIODS / FREQUENCY <= time["reached"] < 10
    result = one_scene.solve(scene_in_time("time.stop=periodic"), tmp_path / "run")
    assert result.converged and not result.data["time"]["periodic"]


def test_stopped_by_hand_is_not_finished_and_goes_on(tmp_path, in_time, check):
    in_time.stop_at = 23
    result = one_scene.solve(scene_in_time(), tmp_path / "run")
    assert (result.failure, result.reason) == ("stopped", "stopped at t = 1.15 s of 2 s") and result.solved
    assert check.calls == [(2.0, 1)]
    in_time.stop_at = None
    again = ffsi.resume(tmp_path / "run")
    assert again.converged and in_time.first_steps == [1, 21] and len(again.history) == 40


@pytest.mark.parametrize(("end", "ramp", "grows", "reason"), [
    (12.0, 2.0, 0.0, ""), (6.0, 2.0, 0.0, "only 4.0 periods"), (3.2, 0.1, 0.0, "full periods found"),
    (12.0, 2.0, 0.1, "the amplitude changes"),
])  # fmt: skip
def test_settled_needs_equal_periods_long_enough_after_the_ramp(end, ramp, grows, reason):
    t = np.arange(0.01, end, 0.01)
    found = settled(scene_in_time(f"inflow.ramp={ramp}"), t, np.exp(grows * t) * np.sin(2 * np.pi * t))
    assert bool(found) == (not reason) and reason in found.reason


def write_history(directory, t, y, name="tip_uy", end="\n"):
    rows = "".join(f"{a!r},0.01,{b!r}\n" for a, b in zip(t.tolist(), y.tolist(), strict=True))
    (directory / "history.csv").write_text(f"time,step,{name}\n{rows}".rstrip("\n") + end)


def test_the_watch_reports_the_signal_and_reads_every_line_once(tmp_path):
    events, clock = [], iter(np.arange(0.0, 1000.0, 1.0)).__next__
    watch = Watch(scene_in_time(), tmp_path, events.append, clock=lambda: float(clock()))
    t = np.arange(0.01, 3.0, 0.01)
    y = 0.2 + 0.5 * np.sin(2 * np.pi * 2 * t)
    write_history(tmp_path, t[:180], y[:180], end="")  # the last line is still being written
    watch.look()
    write_history(tmp_path, t, y)
    watch.look()
    assert watch._tail.times == pytest.approx(t)
    assert [event.kind for event in events] == ["signal", "signal"] and events[-1].fields["name"] == "tip_uy"
    assert events[-1].fields["unit"] == "m"
    assert [events[-1].number(key) for key in ("mean", "amplitude", "frequency")] == pytest.approx(
        [0.2, 0.5, 2.0], 1e-3
    )
    assert not (tmp_path / "stop").exists()  # time.stop is "end"


def test_the_watch_looks_rarely_and_passes_every_event_on(tmp_path, monkeypatch):
    seen, looks, now = [], [], [0.0]
    watch = Watch(scene_in_time(), tmp_path, seen.append, clock=lambda: now[0])
    monkeypatch.setattr(watch, "look", lambda: looks.append(now[0]))
    for i in range(100):
        now[0] = 0.1 * i
        watch(Event("time", {"step": i}))
    assert len(seen) == 100 and len(looks) == 4
    watch(Event("warning"))
    assert seen[-1].kind == "warning"


def test_the_watch_takes_the_lift_where_nothing_moves_and_no_wrong_numbers(tmp_path):
    events = []
    write_history(tmp_path, np.array([0.1, 0.2]), np.array([1.0, math.nan]))
    Watch(scene_in_time("time.stop=periodic"), tmp_path, events.append).look()
    assert events == []
    events, t = [], np.arange(0.01, 12.0, 0.01)
    write_history(tmp_path, t, 3 + np.sin(2 * np.pi * t), "lift")
    Watch(load_scene("cylinder-2d2", ["time.stop=periodic"]), tmp_path, events.append).look()
    assert (events[0].fields["name"], events[0].fields["unit"]) == ("lift", "N/m")
    assert (tmp_path / "stop").read_text() == "1 periodic\n"


@pytest.fixture(params=[1, 4, 5, 6, 12, 23, 39])
def died(request, tmp_path, in_time):
    """A run that died at some step; Python was killed with it."""
    die(in_time, tmp_path / "run", request.param)
    (tmp_path / "run" / "result.json").unlink()
    return tmp_path / "run"


def test_a_killed_run_goes_on_from_its_last_checkpoint_and_comes_to_the_same(died, in_time, tmp_path):
    steps, result = len(read_history(died)), ffsi.resume(died)
    assert result.converged
    whole = one_scene.solve(scene_in_time(), tmp_path / "whole")
    for name in ("history.csv", "newton.csv", "steps.csv"):
        assert (died / name).read_text() == (tmp_path / "whole" / name).read_text()
    assert result.quantities == whole.quantities
    # A step that ends at a checkpoint's time dies before the checkpoint is written.
    assert in_time.first_steps[:2] == [1, max(0, steps - 1) // 5 * 5 + 1]
    assert (died / "freefem-0001.log").is_file()


def test_a_resumed_run_that_dies_goes_on_again(tmp_path, in_time):
    for step in (8, 18, 29):
        die(in_time, tmp_path / "run", step, resume=step > 8)
    assert ffsi.resume(str(tmp_path / "run")).converged and in_time.first_steps == [1, 6, 16, 26]
    assert len(list((tmp_path / "run").glob("freefem-*.log"))) == 3


def test_checkpoints_have_the_version_that_the_library_writes():
    """Of another version none is taken, and each run that goes on starts over."""
    library = (ROOT / "edp/lib/checkpoints.idp").read_text(encoding="utf-8")
    versions = re.findall(r"head = \[(\d+), |head\[0\] != (\d+)", library)
    versions += re.findall(
        r"`checkpoint-b.bin`.*\[version=(\d+)(),", (ROOT / "docs/formats.md").read_text(encoding="utf-8")
    )
    assert ["".join(found) for found in versions] == [str(CHECKPOINT_VERSION)] * 3


def test_the_checkpoint_in_use_is_not_the_next_one_to_be_written(tmp_path, in_time):
    die(in_time, tmp_path / "run", 8)  # only checkpoint-a, of step 5, is there
    ffsi.resume(tmp_path / "run")
    assert in_time.arguments[-1]["resume"].endswith("checkpoint-b.bin")


def test_if_the_script_had_ended_only_the_rest_is_done(tmp_path, in_time, check):
    one_scene.solve(scene_in_time(), tmp_path / "run")
    (tmp_path / "run" / "result.json").unlink()
    check.calls.clear()
    assert ffsi.resume(tmp_path / "run").converged and len(in_time.arguments) == 1
    assert check.calls == [(2.0, 1)]


def test_a_point_that_was_cut_off_is_computed_again(tmp_path, in_time):
    one_scene.solve(scene_in_time(), tmp_path / "run")
    (tmp_path / "run" / "result.json").unlink()
    point = tmp_path / "run" / "point-0001.json"
    point.write_text(point.read_text()[:50])
    assert ffsi.resume(tmp_path / "run").converged and in_time.first_steps == [1, 41]


def test_own_files_stay_when_a_run_goes_on(tmp_path, in_time):
    die(in_time, tmp_path / "run", 12)
    (tmp_path / "run" / "notes.txt").write_text("mine")
    (tmp_path / "run" / ".result.json.77.part").write_text("{")
    ffsi.resume(tmp_path / "run")
    assert (tmp_path / "run" / "notes.txt").is_file() and not list((tmp_path / "run").glob(".*.part"))


@pytest.mark.parametrize(("held", "message"), [
    (None, r"is no run folder of ffsi \(it does not exist\); there is nothing to resume"),
    ("a file", "is no run folder"), ({}, "is no run folder of ffsi; there"),
    ({"scene.toml": load_scene("turek-fsi1").to_toml(), "case.edp": ""}, "a steady run; only runs in time can be"),
    ({"chain.json": "{}"}, "belongs to a sweep; the same call of ffsi sweep goes on with it"),
    ({"scene.toml": "name = [", "case.edp": ""}, "scene.toml"),
])  # fmt: skip
def test_what_cannot_be_resumed_is_refused_and_not_touched(tmp_path, in_time, held, message):
    if isinstance(held, str):
        (tmp_path / "run").write_text(held)
    elif held is not None:
        (tmp_path / "run").mkdir()
        for name, text in held.items():
            (tmp_path / "run" / name).write_text(text)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ValueError, match=message):
        ffsi.resume(tmp_path / "run")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(("fail", "ending"), [(None, r"\(converged\)"), (33, r"\(failed: no step\)")])
def test_a_finished_run_is_refused(tmp_path, in_time, fail, ending):
    in_time.fail = fail
    one_scene.solve(scene_in_time(), tmp_path / "run")
    before = files(tmp_path / "run")
    with pytest.raises(InputError, match=rf"is finished {ending}; there is nothing to resume"):
        ffsi.resume(tmp_path / "run")
    assert files(tmp_path / "run") == before


@pytest.mark.parametrize(("values", "message"), [
    ({"mesh.level": 1}, "mesh.level cannot change in a run that goes on; accepted: time.end.*with time.initial"),
    ({"time.end": 3, "fluid.viscosity": 2}, "fluid.viscosity cannot change"),
    ({"gravity": {"x": 1, "y": 0}}, "gravity cannot change"),
    ({"time.end": 1, "time.step": 0.025}, "time.end = 1 s: must be later than the end of the run, 2 s"),
    ({"time.step": 0.025}, "other values can only hold from a checkpoint before time.end = 2 s"),
])  # fmt: skip
def test_what_cannot_change_is_refused_and_nothing_is_touched(tmp_path, in_time, values, message):
    one_scene.solve(scene_in_time(), tmp_path / "run")
    before = {path: path.read_bytes() for path in (tmp_path / "run").iterdir()}
    with pytest.raises(InputError, match=message):
        ffsi.resume(tmp_path / "run", values=values)
    assert {path: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before


def test_signals_before_another_load_count_no_longer(tmp_path, in_time):
    run = one_scene.solve(scene_in_time("time.stop=periodic", "time.end=50"), tmp_path / "run")
    in_time.stop_at = len(run.history) + 10
    again = ffsi.resume(tmp_path / "run", values={"inflow.waveform": "2"}).data
    since = again["time"]["changed"][0]["time"]
    assert 0 <= run.data["time"]["reached"] - since < 0.3 and again["failure"] == "stopped"
    assert "tip_uy_amplitude" not in again["reached"] and "full periods found" in again["time"]["why_not"]
    in_time.stop_at = None
    last = ffsi.resume(tmp_path / "run")
    assert since + PERIODS / FREQUENCY <= last.data["time"]["reached"] < since + 12 and last.data["time"]["periodic"]
    assert last.quantities["tip_uy"]["frequency"] == pytest.approx(FREQUENCY, rel=1e-3)


def test_another_scene_is_refused(tmp_path, in_time):
    die(in_time, tmp_path / "run", 12)
    with pytest.raises(InputError, match="holds a run of another scene"):
        one_scene.solve(scene_in_time("fluid.viscosity=2"), tmp_path / "run", resume=True)
    with pytest.raises(InputError, match="its folder is needed"):
        one_scene.solve(scene_in_time(), resume=True)


def test_a_folder_in_use_is_refused(tmp_path, in_time):
    die(in_time, tmp_path / "run", 12)
    with folder.held(tmp_path / "run"):
        for resume in (True, False):
            with pytest.raises(InputError, match="another ffsi is at work in"):
                one_scene.solve(scene_in_time(), tmp_path / "run", resume=resume)
    assert len(read_history(tmp_path / "run")) == 12


# Sweeps ---------------------------------------------------------------------------------------------------------------

KEY = "fluid.viscosity"


def test_every_point_in_time_is_a_run_of_its_own(tmp_path, in_time):
    table = sweep.sweep(scene_in_time("time.end=3"), {KEY: [1.0, 2.0]}, tmp_path / "s")
    assert table["folder"].tolist() == ["chain-001", "chain-002"] and table["status"].tolist() == ["converged"] * 2
    assert table["tip_uy_amplitude"].tolist() == pytest.approx([0.03] * 2, rel=1e-3)
    history = load_result(tmp_path / "s" / "chain-001").history
    for part, value in (("min", min(history["tip_uy"])), ("max", max(history["tip_uy"]))):
        assert table[f"tip_uy_{part}"].tolist() == [value] * 2
    assert table.attrs["units"]["tip_uy_max"] == "m"
    assert all("points" not in arguments for arguments in in_time.arguments)
    with pytest.raises(InputError, match="a run of its own"):
        run_chain(scene_in_time(), [{KEY: 1.0}, {KEY: 2.0}], tmp_path / "c")


def test_a_sweep_in_time_goes_on_from_the_checkpoints(tmp_path, in_time):
    in_time.die = 23
    table = sweep.sweep(scene_in_time(), {KEY: [1.0, 2.0]}, tmp_path / "s")
    assert table["failure"].tolist() == ["crash"] * 2
    (tmp_path / "s" / "chain-002" / "result-0001.json").unlink()  # as if Python had been killed, too
    in_time.die = None
    table = sweep.sweep(scene_in_time(), {KEY: [1.0, 2.0]}, tmp_path / "s")
    assert table["status"].tolist() == ["converged"] * 2 and table["folder"].tolist() == ["chain-001", "chain-002"]
    assert in_time.first_steps == [1, 1, 21, 21]
    sweep.sweep(scene_in_time(), {KEY: [1.0, 2.0]}, tmp_path / "s")
    assert len(in_time.arguments) == 4


def test_published_numbers_and_the_last_period():
    published = references("turek-fsi3")
    values = {name: published_value(name, published) for name in ("lift_mean", "lift_amplitude", "lift_frequency")}
    assert [found[0] for found in values.values() if found] == [2.50, 153.91, 5.46]
    assert published_value("lift", published) is not None and published_value("min_jacobian", published) is None
    assert published_value("drag_amplitude", references("turek-fsi1")) is None
    t = np.arange(0.01, 5.0, 0.01)
    history = pd.DataFrame({"time": t, "tip_uy": np.sin(2 * np.pi * t)})
    period = in_time.last_period(history)
    assert period is not None and (period.start, period.end) == pytest.approx((3.0, 4.0), abs=1e-3)
    assert in_time.last_period(history[:20]) is None and in_time.last_period(history.drop(columns="tip_uy")) is None
    assert oscillation.reference_column(history) == "tip_uy"


@pytest.fixture
def scene_file(tmp_path) -> str:
    (tmp_path / "mine.toml").write_text(scene_in_time().to_toml())
    return "mine.toml"


def fields(scale: float) -> Fields:
    mesh = structured_mesh()
    return Fields.from_raw(mesh, given_state(mesh, scale))


def test_run_prints_the_last_period_and_compares_it(capsys, in_time, check, scene_file):
    settings = ["--set", "time.end=3", "--set", "inflow.ramp=2"]
    code, out, err = call(capsys, "run", scene_file, *settings, "--out", "there")
    assert (code, err) == (0, "")  # no progress where stderr is no terminal
    assert "quantity over the last period" in out and re.search(r"tip_uy_frequency +1\S* +Hz", out)
    assert "t = 3 of 3 s, 60 steps, not periodic (tip_uy: " in out


def test_cycles_are_compared_with_each_other_instead_of_periods():
    in_time = {"reached": 4.0, "end": 4.0, "steps": 400, "periodic": False, "why_not": "tip_uy: 3 full periods found"}
    cycles = [{"number": 3}, {"number": 4, "tawss_change": 6.25e-8}]
    differ = "TAWSS of cycle 4 differs by 6.2e-08 from the cycle before"
    assert time_line({"time": in_time, "cycles": cycles}) == f"t = 4 of 4 s, 400 steps, {differ}"
    assert time_line({"time": in_time | {"periodic": True}, "cycles": cycles}).endswith(f"periodic, {differ}")
    for none in (cycles[:1], [], None):
        line = time_line({"time": in_time, "cycles": none})
        assert line.endswith("400 steps, not periodic (tip_uy: 3 full periods found)")


def test_run_without_a_period_prints_the_last_state(capsys, in_time, check, scene_file):
    _, out, _ = call(capsys, "run", scene_file, "--set", "time.end=0.5", "--out", "there")
    assert "quantity at t = 0.5 s" in out and "published" not in out and re.search(r"drag +4 +N/m", out)


def test_a_killed_run_says_how_to_go_on_and_goes_on(capsys, in_time, check, scene_file):
    in_time.die = 23
    code, _, err = call(capsys, "run", scene_file, "--out", "there")
    assert code == 4 and "ffsi run --resume there goes on from t = 1 s" in err
    in_time.die = None
    code, out, err = call(capsys, "run", "--resume", "there")
    assert "there: going on from t = " in err and code == 0
    assert "t = 2 of 2 s, 40 steps" in out and in_time.first_steps == [1, 21]


@pytest.mark.parametrize(("arguments", "message"), [
    (['inflow.waveform="2"', "--error"], "accepted: one with the same values all the time"),
    (["time.end=3", "--adapt", "drag", "--tolerance", "1%"], "is a scene in time; accepted: steady ones"),
    (["time.end=3", "--animate", "speed"], "no animation of 'speed'"),
])  # fmt: skip
def test_what_a_longer_run_cannot_have_is_refused_and_nothing_is_touched(
    capsys, in_time, scene_file, arguments, message
):
    call(capsys, "run", scene_file, "--out", "there")
    before = {path: path.read_bytes() for path in Path("there").iterdir()}
    code, _, err = call(capsys, "run", "--resume", "there", "--set", "time.end=4", "--set", *arguments)
    assert code == 2 and message in err and len(in_time.first_steps) == 1
    assert {path: path.read_bytes() for path in Path("there").iterdir()} == before


def test_a_stopped_run_has_its_exit_code(capsys, in_time, check, scene_file):
    in_time.stop_at = 13
    code, _, err = call(capsys, "run", scene_file, "--out", "there")
    assert code == 3 and "stopped at t = 0.65 s of 2 s; what there is lies in there" in err
    assert "ffsi run --resume there goes on from t = 0.5 s" in err
    in_time.stop_at = None  # without --resume the run is replaced
    assert call(capsys, "run", scene_file, "--out", "there")[0] == 0 and in_time.first_steps == [1, 1]


INTERVAL = ["--set", "time.output_interval=0.1"]
BAD_INPUT = [
    (["run", "--resume", "nothing"], "nothing is no run folder of ffsi (it does not exist)"),
    (["run", "turek-fsi3", "--resume", "nothing"], "give no CASE or --out"),
    (["run", "--resume", "nothing", "--out", "x"], "give no CASE or --out"),
    (["run", "--resume", "nothing", "--set", "mesh.level=1"], "nothing is no run folder of ffsi"),
    (["run", "--resume"], "requires an argument"),
    (["run", "turek-fsi3", "--animate", "velocity"], "set time.output_interval"),
    (["run", "turek-fsi3", *INTERVAL, "--animate", "speed"],
     "no animation of 'speed'; of this scene there is velocity"),
    (["run", "turek-csm3", *INTERVAL, "--animate", "velocity"], "of this scene there is displacement"),
    (["run", "turek-fsi1", "--animate", "velocity"], "turek-fsi1 is steady; there is nothing to animate"),
    (["animate", "nothing"], "nothing is no run folder"),
    (["animate"], "Missing argument"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), BAD_INPUT, ids=[" ".join(words) for words, _ in BAD_INPUT])
def test_bad_input_ends_with_2_names_the_reason_and_writes_nothing(capsys, tmp_path, in_time, arguments, message):
    code, out, err = call(capsys, *arguments)
    assert message in err and (code, out) == (2, "")
    assert list(tmp_path.iterdir()) == []


def test_animations(capsys, tmp_path, in_time, check, scene_file):
    code, _, err = call(capsys, "run", scene_file, "--out", "there", "--animate", "velocity")
    assert code == 0 and "wrote there/velocity.gif (4 frames)" in err
    with Image.open("there/velocity.gif") as image:
        assert image.n_frames == 4
        frames = []
        for i in range(4):
            image.seek(i)
            frames.append(np.asarray(image.convert("RGB")))
    assert {frame.shape for frame in frames} == {frames[0].shape} and not np.array_equal(frames[0], frames[1])
    assert call(capsys, "animate", "there", "--field", "displacement", "-o", "mine.gif")[0] == 0
    assert Path("mine.gif").is_file() and call(capsys, "animate", "there", "-o", "no/mine.gif")[0] == 2
    make_run(tmp_path / "steady")
    assert call(capsys, "animate", "steady")[0] == 2


def test_one_frame_is_no_animation(tmp_path, in_time, check):
    result = one_scene.solve(scene_in_time("time.end=0.5"), tmp_path / "run")
    with pytest.raises(InputError, match="holds 1 saved time steps, an animation needs two or more"):
        write_animation(result, "velocity", tmp_path / "a.gif")
    assert not (tmp_path / "a.gif").exists()


def test_a_common_scale_fits_all_states():
    states = [fields(scale) for scale in (0.5, 2.0)]
    for name in ("velocity", "pressure", "displacement"):
        scale = pictures.common_scale(name, states)
        shapes = {pictures.draw(name, state, "", scale).axes[0].get_xlim() for state in states}
        assert len(shapes) == 1
    assert scale.high == pytest.approx(2 * pictures.common_scale("displacement", states[:1]).high * 2)
    with pytest.raises(ValueError, match="no state"):
        pictures.common_scale("velocity", [])


def test_a_series_for_paraview(tmp_path):
    vtu.write_series(tmp_path, ((step, 0.1 * step, fields(step), {}) for step in (2, 12)))
    root = ElementTree.parse(tmp_path / "fields.pvd").getroot()
    assert root.attrib["type"] == "Collection"
    entries = [(entry.attrib["timestep"], entry.attrib["file"]) for entry in root.iter("DataSet")]
    assert entries == [(repr(0.1 * 2), "fields-000002.vtu"), (repr(0.1 * 12), "fields-000012.vtu")]
    for scale, (_, name) in zip((2, 12), entries, strict=True):
        found = meshio.read(tmp_path / name).point_data["displacement"][:, :2]
        np.testing.assert_allclose(found, fields(scale).displacement, atol=1e-15)


def test_the_report_shows_the_history(tmp_path, in_time, check):
    one_scene.solve(scene_in_time("time.end=3"), tmp_path / "run")
    text = report_text(tmp_path, tmp_path / "run")
    assert "Over time: t = 3 of 3 s, 60 steps, not periodic" in text
    assert "on the right the last 2 periods, grey: the last one" in text
    assert "Quantities over the last period" in text and "Newton&#39;s method" not in text


def test_histories_are_drawn_whole_and_at_their_end():
    t = np.arange(0.01, 5.0, 0.01)
    history = pd.DataFrame({"time": t, "drag": np.cos(t), "tip_uy": np.sin(2 * np.pi * t), "min_jacobian": 0 * t + 0.5})
    figure = histories.time_history(history, (3.0, 4.0))
    assert figure is not None and len(figure.axes) == 6
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "", "", "time (s)", "time (s)"]
    assert figure.axes[1].lines[0].get_xdata()[0] == pytest.approx(2.0)
    whole = histories.time_history(history)
    assert whole is not None and len(whole.axes) == 3
    assert histories.time_history(history[:1]) is None and histories.time_history(history[["time"]]) is None


@pytest.mark.parametrize("damage", ["cut", "mixed", "missing"])
def test_rows_that_a_full_disk_has_cost_end_the_run_with_the_right_cause(capsys, in_time, check, scene_file, damage):
    real = in_time._append

    def append(path, *cells):
        if path.name == "history.csv" and cells[0] > 1.0 - 1e-9:
            if damage == "missing":
                return
            if cells[0] < 1.0 + 1e-9:
                cells = cells[:3] if damage == "cut" else (*cells, *cells)
        real(path, *cells)

    in_time._append = append
    code, _, err = call(capsys, "run", scene_file, "--out", "there")
    if damage == "missing":  # that is not taken for a stop
        assert code != 0 and "history.csv" in err
        return
    assert code == 4
    assert "row 20 of history.csv is damaged: the disk was full for a while" in err and "stopped at" not in err
    assert json.loads(Path("there/result.json").read_text())["failure"] == "crash"
