"""Shear stress of the fluid on its walls, of a state and over the cycles of a run (docs/formats.md).

With n, the unit normal of the deformed wall into the fluid, the viscous traction is t = mu (grad v + (grad v)^T) n and
the shear stress its part along the wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawState, read_arrays
from ffsi.reference.forces import side_flow
from ffsi.reference.relative import largest, relative
from ffsi.reference.system import FluidPart, Sides, System

_SAME = 1e-9


@dataclass(frozen=True)
class WallShear:
    """Shear stress (n, 2) pascals at the P2 ``nodes`` (n,) in the middles of the edges that fluid and walls share."""

    nodes: Ints
    stress: Floats

    @property
    def size(self) -> Floats:
        """Its absolute value, (n,) pascals."""
        result: Floats = np.hypot(*self.stress.T)
        return result

    def difference(self, nodes: Ints, stress: Floats) -> float:
        """Largest difference from the ``stress`` (m, 2) at ``nodes`` (m,), relative to the largest size.

        Infinite if the nodes are not the same.
        """
        if (order := _order(nodes, self.nodes)) is None:
            return np.inf
        return relative(largest(np.abs(stress[order] - self.stress).ravel()), float(self.size.max()))


def wall_shear(system: System, state: RawState) -> WallShear | None:
    """Shear stress of a state; None where no fluid meets a wall."""
    if system.fluid is None:
        return None
    labels = [*system.problem.labels("no-slip"), *system.problem.labels("interface")]
    sides = system.fluid.sides.select(np.isin(system.fluid.sides.label, labels))
    return _wall_shear(system.fluid, sides, state) if len(sides.nodes) else None


def _wall_shear(fluid: FluidPart, sides: Sides, state: RawState) -> WallShear:
    flow = side_flow(fluid, sides, state, np.array([0.5]))
    outward = np.einsum("nqij,nj->nqi", flow.cofactor, sides.normal)
    normal = -outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    viscosity = flow.viscosity(fluid.law.viscosity)[..., None]
    traction = viscosity * np.einsum("nqij,nqj->nqi", flow.doubled_deformation_rate, normal)
    across = np.einsum("nqi,nqi->nq", traction, normal)[..., None] * normal
    return WallShear(sides.nodes[:, 2], (traction - across)[:, 0])


def _order(nodes: Ints, wanted: Ints) -> Ints | None:
    """Places of the ``wanted`` nodes among ``nodes``; None if these are others."""
    if len(nodes) != len(wanted) or not np.array_equal(np.sort(nodes), np.sort(wanted)):
        return None
    order: Ints = np.argsort(nodes)[np.argsort(np.argsort(wanted))]
    return order


# Cycles ---------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Passage:
    """A step from ``start`` to ``end``, seconds, and the shear stress at both."""

    start: float
    end: float
    before: WallShear
    after: WallShear

    def integrals(self, start: float, end: float) -> tuple[Floats, Floats]:
        """Integrals over the part of the step between two times of the stress (n, 2) and of its size (n,), Pa s.

        Both are taken as linear functions of the time.
        """
        begin, finish = max(start, self.start), min(end, self.end)
        weight = (0.5 * (begin + finish) - self.start) / (self.end - self.start)
        length = max(0.0, finish - begin)
        stress = (1.0 - weight) * self.before.stress + weight * self.after.stress
        size = (1.0 - weight) * self.before.size + weight * self.after.size
        return length * stress, length * size


@dataclass(frozen=True)
class WallCycle:
    """Sums over the cycle from ``start`` to ``end`` that a run has written, in the order of its ``nodes`` (n,).

    ``integral`` (n, 2) and ``magnitude`` (n,) Pa s of the stress and of its size, ``peak`` (n,) Pa its largest size.
    """

    start: float
    end: float
    nodes: Ints
    integral: Floats
    magnitude: Floats
    peak: Floats

    @classmethod
    def read(cls, path: Path) -> "WallCycle":
        """Read a file ``wall-0003.bin``. Raises ``ValueError`` if it is damaged."""
        head, times, nodes, *sums = read_arrays(path, (int, float, int, float, float, float, float))
        lengths = [len(array) for array in (times, nodes, *sums)]
        if lengths != [2, *[len(nodes)] * 5] or head.tolist()[::2] != [1, len(nodes)]:
            raise ValueError(f"{path}: no sums of the wall shear stress, or of another version")
        x, y, magnitude, peak = (np.asarray(array, dtype=np.float64) for array in sums)
        return cls(float(times[0]), float(times[1]), nodes.astype(np.int64), np.column_stack([x, y]), magnitude, peak)

    def difference(self, passages: Sequence[Passage]) -> float:
        """Largest relative difference from the sums of the steps, where they make up the whole cycle.

        Of steps that do not, only the peak is compared, which none of their states may exceed. Infinite if the nodes
        are not the same.
        """
        inside = [each for each in passages if each.end > self.start and each.start < self.end]
        if not inside:
            return 0.0
        if (order := _order(self.nodes, inside[0].after.nodes)) is None:
            return np.inf
        length = sum(min(each.end, self.end) - max(each.start, self.start) for each in inside)
        found = [self._above_peak(each, order) for each in inside]
        if abs(length - (self.end - self.start)) <= _SAME * length:
            parts = [each.integrals(self.start, self.end) for each in inside]
            integral, magnitude = (np.sum(part, axis=0) for part in zip(*parts, strict=True))
            size = float(magnitude.max())
            found.append(relative(largest(np.abs(self.integral[order] - integral).ravel()), size))
            found.append(relative(largest(np.abs(self.magnitude[order] - magnitude)), size))
            highest = np.max([each.after.size for each in inside] + [inside[0].before.size], axis=0)
            found.append(relative(largest(self.peak[order] - highest), float(highest.max())))
        return largest(found)

    def _above_peak(self, step: Passage, order: Ints) -> float:
        """By how much a step inside of the cycle ends above the peak, relative to the largest size there."""
        if not step.end < self.end - _SAME * (self.end - self.start):
            return 0.0
        above = largest(step.after.size - self.peak[order])
        return relative(above, float(step.after.size.max()))
