"""Runs of the aneurysm on several meshes, and what they come to."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from ffsi.hemodynamics.result import Result
from ffsi.scene import Aneurysm, Scene
from studies.verification.aneurysm import HELD, VARIANTS, AneurysmVariant
from studies.verification.bent_channel import bent_flow
from studies.verification.far_from_dome import far_flow
from studies.verification.measured import Measured, Row

CHANGES = ("wss_mean_dome", "effective_stress_max")
STEADY_LEVELS = (1, 2, 3)
STEADY_VARIANTS = (*(variant for variant in VARIANTS if not variant.pulsatile), HELD)


@dataclass(frozen=True)
class AneurysmCase:
    """A variant on a mesh level."""

    variant: AneurysmVariant
    level: int

    @property
    def group(self) -> str:
        """Steady or pulsatile."""
        return "pulsatile" if self.variant.pulsatile else "steady"

    @property
    def folder(self) -> str:
        """Name of the run folder."""
        return f"aneurysm-{self.variant.name}-level-{self.level}"

    @property
    def labels(self) -> tuple[str, ...]:
        """Walls and blood, and mesh level."""
        return self.variant.label, str(self.level)

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return self.variant.scene(self.level)

    def measure(self, result: Result) -> dict[str, Measured]:
        """Return what `result.json` has of it; of a steady flow also the flow far from the dome."""
        if self.variant.pulsatile:
            found = result.data["cycles"][-1]
            names = ("tawss_mean_dome", "tawss_min_dome", "osi_max_dome", "tawss_change")
            return {
                "steps": Measured(float(result.data["time"]["steps"])),
                **{name: Measured(found[name]) for name in names},
            }
        found = result.quantities
        names = ("mass_balance", "wss_mean_dome", "effective_stress_max", "dome_displacement_max")
        assert isinstance(result.scene.geometry, Aneurysm) and result.scene.fluid is not None
        _, inner, outer, _ = result.scene.geometry.radii
        straight = bent_flow(result.scene.fluid, inner, outer, found["flow_rate_in"]).gradient * math.pi / 2
        return {
            **{name: Measured(found[name]) for name in names if name in found},
            "pressure_drop": Measured(found["pressure_drop"], straight),
            **far_flow(result),
        }


def level_changes(rows: Sequence[Row]) -> list[Row]:
    """Return a row for every steady variant: what changes from one mesh level to the next, relative to the finer one.

    Quantities: `wss_mean_dome_2`, the change from level 1 to 2, `effective_stress_max_3`, ...
    """
    steady = [row for row in rows if row.group == "steady" and not row.failure]
    found = []
    for label in dict.fromkeys(row.labels[0] for row in steady):
        own = sorted((row for row in steady if row.labels[0] == label), key=lambda row: row.level)
        numbers = {
            f"{name}_{finer.level}": Measured(1 - coarser.numbers[name].value / finer.numbers[name].value)
            for coarser, finer in itertools.pairwise(own)
            for name in CHANGES
            if name in finer.numbers and finer.level == coarser.level + 1
        }
        case = own[-1].case.rpartition("-level-")[0]
        found.append(Row("levels", case, (label,), own[-1].level, numbers))
    return found


ANEURYSM_CASES = (
    *(AneurysmCase(variant, level) for variant in STEADY_VARIANTS for level in STEADY_LEVELS),
    *(
        AneurysmCase(variant, level)
        for variant in VARIANTS
        if variant.pulsatile
        for level in ((1, 2) if variant.name == "pulsatile-elastic" else (2,))
    ),
)
