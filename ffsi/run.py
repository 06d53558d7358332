"""From a scene to a Result: render, run FreeFEM, check, draw, write `result.json`; and go on with a run in time."""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Literal

from ffsi import folder, seals, unsteady
from ffsi.folder import InputError
from ffsi.freefem import Event, FreeFEMError, Installation, find_freefem, run_script
from ffsi.point import Point, seconds
from ffsi.render import is_runtime_parameter, render
from ffsi.result import Result
from ffsi.scene import Scene, stored, with_values

logger = logging.getLogger(__name__)

OnEvent = Callable[[Event], None]
OnResult = Callable[[Result], None]


def solve(
    scene: Scene,
    out: str | Path | None = None,
    *,
    check: bool = True,
    on_event: OnEvent | None = None,
    threads: int = 1,
    resume: bool = False,
    animate: str | None = None,
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
        animate: `velocity`, `pressure` or `displacement`, of which the saved steps become a GIF.

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
    point = Point(scene, directory, 1, {}, alone=True)
    with folder.held(directory):
        arguments = _start(point, installation, resume)
        died = None if arguments is None else _execute(scene, directory, installation, arguments, on_event, threads)
        data = point.judged(died, check)
        point.draw(data)
        if animate is not None:
            point.animate(data, animate)
        data["timings"]["total"] = seconds(time.perf_counter() - begin)
        data = point.save(data)
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
    points = [
        Point(s, directory, i, v, followed=i < len(scenes))
        for i, (s, v) in enumerate(zip(scenes, key_values, strict=True), start=1)
    ]
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
        seals.write(directory / folder.RESULT, _last(results).data)
    return results


def finish_point(
    scene: Scene, directory: Path, point: int, varied: Mapping[str, float], *, check: bool = True
) -> Result | None:
    """Check a complete point of a chain whose process (or Python) died before that was done, and write its result file.

    Returns:
        The Result, or None if FreeFEM had not finished the point.
    """
    todo = Point(scene, directory, point, varied)
    if not todo.complete:
        return None
    return Result(scene, directory, todo.save(todo.judged(None, check)))


class _Finisher:
    """Checks the points of a chain in a second thread while FreeFEM goes on."""

    def __init__(self, points: Sequence[Point], check: bool, draw: bool, on_result: OnResult | None) -> None:
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

    def _one(self, point: Point, died: FreeFEMError | None) -> Result:
        data = point.judged(died, self.check)
        if self.draw:
            point.draw(data)
        result = Result(point.scene, point.directory, point.save(data))
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
    watch = unsteady.Watch(scene, directory, on_event) if scene.time is not None else None
    try:
        run_script(
            directory / folder.SCRIPT,
            {"out": str(directory.absolute()), **_mesh_argument(scene, directory), **arguments},
            installation=installation,
            log=directory / folder.LOG,
            cwd=directory,
            on_event=watch or on_event,
            time_limit=scene.solver.time_limit,
            threads=threads,
        )
    except FreeFEMError as error:
        logger.warning("%s: %s", directory, error)
        return error
    finally:
        if watch is not None:
            watch.record.close()
    return None


def _mesh_argument(scene: Scene, directory: Path) -> Mapping[str, str]:
    return {"mesh": str((directory / folder.MESH_INPUT).absolute())} if scene.geometry.kind == "mesh" else {}


def _start(point: Point, installation: Installation, resume: bool) -> Mapping[str, str] | None:
    """Prepare a run folder; return the script's arguments, or None if only its files are still to be read."""
    script = render(point.scene, mumps=installation.has_mumps)
    if resume:
        return unsteady.prepare_resume(point.scene, point.directory, point.file(folder.RESULT), script)
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
    point = Point(last.scene, last.directory, last.point, last.data.get("varied", {}))
    point.draw(last.data)
    last.data.update(point.save(last.data))
    return last


def _last(results: Sequence[Result]) -> Result:
    """Return the last solved point, or the last one if none is."""
    solved = [result for result in results if result.solved]
    return solved[-1] if solved else results[-1]
