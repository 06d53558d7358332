"""Studies beyond one process: executors, workers that die, a shared cache."""

from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor

import pandas as pd
import pytest
from test_study import KEY, SCENE

from ffsi.files.errors import InputError
from ffsi.result.table import problems as table_problems
from ffsi.run.cache import Cache
from ffsi.run.sweep import sweep
from ffsi.scene import load_scene, with_values

pytestmark = pytest.mark.usefixtures("check")


@pytest.mark.parametrize("jobs", [None, 3])
def test_an_executor_gives_the_same_table(tmp_path, freefem, jobs):
    vary = {KEY: [0.01, 0.02, 0.03, 0.04, 0.05, 0.06], "mesh.level": [0, 1]}
    freefem.fail = 0.05
    here = sweep(SCENE, vary, tmp_path / "here")
    with ThreadPoolExecutor(2) as pool:
        there = sweep(SCENE, vary, tmp_path / "there", jobs=jobs, executor=pool)
    ran = ["seconds", "folder", "point"]
    pd.testing.assert_frame_equal(here.drop(columns=ran), there.drop(columns=ran))
    assert here["failure"].tolist().count("not-converged") == 2
    solved = len(freefem.solved)
    with ThreadPoolExecutor(2) as pool:
        sweep(SCENE, vary, tmp_path / "there", executor=pool)
    assert len(freefem.solved) == solved


class Breaking(ThreadPoolExecutor):
    """Breaks after the first task, as a pool of processes does when one is killed."""

    def submit(self, *arguments, **named):
        if not hasattr(self, "done"):
            self.done = super().submit(*arguments, **named)
            return self.done
        lost = Future()
        lost.set_exception(BrokenExecutor("a process was killed"))
        return lost


def test_pieces_of_a_pool_that_breaks_run_here(tmp_path, freefem):
    vary = {KEY: [0.01, 0.02, 0.03], "mesh.level": [0, 1, 2]}
    with Breaking(1) as pool:
        table = sweep(SCENE, vary, tmp_path / "sweep", executor=pool)
    assert table["status"].tolist() == ["converged"] * 9 and len(freefem.solved) == 9


class KilledWorker(Exception):
    """As Dask raises it for a piece at which several workers died."""


@pytest.mark.parametrize("error", [BrokenExecutor("broken"), RuntimeError("shut down"), KilledWorker("3 workers")])
def test_pieces_that_no_worker_takes_or_survives_run_here(tmp_path, freefem, error):
    class Refusing(ThreadPoolExecutor):
        def submit(self, *arguments, **named):
            if isinstance(error, RuntimeError):
                raise error
            lost = Future()
            lost.set_exception(error)
            return lost

    with Refusing(1) as pool:
        table = sweep(SCENE, {KEY: [0.01], "mesh.level": [0, 1]}, tmp_path / "sweep", executor=pool)
    assert table["status"].tolist() == ["converged"] * 2


@pytest.mark.parametrize(("arguments", "message"), [
    ({"executor": 3}, "executor = 3: accepted"), ({"dask": 3}, "dask = 3: accepted"),
    ({"executor": 3, "dask": "tcp://x"}, "not both"), ({"jobs": 0}, "jobs = 0"), ({"cache": 3}, "cache = 3"),
])  # fmt: skip
def test_what_cannot_run_a_sweep_is_refused(tmp_path, freefem, arguments, message):
    with pytest.raises(InputError, match=message):
        sweep(SCENE, {KEY: [0.01]}, tmp_path / "s", **arguments)
    assert list(tmp_path.iterdir()) == []


def test_studies_that_share_a_cache_solve_no_point_twice(tmp_path, freefem, check):
    one = sweep(SCENE, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "one", cache=tmp_path / "cache")
    checks = len(check.calls)
    vary = [{KEY: "2 cm/s", "fluid.density": 1.0}, {KEY: 0.04}, {KEY: 0.03}]
    two = sweep(with_values(SCENE, {"fluid.density": 1.0}), vary, tmp_path / "two", cache=tmp_path / "cache")
    expected = [0.01, 0.02, 0.03, *([0.04] if SCENE.fluid.density == 1.0 else [0.02, 0.03, 0.04])]
    assert freefem.solved == expected and two["drag"].tolist() == [0.04, 0.08, 0.06]
    assert two["checked"].all() and len(check.calls) == checks + 3
    assert table_problems(tmp_path / "two") == [] and one["drag"].tolist() == [0.02, 0.04, 0.06]
    again = sweep(SCENE, {KEY: [0.03]}, tmp_path / "three", cache=tmp_path / "cache")
    assert freefem.solved == expected and again["drag"].tolist() == [0.06]


@pytest.mark.parametrize("damage", ["nothing", "missing", "cut", "refused"])
def test_a_damaged_entry_of_the_cache_is_solved_again_and_replaced(tmp_path, freefem, check, monkeypatch, damage):
    cache = tmp_path / "cache"
    sweep(SCENE, {KEY: [0.01]}, tmp_path / "one", cache=cache)
    entry = next(cache.iterdir())
    if damage == "missing":
        (entry / "point-0001.json").unlink()
    elif damage == "cut":
        (entry / "point-0001.json").write_text('{"point"')
    check.wrong = 0.01 if damage == "refused" else None
    copy = Cache.copy

    def copied(self, *arguments):
        try:
            return copy(self, *arguments)
        finally:
            check.wrong = None

    monkeypatch.setattr(Cache, "copy", copied)
    table = sweep(SCENE, {KEY: [0.01]}, tmp_path / "two", cache=cache)
    assert table["status"].tolist() == ["converged"]
    assert len(freefem.solved) == (1 if damage == "nothing" else 2)
    sweep(SCENE, {KEY: [0.01]}, tmp_path / "three", cache=cache)
    assert len(freefem.solved) == (1 if damage == "nothing" else 2)
    assert [path.name for path in (tmp_path / "two").glob("chain-*")] == ["chain-001"]


def test_a_cache_that_cannot_be_made_costs_nothing_else(tmp_path, freefem):
    (tmp_path / "file").write_text("")
    table = sweep(SCENE, {KEY: [0.01]}, tmp_path / "s", cache=tmp_path / "file" / "cache")
    assert table["status"].tolist() == ["converged"]


def test_what_a_study_has_solved_before_it_is_interrupted_is_in_the_cache(tmp_path, freefem):
    def interrupt(event):
        if event.kind == "result" and event.integer("done") == 2:
            raise KeyboardInterrupt

    vary = {"mesh.level": [0, 1], KEY: [0.01]}
    with pytest.raises(KeyboardInterrupt):
        sweep(SCENE, vary, tmp_path / "one", cache=tmp_path / "cache", on_event=interrupt)
    assert len(list((tmp_path / "cache").iterdir())) >= 1


def test_a_cache_tells_when_a_run_stops(tmp_path):
    scene = load_scene("turek-csm3")
    ends = [Cache(tmp_path)._place(with_values(scene, {"time.stop": stop})) for stop in ("end", "periodic")]
    assert ends[0] != ends[1]
