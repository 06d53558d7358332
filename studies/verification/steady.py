"""`verify`: steady cases beside known values, on several meshes; from mesh to mesh where nobody published any."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.scene import CASES, load_scene
from studies.harness import Run, Study, solved
from studies.tables import Column, TextTable, columns, number, percent, table, unsigned
from studies.verification.sources import COLUMNS, compared, reference_sets

SIZES = columns("level | unknowns | seconds :.1f")
CHECK = Column("largest check", "check", "{:.0e}")
TIP = "tip_uy"


@dataclass(frozen=True)
class Variant:
    """A catalogue case with other settings."""

    case: str  # name of the case
    name: str = ""  # short name of the variant; empty for the case itself
    text: str = ""  # what tables call it
    settings: tuple[str, ...] = ()  # `KEY=VALUE`, as after `--set`
    levels: Sequence[int] = range(4)  # mesh levels on which it runs
    times: float = 1.0  # what u_y is multiplied by, of a linear problem whose load is so much smaller


def measure(variant: Variant, level: int) -> Run:
    """Run and check a variant on one mesh level, with one thread and in a temporary folder; errors as of `solved`."""
    scene = load_scene(variant.case, [*variant.settings, f"mesh.level={level}"])
    label = f"{variant.case} {variant.name} level {level}".replace("  ", " ")
    run = solved(label, scene, variant.case, variant.name)
    if variant.times == 1 or run.failure:
        return run
    return replace(run, data={**run.data, "quantities": {TIP: variant.times * run.value(TIP)}})


def by_variant(runs: Iterable[Run]) -> list[list[Run]]:
    """Return the runs of each case and variant, in the order of their levels."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.name, run.variant), []).append(run)
    return [sorted(group, key=lambda run: run.level) for group in groups.values()]


def rows_of(runs: Iterable[Run]) -> list[dict[str, Any]]:
    """Return what tables have of each run: sizes, values, changes from the level before, errors against each source.

    With `NAME exact` and `NAME error` of the first source, and what the values of a variant on the levels are called.
    """
    rows = []
    for own in by_variant(runs):
        sources = compared(own[0].name, own[0].variant)
        for before, run in zip([None, *own], own, strict=False):
            row: dict[str, Any] = {name: run.value(name) for name in COLUMNS} | {
                "case": run.name, "text": TEXTS.get(run.variant), "level": run.level, "check": run.check_maximum,
                "unknowns": run.data.get("unknowns"),
                "seconds": f"failed ({run.failure})" if run.failure else run.timings.get("total"),
                "errors": ", ".join(f"{item.source} {percent(item.error(TIP, run.value(TIP)))}" for item in sources),
                "change": unsigned(run.value(TIP) / before.value(TIP) - 1) if before else None,
            }  # fmt: skip
            for name, difference in (differences(before, run) if before else {}).items():
                row[f"{name} change"] = unsigned(difference)
            for name in COLUMNS if sources else ():
                row[f"{name} exact"] = sources[0].values.get(name)
                row[f"{name} error"] = sources[0].error(name, run.value(name))
            rows.append(row)
    return rows


def differences(coarse: Run, fine: Run) -> dict[str, float]:
    """Return the sizes of the relative differences of the tip's displacement (a vector) and of the drag."""
    first, second = ([run.value(name) for name in ("tip_ux", TIP)] for run in (coarse, fine))
    drag = abs(coarse.value("drag") / fine.value("drag") - 1)
    return {"tip": math.dist(first, second) / math.hypot(*second), "drag": drag}


# The catalogue's cases that have published values -------------------------------------------------------------------

FINEST = {"turek-fsi1": 4}  # finest mesh level where it is not 3
SHORT_LEVEL = 2  # the level of the table in docs/results.md
CAVITY = "cavity-flexible-floor"


def error_table(runs: Sequence[Run]) -> TextTable:
    """Return one row per run and source: unknowns, seconds, errors, the checker's largest number."""
    rows = [
        row
        | {"source": source.source}
        | {f"error {COLUMNS[name]}": x for name, x in source.errors(run.quantities).items()}
        for run in runs
        for row in rows_of([run])
        for source in compared(run.name, run.variant)
    ]
    errors = columns(" | ".join(f"{head} = error {head} :%" for head in dict.fromkeys(COLUMNS.values())))
    return table(rows, [*columns("case | compared with = source"), *SIZES, *errors, CHECK], left=2)


def cavity_table(runs: Iterable[Run]) -> TextTable:
    """Return the values of the cavity's floor: this program by level, then every published mesh."""
    rows = [
        {"source": f"this program, level {run.level}, {run.data.get('unknowns')} unknowns", **run.quantities}
        for run in runs
        if run.name == CAVITY and not run.failure
    ]
    published = sorted(reference_sets(CAVITY), key=lambda item: item.source, reverse=True)
    rows += [{"source": item.source, **item.values} for item in published]
    return table(rows, columns("source | u_y(4, -1) in m = tip_uy :.5f | F_y in N/m = lift :.4f"))


def chosen(runs: Sequence[Run]) -> TextTable:
    """Return the errors on every level of the cases in `FINEST`, on level 2 (or the finest) of the others."""
    found: list[Run] = []
    for own in by_variant(runs):
        found += own if own[0].name in FINEST else [run for run in own if run.level == SHORT_LEVEL] or own[-1:]
    return error_table(found)


BENCHMARKS = [Variant(case, levels=range(FINEST.get(case, 3) + 1)) for case in CASES.steady if reference_sets(case)]

# Cook's membrane ----------------------------------------------------------------------------------------------------


def _membrane(name: str, text: str, young: float, poisson: float, *more: str, **options: Any) -> Variant:
    solid = (f"solid.membrane.young_modulus={young!r}", f"solid.membrane.poisson_ratio={poisson!r}")
    return Variant("cook", name, text, (*solid, *more), **options)


_MIXED = "solid.membrane.formulation=mixed"
_SOFT = '{material = "neo-hookean", density = 1.0, young_modulus = 3.0, formulation = "incompressible"}'
_SETTINGS = (f"solid.membrane={_SOFT}", "traction.y=0.05")
_NEARLY = 240.565, 0.4999, "traction.y=6.25"
_LINEAR = "solid.membrane.material=linear-elastic", "traction.y=6.25e-3"
LINEAR = _membrane("linear", "linear elasticity, E 70, ν 1/3, t 6.25", 70, 1 / 3, *_LINEAR, times=1e3)
NEO_HOOKEAN = _membrane("neo-hookean", "neo-Hookean, E 200, ν 0.35, t 4", 200, 0.35, "traction.y=4")
INCOMPRESSIBLE = Variant("cook", "incompressible", "incompressible neo-Hookean, E 3, t 0.05", _SETTINGS)
_TEXT = "neo-Hookean, E 240.565, ν 0.4999, t 6.25, mixed"
NEARLY_INCOMPRESSIBLE = _membrane("nearly-incompressible", _TEXT, *_NEARLY, _MIXED)
# From rest its Newton iterations are many hundreds, all the more on finer meshes: the coarsest one shows the locking.
_NAME = f"{NEARLY_INCOMPRESSIBLE.name}-displacement"
DISPLACEMENT = _membrane(_NAME, "the same in displacements only", *_NEARLY, levels=(0,))
MEMBRANES = (LINEAR, NEO_HOOKEAN, INCOMPRESSIBLE, NEARLY_INCOMPRESSIBLE, DISPLACEMENT)


def membrane_table(runs: Iterable[Run]) -> TextTable:
    """Return one row per run: u_y, its change from the level before, the errors, the checker's largest number."""
    mine = columns(f"u_y = {TIP} :.5g | change | error against = errors")
    return table(rows_of(runs), [Column("membrane", "text"), *SIZES, *mine, CHECK])


def published_table() -> TextTable:
    """Return every published value."""
    rows = [
        (variant.text, source.source, number(source.values[TIP], "{:.4f}"))
        for variant in MEMBRANES
        for source in reference_sets("cook", variant.name)
        if variant != DISPLACEMENT
    ]
    return TextTable(("membrane", "source", "u_y"), rows, left=2)


# The slender cantilever with a dead load at its tip -----------------------------------------------------------------

# P L^2 / (E I), which is traction.y in Pa. Each run starts from rest on its coarsest mesh, where the many steps towards
# a large load cost least: a sweep over the loads on a fine mesh would take them there.
LOADS = [Variant("cantilever", f"load-{load}", f"{load}", (f"traction.y={load}",)) for load in (1, 2, 5, 10)]


def load_table(runs: Iterable[Run]) -> TextTable:
    """Return one row per run: deflection and shortening with their errors, the checker's largest number."""
    rows = rows_of(runs)
    for row in rows:  # the tip moves backwards
        row |= {name: -row[name] for name in ("tip_ux", "tip_ux exact", "tip_ux error")}
    tip = "{1} = {0} :.6f | elastica = {0} exact :.6f | error = {0} error :%"
    both = columns(f"{tip.format(TIP, 'w/L')} | {tip.format('tip_ux', 'u/L')}")
    return table(rows, [Column("P L² / (E I)", "text"), *SIZES, *both, CHECK])


# The paper's flaps, of which nobody published values ----------------------------------------------------------------

VELOCITY = 0.055  # m/s, mean inflow, the last of the paper's sweep
FLAPS = [
    Variant(case, f"inflow-{VELOCITY}", case, (f"inflow.mean_velocity={VELOCITY}",), range(5))
    for case in ("flap-neo-hookean", "flap-mooney-rivlin", "flap-neo-hookean-roof", "flap-mooney-rivlin-roof")
]
FLAP_VALUES = columns("u_x in m = tip_ux :.5g | u_y in m = tip_uy :.5g | drag in N/m = drag :.5g")


def flap_table(runs: Iterable[Run]) -> TextTable:
    """Return one row per run: tip, drag, their differences from the level before, the checker's largest number."""
    changes = columns("tip = tip change | drag = drag change")
    return table(rows_of(runs), [Column("case", "case"), *SIZES, *FLAP_VALUES, *changes, CHECK])


# All of it ----------------------------------------------------------------------------------------------------------

SECTIONS = (BENCHMARKS, MEMBRANES, LOADS, FLAPS)
TEXTS = {variant.name: variant.text for section in SECTIONS for variant in section}


def main(*, out: Path | None = None, readme: Path | None = None) -> list[str]:
    """Run every section, print its tables, and write them down."""
    study = Study("verify", out, readme, "verification")
    done = [[measure(item, level) for item in section for level in item.levels] for section in SECTIONS]
    benchmarks, membranes, loads, flaps = done
    tables = {
        "errors": error_table(benchmarks), "cavity": cavity_table(benchmarks), "membranes": membrane_table(membranes),
        "published": published_table(), "cantilevers": load_table(loads), "flaps": flap_table(flaps),
    }  # fmt: skip
    finest = cavity_table([run for run in benchmarks if run.name == CAVITY][-2:])
    runs = [run for own in done for run in own]
    return study.finish(
        [run.data for run in runs], tables.values(), {"verification.csv": lambda: to_frame(runs)},
        tables=tables, chosen=chosen(benchmarks), finest_cavity=finest, velocity=VELOCITY,
    )  # fmt: skip


def to_frame(runs: Iterable[Run]) -> pd.DataFrame:
    """Return one row per run: sizes, seconds, Newton, and each quantity with its references and relative errors."""
    frame = pd.DataFrame([_line(run) for run in runs])
    parts = ("", "_reference", "_error", "_second_reference", "_second_error")
    values = [name + part for name in COLUMNS for part in parts]
    order = [name for name in frame if name not in values] + [name for name in values if name in frame]
    return frame[order].astype(dict.fromkeys(("unknowns", "triangles", "iterations", "factorizations"), "Int64"))


def _line(run: Run) -> dict[str, Any]:
    newton, sources = run.data.get("newton") or {}, compared(run.name, run.variant)
    line: dict[str, Any] = {
        "case": run.name, "variant": run.variant, "level": run.level,
        **{name: run.data.get(name) for name in ("status", "unknowns", "triangles")},
        "seconds": run.timings.get("total"), "script_seconds": run.timings.get("script"),
        **{name: newton.get(name) for name in ("iterations", "factorizations")}, "check_maximum": run.check_maximum,
    }  # fmt: skip
    if not sources:
        return line | {name: value for name, value in run.quantities.items() if name in COLUMNS}
    for prefix, source in zip(("", "second_"), sources, strict=False):
        line[f"{prefix}source"] = source.source
        for name, error in source.errors(run.quantities).items():
            values = {"": run.quantities[name], f"_{prefix}reference": source.values[name], f"_{prefix}error": error}
            line |= {name + part: value for part, value in values.items()}
    return line
