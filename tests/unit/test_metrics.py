"""Mean, amplitude and frequency of signals that are known exactly."""

import math

import numpy as np
import pandas as pd
import pytest

from ffsi.files.arrays import Floats
from ffsi.files.history import flaw
from ffsi.result.oscillation import blocks, mean_amplitude_frequency, oscillations, periodic, reference_column

F = 5.46  # Hz
STEP = 0.005  # s, 37 steps in a period


def times(end: float, step: float = STEP) -> Floats:
    return np.arange(round(end / step) + 1) * step


def wave(t: Floats, mean: float, amplitude: float, frequency: float = F, phase: float = 0.3) -> Floats:
    return mean + amplitude * np.sin(2 * np.pi * frequency * t + phase)


def growth(t: Floats, rate: float = 2.0, full: float = 4.0) -> Floats:
    """Exponential growth that is complete at the time `full`."""
    return np.minimum(1.0, np.exp(rate * (t - full)))


def fsi3(t: Floats) -> pd.DataFrame:
    """A history like that of the benchmark: growth, then saturation; drag and tip_ux with twice the frequency."""
    size = growth(t)
    return pd.DataFrame(
        {
            "time": t, "step": STEP, "drag": 457.3 * (1 - np.exp(-3 * t)) + size * wave(t, 0, 22.66, 2 * F),
            "lift": size * wave(t, 2.22, 149.78, phase=1.0), "tip_ux": size * wave(t, -2.69, 2.53, 2 * F, 2.0),
            "tip_uy": 1.48 + size * wave(t, 0, 34.38), "min_jacobian": 0.4, "iterations": 3, "seconds": 0.01,
        }
    )  # fmt: skip


@pytest.mark.parametrize(("step", "tolerance"), [(0.01, 3e-4), (STEP, 2e-6), (0.001, 2e-6)])
def test_sine(step: float, tolerance: float) -> None:
    t = times(1.5, step)
    found = mean_amplitude_frequency(t, wave(t, 1.48, 34.38))
    assert found.amplitude == pytest.approx(34.38, rel=tolerance)
    assert found.mean == pytest.approx(1.48, abs=34.38 * tolerance) and found.frequency == pytest.approx(F, rel=1e-5)
    assert found.end - found.start == pytest.approx(1 / F, rel=1e-5) and 1.5 - 1 / F < found.end <= 1.5
    assert not found.reason


def test_neither_long_nor_uneven_steps_limit_the_amplitude() -> None:
    # Ten points in a period that always miss the maximum: the largest of them is 5 % below it.
    t = np.arange(41) / 10
    y = np.cos(2 * np.pi * (t - 0.05))
    assert y.max() < 0.952 and mean_amplitude_frequency(t, y).amplitude == pytest.approx(1.0, abs=4e-3)
    random = np.random.default_rng(2)
    t = np.cumsum(random.uniform(0.2, 1.8, 600)) * STEP
    found = mean_amplitude_frequency(t, wave(t, 1.48, 34.38))
    assert (found.mean, found.amplitude, found.frequency) == pytest.approx((1.48, 34.38, F), rel=2e-3)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step", [STEP, 0.001])
def test_noise(step: float, seed: int) -> None:
    t, random = times(3.0, step), np.random.default_rng(seed)
    found = mean_amplitude_frequency(t, wave(t, 1.48, 34.38) + random.normal(0, 0.3438, len(t)))
    assert found.amplitude == pytest.approx(34.38, rel=0.015)
    assert found.mean == pytest.approx(1.48, abs=0.015 * 34.38) and found.frequency == pytest.approx(F, rel=0.005)


def test_harmonics_do_not_count_but_the_reference_s_period() -> None:
    t, fine = times(2.0), np.linspace(0, 1 / F, 200001)

    def signal(t: Floats) -> Floats:
        return 2.5 + wave(t, 0, 150) + wave(t, 0, 45, 3 * F, 1.1) + wave(t, 0, 10, 2 * F, 0.4)

    exact, found = signal(fine), mean_amplitude_frequency(t, signal(t))
    assert found.amplitude == pytest.approx(np.ptp(exact) / 2, rel=1e-3)
    assert found.mean == pytest.approx((exact.max() + exact.min()) / 2, abs=0.2)
    assert found.frequency == pytest.approx(F, rel=5e-3)
    t = times(2.0, 0.001)
    reference = wave(t, 1.48, 34.38)
    # Maxima of two heights in turn: only the reference's period holds both.
    y, fine = wave(t, -2.88, 2.72, 2 * F, 0.6) + wave(t, 0, 0.3, F), np.linspace(0, 1 / F, 100001)
    exact = wave(fine, -2.88, 2.72, 2 * F, 0.6) + wave(fine, 0, 0.3, F)
    found = mean_amplitude_frequency(t, y, reference)
    assert found.amplitude == pytest.approx(np.ptp(exact) / 2, rel=1e-5)
    assert found.mean == pytest.approx((exact.max() + exact.min()) / 2, rel=1e-5)
    assert found.frequency == pytest.approx(2 * F, rel=1e-6)
    assert mean_amplitude_frequency(t, y).amplitude < found.amplitude - 1e-3
    t = times(6.0)
    drag = 457.3 * (1 - np.exp(-3 * t)) + growth(t) * wave(t, 0, 5.0)
    found = mean_amplitude_frequency(t, drag)
    assert (found.mean, found.amplitude, found.frequency) == pytest.approx((457.3, 5.0, F), rel=1e-4)


@pytest.mark.parametrize("rate", [0.5, 2.0, 8.0])
def test_growing_then_saturated(rate: float) -> None:
    t = times(6.0)
    y = 1.48 + growth(t, rate) * wave(t, 0, 34.38)
    found = mean_amplitude_frequency(t, y)
    assert (found.mean, found.amplitude, found.frequency) == pytest.approx((1.48, 34.38, F), rel=1e-4)


def test_two_periods_are_enough_and_a_part_of_one_is_not() -> None:
    for periods in (0.3, 0.9):
        t = times(periods / F, 0.001)
        found = mean_amplitude_frequency(t, wave(t, 0, 1, phase=-2.0))
        assert all(math.isnan(value) for value in found.as_dict().values())
        assert found.reason == "0 full periods found, 1 needed"
    t = times(2.1 / F, 0.001)
    found = mean_amplitude_frequency(t, wave(t, 1.48, 34.38))
    assert (found.amplitude, found.frequency) == pytest.approx((34.38, F), rel=1e-4)


@pytest.mark.parametrize("y", [np.full(50, 3.0), np.zeros(50), np.linspace(0, 1, 50), np.exp(-np.linspace(0, 9, 50))])
def test_what_does_not_oscillate_has_no_period(y: Floats) -> None:
    found = mean_amplitude_frequency(np.linspace(0, 1, 50), y)
    assert math.isnan(found.amplitude) and found.reason == "0 full periods found, 1 needed"
    assert not periodic(np.linspace(0, 1, 50), y)


def test_few_values_and_a_constant() -> None:
    for count in range(4):
        assert math.isnan(mean_amplitude_frequency(np.arange(count), np.arange(count)).mean)
    t = times(2.0)
    found = mean_amplitude_frequency(t, np.full_like(t, 3.0), wave(t, 0, 1))
    assert (found.mean, found.amplitude) == (3.0, 0.0) and math.isnan(found.frequency)
    assert found.reason == "the signal is constant"


@pytest.mark.parametrize(("t", "y", "text"), [
    ([0, 1], [0, 1, 2], "same length"), ([[0, 1]], [[0, 1]], "same length"), ([0, 1, 1], [0, 1, 2], "do not increase"),
    ([0, 1, 2], [0, math.nan, 2], "not finite"),
])  # fmt: skip
def test_refused(t: list[float], y: list[float], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        mean_amplitude_frequency(t, y)


def test_periods_that_agree_are_periodic_growth_and_drift_not() -> None:
    t = times(6.0)
    y = 1.48 + growth(t) * wave(t, 0, 34.38)
    first = next(end for end in range(0, len(t), 20) if periodic(t[:end], y[:end]))
    # Growth ends at t = 4; the earlier block may lie partly before that, as far as the change is below 2 %.
    assert 4.0 + 2 / F < t[first] < 4.0 + 5.2 / F
    found = periodic(t, y)
    assert found.periodic and not found.reason and max(found.amplitude_change, found.mean_change) < 1e-4
    slow = periodic(t, wave(t, 0, 1) * np.exp(0.1 * t))
    assert not slow and slow.amplitude_change == pytest.approx(1 - math.exp(-0.1 * 2 / F), rel=0.02)
    assert slow.reason == "the amplitude changes by 3.6 % of the amplitude, accepted: 2 %"
    assert periodic(t, wave(t, 0, 1) * np.exp(0.05 * t)) and not periodic(t, wave(t, 0, 1) * np.exp(-0.1 * t))
    drifting = periodic(t, wave(t, 0, 1) + 0.1 * t)
    assert not drifting and drifting.mean_change == pytest.approx(0.1 * 2 / F, rel=0.1)
    assert drifting.reason.startswith("the mean changes by 3.") and periodic(t, wave(t, 0, 1) + 0.04 * t)
    t = times(3.5 / F, 0.001)
    found = periodic(t, wave(t, 0, 1, phase=-1.6))
    assert not found and math.isnan(found.amplitude_change) and found.reason == "3 full periods found, 4 needed"


@pytest.mark.parametrize("seed", range(3))
def test_periodic_with_noise_and_uneven_steps(seed: int) -> None:
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.5, 1.5, 3000)) * 0.001
    assert periodic(t, wave(t, 1.48, 34.38) + random.normal(0, 0.1, len(t)))


def test_quantities_of_a_history() -> None:
    history = fsi3(times(6.0))
    expected = {
        "drag": (457.3, 22.66, 2 * F), "lift": (2.22, 149.78, F), "tip_ux": (-2.69, 2.53, 2 * F),
        "tip_uy": (1.48, 34.38, F),
    }  # fmt: skip
    found = oscillations(history)
    assert list(found) == list(expected)
    for name, (mean, amplitude, frequency) in expected.items():
        assert found[name].as_dict() == pytest.approx(
            {"mean": mean, "amplitude": amplitude, "frequency": frequency}, rel=5e-4, abs=1e-4 * amplitude
        )
    assert len({(item.start, item.end) for item in found.values()}) == 1
    assert reference_column(history) == "tip_uy"


@pytest.mark.parametrize("dropped", [1, 700, 1195])
def test_a_history_without_some_rows_is_refused(dropped: int) -> None:
    history = fsi3(times(6.0))[1:]
    assert flaw(history) == ""
    gap = history.drop(index=range(dropped, dropped + 3))
    assert flaw(gap) == f"step {dropped} does not begin where the one before ends"


@pytest.mark.parametrize("column", ["tip_uy", "drag", "step", "time"])
def test_a_history_with_what_is_no_number_is_refused(column: str) -> None:
    history = fsi3(times(6.0))[1:]
    history.loc[1100, column] = math.nan
    assert flaw(history) == "step 1100 has a value that is not finite"
    if column != "step":
        with pytest.raises(ValueError, match="not finite"):
            oscillations(history)


def test_reference_columns_and_signals_without_a_period() -> None:
    flow = fsi3(times(6.0))[["time", "drag", "lift"]]
    flow["lift"] *= 1e-12
    flow.loc[3, "lift"] = math.nan
    assert reference_column(flow) == "lift"
    # A drift, noise and what grows beside a periodic reference; what is periodic keeps its own.
    t = times(3.0)
    reference, noise = wave(t, 0, 1), np.random.default_rng(1).normal(size=len(t))
    for y in (t, 1e-9 * noise, np.exp(4 * t) * reference, wave(t, 0, 1, F / 2)):
        found = mean_amplitude_frequency(t, y, reference)
        assert math.isnan(found.frequency) and found.reason == "the signal does not repeat from one period to the next"
        assert math.isfinite(found.mean)
    assert mean_amplitude_frequency(t, wave(t, 3, 1, 3 * F), reference).frequency == pytest.approx(3 * F, rel=1e-4)
    assert math.isnan(mean_amplitude_frequency(t[:60], t[:60], reference[:60]).frequency)  # a period and a half
    t = np.delete(times(3.0), slice(560, 575))  # a third of a period within the last one but one
    found = mean_amplitude_frequency(t, wave(t, 0, 1))
    assert all(math.isnan(value) for value in found.as_dict().values())
    assert found.reason == "a step of 0.08 s is too long for a period of 0.183 s"
    assert periodic(t, wave(t, 0, 1)).reason == found.reason
    history = fsi3(times(6.0))
    flow = history[["time", "drag", "lift"]]
    assert reference_column(flow) == "lift" and reference_column(flow.assign(lift=1e-12 * flow["lift"])) == "drag"
    unsolved = flow.assign(
        lift=1e-7 * flow["lift"]
    )  # of a symmetric flow: the tolerance of its steps, more at the start
    unsolved.loc[:3, "lift"] = 1e-3  # at the start
    assert reference_column(unsolved) == "drag" and reference_column(flow.assign(lift=1e-4 * flow["lift"])) == "lift"
    assert reference_column(flow[:0]) == "lift" and reference_column(flow.assign(drag=0.0, lift=0.0)) == "lift"
    assert oscillations(flow)["drag"].frequency == pytest.approx(2 * F, rel=1e-4)
    assert reference_column(flow[["time", "drag"]]) is None
    assert oscillations(flow[["time", "drag"]])["drag"].amplitude == pytest.approx(22.66, rel=1e-3)


def test_blocks_from_half_of_the_final_amplitude_to_the_end() -> None:
    found = oscillations(fsi3(times(0.1)))
    assert set(found) == {"drag", "lift", "tip_ux", "tip_uy"}
    assert all(math.isnan(value) for item in found.values() for value in item.as_dict().values())
    t = times(10.0)
    found = blocks(t, wave(t, 0.3, 2.0, 1.5))
    assert len(found) == 6 and [block.start for block in found[1:]] == [block.end for block in found[:-1]]
    assert 10.0 - 2 / 1.5 < found[-1].end <= 10.0
    for block in found:
        assert (block.mean, block.amplitude, block.frequency) == pytest.approx((0.3, 2.0, 1.5), rel=1e-4)
    t = times(20.0)
    growing = wave(t, 0.0, 1.0, 2.0) * (1 - np.exp(-t / 2))
    found = blocks(t, growing)
    assert 0.5 < found[0].start < 2.5
    sizes = [block.amplitude for block in found]
    assert sizes == sorted(sizes) and sizes[-1] == pytest.approx(1.0, rel=1e-3)
    assert blocks(t[t < 0.9], growing[t < 0.9]) == []
