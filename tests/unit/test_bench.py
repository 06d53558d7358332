"""The benchmark: ratios, medians, tables, mesh motions, and what is written."""

from dataclasses import replace
from types import SimpleNamespace

import pandas as pd
import pytest

from ffsi.scene import CASES, load_scene
from studies.bench import mesh_motion, steady
from studies.bench.mesh_motion import MOTIONS, SWEEPS, Motion, Sweep, Track
from studies.bench.steady import (
    FORMULATIONS,
    RATIOS,
    cost_row,
    formulation_rows,
    formulation_table,
    level_table,
    ratios,
    scene_table,
)
from studies.harness import Run, multiples

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
    found = ratios(TIMINGS)
    assert found == pytest.approx({"newton": 2.0, "one_jacobian": 0.5, "one_residual": 0.01, "overhead": 1.2})
    assert {ratio.name: ratio.bound for ratio in RATIOS} == {
        "newton": 5, "one_jacobian": 1, "one_residual": 1 / 20, "overhead": 4,
    }  # fmt: skip
    found = ratios({name: value for name, value in TIMINGS.items() if name != "check"})
    assert found["overhead"] != found["overhead"]  # NaN
    assert found["newton"] == pytest.approx(2) and all(value != value for value in ratios({}).values())
    row = cost_row([run(factor=1), run(factor=10), run(factor=2)])
    assert (row["seconds"], row["script_seconds"]) == (6.0, 4.0) and row["ratio_newton"] == pytest.approx(4)
    assert (row["runs"], row["status"]) == (3, "converged")
    table = level_table([cost_row([run()]), cost_row([run(factor=3)]), cost_row([failed("x", 3)])])
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
    rows = [cost_row([solution()]), cost_row([solution(jacobian=2.0, solve=3.0, one_jacobian=0.6)])]
    table = scene_table([*rows, cost_row([failed("flap-svk", 2)])], reasons=True)
    assert table.head[4] == "Newton (< 5)"
    assert table.body[0] == ["cook", "2", "7000", "0.500", "2.00", "0.50", "0.010", "1.20", "0.50", "6", "1", ""]
    assert table.body[1][4:6] == ["11.10 !", "1.20 !"]
    assert table.body[1][-1] == "Newton: solve 6.0, Jacobian 4.0, factorise 1.0, residual 0.1; one Jacobian"
    assert table.body[2] == ["flap-svk", "2", *["–"] * 9, ""]
    assert scene_table(rows).body == [row[:-1] for row in table.body[:2]]
    assert set(steady.NEAREST) | set(steady.FORMULATED) <= set(CASES.steady)
    for case, solid in steady.FORMULATED.items():
        for formulation in FORMULATIONS:
            scene = load_scene(case, [f"solid.{solid}.formulation={formulation}"])
            assert scene.solid[solid].mixed == (formulation != "displacement")
    # A machine that is ten times slower in the second repetition changes no quotient.
    repetitions = [
        [solution(total=slow), solution(total=1.25 * slow, one_jacobian=0.4), solution(total=2 * slow)]
        for slow in (3.0, 30.0, 3.0)
    ]
    rows = formulation_rows("cook", repetitions)
    assert [row["quotient_total"] for row in rows] == pytest.approx([1, 1.25, 2])
    assert rows[1]["quotient_one_jacobian"] == pytest.approx(1.6)
    table = formulation_table(rows)
    assert table.body[1][:2] == ["cook", "mixed"]
    assert table.body[1][5:] == ["1.25", "1.00", "1.00", "1.60 !", "1.00"] and table.body[2][5] == "2.00 !"
    rows = formulation_rows("cook", [[solution(), failed("cook", 2), solution()]])
    assert formulation_table(rows).body[1] == ["cook", "mixed", *["–"] * 8] and rows[2]["quotient_script"] == 1


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
    assert pairs == [*FORMULATIONS] * 6
    assert len(pd.read_csv(tmp_path / "results/bench-scenes.csv")) == len(CASES.steady)
    assert pd.read_csv(tmp_path / "results/bench-formulations.csv")["quotient_newton"].tolist() == [1] * 9
    text = readme.read_text()
    assert "Written by `python -m studies bench --scenes --repeat 2`" in text
    assert "(results/bench-formulations.csv)" in text and "Formulations of the solid" in capsys.readouterr().out


def test_a_failed_scene_leaves_the_readme_alone(tmp_path, runs, monkeypatch):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    monkeypatch.setattr(steady, "run", lambda case, *settings: failed(case, 2))
    assert set(steady.main_scenes(readme=readme)) == {"not-converged"} and readme.read_text() == README


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


def test_a_sweep_that_no_mesh_motion_starts_is_a_failure(monkeypatch):
    monkeypatch.setattr(
        mesh_motion, "run", lambda sweep, motion: track(motion, 0.0, failure="not-converged", sweep=sweep)
    )
    assert mesh_motion.main() == ["not-converged", "not-converged"]
