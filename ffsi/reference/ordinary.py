"""How far an ordinary time step, solved to its tolerance and not to round-off, is from the solution of its equations.

Residuals do not tell: a displacement that is wrong by a millionth stresses a stiff solid by more than the fluid does.
What is missing is what Newton's method would still correct, in the norm that the tolerance is meant in.
"""

import math

import numpy as np

from ffsi.files.arrays import RawState
from ffsi.reference.relative import largest, norm
from ffsi.reference.residual import compute_residual
from ffsi.reference.sizes import unknown_sizes
from ffsi.reference.solve import ConvergenceError, Factors, moved
from ffsi.reference.system import System

ALLOWED = 10.0
"""Accepted error of an ordinary step over its tolerance, which bounds the last correction and not what is left."""
LARGEST = 100_000
"""Number of unknowns up to which the error of an ordinary step is computed: it takes a factorisation."""
# Factors of an earlier step are good enough where they leave this part of an error, after so many corrections at most.
_LEFT, _CORRECTIONS = 0.05, 6
# Largest relative residual of a step that is solved to round-off.
_ROUND_OFF = 1e-8


class Corrector:
    """Computes what steps lack; factors are kept from one step to the next, as long as they do."""

    def __init__(self) -> None:
        """Start without factors."""
        self._factors: Factors | None = None

    def missing(self, system: System, state: RawState) -> float:
        """Weighted root mean square of what is missing at the end of the system's step; infinite if it is not found.

        It is zero where the step is solved to round-off: then corrections are noise.
        """
        if largest(compute_residual(system, state).relative.values()) <= _ROUND_OFF:
            return 0.0
        if self._factors is not None and math.isfinite(found := self._missing(self._factors, system, state)):
            return found
        try:
            self._factors = Factors.of(system, state)
        except ConvergenceError:
            return math.inf
        return self._missing(self._factors, system, state)

    @staticmethod
    def _missing(factors: Factors, system: System, state: RawState) -> float:
        """Correct with kept factors until little is left: how far that is; infinite if it takes too many."""
        sizes: list[float] = []
        at = state
        while len(sizes) < _CORRECTIONS:
            correction = factors.correct(system, at, compute_residual(system, at))
            sizes.append(weighted(system, state, correction))
            at = moved(at, correction)
            if len(sizes) > 1 and sizes[-1] <= _LEFT * sizes[0]:
                return weighted(system, state, moved(at, state, -1.0))
        return math.inf


def weighted(system: System, state: RawState, correction: RawState) -> float:
    """Root mean square of a correction over the unknowns of a step, each over its size (``sizes.unknown_sizes``)."""
    parts = []
    for change, given, size in zip(correction.fields, system.rows.given, unknown_sizes(system, state), strict=True):
        free = change[~given]
        parts.append(free / size if size > 0.0 else np.where(free == 0.0, 0.0, np.inf))
    return norm([norm(part) for part in parts]) / math.sqrt(sum(part.size for part in parts) or 1)
