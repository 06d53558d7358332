"""What steady runs cost in units of one factorisation: over the mesh levels, every scene, a solid's formulations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import pandas as pd

from ffsi.cli import show
from ffsi.hemodynamics.result import Result
from ffsi.scene import CASES, load_scene
from studies.harness import Run, Study, repeated, solved
from studies.tables import Column, TextTable, bounded, columns, table
from studies.verification.steady import Variant, measure

SOLVER = ("residual", "jacobian", "factorize", "solve")
WORDS = {"jacobian": "Jacobian", "factorize": "factorise"}  # phases that are called otherwise in tables
COARSER = "coarser_meshes"


class Ratio(NamedTuple):
    """A cost in units of one factorisation on the final mesh: the sum of `phases`, which should be below `bound`."""

    name: str
    title: str
    phases: tuple[str, ...]
    bound: float
    form: str = "{:.2f}"


# Phases are summed over the whole run, coarser meshes included; one_* is the median of a single one on the final mesh.
RATIOS = (
    Ratio("newton", "residual + Jacobian + factorise + solve", SOLVER, 5.0),
    Ratio("one_jacobian", "one Jacobian", ("one_jacobian",), 1.0),
    Ratio("one_residual", "one residual", ("one_residual",), 0.05, "{:.3f}"),
    Ratio("overhead", "mesh + operators + output + check", ("mesh", "operators", "output", "check"), 4.0),
)


def total(timings: Mapping[str, float], phases: Iterable[str]) -> float:
    """Return the seconds of some phases; NaN where one was not timed."""
    return sum(timings.get(phase, math.nan) for phase in phases)


def ratios(timings: Mapping[str, float]) -> dict[str, float]:
    """Return each of `RATIOS` from the timings of one run (s); NaN where a phase was not timed."""
    unit = timings.get("one_factorization") or math.nan
    return {ratio.name: total(timings, ratio.phases) / unit for ratio in RATIOS}


def cost_row(runs: Sequence[Run]) -> dict[str, Any]:
    """Return sizes, Newton's counts and the medians of seconds and ratios over the runs of one scene on one level."""
    good = [run for run in runs if not run.failure]
    status = "converged" if len(good) == len(runs) else "failed"
    row: dict[str, Any] = {"case": runs[0].name, "level": runs[0].level, "status": status, "runs": len(runs)}
    if not good:
        return row
    row |= {name: good[0].data[name] for name in ("unknowns", "triangles")}
    row |= {name: good[0].data["newton"][name] for name in ("iterations", "factorizations")}
    times = pd.DataFrame([run.timings for run in good]).median()
    row |= {"script_seconds": times.get("script"), "seconds": times.get("total")}
    row |= {f"{name}_seconds": value for name, value in times.items() if name not in ("script", "total")}
    costs = pd.DataFrame([ratios(run.timings) for run in good]).median().dropna()
    return row | {f"ratio_{name}": value for name, value in costs.items()}


# Costs over the mesh levels -------------------------------------------------------------------------------------------

CASE, LEVELS = "turek-fsi1", range(5)


def level_table(rows: Sequence[Mapping[str, Any]]) -> TextTable:
    """Return sizes and ratios with their bounds."""
    sizes = columns("level | unknowns | one factorisation s = one_factorization_seconds :.3f")
    found = [Column(f"{x.title} (below {x.bound:g})", f"ratio_{x.name}", x.form, x.bound) for x in RATIOS]
    return table(rows, [*sizes, *found], title="seconds / seconds of one factorisation on the final mesh")


def main_levels(*, repeat: int = 1, out: Path | None = None, readme: Path | None = None) -> list[str]:
    """Run FSI1 on every mesh level, one thread, and print what it costs: medians of `repeat` runs."""
    study = Study(repeated("bench", repeat), out, readme, "bench")
    runs = [[measure(Variant(CASE), level) for _ in range(repeat)] for level in LEVELS]
    rows = [cost_row(group) for group in runs]
    shown = level_table(rows)
    files = {f"bench-{CASE}.csv": lambda: pd.DataFrame(rows)}
    return study.finish([run.data for group in runs for run in group], [shown], files, table=shown)


# Every steady scene near 30 000 unknowns, and what a solid's pressure as an unknown costs ----------------------------

# The level whose number of unknowns is the nearest to 30 000 where it is not 2.
NEAREST = {"turek-csm1": 4, "turek-csm2": 4, "cylinder-2d1": 3, "cavity-flexible-floor": 3}

# The solid of each scene that is also run with a pressure of its own.
FORMULATED = {"flap-neo-hookean": "flap", "flap-mooney-rivlin": "flap", "cook": "membrane"}
FORMULATIONS = ("displacement", "mixed", "incompressible")
# What is compared between two formulations: name, title, phases.
COMPARED = (
    ("total", "whole run", ("total",)),
    ("script", "script", ("script",)),
    ("newton", "Newton", SOLVER),
    ("one_jacobian", "one Jacobian", ("one_jacobian",)),
    ("one_factorization", "one factorisation", ("one_factorization",)),
)
FORMULATION_BOUND = 1.5

# Short titles of `RATIOS`.
SHORT = {"newton": "Newton", "overhead": "other phases"}
MEANING = "; ".join(f"{SHORT[ratio.name]}: {ratio.title}" for ratio in RATIOS if ratio.name in SHORT)


def run(case: str, *settings: str) -> Run:
    """Run and check a case near 30 000 unknowns without pictures; errors as of `solved`.

    The timings of a solved run also hold `coarser_meshes`: the script's seconds until Newton's method had finished on
    the last but one mesh.
    """
    settings = (f"mesh.level={NEAREST.get(case, 2)}", *settings)
    scene = load_scene(case, [*settings, "output.pictures=false"])
    return solved(" ".join([case, *settings]), scene, case, more=_with_coarser)


def _with_coarser(result: Result) -> dict[str, Any]:
    history = result.history
    before = history[history["stage"] < history["stage"].max()]
    return {"timings": {**result.data["timings"], COARSER: 0.0 if before.empty else float(before["seconds"].max())}}


def scene_table(rows: Sequence[Mapping[str, Any]], *, reasons: bool = False) -> TextTable:
    """Return the ratios of every scene, on request with the phases of what is above its bound (marked with `!`)."""
    sizes = columns("case | level | unknowns | factorisation s = one_factorization_seconds :.3f")
    found = [bounded(SHORT.get(x.name, x.title), f"ratio_{x.name}", x.bound, x.form) for x in RATIOS]
    coarser = Column("coarser meshes", lambda row: _share(row, COARSER), "{:.2f}")
    counts = columns("iterations | factorisations = factorizations")
    last = [Column("above the bound", lambda row: "; ".join(above(row)))] if reasons else []
    title = "Scenes: seconds / seconds of one factorisation"
    return table(rows, [*sizes, *found, coarser, *counts, *last], title=title)


def above(row: Mapping[str, Any]) -> list[str]:
    """Return what is above its bound, a sum with its phases: `Newton: Jacobian 7.0, factorise 6.3, solve 1.2, ...`."""
    found = []
    for ratio in RATIOS:
        if row.get(f"ratio_{ratio.name}", 0.0) > ratio.bound:
            shares = sorted(((_share(row, phase), phase) for phase in ratio.phases), reverse=True)
            parts = ", ".join(f"{WORDS.get(phase, phase)} {share:.1f}" for share, phase in shares)
            found.append(f"{SHORT[ratio.name]}: {parts}" if ratio.name in SHORT else ratio.title)
    return found


def _share(row: Mapping[str, Any], phase: str) -> float:
    return float(row.get(f"{phase}_seconds", math.nan) / row.get("one_factorization_seconds", math.nan))


def formulation_rows(case: str, repetitions: Sequence[Sequence[Run]]) -> list[dict[str, Any]]:
    """Return one line per formulation: counts, and median costs as multiples of the displacement form's."""
    rows = []
    for index, formulation in enumerate(FORMULATIONS):
        row = {**cost_row([runs[index] for runs in repetitions]), "case": case, "formulation": formulation}
        pairs = [(runs[index], runs[0]) for runs in repetitions if not runs[index].failure and not runs[0].failure]
        for name, _, phases in COMPARED if pairs else ():
            quotients = [total(item.timings, phases) / total(base.timings, phases) for item, base in pairs]
            row[f"quotient_{name}"] = median(quotients)
        rows.append(row)
    return rows


def formulation_table(rows: Sequence[Mapping[str, Any]]) -> TextTable:
    """Return the costs of the formulations; a value above the bound is marked with `!`."""
    head = columns("case | formulation | unknowns | iterations | factorisations = factorizations")
    costs = [Column(title, f"quotient_{name}", "{:.2f}", FORMULATION_BOUND) for name, title, _ in COMPARED]
    title = f"Formulations of the solid: seconds / seconds of the displacement form (below {FORMULATION_BOUND})"
    return table(rows, [*head, *costs], left=2, title=title)


def main_scenes(*, repeat: int = 1, out: Path | None = None, readme: Path | None = None) -> list[str]:
    """Run every steady scene and the formulations of a solid, one thread, and print what they cost (medians)."""
    study = Study(repeated("bench --scenes", repeat), out, readme, "bench-scenes")
    measure(Variant("turek-csm1"), 0)  # what Python imports and FreeFEM reads from disk for the first time
    groups = [[run(case) for _ in range(repeat)] for case in CASES.steady]
    pairs = {
        case: [[run(case, f"solid.{solid}.formulation={name}") for name in FORMULATIONS] for _ in range(repeat)]
        for case, solid in FORMULATED.items()
    }
    scenes = [cost_row(group) for group in groups]
    forms = [row for case, repetitions in pairs.items() for row in formulation_rows(case, repetitions)]
    formulations = formulation_table(forms)
    for row in scenes:
        for text in above(row):
            show.note(f"above the bound, {row['case']}: {text}")
    every = [item for group in groups for item in group]
    every += [item for repetitions in pairs.values() for runs in repetitions for item in runs]
    return study.finish(
        [item.data for item in every], [scene_table(scenes), formulations],
        {"bench-scenes.csv": lambda: pd.DataFrame(scenes), "bench-formulations.csv": lambda: pd.DataFrame(forms)},
        scenes=scene_table(scenes, reasons=True), formulations=formulations, meaning=MEANING, bound=FORMULATION_BOUND,
    )  # fmt: skip
