"""A scene as a report shows it: its values in words, its dimensionless numbers, the command that computes it."""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Mapping
from typing import Any

import pandas as pd

from ffsi.report.tables import Rows
from ffsi.result.numbers import inlet_words, numbers
from ffsi.scene import CASES, Scene, SceneError, load_scene


def in_words(scene: Scene) -> list[Rows]:
    """Return a table with the values of each table of the scene and their units, and one of dimensionless numbers."""
    body = [[name, values] for name, values in scene.in_words().items()]
    found = [Rows(["table", "values"], body, [False, False], "The scene", "; ".join(inlet_words(scene)))]
    if body := [[number.name, f"{number.value:.4g}", number.formula] for number in numbers(scene)]:
        found.append(Rows(["number", "value", "of"], body, [False, True, False], "Dimensionless numbers"))
    return found


def command(scene: Scene) -> str | None:
    """Return case and settings for a command of ffsi that computes this scene; None where they do not say all of it."""
    if scene.name not in CASES:
        return None
    there, here = _flat(CASES[scene.name]), _flat(scene)
    changed = [key for key in here if there.get(key) != here[key]]
    settings = [f"{key}={str(here[key]).lower() if isinstance(here[key], bool) else here[key]}" for key in changed]
    settings += [f"{key}=none" for key in there if key not in here]
    try:
        same = load_scene(scene.name, settings).to_toml() == scene.to_toml()
    except SceneError:
        return None
    return shlex.join([scene.name, *(part for text in settings for part in ("--set", text))]) if same else None


def options(data: Mapping[str, Any]) -> list[str]:
    """Return the options of `ffsi run` and `ffsi sweep` that led to error bars, or to its mesh, in a result's data."""
    if not (made := data.get("adaptation")):
        return ["--error"] if data.get("errors") else []
    given = [("--tolerance", f"{made['tolerance']:g}"), ("--unknowns", f"{made['unknowns']:.0f}")]
    limits = [part for pair in given if float(pair[1]) for part in pair]
    return ["--adapt", ",".join(made["rounds"][0]["quantities"]), *limits]


def _flat(scene: Scene) -> dict[str, Any]:
    return {
        str(key): value
        for key, value in pd.json_normalize(tomllib.loads(scene.to_toml())).to_dict("records")[0].items()
    }
