"""The script of a run folder: written there, started, watched."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

from ffsi.files import folder
from ffsi.freefem import FreeFEMError, Installation, run_script
from ffsi.freefem.events import OnEvent
from ffsi.run.point import Point
from ffsi.run.resume import prepare_resume
from ffsi.run.watch import Watch
from ffsi.scene import Scene, stored
from ffsi.script.render import render

logger = logging.getLogger(__name__)


def execute(
    scene: Scene,
    directory: Path,
    installation: Installation,
    arguments: Mapping[str, str],
    on_event: OnEvent | None,
) -> FreeFEMError | None:
    """Run the script; return the error if the process died, so that complete points can still be collected."""
    watch = Watch(scene, directory, on_event) if scene.time is not None else None
    try:
        run_script(
            directory / folder.SCRIPT,
            {"out": str(directory.absolute()), **_mesh_argument(scene, directory), **arguments},
            installation=installation,
            log=directory / folder.LOG,
            cwd=directory,
            on_event=watch or on_event,
            time_limit=scene.solver.time_limit,
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


def start(point: Point, installation: Installation, resume: bool) -> Mapping[str, str] | None:
    """Prepare a run folder; return the script's arguments, or None if only its files are still to be read."""
    script = render(point.scene, mumps=installation.has_mumps)
    if resume:
        return prepare_resume(point.scene, point.directory, point.file(folder.RESULT), script)
    folder.prepare(point.directory)
    folder.write_text(point.directory / folder.SCRIPT, script)
    folder.write_text(point.directory / folder.SCENE, stored(point.scene, point.directory).to_toml())
    return {}
