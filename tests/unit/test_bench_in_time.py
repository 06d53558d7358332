"""`python -m studies bench --unsteady`: where steps start from, which of them count, ratios, files."""

import math

import numpy as np
import pandas as pd
import pytest

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.run import watch
from ffsi.scene import load_scene
from studies.bench import unsteady as bench
from studies.bench.unsteady import FINEST, TIME_STEPS
from studies.harness import Run, run_all
from studies.tables import table

README = "<!-- bench-unsteady:begin -->\nold\n<!-- bench-unsteady:end -->\n"
SETTINGS = ("mesh.level=0", "inflow.ramp=0.1", "time.checkpoint_interval=0.25")
SIZE = bench.Size("small", "small flag", "turek-fsi3", SETTINGS, 0.005, 1.0, 0.02)


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(bench, "STEPS", {"condensed": 20, "newton": 4})
    monkeypatch.setattr(bench, "run_time_steps", lambda runs: [swing(step) for step in (*TIME_STEPS, FINEST)])


def swing(step: float, error: float = 100.0, failure: str = "") -> Run:
    """u_y of a beam, whose relative error grows with the square of the time step (s)."""
    t = step * np.arange(1, round(1 / step) + 1)
    u = -0.066 * (1 - np.cos(7 * t)) * (1 + error * step**2)
    history = pd.DataFrame({"time": t, "tip_uy": u, "seconds": 1 + t})
    return Run(f"step-{step}", {"failure": failure}, history=history)


@pytest.fixture
def in_time(in_time, monkeypatch):
    """The stand-in, without looks at its progress: they cost more than all the rest."""
    monkeypatch.setattr(watch, "LOOK_EVERY", math.inf)
    return in_time


START = Run("start", {"failure": "", "timings": dict.fromkeys(bench.SOLVER, 0.01)})


def steps(seconds: list[float]) -> Run:
    timings = dict.fromkeys(bench.SOLVER, 0.31)
    data = {"failure": "", "unknowns": 13000, "triangles": 1400, "timings": timings}
    counted = pd.DataFrame({"took": seconds, "iterations": 3.0, "rebuilds": 0.02, "tip_uy": 0.03})
    return Run("steps", data, history=counted)


def test_meshes_steps_and_bounds_are_the_stated_ones():
    assert [size.bound for size in bench.SIZES] == [0.12, 0.28] * 2 and bench.SIZES[2].scene(1.0).fluid.law == "carreau"
    for step in ("condensed", "newton"):
        scene = bench.SIZES[0].scene(5.5, step)
        assert (scene.time.step, scene.time.end, scene.time.stop, scene.solver.step) == (0.005, 5.5, "end", step)


def test_steps_start_from_the_developed_motion_and_its_ends_do_not_count(tmp_path, in_time, check, short, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    given = {"repeat": 2, "out": tmp_path / "out", "runs": tmp_path / "runs", "sizes": [SIZE]}
    assert bench.main(readme=readme, **given) == [""] * 12 and in_time.first_steps == [1, *[201] * 5]
    developed = load_scene(str(tmp_path / "runs/small-developed/scene.toml"), [])
    for name, count in (("condensed-0", 2), ("condensed-2", 22), ("newton-1", 6)):
        directory = tmp_path / f"runs/small-{name}"
        assert len(pd.read_csv(directory / "history.csv")) == 200 + count
        scene = load_scene(str(directory / "scene.toml"), [])
        assert scene.solver.step == name[:-2] and scene.mesh == developed.mesh
    condensed, newton = (row for _, row in pd.read_csv(tmp_path / "out/bench-unsteady.csv").iterrows())
    assert (condensed["steps"], newton["steps"], condensed["runs"]) == (20, 4, 2)
    assert condensed["median_seconds"] == pytest.approx(0.01)
    # New factors in the steps 201, 211, 221; the first and the last step do not count.
    assert condensed["rebuilds_per_100_steps"] == pytest.approx(100 * 2 / 20)
    assert condensed["ratio"] == pytest.approx(1.0) and math.isnan(newton["ratio"])
    assert "Written by `python -m studies bench --unsteady --repeat 2`" in readme.read_text()
    assert "| small flag | 900 | condensed | 0.010 | 0.010 | 0.02 | 1.0 ! |" in readme.read_text()
    assert "plain Newton" in capsys.readouterr().out and bench.main(**given) == [""] * 12
    assert in_time.first_steps[6:] == [201] * 5


def test_medians_means_and_ratio():
    rows = [
        bench.row(SIZE, "condensed", [steps([0.01, 0.01, 0.04]), steps([0.03] * 3), steps([0.02] * 3)], START),
        bench.row(SIZE, "newton", [steps([0.4] * 3)], START),
    ]
    assert rows[0]["median_seconds"] == pytest.approx(0.02) and rows[0]["mean_seconds"] == pytest.approx(0.02)
    assert rows[0]["largest_seconds"] == pytest.approx(0.03) and rows[0]["iterations_per_step"] == 3
    assert rows[0]["residual_seconds"] == pytest.approx(0.1)
    rows[0]["ratio"] = 20.0
    body = bench.step_table(rows, [SIZE]).body
    assert body[0][:7] == ["small flag", "13000", "condensed", "0.020", "0.020", "0.02", "20.0"]
    assert body[1][:7] == ["small flag", "13000", "plain Newton", "0.400", "0.400", "–", "–"]
    slow = bench.row(SIZE, "condensed", [steps([0.021] * 3)], START)
    assert bench.step_table([slow], [SIZE]).body[0][3:5] == ["0.021 !", "0.021 !"]


def test_a_failed_run_is_a_row_and_leaves_the_readme_alone(tmp_path, in_time, check, short, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    in_time.fail = 205
    given = {"out": tmp_path / "out", "runs": tmp_path / "runs", "sizes": [SIZE]}
    assert bench.main(readme=readme, **given) == ["", "", "not-converged", "", "not-converged", *[""] * 6]
    assert readme.read_text() == README
    assert pd.read_csv(tmp_path / "out/bench-unsteady.csv")["status"].tolist() == ["failed", "failed"]
    assert "small, plain Newton: no step" in capsys.readouterr().err


def test_without_a_checkpoint_there_is_nothing_to_start_from(tmp_path, in_time, check, short):
    run_all({"small-developed": SIZE.scene(SIZE.developed)}, tmp_path)
    for name in folder.CHECKPOINTS:
        (tmp_path / "small-developed" / name).unlink(missing_ok=True)
    with pytest.raises(InputError, match="the checkpoint of t = 1 s is missing or was changed"):
        bench.measure(SIZE, "newton", 4, tmp_path / "small-developed", tmp_path / "newton")


def test_errors_fall_with_the_square_of_the_time_step():
    runs = [swing(step) for step in (*TIME_STEPS, FINEST)]
    found = bench.error_rows(runs)
    assert [row["step"] for row in found] == list(TIME_STEPS)
    assert found[0]["error"] == pytest.approx(100 * (0.04**2 - FINEST**2), rel=2e-3)
    assert [row["order"] for row in found[1:3]] == pytest.approx([2.0, 2.0], abs=0.03)
    assert table(found, bench.ERROR_COLUMNS).body[1][:4] == ["0.02", "50", "2.0", "0.020"]
    assert table(found, bench.ERROR_COLUMNS).body[1][4].startswith("3.99")
    broken = bench.error_rows([swing(0.04, failure="crash"), *runs[1:]])
    assert [math.isnan(row["error"]) for row in broken] == [True, False, False, False, False]
    assert table(broken, bench.ERROR_COLUMNS).body[0][4:] == ["–", "–"]
    assert all(math.isnan(row["error"]) for row in bench.error_rows([*runs[:-1], swing(FINEST, failure="check")]))
