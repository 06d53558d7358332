"""What is wrong with a scene, in words that a user can act on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ffsi.text import cut, listed, printable
from ffsi.text import nearest as nearest

SHOWN_PROBLEMS = 20
"""Problems that the text of an error shows; the rest is counted."""
_LONGEST_MESSAGE = 6000


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
        """Return one printable line: key, value, what is accepted, nearest valid name."""
        given = "" if self.value is None else f" = {printable(self.value)}"
        hint = "" if self.nearest is None else f' (did you mean "{cut(self.nearest)}"?)'
        return f"{cut(self.key)}{given}: {cut(self.message, _LONGEST_MESSAGE)}{hint}"


class SceneError(ValueError):
    """A scene, case name, file or override is not valid.

    Attributes:
        problems: all problems found; the text of the error has one line for each of the first 20.
    """

    def __init__(self, problems: Sequence[Problem]) -> None:
        """Collect the problems; there is at least one."""
        self.problems: tuple[Problem, ...] = tuple(problems)
        lines = [str(problem) for problem in self.problems[: SHOWN_PROBLEMS + 1]]
        if (more := len(self.problems) - len(lines)) > 0:
            lines.append(f"and {more} more problems")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type[SceneError], tuple[tuple[Problem, ...]]]:
        """Keep the problems when the error travels between processes."""
        return (SceneError, (self.problems,))


def fault(text: str, key: str = "file") -> SceneError:
    """Return the error of a mesh file, or of another key of the scene's table "geometry"."""
    return SceneError([Problem(key, text)])


def place(point: NDArray[np.float64], unit: str) -> str:
    """Return a point (2,) in words, in the unit of the mesh file."""
    return f"({point[0]:.6g}, {point[1]:.6g}) {unit}"


def count(number: int, noun: str) -> str:
    """Return "1 triangle" or "2 triangles"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def join(*keys: str) -> str:
    """Return the dotted key made of the parts that are not empty."""
    return ".".join(key for key in keys if key)


def names(valid: Iterable[str]) -> str:
    """Return the names quoted and separated by commas; of very many the first."""
    return listed(f'"{name}"' for name in valid)


def number_text(value: float) -> str:
    """Return a number with at most nine digits and no trailing zeros."""
    return f"{value:.9g}"


def of_type(value: Any) -> str:
    """Return what was given where something of another type is needed: a person may have no idea of its value."""
    return f"{short(value)} ({type(value).__name__})" if isinstance(value, int | float | str) else type(value).__name__


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
    text = printable(text)
    return text if len(text) <= limit else text[: limit - 4] + '..."' if isinstance(value, str) else text[:limit]
