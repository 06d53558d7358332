"""What the arguments of public functions must be."""

from __future__ import annotations

import numbers
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal

from ffsi.files.errors import InputError

Design = Literal["product", "zip", "latin-hypercube", "sobol"]
"""How the points of a study follow from the values of its keys."""


def path_of(value: object, what: str) -> Path:
    """Return the path that an argument stands for; raises InputError for anything else."""
    if isinstance(value, str | os.PathLike) and isinstance(os.fspath(value), str) and str(value):
        return Path(value)
    raise InputError(f"{what} = {value!r}: accepted: a path, such as 'runs/first'")


def count_of(value: object, what: str) -> int:
    """Return the whole number from 1 on that an argument is; raises InputError for anything else."""
    if isinstance(value, numbers.Integral) and not isinstance(value, bool) and int(value) >= 1:
        return int(value)
    raise InputError(f"{what} = {value!r}: accepted: a whole number from 1 on")


def texts_of(value: object, what: str) -> list[str]:
    """Return the texts that an argument is, one alone or several, each once; raises InputError for anything else."""
    if isinstance(value, str):
        return [value]
    if isinstance(value, Iterable) and not isinstance(value, Mapping):
        found = [*value]
        if all(isinstance(text, str) for text in found):
            return list(dict.fromkeys(found))
    raise InputError(f"{what} = {value!r}: accepted: a name, or a list of names")
