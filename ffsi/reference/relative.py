"""Relative numbers: what is no number fails, and nothing is measured in absolute units."""

import math
from collections.abc import Iterable

import numpy as np


def relative(number: float, scale: float) -> float:
    """Size of a number over its scale: 0 for zero, infinite where nothing gives it a scale, NaN for what is none."""
    size = abs(number)
    if size == 0.0:
        return 0.0
    return size / scale if scale > 0.0 or math.isnan(scale) else math.inf


def largest(numbers: Iterable[float]) -> float:
    """Largest of some numbers, 0 of none; unlike max(), NaN if one is NaN."""
    return float(np.max([0.0, *numbers]))


def norm(values: object) -> float:
    """The l2 norm; without the overflow and underflow of squares, so that any units will do."""
    array = np.abs(np.asarray(values, dtype=np.float64))
    size = float(array.max(initial=0.0))
    if not 0.0 < size < math.inf:
        return size
    return size * float(np.linalg.norm(array / size))
