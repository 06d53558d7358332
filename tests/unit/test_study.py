"""A sweep runs, goes on after what interrupts it, and its table and folder are read."""

import itertools
import json
import shutil
import tomllib
from pathlib import Path

import pandas as pd
import pytest

import ffsi
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result
from ffsi.result.table import problems as table_problems
from ffsi.run import sweep as study
from ffsi.run.sweep import sweep
from ffsi.scene import load_scene, with_values

pytestmark = pytest.mark.usefixtures("check")
KEY = "inflow.mean_velocity"
SCENE = load_scene("flap-svk", ["mesh.level=0", "output.pictures=false", "output.vtu=false"])


def test_the_table_has_one_row_per_point(tmp_path, freefem):
    table = sweep(SCENE, {"fluid.density": [1.0, 2.0], KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep", jobs=2)
    assert table[KEY].tolist() == [0.01, 0.02, 0.03] * 2 and table["drag"].tolist() == [0.02, 0.04, 0.06] * 2
    assert table["status"].tolist() == ["converged"] * 6 and table["check_maximum"].tolist() == [1e-11] * 6
    assert table["folder"].tolist() == ["chain-001"] * 3 + ["chain-002"] * 3
    written = pd.read_csv(tmp_path / "sweep" / "sweep.csv")
    assert list(written) == list(table) and written["drag"].tolist() == table["drag"].tolist()
    definition = tomllib.loads((tmp_path / "sweep" / "sweep.toml").read_text())
    assert definition["vary"] == {"fluid.density": [1.0, 2.0], KEY: [0.01, 0.02, 0.03]}


def test_a_second_call_runs_nothing_again(tmp_path, freefem):
    first = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
    assert freefem.solved == [0.01, 0.02]
    second = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
    assert freefem.solved == [0.01, 0.02]
    pd.testing.assert_frame_equal(first, second, check_dtype=False)


def test_after_a_crash_only_the_rest_runs(tmp_path, freefem):
    freefem.die = 0.03
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03, 0.04]}, tmp_path / "sweep")
    assert table["failure"].tolist() == ["", "", "crash", ""]
    freefem.die = None
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03, 0.04]}, tmp_path / "sweep")
    assert table["status"].tolist() == ["converged"] * 4 and freefem.solved == [0.01, 0.02, 0.02, 0.04, 0.03]
    assert table["folder"].tolist() == ["chain-001", "chain-001", "chain-003", "chain-002"]


def test_a_death_that_the_next_point_would_share_ends_the_piece(tmp_path, freefem):
    freefem.die, freefem.death = 0.03, "disk-full"
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03, 0.04]}, tmp_path / "sweep")
    assert table["failure"].tolist() == ["", "", "crash", "crash"]
    freefem.die = None
    assert sweep(SCENE, {KEY: [0.01, 0.02, 0.03, 0.04]}, tmp_path / "sweep")["status"].tolist() == ["converged"] * 4
    assert freefem.solved == [0.01, 0.02, 0.03, 0.04]


def test_what_does_not_converge_from_rest_is_reached_from_the_nearest_solved_point(tmp_path, freefem):
    freefem.needs_neighbour = True
    table = sweep(SCENE, {KEY: [0.02, 0.04, 0.05, 0.06, 0.08, 0.1]}, tmp_path / "sweep", jobs=2)
    assert table["status"].tolist() == ["converged"] * 6
    assert table["drag"].tolist() == [0.04, 0.08, 0.1, 0.12, 0.16, 0.2]


def test_points_that_do_not_converge_have_a_row_and_are_not_tried_again(tmp_path, freefem):
    freefem.fail = 0.02
    for _ in range(2):
        table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
        assert table["status"].tolist() == ["converged", "failed", "converged"]
        assert table["reason"].tolist()[1] == "J too small" and table["failure"].tolist() == ["", "not-converged", ""]
    assert freefem.solved == [0.01, 0.01, 0.03]


def test_of_points_straight_beyond_two_that_fail_none_is_tried(tmp_path, freefem):
    freefem.limit = 0.025
    vary = {KEY: [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]}
    tables = []
    for _ in range(2):
        table = sweep(SCENE, vary, tmp_path / "sweep")
        tables.append(table.to_csv())
        assert table_problems(tmp_path / "sweep") == []
        assert table["failure"].tolist() == ["", "", *["not-converged"] * 2, *["not-reached"] * 2]
        assert table["reason"].tolist()[-1].startswith("not reached: point ")
    assert freefem.solved == [0.01, 0.02, 0.02] and tables[0] == tables[1]
    shutil.rmtree(tmp_path / "sweep" / "chain-002")  # as if a kill had come before the second one was tried
    assert sweep(SCENE, vary, tmp_path / "sweep")["status"].tolist() == table["status"].tolist()


def test_behind_a_point_that_fails_the_rest_goes_on_from_the_one_before(tmp_path, freefem):
    freefem.fail = 0.02
    vary = {KEY: [0.01, 0.02, 0.03], "fluid.viscosity": [1e-3, 2e-3]}
    for _ in range(2):
        table = sweep(SCENE, vary, tmp_path / "sweep")
        assert table["failure"].tolist() == ["", "", "not-converged", "not-converged", "", ""]
        assert sorted({*freefem.solved}) == [0.01, 0.03]
    for chain in (tmp_path / "sweep").glob("chain-*"):  # as if a kill had come when nothing was tried again
        if chain.name != "chain-001":
            shutil.rmtree(chain)
    again = sweep(SCENE, vary, tmp_path / "sweep")
    assert again["failure"].tolist() == table["failure"].tolist()


def test_points_that_fail_from_rest_and_from_their_neighbour_are_not_tried_again(tmp_path, freefem):
    freefem.fail = 0.01
    for _ in range(2):
        table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
        assert table["failure"].tolist() == ["not-converged", "", ""]
    assert freefem.solved == [0.02, 0.03, 0.02]


def test_a_killed_sweep_is_picked_up_from_the_files_of_its_complete_points(tmp_path, freefem):
    out = tmp_path / "sweep"
    sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, out)
    chain = out / "chain-001"
    for number in (2, 3):  # as if Python had been killed while it checked point 2 and FreeFEM wrote point 3
        (chain / f"result-{number:04d}.json").unlink()
    (chain / "result.json").unlink()
    text = (chain / "point-0003.json").read_text()
    (chain / "point-0003.json").write_text(text[: len(text) // 2])
    freefem.solved.clear()
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, out)
    assert freefem.solved == [0.03]
    assert table["status"].tolist() == ["converged"] * 3 and table["check_maximum"].tolist() == [1e-11] * 3


def test_the_table_is_on_disk_while_the_sweep_runs(tmp_path, freefem, monkeypatch):
    sizes = []
    monkeypatch.setattr(study._Table, "add", _spy(study._Table.add, lambda: sizes.append(_rows(tmp_path / "s"))))
    sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "s")
    assert sizes[0] == 1 and _rows(tmp_path / "s") == 3


@pytest.mark.parametrize(("scene", "vary", "message"), [
    (SCENE, {KEY: [0.01, 0.03]}, r"vary.inflow.mean_velocity is \[0.01, 0.02\] there and \[0.01, 0.03\] here"),
    (SCENE, {KEY: [0.01, 0.02], "mesh.level": [0]}, "vary.mesh.level is absent there"),
    (load_scene("flap-svk", ["mesh.level=1"]), {KEY: [0.01, 0.02]}, "scene.mesh.level is 0 there and 1 here"),
])  # fmt: skip
def test_another_definition_in_the_same_folder_is_refused(tmp_path, freefem, scene, vary, message):
    out = tmp_path / "sweep"
    sweep(SCENE, {KEY: [0.01, 0.02]}, out)
    before = (out / "sweep.csv").read_text()
    with pytest.raises(InputError, match=message):
        sweep(scene, vary, out)
    assert (out / "sweep.csv").read_text() == before


def test_a_foreign_folder_is_refused(tmp_path, freefem):
    (tmp_path / "letter.txt").write_text("x")
    with pytest.raises(InputError, match="not empty and holds no sweep"):
        sweep(SCENE, {KEY: [0.01]}, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_chain_json_tells_the_points(tmp_path, freefem):
    sweep(SCENE, {"mesh.level": [0], KEY: [0.01, 0.02]}, tmp_path / "sweep")
    data = json.loads((tmp_path / "sweep" / "chain-001" / "chain.json").read_text())
    assert data == {"points": [{"mesh.level": 0, KEY: 0.01}, {"mesh.level": 0, KEY: 0.02}]}


def result_of(directory: Path, failure: str, drag: float = 0.0, *, checked: bool = True) -> Result:
    good = not failure
    data = {"status": "converged" if good else "failed", "failure": failure, "varied": {KEY: 0.01}, "point": 1}
    data |= {"quantities": {"drag": drag} if good else {}, "checked": good and checked, "digest": ""}
    return Result(SCENE, directory, data)


@pytest.mark.parametrize("worse", ["crash", "not-reached", "not-converged", "check", "stopped"])
def test_a_failure_in_another_chain_never_replaces_a_result(tmp_path, worse):
    for first, second in itertools.permutations(("", worse)):
        table = study._Table(tmp_path, [KEY], [{KEY: 0.01}])
        for number, failure in enumerate((first, second), start=1):
            table.add(result_of(tmp_path / f"chain-{number:03d}", failure, 2.5))
        assert table.write()["drag"].tolist() == [2.5] and table.write()["failure"].tolist() == [""]


def test_of_two_results_the_checked_one_and_else_the_first_counts(tmp_path):
    one, two = tmp_path / "chain-001", tmp_path / "chain-002"
    for results, drag in (
        ([result_of(one, "", 1.0, checked=False), result_of(two, "", 2.0)], 2.0),
        ([result_of(two, "", 2.0), result_of(one, "", 1.0, checked=False)], 2.0),
        ([result_of(one, "", 1.0), result_of(two, "", 2.0)], 1.0),
        ([result_of(two, "", 2.0), result_of(one, "", 1.0)], 1.0),
        ([result_of(one, "", 1.0), result_of(one, "", 3.0)], 3.0),  # made again in its place
    ):
        table = study._Table(tmp_path, [KEY], [{KEY: 0.01}])
        for result in results:
            table.add(result)
        assert table.write()["drag"].tolist() == [drag]


@pytest.mark.parametrize(("failure", "is_solved", "is_missing", "is_alone"), [
    *(("", True, False, False), ("check", True, False, False), ("not-converged", False, False, True)),
    *(("not-reached", False, True, False), ("crash", False, True, False), ("stopped", False, True, False)),
])  # fmt: skip
def test_what_has_to_run(tmp_path, failure, is_solved, is_missing, is_alone):
    table = study._Table(tmp_path, [KEY], [{KEY: 0.01}])
    table.add(result_of(tmp_path / "chain-001", failure))
    assert table.solved() == [{KEY: 0.01}] * is_solved and table.missing() == [{KEY: 0.01}] * is_missing
    assert table.alone() == [{KEY: 0.01}] * is_alone


def test_a_sweep_is_locked_for_the_whole_call(tmp_path, freefem):
    refused = []

    def again(event):
        if event.kind != "point":
            return
        with pytest.raises(InputError, match=r"another ffsi is at work in .*sweep; wait for its end") as caught:
            sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
        refused.append(caught)

    table = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep", on_event=again)
    assert len(refused) == 2 and freefem.solved == [0.01, 0.02]
    assert table["status"].tolist() == ["converged"] * 2
    sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")


def test_a_failed_point_has_no_quantities_but_what_was_reached(tmp_path, freefem):
    freefem.fail = 0.02
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
    assert table["tip_ux"].notna().tolist() == [True, False, True]
    assert table["reached_tip_ux"].notna().tolist() == [False, True, False]
    assert list(table)[-4:] == ["check_maximum", "seconds", "folder", "point"]
    data = json.loads((tmp_path / "sweep" / "chain-001" / "result-0002.json").read_text())
    assert data["quantities"] == {} and data["reached"]["tip_ux"] == 0.01 * 0.02 and data["reached"][KEY] == 0.02


def test_what_failed_the_check_does_not_stand_among_the_quantities(tmp_path, freefem, check):
    check.wrong = 0.02
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
    assert table["checked"].tolist() == [True, False, True]
    assert table["drag"].notna().tolist() == [True, False, True] and table["reached_drag"].tolist()[1] == 0.04


def test_what_nobody_checked_is_checked_by_the_next_call(tmp_path, freefem, check):
    table = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep", check=False)
    assert (table["status"].tolist(), table["checked"].tolist()) == (["converged"] * 2, [False] * 2)
    sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep", check=False)
    assert check.calls == []
    check.wrong = 0.02
    table = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
    assert check.calls == [(0.01, 1), (0.02, 2)] and freefem.solved == [0.01, 0.02]
    assert table["checked"].tolist() == [True, False] and table["failure"].tolist() == ["", "check"]


def _spy(method, after):
    def wrapped(self, result):
        method(self, result)
        after()

    return wrapped


def _rows(path) -> int:
    return len(pd.read_csv(path / "sweep.csv"))


def test_a_study_is_read_from_its_folder(tmp_path, freefem):
    vary = {KEY: [0.01, 0.02], "fluid.viscosity": [1e-3, 2e-3]}
    table, study = sweep(SCENE, vary, tmp_path / "s"), ffsi.Study(tmp_path / "s")
    pd.testing.assert_frame_equal(study.table, table)
    assert study.table.attrs["units"][KEY] == "m/s"
    units = pd.read_csv(tmp_path / "s" / "sweep.units.csv").set_index("column")["unit"]
    assert (units[KEY], units["fluid.viscosity"], units["drag"], units["tip_ux"]) == ("m/s", "Pa s", "N/m", "m")
    assert study.result(2).quantities["drag"] == table["drag"][2]
    assert len(study.plot(KEY, "drag", by="fluid.viscosity").axes[0].get_lines()) == 2
    grid = study.to_xarray()
    assert grid["drag"].sel({KEY: 0.02, "fluid.viscosity": 2e-3}) == 0.04 and grid["drag"].attrs["units"] == "N/m"
    assert {path.suffix for path in study.write_fields([0])} == {".vtu", ".png"}
    assert repr(study).endswith("all 4 points solved and checked")
    for call in (
        lambda: study.result(4),
        lambda: study.result("0"),
        lambda: study.write_fields(0),
        lambda: study.plot(KEY, "drug"),
        lambda: study.plot(KEY, "drag", by=[KEY]),
    ):
        with pytest.raises(InputError):
            call()
    with pytest.raises(InputError, match=r"holds no sweep$"):
        ffsi.Study(tmp_path)


def test_rows_with_equal_values_of_different_keys_are_different_points(tmp_path, freefem):
    sweep(SCENE, [{KEY: 1.0}, {"fluid.viscosity": 1.0}], tmp_path / "s")
    assert len(ffsi.Study(tmp_path / "s").table) == 2 and table_problems(tmp_path / "s") == []


def test_rows_are_no_product(tmp_path, freefem):
    sweep(SCENE, [{KEY: 0.01}, {KEY: 0.02, "output.pictures": False}], tmp_path / "s")
    with pytest.raises(InputError, match="no product"):
        ffsi.Study(tmp_path / "s").to_xarray()


def test_of_a_study_the_last_point_is_drawn_however_many_workers_it_has(tmp_path, freefem):
    scene = with_values(SCENE, {"output.pictures": True})
    for jobs in (1, 2):
        table = sweep(scene, {KEY: [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]}, tmp_path / f"{jobs}", jobs=jobs)
        assert table["folder"].nunique() == jobs
        last = tmp_path / f"{jobs}" / table["folder"].iloc[-1] / f"velocity-{table['point'].iloc[-1]:04d}.png"
        assert list((tmp_path / f"{jobs}").glob("*/velocity-*.png")) == [last]
