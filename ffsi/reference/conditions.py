"""Conditions at the boundaries: how fluid comes in and goes out, and what holds a wall from outside."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.reference.materials import Array
from ffsi.reference.step import Step


@dataclass(frozen=True)
class Inflow:
    """Flow normal to a straight inlet.

    ``velocity`` maps the distances s (n,) from ``start``, metres, and the time, seconds (0 in steady systems), to the
    velocities (n,) along the unit vector ``inward``, metres per second. The inlet runs from its start along ``inward``
    turned by +90 degrees. ``kept`` says that its nodal values are multiplied by what keeps the flow rate.
    """

    velocity: Callable[[Floats, float], Floats]
    start: tuple[float, float] = (0.0, 0.0)
    inward: tuple[float, float] = (1.0, 0.0)
    kept: bool = False

    def at(self, points: Floats, time: float) -> Floats:
        """Velocities (n, 2) at points (n, 2) of the inlet."""
        x, y = self.inward
        s = (points - np.array(self.start)) @ np.array([-y, x])
        return np.asarray(self.velocity(s, time)[:, None] * np.array(self.inward))


@dataclass(frozen=True)
class Outlet:
    """Natural condition at the outlet; flow rates are in m2/s, per metre depth.

    ``pressure`` Pa and ``ramp``, the function of time that multiplies it; ``resistance`` Pa s/m2, in front of which the
    flow rate drives the pressure at once: of the kind ``windkessel`` it is the proximal one, behind which the reservoir
    of the ``compliance`` m2/Pa empties through the ``distal`` resistance. ``backflow`` is the weight of the momentum
    that fluid which comes back brings along. ``hydrostatic`` adds to the pressure behind the outlet that of a column of
    the fluid, which is zero where the outlet ends highest against gravity.
    One of several has a ``name``. Raises ``ValueError`` for an unknown kind.

    A kind with a law of its own is a class derived from this one.
    """

    kinds: ClassVar[tuple[str, ...]] = ("do-nothing", "zero-traction", "pressure", "resistance", "windkessel")

    kind: str
    pressure: float = 0.0
    resistance: float = 0.0
    distal: float = 0.0
    compliance: float = 0.0
    backflow: float = 0.0
    ramp: Callable[[float], float] | None = None
    hydrostatic: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        """Refuse unknown kinds."""
        if self.kind not in self.kinds:
            raise ValueError(f"outlet kind {self.kind!r}, accepted: {self.kinds}")

    @property
    def presses(self) -> bool:
        """Whether there is a pressure at the outlet, one number for all of it."""
        return self.kind not in ("do-nothing", "zero-traction")

    @property
    def stores(self) -> bool:
        """Whether the pressure in a reservoir goes from step to step."""
        return self.kind == "windkessel"

    def pressure_at(self, time: float) -> float:
        """Given part of the pressure, Pa."""
        return self.pressure if self.ramp is None else self.ramp(time) * self.pressure

    def steady(self, flow: Array | float) -> Array | float:
        """Pressure, Pa, at a steady flow rate: what enters the reservoir leaves it."""
        return self.pressure + (self.resistance + self.distal) * flow

    def during(self, step: Step, flow: Array | float, old_flow: Array | float, reservoir: float) -> Array | float:
        """Pressure in a step, Pa, that of n + theta; flow rates at both its ends, ``reservoir`` Pa at its start."""
        behind: Array | float = self.pressure_at(step.between)
        if self.stores:
            after = self.reservoir_after(step, flow, old_flow, reservoir)
            behind = step.theta * after + (1.0 - step.theta) * reservoir
        return behind + self.resistance * (step.theta * flow + (1.0 - step.theta) * old_flow)

    def reservoir_after(
        self, step: Step, flow: Array | float, old_flow: Array | float, reservoir: float
    ) -> Array | float:
        """Pressure of the reservoir at the end of a step, from the balance of what enters, stays and leaves."""
        given, enters = self.pressure_at(step.between), step.theta * flow + (1.0 - step.theta) * old_flow
        stays, leaves = self.compliance / step.k, 1.0 / self.distal
        known = stays * reservoir - leaves * ((1.0 - step.theta) * reservoir - given)
        return (enters + known) / (stays + step.theta * leaves)

    def at_end(self, step: Step, flow: float, reservoir: float) -> float:
        """Pressure at the end of a step, with the flow rate and the ``reservoir`` there."""
        return (reservoir if self.stores else self.pressure_at(step.time)) + self.resistance * flow


@dataclass(frozen=True)
class Support:
    """Elastic support of a wall from outside: ``stiffness`` Pa/m and ``damping`` Pa s/m, per reference length."""

    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True)
class Load:
    """Dead ``traction`` (2,) Pa per reference length and ``pressure`` Pa on a boundary of a solid, times ``factor``.

    The pressure ``follows`` the boundary in its motion or acts as on the reference one; the factor is one of time. What
    the boundary is ``held`` by knows no factor.
    """

    traction: tuple[float, float]
    pressure: float
    follows: bool
    factor: Callable[[float], float]
    held: Support | None = None


@dataclass(frozen=True)
class PointForce:
    """A dead ``force`` (2,), N per metre depth, on a solid's material ``point`` (2,), m, times a ``factor`` of time."""

    point: tuple[float, float]
    force: tuple[float, float]
    factor: Callable[[float], float]


# Waveforms ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Series:
    """Fourier series of a waveform: sum of a_k cos(k w t) + b_k sin(k w t), k from 0, of one ``period``, seconds."""

    period: float
    cosine: Sequence[float]
    sine: Sequence[float]

    @property
    def frequencies(self) -> Floats:
        """k w, (n,), radians per second."""
        return np.asarray(np.arange(len(self.cosine)) * (2.0 * np.pi / self.period), dtype=np.float64)

    def waves(self, time: float) -> Array:
        """c_k e^(i k w t), (n,), whose real parts are the terms of the series at a time."""
        coefficients = np.array(self.cosine) - 1j * np.array(self.sine)
        return np.asarray(coefficients * np.exp(1j * self.frequencies * time))

    def __call__(self, time: float) -> float:
        """Return the sum of the series at a time, seconds."""
        return float(self.waves(time).real.sum())


def womersley(
    series: Series, mean: float, height: float, kinematic_viscosity: float
) -> Callable[[Floats, float], Floats]:
    """Velocity of s (n,) metres and time of the oscillating flow between plates with a ``mean`` velocity times series.

    Source: J. R. Womersley, J. Physiol. 127 (1955), for a channel; each harmonic has the mean one over the height.
    """

    def velocity(s: Floats, time: float) -> Floats:
        shapes = np.stack([_shape(s, height, w / kinematic_viscosity) for w in series.frequencies])
        return np.asarray(mean * (series.waves(time) @ shapes).real)

    return velocity


def _shape(s: Floats, height: float, squared: float) -> Array:
    """Shape (n,) of the harmonic whose factor of exp, b, has the square i ``squared``, 1/m2; a parabola for 0."""
    if squared == 0.0:
        return 6.0 * s * (height - s) / height**2
    half = 0.5 * height
    b = np.sqrt(1j * squared)
    # cosh(b y)/cosh(b h) and tanh(b h) by decaying exponentials: those of the growing ones overflow.
    last = np.exp(-2.0 * b * half)
    inner = (np.exp(-b * (height - s)) + np.exp(-b * s)) / (1.0 + last)
    tangent = (1.0 - last) / (1.0 + last)
    return np.asarray((1.0 - inner) / (1.0 - tangent / (b * half)))
