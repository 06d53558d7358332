"""Evaluations of a result, one by one: a failing one is noted, and neither the result nor the others are lost."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from typing import TypeVar

from ffsi.files import machine

logger = logging.getLogger(__name__)

T = TypeVar("T")
Notes = list[dict[str, str]]
"""What could not be evaluated, as in `result.json`: `what` and `why`, `cause` = "machine" for a full disk or memory."""
Evaluations = dict[str, Callable[[], dict[str, T]]]
"""By what they are in words: functions that return values by name."""


def attempt(notes: Notes, what: str, evaluate: Callable[[], T]) -> T | None:
    """Return what an evaluation returns; None if it fails, and a note of it (of the same failure one)."""
    try:
        return evaluate()
    except Exception as error:
        logger.debug("%s could not be evaluated", what, exc_info=True)
        _note(notes, what, machine.words(error), "machine" if machine.ended(error) else "")
        return None


def gather(notes: Notes, evaluations: Mapping[str, Callable[[], Mapping[str, T]]]) -> dict[str, T]:
    """Return the values of all evaluations that succeed; a number that is none is left out and noted, too."""
    found: dict[str, T] = {}
    for what, evaluate in evaluations.items():
        for name, value in (attempt(notes, what, evaluate) or {}).items():
            if isinstance(value, float) and math.isnan(value):
                _note(notes, name, "it is not a number")
            else:
                found[name] = value
    return found


def words(note: Mapping[str, str]) -> str:
    """Return a note in one line."""
    return f"{note['what']}: {note['why']}"


def _note(notes: Notes, what: str, why: str, cause: str = "") -> None:
    if (note := {"what": what, "why": why} | ({"cause": cause} if cause else {})) not in notes:
        notes.append(note)
