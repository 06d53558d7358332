"""The catalogue's steady cases that have published values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ffsi.scene import CASES
from studies import measurement
from studies.measurement import Measurement, Variant
from studies.tables import TextTable, number, percent
from studies.verification.section import Part, Section, by_variant
from studies.verification.sources import COLUMNS, reference_sets

FINEST = {"turek-fsi1": 4}  # finest mesh level where it is not 3
SHORT_LEVEL = 2  # the level of the table in docs/results.md
CAVITY = "cavity-flexible-floor"
CAVITY_TITLE = "Channel over a cavity with a flexible floor, beside every published value:"
HEAD = tuple(dict.fromkeys(COLUMNS.values()))


def run(levels: Sequence[int] | None = None) -> list[Measurement]:
    """Run every steady case with published values on `levels`; None: 0 to 3, FSI1 0 to 4."""
    return [
        item
        for case in CASES.steady
        if reference_sets(case)
        for item in measurement.measure_all([Variant(case)], levels or range(FINEST.get(case, 3) + 1))
    ]


def error_table(runs: Iterable[Measurement]) -> TextTable:
    """Return one row per run and source: unknowns, seconds, errors, the checker's largest number."""
    table = TextTable(("case", "compared with", "level", "unknowns", "seconds", *HEAD, "largest check"), left=2)
    for run in runs:
        for source in run.compared:
            errors = {COLUMNS[name]: error for name, error in run.errors(source).items()}
            table.add(
                run.case,
                source.source,
                str(run.level),
                run.unknowns,
                run.seconds,
                *(percent(errors.get(name, float("nan"))) for name in HEAD),
                number(run.check_maximum, "{:.0e}"),
            )
    return table


def cavity_table(runs: Iterable[Measurement]) -> TextTable:
    """Return the values of the cavity's floor: this program by level, then every published mesh."""
    table = TextTable(("source", "u_y(4, -1) in m", "F_y in N/m"))
    for run in runs:
        if run.case == CAVITY and not run.failure:
            text = f"this program, level {run.level}, {run.data.get('unknowns')} unknowns"
            table.add(text, *_cavity_cells(run.quantities))
    for source in sorted(reference_sets(CAVITY), key=lambda item: item.source, reverse=True):
        table.add(source.source, *_cavity_cells(source.values))
    return table


def _cavity_cells(values: Mapping[str, float]) -> tuple[str, str]:
    return number(values.get("tip_uy"), "{:.5f}"), number(values.get("lift"), "{:.4f}")


def short(runs: Sequence[Measurement]) -> list[Measurement]:
    """Return what is shown briefly: every level of the cases in `FINEST`, level 2 (or the finest run) of the others."""
    chosen = []
    for (case, _), own in by_variant(runs).items():
        near = [run for run in own if run.level == SHORT_LEVEL] or own[-1:]
        chosen += own if case in FINEST else near
    return chosen


def full(runs: Sequence[Measurement]) -> list[Part]:
    """Return all levels, and the cavity's values beside all published ones."""
    return [error_table(runs), CAVITY_TITLE, cavity_table(runs)]


def brief(runs: Sequence[Measurement]) -> list[Part]:
    """Return the short table, and the cavity's values on the two finest meshes."""
    finest = sorted((run for run in runs if run.case == CAVITY), key=lambda run: run.level)[-2:]
    return [error_table(short(runs)), CAVITY_TITLE, cavity_table(finest)]


BENCHMARKS = Section("verification", "", run, full, brief)
