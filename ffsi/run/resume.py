"""How a computation in time that was killed or stopped goes on."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from ffsi.files import folder, seals
from ffsi.files.checkpoints import Checkpoint, cut_back, keep_checkpoint
from ffsi.files.errors import InputError
from ffsi.files.manifest import begin, cut_tables, has_ended, newest_checkpoint
from ffsi.result.in_time import RESUMABLE
from ffsi.scene import Scene, load_scene

logger = logging.getLogger(__name__)


def check_resumable(directory: Path) -> Scene:
    """Return the scene of a run that can go on; writes nothing.

    Raises:
        InputError: no run folder, a sweep or a part of one, a steady run, or a finished one.
        SceneError: its `scene.toml` cannot be read.
    """
    if folder.is_sweep_folder(directory) or (directory / folder.CHAIN).is_file():
        raise InputError(f"{directory} belongs to a sweep; the same call of ffsi sweep goes on with it")
    if not folder.is_run_folder(directory):
        raise InputError(f"{folder.no_run_folder(directory)}; there is nothing to resume")
    scene = load_scene(str(directory / folder.SCENE), [])
    _refuse_finished(scene, directory, directory / folder.RESULT)
    return scene


def _refuse_finished(scene: Scene, directory: Path, result: Path) -> None:
    if scene.time is None:
        raise InputError(f"{directory} holds a steady run; only runs in time can be resumed")
    if not result.is_file():
        return
    try:
        data = folder.read_json(result)
        wrong = seals.problems(result, data)
    except InputError as error:
        wrong = [str(error)]
    if wrong:  # the record tells what of the run can be believed
        logger.warning("%s: %s; its result is made again", directory, "; ".join(wrong))
    elif data.get("failure", "") not in RESUMABLE:
        ending = "converged" if not data.get("failure") else f"failed: {data.get('reason')}"
        raise InputError(f"the run in {directory} is finished ({ending}); there is nothing to resume")


def prepare_resume(scene: Scene, directory: Path, result: Path, script: str) -> Mapping[str, str] | None:
    """Bring a folder into the state in which its script can go on.

    Everything after the newest checkpoint that its record covers is removed; without one, everything.

    Args:
        scene: what to solve; that of the folder.
        directory: the run folder.
        result: the result file of a run that has ended, if it is there.
        script: the text of the scene's script; nothing else is run.

    Returns:
        The script's arguments; None if the script had ended and only its files have to be read.

    Raises:
        InputError: the run is finished, steady or one of another scene or script, or it was changed.
    """
    if load_scene(str(directory / folder.SCENE), []) != scene:
        raise InputError(
            f"{directory} holds a run of another scene; give another folder, or the scene in {folder.SCENE}"
        )
    _refuse_finished(scene, directory, result)
    _refuse_other_script(directory, script)
    if has_ended(directory) and not _ends_early(result):
        logger.info("%s: the computation is complete, only its evaluation is done again", directory)
        return None
    checkpoint = newest_checkpoint(directory)
    folder.keep_log(directory)
    if checkpoint is None:
        logger.info("%s: no checkpoint is complete, starting over from t = 0 s", directory)
        folder.clear(directory, keep=(*folder.DEFINITION, folder.LOGS))
        return {}
    folder.clear(directory, keep=(*folder.DEFINITION, folder.LOGS, *folder.IN_TIME, folder.HISTORY, folder.MESH))
    cut_tables(directory, checkpoint.step)
    cut_back(directory, checkpoint.step)
    folder.write_text(directory / folder.STOP, folder.GO_ON)
    kept = keep_checkpoint(checkpoint)
    begin(directory, Checkpoint(kept, checkpoint.step, checkpoint.time))
    logger.info("%s: going on from t = %g s", directory, checkpoint.time)
    return {"resume": str(kept.absolute())}


def _refuse_other_script(directory: Path, script: str) -> None:
    """Refuse to run a script that this program would not write for the scene: it can do anything."""
    path = directory / folder.SCRIPT
    if path.is_file() and path.read_bytes() == script.encode("utf-8"):
        return
    raise InputError(
        f"{path} is not the script of {folder.SCENE}: it was changed, or another version of ffsi (or a FreeFEM with "
        f"other solvers) has written it. Nothing was run; to start anew: ffsi run {directory / folder.SCENE} "
        "--out OTHER_FOLDER"
    )


def _ends_early(result: Path) -> bool:
    """Return whether a result says that the run was asked to stop, or died."""
    try:
        return result.is_file() and folder.read_json(result).get("failure") in RESUMABLE
    except InputError:
        return False
