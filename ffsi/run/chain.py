"""Many points in one FreeFEM process, each from the solution before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Literal

from ffsi.files import folder, seals
from ffsi.files.errors import InputError
from ffsi.freefem import Event, FreeFEMError, find_freefem
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result
from ffsi.run.execute import execute, start
from ffsi.run.point import Point
from ffsi.scene import Scene, with_values
from ffsi.scene.lookup import Scalar
from ffsi.script.render import is_runtime_parameter

OnResult = Callable[[Result], None]


def run_chain(
    scene: Scene,
    key_values: Sequence[Mapping[str, Scalar]],
    out: str | Path,
    *,
    check: bool = True,
    draw: Literal["last", "all", "none"] = "last",
    on_event: OnEvent | None = None,
    on_result: OnResult | None = None,
    resume: bool = False,
    asked: Sequence[str] = (),
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
        resume: go on with the computation in time in `out`.
        asked: what the script is asked for besides, of `sensitivities` and `error`.

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
        arguments = start(points[0], installation, resume)
        if not resume:
            folder.write_json(directory / folder.CHAIN, {"points": list(key_values)})
            arguments = {**_write_points(directory, names, key_values), **dict.fromkeys(asked, "1")}
        with _Finisher(points, check, draw == "all", on_result) as finisher:
            if draw != "none" and scene.output.pictures:  # loaded while the script makes its mesh, not at the end
                finisher.pool.submit(import_module, "ffsi.result.pictures")
            died = None
            if arguments is not None:
                listener = finisher.listen(on_event)
                died = execute(scenes[0], directory, installation, arguments, listener)
            results = finisher.finish(died)
        if draw == "last":
            drawn = _draw_last(results)
            if drawn.not_evaluated and on_result is not None:
                on_result(drawn)
        seals.write(directory / folder.RESULT, _last(results).data)
    return results


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


def _chain_scenes(scene: Scene, key_values: Sequence[Mapping[str, Scalar]]) -> tuple[list[Scene], list[str]]:
    """Return the scene of each point and the keys that vary along the chain."""
    if not key_values:
        raise InputError("a chain needs at least one point")
    keys = list(key_values[0])
    if any(set(values) != set(keys) for values in key_values):
        raise InputError("every point of a chain needs the same keys")
    if scene.time is not None and len(key_values) > 1:
        raise InputError("a scene in time needs a run of its own for every point")
    varying = [key for key in keys if len({values[key] for values in key_values}) > 1]
    scenes = [with_values(scene, dict(values)) for values in key_values]
    one = all(each.formulations == scenes[0].formulations for each in scenes)
    if fixed := [key for key in varying if not one or not is_runtime_parameter(scenes[0], key)]:
        raise InputError(f"{', '.join(fixed)} cannot change within one chain: it needs another mesh or script")
    return scenes, varying


def _write_points(directory: Path, names: Sequence[str], key_values: Sequence[Mapping[str, Scalar]]) -> dict[str, str]:
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
