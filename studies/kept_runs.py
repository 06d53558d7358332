"""Runs that may take hours, most of them in time: each in a folder of its own, several at a time, and none twice."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.history import read_history, seconds_of_run, seconds_of_steps
from ffsi.freefem import FreeFEMError, FreeFEMNotFound, find_freefem
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import load_result
from ffsi.result.in_time import RESUMABLE
from ffsi.result.quantities import check_maximum
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, SceneError, load_scene
from ffsi.script.render import render
from studies.harness import side_by_side


@dataclass(frozen=True)
class TimeRun:
    """A run, in time or steady: its folder, and the content of its `result.json`."""

    name: str
    scene: Scene
    directory: Path
    data: Mapping[str, Any]

    @property
    def failure(self) -> str:
        """Empty, or what went wrong, as `Result.failure`."""
        return str(self.data.get("failure", ""))

    @property
    def in_time(self) -> Mapping[str, Any]:
        """How far it came, and whether it is periodic (docs/formats.md)."""
        return dict(self.data.get("time") or {})

    @property
    def quantities(self) -> dict[str, Any]:
        """Mean, amplitude and frequency of every quantity; none of a run that failed."""
        return {} if self.failure else dict(self.data.get("quantities") or {})

    @cached_property
    def history(self) -> pd.DataFrame:
        """One row per step, as of `files.history.read_history`; no rows if it died before the first step."""
        try:
            return read_history(self.directory)
        except InputError:
            return pd.DataFrame({"time": [], "seconds": []})

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.history)

    @property
    def seconds(self) -> float:
        """Processor time of the script, those before a resume included, s."""
        if self.scene.time is None:
            return float((self.data.get("timings") or {}).get("script", math.nan))
        return seconds_of_run(self.history)

    @property
    def seconds_per_step(self) -> float:
        """Processor time of a step, mean, s."""
        return float(seconds_of_steps(self.history).mean())

    @property
    def iterations_per_step(self) -> float:
        """Iterations of a step, mean; NaN without steps."""
        return self._per_step("iterations")

    @property
    def rebuilds_per_100_steps(self) -> float:
        """Factorisations in 100 steps, mean; NaN without steps."""
        return 100 * self._per_step("factorizations")

    @property
    def check_maximum(self) -> float:
        """Largest number of the reference checker; NaN if it did not run."""
        return check_maximum(self.data)

    def _per_step(self, name: str) -> float:
        count = (self.data.get("newton") or {}).get(name)
        return math.nan if count is None or not self.steps else count / self.steps


def run_all(scenes: Mapping[str, Scene], runs: Path, jobs: int = 1, label: str = "") -> list[TimeRun]:
    """Run scenes, or what is missing of them, with one thread each.

    Args:
        scenes: by name of the run folder.
        runs: where the run folders are. A finished run is read; one that was stopped or killed goes on.
        jobs: runs at a time.
        label: what the progress line says where it speaks of several runs.

    Returns:
        The runs, in the order of the scenes; one that failed or died is among them.

    Raises:
        InputError: a folder cannot be used, or another ffsi is at work in it.
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    if jobs == 1:
        return [_alone(name, scene, runs / name) for name, scene in scenes.items()]
    tasks = {name: partial(run_one, name, scene, runs / name) for name, scene in scenes.items()}
    return list(side_by_side(tasks, jobs, label).values())


def _alone(name: str, scene: Scene, directory: Path) -> TimeRun:
    with show.progress(name) as on_event:
        return run_one(name, scene, directory, on_event)


def run_one(name: str, scene: Scene, directory: Path, on_event: OnEvent | None = None) -> TimeRun:
    """Run a scene in its folder, or what is missing of it; arguments and errors as of `run_all`."""
    state = _state(scene, directory)
    if state != "finished":
        try:
            solve(scene, directory, on_event=on_event, threads=1, resume=state == "begun")
        except FreeFEMNotFound:
            raise
        except FreeFEMError:  # the result says so
            pass
    run = TimeRun(name, scene, directory, load_result(directory).data)
    if run.failure:
        show.error(f"{name}: {run.data.get('reason')}; what there is lies in {directory}")
    elif state == "finished":
        show.note(f"{name}: finished before, in {directory}{_other_script(scene, directory)}")
    elif scene.time is None:
        show.note(f"{name}: {run.seconds:.1f} s")
    else:
        show.note(f"{name}: {run.steps} steps to t = {run.in_time.get('reached'):g} s, {run.seconds:.0f} s")
    return run


def _state(scene: Scene, directory: Path) -> str:
    """Return `new`, `begun` or `finished`; what another script than the present one has begun or failed is `new`."""
    if not folder.is_run_folder(directory):
        return "new"
    try:
        if load_scene(str(directory / folder.SCENE), []) != scene:
            return "new"
    except SceneError:  # of a program with other keys
        return "new"
    result = directory / folder.RESULT
    failure = folder.read_json(result).get("failure") if result.is_file() else RESUMABLE[0]
    if failure and _other_script(scene, directory):
        return "new"
    if failure in RESUMABLE:
        return "begun" if scene.time is not None else "new"
    return "finished"


def _other_script(scene: Scene, directory: Path) -> str:
    """Return a remark if the folder's script is not the one that the scene has now."""
    script = directory / folder.SCRIPT
    if script.is_file() and script.read_text(encoding="utf-8") == render(scene, mumps=find_freefem().has_mumps):
        return ""
    return ", by another script than that of today; remove the folder to run it again"
