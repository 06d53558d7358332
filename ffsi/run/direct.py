"""The folder of a script that was run directly, without Python: made a run folder, and checked."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ffsi.files import folder
from ffsi.files.arguments import path_of
from ffsi.files.errors import InputError
from ffsi.files.json_types import read_table
from ffsi.hemodynamics.result import Result
from ffsi.hemodynamics.result import load_result as load_finished
from ffsi.run.point import Point
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values
from ffsi.script.render import parameters

_POINTS = folder.numbered(folder.POINT, 0).replace("0000", "[0-9]*")


def load_result(directory: str | Path, point: int | None = None) -> Result:
    """Read a run folder, also that of a script which was run directly: it is checked first.

    Args:
        directory: what `ffsi run --out`, `ffsi.solve` or a script has written, or one chain of a sweep.
        point: which point of a chain; by default the last one.

    Raises:
        InputError: the folder or the point is not there, or its files are damaged, or were changed after the run.
        SceneError: its `scene.toml` cannot be read.
    """
    adopt(path_of(directory, "directory"))
    return load_finished(directory, point)


def adopt(directory: Path) -> None:
    """Check what a script left in a folder of its own, and write the results; any other folder stays as it is.

    The scene is that of the catalogue with the script's name and numbers; another scene is needed as `scene.toml`.

    Raises:
        InputError: the scene is not known or is another one, or a file is damaged.
    """
    if not directory.is_dir() or any((directory / name).exists() for name in (folder.SCRIPT, folder.SWEEP)):
        return
    written = _written(directory)
    if not written or not (directory / folder.MESH).is_file() or _is_judged(directory, written):
        return
    outcomes = [read_table(path) for path in written]
    folder.check_writable(directory)
    numbers = [outcome.get("parameters") or {} for outcome in outcomes]
    names = [key for key in numbers[0] if any(each.get(key) != numbers[0][key] for each in numbers)]
    scenes = [_scene(directory, str(outcome.get("case")), own) for outcome, own in zip(outcomes, numbers, strict=True)]
    varied = [{key: own[key] for key in names if key in own} for own in numbers]
    alone = len(outcomes) == 1
    if not (own := directory / folder.SCENE).is_file() or load_scene(own) != scenes[0]:  # else as its author wrote it
        folder.write_text(own, scenes[0].to_toml())
    for pattern in (folder.CHAIN, folder.RESULT, folder.RESULT.replace(".", "-*.")):  # of an earlier run of the script
        for path in directory.glob(pattern):
            path.unlink()
    for i, (scene, values) in enumerate(zip(scenes, varied, strict=True), start=1):
        point = Point(scene, directory, i, values, alone=alone, followed=i < len(scenes))
        data = point.judged(None, check=True)
        point.draw(data)
        point.save(data)
    if not alone:
        folder.write_json(directory / folder.CHAIN, {"points": varied})


def _written(directory: Path) -> list[Path]:
    """Return the files of the points; raises InputError where one is of two runs of the script."""
    points, failed = sorted(directory.glob(_POINTS)), directory / folder.FAILED
    if not failed.is_file():
        return points
    number = read_table(failed).get("point", len(points) + 1)
    before = [path for path in points if int(path.stem.rpartition("-")[2]) < number]
    if len(before) == len(points):
        return [*points, failed]
    if points[len(before)].stat().st_mtime_ns > failed.stat().st_mtime_ns:  # solved since
        return points
    raise InputError(
        f"{directory}: a run of the script failed at point {number}, which an earlier one solved; files of both lie "
        "there: let each write into a folder of its own (-out)"
    )


def _is_judged(directory: Path, written: Sequence[Path]) -> bool:
    """Tell whether every point has a result that is not older: the script was not run again since."""
    alone = len(written) == 1
    names = [folder.RESULT if alone else folder.numbered(folder.RESULT, i + 1) for i in range(len(written))]
    results = [directory / name for name in names]
    last = max(path.stat().st_mtime_ns for path in written)
    return all(path.is_file() and path.stat().st_mtime_ns >= last for path in results)


def _scene(directory: Path, case: str, numbers: dict[str, float]) -> Scene:
    own = directory / folder.SCENE
    found = [load_scene(own)] if own.is_file() else []
    if case in CASES:
        found.append(CASES[case])
    if not found:
        shown = case if re.fullmatch(r"[a-z0-9-]{1,64}", case) else "another scene"
        raise InputError(
            f"{directory} was written by the script of {shown}, none of the catalogue; put its scene.toml there"
        )
    keys = [{parameter.key for parameter in parameters(scene)} for scene in found]
    fitting = [scene for scene, known in zip(found, keys, strict=True) if known == numbers.keys()]
    if not fitting:
        other = ", ".join(sorted(keys[0] ^ numbers.keys())[:3])
        text = f"{directory} was written by another script than that of {found[0].name} ({other})"
        raise InputError(f"{text}; put its scene.toml there")
    # an earlier run of another script left its scene there
    scene = next((scene for scene in fitting if scene.name == case), fitting[0])
    known = scene.parameters()
    try:
        return with_values(scene, {key: value for key, value in numbers.items() if value != known[key]})
    except SceneError as error:
        raise InputError(f"{directory}: {error}") from None
