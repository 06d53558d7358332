"""What a result may lack although its equations are solved: warnings, each with the key to change.

A step k of the scheme (theta near 1/2) changes the period of an oscillation by (w k)^2 / 12 of it, that is by
3.3 / n^2 with n steps per period: 2 % with 13 steps. In numbers taken step by step (w k)^2 is the second difference
over the value, so the same estimate holds for any signal: its second differences over 12, relative to its amplitude.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.result import oscillation
from ffsi.scene import Boundary, Scene, boundaries
from ffsi.scene.geometry import ChannelGeometry, MeshGeometry

if TYPE_CHECKING:
    import pandas as pd

ACCEPTED = 0.02
"""Largest error that is not said, relative: of a period, and what is left of the energy balance."""
_WINDOW = 100  # steps that are judged together
_FEWEST = 20
_SIGNIFICANT = 0.01  # part of the largest force (displacement) below which its changes do not count
_SAMPLES = 4000
_SPACINGS = (1.0, 0.77, 0.37)  # of the differences of a waveform, in steps: one alone misses some frequencies
_SHEDDING, _STROUHAL = 47.0, 0.2  # Reynolds number from which on a cylinder sheds vortices, and their frequency
_NOISE = 1e-8  # part of the size, and of the forces that drive the scene, below which there is but noise of the steps


def of_history(scene: Scene, history: pd.DataFrame, energy: dict[str, float]) -> list[str]:
    """Return the warnings on the steps that a computation in time has taken.

    The history has one row per step, as `history.csv`; without rows the steps are those of the scene. `energy` is its
    balance, J per metre depth (`in_time.energy_balance`).
    """
    assert scene.time is not None
    if len(history):
        ends, steps = history["time"].to_numpy(np.float64), history["step"].to_numpy(np.float64)
    else:
        ends = steps = np.array([scene.time.step])
    found = [_ramp(scene, ends, steps), _waveform(scene, ends, steps), _vortices(scene, ends, steps)]
    if len(history):
        found += [_motion(scene, history, steps), _damping(scene, history, steps), _energy(scene, energy)]
    return [text for text in found if text]


def of_scene(scene: Scene) -> list[str]:
    """Return the warnings that a scene deserves before it is solved: gravity at the outlet."""
    if scene.gravity is None or scene.fluid is None:
        return []
    gravity = np.array([scene.gravity.x, scene.gravity.y])
    found = []
    for side in boundaries(scene):
        name = f"outlet.{side.opening}" if scene.outlets else "outlet"
        outlet = scene.only_outlet or scene.outlets.get(side.opening or "")
        if side.role != "outlet" or side.opening in scene.inlet or outlet is None or outlet.hydrostatic is not None:
            continue
        points = _points(scene, side)
        weight = float(np.ptp(points @ gravity))
        if weight > 1e-9 * float(np.hypot(*gravity) * np.hypot(*np.ptp(points, axis=0))):
            found.append(
                "a constant pressure behind the outlet does not balance gravity along it, where the weight of the "
                f"fluid makes a difference of {scene.fluid.density * weight:.3g} Pa: give {name}.hydrostatic = true "
                "(or false if this is meant)"
            )
    return found


def _points(scene: Scene, side: Boundary) -> Floats:
    """Return points (n, 2) of an outlet, m."""
    if isinstance(scene.geometry, MeshGeometry):
        return scene.geometry.ends_of(side.label).reshape(-1, 2)
    assert isinstance(scene.geometry, ChannelGeometry)
    return np.array(scene.geometry.outlet_points)


def _vortices(scene: Scene, ends: Floats, steps: Floats) -> str:
    """Judge the period of a vortex street: steps that are too large for it leave no trace of it."""
    if not isinstance(scene.geometry, ChannelGeometry) or scene.inflow is None or not scene.geometry.bluff:
        return ""
    assert scene.fluid is not None and scene.forces is not None and scene.inflow.mean_velocity is not None
    speed = scene.inflow.mean_velocity * float(np.abs(scene.inflow.factor(ends)).max())
    length = scene.forces.reference_length
    viscosity = float(scene.fluid.apparent_viscosity(np.array([speed / length]))[0])
    if not scene.fluid.density * speed * length > _SHEDDING * viscosity:
        return ""
    period, step = length / (_STROUHAL * speed), float(steps.max())
    error = (2 * math.pi * step / period) ** 2 / 12
    if error <= ACCEPTED:
        return ""
    return (
        f"a vortex street, which has a period of about {period:.2g} s, would not be resolved "
        f"({period / step:.2g} steps): {_smaller(scene, step, error)}"
    )


def _ramp(scene: Scene, ends: Floats, steps: Floats) -> str:
    """Judge the ramp of the inflow, half a period of a cosine."""
    if scene.inflow is None or scene.inflow.ramp is None or not scene.inflow.mean_velocity:
        return ""
    ramp = scene.inflow.ramp
    step = float(steps[ends - steps < ramp * (1 - 1e-9)].max(initial=steps[0]))
    error = (math.pi * step / ramp) ** 2 / 12
    if error <= ACCEPTED:
        return ""
    return (
        f"{ramp / step:.3g} steps for the inflow's ramp are too few: inflow.ramp = {_digits(ramp * _more(error), 1)}, "
        f"or {_smaller(scene, step, error)}"
    )


def _waveform(scene: Scene, ends: Floats, steps: Floats) -> str:
    """Judge the waveform of the inflow: its second differences over the steps."""
    assert scene.time is not None
    if scene.inflow is None or not scene.inflow.mean_velocity:
        return ""
    factor = scene.inflow.waveform_factor
    t = np.linspace(0.0, float(ends[-1]), min(_SAMPLES, 16 * len(ends) + 1))
    k = steps[np.minimum(np.searchsorted(ends, t), len(steps) - 1)]
    everywhere = factor(np.linspace(0.0, max(scene.time.end, scene.inflow.period or 0.0), _SAMPLES))
    if not np.isfinite(everywhere).all() or np.ptp(everywhere) <= 1e-9 * np.abs(everywhere).max():
        return ""
    changes = [factor(t + h * k) - 2 * factor(t) + factor(np.abs(t - h * k)) for h in _SPACINGS]
    error = max(_rms(np.nan_to_num(change)) for change in changes) / 12 / float(np.std(everywhere))
    if error <= ACCEPTED:
        return ""
    return (
        f"the steps are too large for the waveform of the inflow ({_percent(error)}): {_smaller(scene, k.max(), error)}"
    )


def _motion(scene: Scene, history: pd.DataFrame, steps: Floats) -> str:
    """Judge the forces and displacements: their second differences over the steps."""
    worst, name, at = 0.0, "", 0
    for names, noise in _signals(scene, history):
        table = history[names].to_numpy(np.float64)[2:]  # the first steps are those of an impulsive start
        scale = float(np.abs(table).max(initial=0.0))
        for start in range(0, max(1, len(table) - _WINDOW // 2), _WINDOW // 2):
            window = table[start : start + _WINDOW]
            if len(window) < _FEWEST:
                continue
            amplitude = np.ptp(window, axis=0) / 2
            for column in np.flatnonzero(amplitude > max(_SIGNIFICANT * scale, noise)):
                change = math.sqrt(2.0) * _rms(np.diff(window[:, column], 2))
                error = change / 12 / float(amplitude[column])
                if error > worst:
                    worst, name, at = error, names[column], start + 2
    if not worst > ACCEPTED:
        return ""
    return (
        f"the steps are too large for the motion: {name} changes too much from step to step ({_percent(worst)}, from "
        f"t = {history['time'].iloc[at]:.4g} s on): {_smaller(scene, steps[at:].max(), worst)}"
    )


def _signals(scene: Scene, history: pd.DataFrame) -> list[tuple[list[str], float]]:
    """Return the displacements and the forces of the history, with the size (m, N/m) of what is but noise."""
    names, size = list(map(str, history.columns)), _size(scene)
    displacements = [name for name in names if name.endswith(("_ux", "_uy"))]
    forces = [name for name in names if name in ("drag", "lift")]
    found = [(displacements, _NOISE * size), (forces, _NOISE * _driving_energy(scene) / size)]
    return [(group, noise) for group, noise in found if group]


def _damping(scene: Scene, history: pd.DataFrame, steps: Floats) -> str:
    """Judge what the scheme takes from an oscillation in each of its periods, where theta is above 1/2."""
    assert scene.time is not None
    name = oscillation.reference_column(history)
    if name is None:
        return ""
    try:
        found = oscillation.mean_amplitude_frequency(history["time"], history[name])
    except ValueError:
        return ""
    noise = max(noise for names, noise in _signals(scene, history) if name in names)
    if not found.amplitude > max(_SIGNIFICANT * float(history[name].abs().max()), noise):
        return ""
    step = float(np.median(steps[-_WINDOW:]))
    loss = (2 * math.pi) ** 2 * (scene.time.theta_of(step) - 0.5) * step * found.frequency
    if not loss > ACCEPTED:
        return ""
    first = scene.time.scheme == "backward-euler"
    other = ', or time.scheme = "shifted-crank-nicolson"' if first else ""
    needed = loss**2 / ACCEPTED if first else loss  # of first order: as many times more steps as it is too large
    return (
        f"the scheme damps the motion: {name} loses about {_hundredths(min(loss, 1.0))} % of its amplitude in each "
        f"period: {_smaller(scene, step, needed)}{other}"
    )


def _energy(scene: Scene, energy: dict[str, float]) -> str:
    """Judge what the balance of the energy misses."""
    error = abs(energy.get("imbalance", 0.0))
    if error <= ACCEPTED or abs(energy["work"]) <= _NOISE * _driving_energy(scene):
        return ""
    if not math.isfinite(error):
        return "the energy balance is no number"
    assert scene.time is not None
    # A coarse mesh of a flow loses some, too.
    finer = f", or mesh.level = {scene.mesh.level + 1}" if scene.fluid else ""
    cure = _smaller(scene, scene.time.step, error)
    if scene.inflow and scene.inflow.ramp is None and scene.inflow.mean_velocity and scene.inflow.factor(0.0) != 0:
        cure = f"it starts with a jump, inflow.ramp = {_digits(20 * scene.time.step, 0)} or more ends that; or {cure}"
    return f"the energy balance misses {_hundredths(error)} % of the work done: {cure}{finer}"


def _driving_energy(scene: Scene) -> float:
    """Return the energy that inflow, gravity and tractions make up over the domain, J per metre depth; 0 without."""
    areas = scene.exact_areas()
    speed = (scene.inflow.mean_velocity if scene.inflow else None) or 0.0
    weight = math.hypot(scene.gravity.x, scene.gravity.y) * _size(scene) if scene.gravity else 0.0
    densities = {"fluid": scene.fluid.density} if scene.fluid else {}
    densities |= {name: solid.density for name, solid in scene.solid.items()}
    mass = sum(areas[name] * density for name, density in densities.items())
    load = math.hypot(scene.traction.x, scene.traction.y) if scene.traction else 0.0
    return mass * (speed**2 + weight) + load * sum(areas.values())


def _size(scene: Scene) -> float:
    """Return the size of the domain, m."""
    return math.sqrt(sum(scene.exact_areas().values()))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0


def _more(error: float) -> float:
    """Return how many times more steps an error needs that is of second order."""
    return math.sqrt(error / ACCEPTED)


def _percent(error: float) -> str:
    return f"an error of about {_hundredths(error)} %" if error < 0.2 else "they do not follow it at all"


def _smaller(scene: Scene, step: float, error: float) -> str:
    assert scene.time is not None
    text = f"time.step = {_digits(step / _more(error), 0)} or less"
    return f"{text}, or a smaller time.error" if scene.time.adaptive else text


def _digits(value: float, up: int) -> str:
    """Return a value with two digits, rounded down (or up)."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{(math.floor(value / unit) + up) * unit:.2g}"


def _hundredths(value: float) -> str:
    return f"{float(f'{100 * value:.2g}'):g}"
