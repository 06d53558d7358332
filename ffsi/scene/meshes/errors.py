"""What is wrong with a mesh, and words for places in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ffsi.scene.errors import Problem

FILE = "file"
"""Key of the problems of the mesh itself, below the table "geometry"."""


class MeshError(Exception):
    """A mesh cannot be used.

    Attributes:
        problems: what is wrong; their keys are those below the scene's table "geometry".
    """

    def __init__(self, problems: Sequence[Problem]) -> None:
        """Collect the problems; there is at least one."""
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


def fault(text: str, key: str = FILE) -> MeshError:
    """Return the error with one problem of the mesh itself."""
    return MeshError([Problem(key, text)])


def place(point: NDArray[np.float64], unit: str) -> str:
    """Return a point (2,) in words, in the unit of the mesh file."""
    return f"({point[0]:.6g}, {point[1]:.6g}) {unit}"


def count(number: int, noun: str) -> str:
    """Return "1 triangle" or "2 triangles"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
