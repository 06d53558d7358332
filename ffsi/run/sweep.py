"""Many points of one scene: run what is missing, in parallel, here or elsewhere; one table."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.files import folder
from ffsi.files.arguments import count_of, path_of
from ffsi.files.errors import InputError
from ffsi.freefem import Event, find_freefem, stop_all
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result
from ffsi.result import in_time, study_definition
from ffsi.result.study_definition import Values
from ffsi.result.table import TABLE, UNITS, frame, place
from ffsi.run import remote
from ffsi.run.cache import Cache
from ffsi.run.design import columns_of
from ffsi.run.harvest import chains_of, harvest, points_of
from ffsi.run.pieces import Stop, run_piece
from ffsi.run.plan import Piece, beyond, formulations, in_order, nearest, plan, run_time_keys
from ffsi.scene import Scene, scene_of

logger = logging.getLogger(__name__)

_SHARE = 0.05
"""Largest part of the wall time that writing the table may cost while points are still running."""


def sweep(
    scene: Scene | str | Path,
    vary: Any,
    out: str | Path,
    design: str = "product",
    samples: int | None = None,
    seed: int | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    dask: Any = None,
    *,
    cache: str | Path | None = None,
    check: bool = True,
    on_event: OnEvent | None = None,
    error: bool = False,
    sensitivities: bool = False,
) -> pd.DataFrame:
    """Solve `scene` at many points, and keep `out/sweep.csv` up to date while they finish.

    A second call with the same points runs only what is missing or died; points that did not converge are not tried
    again. Points of a scene in time go on from their last checkpoints. A point that fails costs no other one.

    Args:
        scene: what to solve: a scene, the name of a case, or the path of a TOML file.
        vary: values by dotted key: numbers in SI, texts with a unit, names, truth values, of Python, numpy, pandas or
            pint. Or the points themselves: a DataFrame or a list of mappings.
        out: the sweep's folder.
        design: `product` of the values, `zip` (the first of each, the second ...), or samples of ranges (low, high):
            `latin-hypercube`, `sobol`.
        samples: points of a sample.
        seed: of a sample; without one 0.
        jobs: pieces at a time: FreeFEM processes on this machine (1), or workers of `executor` or `dask` (all).
        executor: where the pieces run instead: any `concurrent.futures.Executor`. What goes there and comes back goes
            through it; no disk needs to be shared.
        dask: a `distributed.Client` or the address of a scheduler (extra `dask`), likewise.
        cache: a folder in which points are kept by their content, and looked up; studies may share it.
        check: verify every point with the independent checker.
        on_event: called with every event of the scripts, and with `result` events of the study: `points`, `done`,
            `failed`, `running`, and in words the last point.
        error: of steady scenes: error bars (`solve`) in the columns `..._error`. Points that are there already stay.
        sensitivities: likewise derivatives by the varied keys (`solve`), in SI, in columns such as
            `drag_by_fluid.viscosity`.

    Returns:
        One row per point in their order: the varied keys in SI, `status`, `checked`, `reason`, `failure`, `warnings`,
        every quantity (of a point that failed none, but `reached_...`; in time the mean, amplitude and frequency
        where periodic, and `_last`, `_min`, `_max`), `check_maximum`, `seconds`, `folder` and `point`. `attrs["units"]`
        has the columns' units, so has `out/sweep.units.csv`.

    Raises:
        InputError: `out` holds something else, or a sweep with other points; or an argument is not accepted.
        SceneError: keys or values that the scene does not accept, all of them.
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    directory = path_of(out, "out").absolute()
    scene = scene_of(scene)
    asked = [name for name, wanted in (("sensitivities", sensitivities), ("error", error)) if wanted]
    if asked and scene.time is not None:
        raise InputError(f"{asked[0]}: {scene.name} is a scene in time; accepted: steady ones")
    varied, points = columns_of(scene, vary, design, samples, seed)
    pool = remote.executor_of(executor, dask)
    kept = Cache(cache) if cache is not None else None
    workers = count_of(jobs, "jobs") if jobs is not None else 1 if pool is None else remote.workers_of(pool)
    defined = study_definition.define(scene, varied)
    if pool is None:
        find_freefem()
    with folder.held(directory, lambda path: study_definition.check(path, defined)):
        if not folder.is_sweep_folder(directory):
            study_definition.write(directory, defined)
        table = _Table(directory, list(varied["vary"]), points)
        for chain in chains_of(directory):
            for result in harvest(scene, chain, table.keys, check=check):
                table.add(result)
        table.on_event = on_event
        study = _Study(scene, directory, table, workers, pool, kept, check, asked)
        study.run(on_event)
        return table.write()


class _Table:
    """The results that are known so far; `sweep.csv` follows them."""

    def __init__(self, directory: Path, keys: Sequence[str], order: Sequence[Values]) -> None:
        self.directory, self.keys, self.order = directory, list(keys), order
        self.on_event: OnEvent | None = None
        self.results: dict[tuple[Any, ...], Result] = {}
        self.led: set[tuple[Any, ...]] = set()
        self.running = 0
        self.lock = threading.Lock()
        self._next = 0.0

    def add(self, result: Result) -> None:
        """Take a point in, if it is better than what is known of it, or has taken its place in the same folder."""
        at = place(result.data["varied"], self.keys)
        with self.lock:
            known = self.results.get(at)
            if result.point > 1:
                self.led.add(at)
            if known is None or known.directory == result.directory or result.worth > known.worth:
                self.results[at] = result
                if time.monotonic() >= self._next:
                    self._write()
            self._tell(result)

    def count(self, change: int) -> None:
        """Count the processes that are running."""
        with self.lock:
            self.running += change

    def missing(self) -> list[Values]:
        """Return the points that have to run."""
        done = {at for at, result in self.results.items() if result.failure not in (*in_time.RESUMABLE, "not-reached")}
        unreached = {at for at, result in self.results.items() if result.failure == "not-reached"}
        found = [values for values in self.order if place(values, self.keys) not in done]
        if unreached:  # a kill may have come before they were tried again
            failed = [result.data["varied"] for result in self.results.values() if result.failure == "not-converged"]
            solved = self.solved()
            found = [
                values
                for values in found
                if place(values, self.keys) not in unreached
                or sum(any(beyond(values, wall, start) for start in solved) for wall in failed) < 2
            ]
        return found

    def solved(self) -> list[Values]:
        """Return the points that were solved, from which others can be reached."""
        good = {at for at, result in self.results.items() if result.failure in ("", "check")}
        return [values for values in self.order if place(values, self.keys) in good]

    def alone(self) -> list[Values]:
        """Return the points that did not converge from rest and were not yet tried from another point."""
        bad = {at for at, result in self.results.items() if result.failure == "not-converged"} - self.led
        return [values for values in self.order if place(values, self.keys) in bad]

    def write(self) -> pd.DataFrame:
        with self.lock:
            return self._write()

    def _write(self) -> pd.DataFrame:
        begin = time.monotonic()
        table = frame(self.directory, self.keys, self.order, self.results)
        folder.write_text(self.directory / TABLE, table.to_csv(index=False))
        units = pd.DataFrame(table.attrs["units"].items(), columns=["column", "unit"])
        folder.write_text(self.directory / UNITS, units.to_csv(index=False))
        took = time.monotonic() - begin
        self._next = time.monotonic() + took / _SHARE
        return table

    def _tell(self, result: Result) -> None:
        if self.on_event is None:
            return
        failed = sum(1 for other in self.results.values() if other.failure)
        numbers = {"points": len(self.order), "done": len(self.results), "failed": failed, "running": self.running}
        seconds = float(result.data.get("timings", {}).get("total") or 0.0)
        verdict = result.verdict + (f" ({result.reason})" if result.reason else "")
        self.on_event(
            Event(
                "result",
                {**numbers, "seconds": seconds, "verdict": verdict},
                study_definition.label(result.data["varied"]),
            )
        )


class _Study:
    """Runs the missing points of a table."""

    def __init__(
        self, scene: Scene, directory: Path, table: _Table, workers: int, pool: Executor | None, cache: Cache | None,
        check: bool, asked: Sequence[str],
    ) -> None:  # fmt: skip
        self.asked = asked
        self.scene, self.directory, self.table, self.workers = scene, directory, table, workers
        self.pool, self.cache, self.check = pool, cache, check
        self.stop = Stop()
        self._folders = threading.Lock()
        self._seen: set[tuple[Any, ...]] = set()

    def run(self, on_event: OnEvent | None) -> None:
        """Run what is missing; then, from their nearest solved neighbours, points that do not converge from rest."""
        self._keep()
        self._run(plan(self.scene, self._not_kept(self.table.missing()), self.workers), on_event)
        if self.scene.time is None and (alone := self.table.alone()):
            self._run(self._led(alone), on_event, leads=1)

    def _keep(self) -> None:
        """Keep what is new in the table, but of chains at work."""
        if self.cache is None:
            return
        with self.table.lock:
            results = list(self.table.results.items())
        for at, result in results:
            if at not in self._seen and not result.failure and not folder.is_held(result.directory):
                self._seen.add(at)
                self.cache.keep(result)

    def _not_kept(self, points: Sequence[Values]) -> list[Values]:
        """Return the points that are not in the cache; take the others in."""
        if self.cache is None or self.asked:  # nobody asked when they were kept
            return list(points)
        left = []
        for values in points:
            result = None
            if self.cache.knows(self.scene, values):
                chain = self.new_folder()
                result = self.cache.copy(self.scene, values, chain)
                if result is None:
                    shutil.rmtree(chain, ignore_errors=True)
                else:
                    self.table.add(result)
            if result is None:
                left.append(values)
        return left

    def _led(self, alone: Sequence[Values]) -> list[Piece]:
        """Return points behind the nearest solved ones with their script and mesh, those of one such in one piece."""
        pieces: dict[int, Piece] = {}
        solved = self.table.solved()
        for values in alone:
            keys = run_time_keys(self.scene, values)
            fixed = {key: value for key, value in values.items() if key not in keys}
            near = [other for other in solved if other.keys() == values.keys() and fixed.items() <= other.items()]
            near = [other for other in near if formulations(self.scene, other) == formulations(self.scene, values)]
            if near:
                lead = nearest(values, near, keys)
                pieces.setdefault(id(lead), [lead]).append(values)
        return [
            [lead, *(rest if len(rest) == 1 else in_order([lead, *rest], run_time_keys(self.scene, lead), first=0)[1:])]
            for lead, *rest in pieces.values()
        ]

    def _run(self, pieces: Sequence[Piece], on_event: OnEvent | None, leads: int = 0) -> None:
        if not pieces:
            return
        begun = {} if self.scene.steady else self._begun()
        work: Callable[[Piece], None]
        if self.pool is None:

            def work(piece: Piece) -> None:
                if not leads and not (piece := self._not_kept(piece)):  # another study has solved it meanwhile
                    return
                self.table.count(1)
                first = begun.get(place(piece[0], self.table.keys))
                new = [self.new_folder() if first is None else first]
                run_piece(
                    self.scene, piece, lambda: new.pop() if new else self.new_folder(), check=self.check,
                    draw=self._drawn(piece), leads=leads, on_event=on_event, on_result=self.table.add,
                    stop=self.stop, asked=self.asked,
                )  # fmt: skip
                self._keep()
                self.table.count(-1)

            with ThreadPoolExecutor(max_workers=self.workers, thread_name_prefix="ffsi-chain") as pool:
                self._wait({pool.submit(work, piece): piece for piece in pieces}, pool, lambda _: None)
            return
        tasks: dict[Future[Any], Piece] = {}
        try:
            for piece in pieces:
                tasks[
                    self.pool.submit(
                        remote.work, remote.task(self.scene, piece, self.check, self._drawn(piece), leads, self.asked)
                    )
                ] = piece
        except RuntimeError as error:  # it is broken already, or shut down
            logger.warning("%s", error)
        lost = [*self._wait(tasks, self.pool, self._fetch), *pieces[len(tasks) :]]
        if lost:  # by an executor that is of no use any more
            logger.warning("%d pieces were lost with their workers; they run on this machine", len(lost))
            self.pool = None
            find_freefem()
            self._run(lost, on_event, leads)

    def _drawn(self, piece: Piece) -> bool:
        """Return whether a piece draws: in time each, else the one with the last point, however the study is cut."""
        return not self.scene.steady or self.table.order[-1] in piece

    def _wait(self, tasks: Mapping[Future[Any], Piece], pool: Executor, take: Callable[[Any], None]) -> list[Piece]:
        """Wait for pieces; return those whose workers died. Whatever else happens ends them all."""
        lost = []
        try:
            for job in as_completed(tasks):
                try:
                    take(job.result())
                except Exception as error:
                    if not remote.lost(error):
                        raise
                    logger.warning("a worker died: %s", error)
                    lost.append(tasks[job])
        except BaseException:  # Ctrl-C reaches this thread only
            self.stop.set()
            for job in tasks:
                job.cancel()
            stop_all()
            raise
        return lost

    def _fetch(self, chains: Sequence[Mapping[str, bytes]]) -> None:
        """Write the chains that a worker has sent, and take their points in."""
        for files in chains:
            chain = self.new_folder()
            for name, data in files.items():
                (chain / name).write_bytes(data)
            for result in harvest(self.scene, chain, self.table.keys, check=self.check):
                self.table.add(result)
        self._keep()

    def new_folder(self) -> Path:
        """Make the folder of another chain."""
        with self._folders:
            numbers = [int(path.name.rpartition("-")[2]) for path in chains_of(self.directory)]
            path = self.directory / f"chain-{max(numbers, default=0) + 1:03d}"
            path.mkdir()
            return path

    def _begun(self) -> dict[tuple[Any, ...], Path]:
        """Return the chains in time that have begun and not ended, by the values of their point."""
        found = {}
        for path in chains_of(self.directory):
            if not (path / folder.CHAIN).is_file() or not folder.is_run_folder(path) or folder.is_held(path):
                continue
            result = path / folder.numbered(folder.RESULT, 1)
            if not result.is_file() or folder.read_json(result).get("failure") in in_time.RESUMABLE:
                found[place(points_of(path, self.table.keys)[0], self.table.keys)] = path
        return found
