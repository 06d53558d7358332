"""A run in time that is to go on beyond its end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ffsi.files import folder, seals
from ffsi.files.checkpoints import cut_back
from ffsi.files.errors import InputError
from ffsi.files.manifest import begin, cut_tables, newest_checkpoint
from ffsi.freefem import find_freefem
from ffsi.result.in_time import RESUMABLE
from ffsi.scene import Scene, load_scene, stored
from ffsi.script.render import render

END = "time.end"


def lengthen(directory: Path, settings: Sequence[str]) -> Scene:
    """Give a run in a folder a later end, so that it can be resumed, and return its scene.

    What was computed after its last checkpoint is removed, as when any run is resumed; without a checkpoint all is.

    Args:
        directory: its run folder; the run is finished, or was stopped or killed.
        settings: its new end, such as ``["time.end=5"]``.

    Raises:
        InputError: no run in time, a failed one, another key, or an end that is not later; nothing was changed.
        SceneError: the end is no time.
        FreeFEMNotFound: no FreeFEM on this machine; nothing was changed.
    """
    if [setting.partition("=")[0].strip() for setting in settings] != [END]:
        other = f"a run with other values starts from this one with time.initial = '{directory}'"
        raise InputError(f"with --resume only {END} can change: give --set {END}=SECONDS; {other}")
    if not folder.is_run_folder(directory) or (directory / folder.CHAIN).is_file():
        raise InputError(f"{folder.no_run_folder(directory)}; there is nothing to resume")
    path = str(directory / folder.SCENE)
    before, scene = load_scene(path, []), load_scene(path, settings)
    if before.time is None or scene.time is None:
        raise InputError(f"{directory} holds a steady run; only runs in time can be resumed")
    if not scene.time.end > before.time.end:
        raise InputError(f"{END} = {scene.time.end:g} s: must be later than the end of the run, {before.time.end:g} s")
    result = directory / folder.RESULT
    if result.is_file():
        data = folder.read_json(result)
        if wrong := seals.problems(result, data):
            raise InputError(f"{directory} cannot go on: {'; '.join(wrong)}")
        if data.get("failure") and data["failure"] not in RESUMABLE:
            raise InputError(f"the run in {directory} failed: {data.get('reason')}")
    script = render(scene, mumps=find_freefem().has_mumps)
    with folder.held(directory):
        checkpoint = newest_checkpoint(directory)
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
