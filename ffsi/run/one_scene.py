"""From a scene to a Result: render, run FreeFEM, check, draw, write `result.json`; and go on with a run in time."""

from __future__ import annotations

import logging
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ffsi.files import folder
from ffsi.files.arguments import path_of
from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMError, find_freefem
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result, load_result
from ffsi.run import beside
from ffsi.run.adaptation import asked_of
from ffsi.run.execute import execute, start
from ffsi.run.longer import END, lengthen, refuse_changed
from ffsi.run.point import Point, seconds
from ffsi.run.resume import check_resumable
from ffsi.scene import Scene, scene_of, with_values
from ffsi.scene.numerics import FURTHEST

logger = logging.getLogger(__name__)
MUCH_BACKFLOW = 20
"""Percent of what passes the outlets, coming back, from which on that is what a run in time failed for."""
STABLE_BACKFLOW = 0.5


def solve(
    scene: Scene | str | Path,
    out: str | Path | None = None,
    *,
    check: bool = True,
    on_event: OnEvent | None = None,
    resume: bool = False,
    animate: str | None = None,
    sensitivities: bool = False,
    error: bool = False,
    adapt: Sequence[str] = (),
    tolerance: float | str | None = None,
    unknowns: int | None = None,
) -> Result:
    """Solve one scene and leave its run folder behind.

    A scene in time with `time.stop = "periodic"` ends as soon as its motion is periodic. Quantities of such a scene are
    mean, amplitude and frequency over the last period.

    Args:
        scene: what to solve: a scene, the name of a case, or the path of a TOML file.
        out: the run folder; an earlier run in it is replaced. None: a temporary folder that lives as long as the
            Result.
        check: verify the solution with the independent checker; a mismatch makes the status `failed`.
        on_event: called with every event that the script reports; in time also with `signal` (see `watch.Watch`).
        resume: go on with the computation in time in `out`, which was killed or stopped, from its last checkpoint.
        animate: `velocity`, `pressure` or `displacement`, of which the saved steps become a GIF.
        sensitivities: of a steady scene, also the derivatives of its quantities by its numbers, into
            `data["sensitivities"]`: by quantity, then key, `derivative` (SI) and `logarithmic`.
        error: also estimates of what the mesh, and in time the step, adds to the quantities, and error bars, into
            `data["errors"]` (docs/numerics.md). In time two more runs beside this one, in folders of `out`.
        adapt: of a steady scene, the quantities that the mesh is made for: from that of level 0 on it is made again
            where their errors come from, until the tolerance is met or the unknowns are used up. With `error`; the
            meshes are in `data["adaptation"]`.
        tolerance: of each of them, relative, as 1e-3 or "0.1%".
        unknowns: the most that the mesh may have, at least those of level 0; 60 000 where only a tolerance is given.

    Returns:
        The Result; a scene that does not converge is a Result with status `failed`, not an exception.

    Raises:
        SceneError: there is no such case or file, or it is no valid scene.
        InputError: `out` cannot be used, or with `resume` holds nothing to go on with; an argument is not accepted.
        FreeFEMNotFound: no FreeFEM on this machine; nothing was written.
        FreeFEMError: the process died or took longer than `solver.time_limit`; `result.json` says so.
    """
    begin = time.perf_counter()
    scene = scene_of(scene)
    target = None if out is None else path_of(out, "out")
    if animate is not None and animate not in folder.PICTURES:
        raise InputError(f"animate = {animate!r}: accepted: {', '.join(folder.PICTURES)}")
    if on_event is not None and not callable(on_event):
        raise InputError(f"on_event = {on_event!r}: accepted: a function that takes an event")
    if target is not None and folder.is_sweep_folder(target.parent) and (target / folder.CHAIN).is_file():
        raise InputError(f"{target} is a piece of the sweep {target.parent}; give another folder")
    named = [name for name, wanted in (("sensitivities", sensitivities), ("error", error)) if wanted]
    if sensitivities and scene.time is not None:
        raise InputError(f"sensitivities: {scene.name} is a scene in time; accepted: steady ones")
    others = beside.scenes_beside(scene) if error and scene.time is not None else {}
    scene, asked = asked_of(scene, adapt, tolerance, unknowns)
    if asked and sensitivities:
        raise InputError("give either adapt or sensitivities, not both")
    if resume:
        if target is None:
            raise InputError("to resume a run its folder is needed")
        check_resumable(target)
        if others:
            refuse_changed(target)
    installation, notes = find_freefem(), list[str]()
    temporary = tempfile.TemporaryDirectory(prefix=f"ffsi-{scene.name}-") if target is None else None
    directory = target or Path(temporary.name if temporary else "")
    point = Point(scene, directory, 1, {}, alone=True)

    def run_beside(other: Scene, name: str) -> Result:
        at = directory / name  # that of an earlier end is no longer beside
        go_on = resume and folder.is_run_folder(at) and scene_of(at / folder.SCENE) == other
        if go_on and (at / folder.RESULT).is_file() and not folder.read_json(at / folder.RESULT).get("failure"):
            return load_result(at)
        return solve(other, at, check=check, resume=go_on)

    with folder.held(directory):
        arguments = start(point, installation, resume)
        with beside.running(directory, others, run_beside, resume) as runs:
            asked = {**asked, **(dict.fromkeys(named, "1") if scene.steady else {})}
            died = None
            if arguments is not None:
                died = execute(scene, directory, installation, {**arguments, **asked}, on_event)
            data = point.judged(died, check)
            while not resume and (changes := _what_goes_further(scene, data)):
                said = ", ".join(f"{key} = {value}" for key, value in changes.items())
                note = f"started again with {said}: {data['reason']}"
                notes.append(note)
                logger.warning("%s: %s", directory, note)
                scene = with_values(scene, changes)
                point = Point(scene, directory, 1, {}, alone=True)
                start(point, installation, resume=False)
                died = execute(scene, directory, installation, asked, on_event)
                data = point.judged(died, check)
            data["warnings"] += notes
            if runs:
                beside.complete(data, scene, directory, runs)
        point.draw(data)
        if animate is not None:
            point.animate(data, animate)
        data["timings"]["total"] = seconds(time.perf_counter() - begin)
        data = point.save(data)
    if data["failure"] == "crash":
        raise died or FreeFEMError("crash", data["reason"], log=directory / folder.LOG)
    return Result(scene, directory, data, temporary)


def _what_goes_further(scene: Scene, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the scene leaves to the program and a run failed for.

    That is the solver where MUMPS put off too many pivots; in time the mesh's motion, then the outlets.
    """
    motion, reason = scene.mesh_motion, data["reason"] or ""
    if "MUMPS error -9" in reason and scene.solver.linear_solver == "mumps":
        return {"solver.linear_solver": "umfpack"}
    if scene.time is None:
        return {}
    chosen = motion is None or not motion.law.linear or "kind" in motion.model_fields_set
    if not chosen and "the fluid mesh folds" in reason:
        return {"mesh_motion.kind": FURTHEST}
    back = re.search(r"comes back through the outlet, (\d+) %", reason)
    if back is None or int(back[1]) < MUCH_BACKFLOW:
        return {}
    tables = (
        {"outlet": scene.only_outlet} if scene.only_outlet else {f"outlet.{k}": v for k, v in scene.outlets.items()}
    )
    return {f"{key}.backflow": STABLE_BACKFLOW for key, table in tables.items() if table.backflow is None}


def resume(
    directory: str | Path,
    *,
    end: float | str | None = None,
    values: Mapping[str, Any] | None = None,
    check: bool = True,
    on_event: OnEvent | None = None,
) -> Result:
    """Go on with a computation in time that was killed or stopped, from its last checkpoint; without one, start over.

    Args:
        directory: its run folder.
        end: another, later end, a number in s or a text with a unit; a finished run goes on, too.
        values: what is another one from that checkpoint on, by dotted key, such as `{"time.step": 0.005}`: steps,
            output, and the numbers and waveforms of loads, openings and gravity (docs/formats.md).
        check: verify the saved steps with the independent checker.
        on_event: called with every event, as by `solve`.

    Returns:
        The Result, as of `solve`.

    Raises:
        InputError: no run folder, a finished run, one that is no computation in time, or one that is still running;
            a value that cannot change.
        SceneError: its `scene.toml` cannot be read.
        FreeFEMNotFound: no FreeFEM on this machine.
        FreeFEMError: as `solve`.
    """
    folder_of_run = path_of(directory, "directory")
    changed = {**({} if end is None else {END: end}), **(values or {})}
    scene = lengthen(folder_of_run, changed) if changed else check_resumable(folder_of_run)
    return solve(scene, directory, check=check, on_event=on_event, resume=True)
