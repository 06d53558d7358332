"""The benchmark: ratios, medians, tables, mesh motions, and what is written."""

import math
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.scene import CASES, load_scene
from studies.bench import factors, mesh_motion, speed, steady
from studies.bench import unsteady as bench
from studies.bench.mesh_motion import MOTIONS, SWEEPS, Motion, Sweep, Track
from studies.bench.speed import FSI1, SAMPLES, Sample, alternating, processor_time, reference, row, within
from studies.bench.unsteady import FINEST, TIME_STEPS
from studies.harness import Run, multiples, run_all
from studies.tables import table

pytestmark = pytest.mark.usefixtures("unwatched")

TIMINGS = {
    "mesh": 0.1, "operators": 0.3, "residual": 0.05, "jacobian": 0.35, "factorize": 0.5, "solve": 0.1, "output": 0.15,
    "check": 0.05, "script": 2.0, "total": 3.0, "pictures": 0.7,
    "one_factorization": 0.5, "one_jacobian": 0.25, "one_residual": 0.005, "one_solve": 0.01,
}  # fmt: skip
BLOCKS = ("bench", "bench-scenes", "mesh-motion")
README = "".join(f"<!-- {name}:begin -->\n<!-- {name}:end -->\n" for name in BLOCKS)


def run(level: int = 2, factor: float = 1.0, case: str = "turek-fsi1") -> Run:
    """A run with these timings; `factor` multiplies all but those of a single factorisation, Jacobian, ..."""
    timings = {name: value if name.startswith("one_") else factor * value for name, value in TIMINGS.items()}
    return Run(
        case,
        {
            "case": case, "status": "converged", "failure": "", "level": level, "unknowns": 1000 * level + 5000,
            "triangles": 2800, "newton": {"iterations": 6, "factorizations": 1}, "timings": timings,
            "quantities": {"drag": 14.3, "lift": 0.76, "tip_ux": 2.2e-5, "tip_uy": 8.1e-4},
            "freefem": {"version": "4.9", "solver": "MUMPS"},
        },
    )  # fmt: skip


def failed(case: str, level: int) -> Run:
    return Run(case, {"status": "failed", "failure": "not-converged", "reason": "J too small", "level": level})


def test_ratios_medians_and_marks_in_tables():
    found = steady.ratios(TIMINGS)
    assert found == pytest.approx({"newton": 2.0, "one_jacobian": 0.5, "one_residual": 0.01, "overhead": 1.2})
    assert {ratio.name: ratio.bound for ratio in steady.RATIOS} == {
        "newton": 5, "one_jacobian": 1, "one_residual": 1 / 20, "overhead": 4,
    }  # fmt: skip
    found = steady.ratios({name: value for name, value in TIMINGS.items() if name != "check"})
    assert found["overhead"] != found["overhead"]  # NaN
    assert found["newton"] == pytest.approx(2) and all(value != value for value in steady.ratios({}).values())
    row = steady.cost_row([run(factor=1), run(factor=10), run(factor=2)])
    assert (row["seconds"], row["script_seconds"]) == (6.0, 4.0) and row["ratio_newton"] == pytest.approx(4)
    assert (row["runs"], row["status"]) == (3, "converged")
    table = steady.level_table(
        [steady.cost_row([run()]), steady.cost_row([run(factor=3)]), steady.cost_row([failed("x", 3)])]
    )
    assert table.head[3] == "residual + Jacobian + factorise + solve (below 5)"
    assert table.body[0] == ["2", "7000", "0.500", "2.00", "0.50", "0.010", "1.20"] and table.body[1][3] == "6.00 !"
    assert set(table.body[2][1:]) == {"–"}


def test_table_and_readme_are_written(tmp_path, monkeypatch, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    monkeypatch.setattr(steady, "measure", lambda variant, level: run(level, level + 1))
    assert steady.main_levels(repeat=2, out=tmp_path / "results", readme=readme) == [""] * 10
    frame = pd.read_csv(tmp_path / "results/bench-turek-fsi1.csv")
    assert frame["script_seconds"].tolist() == [2, 4, 6, 8, 10]
    text = readme.read_text()
    assert "Written by `python -m studies bench --repeat 2`" in text
    assert "one residual (below 0.05)" in capsys.readouterr().out
    monkeypatch.setattr(steady, "measure", lambda variant, level: failed(variant.case, level))
    assert steady.main_levels(readme=readme) == ["not-converged"] * 5 and readme.read_text() == text


def solution(**timings: float) -> Run:
    """A run whose timings differ from `TIMINGS`."""
    base = run(case="cook")
    return replace(base, data={**base.data, "timings": {**TIMINGS, "coarser_meshes": 0.25, **timings}})


def test_scenes_and_formulations_within_a_repetition():
    rows = [steady.cost_row([solution()]), steady.cost_row([solution(jacobian=2.0, solve=3.0, one_jacobian=0.6)])]
    table = steady.scene_table([*rows, steady.cost_row([failed("flap-svk", 2)])], reasons=True)
    assert table.head[4] == "Newton (< 5)"
    assert table.body[0] == ["cook", "2", "7000", "0.500", "2.00", "0.50", "0.010", "1.20", "0.50", "6", "1", ""]
    assert table.body[1][4:6] == ["11.10 !", "1.20 !"]
    assert table.body[1][-1] == "Newton: solve 6.0, Jacobian 4.0, factorise 1.0, residual 0.1; one Jacobian"
    assert table.body[2] == ["flap-svk", "2", *["–"] * 9, ""]
    assert steady.scene_table(rows).body == [row[:-1] for row in table.body[:2]]
    assert set(steady.NEAREST) | set(steady.FORMULATED) <= set(CASES.steady)
    for case, solid in steady.FORMULATED.items():
        for formulation in steady.FORMULATIONS:
            scene = load_scene(case, [f"solid.{solid}.formulation={formulation}"])
            assert scene.solid[solid].mixed == (formulation != "displacement")
    # A machine that is ten times slower in the second repetition changes no quotient.
    repetitions = [
        [solution(total=slow), solution(total=1.25 * slow, one_jacobian=0.4), solution(total=2 * slow)]
        for slow in (3.0, 30.0, 3.0)
    ]
    rows = steady.formulation_rows("cook", repetitions)
    assert [row["quotient_total"] for row in rows] == pytest.approx([1, 1.25, 2])
    assert rows[1]["quotient_one_jacobian"] == pytest.approx(1.6)
    table = steady.formulation_table(rows)
    assert table.body[1][:2] == ["cook", "mixed"]
    assert table.body[1][5:] == ["1.25", "1.00", "1.00", "1.60 !", "1.00"] and table.body[2][5] == "2.00 !"
    rows = steady.formulation_rows("cook", [[solution(), failed("cook", 2), solution()]])
    assert steady.formulation_table(rows).body[1] == ["cook", "mixed", *["–"] * 8] and rows[2]["quotient_script"] == 1


@pytest.fixture
def runs(monkeypatch) -> list[tuple[str, tuple[str, ...]]]:
    calls = []

    def solved(case, *settings):
        calls.append((case, settings))
        return replace(solution(), name=case)

    monkeypatch.setattr(steady, "run", solved)
    monkeypatch.setattr(steady, "measure", lambda variant, level: solution())
    return calls


def test_scenes_are_run_and_written(tmp_path, runs, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    assert set(steady.main_scenes(repeat=2, out=tmp_path / "results", readme=readme)) == {""}
    assert [runs.count((case, ())) for case in CASES.steady] == [2] * len(CASES.steady)
    pairs = [settings[0].partition("formulation=")[2] for _, settings in runs if settings]
    assert pairs == [*steady.FORMULATIONS] * 6
    assert len(pd.read_csv(tmp_path / "results/bench-scenes.csv")) == len(CASES.steady)
    assert pd.read_csv(tmp_path / "results/bench-formulations.csv")["quotient_newton"].tolist() == [1] * 9
    text = readme.read_text()
    assert "Written by `python -m studies bench --scenes --repeat 2`" in text
    assert "(results/bench-formulations.csv)" in text and "Formulations of the solid" in capsys.readouterr().out


def test_a_run_counts_what_was_done_on_coarser_meshes(monkeypatch):
    history = pd.DataFrame({"stage": [1, 1, 2, 2], "seconds": [0.1, 0.4, 0.9, 1.0]})
    done = SimpleNamespace(data=dict(solution().data), solved=True, history=history)
    monkeypatch.setattr("studies.harness.solve", lambda scene, **_: done)
    found = steady.run("cook")
    assert (found.level, found.timings["coarser_meshes"]) == (2, 0.4)
    done.history = history[history["stage"] == 2]
    assert steady.run("cylinder-2d1").timings["coarser_meshes"] == 0


# Mesh motion --------------------------------------------------------------------------------------------------------

SHORT = Sweep("flap-neo-hookean", "rigid roof", (0.06, 0.12, 0.18))
GOOD, POOR = MOTIONS[6], MOTIONS[0]


def point(number: int, jacobian: float, failure: str = "") -> dict[str, object]:
    """What `result.json` holds; counts and script seconds go on from point to point."""
    return {
        "status": "failed" if failure else "converged", "failure": failure, "unknowns": 9007,
        "reason": "the fluid mesh folds at (0.54, 0.2) (last good state at load 0.9; and so on)" if failure else "",
        "reached" if failure else "quantities": {"min_jacobian_fluid": jacobian, "drag": 0.1, "tip_ux": 0.13},
        "newton": {"iterations": 10 * number, "factorizations": number},
        "timings": {"script": 1.5 * number, "one_factorization": 0.1, "one_jacobian": 0.07},
        "freefem": {"version": "4.9", "solver": "MUMPS"},
    }  # fmt: skip


def track(motion: Motion, *jacobians: float, failure: str = "", sweep: Sweep = SHORT) -> Track:
    last = len(jacobians)
    points = [point(i, value, failure if i == last else "") for i, value in enumerate(jacobians, start=1)]
    return Track(sweep, motion, points)


def known(found: Track) -> dict[str, object]:
    names = [*found.motion._fields, "roof", "ended"]
    return {key: value for key, value in found.row.items() if key not in names and value is not None}


def test_a_sweep_to_its_last_point_and_one_that_ends_before():
    found = track(GOOD, 0.7, 0.5, 0.4)
    assert found.end is None
    assert known(found) == {
        "reaches": "≥ 0.18", "min_jacobian_last": 0.4, "min_jacobian": 0.5, "tip_ux": 0.13, "seconds": 3.0,
        "iterations": 20, "factorizations": 2, "one_factorization": 0.1, "one_jacobian": 0.07,
    }  # fmt: skip
    found = track(POOR, 0.7, 0.01, failure="not-converged")
    assert found.row["reaches"] == "0.06" and found.end is not None and found.end[0] == 0.12
    assert found.row["min_jacobian_last"] == 0.7 and "min_jacobian" not in known(found)
    assert known(track(POOR, 0.01, failure="not-converged")) == {"reaches": "–"}


def test_a_failed_check_and_a_crash_are_failures(monkeypatch):
    for failure in ("check", "crash"):
        monkeypatch.setattr(
            mesh_motion, "run",
            lambda sweep, motion, failure=failure: track(motion, 0.7, 0.5, failure=failure, sweep=sweep),
        )  # fmt: skip
        assert mesh_motion.main() == [failure] * 16


def test_mesh_motions_and_their_tables():
    found = track(GOOD, 0.7, 0.5, 0.4, failure="check")
    assert found.row["reaches"] == "≥ 0.18"
    tracks = [track(GOOD, 0.7, 0.5, 0.4), track(POOR, 0.01, failure="not-converged")]
    table = mesh_motion.motion_table(tracks, mesh_motion.ENDED)
    costs_of_good = ["3.0", "20", "2", "0.100", "0.070"]
    assert table.body[0] == [
        "rigid", "hyperelastic, size", "1", "0", "5", "≥ 0.18", "0.400", "0.500", "0.13000", *costs_of_good, "–"
    ]  # fmt: skip
    ended = "the fluid mesh folds at (0.54, 0.2)"
    assert table.body[1] == ["rigid", "harmonic, constant", "0", "0", "0", *["–"] * 9, ended]
    assert [row[:-1] for row in table.body] == mesh_motion.motion_table(tracks).body
    frame = mesh_motion.frame(tracks)
    assert frame["inflow.mean_velocity"].tolist() == [0.06, 0.12, 0.18, 0.06]
    assert frame["min_jacobian_fluid"].tolist()[:3] == [0.7, 0.5, 0.4]
    assert frame["reached_min_jacobian_fluid"].tolist()[3:] == [0.01]
    assert frame["drag"].isna().tolist() == [False, False, False, True]
    for sweep in SWEEPS:
        assert mesh_motion.COMMON in sweep.velocities
        scenes_of = [load_scene(sweep.case, motion.settings) for motion in MOTIONS]
        assert scenes_of[MOTIONS.index(GOOD)] == load_scene(sweep.case, [])
        assert len({scene.to_toml() for scene in scenes_of}) == len(MOTIONS)
    assert SWEEPS[0].velocities[-1] == 0.3 and multiples(0.1, 3) == (0.1, 0.2, 0.3)


def test_a_sweep_is_one_chain_that_ends_at_its_first_failure(monkeypatch):
    seen = []

    def chain(scene, values, out, **options):
        seen.append((scene.mesh_motion.kind, scene.mesh.level, [dict(item) for item in values], options["draw"]))
        data = [point(1, 0.7), point(2, 0.01, "not-converged"), point(3, 0.0, "not-reached")]
        return [SimpleNamespace(data=item, solved=not item["failure"]) for item in data]

    monkeypatch.setattr(mesh_motion, "run_chain", chain)
    found = mesh_motion.run(SHORT, POOR)
    assert seen == [("harmonic", 1, [{"inflow.mean_velocity": v} for v in SHORT.velocities], "none")]
    assert [item["failure"] for item in found.points] == ["", "not-converged"]


def test_mesh_motions_are_run_and_written(tmp_path, monkeypatch, capsys):
    def solved(sweep, motion):
        if motion == POOR:
            return track(motion, 0.0, failure="not-converged", sweep=sweep)
        return track(motion, 0.7, 0.5, sweep=sweep)

    monkeypatch.setattr(mesh_motion, "run", solved)
    assert mesh_motion.main(out=tmp_path / "results") == []
    assert len(pd.read_csv(tmp_path / "results/mesh-motion.csv")) == 2 * (2 * 7 + 1)
    assert (tmp_path / "results/mesh-motion.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "results/mesh-motion.md").read_text()
    assert "rigid roof, harmonic, constant: failed at 0.02 m/s: the fluid mesh folds" in text
    assert "Written by `python -m studies bench --mesh-motion`" in text
    out, err = capsys.readouterr()
    assert "hyperelastic, size" in out and "and so on" in err


PROGRAMS = ("ffsi run", "ffsi script", "NGSolve")
BURN = "import time; t = time.process_time()\nwhile time.process_time() - t < {}: pass\n"
NESTED = "import subprocess, sys; subprocess.run([sys.executable, '-c', {!r}]); print('{{\"unknowns\": 7}}')"


def test_children_count_tasks_alternate_and_failures_stay():
    seconds, found = processor_time([sys.executable, "-c", NESTED.format(BURN.format(0.3))])
    assert found["unknowns"] == 7 and found["memory"] > 5 and 0.3 < seconds < 3
    _, found = processor_time([sys.executable, "-c", "raise SystemExit('no such mesh')"])
    assert found == {"failure": "crash", "reason": "no such mesh"}
    order, numbers = [], count()

    def task(name, seconds, failing=-1):
        def do():
            order.append(name)
            return next(seconds), {"failure": "check" if next(numbers) == failing else ""}

        return do

    tasks = {("a", 1): task("a", iter([1.0, 9.0, 2.0])), ("b", 1): task("b", iter([5.0, 5.0, 7.0]), failing=1)}
    found = alternating(tasks, 3)
    assert order == ["a", "b"] * 3 and [item["seconds"] for item in found.values()] == [2, 5]
    assert [item["failure"] for item in found.values()] == ["", "check"]


def test_errors_and_the_cheapest_within_each_tolerance():
    assert reference(SAMPLES[2], {}).values["tip_ux"] == 2.2681e-5
    own = reference(Sample("flap-svk", ("drag",)), {"quantities": {"drag": 2.0}})
    line = row({"unknowns": 10, "seconds": 1.0, "quantities": {"drag": 1.9, "lift": 3.0}}, own, ("drag",), level=0)
    assert (line["error_drag"], line["error"]) == (pytest.approx(-0.05), pytest.approx(0.05))
    assert math.isnan(row({"seconds": 1.0, "failure": "crash"}, own, ("drag",))["error"])

    def line(program, seconds, error):
        return {"program": program, "mesh": "", "unknowns": 1, "seconds": seconds, "error": error}

    nan = float("nan")
    rows = [
        line("ffsi run", 1.0, 0.02),
        line("ffsi run", 3.0, 0.004),
        line("ffsi run", 6.0, 0.0009),
        line("ffsi run", 0.1, nan),
    ]
    rows += [line("NGSolve", 9.0, 0.0001), line("NGSolve", 2.0, 0.0008)]
    found = {(x["tolerance"], x["program"]): (x["seconds"], x["ratio"]) for x in within(rows)}
    assert found == {
        ("0.5 %", "ffsi run"): (3, 1.5), ("0.5 %", "NGSolve"): (2, 1), ("0.1 %", "ffsi run"): (6, 3),
        ("0.1 %", "NGSolve"): (2, 1), ("0.02 %", "NGSolve"): (9, 1),
    }  # fmt: skip


def solved(case, settings):
    """A run whose errors halve from level to level."""
    level = settings if isinstance(settings, int) else int(settings[0][-1])
    names = next(sample.quantities for sample in SAMPLES if sample.case == case)
    values = {name: 1 + 0.1 / 2**level for name in names}
    return 1.0 + level, {"unknowns": 1000 * 2**level, "memory": 90.0 * 2**level, "failure": "", "quantities": values}


BLOCKS_OF_SPEED = [("work-precision", speed.main_levels), ("peers", speed.main_peers), ("factors", factors.main)]


@pytest.mark.parametrize(("block", "main"), BLOCKS_OF_SPEED)
def test_tables_and_pictures_are_written(block, main, tmp_path, monkeypatch):
    page = tmp_path / "speed.md"
    page.write_text(f"<!-- {block}:begin -->\n<!-- {block}:end -->\n")
    monkeypatch.setattr(speed, "own", solved)
    for module in (speed, factors):
        monkeypatch.setattr(module, "script", lambda path, settings: solved(FSI1.case, settings or 2))
    monkeypatch.setattr(speed, "peer", lambda order, size, layers: solved("turek-fsi1", order))
    monkeypatch.setattr(speed, "PEER_PYTHON", page)
    assert set(main(out=tmp_path, readme=page)) == {""}
    frame = pd.read_csv(tmp_path / f"{block}.csv")
    text = page.read_text()
    assert len(frame) == {"work-precision": 26, "peers": 15, "factors": 18}[block]
    if block != "factors":
        assert (tmp_path / f"{block}.png").read_bytes().startswith(b"\x89PNG")
    assert f"Written by `python -m studies bench --{block}`" in text
    known = {"work-precision": "`flap-svk`, against the own finest level:", "peers": "| NGSolve |"}
    assert known.get(block, "| coarse to fine | 4 | 1.00 |") in text


def test_without_ngsolve_the_command_that_installs_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "PEER_PYTHON", tmp_path / "python")
    with pytest.raises(InputError, match="make bench-peers"):
        speed.main_peers()


@pytest.mark.parametrize("tolerance", ["0.1 %", "0.02 %"])
def test_the_readme_tells_what_was_measured_beside_the_peer(tolerance):
    root = Path(__file__).parents[2]
    best = within(pd.read_csv(root / "results/peers.csv").to_dict("records"))
    own, script, other = (
        next(x for x in best if (x["tolerance"], x["program"]) == (tolerance, name)) for name in PROGRAMS
    )
    lines = (root / "README.md").read_text(encoding="utf-8").splitlines()
    command = " ".join(f"--set {setting}" for setting in speed.OWN[own["mesh"]])
    (line,) = [line for line in lines if f"ffsi run turek-fsi1 {command}`" in line]
    assert f"within {tolerance}" in line
    assert script["mesh"] == own["mesh"] and f"{script['seconds']:.1f} s as a script" in line
    for item in (own, other):
        assert f"{item['seconds']:.1f} s" in line and f"{item['unknowns']:,} unknowns".replace(",", " ") in line


UNSTEADY = "<!-- bench-unsteady:begin -->\nold\n<!-- bench-unsteady:end -->\n"
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


START = Run("start", {"failure": "", "timings": dict.fromkeys(bench.SOLVER, 0.01)})


def steps(seconds: list[float]) -> Run:
    timings = dict.fromkeys(bench.SOLVER, 0.31)
    data = {"failure": "", "unknowns": 13000, "triangles": 1400, "timings": timings}
    counted = pd.DataFrame({"took": seconds, "iterations": 3.0, "rebuilds": 0.02, "tip_uy": 0.03})
    return Run("steps", data, history=counted)


def test_steps_start_from_the_developed_motion_and_its_ends_do_not_count(tmp_path, in_time, check, short, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(UNSTEADY)
    given = {"repeat": 2, "out": tmp_path / "out", "runs": tmp_path / "runs", "sizes": [SIZE]}
    assert bench.main(readme=readme, **given) == [""] * 12 and in_time.first_steps == [1, *[201] * 5]
    developed = load_scene(str(tmp_path / "runs/small-developed/scene.toml"), [])
    for name, number in (("condensed-0", 2), ("condensed-2", 22), ("newton-1", 6)):
        directory = tmp_path / f"runs/small-{name}"
        assert len(pd.read_csv(directory / "history.csv")) == 200 + number
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
    readme.write_text(UNSTEADY)
    in_time.fail = 205
    given = {"out": tmp_path / "out", "runs": tmp_path / "runs", "sizes": [SIZE]}
    assert bench.main(readme=readme, **given) == ["", "", "not-converged", "", "not-converged", *[""] * 6]
    assert readme.read_text() == UNSTEADY
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
