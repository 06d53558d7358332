"""Solved points kept by their content, for studies that share them: what was computed once is never solved again."""

from __future__ import annotations

import hashlib
import logging
import shutil
import tempfile
from pathlib import Path

from ffsi.files import folder, machine
from ffsi.files.arguments import path_of
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result
from ffsi.result.study_definition import Values
from ffsi.run.point import finish_point
from ffsi.scene import MeshGeometry, Scene, stored, with_values
from ffsi.script.render import render

logger = logging.getLogger(__name__)

_OWN = (folder.RESULT, "result-*.json", folder.CHAIN, folder.SCENE, folder.POINTS, folder.MANIFEST, folder.STOP)
"""Files that belong to the study and not to the point."""


class Cache:
    """A folder with the script's files of solved and checked points, each in a folder named by its content.

    The content is the script as it is rendered for the point, with all its numbers, the mesh of the user's own, and in
    time when it stops, which the script does not know.
    What comes from here is checked like what has just been solved.
    """

    def __init__(self, directory: str | Path) -> None:
        """Use a folder; it is made when the first point is kept.

        Raises:
            InputError: it is no folder.
        """
        self.directory = path_of(directory, "cache").absolute()
        if self.directory.exists() and not self.directory.is_dir():
            raise InputError(f"cache = {str(directory)!r} is a file; accepted: a folder")

    def knows(self, scene: Scene, values: Values) -> bool:
        """Return whether a point is there."""
        return self._place(with_values(scene, values)).is_dir()

    def copy(self, scene: Scene, values: Values, chain: Path) -> Result | None:
        """Make a chain of one point from what is kept, in an empty folder, and check it.

        What is damaged there is taken out of the cache, and nothing is returned: the chain is of no use then.
        """
        scene = with_values(scene, values)
        place, made, problem = self._place(scene), None, "it is not complete"
        with folder.held(chain):
            try:
                for path in place.iterdir():
                    shutil.copyfile(path, chain / path.name)
                folder.write_text(chain / folder.SCENE, stored(scene, chain).to_toml())
                folder.write_json(chain / folder.CHAIN, {"points": [values]})
                made = finish_point(scene, chain, 1, values)
            except (ValueError, OSError) as error:
                if machine.ended(error):
                    raise
                problem = machine.words(error)
            if made is not None and not made.failure:
                return made
            logger.warning("%s: %s; it is taken out of the cache", place, made.reason if made is not None else problem)
            shutil.rmtree(place, ignore_errors=True)
        return None

    def keep(self, result: Result) -> None:
        """Keep the files of a point that was solved and checked, unless they are there."""
        place, new = self._place(result.scene), None
        if result.failure or not result.checked or place.exists():
            return
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            new = Path(tempfile.mkdtemp(prefix=".new-", dir=self.directory))
            for path in result.directory.iterdir():
                if path.is_file() and (name := _kept(path, result)) is not None:
                    shutil.copyfile(path, new / name)
            if result.scene.time is None:
                _renumber(new, result.point)
            new.rename(place)
        except OSError as error:  # a full disk, or another study has kept it meanwhile
            if not place.exists():
                logger.warning("%s is not kept in the cache: %s", result.file, error)
            if new is not None:
                shutil.rmtree(new, ignore_errors=True)

    def _place(self, scene: Scene) -> Path:
        mesh = scene.geometry.digest if isinstance(scene.geometry, MeshGeometry) else ""
        stop = scene.time.stop if scene.time and scene.time.stop != "end" else ""
        return self.directory / hashlib.sha256(f"{render(scene)}{mesh}{stop}".encode()).hexdigest()


def _kept(path: Path, result: Result) -> str | None:
    """Return the name under which a file is kept; None for one that does not belong to the point."""
    if any(path.match(pattern) for pattern in _OWN):
        return None
    if result.scene.time is not None:
        return path.name
    own = {folder.numbered(name, result.point): folder.numbered(name, 1) for name in (folder.POINT, folder.STATE)}
    same = (folder.SCRIPT, folder.LOG, folder.HISTORY, folder.MESH, folder.MESH_INPUT)
    return own.get(path.name, path.name if path.name in same else None)


def _renumber(directory: Path, point: int) -> None:
    """Make a point of a chain the first of its folder: in the script's file of it, and in Newton's history."""
    import pandas as pd

    path = directory / folder.numbered(folder.POINT, 1)
    folder.write_json(path, folder.read_json(path) | {"point": 1})
    history = pd.read_csv(directory / folder.HISTORY, dtype=str)
    rows = history[history["point"] == str(point)].assign(point="1")
    folder.write_text(directory / folder.HISTORY, rows.to_csv(index=False))
