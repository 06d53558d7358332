"""`sweep.toml`: what a sweep is to solve, and whether a folder holds that or another one."""

from __future__ import annotations

import hashlib
import itertools
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.reading import LONGEST_TABLE, read_bytes
from ffsi.scene import MeshGeometry, Scene
from ffsi.scene.lookup import Scalar

Values = dict[str, Scalar]
"""The varied values of one point, in SI, by dotted key; a key that it leaves as the scene has it is absent."""

_SUM = "# sha256 "


def points_of(definition: Mapping[str, Any]) -> list[Values]:
    """Return the points of a study: the product of the values of `vary`, the last key changing fastest, or its rows."""
    vary = definition["vary"]
    if definition.get("design") == "product":
        return [dict(zip(vary, values, strict=True)) for values in itertools.product(*vary.values())]
    rows = zip(*vary.values(), strict=True)
    return [{key: value for key, value in zip(vary, row, strict=True) if value != ""} for row in rows]


def shown(value: Scalar) -> str:
    """Return a varied value as people read it."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def label(values: Mapping[str, Scalar]) -> str:
    """Return a point in words, such as `mesh.level = 1, inflow.profile = uniform`."""
    return ", ".join(f"{key} = {shown(value)}" for key, value in values.items())


def define(scene: Scene, varied: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `sweep.toml` holds of a sweep: `varied` is its `design` and `vary`."""
    definition: dict[str, Any] = {**varied, "scene": tomllib.loads(scene.to_toml())}
    if isinstance(scene.geometry, MeshGeometry):
        definition["mesh"] = scene.geometry.digest  # the file may have changed
    if scene.time is not None and scene.time.initial_state is not None:
        definition["initial"] = scene.time.initial_state.digest  # and the folder
    return definition


def write(directory: Path, definition: Mapping[str, Any]) -> None:
    """Write `sweep.toml`; its first line, a comment, is the SHA-256 of the rest."""
    text = tomli_w.dumps(definition)
    folder.write_text(directory / folder.SWEEP, f"{_SUM}{hashlib.sha256(text.encode('utf-8')).hexdigest()}\n{text}")


def read(directory: Path) -> dict[str, Any]:
    """Return what `sweep.toml` holds.

    Raises:
        InputError: it is damaged, or was changed.
    """
    path = directory / folder.SWEEP
    data = read_bytes(path, LONGEST_TABLE)
    head, _, text = data.partition(b"\n")
    try:
        found = tomllib.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is damaged: {error}") from error
    if head != (_SUM + hashlib.sha256(text).hexdigest()).encode("ascii"):
        raise InputError(
            f"{path} was changed after it was written, or is of an older version: its checksum does not fit"
        )
    return found


def check(directory: Path, definition: Mapping[str, Any]) -> None:
    """Refuse a folder with other content or another sweep; writes nothing.

    Raises:
        InputError: it is one.
    """
    folder.check_writable(directory)
    if not directory.exists():
        return
    if not directory.is_dir():
        raise InputError(f"{directory} is a file; the sweep needs a folder")
    if not folder.is_sweep_folder(directory):
        if any(directory.iterdir()):
            raise InputError(f"{directory} is not empty and holds no sweep; nothing was written. Give another folder")
        return
    folder.refuse_links(directory, ("chain-*", "sweep.*", ".*.part"))
    there = read(directory)
    if (key := _first_difference(there, definition)) is not None:
        raise InputError(f"{directory} holds a sweep with another definition: {key}. Give another folder to keep both")


def _first_difference(there: Any, here: Any, key: str = "") -> str | None:
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for name in dict.fromkeys([*there, *here]):
            found = _first_difference(there.get(name), here.get(name), f"{key}.{name}" if key else str(name))
            if found is not None:
                return found
        if key == "vary" and list(there) != list(here):
            return f"vary is in the order {', '.join(there)} there and {', '.join(here)} here"
        return None
    return None if there == here else f"{key} is {_words(there)} there and {_words(here)} here"


def _words(value: Any) -> str:
    return "absent" if value is None else repr(value)
