"""Error bars against finer meshes and steps, where they are shown, and where there are none."""

import json
from concurrent.futures import Future
from types import SimpleNamespace

import pandas as pd
import pytest
from conftest import scene_of

import ffsi
from ffsi.reference.check import check_run
from ffsi.report import write_report
from ffsi.run.beside import COARSER, TWICE, complete, scenes_beside
from ffsi.run.longer import lengthen
from ffsi.scene import with_values


@pytest.fixture(scope="module")
def estimated(tmp_path_factory):
    def estimated(case, *settings):
        return ffsi.solve(scene_of(case, *settings), tmp_path_factory.mktemp(case), error=True)

    return estimated


@pytest.mark.parametrize(("case", "names"), [
    ("turek-fsi1", ("drag", "lift", "tip_ux", "tip_uy", "pressure_drop")),
    ("cook", ("tip_ux", "tip_uy")),
    ("turek-csm1", ("tip_ux", "tip_uy")),
])  # fmt: skip
def test_bars_cover_the_difference_to_a_finer_mesh(estimated, solved, case, names):
    result, fine = estimated(case), solved(case, "mesh.level=3")
    assert result.checked and set(names) <= set(result.data["errors"])
    for name in names:
        error, wrong = result.data["errors"][name], fine.quantities[name] - result.quantities[name]
        assert abs(wrong) <= error["bar"] < 12 * abs(wrong), name
        assert abs(wrong - error["estimate"]) < 0.5 * abs(wrong), name  # with it the value is better
        if case != "turek-fsi1":  # a displacement of one solid: nothing cancels, and the sum is the estimate
            assert error["bar"] == pytest.approx(2.2 * abs(error["estimate"]), rel=1e-9)
    assert "min_jacobian" not in result.data["errors"]


def test_the_checker_makes_its_own_estimate_and_catches_a_wrong_one(estimated):
    result = estimated("turek-fsi1", "mesh.level=0", "mesh.size_factor=2")
    assert result.checked and result.data["check"]["errors_difference"] < 1e-6
    path = result.directory / "errors-0001.json"
    text = path.read_text()
    for name, part, factor in (("drag", "estimate", 1.0001), ("lift", "bar", 0.2)):
        errors = json.loads(text)
        errors["errors"][name][part] *= factor
        path.write_text(json.dumps(errors))
        (failure,) = check_run(result.directory, result.scene).failures
        assert failure.startswith("errors_difference") and name in failure


def test_the_chain_goes_on_from_the_coarse_mesh(tmp_path, solved):
    scene = scene_of("turek-fsi1")
    table = ffsi.sweep(scene, {"fluid.density": [1000.0, 900.0]}, tmp_path / "s", error=True, sensitivities=True)
    assert list(table["status"]) == ["converged"] * 2 and table["checked"].all()
    alone = ffsi.solve(with_values(scene, {"fluid.density": 900.0}), tmp_path / "alone", error=True)
    second = table.iloc[1] if table["fluid.density"][1] == 900 else table.iloc[0]
    assert second["drag"] == pytest.approx(alone.quantities["drag"], rel=1e-9)
    assert second["drag_error"] == pytest.approx(alone.data["errors"]["drag"]["bar"], rel=1e-4)
    assert table.attrs["units"]["drag_error"] == "N/m"
    slope = (table["drag"][1] - table["drag"][0]) / (table["fluid.density"][1] - table["fluid.density"][0])
    assert table["drag_by_fluid.density"].mean() == pytest.approx(slope, rel=1e-2)


def test_there_is_no_bar_where_the_refined_mesh_does_not_hold(estimated):
    result = estimated("flap-svk")  # its corner collapses there: docs/limits.md
    assert result.converged and result.data["errors"] == {}
    assert any(text.startswith("no error bars") for text in result.warnings)


def test_in_time_runs_beside_tell_what_mesh_and_step_add(tmp_path, solved):
    settings = ("time.end=0.12", "time.output_interval=0.01")
    scene = scene_of("turek-csm3", "mesh.level=1", "time.step=0.01", *settings)
    result = ffsi.solve(scene, tmp_path, error=True)
    fine = solved("turek-csm3", "mesh.level=2", "time.step=0.0025", *settings)
    assert result.checked and result.warnings == []
    for name in ("tip_ux", "tip_uy"):
        error = result.data["errors"][f"{name}_last"]
        wrong = fine.data["time"]["last"][name] - result.data["time"]["last"][name]
        assert abs(wrong) <= error["bar"] < 8 * abs(wrong), name
    write_report([tmp_path], tmp_path / "report.md")
    assert " ± " in (tmp_path / "report.md").read_text()


@pytest.mark.parametrize(("settings", "words"), [
    (["mesh.level=0"], "mesh.level = 0; accepted in time: 1 or more"),
    (["time.adaptive=true"], "time.adaptive = true; accepted in time: false"),
    (["time.end=0.015", "time.step=0.01"], "time.end"),
])  # fmt: skip
def test_in_time_there_must_be_room_for_runs_beside(tmp_path, settings, words):
    with pytest.raises(ValueError, match=words):
        ffsi.solve(ffsi.load_scene("turek-csm3", settings), tmp_path / "run", error=True)
    assert not (tmp_path / "run").exists()


def test_the_runs_beside_one_that_goes_on_go_on_to_the_same_end(tmp_path):
    scene = scene_of("turek-csm3", "mesh.level=1", "time.step=0.02", "time.end=0.04", "output.pictures=false")
    ffsi.solve(scene, tmp_path / "a", error=True, check=False)
    ffsi.solve(lengthen(tmp_path / "a", {"time.end": 0.08}), tmp_path / "a", error=True, check=False, resume=True)
    ffsi.solve(with_values(scene, {"time.end": 0.08}), tmp_path / "b", error=True, check=False)
    bars = [ffsi.load_result(tmp_path / name).data["errors"]["tip_uy_last"]["bar"] for name in "ab"]
    assert bars[0] == pytest.approx(bars[1], rel=1e-3)


@pytest.mark.parametrize(("scheme", "over"), [("shifted-crank-nicolson", 3.0), ("backward-euler", 1.0)])
def test_bars_are_three_times_richardsons_differences_of_runs_with_the_same_values(tmp_path, scheme, over):
    scene = scene_of("turek-csm3", "mesh.level=1", "time.step=0.02", "time.end=0.04", f"time.scheme={scheme}")
    data = {"warnings": [], "failure": "", "triangles": 500, "quantities": {"tip_uy": 2.0}}
    data["time"] = {"last": {"lift": 0.0}, "largest": {"lift": 0.0}}
    (tmp_path / "history.csv").write_text("step,time,lift\n1,0.02,0\n2,0.04,0\n3,0.06,0\n")
    history = pd.DataFrame({"time": [0.02, 0.06], "lift": [0.9, 0.0]})  # equal at the end only by chance
    beside = {name: Future() for name in (COARSER, TWICE)}
    found = {COARSER: (100, 1.0), TWICE: (500, 2.3)}
    for name, other in scenes_beside(scene).items():
        values = {**data, "triangles": found[name][0], "quantities": {"tip_uy": found[name][1]}}
        beside[name].set_result(SimpleNamespace(scene=other, reason="", data=values, history=history))
    complete(data, scene, tmp_path, beside)
    error = data["errors"]["tip_uy"]
    assert data["errors"]["lift_last"]["bar"] == pytest.approx(3 * (0.9 / 4 + 0.9 / over))
    assert (error["mesh"], error["step"]) == pytest.approx((1 / 4, -0.3 / over))
    assert (error["estimate"], error["bar"]) == pytest.approx((1 / 4 - 0.3 / over, 3 * (1 / 4 + 0.3 / over)))
    for future in beside.values():
        future.result().scene = with_values(future.result().scene, {"solver.tolerance": 1e-9})
    complete(data, scene, tmp_path, beside)
    assert len(data["warnings"]) == 2 and "started again with other values" in data["warnings"][0]


def test_levels_tell_the_order_and_the_error_of_the_finest(tmp_path, solved):
    table = ffsi.levels("turek-fsi1", [0, 1, 2], tmp_path / "levels")
    fine = solved("turek-fsi1", "mesh.level=3")
    assert 2 < table["order"]["lift"] < 4 and (tmp_path / "levels" / "levels.csv").is_file()
    for name in ("drag", "lift", "tip_ux", "tip_uy"):
        assert abs(fine.quantities[name] - table["level 2"][name]) < table["error"][name]


def test_a_report_shows_bars_and_sensitivities(tmp_path):
    ffsi.solve(scene_of("turek-csm1"), tmp_path / "run", error=True, sensitivities=True)
    write_report([tmp_path / "run"], tmp_path / "report.md")
    text = (tmp_path / "report.md").read_text()
    assert " ± " in text and "p/J dJ/dp" in text and "poisson" in text
