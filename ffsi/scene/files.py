"""Scenes by case name or from a file; the catalogue: scenes with published values, each a file that a user can copy."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from ffsi.files import catalogue, folder
from ffsi.files.catalogue import FOLDER as FOLDER
from ffsi.files.errors import InputError
from ffsi.files.reading import MEGABYTE, read_text
from ffsi.scene.errors import Problem, SceneError, names, nearest, of_type, short
from ffsi.scene.geometry import MeshGeometry
from ffsi.scene.model import Scene
from ffsi.scene.overrides import parse_overrides, with_values
from ffsi.scene.toml import parse_toml


class Catalogue(Mapping[str, Scene]):
    """Scenes by name, in alphabetical order; each is read when it is asked for."""

    @property
    def steady(self) -> list[str]:
        """Names of the scenes that are steady."""
        return [name for name in self if self[name].steady]

    def __getitem__(self, name: str) -> Scene:
        """Return a scene. Raises ``KeyError`` for a name that is none."""
        if name not in catalogue.names():
            raise KeyError(name)
        return _case(name)

    def __iter__(self) -> Iterator[str]:
        """Go through the names."""
        return iter(catalogue.names())

    def __len__(self) -> int:
        """Return the number of scenes."""
        return len(catalogue.names())


@cache
def _case(name: str) -> Scene:
    return Scene.model_validate(catalogue.table(name))


CASES = Catalogue()


def load_scene(case_or_path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Return a scene of the catalogue or of a TOML file, with some values changed.

    Args:
        case_or_path: name of a case, or path of a TOML file; a case's name comes first.
        overrides: ``key=value`` texts, such as ``fluid.viscosity=3.5 mPa s``.

    Raises:
        SceneError: there is no such case or file, or a key or value is not valid.
    """
    if not isinstance(case_or_path, str | os.PathLike):
        accepted = "accepted: the name of a case or of a TOML file"
        if isinstance(case_or_path, Scene):
            accepted += "; this is a scene already, ffsi.with_values changes it"
        raise SceneError([Problem("scene", accepted, of_type(case_or_path))])
    try:
        scene = CASES[case_or_path] if isinstance(case_or_path, str) and case_or_path in CASES else _find(case_or_path)
    except OSError as error:
        raise SceneError([Problem("scene", f"cannot be read: {error.strerror}", short(str(case_or_path)))]) from None
    values = parse_overrides(overrides)
    return with_values(scene, values) if values else scene


def scene_of(scene: Scene | str | Path) -> Scene:
    """Return a scene as it is, and for a name or a path what `load_scene` reads.

    Raises:
        SceneError: as `load_scene`.
    """
    return scene if isinstance(scene, Scene) else load_scene(scene)


def stored(scene: Scene, directory: Path) -> Scene:
    """Return the scene as `scene.toml` of a run folder has it; write what it reads there too."""
    if isinstance(scene.geometry, MeshGeometry):
        scene = scene.model_copy(update={"geometry": scene.geometry.store(directory)})
    return scene if scene.time is None else scene.model_copy(update={"time": scene.time.store(directory)})


def scenes_before(directory: Path) -> list[tuple[int, Scene]]:
    """Return the scenes that a run in time in a folder had before it was changed, each with its last step, in time."""
    paths = sorted(directory.glob(folder.EARLIER), key=lambda path: int(path.stem.rpartition("-")[2]))
    return [(int(path.stem.rpartition("-")[2]), load_scene(path)) for path in paths]


def _find(case_or_path: str | Path) -> Scene:
    path = Path(case_or_path)
    if path.exists() and not path.is_dir():
        return Scene.model_validate(_located(parse_toml(_read(path), path.name), path.parent))
    if path.is_dir():
        inner = path / "scene.toml"
        guess = str(inner) if inner.is_file() else None
        text = "this is a folder; the name of a case or of a TOML file is accepted"
        raise SceneError([Problem("scene", text, short(str(path)), guess)])
    if path.name == str(case_or_path) and path.suffix != ".toml":
        text = f"no such case and no such file; cases: {names(CASES)}"
        raise SceneError([Problem("case", text, short(str(path)), nearest(path.name, CASES))])
    siblings = [str(other) for other in sorted(path.parent.glob("*.toml"))] if path.parent.is_dir() else []
    guess = nearest(str(path), siblings) or nearest(path.stem, CASES)
    raise SceneError([Problem("scene", "no such file", short(str(path)), guess)])


_FILES = (("geometry", "file"), ("inflow", "waveform_file"), ("inflow", "profile_file"), ("time", "initial"))


def _located(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the scene's table with the paths of its files seen from here: in the file they are relative to it."""

    def located(inner: Any, key: str) -> Any:
        given = isinstance(inner, dict) and isinstance(inner.get(key), str)
        return {**inner, key: str(folder.absolute() / inner[key])} if given else inner

    for name, key in _FILES:
        if name in table:
            table = {**table, name: located(table[name], key)}
    driven = [(tables, "waveform_file") for tables in ("inlet", "loads", "point_forces")]
    for tables, key in (*driven, ("inlet", "profile_file"), ("walls", "displacement_file")):
        if isinstance(found := table.get(tables), dict):
            table = {**table, tables: {name: located(inner, key) for name, inner in found.items()}}
    return table


def _read(path: Path) -> str:
    try:
        return read_text(path, MEGABYTE)
    except InputError as error:
        raise SceneError([Problem("scene", f"{error}; a TOML file is accepted", short(str(path)))]) from None
