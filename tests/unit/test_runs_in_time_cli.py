"""The command line, the report and the pictures of runs in time."""

import io
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from rich.console import Console
from run_folders import given_state, make_run, structured_mesh
from test_cli import call
from time_folders import scene_in_time

from ffsi.cli.progress import ProgressDisplay
from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMError, parse_event
from ffsi.report import history as histories
from ffsi.report import write_report
from ffsi.report.animation import write_animation
from ffsi.result import pictures, vtu
from ffsi.result.fields import Fields
from ffsi.result.words import time_line
from ffsi.run import execute, one_scene

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


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
    assert (code, err) == (0, "")
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
    code, out, err = call(capsys, "run", "--resume", "there")
    assert (code, out) == (2, "")
    assert "the run in there is finished (converged); there is nothing to resume" in err


def test_a_stopped_run_has_its_exit_code(capsys, in_time, check, scene_file):
    in_time.stop_at = 13
    code, _, err = call(capsys, "run", scene_file, "--out", "there")
    assert code == 3 and "stopped at t = 0.65 s of 2 s; what there is lies in there" in err
    assert "ffsi run --resume there goes on from t = 0.5 s" in err


def test_without_resume_the_run_is_replaced(capsys, in_time, check, scene_file):
    in_time.die = 23
    call(capsys, "run", scene_file, "--out", "there")
    in_time.die = None
    assert call(capsys, "run", scene_file, "--out", "there")[0] == 0 and in_time.first_steps == [1, 1]


INTERVAL = ["--set", "time.output_interval=0.1"]
BAD_INPUT = [
    (["run", "--resume", "nothing"], "nothing is no run folder of ffsi (it does not exist)"),
    (["run", "turek-fsi3", "--resume", "nothing"], "give no CASE or --out"),
    (["run", "--resume", "nothing", "--out", "x"], "give no CASE or --out"),
    (["run", "--resume", "nothing", "--set", "mesh.level=1"], "only time.end can change"),
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
    write_report([tmp_path / "run"], tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    assert "Over time: t = 3 of 3 s, 60 steps, not periodic" in text
    assert "on the right the last 2 periods, grey: the last one" in text
    assert "Quantities over the last period" in text and "Newton&#39;s method" not in text


def test_the_report_of_a_run_that_died_at_once(tmp_path, in_time, check, monkeypatch):
    def crash(*_, **__):
        raise FreeFEMError("crash", "at once")

    monkeypatch.setattr(execute, "run_script", crash)
    with pytest.raises(FreeFEMError):
        one_scene.solve(scene_in_time(), tmp_path / "run")
    write_report([tmp_path / "run"], tmp_path / "report.html")
    assert "at once" in (tmp_path / "report.html").read_text()


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


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_progress_in_time_and_of_its_sweeps():
    clock, stream = Clock(), io.StringIO()
    with ProgressDisplay(console=Console(file=stream, force_terminal=True, width=200), clock=clock) as show:
        for line in (
            "start case=turek-fsi3",
            "mesh stage=1 stages=1 unknowns=6995",
            "time step=10 time=1 end=6 dt=0.1",
        ):
            show(parse_event("@ffsi " + line))
        assert show.seconds_left is None
        clock.now = 60.0
        show(parse_event("@ffsi time step=20 time=2 end=6 dt=0.1 iterations=3"))
        show(parse_event("@ffsi signal name=tip_uy unit=m mean=0.00123456 amplitude=0.035 frequency=5.461234"))
        assert show.state == "t = 2 of 6 s · step 20 · tip_uy 0.001235 ± 0.035 m, 5.461 Hz"
        assert show.seconds_left == pytest.approx(240.0)
    assert "about 4:00 left" in stream.getvalue()
    stream = io.StringIO()
    with ProgressDisplay(points=3, console=Console(file=stream, force_terminal=True, width=200)) as show:
        show(parse_event("@ffsi time step=20 time=2 end=6 dt=0.1"))
        show(parse_event("@ffsi signal name=lift unit=N/m mean=1 amplitude=2 frequency=3"))
        assert show.state == "0/3 done · t = 2 of 6 s · step 20"


def test_progress_is_quiet_when_piped(capsys, in_time, check, scene_file):
    assert call(capsys, "run", scene_file, "--out", "there")[2] == ""


@pytest.mark.parametrize("damage", ["cut", "mixed"])
def test_rows_that_a_full_disk_has_cost_end_the_run_with_the_right_cause(capsys, in_time, check, scene_file, damage):
    real = in_time._append

    def append(path, *cells):
        if path.name == "history.csv" and abs(cells[0] - 1.0) < 1e-9:
            cells = cells[:3] if damage == "cut" else (*cells, *cells)
        real(path, *cells)

    in_time._append = append
    code, _, err = call(capsys, "run", scene_file, "--out", "there")
    assert code == 4
    assert "row 20 of history.csv is damaged: the disk was full for a while" in err and "stopped at" not in err
    assert json.loads(Path("there/result.json").read_text())["failure"] == "crash"


def test_a_row_that_is_missing_is_not_taken_for_a_stop(capsys, in_time, check, scene_file):
    real = in_time._append

    def append(path, *cells):
        if path.name != "history.csv" or cells[0] < 1.0:
            real(path, *cells)

    in_time._append = append
    code, _, err = call(capsys, "run", scene_file, "--out", "there")
    assert code != 0 and "history.csv" in err
