"""Indices of the wall shear stress over a cycle of the flow: TAWSS, OSI, RRT, peak."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import Floats, Ints, RawFileError, read_arrays
from ffsi.files.errors import InputError

logger = logging.getLogger(__name__)

_VERSION = 1
_SAME = 1e-9


@dataclass(frozen=True)
class WallCycle:
    """Sums of the wall shear stress tau over cycle ``number``, from 1, between the times ``start`` and ``end``, s.

    ``node`` (n,) is the P2 node of each point, in the middle of a wet edge; ``integral`` (n, 2) Pa s that of tau,
    ``magnitude`` (n,) Pa s that of |tau|, ``peak`` (n,) Pa the largest |tau|.
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
        """Oscillatory shear index (1 - |int tau dt| / int |tau| dt) / 2, (n,), 0 to 1/2; 0 where nothing ever flows."""
        vector, size = np.hypot(*self.integral.T), self.magnitude
        ratio = np.divide(vector, size, out=np.ones_like(size), where=size != 0)
        # Of one rounding above 1 where the direction never changes.
        return np.asarray(0.5 * (1.0 - np.minimum(ratio, 1.0)))

    @property
    def rrt(self) -> Floats:
        """Relative residence time 1/((1 - 2 OSI) TAWSS), (n,) 1/Pa; infinite where the mean of tau is zero."""
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / ((1.0 - 2.0 * self.osi) * self.tawss))

    def at(self, nodes: Ints) -> WallCycle:
        """Return the same in the order of some nodes of the mesh; raises InputError if one is none of the cycle's."""
        order = np.argsort(self.node)
        place = order[np.minimum(np.searchsorted(self.node, nodes, sorter=order), len(order) - 1)]
        if not np.array_equal(self.node[place], nodes):
            raise InputError("the sums of the wall shear stress belong to another mesh")
        sums = {name: getattr(self, name)[place] for name in ("integral", "magnitude", "peak")}
        return replace(self, node=nodes, **sums)


def read_cycle(path: Path) -> WallCycle:
    """Read `wall-0003.bin` (docs/formats.md); raises InputError if it is missing, cut off or of another version."""
    try:
        head, times, node, x, y, magnitude, peak = read_arrays(path, (int, float, int, float, float, float, float))
    except (OSError, RawFileError) as error:
        raise InputError(f"cannot read {path}: {error}") from error
    lengths = [len(array) for array in (head, times, node, x, y, magnitude, peak)]
    if lengths != [3, 2, *[len(node)] * 5] or head[::2].tolist() != [_VERSION, len(node)]:
        raise InputError(f"{path}: no sums of the wall shear stress, or of another version")
    integral = np.column_stack([x, y]).astype(np.float64)
    sums = [array.astype(np.float64) for array in (magnitude, peak)]
    return WallCycle(int(head[1]), float(times[0]), float(times[1]), node.astype(np.int64), integral, *sums)


def read_cycles(directory: Path) -> list[WallCycle]:
    """Return the cycles that a run has written, in time; raises InputError if a file is damaged."""
    return [read_cycle(path) for path in sorted(directory.glob(folder.WALL_CYCLES))]


def cycles_until(directory: Path, time: float) -> list[str]:
    """Return the names of the files of cycles that end by a time in s."""
    found = []
    for path in sorted(directory.glob(folder.WALL_CYCLES)):
        try:
            if read_cycle(path).end <= time * (1 + _SAME):
                found.append(path.name)
        except InputError as error:  # cut off by a kill
            logger.debug("%s", error)
    return found
