"""Whether a result that is there still says what its files say."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ffsi.files import seals
from ffsi.hemodynamics.result import Result
from ffsi.run.point import Point, set_aside

TOLERANCE = 1e-9
"""Largest relative difference that another machine's rounding may make."""
_TOLD = (
    *("case", "unknowns", "triangles", "level", "quantities", "reached", "newton", "parameters", "state", "time"),
    *("cycles", "regions", "boundaries"),
)


def problems(result: Result) -> list[str]:
    """Return why a result cannot be believed: checksums, and what is found when it is made again from its files."""
    found = seals.problems(result.file, result.data)
    point = Point(
        result.scene, result.directory, result.point, result.data.get("varied") or {}, alone="varied" not in result.data
    )
    try:
        again = point.collect(None)
    except (ValueError, OSError, KeyError) as error:
        return [*found, f"it cannot be evaluated again: {error}"]
    if result.failure == "check":
        set_aside(again, {})
    for key in _TOLD:
        if key in result.data:
            found += _differences(key, result.data[key], again.get(key))
    return found


def _differences(name: str, told: Any, again: Any) -> list[str]:
    if isinstance(told, Mapping) and isinstance(again, Mapping):
        keys = dict.fromkeys([*told, *again])
        return [text for key in keys for text in _differences(f"{name}.{key}", told.get(key), again.get(key))]
    if isinstance(told, list) and isinstance(again, list) and len(told) == len(again):
        pairs = enumerate(zip(told, again, strict=True))
        return [text for i, pair in pairs for text in _differences(f"{name}[{i}]", *pair)]
    return [] if _same(told, again) else [f"{name} is {told!r}, the run's files say {again!r}"]


def _same(told: Any, again: Any) -> bool:
    """Compare two values of JSON; a number that is not finite is null there."""
    if isinstance(told, (int, float)) and isinstance(again, (int, float)) and math.isfinite(again):
        return abs(told - again) <= TOLERANCE * max(abs(told), abs(again))
    if isinstance(again, float) and not math.isfinite(again):
        return told is None
    return bool(told == again)
