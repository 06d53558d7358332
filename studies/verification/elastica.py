"""The slender cantilever with a dead load at its tip, beside the elastica."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from studies import measurement
from studies.measurement import Measurement, Variant
from studies.tables import TextTable, number, percent
from studies.verification.section import Part, Section, by_variant
from studies.verification.sources import reference_sets

CASE = "cantilever"
LEVELS = range(4)
LOADS = (1, 2, 5, 10)  # P L^2 / (E I), which is traction.y in Pa
VARIANTS = tuple(Variant(CASE, f"load-{load}", f"{load}", (f"traction.y={load}",)) for load in LOADS)
INTRODUCTION = (
    "Cantilever with a dead load P across its tip, length 100 times the thickness (L = 1 m), St. Venant-Kirchhoff, "
    "beside the elastica (a beam that bends and does nothing else): deflection w and shortening u of the tip."
)


def run(levels: Sequence[int] | None = None) -> list[Measurement]:
    """Run every load on `levels`; None: 0 to 3.

    Each run starts from rest on its coarsest mesh, where the many steps towards a large load cost least: a sweep over
    the loads on a fine mesh would take them there.
    """
    return measurement.measure_all(VARIANTS, levels or LEVELS)


def load_table(runs: Iterable[Measurement]) -> TextTable:
    """Return one row per run: deflection and shortening with their errors, the checker's largest number."""
    head = ("P L² / (E I)", "level", "unknowns", "seconds", "w/L", "elastica", "error", "u/L", "elastica", "error")
    table = TextTable((*head, "largest check"))
    for run in runs:
        (source,) = reference_sets(CASE, run.variant)
        cells: list[str] = []
        for name, sign in (("tip_uy", 1), ("tip_ux", -1)):
            value = run.value(name)
            cells += [number(sign * item, "{:.6f}") for item in (value, source.values[name])]
            cells.append(percent(sign * source.error(name, value)))
        table.add(
            run.variant.removeprefix("load-"),
            str(run.level),
            run.unknowns,
            run.seconds,
            *cells,
            number(run.check_maximum, "{:.0e}"),
        )
    return table


def full(runs: Sequence[Measurement]) -> list[Part]:
    """Return every run."""
    return [INTRODUCTION, load_table(runs)]


def brief(runs: Sequence[Measurement]) -> list[Part]:
    """Return the finest mesh of every load."""
    return [INTRODUCTION, load_table([own[-1] for own in by_variant(runs).values()])]


ELASTICA = Section("elastica", "Cantilever and elastica", run, full, brief)
