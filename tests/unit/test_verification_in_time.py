"""`python -m studies verify --unsteady` and `--long`: published values, bounds, run folders, tables, files."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from time_folders import scene_in_time

from ffsi.files.errors import InputError
from ffsi.result.pictures import to_png
from ffsi.result.published import references
from ffsi.result.quantities import published_value
from ffsi.scene import CASES
from studies import harness
from studies.harness import Run, run_all
from studies.tables import Column
from studies.verification import in_time as study
from studies.verification.in_time import PERIODIC_CASES, LongCase, LongRun, Plan, case_table
from studies.verification.sources import reference_sets

pytestmark = pytest.mark.usefixtures("unwatched")

BY_NAME = {case.name: case for case in PERIODIC_CASES}
BOUNDS = {  # in per cent
    "turek-cfd3": {"drag_mean": 0.5, "drag_amplitude": 3, "lift_amplitude": 1.5, "lift_frequency": 1},
    "turek-csm3": {
        **{f"tip_{name}_{part}": 1.5 for name in ("ux", "uy") for part in ("mean", "amplitude")},
        "tip_uy_frequency": 0.5,
    },
    "turek-fsi2": {
        "tip_uy_amplitude": 2, "tip_ux_amplitude": 4, "drag_mean": 1.5, "lift_amplitude": 5, "tip_uy_frequency": 1.5,
    },
    "turek-fsi3": {
        "tip_uy_amplitude": 3, "tip_ux_amplitude": 6, "drag_mean": 1, "lift_amplitude": 8, "tip_uy_frequency": 1.5,
    },
    "cylinder-2d2": {
        "drag_coefficient_maximum": 0.5, "lift_coefficient_peak_to_peak": 1, "lift_coefficient_frequency": 0.7,
    },
}  # fmt: skip
README = "before\n<!-- verification-unsteady:begin -->\nold\n<!-- verification-unsteady:end -->\nafter\n"


@pytest.fixture(autouse=True)
def coarse_pictures(monkeypatch):
    monkeypatch.setattr(study, "to_small_png", lambda figure: to_png(figure, 20))


def published(case: str) -> dict[str, dict[str, float | None]]:
    return {
        name: {"mean": item.mean or 0.0, "amplitude": item.amplitude, "frequency": item.frequency}
        for name, item in references(case).items()
    }


def outcome(case: str, number: int = 0, **changes: object) -> tuple[Plan, Run]:
    """A run that meets every published value."""
    plan = BY_NAME[case].plans[number]
    data = {
        "status": "converged", "failure": "", "unknowns": 24000, "triangles": 2800, "quantities": published(case),
        "time": {"reached": 6.0, "periodic": True}, "newton": {"iterations": 800, "factorizations": 12},
        "check": {"momentum": 2e-11, "kinematics": None},
    }  # fmt: skip
    return plan, run_of(plan, data | changes)


def run_of(plan: Plan, data: dict[str, object]) -> Run:
    seconds = 1.0 + 0.25 * np.arange(200)
    return Run(plan.name, data, history=pd.DataFrame({"time": 0.01 * np.arange(200), "seconds": seconds}))


def test_every_bound_is_the_stated_one():
    found = {case.name: {item.name: 100 * item.bound for item in case.compared} for case in PERIODIC_CASES}
    assert found == {name: pytest.approx(bounds) for name, bounds in BOUNDS.items()}


@pytest.mark.parametrize("case", BY_NAME)
def test_published_values_have_no_error_and_one_per_cent_more_has_one(case):
    for item in BY_NAME[case].compared:
        assert item.error(case, published(case)) == pytest.approx(0, abs=1e-14)
        more = {
            name: {part: value and 1.01 * value for part, value in parts.items()}
            for name, parts in published(case).items()
        }
        sign = math.copysign(1, item.published(case))
        assert item.error(case, more) == pytest.approx(sign * 0.01), item.name
        assert math.isnan(item.error(case, {}))
        assert math.isnan(item.error(case, {item.quantity: {"mean": None, "amplitude": None, "frequency": None}}))


def test_the_cylinder_in_time_and_a_mean_that_nobody_published():
    drag, lift, strouhal = BY_NAME["cylinder-2d2"].compared
    assert drag.published("cylinder-2d2") == pytest.approx(3.227393, rel=1e-12)
    assert lift.published("cylinder-2d2") == pytest.approx(2.007871, rel=1e-12)
    scene = CASES["cylinder-2d2"]
    assert scene.forces is not None and scene.inflow is not None
    speed = scene.inflow.mean_velocity / scene.forces.reference_length
    assert strouhal.published("cylinder-2d2") / speed == pytest.approx(0.301841, rel=1e-12)
    table = references("cylinder-2d2")
    assert table["drag_coefficient"].mean - table["drag_coefficient"].amplitude == pytest.approx(3.164263)
    assert table["drag_coefficient"].frequency == pytest.approx(2 * table["lift_coefficient"].frequency)
    assert math.isnan(table["lift_coefficient"].relative_error(1.0))
    assert published_value("lift_coefficient_mean", table) is None
    assert published_value("lift_coefficient_amplitude", table)[0] == 1.0039355
    assert reference_sets("cylinder-2d2") == []


@pytest.mark.parametrize("case", BY_NAME)
def test_every_case_runs_on_two_meshes_with_two_steps_the_catalogue_first(case):
    plans, own = BY_NAME[case].plans, CASES[case]
    assert own.time is not None and (plans[0].level, plans[0].step) == (own.mesh.level, own.time.step)
    assert len({plan.name for plan in plans}) == 4
    assert {plan.level for plan in plans} == {own.mesh.level, own.mesh.level - 1}
    assert {plan.step for plan in plans} == {own.time.step, own.time.step * 2}
    for plan in plans:
        scene = plan.scene
        assert scene.time is not None
        assert (scene.mesh.level, scene.time.step, scene.time.stop) == (plan.level, plan.step, own.time.stop)


@pytest.mark.parametrize("jobs", [1, 2])
def test_runs_are_done_once_and_a_killed_one_goes_on(tmp_path, in_time, check, capsys, jobs):
    scenes = {"one": scene_in_time("time.end=3"), "two": scene_in_time("time.end=3", "fluid.viscosity=2")}
    in_time.die = 23
    first = run_all(scenes, tmp_path, jobs)
    assert [run.failure for run in first] == ["crash", "crash"] and first[0].quantities == {}
    in_time.die = None
    second = run_all(scenes, tmp_path, jobs)
    assert [run.failure for run in second] == ["", ""] and [run.name for run in second] == ["one", "two"]
    assert in_time.first_steps == [1, 1, 21, 21] and second[0].steps["steps"] == 60
    assert second[0].quantities["tip_uy"]["amplitude"] == pytest.approx(0.03, rel=1e-2)
    third = run_all(scenes, tmp_path, jobs)
    assert len(in_time.first_steps) == 4 and [run.data for run in third] == [run.data for run in second]
    err = capsys.readouterr().err
    assert "one: FreeFEM died" in err and "one: 60 steps to t = 3 s" in err
    assert f"two: finished before, in {tmp_path / 'two'}\n" in err


def test_another_scene_is_run_anew(tmp_path, in_time, check):
    run_all({"one": scene_in_time()}, tmp_path)
    run_all({"one": scene_in_time("time.end=1")}, tmp_path)
    assert in_time.first_steps == [1, 1]
    (tmp_path / "one/scene.toml").write_text('name = "of another program"\n')
    run_all({"one": scene_in_time("time.end=1")}, tmp_path)
    assert in_time.first_steps == [1, 1, 1]


def test_a_run_of_another_script_stays_unless_it_failed(tmp_path, in_time, check, capsys, monkeypatch):
    scenes = {"good": scene_in_time()}
    run_all(scenes, tmp_path)
    in_time.fail = 30
    bad = {"bad": scene_in_time()}
    assert run_all(bad, tmp_path)[0].failure == "not-converged"
    in_time.fail = None
    assert run_all(bad, tmp_path)[0].failure == "not-converged" and in_time.first_steps == [1, 1]
    assert "by another script" not in capsys.readouterr().err
    monkeypatch.setattr(harness, "render", lambda scene, mumps: "// new")
    run_all(scenes, tmp_path)
    assert "by another script than that of today" in capsys.readouterr().err
    assert run_all(bad, tmp_path)[0].failure == "" and in_time.first_steps == [1, 1, 1]


def test_a_folder_of_somebody_else_is_refused(tmp_path, in_time, check):
    (tmp_path / "one").mkdir()
    (tmp_path / "one/thesis.tex").write_text("")
    with pytest.raises(InputError, match="is no run folder"):
        run_all({"one": scene_in_time()}, tmp_path)


def test_tables_mark_what_misses_its_bound():
    marked = Column("", "error", "%", 0.01)
    assert [marked.cell({"error": x}) for x in (0.0101, -0.0099, math.nan)] == ["+1.010 % !", "-0.990 %", "– !"]
    good, shaken = outcome("turek-fsi3"), published("turek-fsi3")
    shaken["tip_uy"]["amplitude"] *= 0.96
    items = [
        good, outcome("turek-fsi3", 1, quantities=shaken, unknowns=41000),
        outcome("turek-fsi3", 2, time={"reached": 6.0, "periodic": False}),
        outcome("turek-fsi3", 3, failure="not-converged", status="failed", time={"reached": 1.23}),
    ]  # fmt: skip
    table = case_table(BY_NAME["turek-fsi3"], items)
    assert table.head[9:11] == ["u_y amplitude (< 3 %)", "u_x amplitude (< 6 %)"]
    rows = [dict(zip(table.head, row, strict=True)) for row in table.body]
    first = {"unknowns": "24000", "t s": "6.00", "steps": "200", "seconds": "51", "per step": "0.250"}
    assert rows[0] | first == rows[0]
    assert (rows[0]["iterations"], rows[0]["rebuilds"], rows[0]["check"]) == ("4.0", "6.0", "2e-11")
    assert not any("!" in cell for cell in table.body[0])
    assert [name for name, cell in rows[1].items() if "!" in cell] == ["u_y amplitude (< 3 %)"]
    assert rows[1]["u_y amplitude (< 3 %)"] == "-4.000 % !"
    assert [name for name, cell in rows[2].items() if "!" in cell] == ["t s"]
    assert rows[3]["seconds"] == "failed (not-converged)" and set(list(rows[3].values())[9:14]) == {"–"}
    large = case_table(BY_NAME["turek-fsi3"], [outcome("turek-fsi3", unknowns=41000)])
    assert "41000 !" in large.body[0]


def test_everything_is_written(tmp_path, in_time, check, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    cases = [
        replace(BY_NAME["turek-fsi3"], parts=(20.0, 10.0)), replace(BY_NAME["turek-cfd3"], parts=(20.0,), coarser=(0,)),
    ]  # fmt: skip
    given = {"out": tmp_path / "results", "runs": tmp_path / "runs", "cases": cases}
    assert study.main(readme=readme, **given) == [""] * 5
    frame = pd.read_csv(tmp_path / "results/verification-unsteady.csv")
    assert frame["case"].tolist() == ["turek-fsi3"] * 4 + ["turek-cfd3"]
    row = frame.iloc[0]
    assert row["step"] == pytest.approx(20 * CASES["turek-fsi3"].time.step)
    assert row["tip_uy_amplitude"] == pytest.approx(0.03, rel=2e-2)
    assert row["tip_uy_amplitude_error"] == pytest.approx(0.03 / 34.99e-3 - 1, abs=2e-2)
    assert (row["tip_uy_amplitude_reference"], row["tip_uy_amplitude_bound"]) == (34.99e-3, 0.03)
    assert row["iterations_per_step"] == 2 and row["rebuilds_per_100_steps"] == pytest.approx(10, abs=1)
    assert row["seconds_per_step"] == pytest.approx(0.01)
    assert (tmp_path / "results/verification-unsteady.png").read_bytes().startswith(b"\x89PNG")
    text = readme.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text and "`turek-cfd3`" in text
    assert "Written by `python -m studies verify --unsteady` (FreeFEM 4.9 with MUMPS, one thread;" in text
    assert "(results/verification-unsteady.png)" in text
    assert "| u_y amplitude (< 3 %) |" in (tmp_path / "results/verification-unsteady.md").read_text()
    assert "turek-cfd3" in capsys.readouterr().out
    steps = list(in_time.first_steps)
    assert study.main(readme=readme, **given) == [""] * 5 and in_time.first_steps == steps
    assert readme.read_text() == text


def long_run(end: float, growth: float = 0.0, reached: float | None = None) -> LongRun:
    """u_y with the amplitude 0.1 (1 + growth t), from t = 2 s on, and J."""
    t = np.arange(0.01, (reached or end) + 1e-9, 0.01)
    on = np.clip((t - 2) / 1.5, 0, 1) ** 2
    u = 0.1 * on * (1 + growth * t) * np.sin(2 * np.pi * 2 * t)
    history = pd.DataFrame({"time": t, "tip_uy": u, "min_jacobian": 0.5 - np.abs(u), "seconds": 0.1 * t})
    case = LongCase("turek-fsi2", end)
    data = {
        "failure": "", "time": {"reached": reached or end}, "unknowns": 24000, "level": 1, "check": {"momentum": 1e-11},
    }  # fmt: skip
    return LongRun(case, Run(case.name, data | {"level": 1}, history=history))


def test_long_runs_and_their_blocks():
    item = long_run(20.0)
    assert item.complete
    assert len(item.blocks) == 16 or len(item.blocks) == 17
    assert item.blocks[-1]["amplitude"] == pytest.approx(0.1, rel=1e-3) and abs(item.blocks[-1]["change"]) < 1e-3
    assert item.blocks[-1]["min_jacobian"] == pytest.approx(0.4, abs=1e-3)
    row = dict(zip(study.summary_table([item]).head, study.summary_table([item]).body[0], strict=True))
    assert row["t s"] == "20.00" and "!" not in "".join(row.values())
    growing = long_run(20.0, growth=0.5)
    change = growing.blocks[-1]["change"]
    assert change > 0.02
    (cells,) = study.summary_table([growing]).body
    assert [cell for cell in cells if "!" in cell] == [f"{100 * change:+.3f} % !"]
    early = long_run(20.0, reached=19.0)
    assert not early.complete
    (cells,) = study.summary_table([early]).body
    assert [cell for cell in cells if "!" in cell] == ["19.00 !"]
    frame = study.long_frame([growing, early])
    assert frame["complete"].tolist() == [True] * len(growing.blocks) + [False] * len(early.blocks)
    assert frame["block"].iloc[0] == 1
    scenes = {case.name: case.scene for case in study.LONG_CASES}
    assert {name: (scene.time.end, scene.time.stop) for name, scene in scenes.items()} == {
        "turek-fsi2": (35.0, "end"), "turek-fsi3": (20.0, "end"),
    }  # fmt: skip
    for name, scene in scenes.items():
        assert scene.mesh == CASES[name].mesh and scene.time.step == CASES[name].time.step


def test_long_runs_are_written(tmp_path, in_time, check):
    class Short(LongCase):
        @property
        def scene(self):
            return scene_in_time(f"time.end={self.end}")

    readme = tmp_path / "README.md"
    readme.write_text(README.replace("verification-unsteady", "long"))
    cases = [Short("turek-fsi3", 12.0)]
    given = {"out": tmp_path, "runs": tmp_path / "runs", "cases": cases}
    assert study.main_long(readme=readme, **given) == [""]
    frame = pd.read_csv(tmp_path / "long.csv")
    assert frame["complete"].all() and frame["amplitude"].iloc[-1] == pytest.approx(0.03, rel=1e-2)
    assert frame["change"].iloc[1:].abs().max() < 1e-3
    assert (tmp_path / "long-fsi3.png").read_bytes().startswith(b"\x89PNG")
    assert "| 1 | " in (tmp_path / "long.md").read_text()
    assert "[long-fsi3.png](long-fsi3.png)" in readme.read_text() and study.main_long(**given) == [""]
    assert in_time.first_steps == [1]


def test_a_long_run_that_died_at_once_has_one_row(tmp_path, in_time, check):
    in_time.fail = 1
    cases = [LongCase("turek-fsi3", 20.0)]
    assert study.main_long(out=tmp_path, runs=tmp_path / "runs", cases=cases) == ["not-converged"]
    frame = pd.read_csv(tmp_path / "long.csv")
    assert frame["complete"].tolist() == [False]
