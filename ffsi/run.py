"""From a scene to a Result: render, run FreeFEM, check, draw, write `result.json`; and go on with a run in time."""

from __future__ import annotations

import logging
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from ffsi import folder, resolution, unsteady, vtu
from ffsi.evaluation import Notes, attempt, gather
from ffsi.folder import InputError
from ffsi.freefem import Event, FreeFEMError, Installation, find_freefem, run_script
from ffsi.render import is_runtime_parameter, render
from ffsi.result import Result
from ffsi.scene import Scene, stored, with_values

logger = logging.getLogger(__name__)

OnEvent = Callable[[Event], None]
OnResult = Callable[[Result], None]
CHECKED = (
    *("momentum", "continuity", "incompressibility", "kinematics", "mesh_motion", "dirichlet"),
    *("drag_difference", "lift_difference", "coefficient_difference", "outlet_difference", "wall_difference"),
    "quantities_difference",
)
_drawing = threading.Lock()  # matplotlib's text cache is shared between threads


def solve(
    scene: Scene,
    out: str | Path | None = None,
    *,
    check: bool = True,
    on_event: OnEvent | None = None,
    threads: int = 1,
    resume: bool = False,
) -> Result:
    """Solve one scene and leave its run folder behind.

    A scene in time with `time.stop = "periodic"` ends as soon as its motion is periodic. Quantities of such a scene are
    mean, amplitude and frequency over the last period.

    Args:
        scene: what to solve.
        out: the run folder; an earlier run in it is replaced. None: a temporary folder that lives as long as the
            Result.
        check: verify the solution with the independent checker; a mismatch makes the status `failed`.
        on_event: called with every event that the script reports; in time also with `signal` (see `unsteady.Watch`).
        threads: threads of the linear algebra.
        resume: go on with the computation in time in `out`, which was killed or stopped, from its last checkpoint.

    Returns:
        The Result; a scene that does not converge is a Result with status `failed`, not an exception.

    Raises:
        InputError: `out` cannot be used, or with `resume` holds nothing to go on with.
        FreeFEMNotFound: no FreeFEM on this machine; nothing was written.
        FreeFEMError: the process died or took longer than `solver.time_limit`; `result.json` says so.
    """
    begin = time.perf_counter()
    if resume:
        if out is None:
            raise InputError("to resume a run its folder is needed")
        unsteady.check_resumable(Path(out))
    installation = find_freefem()
    temporary = tempfile.TemporaryDirectory(prefix=f"ffsi-{scene.name}-") if out is None else None
    directory = Path(temporary.name if temporary else str(out))
    point = _Point(scene, directory, 1, {}, alone=True)
    with folder.held(directory):
        arguments = _start(point, installation, resume)
        died = None if arguments is None else _execute(scene, directory, installation, arguments, on_event, threads)
        data = point.collect(died)
        if check:
            point.check(data)
        point.draw(data)
        data["timings"]["total"] = _seconds(time.perf_counter() - begin)
        point.save(data)
    if data["failure"] == "crash":
        raise died or FreeFEMError("crash", data["reason"], log=directory / folder.LOG)
    return Result(scene, directory, data, temporary)


def resume(directory: str | Path, *, check: bool = True, on_event: OnEvent | None = None, threads: int = 1) -> Result:
    """Go on with a computation in time that was killed or stopped, from its last checkpoint; without one, start over.

    Args:
        directory: its run folder.
        check: verify the saved steps with the independent checker.
        on_event: called with every event, as by `solve`.
        threads: threads of the linear algebra.

    Returns:
        The Result, as of `solve`.

    Raises:
        InputError: no run folder, a finished run, one that is no computation in time, or one that is still running.
        SceneError: its `scene.toml` cannot be read.
        FreeFEMNotFound: no FreeFEM on this machine.
        FreeFEMError: as `solve`.
    """
    scene = unsteady.check_resumable(Path(directory))
    return solve(scene, directory, check=check, on_event=on_event, threads=threads, resume=True)


def run_chain(
    scene: Scene,
    key_values: Sequence[Mapping[str, float]],
    out: str | Path,
    *,
    check: bool = True,
    draw: Literal["last", "all", "none"] = "last",
    on_event: OnEvent | None = None,
    on_result: OnResult | None = None,
    threads: int = 1,
    resume: bool = False,
) -> list[Result]:
    """Solve many points in one FreeFEM process, each from the solution before it; of a scene in time, one point.

    Every point is checked while FreeFEM computes the next one, and its `result-0001.json` is written at once, so what
    was complete is never lost. A point that fails ends the chain; the ones after it are reported as not reached.

    Args:
        scene: what to solve.
        key_values: per point, the scene's dotted keys and their values. Those that differ between the points must need
            no new mesh.
        out: the run folder.
        check: verify every point with the independent checker.
        draw: write VTU and pictures of the last solved point, of all, or of none.
        on_event: called with every event that the script reports.
        on_result: called with each Result as soon as it is there, from another thread.
        threads: threads of the linear algebra.
        resume: go on with the computation in time in `out`.

    Returns:
        One Result per point.

    Raises:
        InputError: no points, different keys, a key that needs a new mesh, several points in time, or an unusable
            folder.
        SceneError: a value that the scene does not accept.
        FreeFEMNotFound: no FreeFEM on this machine; nothing was written.
    """
    scenes, names = _chain_scenes(scene, key_values)
    installation = find_freefem()
    directory = Path(out)
    points = [_Point(s, directory, i, v) for i, (s, v) in enumerate(zip(scenes, key_values, strict=True), start=1)]
    with folder.held(directory):
        arguments = _start(points[0], installation, resume)
        if not resume:
            folder.write_json(directory / folder.CHAIN, {"points": list(key_values)})
            arguments = _write_points(directory, names, key_values)
        with _Finisher(points, check, draw == "all", on_result) as finisher:
            died = None
            if arguments is not None:
                listener = finisher.listen(on_event)
                died = _execute(scenes[0], directory, installation, arguments, listener, threads)
            results = finisher.finish(died)
        if draw == "last":
            drawn = _draw_last(results)
            if drawn.not_evaluated and on_result is not None:
                on_result(drawn)
        folder.write_json(directory / folder.RESULT, _last(results).data)
    return results


def finish_point(
    scene: Scene, directory: Path, point: int, varied: Mapping[str, float], *, check: bool = True
) -> Result | None:
    """Check a complete point of a chain whose process (or Python) died before that was done, and write its result file.

    Returns:
        The Result, or None if FreeFEM had not finished the point.
    """
    todo = _Point(scene, directory, point, varied)
    if not todo.complete:
        return None
    data = todo.collect(None)
    if check:
        todo.check(data)
    todo.save(data)
    return Result(scene, directory, data)


@dataclass(frozen=True)
class _Point:
    """One point of a run folder on its way from FreeFEM's files to a result file."""

    scene: Scene
    directory: Path
    number: int
    varied: Mapping[str, float]
    alone: bool = False

    @property
    def complete(self) -> bool:
        return self._solved() is not None or self._failed() is not None

    def collect(self, died: FreeFEMError | None) -> dict[str, Any]:
        """Read what FreeFEM wrote about this point, into the shape of `result.json`."""
        state: str | None = None
        solved, failed = self._solved(), self._failed()
        if solved is not None:
            raw, failure, reason = solved, "", ""
            state = folder.numbered("point.bin", self.number)
        elif failed is not None:
            raw, failure, reason = failed, "not-converged", str(failed.get("reason") or "not converged")
            state = folder.FAILED_STATE if (self.directory / folder.FAILED_STATE).is_file() else None
        else:
            raw, (failure, reason) = {}, self._why_missing(died)
        parameters = dict(raw.get("parameters") or self.scene.parameters())
        data = {
            "case": self.scene.name,
            "status": "failed" if failure else "converged",
            "reason": reason,
            "unknowns": raw.get("unknowns"),
            "triangles": raw.get("triangles"),
            "level": raw.get("level", self.scene.mesh.level),
            "quantities": dict(raw.get("quantities") or {}),
            "newton": dict(raw.get("newton") or {}),
            "timings": dict(raw.get("timings") or {}),
            "check": {},
            "freefem": dict(raw.get("freefem") or {}),
            "parameters": parameters,
            "point": self.number,
            "state": state,
            "failure": failure,
            "check_failures": [],
            "not_evaluated": [],
            "warnings": resolution.of_scene(self.scene),
        }
        if not self.alone:
            data["varied"] = dict(self.varied)
        result, notes = Result(self.scene, self.directory, data), data["not_evaluated"]
        if state is not None and not failure:
            walls = attempt(notes, "walls", lambda: result.walls)
            data["quantities"] |= gather(notes, walls.evaluations) if walls is not None else {}
        data |= attempt(notes, "regions and boundaries", lambda: result.domain) or {}
        if self.scene.time is not None:
            attempt(notes, "motion", lambda: unsteady.complete(data, self.scene, self.directory))
            if self.scene.output.wall and (cycles := attempt(notes, "cycles", lambda: result.cycles)):
                data["cycles"] = cycles
                data["quantities"] |= {key: value for key, value in cycles[-1].items() if "_" in key}
        return data

    def check(self, data: dict[str, Any]) -> None:
        """Run the independent checker on a solved point; a mismatch makes it a failed one."""
        if data["failure"] not in ("", unsteady.STOPPED):
            return
        from ffsi.reference import check_run

        begin = time.perf_counter()
        try:
            report = check_run(self.directory, self.scene, point=self.number)
        except Exception as error:  # files or parameters that do not belong to this scene, or whatever stops it
            logger.debug("%s: the check stopped", self.directory, exc_info=True)
            failures, reason = [str(error) or type(error).__name__], "the reference check could not be done"
        else:
            data["check"] = {name: getattr(report, name) for name in CHECKED}
            failures, reason = list(report.failures), "the reference check disagrees"
        data["timings"]["check"] = _seconds(time.perf_counter() - begin)
        if failures:
            data["check_failures"] = failures
            data["status"], data["failure"] = "failed", "check"
            data["reason"] = f"{reason}: {'; '.join(failures)}"
            logger.error("%s: %s", self.directory, data["reason"])

    def draw(self, data: dict[str, Any]) -> None:
        """Write the VTU files and the pictures that the scene asks for; what cannot be done is noted."""
        result, notes = Result(self.scene, self.directory, data), data["not_evaluated"]
        begin = time.perf_counter()
        if self.scene.output.vtu:
            attempt(notes, "VTU", lambda: self._write_vtu(result, notes))
        if data["state"] is None:
            return
        attempt(notes, folder.WALL, lambda: self._write_wall(result))
        written = time.perf_counter()
        data["timings"]["output"] = _seconds(data["timings"].get("output", 0.0) + written - begin)
        if self.scene.output.pictures:
            with _drawing:
                attempt(notes, "pictures", lambda: self._write_pictures(result, notes))
        data["timings"]["pictures"] = _seconds(time.perf_counter() - written)

    def _write_vtu(self, result: Result, notes: Notes) -> None:
        """Write the saved steps, or the last state, with those fields along the walls that can be evaluated."""
        if result.saved_steps:
            steps = (
                (step.step, step.time, result.fields_of(step), gather(notes, result.wall_fields(step.new)))
                for step in result.saved_steps
            )
            vtu.write_series(self.directory, steps)
        if (state := result.state_file) and (not result.saved_steps or result.failure == "not-converged"):
            vtu.write_vtu(self.file("fields.vtu"), result.fields, gather(notes, result.wall_fields(state)))

    def _write_wall(self, result: Result) -> None:
        if (wall := result.wall) is not None:
            folder.write_text(self.file(folder.WALL), wall.to_csv(index=False))

    def _write_pictures(self, result: Result, notes: Notes) -> None:
        from ffsi.report import figures

        for name in figures.available(result.fields):
            png = attempt(notes, f"picture of the {name}", lambda name=name: figures.to_png(result.picture(name)))  # type: ignore[misc]
            if png is not None:
                self.file(f"{name}.png").write_bytes(png)

    def save(self, data: dict[str, Any]) -> None:
        """Write the result file."""
        if not self.alone:
            data["timings"]["total"] = self._chain_seconds(data["timings"])
        folder.write_json(self.file(folder.RESULT), data)

    def _chain_seconds(self, timings: Mapping[str, float]) -> float:
        """Return what this point took: the script's clock since the point before it, and the check."""
        before = self.directory / folder.numbered("point.json", self.number - 1)
        start = folder.read_json(before)["timings"].get("script", 0.0) if before.is_file() else 0.0
        own = max(0.0, timings.get("script", start) - start)
        return _seconds(own + timings.get("check", 0.0))

    def file(self, name: str) -> Path:
        """Return the path of one of this point's own files."""
        return self.directory / (name if self.alone else folder.numbered(name, self.number))

    def _solved(self) -> dict[str, Any] | None:
        return self._read(folder.numbered("point.json", self.number))

    def _failed(self) -> dict[str, Any] | None:
        data = self._read(folder.FAILED)
        return data if data and int(data.get("point", 1)) == self.number else None

    def _read(self, name: str) -> dict[str, Any] | None:
        """Read a file of the script; None if it is missing, half written, or was cut off (a kill, a full disk)."""
        path = self.directory / name
        if not path.is_file():
            return None
        try:
            return folder.read_json(path)
        except InputError as error:
            logger.warning("%s", error)
            return None

    def _why_missing(self, died: FreeFEMError | None) -> tuple[str, str]:
        before = self._read(folder.FAILED)
        if before:
            return (
                "not-reached",
                f"not reached: point {before.get('point')} of the chain failed ({before.get('reason')})",
            )
        return (
            "crash",
            f"FreeFEM died ({died.kind}): {died.message}"
            if died is not None
            else f"FreeFEM did not write point {self.number}",
        )


class _Finisher:
    """Checks the points of a chain in a second thread while FreeFEM goes on."""

    def __init__(self, points: Sequence[_Point], check: bool, draw: bool, on_result: OnResult | None) -> None:
        self.points, self.check, self.draw, self.on_result = points, check, draw, on_result
        self.pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="ffsi-check")
        self.jobs: dict[int, Future[Result]] = {}

    def __enter__(self) -> _Finisher:
        return self

    def __exit__(self, *_: object) -> None:
        self.pool.shutdown(wait=True, cancel_futures=True)

    def listen(self, on_event: OnEvent | None) -> OnEvent:
        """Return a listener that queues each point as soon as the script says that its files are complete."""

        def listener(event: Event) -> None:
            if event.kind == "point":
                self.queue(event.integer("point"))
            if on_event is not None:
                on_event(event)

        return listener

    def queue(self, number: int) -> None:
        """Queue a complete point."""
        if 1 <= number <= len(self.points) and number not in self.jobs:
            self.jobs[number] = self.pool.submit(self._one, self.points[number - 1], None)

    def finish(self, died: FreeFEMError | None) -> list[Result]:
        """Wait for the queued points and treat the rest, whatever became of them."""
        for point in self.points:
            if point.number not in self.jobs:
                self.jobs[point.number] = self.pool.submit(self._one, point, died)
        return [self.jobs[point.number].result() for point in self.points]

    def _one(self, point: _Point, died: FreeFEMError | None) -> Result:
        data = point.collect(died)
        if self.check:
            point.check(data)
        if self.draw:
            point.draw(data)
        point.save(data)
        result = Result(point.scene, point.directory, data)
        if self.on_result is not None:
            self.on_result(result)
        return result


def _execute(
    scene: Scene,
    directory: Path,
    installation: Installation,
    arguments: Mapping[str, str],
    on_event: OnEvent | None,
    threads: int,
) -> FreeFEMError | None:
    """Run the script; return the error if the process died, so that complete points can still be collected."""
    if scene.time is not None:
        on_event = unsteady.Watch(scene, directory, on_event)
    try:
        run_script(
            directory / folder.SCRIPT,
            {"out": str(directory.absolute()), **_mesh_argument(scene, directory), **arguments},
            installation=installation,
            log=directory / folder.LOG,
            cwd=directory,
            on_event=on_event,
            time_limit=scene.solver.time_limit,
            threads=threads,
        )
    except FreeFEMError as error:
        logger.warning("%s: %s", directory, error)
        return error
    return None


def _mesh_argument(scene: Scene, directory: Path) -> Mapping[str, str]:
    return {"mesh": str((directory / folder.MESH_INPUT).absolute())} if scene.geometry.kind == "mesh" else {}


def _start(point: _Point, installation: Installation, resume: bool) -> Mapping[str, str] | None:
    """Prepare a run folder; return the script's arguments, or None if only its files are still to be read."""
    if resume:
        return unsteady.prepare_resume(point.scene, point.directory, point.file(folder.RESULT))
    script = render(point.scene, mumps=installation.has_mumps)
    folder.prepare(point.directory)
    folder.write_text(point.directory / folder.SCRIPT, script)
    folder.write_text(point.directory / folder.SCENE, stored(point.scene, point.directory).to_toml())
    return {}


def _chain_scenes(scene: Scene, key_values: Sequence[Mapping[str, float]]) -> tuple[list[Scene], list[str]]:
    """Return the scene of each point and the keys that vary along the chain."""
    if not key_values:
        raise InputError("a chain needs at least one point")
    keys = list(key_values[0])
    if any(set(values) != set(keys) for values in key_values):
        raise InputError("every point of a chain needs the same keys")
    if scene.time is not None and len(key_values) > 1:
        raise InputError("a scene in time needs a run of its own for every point")
    varying = [key for key in keys if len({values[key] for values in key_values}) > 1]
    scene = scene.settled()  # one script: no default may follow a value that varies
    scenes = [with_values(scene, dict(values)) for values in key_values]
    if fixed := [key for key in varying if not is_runtime_parameter(scenes[0], key)]:
        raise InputError(f"{', '.join(fixed)} cannot change within one chain: it needs another mesh or script")
    return scenes, varying


def _write_points(directory: Path, names: Sequence[str], key_values: Sequence[Mapping[str, float]]) -> dict[str, str]:
    if not names:
        return {}
    lines = [str(len(names)), " ".join(name.replace(".", "_") for name in names), str(len(key_values))]
    lines += [" ".join(repr(values[name]) for name in names) for values in key_values]
    path = directory / folder.POINTS
    folder.write_text(path, "\n".join(lines) + "\n")
    return {"points": str(path.absolute())}


def _draw_last(results: Sequence[Result]) -> Result:
    last = _last(results)
    point = _Point(last.scene, last.directory, last.point, last.data.get("varied", {}))
    point.draw(last.data)
    point.save(last.data)
    return last


def _last(results: Sequence[Result]) -> Result:
    """Return the last solved point, or the last one if none is."""
    solved = [result for result in results if result.solved]
    return solved[-1] if solved else results[-1]


def _seconds(value: float) -> float:
    return round(value, 6)
