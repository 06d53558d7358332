"""A run in time that is to go on beyond its end, or with other values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ffsi.files import folder, seals
from ffsi.files.checkpoints import cut_back
from ffsi.files.errors import InputError
from ffsi.files.manifest import begin, cut_tables, newest_checkpoint
from ffsi.freefem import find_freefem
from ffsi.result.in_time import RESUMABLE, differing
from ffsi.scene import Scene, load_scene, stored, with_values
from ffsi.scene.outlet import PRESSURES
from ffsi.script.render import render

END = "time.end"
CHANGEABLE = (
    *(f"time.{key}" for key in ("end", "stop", "step", "smallest_step", "error")),
    *("time.output_interval", "time.checkpoint_interval", "output.vtu", "output.pictures", "solver.step_tolerance"),
    *("solver.max_iterations", "solver.time_limit", "gravity.x", "gravity.y", "traction.x", "traction.y"),
    *(f"loads.*.{key}" for key in ("traction_x", "traction_y", "pressure", "waveform")),
    *(f"point_forces.*.{key}" for key in ("force_x", "force_y", "waveform")),
    *("inflow.waveform", "inlet.*.waveform", "inlet.*.pressure"),
    *(f"outlet{name}.{key}" for name in ("", ".*") for key in sorted(PRESSURES)),
)
"""What a run that goes on can have another one of: nothing that its states or its history rest on."""


def lengthen(
    directory: Path, values: Mapping[str, Any], refuse: Callable[[Scene], object] | None = None, *, error: bool = False
) -> Scene:
    """Give a run in a folder a later end or other values, so that it can be resumed, and return its scene.

    What was computed after its last checkpoint is removed, as when any run is resumed; without a checkpoint all is,
    where only the end is another one. The scene up to there stays in the folder: the checker judges steps by it.

    Args:
        directory: its run folder; the run is finished, or was stopped or killed.
        values: its new values by dotted key, such as ``{"time.end": 5, "time.step": 0.01}``.
        refuse: called with the scene before anything is changed; what it raises ends the call.
        error: error bars are asked for, which a run with other values on the way has not.

    Raises:
        InputError: no run in time, a failed one, a key that cannot change, an end that is not later, or no checkpoint
            from which on other values could hold; nothing was changed.
        SceneError: a value is not accepted.
        FreeFEMNotFound: no FreeFEM on this machine; nothing was changed.
    """
    if not folder.is_run_folder(directory) or (directory / folder.CHAIN).is_file():
        raise InputError(f"{folder.no_run_folder(directory)}; there is nothing to resume")
    path = str(directory / folder.SCENE)
    before = load_scene(path, [])
    scene = with_values(before, values)
    if before.time is None or scene.time is None:
        raise InputError(f"{directory} holds a steady run; only runs in time can be resumed")
    changed = differing(before.model_dump(), scene.model_dump())
    if fixed := [key for key in changed if not any(fnmatchcase(key, name) for name in CHANGEABLE)]:
        other = f"a run with another one starts from this one with time.initial = '{directory}'"
        raise InputError(f"{fixed[0]} cannot change in a run that goes on; accepted: {', '.join(CHANGEABLE)}; {other}")
    if scene.time.end < before.time.end or not changed:
        raise InputError(f"{END} = {scene.time.end:g} s: must be later than the end of the run, {before.time.end:g} s")
    result = directory / folder.RESULT
    if result.is_file():
        data = folder.read_json(result)
        if wrong := seals.problems(result, data):
            raise InputError(f"{directory} cannot go on: {'; '.join(wrong)}")
        if data.get("failure") and data["failure"] not in RESUMABLE:
            raise InputError(f"the run in {directory} failed: {data.get('reason')}")
    if error:
        refuse_changed(directory, changed)
    if refuse is not None:
        refuse(scene)
    script = render(scene, mumps=find_freefem().has_mumps)
    with folder.held(directory):
        checkpoint = newest_checkpoint(directory)
        if changed.keys() != {END}:
            if checkpoint is None or not scene.time.end > checkpoint.time * (1 + 1e-9):
                text = f"a checkpoint before {END} = {scene.time.end:g} s (time.checkpoint_interval)"
                raise InputError(f"{directory}: other values can only hold from {text} on; there is none")
            earlier = directory / folder.EARLIER.replace("*", f"{checkpoint.step:06d}")
            if not earlier.is_file():
                folder.write_text(earlier, (directory / folder.SCENE).read_text(encoding="utf-8"))
        keep: tuple[str, ...] = (*folder.DEFINITION, folder.LOGS)
        if checkpoint is not None:
            cut_tables(directory, checkpoint.step)
            cut_back(directory, checkpoint.step)
            keep = (*keep, *folder.IN_TIME, folder.HISTORY, folder.MESH)
        folder.clear(directory, keep=keep)
        folder.write_text(directory / folder.SCRIPT, script)
        folder.write_text(directory / folder.SCENE, stored(scene, directory).to_toml())
        if checkpoint is not None:
            begin(directory, checkpoint)
    return load_scene(path, [])


def refuse_changed(directory: Path, changed: Iterable[str] = ()) -> None:
    """Refuse error bars where values, by key, were changed on the way or are to be; the end may be another one."""
    if {*changed} - {END} or any(directory.glob(folder.EARLIER)):
        raise InputError(f"error: the run in {directory} was changed; accepted: one with the same values all the time")
