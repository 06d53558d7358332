"""The folder of a script that was run directly, without Python: made a run folder, and checked."""

from __future__ import annotations

import re
from pathlib import Path

from ffsi.files import folder
from ffsi.files.arguments import path_of
from ffsi.files.errors import InputError
from ffsi.files.json_types import read_table
from ffsi.hemodynamics.result import Result
from ffsi.hemodynamics.result import load_result as load_finished
from ffsi.run.point import Point
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values

_POINTS = (folder.numbered(folder.POINT, 0).replace("0000", "[0-9]*"), folder.FAILED)


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
    ours = (folder.SCRIPT, folder.RESULT, folder.CHAIN, folder.SWEEP)  # a run folder, damaged or not
    if not directory.is_dir() or any((directory / name).exists() for name in ours):
        return
    outcomes = [read_table(path) for pattern in _POINTS for path in sorted(directory.glob(pattern))]
    if not outcomes or not (directory / folder.MESH).is_file():
        return
    folder.check_writable(directory)
    numbers = [outcome.get("parameters") or {} for outcome in outcomes]
    names = [key for key in numbers[0] if any(each.get(key) != numbers[0][key] for each in numbers)]
    scenes = [_scene(directory, str(outcome.get("case")), own) for outcome, own in zip(outcomes, numbers, strict=True)]
    varied = [{key: own[key] for key in names if key in own} for own in numbers]
    alone = len(outcomes) == 1
    for i, (scene, values) in enumerate(zip(scenes, varied, strict=True), start=1):
        point = Point(scene, directory, i, values, alone=alone, followed=i < len(scenes))
        data = point.judged(None, check=True)
        point.draw(data)
        point.save(data)
    if not alone:
        folder.write_json(directory / folder.CHAIN, {"points": varied})
    folder.write_text(directory / folder.SCENE, scenes[0].to_toml())  # last: only now is it a run folder


def _scene(directory: Path, case: str, numbers: dict[str, float]) -> Scene:
    own = directory / folder.SCENE
    if not own.is_file() and case not in CASES:
        shown = case if re.fullmatch(r"[a-z0-9-]{1,64}", case) else "another scene"
        raise InputError(
            f"{directory} was written by the script of {shown}, none of the catalogue; put its scene.toml there"
        )
    scene = load_scene(own) if own.is_file() else CASES[case]
    known = scene.parameters()
    try:
        if known.keys() != numbers.keys():
            other = ", ".join(sorted(known.keys() ^ numbers.keys())[:3])
            text = f"{directory} was written by another script than that of {scene.name} ({other})"
            raise InputError(f"{text}; put its scene.toml there")
        return with_values(scene, {key: value for key, value in numbers.items() if value != known[key]})
    except SceneError as error:
        raise InputError(f"{directory}: {error}") from None
