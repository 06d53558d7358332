"""Shear stress of the fluid on its walls, of a state and over the cycles of a run (docs/formats.md).

With n, the unit normal of the deformed wall into the fluid, the viscous traction is t = mu (grad v + (grad v)^T) n and
the shear stress its part along the wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawState
from ffsi.files.cycles import WallCycle
from ffsi.reference.forces import side_flow
from ffsi.reference.relative import largest, relative
from ffsi.reference.sizes import ROUNDING, largest_on
from ffsi.reference.system import System

_SAME = 1e-9


@dataclass(frozen=True)
class WallShear:
    """Shear stress (n, 2) pascals at the P2 ``nodes`` (n,) in the middles of the edges that fluid and walls share.

    Below the ``least`` one, pascals, a scale is rounding of what cancels in a plug flow.
    """

    nodes: Ints
    stress: Floats
    least: float = 0.0

    @property
    def size(self) -> Floats:
        """Its absolute value, (n,) pascals."""
        return np.asarray(np.hypot(*self.stress.T))

    def difference(self, nodes: Ints, stress: Floats) -> float:
        """Largest difference from the ``stress`` (m, 2) at ``nodes`` (m,), relative to the largest size.

        Infinite if the nodes are not the same.
        """
        if (order := _order(nodes, self.nodes)) is None:
            return np.inf
        return relative(largest(np.abs(stress[order] - self.stress).ravel()), max(float(self.size.max()), self.least))


def wall_shear(system: System, state: RawState) -> WallShear | None:
    """Shear stress of a state; None where no fluid meets a wall."""
    if system.fluid is None:
        return None
    labels = [*system.problem.labels("no-slip"), *system.problem.labels("interface")]
    sides = system.fluid.sides.select(np.isin(system.fluid.sides.label, labels))
    if not len(sides.nodes):
        return None
    flow = side_flow(system.fluid, sides, state, np.array([0.5]))
    outward = np.einsum("nqij,nj->nqi", flow.cofactor, sides.normal)
    normal = -outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    viscosity = flow.viscosity(system.fluid.law.viscosity)[..., None]
    traction = viscosity * np.einsum("nqij,nqj->nqi", flow.doubled_deformation_rate, normal)
    across = np.einsum("nqi,nqi->nq", traction, normal)[..., None] * normal
    rate = (largest_on(state.v, system.fluid.elements) / np.sqrt(system.fluid.elements.area))[sides.element]
    least = ROUNDING * float((viscosity[:, 0, 0] * rate).max())
    return WallShear(sides.nodes[:, 2], (traction - across)[:, 0], least)


def _order(nodes: Ints, wanted: Ints) -> Ints | None:
    """Places of the ``wanted`` nodes among ``nodes``; None if these are others."""
    if len(nodes) != len(wanted) or not np.array_equal(np.sort(nodes), np.sort(wanted)):
        return None
    return np.argsort(nodes)[np.argsort(np.argsort(wanted))]


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


def cycle_difference(cycle: WallCycle, passages: Sequence[Passage]) -> float:
    """Largest relative difference of a cycle from the sums of the steps, where they make up the whole of it.

    Of steps that do not, only the peak is compared, which none of their states may exceed. Infinite if the nodes are
    not the same.
    """
    inside = [each for each in passages if each.end > cycle.start and each.start < cycle.end]
    if not inside:
        return 0.0
    if (order := _order(cycle.node, inside[0].after.nodes)) is None:
        return np.inf
    length = sum(min(each.end, cycle.end) - max(each.start, cycle.start) for each in inside)
    found = [_above_peak(cycle, each, order) for each in inside]
    if abs(length - (cycle.end - cycle.start)) <= _SAME * length:
        parts = [each.integrals(cycle.start, cycle.end) for each in inside]
        integral, magnitude = (np.sum(part, axis=0) for part in zip(*parts, strict=True))
        size = float(magnitude.max())
        found.append(relative(largest(np.abs(cycle.integral[order] - integral).ravel()), size))
        found.append(relative(largest(np.abs(cycle.magnitude[order] - magnitude)), size))
        highest = np.max([each.after.size for each in inside] + [inside[0].before.size], axis=0)
        found.append(relative(largest(cycle.peak[order] - highest), float(highest.max())))
    return largest(found)


def _above_peak(cycle: WallCycle, step: Passage, order: Ints) -> float:
    """By how much a step inside of the cycle ends above the peak, relative to the largest size there."""
    if not step.end < cycle.end - _SAME * (cycle.end - cycle.start):
        return 0.0
    above = largest(step.after.size - cycle.peak[order])
    return relative(above, float(step.after.size.max()))
