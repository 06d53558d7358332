"""The paper's study: its data, figures, tables, and what becomes of sweeps that end early."""

import io
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from run_folders import make_run
from test_report import colours, pixels

from ffsi.files.errors import InputError
from ffsi.report import walls
from ffsi.result.fields import Fields
from ffsi.scene import SceneError, load_scene
from ffsi.scene.fluids import Carreau, Newtonian
from studies.paper import aneurysm, flap
from studies.paper.flap import CASES, Curve, Outcome, PaperCase

KEY = "inflow.mean_velocity"
FIGURES = ["figure-03-velocity.png", "figure-04-pressure.png", "figure-05-displacement.png", "figure-12-forces.png"]


@pytest.fixture
def one(monkeypatch) -> PaperCase:
    """Only case 1, with three points and one sweep to compare with."""
    curve = Curve("case-1", "coarse root", "flap-svk", (0.04, 0.08, 0.12))
    other = Curve("fine", "fine root", "flap-svk", (0.04, 0.08), ("mesh.root_size=0.005",))
    case = PaperCase(1, "St. Venant-Kirchhoff flap", curve, (other,))
    monkeypatch.setattr(flap, "main", partial(flap.main, level=0, cases=[case]))
    return case


def outcome(curve: Curve, tmp_path, *, steps: int, failure: str = "", **columns) -> Outcome:
    """A sweep over 0.01, 0.02, ... m/s whose last point failed if `failure` says so."""
    count = len(next(iter(columns.values())))
    failures = [""] * steps + [failure] * (count - steps)
    table = pd.DataFrame({
        KEY: 0.01 * np.arange(1, count + 1), "status": ["failed" if item else "converged" for item in failures],
        "reason": ["J too small" if item else "" for item in failures], "failure": failures, **columns,
        "check_maximum": 1.234e-11, "seconds": 3.0, "folder": ".", "point": 1,
    })  # fmt: skip
    return Outcome(curve, load_scene(curve.scene, ["mesh.level=0"]), make_run(tmp_path / curve.name), table)


def test_figures_and_velocities_are_those_of_the_paper_in_valid_scenes():
    numbers = sorted(number for case in CASES for number in case.figures.values())
    assert numbers == list(range(3, 15)) and [case.figures["forces"] for case in CASES] == [12, 13, 14]
    assert CASES[1].file("pressure") == "figure-07-pressure.png"
    first, second, third = (case.curve.velocities for case in CASES)
    assert first == (0.012, 0.024, 0.036, 0.048, 0.06, 0.072, 0.084, 0.096, 0.108, 0.12)
    assert second[:10] == third[:10] == (0.0055, 0.011, 0.0165, 0.022, 0.0275, 0.033, 0.0385, 0.044, 0.0495, 0.055)
    assert second[-1] == third[-1] == 0.12
    assert all(tuple(sorted(curve.velocities)) == curve.velocities for case in CASES for curve in case.curves)
    scenes = flap.load_scenes(CASES, 3)
    assert len({curve.name for curve in scenes}) == len(scenes) == sum(len(case.curves) for case in CASES)
    assert {scene.mesh.level for scene in scenes.values()} == {3}
    bulk = {scenes[curve].solid["flap"].bulk_modulus for curve in CASES[2].curves}
    assert bulk == {5.6, 1.75e4}
    assert [set(scenes[case.curve].solid) for case in CASES] == [{"flap"}, {"flap", "roof"}, {"flap", "roof"}]
    with pytest.raises(SceneError, match=re.escape("mesh.level = 7")):
        flap.load_scenes(CASES, 7)


def test_the_study_writes_tables_figures_and_text_and_resumes(tmp_path, capsys, freefem, check, one):
    out, runs = tmp_path / "out", tmp_path / "runs"
    assert flap.main(jobs=2, out=out, runs=runs) == []
    assert sorted(path.name for path in out.iterdir()) == sorted([*FIGURES, "case-1.csv", "fine.csv", "paper.md"])
    assert sorted(freefem.solved) == [0.04, 0.04, 0.08, 0.08, 0.12]
    table = pd.read_csv(out / "case-1.csv")
    assert table[KEY].tolist() == [0.04, 0.08, 0.12] and table["drag"].tolist() == [0.08, 0.16, 0.24]
    assert not {"seconds", "folder", "point"} & set(table)
    text = (out / "paper.md").read_text()
    assert "`python -m studies paper` (FreeFEM 4.9 with MUMPS, mesh level 0)" in text
    assert "*Figure 3, at 0.12 m/s: velocity" in text and all(f"]({name})" in text for name in FIGURES)
    for name in FIGURES:
        assert (out / name).stat().st_size <= 150_000 and Image.open(out / name).width > 500
    assert (runs / "level-0" / "fine" / "sweep.csv").is_file()
    assert re.search(r"case 1 +flap-svk +900 +3 of 3 +0\.12", capsys.readouterr().out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert flap.main(out=out, runs=runs) == [] and len(freefem.solved) == 5
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_where_a_sweep_ends_stays_visible_and_is_no_failure(tmp_path, capsys, freefem, check, one):
    freefem.limit = 0.06
    assert flap.main(out=tmp_path / "out", runs=tmp_path / "runs") == []
    table = pd.read_csv(tmp_path / "out" / "case-1.csv")
    assert table["failure"].fillna("").tolist() == ["", "not-converged", "not-converged"]
    assert table["reason"][1] == "J too small" and table["drag"].notna().tolist() == [True, False, False]
    assert table["min_jacobian"].notna().tolist() == [True, False, False]
    assert table["reached_min_jacobian"].notna().tolist() == [False, True, True]
    text = (tmp_path / "out" / "paper.md").read_text()
    assert "The sweep ended at 0.08 m/s: J too small." in text and "*Figure 3, at 0.04 m/s: velocity" in text
    assert "| failed (not-converged) |" in text and "| case 1 | flap-svk | 900 | 1 of 3 | 0.04 | 0.08 |" in text
    assert "case-1 ended at 0.08 m/s: J too small" in capsys.readouterr().err


@pytest.mark.parametrize(("ending", "velocity", "failures"), [
    ("limit", 0.03, {"not-converged"}), ("die", 0.08, {"crash"}), ("wrong", 0.08, {"check"}),
])  # fmt: skip
def test_failures_are_returned(tmp_path, freefem, check, one, ending, velocity, failures):
    setattr(check if ending == "wrong" else freefem, ending, velocity)
    assert set(flap.main(out=tmp_path / "out", runs=tmp_path / "runs")) == failures
    text = (tmp_path / "out" / "paper.md").read_text()
    assert ("Figure 3: nothing was solved" in text) == (ending == "limit")
    assert (tmp_path / "out" / FIGURES[0]).is_file() == (ending != "limit")


def test_bad_input_writes_nothing(tmp_path, freefem, check, one):
    with pytest.raises(SceneError):
        flap.main(level=9, out=tmp_path / "out", runs=tmp_path / "runs")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        flap.main(out=tmp_path / "file", runs=tmp_path / "runs")
    assert freefem.solved == []


def test_the_highest_velocity_counts_and_not_the_last_row(tmp_path):
    done = outcome(CASES[0].curve, tmp_path, steps=2, failure="not-converged", drag=[1.0, 2.0, 3.0])
    assert done.end == (pytest.approx(0.03), "J too small") and done.failures == []
    assert done.solved["drag"].tolist() == [1.0, 2.0]
    turned = Outcome(done.curve, done.scene, done.directory, done.table[::-1])
    assert turned.solved["drag"].tolist() == [1.0, 2.0] and turned.highest.directory == done.directory


def test_point_tables_leave_out_what_is_no_solution(tmp_path):
    values = {"drag": [1e-3, None], "tip_ux": [0.1, None], "min_jacobian": [0.5, None], "roof_uy": [np.nan, np.nan]}
    values |= {"reached_tip_ux": [None, 0.2], "reached_min_jacobian": [None, 0.01]}
    done = outcome(CASES[0].curve, tmp_path, steps=1, failure="not-converged", **values)
    text = flap.point_table(done).markdown()
    head = "| v_mean (m/s) | drag (N/m) | tip_ux (m) | min_jacobian | before the failure | check | status |"
    assert text.splitlines()[0] == head
    assert [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]] == [
        ["0.01", "0.001", "0.1", "0.5000", "–", "1e-11", "converged"],
        ["0.02", "–", "–", "–", "0.0100", "1e-11", "failed (not-converged)"],
    ]


def test_statements_carry_the_numbers(tmp_path):
    tip = {"tip_ux": [0.012, 0.03, 0.06], "tip_uy": [0.0, -0.04, -0.08]}
    first = outcome(CASES[0].curve, tmp_path, steps=3, **tip)
    text = flap.text_of(CASES[:1], {CASES[0].curve: first}, [])
    assert (
        "Here: the tip moves by 6 % of the flap's height at 0.01 m/s and 50 % of the flap's height at 0.03 m/s." in text
    )
    assert "Here: at 0.03 m/s the tip moves by 0.1 m, 50 % of the flap's height." in text
    assert "Here: it grows at every step: 0.012 m at 0.01 m/s, 0.1 m at 0.03 m/s." in text
    back = outcome(CASES[0].curve, tmp_path / "back", steps=2, tip_ux=[0.02, 0.01])
    assert "it does not grow at every step" in flap.text_of(CASES[:1], {CASES[0].curve: back}, [])


def test_the_roofs_of_both_cases_are_compared_where_both_got_to(tmp_path):
    soft = outcome(CASES[1].curve, tmp_path, steps=3, tip_ux=[0.1, 0.1, 0.1], roof_uy=[0.1, 0.2, 0.3])
    stiff = outcome(
        CASES[2].curve, tmp_path, steps=2, failure="not-converged",
        tip_ux=[0.01, 0.02, 0.0], tip_uy=[0.0, -0.001, 0.0], roof_uy=[0.15, 0.25, 0.0],
    )  # fmt: skip
    text = flap.text_of(CASES[1:], {CASES[1].curve: soft, CASES[2].curve: stiff}, [])
    assert "at 0.02 m/s the middle of the roof rises by 0.2 m over this flap and by 0.25 m" in text
    assert "over this flap" not in flap.text_of(CASES[1:2], {CASES[1].curve: soft}, [])
    assert "at 0.02 m/s the ratio of the two is 0.05." in text
    assert "rises by 0.25 m, 62.5 % of the channel's height" in text


def test_remarks_name_their_cases_and_open_values_their_scenes(tmp_path):
    tables = {case.curve: outcome(case.curve, tmp_path, steps=1, tip_ux=[0.1], tip_uy=[0.0]) for case in CASES}
    text = flap.text_of(CASES, tables, [])
    assert "**Drag and lift.** Paper: F<sub>D</sub> = ∫<sub>S</sub> ( ρ η ∂u<sub>t</sub>/∂n" in text
    assert text.count("**Drag and lift.**") == 1 and "**Bulk modulus (case 3).** Paper: K = 5.6 Pa" in text
    assert "Poisson's ratio −0.931" in text
    assert "**Rate of deformation.** Paper: D in the viscosity law (30) is called the deformation gradient." in text
    assert "| element size at the flap's root corners | 1 | 0.01 m |" in text
    assert "| elastic roof | 2, 3 | the strip [0, 2.5] x [0.4, 0.42] m" in text
    assert "| left side of the flap | 1, 2, 3 | x = 0.5 m |" in text


def test_figures_belong_to_the_highest_velocity_and_show_the_comparison(tmp_path, freefem, check, one):
    outcomes = flap.run_sweeps(flap.load_scenes([one], 0), tmp_path)
    figures = flap.draw(one, outcomes)
    assert list(figures) == ["velocity", "pressure", "displacement", "forces"]
    assert figures["velocity"].axes[0].get_title(loc="left").endswith("mean inflow velocity 0.12 m/s")
    drag = figures["forces"].axes[0]
    np.testing.assert_allclose(drag.lines[0].get_xydata(), [[0.04, 0.08], [0.08, 0.16], [0.12, 0.24]])
    np.testing.assert_allclose(drag.lines[1].get_xydata(), [[0.04, 0.08], [0.08, 0.16]])
    legend = [text.get_text() for text in figures["forces"].legends[0].get_texts()]
    assert legend == ["coarse root", "fine root"]
    buffer = io.BytesIO()
    figures["displacement"].savefig(buffer, format="png", dpi=50)
    assert Image.open(buffer).width > 100


def test_eight_variants_and_their_systole() -> None:
    scenes = {variant.name: variant.scene(1) for variant in aneurysm.VARIANTS}
    assert list(scenes) == [
        "steady-elastic", "steady-elastic-carreau", "steady-rigid", "steady-rigid-carreau", "pulsatile-elastic",
        "pulsatile-elastic-carreau", "pulsatile-rigid", "pulsatile-rigid-carreau",
    ]  # fmt: skip
    for name, scene in scenes.items():
        assert scene.mesh.level == 1 and scene.physics == ("fsi" if "elastic" in name else "fluid")
        assert isinstance(scene.fluid, Carreau if "carreau" in name else Newtonian)
        assert (scene.time is not None) == (scene.output.wall is not None) == name.startswith("pulsatile")
        assert (scene.support is not None) == name.startswith("pulsatile-elastic")
        if scene.time:
            assert scene.inflow and scene.inflow.period
            assert scene.time.output_interval == pytest.approx(scene.inflow.period / 20)
    with pytest.raises(Exception, match=r"mesh\.level = 7"):
        aneurysm.VARIANTS[0].scene(7)
    found = aneurysm.systole(SimpleNamespace(scene=aneurysm.VARIANTS[4].scene(1)))  # type: ignore[arg-type]
    period = 60 / 84
    assert 3 * period < found < 4 * period and found / period % 1 == pytest.approx(0.648, abs=1e-3)


def shades(figure: Any) -> int:
    return colours(pixels(figure))


def wall(cycle: int | None = None) -> pd.DataFrame:
    arc = np.linspace(0, 0.01, 21)
    part = np.where(np.abs(arc - 0.005) < 0.001, "dome", np.where(np.abs(arc - 0.005) < 0.002, "neck", "vessel"))
    table = pd.DataFrame({"line": "dome", "arc": arc, "part": part, "wss": 1 + arc, "pressure": 5.0 - 100 * arc})
    return table if cycle is None else table.assign(cycle=cycle, tawss=1 + arc, osi=0.1, rrt=2.0)


def test_pictures_and_curves_of_mesh_stress_dome_and_neck(fields: Fields) -> None:
    assert shades(aneurysm.mesh_picture(fields, "title")) > 20
    stress = np.linspace(0, 1, len(fields.points))
    assert shades(walls.wall_stress(fields, stress, 1.0, "title")) > 20
    low, high = fields.deformed.min(axis=0), fields.deformed.max(axis=0)
    assert shades(aneurysm.velocity_within(fields, (low, (low + high) / 2))) > 20
    figure = walls.along_walls(
        {"a": wall(), "b": wall()}, [("wss", "WSS (Pa)"), ("pressure", "p (Pa)")], "title", ("wss",)
    )
    first, second = figure.axes
    assert first.get_yscale() == "log" and second.get_yscale() == "linear" and len(first.get_lines()) == 2
    shaded = sorted(tuple(np.round(patch.get_extents().transformed(first.transData.inverted()).intervalx, 2))
                    for patch in first.patches)  # fmt: skip
    assert shaded == [(3.5, 4.0), (4.5, 5.5), (6.0, 6.5)]


def result(pulsatile: bool, failure: str = "") -> Any:
    quantities = {
        "wss_mean_neck": 0.2, "wss_mean_dome": 0.01, "dome_inflow": 1e-6, "flow_rate_in": 1e-5, "pressure_drop": 3.0,
        "mass_balance": 1e-16,
    }  # fmt: skip
    parts = {f"{name}_{part}": 0.5 for part in ("dome", "neck", "vessel") for name in ("tawss_mean", "osi_mean")}
    data = {
        "unknowns": 900, "check": {"momentum": 2e-11, "drag_difference": None}, "timings": {"script": 12.34},
        "freefem": {"version": "4.9", "solver": "MUMPS"}, "time": {"steps": 400} if pulsatile else None,
        "cycles": [parts, parts | {"tawss_change": 3e-5}] if pulsatile else None,
    }  # fmt: skip
    return SimpleNamespace(
        data=data, quantities=quantities, failure=failure, solved=failure != "not-converged",
        status="failed" if failure else "converged", wall=wall(2 if pulsatile else None),
    )  # fmt: skip


def test_text() -> None:
    results = {variant: result(variant.pulsatile) for variant in aneurysm.VARIANTS}
    text = aneurysm.text_of(results, ["figure-15-mesh.png"])
    assert "Written by `python -m studies paper --aneurysm` (FreeFEM 4.9 with MUMPS)." in text
    assert text.count("](figure-15-mesh.png)") == 1 and "figure-16" not in text
    assert "| pulsatile | rigid, Carreau | 900 | 400 | 12.3 | 2e-11 | converged |" in text
    assert "| elastic, Newtonian | dome | 0.5 |" in text and "3e-05" in text
    assert "20 times that of the dome; 10 % of the flow enters the dome" in text
    assert "4.45 to 4.55 Pa" in text  # pressure in the dome


def test_every_variant_is_run_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: dict[str, Any] = {}
    monkeypatch.setattr(
        aneurysm, "run_all", lambda scenes, runs: ran.update({runs / name: scenes[name] for name in scenes})
    )
    monkeypatch.setattr(
        aneurysm, "load_result", lambda path: result(bool(ran[path].time), "not-converged" if ran[path].time else "")
    )
    monkeypatch.setattr(aneurysm, "draw", lambda results: {})
    out = tmp_path / "out"
    assert aneurysm.main(level=1, out=out, runs=tmp_path / "runs") == ["", "", "", "", *["not-converged"] * 4]
    assert list(ran) == [tmp_path / "runs/aneurysm-level-1" / variant.name for variant in aneurysm.VARIANTS]
    assert sorted(path.name for path in out.iterdir()) == [
        *(f"aneurysm-steady-{name}-wall.csv" for name in ("elastic-carreau", "elastic", "rigid-carreau", "rigid")),
        "aneurysm.md",
    ]
