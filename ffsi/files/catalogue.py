"""The catalogue's scenes as files: what can be said of them before any model is built."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "cases"


@cache
def names() -> tuple[str, ...]:
    """Return the names of the scenes, in alphabetical order."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def table(name: str) -> dict[str, Any]:
    """Return what the file of a scene says."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def summaries() -> list[dict[str, str]]:
    """Return name, physics (fluid, solid, fsi) and description of every scene."""
    found = []
    for name in names():
        keys = table(name)
        physics = "fsi" if {"fluid", "solid"} <= keys.keys() else "fluid" if "fluid" in keys else "solid"
        found.append({"name": name, "physics": physics, "description": keys["description"]})
    return found
