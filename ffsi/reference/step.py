"""One step of the theta scheme: its weights, and the state that it starts from."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ffsi.files.arrays import RawState
from ffsi.reference.materials import Array


@dataclass(frozen=True)
class Step:
    """A step of length ``k`` seconds that ends at ``time`` seconds; ``theta``, above 0, is the new state's weight.

    theta is 1 for backward Euler and 1/2 for Crank-Nicolson. Raises ``ValueError`` for other numbers.
    """

    k: float
    theta: float
    time: float

    def __post_init__(self) -> None:
        """Refuse numbers that are no step."""
        if not (0.0 < self.k < math.inf and 0.0 < self.theta <= 1.0 and math.isfinite(self.time)):
            raise ValueError(f"no time step: k = {self.k!r} s, theta = {self.theta!r}, time = {self.time!r} s")

    @property
    def start(self) -> float:
        """Time at which the step starts, seconds."""
        return self.time - self.k

    @property
    def between(self) -> float:
        """Time n + theta, to which the momentum of the step belongs, seconds."""
        return self.start + self.theta * self.k

    def mean(self, new: Array, old: Array) -> Array:
        """Weighted mean theta new + (1 - theta) old of two arrays of one shape."""
        return self.theta * new + (1.0 - self.theta) * old

    def rate(self, new: Array, old: Array) -> Array:
        """Difference quotient (new - old) / k of two arrays of one shape, per second."""
        return (new - old) / self.k


@dataclass(frozen=True)
class Increment:
    """A step and the state at its start; ``reservoirs`` are the pressures, Pa, there behind outlets that store fluid.

    They are by the outlet's name, which of the only one is empty.
    """

    old: RawState
    step: Step
    reservoirs: Mapping[str, float] = field(default_factory=dict)
