"""A sweep runs, goes on after what interrupts it, and its table and folder are read."""

import itertools
import json
import shutil
import tomllib
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pint
import pytest
from test_cli import call

import ffsi
from ffsi.cli.vary import parse_all, parse_vary, read_points
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result
from ffsi.result.table import problems as table_problems
from ffsi.run import design as designs
from ffsi.run import sweep as study
from ffsi.run.design import columns_of
from ffsi.run.plan import beyond, plan
from ffsi.run.sweep import sweep
from ffsi.scene import SceneError, load_scene, with_values

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


def test_chain_json_tells_the_points_and_a_second_call_runs_nothing_again(tmp_path, freefem):
    vary = {"mesh.level": [0], KEY: [0.01, 0.02]}
    tables = []
    for _ in range(2):
        tables.append(sweep(SCENE, vary, tmp_path / "sweep"))
        assert freefem.solved == [0.01, 0.02]
    pd.testing.assert_frame_equal(*tables, check_dtype=False)
    data = json.loads((tmp_path / "sweep" / "chain-001" / "chain.json").read_text())
    assert data == {"points": [{"mesh.level": 0, KEY: 0.01}, {"mesh.level": 0, KEY: 0.02}]}


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
    # They have no quantities but what was reached.
    assert table["tip_ux"].notna().tolist() == [True, False, True]
    assert table["reached_tip_ux"].notna().tolist() == [False, True, False]
    assert list(table)[-4:] == ["check_maximum", "seconds", "folder", "point"]
    data = json.loads((tmp_path / "sweep" / "chain-001" / "result-0002.json").read_text())
    assert data["quantities"] == {} and data["reached"]["tip_ux"] == 0.01 * 0.02 and data["reached"][KEY] == 0.02


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
    real, sizes = study._Table.add, []

    def add(table, result):
        real(table, result)
        sizes.append(len(pd.read_csv(tmp_path / "s/sweep.csv")))

    monkeypatch.setattr(study._Table, "add", add)
    sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "s")
    assert sizes[0] == 1 and len(pd.read_csv(tmp_path / "s/sweep.csv")) == 3


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
    for wrong in (
        lambda: study.result(4), lambda: study.result("0"), lambda: study.write_fields(0),
        lambda: study.plot(KEY, "drug"), lambda: study.plot(KEY, "drag", by=[KEY]),
    ):  # fmt: skip
        with pytest.raises(InputError):
            wrong()
    with pytest.raises(InputError, match=r"holds no sweep$"):
        ffsi.Study(tmp_path)


def test_rows_with_equal_values_of_different_keys_are_different_points_and_no_product(tmp_path, freefem):
    sweep(SCENE, [{KEY: 1.0}, {"fluid.viscosity": 1.0}], tmp_path / "s")
    assert len(ffsi.Study(tmp_path / "s").table) == 2 and table_problems(tmp_path / "s") == []
    with pytest.raises(InputError, match="no product"):
        ffsi.Study(tmp_path / "s").to_xarray()


def test_of_a_study_the_last_point_is_drawn_however_many_workers_it_has(tmp_path, freefem):
    scene = with_values(SCENE, {"output.pictures": True})
    for jobs in (1, 2):
        table = sweep(scene, {KEY: [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]}, tmp_path / f"{jobs}", jobs=jobs)
        assert table["folder"].nunique() == jobs
        last = tmp_path / f"{jobs}" / table["folder"].iloc[-1] / f"velocity-{table['point'].iloc[-1]:04d}.png"
        assert list((tmp_path / f"{jobs}").glob("*/velocity-*.png")) == [last]


@pytest.mark.parametrize(("text", "values"), [
    ("k=0.012:0.12:0.012", [0.012, 0.024, 0.036, 0.048, 0.06, 0.072, 0.084, 0.096, 0.108, 0.12]),
    ("k=0.0055:0.055:0.0055", [0.0055, 0.011, 0.0165, 0.022, 0.0275, 0.033, 0.0385, 0.044, 0.0495, 0.055]),
    ("k=0:1:0.4", [0.0, 0.4, 0.8]), ("k=1:0:-0.5", [1.0, 0.5, 0.0]), ("k=3:3:1", [3]), ("k=0:4:2", [0, 2, 4]),
    ("k=1e-9:3e-9:1e-9", [1e-9, 2e-9, 3e-9]), ("k=5,1e3,-2.5", [5, 1000.0, -2.5]), (" k = 1 , 2 ", [1, 2]),
    ("k=0, 3 cm/s", [0, "3 cm/s"]), ("k=7", [7]), ("k=4 Pa, 6e1 kPa", ["4 Pa", "6e1 kPa"]),
    ("k=0.1:0.3:0.1 m/s", ["0.1 m/s", "0.2 m/s", "0.3 m/s"]),
    ('k=parabolic,"uniform",true', ["parabolic", "uniform", True]), ("k=a:b", ["a:b"]),
])  # fmt: skip
def test_ranges_and_lists_are_exact(text, values):
    key, found = parse_vary(text)
    assert key == "k"
    assert found == values and [type(value) for value in found] == [type(value) for value in values]


def test_a_range_of_samples():
    assert parse_vary("k=0.1:0.3", sampled=True) == ("k", [0.1, 0.3])
    assert parse_vary("k=2 cm/s:4 cm/s", sampled=True) == ("k", ["2 cm/s", "4 cm/s"])


@pytest.mark.parametrize(("text", "message"), [
    ("k=1:2", "START:STOP:STEP"), ("k", "KEY=START:STOP:STEP"), ("k=", "KEY=START:STOP:STEP"),
    ("=1,2", "KEY=START:STOP:STEP"), ("k=1:2:3:4", "START:STOP:STEP"), ("k=1:2:0", "does not lead"),
    ("k=1:2:-1", "does not lead"), ("k=2:1:1", "does not lead"), ("k=1,,2", "a value is empty"),
    ("k=1:two:3", "'two' is no number"), ("k=1 mm:3 m:1 m", "one unit, at the end"),
    ("k=1 mm:3:1", "one unit, at the end"), ("k=2, 3 cm/s", "each value its unit"),
    ("k=2 cm/s, 3", "each value its unit"), ("k=1,nan", "not finite"), ("k=1:inf:1", "not finite"),
    ("k=0:1:1e-9", "more than 100000"),
])  # fmt: skip
def test_bad_ranges_are_named(text, message):
    with pytest.raises(InputError, match=message):
        parse_vary(text)


def test_keys_rows_and_chains():
    assert list(parse_all(["a=1,2", "b=3"])) == ["a", "b"]
    with pytest.raises(InputError, match="twice"):
        parse_all(["a=1,2", "a=3"])
    mooney = {"solid.flap.material": "mooney-rivlin", "solid.flap.c10": "1 Pa", "solid.flap.c01": 0.5,
              "solid.flap.bulk_modulus": 20}  # fmt: skip
    rows = [{KEY: 0.02}, {KEY: "4 cm/s", **mooney}, {KEY: 0.02}]
    for vary in (rows, pd.DataFrame(rows)):
        definition, points = columns_of(SCENE, vary)
        assert points == [{KEY: 0.02}, {KEY: 0.04, **mooney, "solid.flap.c10": 1.0, "solid.flap.bulk_modulus": 20.0}]
        assert definition["vary"]["solid.flap.c01"] == ["", 0.5]
    assert [len(piece) for piece in plan(SCENE, points)] == [1, 1]
    assert columns_of(SCENE, [{f" {KEY} ": 0.02, "mesh.level": 1}])[1] == [{KEY: 0.02, "mesh.level": 1}]
    with pytest.raises(SceneError, match=r"mesh\.level = 9.*point 3"):
        columns_of(SCENE, [{"mesh.level": 1}, {"mesh.level": 1}, {"mesh.level": 9}])
    found = pieces({"fluid.viscosity": [1e-3, 2e-3], KEY: [0.3, 0.1, 0.2], "mesh.level": [0, 1]})
    assert [{values["mesh.level"] for values in piece} for piece in found] == [{0}, {1}]
    assert [(values["fluid.viscosity"], values[KEY]) for values in found[0]] == [
        *((1e-3, 0.1), (1e-3, 0.2), (1e-3, 0.3), (2e-3, 0.3), (2e-3, 0.2), (2e-3, 0.1)),
    ]  # fmt: skip
    assert list(found[0][0]) == ["fluid.viscosity", KEY, "mesh.level"]
    values = [round(0.01 * i, 2) for i in range(1, 21)]
    assert [[p[KEY] for p in piece] for piece in pieces({KEY: values}, 2)] == [values[:10], values[10:]]
    assert [len(piece) for piece in pieces({KEY: values[:5]}, 4)] == [5]
    assert [len(piece) for piece in pieces({KEY: values, "mesh.level": [0, 1]}, 4)] == [10, 10, 10, 10]
    assert [len(piece) for piece in pieces({"mesh.level": [0, 1, 2]})] == [1, 1, 1]
    assert [len(piece) for piece in pieces({"inflow.profile": ["parabolic", "uniform"], KEY: [0.1, 0.2]})] == [2, 2]
    in_time = load_scene("turek-csm3", [])
    assert [len(piece) for piece in pieces({"solid.beam.density": [800, 1000]}, 1, in_time)] == [1, 1]


def pieces(vary, workers=1, scene=SCENE, **design):
    return plan(scene, columns_of(scene, vary, **design)[1], workers)


def points_with(values, key=KEY):
    return [point[key] for point in columns_of(SCENE, {key: values})[1]]


@pytest.mark.parametrize(
    "values",
    [
        np.linspace(0.02, 0.04, 2), np.array([0.02, 0.04], dtype=np.float32), pd.Series([0.02, 0.04]), (0.02, 0.04),
        [Decimal("0.02"), Decimal("0.04")], ["2 cm/s", "0.04 m/s"], pint.UnitRegistry().Quantity([2, 4], "cm/s"),
        [np.float64(0.02), "40 mm/s"], [0.02, 0.04, 0.04, "2 cm/s"],
        [pint.UnitRegistry().Quantity(2, "cm/s"), pint.UnitRegistry().Quantity(0.04, "m/s")],
    ],
)  # fmt: skip
def test_values_of_any_type_are_numbers_in_si(values):
    found = points_with(values)
    assert found == [0.02, 0.04] and all(type(value) is float for value in found)


@pytest.mark.parametrize(("key", "values", "found"), [
    ("mesh.level", np.array([0, 1], dtype=np.int64), [0, 1]),
    ("mesh.level", [1.0, "1"], None),
    ("mesh.level", [1.0], [1]),
    (KEY, np.arange(1, 3), [1.0, 2.0]),
    ("output.vtu", np.array([True, False]), [True, False]),
    ("inflow.profile", np.array(["parabolic", "uniform"]), ["parabolic", "uniform"]),
    ("mesh_motion.kind", pd.Series(["harmonic"], dtype="string"), ["harmonic"]),
    ("inflow.peak_velocity", ["3 cm/s"], [0.03]),
    ("solid.flap.density", ["1 g/cm^3", pint.UnitRegistry().Quantity(1, "g/cm^3"), 1000], [1000.0]),
    ("mesh.level", [1, True], None),  # equal for Python
    ("output.vtu", [True, 1], None),
])  # fmt: skip
def test_values_are_what_the_scene_makes_of_them(key, values, found):
    if found is None:
        with pytest.raises(SceneError, match=key):
            points_with(values, key)
    else:
        assert points_with(values, key) == found
        assert [type(value) for value in points_with(values, key)] == [type(value) for value in found]


def test_designs():
    assert columns_of(SCENE, {KEY: [0.1, 0.2], "mesh.level": [0, 1]}, "zip")[1] == [
        {KEY: 0.1, "mesh.level": 0}, {KEY: 0.2, "mesh.level": 1},
    ]  # fmt: skip
    ranges = {KEY: ("2 cm/s", 0.06), "fluid.viscosity": np.array([1e-3, 2e-3])}
    for design in ("latin-hypercube", "sobol"):
        points = columns_of(SCENE, ranges, design, 8, 3)[1]
        assert points == columns_of(SCENE, ranges, design, 8, 3)[1]
        assert points != columns_of(SCENE, ranges, design, 8)[1]
        cells = sorted(int((point[KEY] - 0.02) / 0.04 * 8) for point in points)
        assert cells == list(range(8))  # one in each eighth of the range


@pytest.mark.parametrize(("vary", "design", "message"), [
    ({KEY: [0.1]}, {"design": "produkt"}, 'did you mean "product"'),
    ({KEY: [0.1, 0.2], "mesh.level": [0]}, {"design": "zip"}, f"{KEY} 2, mesh.level 1"),
    ([{KEY: 0.1}], {"design": "zip"}, "a mapping of keys, not list"),
    ({KEY: [0.1]}, {"samples": 3}, "samples and seed belong"),
    ({KEY: [0.1, 0.2, 0.3]}, {"design": "sobol", "samples": 3}, r"a range \(low, high\)"),
    ({KEY: (0.2, 0.1)}, {"design": "sobol", "samples": 3}, "low < high"),
    ({KEY: (0.1, 0.2)}, {"design": "sobol"}, "samples = None"),
    ({KEY: (0.1, 0.2)}, {"design": "sobol", "samples": 3, "seed": -1}, "seed = -1"),
    ({KEY: [None]}, {}, "a value is missing"),
    ({KEY: np.ma.array([0.1, 0.2], mask=[False, True])}, {}, "a value is missing"),
    ({KEY: {"1 cm/s", "2 cm/s"}}, {}, "a list of numbers"),  # without an order
    ({KEY: [0.1], f"{KEY} ": [0.2]}, {}, "comes twice"),
    (pd.DataFrame([[0.1, 0.2]], columns=[KEY, KEY]), {}, "comes twice"),
    ({KEY: "0.1"}, {}, "a list of numbers"),
    ({KEY: 0.1}, {}, "a list of numbers"),
    ({KEY: [[0.1]]}, {}, "a number, a text or a truth value"),
    ({KEY: [pint.UnitRegistry().Quantity([1, 2], "cm/s")]}, {}, "a number, a text or a truth value"),
    ({KEY: [Decimal("sNaN")]}, {}, "a finite number"),
    (pd.DataFrame({KEY: [0.1], "fluid.viscosty": [None]}), {}, "fluid.viscosty: no point has a value of it"),
    ({"time.end": [1.0, 2.0]}, {}, "time.end: the scene is steady"),
    ({(KEY, "mesh.level"): [(0.1, 1)]}, {}, "dotted keys"),
    ("0.1", {}, "a DataFrame or a list of mappings"),
    *((nothing, {}, "at least one|sets no key") for nothing in ({}, {KEY: []}, [], [{}], pd.DataFrame({KEY: []}))),
    ({KEY: np.linspace(1, 2, 1000), "fluid.viscosity": np.linspace(1, 2, 1000)}, {}, "1000 x 1000 = 1000000"),
])  # fmt: skip
def test_what_is_no_design_is_refused(vary, design, message):
    with pytest.raises(InputError, match=message):
        columns_of(SCENE, vary, **design)


def test_all_that_the_scene_refuses_is_told_at_once_with_the_point():
    with pytest.raises(SceneError) as caught:
        columns_of(SCENE, {KEY: [0.1, -1], "mesh.level": [0, 7], "fluid.viscosity": ["1 Pa s", "1 m"]})
    text = str(caught.value)
    assert len(caught.value.problems) == 3
    assert f"{KEY} = -1" in text and "mesh.level = 7" in text and 'fluid.viscosity = "1 m"' in text
    assert "(point 2)" in text and "(point 3)" in text and "(point 5)" in text


def test_of_very_many_points_corners_are_checked(monkeypatch):
    monkeypatch.setattr(designs, "_ALL_CHECKED", 50)
    checked = []
    monkeypatch.setattr(designs, "with_values", lambda *given: checked.append(with_values(*given)))
    vary = {KEY: np.linspace(0.01, 0.1, 10), "geometry.flap_height": np.linspace(0.1, 0.2, 10)}
    assert len(columns_of(SCENE, vary)[1]) == 100 and len(checked) == 4
    with pytest.raises(SceneError, match=r"geometry\.flap_height"):
        columns_of(SCENE, vary | {"geometry.flap_height": np.linspace(0.1, 2.0, 10)})


@pytest.mark.parametrize(("values", "is_beyond"), [
    ({"a": 3.0, "b": 1.0}, True), ({"a": 1.5, "b": 1.0}, False), ({"a": 0.5, "b": 1.0}, False),
    ({"a": 3.0, "b": 2.0}, False), ({"a": 3.0}, False),
])  # fmt: skip
def test_beyond_a_failed_point_is_what_lies_on_one_line(values, is_beyond):
    assert beyond(values, {"a": 2.0, "b": 1.0}, {"a": 1.0, "b": 1.0}) == is_beyond
    assert not beyond(values, {"a": 2.0, "b": 2.0}, {"a": 1.0, "b": 1.0})


def test_a_wall_at_rest_has_a_script_of_its_own():
    wall = {"walls.cylinder.centre_x": 0.2, "walls.cylinder.centre_y": 0.2, "walls.cylinder.rotation": 1}
    points = [{"walls.cylinder.rotation": turn} for turn in (1.0, 0.0, 2.0, -1.0)]
    pieces = plan(with_values(load_scene("cylinder-2d1"), wall), points)
    assert [len(piece) for piece in pieces] == [3, 1] and pieces[1] == [points[1]]


STUDY = """
scene = "flap-svk"
set = {mesh.level = 0, output = {pictures = false, vtu = false}}
design = "zip"
[vary]
inflow.mean_velocity = ["1 cm/s", 0.02]
"fluid.viscosity" = [1e-3, 2e-3]
"""


def test_a_study_s_file_and_a_file_of_points_say_the_same_as_python(tmp_path, freefem, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(STUDY)
    Path("points.csv").write_text("inflow.mean_velocity, fluid.viscosity\n1 cm/s,1e-3\n0.02,2e-3\n")
    level = ["--set", "mesh.level=0", "--set", "output.pictures=false", "--set", "output.vtu=false"]
    for words in (["study.toml", "--out", "a"], ["flap-svk", *level, "--points", "points.csv", "--out", "b"]):
        code, _, printed = call(capsys, "sweep", *words)
        assert code == 0
    sweep(SCENE, {KEY: [0.01, 0.02], "fluid.viscosity": [1e-3, 2e-3]}, "c", "zip")
    texts = {Path(name, "sweep.toml").read_text() for name in "abc"}
    assert len(texts) == 1
    assert "1/2 inflow.mean_velocity = 0.01, fluid.viscosity = 0.001: converged" in printed


def test_a_setting_of_the_call_wins_over_the_study_s_and_json_has_all_digits(tmp_path, freefem, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(STUDY.replace('"zip"', '"product"').replace('["1 cm/s", 0.02]', '"1:2:1 cm/s"'))
    code, out, _ = call(capsys, "sweep", "study.toml", "--set", "mesh.level=1", "--out", "a", "--json")
    rows = json.loads(out)
    assert code == 0 and [row[KEY] for row in rows] == [0.01, 0.01, 0.02, 0.02]
    assert [row["check_maximum"] for row in rows] == [1e-11] * 4
    assert tomllib.loads(Path("a/sweep.toml").read_text())["scene"]["mesh"]["level"] == 1


@pytest.mark.parametrize(("text", "message"), [
    ("a,b\n0,02,1\n", "line 2 has 3 cells under 2 keys"), ("a, a\n1,2\n", "a comes twice"), ("a\n", "holds no points"),
    ("a,\n1,\n", "a cell without a key"), ("a\nnan\n", "not finite"), ('a,b\n"x, y",True\n 2 ,\n', None),
])  # fmt: skip
def test_a_file_of_points(tmp_path, text, message):
    path = tmp_path / "points.csv"
    path.write_text(text)
    if message is None:
        assert [column[0] for column in read_points(path).to_dict("list").values()] == ["x, y", True]
    else:
        with pytest.raises(InputError, match=message):
            read_points(path)


@pytest.mark.parametrize(("text", "message"), [
    (STUDY.replace("design", "desing"), 'mean "design"'), (STUDY.replace("[vary]", "[vray]"), 'mean "vary"'),
    (STUDY.replace('scene = "flap-svk"', ""), "scene is missing"),
    (STUDY.replace('"zip"', "3"), "design = 3: accepted: a text"),
    (STUDY.replace("[vary]", "[[vary]]"), "accepted: a table"), (STUDY.replace("0.02", "-1"), "mean_velocity = -1"),
    (STUDY.replace("flap-svk", "flap-svq"), 'did you mean "flap-svk"'),
    ('points = "p.csv"' + STUDY, "either vary or points"), (STUDY + '"inflow.mean_velocity" = [1]\n', "comes twice"),
])  # fmt: skip
def test_what_is_no_study_is_refused(tmp_path, freefem, monkeypatch, capsys, text, message):
    monkeypatch.chdir(tmp_path)
    Path("study.toml").write_text(text)
    code, _, err = call(capsys, "sweep", "study.toml", "--out", "a")
    assert code == 2 and message in err and not Path("a").exists()
