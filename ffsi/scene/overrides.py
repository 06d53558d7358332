"""A scene with some values changed: from `key=value` texts or from a dictionary of dotted keys."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Mapping
from typing import Any

from ffsi.scene.errors import Problem, SceneError, of_type, short
from ffsi.scene.flow import PROFILE_KEYS, VELOCITIES, WAVEFORMS
from ffsi.scene.fluids import LAWS
from ffsi.scene.lookup import fields, plain
from ffsi.scene.materials import ELASTIC_CONSTANTS, ELASTIC_PAIRS, MATERIALS, PAIRS_TEXT, CompressibleElastic, Elastic
from ffsi.scene.model import Scene
from ffsi.scene.outlet import OUTLETS, PRESSURES
from ffsi.scene.toml import parse_value

_KEY = re.compile(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*")


def parse_overrides(overrides: Iterable[str]) -> dict[str, Any]:
    """Return dotted keys and values of texts like ``fluid.viscosity=3.5 mPa s``; of a repeated key the last.

    A value is read as TOML if that is possible (numbers, true, "text", tables), else as plain text; none without
    quotes is None, which removes the key.

    Raises:
        SceneError: a text is not ``key=value``.
    """
    values: dict[str, Any] = {}
    problems = []
    if isinstance(overrides, str | Mapping) or not isinstance(overrides, Iterable):
        accepted = 'accepted: a list of texts such as ["mesh.level=1"]; ffsi.with_values takes {"mesh.level": 1}'
        raise SceneError([Problem("overrides", accepted, of_type(overrides))])
    for text in overrides:
        key, equals, value = text.partition("=") if isinstance(text, str) else ("", "", "")
        key = key.strip()
        if not equals or not _KEY.fullmatch(key):
            problems.append(Problem("override", "accepted: key=value, such as mesh.level=1", short(text)))
        else:
            values[key] = _literal(value.strip())
    if problems:
        raise SceneError(problems)
    return values


def with_values(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return the scene with some values changed, checked anew.

    Args:
        scene: where the other values come from.
        values: new values by dotted key, such as ``{"inflow.mean_velocity": 0.06}``; a complete new pair of elastic
            constants replaces the scene's pair; a new material keeps the constants that it knows. The formulation
            "incompressible" drops what that form does not have: of (lame_lambda, lame_mu) and (lame_mu, poisson_ratio)
            it keeps lame_mu, of (young_modulus, poisson_ratio) young_modulus; Mooney-Rivlin loses bulk_modulus.
            Constants among the new values win. The way back needs the constants that are then missing.
            A new velocity of an inflow (mean_velocity, peak_velocity or flow_rate; of an inlet by name a pressure, too)
            replaces the one in use, so does a new waveform (waveform, waveform_file or series, with their period).
            A new viscosity law, too, keeps the constants that it knows, so does a new kind of outlet.
            None removes a key or a table. What the scene does not state but has from other values (kind of mesh motion,
            formulation, element sizes) follows the new ones.

    Raises:
        SceneError: a key or value is not valid.
    """
    if not isinstance(scene, Scene):
        raise SceneError([Problem("scene", "accepted: a scene, such as load_scene returns", of_type(scene))])
    if not isinstance(values, Mapping) or not all(isinstance(key, str) for key in values):
        accepted = 'accepted: a table of keys and values, such as {"mesh.level": 1}'
        raise SceneError([Problem("values", accepted, of_type(values))])
    table = scene.given()
    problems = []
    if values.get("geometry.kind", scene.geometry.kind) != scene.geometry.kind:
        text = f'the scene has the geometry "{scene.geometry.kind}"; another one needs another scene'
        problems.append(Problem("geometry.kind", text, short(values["geometry.kind"])))
    for name, solid in scene.solid.items():
        if not {"solid", f"solid.{name}"} & set(values):
            problems += _adapt_solid(f"solid.{name}.", solid, values, table["solid"][name])
    for key, inner in _tables(table, "inflow", "inlet"):
        if key in values or key.partition(".")[0] in values:
            continue
        for alternatives, unused in (((*VELOCITIES, "pressure"), ()), (WAVEFORMS, ("period",)), (PROFILE_KEYS, ())):
            if any(f"{key}.{name}" in values for name in alternatives):
                for name in (*alternatives, *unused):
                    inner.pop(name, None)
    for key, inner in _tables(table, "outlet"):
        kind = values.get(f"{key}.kind")
        if isinstance(kind, str) and kind in OUTLETS:
            for name in PRESSURES.difference(OUTLETS[kind].keys):
                inner.pop(name, None)
    law = values.get("fluid.law")
    if isinstance(law, str) and law in LAWS and "fluid" in table:
        for key in table["fluid"].keys() - LAWS[law].model_fields.keys():
            del table["fluid"][key]
    for key, value in values.items():
        problems += _put(table, key, value)
    if problems:
        raise SceneError(problems)
    return Scene.model_validate(table)


_OF_ONE = ("series", "profile_samples")  # tables inside of one


def _tables(table: dict[str, Any], *keys: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the tables under some keys, or those by name there, with their dotted keys."""
    found = []
    for key, inner in ((key, table[key]) for key in keys if key in table):
        several = any(isinstance(value, dict) for name, value in inner.items() if name not in _OF_ONE)
        found += [(f"{key}.{name}", each) for name, each in inner.items()] if several else [(key, inner)]
    return found


def _adapt_solid(prefix: str, solid: Elastic, values: Mapping[str, Any], table: dict[str, Any]) -> list[Problem]:
    """Remove from the solid's table what the new values replace: the old material's own keys, or constants in use."""
    name = values.get(prefix + "material")
    material = MATERIALS.get(name, type(solid)) if isinstance(name, str) else type(solid)
    for key in table.keys() - material.model_fields.keys():
        del table[key]
    formulation = values.get(prefix + "formulation", table.get("formulation"))
    unused = material.volume_constants if formulation == "incompressible" else ()
    for key in unused:
        table.pop(key, None)
    if not (isinstance(solid, CompressibleElastic) and issubclass(material, CompressibleElastic)):
        return []
    given = [constant for constant in ELASTIC_CONSTANTS if prefix + constant in values]
    if unused:
        # One constant is left; a new one replaces it.
        for key in solid.given_constants if given else ():
            table.pop(key, None)
        return []
    if any(set(pair) == set(given) for pair in ELASTIC_PAIRS):
        for key in solid.given_constants:
            del table[key]
        return []
    used = solid.given_constants
    text = f"the scene uses the pair ({', '.join(used)}): change one of these, or give one whole pair of {PAIRS_TEXT}"
    # From incompressible, what is missing beside the one constant may be given alone.
    return [Problem(prefix + key, text) for key in given if key not in used and not solid.incompressible]


def _put(table: dict[str, Any], key: str, value: Any) -> list[Problem]:
    """Set the value in nested tables; tables that are missing are added."""
    *path, last = key.split(".")
    for depth, name in enumerate(path):
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            return [Problem(key, f"{'.'.join(path[: depth + 1])} is a single value, it has no keys")]
    if value is None and (last in table or fields(key)):  # perhaps of another material
        table.pop(last, None)
        return []
    try:
        table[last] = copy.deepcopy(plain(value))
    except TypeError:  # of a generator, an open file ...
        return [Problem(key, "accepted: numbers, texts, truth values, lists and tables", of_type(value))]
    return []


def _literal(text: str) -> Any:
    if text == "none":
        return None
    try:
        value = parse_value(text)
    except ValueError:
        return text
    return value if isinstance(value, int | float | str | list | dict) else text
