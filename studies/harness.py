"""The frame of every study: its outputs, and runs, once or kept in folders, several at a time, and none twice."""

from __future__ import annotations

import math
import os
import platform
import re
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.history import read_history, seconds_of_run, seconds_of_steps
from ffsi.freefem import FreeFEMError, FreeFEMNotFound, find_freefem, stop_all
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result, load_result
from ffsi.result import quantities
from ffsi.result.in_time import RESUMABLE
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, SceneError, load_scene
from ffsi.script.render import render
from studies.tables import TextTable, document

K = TypeVar("K")
T = TypeVar("T")
Place = Path | None
Content = Callable[[], str | bytes | pd.DataFrame]


@dataclass(frozen=True)
class Study:
    """What a study is called and where its findings go; made before anything is computed."""

    command: str  # the command that does it, without `python -m studies`
    out: Path | None = None  # folder of its files, which is made; None: none are written
    readme: Path | None = None  # file in which the block `name` is replaced, unless a run failed; None: nothing is
    name: str = ""  # of its block, its document, and the template of both in `documents/`

    def __post_init__(self) -> None:
        """Refuse unusable outputs."""
        if self.readme is not None:
            replaced(self.readme, self.name, "")
        if self.out is not None:
            if self.out.exists() and not self.out.is_dir():
                raise InputError(f"{self.out} is a file; --out takes a folder")
            self.out.mkdir(parents=True, exist_ok=True)

    def finish(
        self,
        data: Iterable[Mapping[str, Any]],
        shown: Iterable[TextTable],
        files: Mapping[str, Content],
        digits: str | None = "%.8g",
        **values: Any,
    ) -> list[str]:
        """Print tables, write files, the document and the block, which is made with `brief`; return the failures.

        Args:
            data: the content of each `result.json`.
            shown: what is printed.
            files: what makes each file, by its name; a table becomes CSV with so many digits.
            digits: format of the numbers in CSV.
            values: what the template needs, besides `written`, a sentence about who wrote it, and `links`.
        """
        for item in shown:
            item.print()
        data = list(data)
        failures = [str(item.get("failure", "")) for item in data]
        info = Path("/proc/cpuinfo")
        names = re.findall(r"^model name\s*:\s*(.*?)\s*$", info.read_text(), re.MULTILINE) if info.is_file() else []
        machine = names[0] if names else platform.processor() or platform.machine()
        written = origin(f"python -m studies {self.command}", data, f", one thread; {machine}")
        values |= {"written": written, "links": self.links}
        if self.out is not None:
            made = {name: make() for name, make in files.items()}
            if text := document(self.name, brief=False, **values):
                made[f"{self.name}.md"] = text + "\n"
            for name, content in made.items():
                if isinstance(content, pd.DataFrame):
                    content = content.to_csv(index=False, float_format=digits)
                (self.out / name).write_bytes(content if isinstance(content, bytes) else content.encode())
            *first, last = (str(self.out / name) for name in made)
            show.note(f"wrote {', '.join(first)}{' and ' if first else ''}{last}")
        if self.readme is not None and any(failures):
            show.error(f"{self.readme} stays as it is, because a run failed")
        elif self.readme is not None:
            content = document(self.name, brief=True, **values)
            folder.write_text(self.readme, replaced(self.readme, self.name, content))
            show.note(f"wrote the block {self.name} of {self.readme}")
        return failures

    def links(self, text: str, *names: str) -> str:
        """Return ` TEXT: [name](path), ....`, paths as seen from `readme`; empty without `out` or `readme`."""
        if self.out is None or self.readme is None:
            return ""
        paths = [Path(os.path.relpath(self.out / name, self.readme.parent)).as_posix() for name in names]
        return f" {text}: {', '.join(f'[{name}]({path})' for name, path in zip(names, paths, strict=True))}."


def side_by_side(
    tasks: Mapping[K, Callable[[OnEvent], T]], jobs: int, label: str, points: int | None = None
) -> dict[K, T]:
    """Do tasks, `jobs` at a time, under one line of progress that counts `points`; return what they return by key."""
    with (
        show.progress(label, len(tasks) if points is None else points) as on_event,
        ThreadPoolExecutor(max_workers=jobs, thread_name_prefix="ffsi-run") as pool,
    ):
        running = {key: pool.submit(task, on_event) for key, task in tasks.items()}
        try:
            for job in as_completed(running.values()):
                job.result()
        except BaseException:  # Ctrl-C reaches this thread only
            pool.shutdown(wait=False, cancel_futures=True)
            stop_all()
            raise
    return {key: job.result() for key, job in running.items()}


def replaced(readme: Path, block: str, content: str) -> str:
    """Return the text of a file with other content between `<!-- BLOCK:begin -->` and `<!-- BLOCK:end -->`."""
    if not readme.is_file():
        raise InputError(f"--readme: there is no file {readme}")
    text, begin, end = readme.read_text(encoding="utf-8"), f"<!-- {block}:begin -->", f"<!-- {block}:end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise InputError(f"{readme}: the text needs one line {begin} and after it one line {end}")
    head, _, rest = text.partition(begin)
    return f"{head}{begin}\n{content.strip()}\n{end}{rest.partition(end)[2]}"


def origin(command: str, data: Iterable[Mapping[str, Any]], more: str = "") -> str:
    """Return one sentence about who wrote a text, with the FreeFEM of the first `result.json` that names it."""
    used: Mapping[str, Any] = next((item["freefem"] for item in data if item.get("freefem")), {})
    return f"Written by `{command}` (FreeFEM {used.get('version', '?')} with {used.get('solver', '?')}{more})."


PLAIN = ("output.pictures=false", "output.vtu=false")


@dataclass(frozen=True)
class Run:
    """A run."""

    name: str  # of its case, or of its folder
    data: Mapping[str, Any]  # content of its `result.json`
    variant: str = ""  # name of the variant of the case; empty for the case itself
    # Of a kept run one row per step, as of `files.history.read_history`; without rows in a steady one.
    history: pd.DataFrame = field(default_factory=pd.DataFrame, compare=False, repr=False)

    @property
    def failure(self) -> str:
        """Empty, or what went wrong, as `Result.failure`."""
        return str(self.data.get("failure", ""))

    @property
    def level(self) -> int:
        """Mesh level."""
        return int(self.data["level"])

    @property
    def quantities(self) -> dict[str, Any]:
        """Quantities (SI); in time each with mean, amplitude and frequency."""
        return dict(self.data.get("quantities") or {})

    @property
    def timings(self) -> dict[str, float]:
        """Seconds by phase."""
        return dict(self.data.get("timings") or {})

    @property
    def in_time(self) -> Mapping[str, Any]:
        """How far it came, and whether it is periodic (docs/formats.md)."""
        return dict(self.data.get("time") or {})

    @property
    def check_maximum(self) -> float:
        """Largest number of the reference checker (relative residuals and differences); NaN if it did not run."""
        return quantities.check_maximum(self.data)

    def value(self, quantity: str) -> float:
        """Return a quantity (SI); NaN if a failed or other run does not have it."""
        return math.nan if self.failure else self.quantities.get(quantity, math.nan)

    @property
    def seconds(self) -> float:
        """Processor time of the script, those before a resume included, s."""
        in_time = "time" in self.history
        return seconds_of_run(self.history) if in_time else float(self.timings.get("script", math.nan))

    @property
    def steps(self) -> dict[str, Any]:
        """What the steps took: their number, seconds, and per step (means) seconds, iterations and rebuilds."""
        count, newton = len(self.history), self.data.get("newton") or {}
        iterations, rebuilds = (
            newton[name] / count if count and newton.get(name) is not None else math.nan
            for name in ("iterations", "factorizations")
        )
        return {
            "steps": count, "seconds": self.seconds, "seconds_per_step": float(seconds_of_steps(self.history).mean()),
            "iterations_per_step": iterations, "rebuilds_per_100_steps": 100 * rebuilds,
            "check_maximum": self.check_maximum,
        }  # fmt: skip


def repeated(command: str, repeat: int) -> str:
    """Return a command with its option, if it has one."""
    return command + (f" --repeat {repeat}" if repeat > 1 else "")


def multiples(size: float, count: int) -> tuple[float, ...]:
    """Return size, 2 size, ..., count size, without rounding errors."""
    return tuple(round(k * size, 10) for k in range(1, count + 1))


def history_of(directory: Path) -> pd.DataFrame:
    """Return one row per step, as of `files.history.read_history`; no rows if there is no step."""
    try:
        return read_history(directory)
    except InputError:
        return pd.DataFrame({"time": [], "seconds": []})


def solved(
    label: str, scene: Scene, case: str, variant: str = "", more: Callable[[Result], Mapping[str, Any]] | None = None
) -> Run:
    """Solve and check a scene with one thread in a temporary folder; a process that died has the failure `crash`."""
    try:
        with show.progress(label) as on_event:
            result = solve(scene, on_event=on_event)
        data = {**result.data, **(more(result) if more and result.solved else {})}
    except FreeFEMNotFound:
        raise
    except FreeFEMError as error:
        data = {"case": scene.name, "status": "failed", "failure": "crash", "reason": str(error)}
    if data.get("failure"):
        show.error(f"{label}: {data['reason']}")
    return Run(case, data | {"level": scene.mesh.level}, variant)


def run_all(scenes: Mapping[str, Scene], runs: Path, jobs: int = 1, label: str = "") -> list[Run]:
    """Run scenes, by the names of their folders in `runs`, `jobs` at a time, or what is missing of them.

    A finished run is read; one that was stopped or killed goes on. One that failed or died is among those returned.
    """
    if jobs > 1:
        tasks = {name: partial(run_one, name, scene, runs / name) for name, scene in scenes.items()}
        return list(side_by_side(tasks, jobs, label).values())
    found = []
    for name, scene in scenes.items():
        with show.progress(name) as on_event:
            found.append(run_one(name, scene, runs / name, on_event))
    return found


def run_one(name: str, scene: Scene, directory: Path, on_event: OnEvent | None = None, *, error: bool = False) -> Run:
    """Run a scene in its folder, or what is missing of it, with one thread; with `error` its quantities have bars."""
    state = _state(scene, directory)
    if state != "finished":
        try:
            solve(scene, directory, on_event=on_event, resume=state == "begun", error=error)
        except FreeFEMNotFound:
            raise
        except FreeFEMError:  # the result says so
            pass
    data = load_result(directory).data
    run = Run(name, data, history=pd.DataFrame() if scene.time is None else history_of(directory))
    if run.failure:
        show.error(f"{name}: {data.get('reason')}; what there is lies in {directory}")
    elif state == "finished":
        show.note(f"{name}: finished before, in {directory}{_other_script(scene, directory)}")
    elif scene.time is None:
        show.note(f"{name}: {run.seconds:.1f} s")
    else:
        show.note(f"{name}: {len(run.history)} steps to t = {run.in_time.get('reached'):g} s, {run.seconds:.0f} s")
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
