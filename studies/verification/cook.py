"""Cook's membrane: u_y(48, 60) of linear, compressible, incompressible and nearly incompressible materials."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from studies import measurement
from studies.measurement import Measurement, Variant
from studies.tables import NOTHING, TextTable, number, percent, size
from studies.verification.section import Part, Section, by_variant
from studies.verification.sources import reference_sets

CASE = "cook"
LEVELS = range(4)
TIP = "tip_uy"

LINEAR = Variant(
    CASE,
    "linear",
    "linear elasticity, E 70, ν 1/3, t 6.25",
    ("solid.membrane.young_modulus=70", f"solid.membrane.poisson_ratio={1 / 3!r}"),
)
LOAD = 6.25  # Pa, of the linear problem
SMALL_LOADS = (3.125e-3, 6.25e-3)  # Pa, one twice the other

NEO_HOOKEAN = Variant(
    CASE,
    "neo-hookean",
    "neo-Hookean, E 200, ν 0.35, t 4",
    ("solid.membrane.young_modulus=200", "solid.membrane.poisson_ratio=0.35", "traction.y=4"),
)
INCOMPRESSIBLE = Variant(
    CASE,
    "incompressible",
    "incompressible neo-Hookean, E 3, t 0.05",
    (
        'solid.membrane={material = "neo-hookean", density = 1.0, young_modulus = 3.0, formulation = "incompressible"}',
        "traction.y=0.05",
    ),
)
_NEARLY = ("solid.membrane.young_modulus=240.565", "solid.membrane.poisson_ratio=0.4999", "traction.y=6.25")
NEARLY_INCOMPRESSIBLE = Variant(
    CASE,
    "nearly-incompressible",
    "neo-Hookean, E 240.565, ν 0.4999, t 6.25, mixed",
    (*_NEARLY, "solid.membrane.formulation=mixed"),
)
# From rest its Newton iterations are many hundreds, all the more on finer meshes: the coarsest one shows the locking.
DISPLACEMENT = Variant(CASE, "nearly-incompressible-displacement", "the same in displacements only", _NEARLY)
DISPLACEMENT_LEVEL = 0
VARIANTS = (LINEAR, NEO_HOOKEAN, INCOMPRESSIBLE, NEARLY_INCOMPRESSIBLE, DISPLACEMENT)

INTRODUCTION = (
    "Cook's membrane, u_y(48, 60) in m; E and the traction t in Pa. Linear elasticity: u_y / t at two small loads, "
    "extrapolated to none."
)
REASON = (
    "ν 0.4999: the published 6.9083 is what bilinear elements give on 50 to 65 elements per side, still rising there; "
    "quadratic ones, by two solvers, for two energies and for J = 1, meet at 6.934 to 6.936 (studies/data/README.md)."
)


def run(levels: Sequence[int] | None = None) -> list[Measurement]:
    """Run every variant on `levels`; None: 0 to 3. The displacement form of the last one runs on level 0 only."""
    chosen = levels or LEVELS
    runs = [measure_linear(level) for level in chosen]
    runs += measurement.measure_all([NEO_HOOKEAN, INCOMPRESSIBLE, NEARLY_INCOMPRESSIBLE], chosen)
    return runs + measurement.measure_all([DISPLACEMENT], [level for level in chosen if level == DISPLACEMENT_LEVEL])


def measure_linear(level: int) -> Measurement:
    """Run the linear problem: the same at two small loads, extrapolated to none."""
    pair = [
        measurement.measure(CASE, level, replace(LINEAR, settings=(*LINEAR.settings, f"traction.y={load!r}")))
        for load in SMALL_LOADS
    ]
    return extrapolated(*pair)


def extrapolated(small: Measurement, large: Measurement) -> Measurement:
    """Return u_y at `LOAD` of the linear problem: u_y per load of two runs at `SMALL_LOADS`, linear in the load.

    The seconds are the sum, the check the worse one; a run that failed is returned as it is.
    """
    failed = next((run for run in (small, large) if run.failure), None)
    if failed is not None:
        return failed
    first, second = (run.value(TIP) / load for run, load in zip((small, large), SMALL_LOADS, strict=True))
    timings = {name: small.timings.get(name, 0.0) + seconds for name, seconds in large.timings.items()}
    worse = max((small, large), key=lambda run: run.check_maximum)
    data: dict[str, Any] = {
        **large.data,
        "quantities": {TIP: LOAD * (2 * first - second)},
        "timings": timings,
        "check": worse.data.get("check"),
    }
    return Measurement(CASE, large.level, data, LINEAR.name)


def run_table(runs: Iterable[Measurement]) -> TextTable:
    """Return one row per run: u_y, its change from the level before, the errors, the checker's largest number."""
    head = ("membrane", "level", "unknowns", "seconds", "u_y", "change", "error against", "largest check")
    table = TextTable(head)
    for own in by_variant(runs).values():
        for before, run in zip([None, *own], own, strict=False):
            value = run.value(TIP)
            table.add(
                text_of(run.variant),
                str(run.level),
                run.unknowns,
                run.seconds,
                number(value, "{:.5g}"),
                size(value / before.value(TIP) - 1) if before else NOTHING,
                ", ".join(f"{source.source} {percent(source.error(TIP, value))}" for source in run.compared),
                number(run.check_maximum, "{:.0e}"),
            )
    return table


def published_table() -> TextTable:
    """Return every published value."""
    table = TextTable(("membrane", "source", "u_y"), left=2)
    for variant in VARIANTS:
        for source in reference_sets(CASE, variant.name) if variant != DISPLACEMENT else []:
            table.add(variant.text, source.source, number(source.values[TIP], "{:.4f}"))
    return table


def level_table(runs: Sequence[Measurement]) -> TextTable:
    """Return one row per variant: published values, u_y by level, the error on the finest mesh."""
    levels = sorted({run.level for run in runs})
    table = TextTable(("membrane", "published", *(f"level {level}" for level in levels), "error, finest mesh"))
    for (_, variant), own in by_variant(runs).items():
        values = {run.level: run.value(TIP) for run in own}
        errors = [percent(source.error(TIP, values[max(values)])) for source in own[0].compared]
        table.add(
            text_of(variant),
            ", ".join(number(source.values[TIP], "{:.5g}") for source in own[0].compared),
            *(number(values.get(level), "{:.5g}") for level in levels),
            ", ".join(errors),
        )
    return table


def text_of(name: str) -> str:
    """Return what tables call a variant."""
    texts: Mapping[str, str] = {variant.name: variant.text for variant in VARIANTS}
    return texts[name]


def full(runs: Sequence[Measurement]) -> list[Part]:
    """Return every run and every published value."""
    return [INTRODUCTION, run_table(runs), REASON, published_table()]


def brief(runs: Sequence[Measurement]) -> list[Part]:
    """Return u_y by level."""
    return [INTRODUCTION, level_table(runs), REASON]


COOK = Section("cook", "Cook's membrane", run, full, brief)
