"""Flow at an inlet of height H: a profile times a function of time, or Womersley's flow of a Fourier series.

Formulas: docs/theory.md, "Blood".
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.reference.materials import Array


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
        result: Array = coefficients * np.exp(1j * self.frequencies * time)
        return result

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
        result: Floats = mean * (series.waves(time) @ shapes).real
        return result

    return velocity


def _shape(s: Floats, height: float, squared: float) -> Array:
    """Shape (n,) of the harmonic whose factor of exp, b, has the square i ``squared``, 1/m2; a parabola for 0."""
    if squared == 0.0:
        parabola: Floats = 6.0 * s * (height - s) / height**2
        return parabola
    half = 0.5 * height
    b = np.sqrt(1j * squared)
    # cosh(b y)/cosh(b h) and tanh(b h) by decaying exponentials: those of the growing ones overflow.
    last = np.exp(-2.0 * b * half)
    inner = (np.exp(-b * (height - s)) + np.exp(-b * s)) / (1.0 + last)
    tangent = (1.0 - last) / (1.0 + last)
    result: Array = (1.0 - inner) / (1.0 - tangent / (b * half))
    return result
