"""TAWSS, OSI and RRT of signals whose indices are known, and the file of a cycle."""

from pathlib import Path

import numpy as np
import pytest

from ffsi.files.arrays import write_arrays
from ffsi.files.cycles import WallCycle, read_cycle, read_cycles
from ffsi.files.errors import InputError
from ffsi.hemodynamics.cycles import change
from ffsi.hemodynamics.walls import wall_points


def cycle_of(tau: np.ndarray, times: np.ndarray) -> WallCycle:
    """One point whose stress (m, 2) is known at the times (m,): the trapezoidal rule."""
    size = np.hypot(*tau.T)
    integral = np.trapezoid(tau, times, axis=0) if hasattr(np, "trapezoid") else np.trapz(tau, times, axis=0)
    magnitude = float(np.sum((size[1:] + size[:-1]) / 2 * np.diff(times)))
    return WallCycle(
        1, times[0], times[-1], np.array([0]), integral[None], np.array([magnitude]), np.array([size.max()])
    )


def of_sums(integral: list[float], magnitude: list[float]) -> WallCycle:
    """A second of a stress along x."""
    vector = np.column_stack([integral, np.zeros(2)])
    return WallCycle(1, 0.0, 1.0, np.arange(2), vector, np.array(magnitude), np.ones(2))


TIMES = np.linspace(0.0, 0.8, 4001)


def test_indices_of_given_stresses_and_of_files(tmp_path: Path) -> None:
    cycle = cycle_of(np.tile([0.3, -0.4], (len(TIMES), 1)), TIMES)
    assert cycle.tawss == pytest.approx([0.5], rel=1e-14) and cycle.osi.tolist() == [pytest.approx(0.0, abs=1e-14)]
    assert cycle.rrt == pytest.approx([2.0], rel=1e-12) and cycle.peak == pytest.approx([0.5])
    tau = np.column_stack([3.0 * np.sin(2 * np.pi * TIMES / 0.8), np.zeros_like(TIMES)])
    cycle = cycle_of(tau, TIMES)
    assert cycle.tawss == pytest.approx([2 * 3.0 / np.pi], rel=1e-6)
    assert cycle.osi == pytest.approx([0.5], abs=1e-12) and cycle.rrt[0] > 1e9 and cycle.peak == pytest.approx([3.0])
    # a + b sin with b > a: the zeros are at -asin(a/b), TAWSS and OSI follow by hand.
    a, b = 1.0, 2.0
    tau = np.column_stack([np.zeros_like(TIMES), a + b * np.sin(2 * np.pi * TIMES / 0.8)])
    zero = np.arcsin(a / b)
    tawss, cycle = 2 / np.pi * (a * zero + b * np.cos(zero)), cycle_of(tau, TIMES)
    assert cycle.tawss == pytest.approx([tawss], rel=1e-6)
    assert cycle.osi == pytest.approx([0.5 * (1 - a / tawss)], rel=1e-5)
    assert cycle.rrt == pytest.approx([1 / a], rel=1e-6)
    angle = 2 * np.pi * TIMES / 0.8
    cycle = cycle_of(np.column_stack([np.cos(angle), np.sin(angle)]), TIMES)
    assert cycle.tawss == pytest.approx([1.0]) and cycle.osi == pytest.approx([0.5], abs=1e-6)
    # The ratio is above 1 by rounding; nothing ever flows at the second point.
    assert of_sums([1.0 + 1e-15, 0.0], [1.0, 0.0]).osi.tolist() == [0.0, 0.0]
    assert of_sums([0.0, 1.0], [0.0, 2.0]).rrt.tolist() == [np.inf, 1.0]
    assert np.isnan(of_sums([0.1, np.nan], [np.nan, 1.0]).osi).all()
    assert np.isnan(change(np.array([1.0, 1.0]), np.array([np.nan, 1.0]), np.ones(2)))
    assert change(np.array([1.0, 2.0]), np.array([1.0, 4.0]), np.array([1.0, 0.25])) == pytest.approx(
        np.sqrt(0.25 * 4 / (1 + 0.25 * 16))
    )
    cycle = read_cycle(written(tmp_path / "wall-0003.bin", [7, 5]))
    assert (cycle.number, cycle.start, cycle.end) == (3, 1.6, 2.4) and cycle.node.tolist() == [7, 5]
    assert cycle.integral.tolist() == [[10.0, 20.0], [11.0, 21.0]]
    assert (cycle.magnitude.tolist(), cycle.peak.tolist()) == ([30.0, 31.0], [40.0, 41.0])
    assert cycle.tawss == pytest.approx([30 / 0.8, 31 / 0.8])
    written(tmp_path / "wall-0002.bin", [7, 5])
    assert len(read_cycles(tmp_path)) == 2
    path = written(tmp_path / "wall-0003.bin", [7, 5])
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InputError, match="wall-0003"):
        read_cycle(path)
    with pytest.raises(InputError, match="wall-0009"):
        read_cycle(tmp_path / "wall-0009.bin")


def written(path: Path, node: list[int]) -> Path:
    n = len(node)
    values = [10.0 * i + np.arange(n) for i in range(1, 5)]
    write_arrays(path, [np.array([1, 3, n]), np.array([1.6, 2.4]), np.array(node), *values])
    return path


def test_cycles_are_put_into_the_order_of_the_points(tmp_path: Path) -> None:
    from test_hemodynamics import channel

    points = wall_points(channel(), [3, 4])
    shuffled = points.middle[::-1]
    cycle = read_cycle(written(tmp_path / "wall-0001.bin", shuffled.tolist())).at(points.middle)
    assert cycle.node.tolist() == points.middle.tolist()
    assert cycle.magnitude.tolist() == (30.0 + np.arange(12))[::-1].tolist()
    with pytest.raises(InputError, match="another mesh"):
        read_cycle(written(tmp_path / "wall-0001.bin", [1, 2])).at(points.middle)
