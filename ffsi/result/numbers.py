"""The dimensionless numbers of a scene, and its inflow in words."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.scene import Scene
from ffsi.scene.errors import number_text
from ffsi.scene.flow import Inflow
from ffsi.scene.geometry import ChannelGeometry


class Number(NamedTuple):
    """A dimensionless number: its name, value, and formula with the values in it."""

    name: str
    value: float
    formula: str


def numbers(scene: Scene) -> list[Number]:
    """Return Reynolds and Womersley number, mass and stiffness ratios; of a solid alone its load.

    The velocity is the mean one over the inlet, in time times the largest factor on it.
    """
    fluid, inflow = scene.fluid, scene.inflow
    if fluid is None or inflow is None or scene.forces is None or not isinstance(scene.geometry, ChannelGeometry):
        return [
            Number(f"traction / stiffness of {name}", _load(scene) / solid.young_poisson[0], "|traction| / E")
            for name, solid in scene.solid.items()
            if scene.traction is not None
        ]
    assert inflow.mean_velocity is not None
    speed, length = inflow.mean_velocity * largest_factor(scene), scene.forces.reference_length
    viscosity = float(fluid.apparent_viscosity(np.array([speed / length]))[0])
    where = f"U = {number_text(speed)} m/s, L = {number_text(length)} m"
    if fluid.law != "newtonian":
        where += f", mu = {viscosity:.4g} Pa s at the shear rate U / L"
    found = [Number("Reynolds number", fluid.density * speed * length / viscosity, f"rho U L / mu, {where}")]
    if inflow.period is not None:
        half, rate = scene.geometry.inlet.height / 2, 2 * math.pi / inflow.period
        value = half * math.sqrt(rate * fluid.density / viscosity)
        formula = f"h sqrt(w rho / mu), h = {number_text(half)} m (half the inlet), w = 2 pi / {inflow.period:.4g} s"
        found.append(Number("Womersley number", value, formula))
    for name, solid in scene.solid.items():
        found.append(Number(f"mass ratio of {name}", solid.density / fluid.density, "rho_s / rho"))
        if speed > 0:
            stiffness = solid.young_poisson[0] / (fluid.density * speed**2)
            found.append(Number(f"stiffness ratio of {name}", stiffness, "E / (rho U^2), E Young's modulus at rest"))
    return found


def inlet_words(scene: Scene) -> list[str]:
    """Return the lines that say what flows in; none without a fluid."""
    from scipy.integrate import trapezoid

    inflow = scene.inflow
    if inflow is None or not isinstance(scene.geometry, ChannelGeometry):
        return [
            f"{name}, pressure {number_text(inlet.pressure)} Pa"
            if inlet.pressure is not None
            else f"{name}, profile {_profile(inlet)}: mean_velocity {number_text(inlet.mean_velocity or 0.0)} m/s"
            for name, inlet in scene.inlet.items()
        ]
    height, mean = scene.geometry.inlet.height, inflow.mean_velocity
    assert mean is not None
    s = np.linspace(0.0, height, 2001)
    profile = scene.inflow_profile()(s)
    flow = float(trapezoid(profile, s))
    lines = [
        f"profile {_profile(inflow)}: mean_velocity {number_text(mean)} m/s, "
        f"largest {number_text(float(profile.max()))} m/s, "
        f"flow rate {flow:.6g} m²/s over an inlet of {number_text(height)} m"
    ]
    if scene.time is not None:
        factor = inflow.factor(_times(scene))
        words = f"in time times a factor from {factor.min():.4g} to {factor.max():.4g}"
        waveform = "a Fourier series" if inflow.series else inflow.waveform
        words += f", waveform {waveform}" if waveform else ""
        words += f", period {number_text(inflow.period)} s" if inflow.period else ""
        words += f", from rest within {number_text(inflow.ramp)} s" if inflow.ramp else ""
        lines.append(words)
    return lines


def _profile(inflow: Inflow) -> str:
    return inflow.profile if inflow.profile_samples is None else f"of {len(inflow.profile_samples.at)} samples"


def largest_factor(scene: Scene) -> float:
    """Return the largest factor on the inflow in the time of the scene, dimensionless; 1 of a steady one."""
    if scene.time is None or scene.inflow is None:
        return 1.0
    return float(np.abs(scene.inflow.factor(_times(scene))).max())


def _times(scene: Scene) -> Floats:
    assert scene.time is not None
    return np.linspace(0.0, scene.time.end, 2001)


def _load(scene: Scene) -> float:
    return math.hypot(scene.traction.x, scene.traction.y) if scene.traction else 0.0
