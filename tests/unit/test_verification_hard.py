"""`python -m studies verify --hard`: the entries as data, their runs, the verdicts on them, what is written."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pandas as pd
import pytest

from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMNotFound
from ffsi.scene import Scene, SceneError
from studies.verification import hard

TITLES, ENTRIES = hard.load()
NEAR = hard.Expectation("drag", value=2.0, within=0.01)


@pytest.mark.parametrize("name", ENTRIES)
def test_every_scene_is_valid_or_its_refusal_is_expected(name):
    entry = ENTRIES[name]
    assert entry.what and entry.why
    try:
        assert isinstance(entry.scene(), Scene)
    except SceneError:
        assert entry.outcome in ("fails", "either")


def test_most_entries_claim_something():
    assert len(ENTRIES) > 180 and sum(entry.outcome == "open" for entry in ENTRIES.values()) < 5
    assert sum(bool(entry.expect) for entry in ENTRIES.values()) > 0.6 * len(ENTRIES)


@pytest.mark.parametrize("values", [
    {"of": "drag"}, {"of": "drag", "value": 1.0}, {"of": "drag", "within": 0.1}, {"of": "Drag", "above": 0.0},
    {"of": "least drag", "above": 0.0},
])  # fmt: skip
def test_an_expectation_that_holds_of_everything_is_refused(values):
    with pytest.raises(ValueError, match=values["of"]):
        hard.Expectation(**values)


@pytest.mark.parametrize("values", [{"outcome": "fails"}, {"outcome": "solves", "reason": "x"}, {"outcome": "never"}])
def test_an_entry_that_contradicts_itself_is_refused(values):
    with pytest.raises(ValueError, match="a-b: outcome"):
        hard.Entry("a-b", "", "cook", **values)


def test_entries_are_chosen_with_those_that_they_compare_with():
    names = {entry.id for entry in hard.select(ENTRIES, "k-rho-tiny,i-maxit-1")}
    assert names == {"k-rho-tiny", "k-creep", "k-creep-slow", "i-maxit-1"}
    assert len(hard.select(ENTRIES)) == len(ENTRIES)
    with pytest.raises(InputError, match="no hard case matches 'k-none'"):
        hard.select(ENTRIES, "k-rho*,k-none")


def outcome(failure: str = "", said: str = "", rows: tuple[dict[str, float], ...] = ({"drag": 2.01},), **entry: object):
    given = {"expect": (NEAR,), **entry}
    return hard.Outcome(hard.Entry("a-b", "", "cook", **given), hard.Path("nowhere"), failure, said, (), rows)


EITHER = {"outcome": "either", "reason": "folds"}
SWEEP = {"vary": {"mesh.level": (0, 1)}}


@pytest.mark.parametrize(("given", "word"), [
    (outcome(), hard.SOLVED),
    (outcome(rows=({"drag": 2.03},)), hard.WRONG),
    (outcome(rows=({"drag": math.nan},)), hard.WRONG),
    (outcome(rows=({},)), hard.WRONG),
    (outcome(rows=({"drag": 2.03, "iterations": 9.0},), expect=(hard.Expectation("iterations", below=9),)),
     hard.FAILED),
    (outcome("not-converged"), hard.FAILED),
    (outcome("check", "the reference check disagrees"), hard.FAILED),
    (outcome("error", "TypeError: folds", **EITHER), hard.FAILED),
    (outcome("error", "TypeError", outcome="open"), hard.FAILED),
    (outcome(**EITHER), hard.SOLVED),
    (outcome(rows=({"drag": 3.0},), **EITHER), hard.WRONG),
    (outcome("not-converged", "the mesh folds", **EITHER), hard.REFUSED),
    (outcome("not-converged", "a limit point", **EITHER), hard.CAUSE),
    (outcome("crash", "time limit; last progress: folds", **EITHER), hard.FAILED),
    (outcome("refused", "mesh.level: folds", outcome="fails", reason="folds"), hard.REFUSED),
    (outcome(outcome="fails", reason="folds", expect=()), hard.WRONG),
    (outcome("not-converged", "folds: J = 1", unlike="J = 1", **EITHER), hard.CAUSE),
    (outcome(outcome="open"), hard.NO_CLAIM),
    (outcome("crash", outcome="open"), hard.NO_CLAIM),
    (outcome(warns="time.step"), hard.CAUSE),
    (outcome("not-converged", "x", **SWEEP), hard.FAILED),
    (outcome("not-converged", "x", rows=(), **SWEEP), hard.FAILED),
    (outcome("not-converged", "folds", rows=({"drag": 3.0},), **SWEEP, **EITHER), hard.WRONG),
])  # fmt: skip
def test_verdicts(given, word):
    assert hard.judge(given, {}).word == word


def test_warnings_and_points_that_are_not_solved():
    assert hard.judge(replace(outcome(warns="time.step"), warnings=("time.step is too large",)), {}).word == hard.SOLVED
    rows = ({"drag": 2.0}, {}, {"drag": 2.0})
    sweep = outcome("check", "x", rows=rows, expect=(hard.Expectation("drag#1", value=2.0, within=0.1),), **SWEEP)
    assert hard.judge(sweep, {}).word == hard.FAILED and hard.judge(replace(sweep, failure=""), {}).word == hard.WRONG
    assert hard.judge(replace(outcome("not-converged", "x", **EITHER), warnings=("it folds",)), {}).word == hard.REFUSED


def compared(own: float, other: float, failure: str = "", **expectation: object) -> str:
    entry = hard.Entry("a-b", "", "cook", expect=(hard.Expectation("drag", per="a-c", **expectation),))
    beside = hard.Outcome(hard.Entry("a-c", "", "cook"), hard.Path("nowhere"), failure, rows=({"drag": other},))
    return hard.judge(hard.Outcome(entry, hard.Path("nowhere"), "", rows=({"drag": own},)), {"a-c": beside}).word


@pytest.mark.parametrize(("numbers", "expectation", "word"), [
    ((2.0, 1.0), {"within": 0.1, "times": 2.0}, hard.SOLVED), ((2.0, 1.0), {"within": 0.1}, hard.WRONG),
    ((2.0, 1.0), {"value": 2.1, "within": 0.1}, hard.SOLVED), ((2.0, 1.0), {"above": 1.9, "below": 2.1}, hard.SOLVED),
    ((2.0, 1.0), {"below": 2.0}, hard.WRONG), ((2.0, 0.0), {"above": 1.0}, hard.WRONG),
    ((2.0, math.nan), {"above": 1.0}, hard.WRONG),
])  # fmt: skip
def test_numbers_beside_those_of_another_entry(numbers, expectation, word):
    assert compared(*numbers, **expectation) == word


def test_without_the_other_entry_nothing_is_claimed():
    assert compared(2.0, 1.0, "not-converged", within=0.1) == hard.NO_CLAIM


def with_history(name: str, times: list[float], values: list[float]) -> hard.Outcome:
    found = hard.Outcome(hard.Entry(name, "", "cook"), hard.Path("nowhere"), "", rows=({},))
    found.__dict__["history"] = pd.DataFrame({"time": times, "drag": values})
    return found


@pytest.mark.parametrize(("expectation", "x"), [
    (hard.Expectation("drag@0.25", above=0.0), 0.5), (hard.Expectation("max drag", above=0.0), 3.0),
    (hard.Expectation("max drag", per="a-c", above=0.0), 1.5),
    (hard.Expectation("path drag", per="a-c", above=0.0), 0.5),
])  # fmt: skip
def test_numbers_of_a_history(expectation, x):
    own = with_history("a-b", [0.0, 0.5, 1.0], [0.0, 1.0, -3.0])
    other = with_history("a-c", [0.0, 1.0], [0.0, -2.0])
    own = replace(own, entry=replace(own.entry, expect=(expectation,)))
    own.__dict__["history"] = with_history("a-b", [0.0, 0.5, 1.0], [0.0, 1.0, -3.0]).history
    shown = hard.judge(own, {"a-c": other}).shown[0]
    assert f"= {1.0 if x == 0.5 and expectation.per else x:g} (" in shown


@pytest.mark.parametrize(("of", "x"), [
    ("drag", 5.0), ("drag#0", 4.0), ("drag#2", 2.0), ("rise drag", -2.0), ("points", 3.0), ("size lift", 1.0),
])  # fmt: skip
def test_numbers_of_a_sweep(of, x):
    rows = ({"drag": 4.0}, {}, {"drag": 2.0}, {"drag": 5.0, "lift": -1.0}, {})
    assert hard.judge(outcome(rows=rows, expect=(hard.Expectation(of, value=x, within=1e-9),)), {}).word == hard.SOLVED


@pytest.fixture
def runs(monkeypatch):
    calls: list[str] = []

    data = {"failure": "", "check": {"momentum": 0.0}, "quantities": {"drag": 2.0, "lift": math.inf}}
    done = SimpleNamespace(data=data, has_mumps=True)

    def run_one(name, scene, directory, on_event):
        calls.append(name)
        if done.data is None:
            raise TypeError("a fault")
        return done

    monkeypatch.setattr(hard, "run_one", run_one)
    monkeypatch.setattr(hard, "render", lambda scene, mumps: scene.name)
    monkeypatch.setattr(hard, "find_freefem", lambda: done)
    return calls, done


def test_nothing_runs_twice_but_what_has_changed(runs, tmp_path):
    calls, _ = runs
    entry = hard.Entry("a-b", "", "cook")
    first = hard.run_all([entry], tmp_path)
    assert hard.run_all([replace(entry, what="other words", expect=(NEAR,))], tmp_path)["a-b"].rows == first["a-b"].rows
    assert (calls, first["a-b"].value("drag")) == (["a-b"], 2.0) and math.isnan(first["a-b"].value("lift"))
    hard.run_all([replace(entry, set={"mesh.level": 1})], tmp_path)
    assert calls == ["a-b", "a-b"]


def test_a_fault_of_the_program_is_no_result_and_runs_again(runs, tmp_path, monkeypatch):
    calls, done = runs
    monkeypatch.setattr(done, "data", None)
    found = hard.run_all([ENTRIES["a-fsi3-1"]] * 1, tmp_path)["a-fsi3-1"]
    assert found.failure == hard.ERROR and "TypeError: a fault (test_verification_hard.py" in found.reason
    hard.run_all([ENTRIES["a-fsi3-1"]], tmp_path)
    assert len(calls) == 2


def test_what_was_killed_runs_again_and_unchecked_is_not_solved(runs, tmp_path, monkeypatch):
    (calls, done), whole = runs, runs[1].data
    killed = {"failure": "crash", "reason": "FreeFEM died (killed): from outside"}
    monkeypatch.setattr(done, "data", killed)
    assert hard.run(hard.Entry("a-b", "", "cook"), tmp_path).failure == "crash"
    monkeypatch.setattr(done, "data", killed | {"reason": "FreeFEM died (time-limit): 1 s"})
    for _ in range(2):
        assert "time-limit" in hard.run(hard.Entry("a-b", "", "cook"), tmp_path).reason
    assert len(calls) == 2
    monkeypatch.setattr(done, "data", {**whole, "checked": False})
    assert hard.run(hard.Entry("a-b", "", "cook"), tmp_path / "other").failure == hard.ERROR


def test_a_scene_that_is_refused_does_not_run(runs, tmp_path):
    found = hard.run(hard.Entry("a-b", "", "cook", set={"mesh.levle": 1}), tmp_path)
    assert found.failure == hard.INVALID and "mesh.levle" in found.reason
    assert runs[0] == []


def test_without_freefem_nothing_runs(tmp_path, monkeypatch):
    monkeypatch.setenv("FFSI_FREEFEM", "/nonexistent")
    with pytest.raises(FreeFEMNotFound):
        hard.run_all([], tmp_path)


def test_tables_and_failures(runs, tmp_path, monkeypatch):
    good = replace(outcome(), entry=replace(outcome().entry, id="k-good"))
    wrong = outcome(rows=({"drag": 3.0, "min_jacobian": 0.5},))
    lost = replace(outcome("not-converged", "a | b"), entry=replace(wrong.entry, id="a-lost"))
    monkeypatch.setattr(hard, "run_all", lambda entries, runs, jobs: {x.entry.id: x for x in (good, wrong, lost)})
    assert hard.main(out=tmp_path) == ["", "check", "not-converged"]
    text = (tmp_path / "hard.md").read_text()
    assert "| all | 3 | 1 |  | 1 | 1 |  |  |" in text
    assert "| a-b | wrong | drag = 3 (2 ± 1 %) |" in text and "a \\| b" in text and text.count("| k-good |") == 1
    table = pd.read_csv(tmp_path / "hard.csv").set_index("id")
    assert table["verdict"].to_dict() == {"k-good": hard.SOLVED, "a-b": hard.WRONG, "a-lost": hard.FAILED}
    assert table.loc["a-b", "min_jacobian"] == 0.5
