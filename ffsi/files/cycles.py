"""Indices of the wall shear stress over a cycle of the flow: TAWSS, OSI, RRT, peak."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ffsi.files import folder
from ffsi.files.arrays import Floats, Ints, RawFileError, read_arrays
from ffsi.files.errors import InputError

logger = logging.getLogger(__name__)

_VERSION = 1
_SAME = 1e-9


@dataclass(frozen=True)
class WallCycle:
    """Sums of the wall shear stress tau over one cycle.

    Attributes:
        number: of the cycle, from 1.
        start: time at which it begins, s.
        end: time at which it ends, s.
        node: (n,) P2 node of each point, in the middle of a wet edge.
        integral: (n, 2) integral of tau, Pa s.
        magnitude: (n,) integral of |tau|, Pa s.
        peak: (n,) largest |tau|, Pa.
    """

    number: int
    start: float
    end: float
    node: Ints
    integral: Floats
    magnitude: Floats
    peak: Floats

    @property
    def tawss(self) -> Floats:
        """Time-averaged wall shear stress (1/T) int |tau| dt, (n,) Pa; never negative."""
        return np.asarray(self.magnitude / (self.end - self.start))

    @property
    def osi(self) -> Floats:
        """Oscillatory shear index, (n,), 0 to 1/2."""
        return oscillatory_shear_index(np.hypot(*self.integral.T), self.magnitude)

    @property
    def rrt(self) -> Floats:
        """Relative residence time 1/((1 - 2 OSI) TAWSS), (n,) 1/Pa; infinite where the mean of tau is zero."""
        return relative_residence_time(self.tawss, self.osi)

    def at(self, nodes: Ints) -> WallCycle:
        """Return the same in the order of some nodes of the same mesh.

        Raises:
            InputError: a node is none of the cycle's.
        """
        order = np.argsort(self.node)
        place = np.minimum(np.searchsorted(self.node, nodes, sorter=order), len(order) - 1)
        place = order[place]
        if not np.array_equal(self.node[place], nodes):
            raise InputError("the sums of the wall shear stress belong to another mesh")
        return WallCycle(
            self.number, self.start, self.end, nodes, self.integral[place], self.magnitude[place],
            self.peak[place],
        )  # fmt: skip


def oscillatory_shear_index(integral: ArrayLike, magnitude: ArrayLike) -> Floats:
    """Return OSI = (1 - |int tau dt| / int |tau| dt) / 2, (n,); 0 where nothing ever flows.

    Args:
        integral: (n,) |int tau dt|, Pa s.
        magnitude: (n,) int |tau| dt, Pa s.
    """
    vector, size = np.asarray(integral, dtype=float), np.asarray(magnitude, dtype=float)
    ratio = np.divide(vector, size, out=np.ones_like(size), where=size != 0)
    # Of one rounding above 1 where the direction never changes.
    return np.asarray(0.5 * (1.0 - np.minimum(ratio, 1.0)))


def relative_residence_time(tawss: ArrayLike, osi: ArrayLike) -> Floats:
    """Return RRT = 1 / ((1 - 2 OSI) TAWSS), (n,) 1/Pa; infinite where its denominator is zero.

    Args:
        tawss: (n,) Pa.
        osi: (n,).
    """
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / ((1.0 - 2.0 * np.asarray(osi, dtype=float)) * np.asarray(tawss, dtype=float)))


def read_cycle(path: Path) -> WallCycle:
    """Read `wall-0003.bin` (docs/formats.md).

    Raises:
        InputError: the file is missing, cut off or of another version.
    """
    try:
        head, times, node, x, y, magnitude, peak = read_arrays(path, (int, float, int, float, float, float, float))
    except (OSError, RawFileError) as error:
        raise InputError(f"cannot read {path}: {error}") from error
    if len(head) != 3 or head[0] != _VERSION or len(times) != 2 or any(len(a) != head[2] for a in (node, x, y, peak)):
        raise InputError(f"{path} is no file of the wall shear stress of this version")
    integral = np.column_stack([x, y]).astype(np.float64)
    sums = [array.astype(np.float64) for array in (magnitude, peak)]
    return WallCycle(int(head[1]), float(times[0]), float(times[1]), node.astype(np.int64), integral, *sums)


def read_cycles(directory: Path) -> list[WallCycle]:
    """Return the cycles that a run has written, in time.

    Raises:
        InputError: a file is damaged.
    """
    return [read_cycle(path) for path in sorted(directory.glob("wall-*.bin"))]


def cycles_until(directory: Path, time: float) -> list[str]:
    """Return the names of the files of cycles that end by a time in s."""
    return sorted(path.name for path in directory.glob(folder.WALL_CYCLES) if _cycle_end(path) <= time * (1 + _SAME))


def _cycle_end(path: Path) -> float:
    """Return the time (s) at which the cycle of a file ends; infinity if it was cut off by a kill."""
    from ffsi.files.cycles import read_cycle

    try:
        return read_cycle(path).end
    except InputError as error:
        logger.debug("%s", error)
        return math.inf
