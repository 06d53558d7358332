"""What is wrong with a scene, in words that a user can act on."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with a scene.

    Args:
        key: dotted key of the value, such as ``fluid.viscosity``.
        message: what is accepted.
        value: the refused value as text (see `short`), None if there is none.
        nearest: the valid name that is most similar to the refused one, if any.
    """

    key: str
    message: str
    value: str | None = None
    nearest: str | None = None

    def below(self, prefix: str) -> Problem:
        """Return the same problem with its key below the table ``prefix``."""
        return replace(self, key=join(prefix, self.key))

    def __str__(self) -> str:
        """Return one line: key, value, what is accepted, nearest valid name."""
        given = "" if self.value is None else f" = {self.value}"
        hint = "" if self.nearest is None else f' (did you mean "{self.nearest}"?)'
        return f"{self.key}{given}: {self.message}{hint}"


class SceneError(ValueError):
    """A scene, case name, file or override is not valid.

    Attributes:
        problems: all problems found; the text of the error has one line for each.
    """

    def __init__(self, problems: Sequence[Problem]) -> None:
        """Collect the problems; there is at least one."""
        self.problems: tuple[Problem, ...] = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[SceneError], tuple[tuple[Problem, ...]]]:
        """Keep the problems when the error travels between processes."""
        return (SceneError, (self.problems,))


def join(*keys: str) -> str:
    """Return the dotted key made of the parts that are not empty."""
    return ".".join(key for key in keys if key)


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """Return the valid name most similar to ``name``, or None if none is similar."""
    by_lower = {candidate.lower(): candidate for candidate in valid}
    found = difflib.get_close_matches(name.lower(), list(by_lower), n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None


def names(valid: Iterable[str]) -> str:
    """Return the names quoted and separated by commas."""
    return ", ".join(f'"{name}"' for name in valid)


def number_text(value: float) -> str:
    """Return a number with at most nine digits and no trailing zeros."""
    return f"{value:.9g}"


def short(value: Any, limit: int = 60) -> str:
    """Return the value as a TOML user would write it, cut to ``limit`` characters and free of control characters."""
    match value:
        case bool():
            text = "true" if value else "false"
        case int() if abs(value) >= 10**limit:
            text = "a whole number of very many digits"
        case float():
            text = number_text(float(value)) if math.isfinite(value) else str(float(value))
        case str():
            text = f'"{value[: 2 * limit]}"'
        case Mapping():
            text = f"a table with {len(value)} keys"
        case list() | tuple():
            text = f"a list of {len(value)}"
        case _:
            text = str(value)
    text = "".join(character if character.isprintable() else "?" for character in text)
    return text if len(text) <= limit else text[: limit - 4] + '..."' if isinstance(value, str) else text[:limit]
