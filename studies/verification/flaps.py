"""How the values of the paper's flaps, which nobody published, change from one mesh level to the next."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from studies import measurement
from studies.measurement import Measurement, Variant
from studies.tables import NOTHING, TextTable, number, size
from studies.verification.section import Part, Section, by_variant

CASES = ("flap-neo-hookean", "flap-mooney-rivlin", "flap-neo-hookean-roof", "flap-mooney-rivlin-roof")
VELOCITY = 0.055  # m/s, mean inflow, the last of the paper's sweep
LEVELS = range(5)
VARIANTS = tuple(Variant(case, f"inflow-{VELOCITY}", case, (f"inflow.mean_velocity={VELOCITY}",)) for case in CASES)
INTRODUCTION = (
    f"Flaps of the paper at a mean inflow of {VELOCITY} m/s: differences from one mesh level to the next, of the tip's "
    "displacement (length of the difference over length) and of the drag."
)


def run(levels: Sequence[int] | None = None) -> list[Measurement]:
    """Run every flap on `levels`; None: 0 to 4."""
    return measurement.measure_all(VARIANTS, levels or LEVELS)


def tip_difference(coarse: Measurement, fine: Measurement) -> float:
    """Return the length of the difference of the tip's displacements over the finer one's; NaN without a value."""
    first, second = ([run.value(name) for name in ("tip_ux", "tip_uy")] for run in (coarse, fine))
    return math.dist(first, second) / math.hypot(*second)


def drag_difference(coarse: Measurement, fine: Measurement) -> float:
    """Return the size of the relative difference of the drags; NaN without a value."""
    return abs(coarse.value("drag") / fine.value("drag") - 1)


def level_table(runs: Iterable[Measurement]) -> TextTable:
    """Return one row per run: tip, drag, their differences from the level before, the checker's largest number."""
    head = ("case", "level", "unknowns", "seconds", "u_x in m", "u_y in m", "drag in N/m", "tip", "drag")
    table = TextTable((*head, "largest check"))
    for own in by_variant(runs).values():
        for before, run in zip([None, *own], own, strict=False):
            differences = [size(of(before, run)) if before else NOTHING for of in (tip_difference, drag_difference)]
            table.add(
                run.case,
                str(run.level),
                run.unknowns,
                run.seconds,
                *_values(run),
                *differences,
                number(run.check_maximum, "{:.0e}"),
            )
    return table


def difference_table(runs: Sequence[Measurement]) -> TextTable:
    """Return one row per case: the finest values, and all differences between successive levels."""
    steps = list(pairwise(sorted({run.level for run in runs})))
    names = [f"{name} {coarse}-{fine}" for name in ("tip", "drag") for coarse, fine in steps]
    table = TextTable(("case", "u_x in m", "u_y in m", "drag in N/m", *names))
    for own in by_variant(runs).values():
        pairs = list(pairwise(own))
        cells = [size(of(*pair)) for of in (tip_difference, drag_difference) for pair in pairs]
        table.add(own[-1].case, *_values(own[-1]), *cells)
    return table


def _values(run: Measurement) -> list[str]:
    return [number(run.value(name), "{:.5g}") for name in ("tip_ux", "tip_uy", "drag")]


def full(runs: Sequence[Measurement]) -> list[Part]:
    """Return every run."""
    return [INTRODUCTION, level_table(runs)]


def brief(runs: Sequence[Measurement]) -> list[Part]:
    """Return the differences."""
    return [INTRODUCTION, difference_table(runs)]


FLAPS = Section("flap-levels", "Flaps over the mesh levels", run, full, brief)
