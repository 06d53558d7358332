"""Womersley's flow, waveforms, and the conditions of a scene."""

import math

import numpy as np
import pytest

from ffsi.reference.conditions import Outlet, Series, Support, womersley
from ffsi.reference.from_scene import problem_from_scene
from ffsi.scene import CASES, with_values

HEIGHT, MEAN, NU, PERIOD = 0.02, 0.3, 4e-6, 0.9
WAVEFORM = Series(PERIOD, (1.0, 0.4, -0.2, 0.05), (0.0, 0.3, 0.1, -0.1))
IN_TIME = {"time.step": 0.01, "time.end": 1.0}


def mean_of(values):
    points, weights = np.polynomial.legendre.leggauss(200)
    return weights @ values(0.5 * HEIGHT * (points + 1.0)) / 2.0


@pytest.mark.parametrize("time", [0.0, 0.21, 0.6, 5.3])
def test_womersley_flow_has_the_waveform_as_its_flow_rate_and_rests_at_the_walls(time):
    velocity = womersley(WAVEFORM, MEAN, HEIGHT, NU)
    angle = 2 * np.pi / PERIOD * time * np.arange(4)
    waveform = np.cos(angle) @ np.array(WAVEFORM.cosine) + np.sin(angle) @ np.array(WAVEFORM.sine)
    assert WAVEFORM(time) == pytest.approx(waveform, rel=1e-14)
    assert mean_of(lambda s: velocity(s, time)) == pytest.approx(MEAN * waveform, rel=1e-12)
    np.testing.assert_allclose(velocity(np.array([0.0, HEIGHT]), time), 0.0, atol=1e-14)


def test_womersley_flow_and_the_series_of_a_scene():
    # dv/dt - nu d2v/ds2 is the pressure gradient, one number over the height.
    velocity = womersley(WAVEFORM, MEAN, HEIGHT, NU)
    s, k, h = np.linspace(0.002, 0.018, 9), 1e-4, 1e-5
    for time in (0.1, 0.5):
        acceleration = (velocity(s, time + k) - velocity(s, time - k)) / (2 * k)
        curvature = (velocity(s + h, time) - 2 * velocity(s, time) + velocity(s - h, time)) / h**2
        gradient = acceleration - NU * curvature
        np.testing.assert_allclose(gradient, gradient.mean(), rtol=0, atol=1e-4 * np.abs(acceleration).max())
    one, s = Series(PERIOD, (0.0, 1.0), (0.0, 0.0)), np.linspace(0.0, HEIGHT, 11)
    slow = womersley(one, MEAN, HEIGHT, 1e3 * NU)(s, 0.0)
    np.testing.assert_allclose(slow, 6 * MEAN * s * (HEIGHT - s) / HEIGHT**2, atol=1e-3 * MEAN)
    # A layer at the wall so thin that exp(b h) overflows.
    fast = womersley(one, MEAN, HEIGHT, 1e-14)(s, 0.0)
    np.testing.assert_allclose(fast[1:-1], MEAN, rtol=1e-3)
    np.testing.assert_allclose(fast[[0, -1]], 0.0, atol=1e-12)
    scene = scene_of(inflow__waveform="mca")
    series, inflow = scene.inflow.fourier, problem_from_scene(scene).inflow
    angle = 2 * np.pi / series.period * 0.2 * np.arange(len(series.cosine))
    waveform = np.cos(angle) @ np.array(series.cosine) + np.sin(angle) @ np.array(series.sine)
    ramp, middle = 0.5 - 0.5 * math.cos(math.pi / 2), 1.5 * scene.inflow.mean_velocity
    assert inflow.velocity(np.array([0.205]), 0.2)[0] == pytest.approx(ramp * waveform * middle, rel=1e-13)


def scene_of(**changes):
    changes = {key.replace("__", "."): value for key, value in changes.items()}
    return with_values(CASES["turek-fsi3"], IN_TIME | {"inflow.ramp": 0.4} | changes)


@pytest.mark.parametrize(
    ("law", "viscosity"),
    [({}, 1.0), ({"fluid__law": "carreau", "fluid__viscosity_zero": 0.9, "fluid__viscosity_infinity": 0.7}, 0.7)],
)  # fmt: skip
def test_womersley_profile_of_a_scene_reaches_the_problem(law, viscosity):
    scene = scene_of(inflow__waveform="mca", inflow__profile="womersley", **law)
    series = scene.inflow.fourier
    own = womersley(
        Series(series.period, series.cosine, series.sine), scene.inflow.mean_velocity, 0.41,
        viscosity / scene.fluid.density,
    )  # fmt: skip
    s = np.linspace(0.0, 0.41, 7)
    found = problem_from_scene(scene).inflow.velocity(s, 0.3)
    np.testing.assert_allclose(found, (0.5 - 0.5 * math.cos(0.75 * math.pi)) * own(s, 0.3), rtol=1e-12, atol=1e-15)


def test_outlets_and_support_of_a_scene_reach_the_problem():
    outlet = problem_from_scene(scene_of(outlet__kind="resistance", outlet__resistance=2.0)).outlet
    assert (outlet.kind, outlet.resistance, outlet.pressure, outlet.backflow) == ("resistance", 2.0, 0.0, 0.0)
    changes = dict(proximal_resistance=3.0, distal_resistance=4.0, compliance=0.1, pressure=5.0, backflow=0.5)
    outlet = problem_from_scene(
        scene_of(outlet__kind="windkessel", **{f"outlet__{key}": value for key, value in changes.items()})
    ).outlet
    assert outlet.pressure_at(0.2) == pytest.approx(2.5, rel=1e-14)
    assert outlet.pressure_at(0.4) == outlet.pressure_at(0.7) == 5.0
    assert outlet == Outlet("windkessel", 5.0, 3.0, 4.0, 0.1, 0.5, outlet.ramp)
    roof = CASES["flap-neo-hookean-roof"]
    problem = problem_from_scene(with_values(roof, {"support.stiffness": 3.0, "support.damping": 0.2}))
    assert problem.support == Support(3.0, 0.2) and problem.labels("supported") == [7] and not problem.labels("free")
    assert problem_from_scene(roof).support is None
    scene = scene_of(inflow__waveform="mca", inflow__profile="womersley")
    wrong = scene.model_copy(update={"inflow": scene.inflow.model_copy(update={"period": None})})
    with pytest.raises(ValueError, match="needs a fluid and the Fourier series"):
        problem_from_scene(wrong)
