"""Sweeps: reading the ranges, planning the chains, resuming."""

import itertools
import json
import tomllib
from pathlib import Path

import pandas as pd
import pytest

from ffsi.cli.vary import parse_all, parse_vary
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result
from ffsi.run import sweep as study
from ffsi.run.sweep import plan, sweep
from ffsi.scene import SceneError, load_scene

pytestmark = pytest.mark.usefixtures("check")
KEY = "inflow.mean_velocity"
SCENE = load_scene("flap-svk", ["mesh.level=0", "output.pictures=false", "output.vtu=false"])


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("k=0.012:0.12:0.012", [0.012, 0.024, 0.036, 0.048, 0.06, 0.072, 0.084, 0.096, 0.108, 0.12]),
        ("k=0.0055:0.055:0.0055", [0.0055, 0.011, 0.0165, 0.022, 0.0275, 0.033, 0.0385, 0.044, 0.0495, 0.055]),
        ("k=0:1:0.4", [0.0, 0.4, 0.8]),
        ("k=1:0:-0.5", [1.0, 0.5, 0.0]),
        ("k=3:3:1", [3]),
        ("k=0:4:2", [0, 2, 4]),
        ("k=1e-9:3e-9:1e-9", [1e-9, 2e-9, 3e-9]),
        ("k=5,1e3,-2.5", [5, 1000.0, -2.5]),
        (" k = 1 , 2 ", [1, 2]),
        ("k=7", [7]),
    ],
)
def test_ranges_and_lists_are_exact(text, values):
    key, found = parse_vary(text)
    assert key == "k"
    assert found == values
    assert [type(value) for value in found] == [type(value) for value in values]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("k", "KEY=START:STOP:STEP"),
        ("k=", "KEY=START:STOP:STEP"),
        ("=1,2", "KEY=START:STOP:STEP"),
        ("k=1:2", "START:STOP:STEP"),
        ("k=1:2:3:4", "START:STOP:STEP"),
        ("k=1:2:0", "does not lead"),
        ("k=1:2:-1", "does not lead"),
        ("k=2:1:1", "does not lead"),
        ("k=1,,2", "'' is no number"),
        ("k=1,two", "'two' is no number"),
        ("k=3 mm", "no number"),
        ("k=1,nan", "not finite"),
        ("k=1:inf:1", "not finite"),
        ("k=1,2,1.0", "occurs twice"),
        ("k=0:1:1e-9", "more than 100000"),
    ],
)
def test_bad_ranges_are_named(text, message):
    with pytest.raises(InputError, match=message):
        parse_vary(text)


def test_a_key_may_come_only_once():
    assert list(parse_all(["a=1,2", "b=3"])) == ["a", "b"]
    with pytest.raises(InputError, match="twice"):
        parse_all(["a=1,2", "a=3"])


def test_the_last_key_that_keeps_the_mesh_runs_along_the_chain():
    chains = plan(SCENE, {"fluid.viscosity": [1e-3, 2e-3], KEY: [0.1, 0.2], "mesh.level": [0, 1]})
    assert len(chains) == 4
    assert [values[KEY] for values in chains[0].points] == [0.1, 0.2]
    assert [(c.points[0]["fluid.viscosity"], c.points[0]["mesh.level"]) for c in chains] == [
        *((1e-3, 0), (1e-3, 1), (2e-3, 0), (2e-3, 1)),
    ]  # fmt: skip
    assert list(chains[0].points[0]) == ["fluid.viscosity", KEY, "mesh.level"]


def test_without_such_a_key_every_point_is_its_own_chain():
    assert [len(chain.points) for chain in plan(SCENE, {"mesh.level": [0, 1, 2]})] == [1, 1, 1]


@pytest.mark.parametrize("vary", [{}, {KEY: []}])
def test_nothing_to_vary(vary):
    with pytest.raises(InputError, match="at least one"):
        plan(SCENE, vary)


@pytest.mark.parametrize("vary", [{"inflow.mean_velocitty": [0.1]}, {"mesh.level": [0, 7]}, {"mesh.level": [0.5]}])
def test_keys_and_values_are_checked_before_anything_is_written(tmp_path, freefem, vary):
    with pytest.raises(SceneError):
        sweep(SCENE, vary, tmp_path / "sweep")
    assert list(tmp_path.iterdir()) == []


def test_the_table_has_one_row_per_point(tmp_path, freefem):
    table = sweep(SCENE, {"fluid.density": [1.0, 2.0], KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep", jobs=2)
    assert table[KEY].tolist() == [0.01, 0.02, 0.03] * 2
    assert table["drag"].tolist() == [0.02, 0.04, 0.06] * 2
    assert table["status"].tolist() == ["converged"] * 6
    assert table["check_maximum"].tolist() == [1e-11] * 6
    assert table["folder"].tolist() == ["chain-001"] * 3 + ["chain-002"] * 3
    written = pd.read_csv(tmp_path / "sweep" / "sweep.csv")
    assert list(written) == list(table)
    assert written["drag"].tolist() == table["drag"].tolist()
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
    assert table["failure"].tolist() == ["", "", "crash", "crash"]
    freefem.die = None
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03, 0.04]}, tmp_path / "sweep")
    assert table["status"].tolist() == ["converged"] * 4
    assert freefem.solved == [0.01, 0.02, 0.03, 0.04]
    assert table["folder"].tolist() == ["chain-001", "chain-001", "chain-002", "chain-002"]


def test_the_rest_goes_through_the_solved_points_if_it_does_not_converge_from_rest(tmp_path, freefem):
    freefem.die = 0.06
    sweep(SCENE, {KEY: [0.02, 0.04, 0.06, 0.08]}, tmp_path / "sweep")
    freefem.die, freefem.needs_neighbour = None, True
    table = sweep(SCENE, {KEY: [0.02, 0.04, 0.06, 0.08]}, tmp_path / "sweep")
    assert table["status"].tolist() == ["converged"] * 4
    assert table["drag"].tolist() == [0.04, 0.08, 0.12, 0.16]
    assert freefem.solved == [0.02, 0.04, 0.02, 0.04, 0.06, 0.08]


def test_points_that_do_not_converge_have_a_row_and_are_not_tried_again(tmp_path, freefem):
    freefem.fail = 0.02
    for _ in range(2):
        table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
        assert table["status"].tolist() == ["converged", "failed", "failed"]
        assert table["reason"].tolist()[1] == "J too small"
        assert table["failure"].tolist() == ["", "not-converged", "not-reached"]
    assert freefem.solved == [0.01]


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
    assert table["status"].tolist() == ["converged"] * 3
    assert table["check_maximum"].tolist() == [1e-11] * 3


def test_the_table_is_on_disk_while_the_sweep_runs(tmp_path, freefem, monkeypatch):
    sizes = []
    monkeypatch.setattr(study._Table, "add", _spy(study._Table.add, lambda: sizes.append(_rows(tmp_path / "s"))))
    sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "s")
    assert sizes == [1, 2, 3]


@pytest.mark.parametrize(
    ("scene", "vary", "message"),
    [
        (SCENE, {KEY: [0.01, 0.03]}, r"vary.inflow.mean_velocity is \[0.01, 0.02\] there and \[0.01, 0.03\] here"),
        (SCENE, {KEY: [0.01, 0.02], "mesh.level": [0]}, "vary.mesh.level is absent there"),
        (load_scene("flap-svk", ["mesh.level=1"]), {KEY: [0.01, 0.02]}, "scene.mesh.level is 0 there and 1 here"),
    ],
)
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
        assert table.write()["drag"].tolist() == [2.5]
        assert table.write()["failure"].tolist() == [""]


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


@pytest.mark.parametrize(
    ("failure", "is_lead_in", "is_done"),
    [
        *(("", True, True), ("check", True, True), ("not-converged", False, True), ("not-reached", False, True)),
        *(("crash", False, False), ("stopped", False, False)),
    ],
)
def test_only_solved_points_lead_to_others(tmp_path, failure, is_lead_in, is_done):
    table = study._Table(tmp_path, [KEY], [{KEY: 0.01}, {KEY: 0.02}])
    table.add(result_of(tmp_path / "chain-001", failure))
    assert table.converged() == ({(0.01,)} if is_lead_in else set())
    assert table.done() == ({(0.01,)} if is_done else set())
    rest = study.remaining(study.Chain(({KEY: 0.01}, {KEY: 0.02})), {(0.01,)}, table.converged())
    assert rest is not None
    assert rest.lead_in == (({KEY: 0.01},) if is_lead_in else ())


def test_a_sweep_is_locked_for_the_whole_call(tmp_path, freefem):
    refused = []

    def again(event):
        with pytest.raises(InputError, match=r"another ffsi is at work in .*sweep; wait for its end") as caught:
            sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
        refused.append(caught)

    table = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep", on_event=again)
    assert len(refused) == 2
    assert freefem.solved == [0.01, 0.02]
    assert table["status"].tolist() == ["converged"] * 2
    sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")


def test_a_failed_point_has_no_quantities_but_what_was_reached(tmp_path, freefem):
    freefem.fail = 0.02
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
    assert table["tip_ux"].notna().tolist() == [True, False, False]
    assert table["reached_tip_ux"].notna().tolist() == [False, True, False]
    assert list(table)[-4:] == ["check_maximum", "seconds", "folder", "point"]
    data = json.loads((tmp_path / "sweep" / "chain-001" / "result-0002.json").read_text())
    assert data["quantities"] == {}
    assert data["reached"]["tip_ux"] == 0.01 * 0.02
    assert data["reached"][KEY] == 0.02


def test_what_failed_the_check_does_not_stand_among_the_quantities(tmp_path, freefem, check):
    check.wrong = 0.02
    table = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
    assert table["checked"].tolist() == [True, False, True]
    assert table["drag"].notna().tolist() == [True, False, True]
    assert table["reached_drag"].tolist()[1] == 0.04


def test_what_nobody_checked_is_checked_by_the_next_call(tmp_path, freefem, check):
    table = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep", check=False)
    assert (table["status"].tolist(), table["checked"].tolist()) == (["converged"] * 2, [False] * 2)
    sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep", check=False)
    assert check.calls == []
    check.wrong = 0.02
    table = sweep(SCENE, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
    assert check.calls == [(0.01, 1), (0.02, 2)]
    assert freefem.solved == [0.01, 0.02]
    assert table["checked"].tolist() == [True, False]
    assert table["failure"].tolist() == ["", "check"]


def _spy(method, after):
    def wrapped(self, result):
        method(self, result)
        after()

    return wrapped


def _rows(path) -> int:
    return len(pd.read_csv(path / "sweep.csv"))
