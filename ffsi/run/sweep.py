"""Many points of one scene: plan chains, run them in parallel, resume, one table."""

from __future__ import annotations

import logging
import numbers
import os
import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import tomli_w

from ffsi.files import folder
from ffsi.files.arguments import count_of, path_of
from ffsi.files.errors import InputError
from ffsi.freefem import find_freefem, stop_all
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result
from ffsi.result import in_time, sweep_definition
from ffsi.result.table import TABLE, Values, check_count, frame, points
from ffsi.run.chain import OnResult, run_chain
from ffsi.run.harvest import chains_of, harvest, points_of
from ffsi.scene import Scene, load_scene, scene_of, with_values
from ffsi.script.render import is_runtime_parameter

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Chain:
    """Points that one FreeFEM process solves in this order.

    Attributes:
        points: per point, every varied key and its value.
        lead_in: points solved by an earlier call, in order; the way to the first of `points` if that does not converge
            from rest.
    """

    points: tuple[Values, ...]
    lead_in: tuple[Values, ...] = ()


def plan(scene: Scene, vary: Mapping[str, Sequence[float]]) -> list[Chain]:
    """Split the cartesian product of `vary` into chains.

    The last key that needs no new mesh runs along the chain, in the given order; every combination of the others is
    its own chain. In time every point is a chain.

    Raises:
        InputError: nothing varies.
        SceneError: a key or a value that the scene does not accept.
    """
    if not vary or any(len(values) == 0 for values in vary.values()):
        raise InputError("a sweep needs at least one varied key with at least one value")
    check_count(vary)
    for values in points(vary):
        with_values(scene, dict(values))
    along = next((key for key in reversed(list(vary)) if scene.steady and is_runtime_parameter(scene, key)), None)
    others = {key: vary[key] for key in vary if key != along}
    steps: Sequence[Values] = [{along: value} for value in vary[along]] if along is not None else [{}]
    return [Chain(tuple({key: {**fixed, **step}[key] for key in vary} for step in steps)) for fixed in points(others)]


def sweep(
    scene: Scene | str | Path,
    vary: Mapping[str, Sequence[float]],
    out: str | Path,
    jobs: int = 1,
    dask: str | None = None,
    on_event: OnEvent | None = None,
    *,
    check: bool = True,
) -> pd.DataFrame:
    """Solve `scene` for every combination of values, and keep `out/sweep.csv` up to date while points finish.

    A second call with the same definition runs only what is missing or died; points that did not converge are not
    tried again. Points of a scene in time go on from their last checkpoints.

    Args:
        scene: what to solve: a scene, the name of a case, or the path of a TOML file.
        vary: dotted keys and their values, numbers in SI.
        out: the sweep's folder.
        jobs: chains at a time on this machine.
        dask: address of a dask scheduler whose workers see `out` under the same path (extra `dask`).
        on_event: called with every event that the scripts report (not with dask).
        check: verify every point with the independent checker.

    Returns:
        One row per point in the order of the product: the varied keys, `status`, `checked`, `reason`, `failure`,
        `warnings`, every quantity (of a point that failed none, but `reached_...`), `check_maximum`, `seconds`,
        `folder` and `point`.

    Raises:
        InputError: `out` holds something else, or a sweep with another definition; or `dask` is not installed; or an
            argument is not accepted.
        SceneError: a key or a value that the scene does not accept.
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    vary, jobs, directory = _checked(vary), count_of(jobs, "jobs"), path_of(out, "out").absolute()
    # One script for the points of a chain, also where a default would follow a varied value.
    scene = scene_of(scene).settled()
    chains = plan(scene, vary)
    defined = sweep_definition.define(scene, vary)
    if dask is None:
        find_freefem()
    with folder.held(directory, lambda path: sweep_definition.check(path, defined)):
        if not folder.is_sweep_folder(directory):
            sweep_definition.write(directory, defined)
        table = _Table(directory, list(vary), points(vary))
        for chain in chains_of(directory):
            for result in harvest(scene, chain, list(vary), check=check):
                table.add(result)
        todo = [rest for chain in chains if (rest := remaining(chain, table.done(), table.converged()))]
        folders = _folders(scene, directory, todo)
        if dask is not None:
            _run_on_dask(scene, todo, folders, table, dask, check)
        else:
            _run_here(scene, todo, folders, table, jobs, on_event, check)
        return table.write()


def _checked(vary: Mapping[str, Sequence[float]]) -> dict[str, list[float]]:
    """Return what varies, if it is what the command line accepts, too.

    Raises:
        InputError: it is something else, or a value occurs twice.
    """
    if not isinstance(vary, Mapping):
        raise InputError(f"vary: accepted: keys and their values, such as {{'mesh.level': [0, 1]}}, not {vary!r}")
    found: dict[str, list[float]] = {}
    for key, values in vary.items():
        several = isinstance(values, Iterable) and not isinstance(values, str)
        given: list[Any] = list(values) if several else []
        wrong = [item for item in given if isinstance(item, bool) or not isinstance(item, numbers.Real)]
        if wrong or not several:
            shown = wrong[0] if wrong else values
            raise InputError(f"vary {key} = {shown!r}: accepted: a list of numbers in SI, such as [0.02, 0.04]")
        found[key] = given
        if len(set(given)) < len(given):
            raise InputError(f"vary {key}: a value occurs twice")
    return found


def remaining(chain: Chain, done: set[tuple[float, ...]], converged: set[tuple[float, ...]]) -> Chain | None:
    """Return the part of a chain that still has to run, or None."""
    missing = [i for i, values in enumerate(chain.points) if tuple(values.values()) not in done]
    if not missing:
        return None
    lead_in = tuple(values for values in chain.points[: missing[0]] if tuple(values.values()) in converged)
    return Chain(tuple(chain.points[i] for i in missing), lead_in)


class _Table:
    """The results that are known so far; `sweep.csv` follows every addition."""

    def __init__(self, directory: Path, keys: Sequence[str], order: Sequence[Values]) -> None:
        self.directory, self.keys, self.order = directory, keys, order
        self.results: dict[tuple[float, ...], Result] = {}
        self.lock = threading.Lock()

    def add(self, result: Result) -> None:
        """Take a point in, if it is better than what is known of it, or has taken its place in the same folder."""
        at = tuple(result.data["varied"][key] for key in self.keys)
        with self.lock:
            known = self.results.get(at)
            if known is None or known.directory == result.directory or _worth(result) > _worth(known):
                self.results[at] = result
                self._write()

    def done(self) -> set[tuple[float, ...]]:
        """Return the points that need not run again."""
        with self.lock:
            return self._done()

    def converged(self) -> set[tuple[float, ...]]:
        """Return the points that were solved."""
        with self.lock:
            return {at for at, result in self.results.items() if result.failure in ("", "check")}

    def write(self) -> pd.DataFrame:
        with self.lock:
            return self._write()

    def _done(self) -> set[tuple[float, ...]]:
        return {at for at, result in self.results.items() if result.failure not in in_time.RESUMABLE}

    def _write(self) -> pd.DataFrame:
        table = frame(self.directory, self.keys, self.order, self.results)
        folder.write_text(self.directory / TABLE, table.to_csv(index=False))
        return table


def _worth(result: Result) -> tuple[int, list[int]]:
    """Return what decides between two results of a point: the better one; of two as good that of the first chain."""
    return result.rank, [-ord(letter) for letter in result.directory.name]


def _run_here(
    scene: Scene,
    todo: Sequence[Chain],
    folders: Sequence[Path],
    table: _Table,
    jobs: int,
    on_event: OnEvent | None,
    check: bool,
) -> None:
    threads = max(1, (os.cpu_count() or 1) // jobs) if jobs > 1 else 1
    with ThreadPoolExecutor(max_workers=jobs, thread_name_prefix="ffsi-chain") as pool:
        running: list[Future[None]] = [
            pool.submit(_run_one, scene, chain, path, check, on_event, table.add, threads)
            for chain, path in zip(todo, folders, strict=True)
        ]
        try:
            for job in as_completed(running):
                job.result()
        except BaseException:  # Ctrl-C reaches this thread only
            pool.shutdown(wait=False, cancel_futures=True)
            stop_all()
            raise


def _run_on_dask(
    scene: Scene, todo: Sequence[Chain], folders: Sequence[Path], table: _Table, address: str, check: bool
) -> None:
    try:
        from distributed import Client
        from distributed import as_completed as done
    except ImportError as error:
        raise InputError("--dask needs the package distributed: pip install distributed") from error
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"no dask scheduler at {address}: {error}") from error
    with client:
        jobs = [
            client.submit(_run_remotely, tomli_w.dumps(scene.given()), chain, str(path), check, pure=False)
            for chain, path in zip(todo, folders, strict=True)
        ]
        for job in done(jobs):
            for result in harvest(scene, Path(job.result()), table.keys, check=check):
                table.add(result)


def _run_remotely(toml: str, chain: Chain, path: str, check: bool) -> str:
    """Run a chain on a dask worker; the results travel through the shared folder."""
    directory = Path(path)
    directory.mkdir(parents=True, exist_ok=True)
    source = directory.with_suffix(".toml")
    folder.write_text(source, toml)
    _run_one(load_scene(str(source), []), chain, directory, check, None, None, 1)
    source.unlink()
    return path


def _run_one(
    scene: Scene,
    chain: Chain,
    path: Path,
    check: bool,
    on_event: OnEvent | None,
    on_result: OnResult | None,
    threads: int,
) -> None:
    run = partial(run_chain, scene, out=path, check=check, on_event=on_event, threads=threads)
    results: list[Result] = []
    if not scene.steady and folder.is_run_folder(path):
        try:
            results = run(chain.points, on_result=on_result, resume=True)
        except InputError as error:  # what lies there cannot be believed
            logger.warning("%s. The point is computed anew", error)
    if not results:
        results = run(chain.points, on_result=on_result)
    if not chain.lead_in or results[0].failure != "not-converged":
        return
    logger.info("%s: the first point does not converge from rest, going through the points before it again", path)

    def report(result: Result) -> None:
        if on_result is not None and result.point > len(chain.lead_in):
            on_result(result)

    run((*chain.lead_in, *chain.points), on_result=report)


def _folders(scene: Scene, directory: Path, todo: Sequence[Chain]) -> list[Path]:
    """Return where each chain runs: in a new folder, or, in time, in the one where an earlier call has begun it."""
    begun = {} if scene.steady or not todo else _begun(directory, list(todo[0].points[0]))
    new = iter(_new_folders(directory, len(todo)))
    return [begun.get(tuple(chain.points[0].values())) or next(new) for chain in todo]


def _begun(directory: Path, keys: Sequence[str]) -> dict[tuple[float, ...], Path]:
    """Return the chains in time that have begun and not ended, by the values of their point."""
    found = {}
    for path in chains_of(directory):
        if not (path / folder.CHAIN).is_file() or not folder.is_run_folder(path) or folder.is_held(path):
            continue
        result = path / folder.numbered(folder.RESULT, 1)
        if not result.is_file() or folder.read_json(result).get("failure") in in_time.RESUMABLE:
            found[tuple(points_of(path, keys)[0].values())] = path
    return found


def _new_folders(directory: Path, count: int) -> list[Path]:
    numbers = [int(path.name.rpartition("-")[2]) for path in chains_of(directory)]
    start = max(numbers, default=0) + 1
    return [directory / f"chain-{start + i:03d}" for i in range(count)]
