"""Running the hard cases: each in a folder of its own, several at a time, and none twice."""

from __future__ import annotations

import hashlib
import math
import shutil
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.history import read_history
from ffsi.freefem import FreeFEMNotFound, find_freefem
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import load_result, load_results
from ffsi.result.quantities import flatten
from ffsi.run.sweep import sweep
from ffsi.scene import Scene, SceneError
from ffsi.script.render import render
from studies.harness import side_by_side
from studies.kept_runs import run_one
from studies.verification.hard_entries import Entry

REFUSED, ERROR = "refused", "error"
"""Failures beside those of a Result: a scene that is not accepted; a fault of the program."""
KILLED = "FreeFEM died (killed)"
"""From outside: it is to run again."""


@dataclass(frozen=True)
class Outcome:
    """What became of an entry, as its file `ID.json` has it.

    Attributes:
        entry: what was run.
        directory: the run folder, or that of the sweep.
        failure: as of a Result, or `REFUSED` or `ERROR`; of a sweep that of its first failed point.
        reason: of it, in words.
        warnings: what the program said beside the result.
        rows: numbers (SI) of the run, or of each point of the sweep: none of one that was not solved.
        seconds: of wall-clock time.
        freefem: version and solver.
    """

    entry: Entry
    directory: Path
    failure: str
    reason: str = ""
    warnings: Sequence[str] = ()
    rows: Sequence[Mapping[str, float | None]] = ()
    seconds: float = 0.0
    freefem: Mapping[str, str] | None = None

    @property
    def data(self) -> dict[str, Any]:
        """What the sentence about the origin of a table needs."""
        return {"freefem": dict(self.freefem or {})}

    def value(self, name: str, row: int | None = None) -> float:
        """Return a number (SI) of a row, by default of the last solved one; NaN where there is none."""
        solved = [point for point in self.rows if point]
        if name == "points":
            return float(len(solved))
        try:
            found = (solved[-1] if row is None else self.rows[row]).get(name)
        except IndexError:
            found = None
        return math.nan if found is None else float(found)

    def at(self, name: str, point: tuple[float, float]) -> float:
        """Return a field at a point (m); NaN where there is none."""
        try:
            return load_result(self.directory).at(*point)[name]
        except (InputError, ValueError, KeyError):
            return math.nan

    @cached_property
    def history(self) -> pd.DataFrame:
        """One row per step; no rows where there were none."""
        try:
            return read_history(self.directory)
        except InputError:
            return pd.DataFrame({"time": []})


def run_all(entries: Sequence[Entry], runs: Path, jobs: int = 1) -> dict[str, Outcome]:
    """Run entries, or what is missing of them, with one thread each.

    Args:
        entries: what to run.
        runs: where the folders are; one that the present scene, script and limit have filled is read.
        jobs: entries at a time.

    Returns:
        What became of each, by id; whatever an entry does is in there.

    Raises:
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    find_freefem()
    runs.mkdir(parents=True, exist_ok=True)
    tasks = {entry.id: partial(run, entry, runs) for entry in entries}
    return side_by_side(tasks, jobs, "verify --hard")


def run(entry: Entry, runs: Path, on_event: OnEvent | None = None) -> Outcome:
    """Run an entry, or read what an earlier call has found; arguments and errors as of `run_all`."""
    file, directory = runs / f"{entry.id}.json", runs / entry.id
    begin = time.perf_counter()
    try:
        scene = entry.scene()
        digest = _digest(entry, scene)
        known = folder.read_json(file) if file.is_file() else {}
        if known.get("digest") == digest and "outcome" in known:
            return Outcome(entry, directory, **known["outcome"])
        if known.get("digest") != digest and directory.exists():
            shutil.rmtree(directory)
        folder.write_json(file, {"digest": digest})  # a run in time that is killed goes on
        found = (_sweep if entry.vary else _single)(entry, scene, directory, on_event)
    except FreeFEMNotFound:
        raise
    except (SceneError, InputError) as error:
        return Outcome(entry, directory, REFUSED, str(error))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
        return Outcome(entry, directory, ERROR, reason)
    found["seconds"] = round(time.perf_counter() - begin, 2)
    if KILLED not in found["reason"]:
        folder.write_json(file, {"digest": digest, "outcome": found})
    return Outcome(entry, directory, **found)


def _digest(entry: Entry, scene: Scene) -> str:
    """Return what says whether an entry must run again: its own values and files, and the script of today."""
    found = hashlib.sha256(repr((entry.case, dict(entry.set), dict(entry.vary), entry.limit)).encode())
    found.update(render(scene, mumps=find_freefem().has_mumps).encode())
    for path in entry.files:
        found.update(path.read_bytes())
    return found.hexdigest()


def _single(entry: Entry, scene: Scene, directory: Path, on_event: OnEvent | None) -> dict[str, Any]:
    done = run_one(entry.id, scene, directory, on_event)
    return _told(done.data, [_row(done.data)])


def _sweep(entry: Entry, scene: Scene, directory: Path, on_event: OnEvent | None) -> dict[str, Any]:
    sweep(scene, entry.vary, directory, on_event=on_event)
    points = [point.data for point in load_results(directory)]
    rows = [{} if data["failure"] else {**data["varied"], **_row(data)} for data in points]
    failed = [data for data in points if data["failure"]]
    warnings = [text for data in points for text in data.get("warnings", [])]
    return _told({**(failed or points)[0], "warnings": list(dict.fromkeys(warnings))}, rows)


def _told(data: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    unchecked = not data["failure"] and not data.get("checked", data.get("check"))
    return {
        "failure": ERROR if unchecked else data["failure"],
        "reason": "nobody checked it" if unchecked else data.get("reason") or "",
        "warnings": data.get("warnings", []),
        "rows": rows,
        "freefem": data.get("freefem", {}),
    }


def _row(data: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of a run: its quantities, in time those of the last state too, and what it took."""
    in_time = data.get("time") or {}
    energy = in_time.get("energy") or {}
    found = {**flatten(data.get("quantities") or {}), **flatten(in_time.get("last") or {})}
    smallest = (data.get("quantities") or {}).get("min_jacobian")
    found |= {} if smallest is None else {"min_jacobian": float(smallest)}
    found |= {"imbalance": abs(energy["imbalance"])} if "imbalance" in energy else {}
    found |= {key: float(value) for key, value in (data.get("newton") or {}).items()}
    return {key: value for key, value in found.items() if math.isfinite(value)}
