"""What earlier calls have left in the chains of a sweep: what can be believed of it, and what is made again."""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from ffsi.files import folder, seals
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result, load_result
from ffsi.result.study_definition import Values
from ffsi.run.point import finish_point
from ffsi.scene import Scene, with_values

logger = logging.getLogger(__name__)


def chains_of(directory: Path) -> list[Path]:
    """Return the folders of a sweep's chains, in order."""
    found = [path for path in directory.glob("chain-*") if re.fullmatch(r"chain-[0-9]{3,9}", path.name)]
    return sorted((path for path in found if path.is_dir()), key=lambda path: int(path.name[6:]))


def harvest(scene: Scene, chain: Path, keys: Sequence[str], *, check: bool = True) -> list[Result]:
    """Collect what earlier calls left in a chain of a sweep.

    Complete points that nobody checked are checked now. What is damaged, or was changed, is taken out, with a warning:
    the sweep solves it again, unless the result alone is damaged and can be made again from the script's files.
    """
    try:
        with folder.held(chain):
            return list(_harvest(scene, chain, keys, check))
    except InputError as error:  # another ffsi is at work there, or it is no run folder any more
        logger.warning("%s", error)
        return []


def _harvest(scene: Scene, chain: Path, keys: Sequence[str], check: bool) -> Iterator[Result]:
    try:
        known = points_of(chain, keys)
    except InputError as error:
        logger.warning("%s; its points are solved again", error)
        folder.clear(chain)
        with contextlib.suppress(OSError):  # files of somebody else stay
            chain.rmdir()
        return
    for number, values in enumerate(known, start=1):
        result = _point(scene, chain, number, values, check)
        if result is not None:
            yield result


def _point(scene: Scene, chain: Path, number: int, values: Values, check: bool) -> Result | None:
    """Return a point as far as it can be believed, and checked if it has to be."""
    path = chain / folder.numbered(folder.RESULT, number)
    if not path.is_file():
        if scene.time is not None:  # its record tells what there is, when it goes on
            return None
        made = _finish(scene, chain, number, values, check)
        if made is not None and made.failure == "check":
            return _discard(scene, chain, number)
        return made
    try:
        result = load_result(chain, number)
        if "digest" not in result.data or result.data.get("varied") != values:
            raise InputError(f"{path} carries no checksum, or belongs to another point")
    except ValueError as error:  # also of the scene
        logger.warning("%s. The point is made again", error)
        alone = scene.time is None and not _is_whole(path)  # the script's files are what they were
        path.unlink()
        made = _finish(scene, chain, number, values, check) if alone else None
        return made if made is not None and made.checked else _discard(scene, chain, number)
    if result.failure or result.checked or not check:
        return result
    return finish_point(result.scene, chain, number, values)


def _finish(scene: Scene, chain: Path, number: int, values: Values, check: bool) -> Result | None:
    try:
        return finish_point(with_values(scene, values), chain, number, values, check=check)
    except ValueError as error:  # cut off while FreeFEM was writing it
        logger.warning("%s", error)
        return None


def _is_whole(path: Path) -> bool:
    """Return whether a result file itself is what was written, whatever became of the files that it seals."""
    try:
        return not seals.problems(path, {**folder.read_json(path), "files": {}})
    except InputError:
        return False


def _discard(scene: Scene, chain: Path, number: int) -> Result | None:
    """Take a point out of a chain; of one in time the record and the script's files stay, to go on from."""
    names = [folder.numbered(folder.RESULT, number)]
    if scene.time is None:
        names += [folder.numbered(name, number) for name in (folder.STATE, folder.POINT)]
        with contextlib.suppress(InputError):
            if folder.read_json(chain / folder.FAILED).get("point") == number:
                names += [folder.FAILED, folder.FAILED_STATE]
    for name in names:
        (chain / name).unlink(missing_ok=True)
    return None


def points_of(chain: Path, keys: Sequence[str]) -> list[Values]:
    """Return the points of a chain.

    Raises:
        InputError: `chain.json` is damaged, or has points of another sweep.
    """
    path = chain / folder.CHAIN
    known = folder.read_json(path).get("points")
    if not isinstance(known, list) or not known:
        raise InputError(f"{path} is damaged: it names no points")
    if any(not isinstance(values, dict) or not set(values) <= set(keys) for values in known):
        raise InputError(f"{path} is damaged: its points are not those of the sweep")
    return known
