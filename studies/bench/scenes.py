"""Every steady scene of the catalogue near 30 000 unknowns, and what a solid's pressure as an unknown costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd

from ffsi.cli import show
from ffsi.files.errors import InputError
from ffsi.scene import CASES
from studies.bench.costs import COARSER, RATIOS, SOLVER, WORDS, cost_row, marked, run
from studies.harness import Study
from studies.measurement import Measurement
from studies.tables import TextTable, number

BLOCK = "bench-scenes"
SCENES_CSV = "bench-scenes.csv"
FORMULATIONS_CSV = "bench-formulations.csv"
# The level whose number of unknowns is the nearest to 30 000 where it is not 2.
LEVEL = 2
LEVELS = {"turek-csm1": 4, "turek-csm2": 4, "cylinder-2d1": 3, "cavity-flexible-floor": 3}

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
SCENES_TEXT = (
    "Costs of a whole run in units of one factorisation on the final mesh, coarser meshes included, at the level "
    f"nearest to 30 000 unknowns. {MEANING}. *Coarser meshes*: all that the script does before the final mesh. "
    "Iterations and factorisations are those on the final mesh. `!` marks what is above its bound; the last column "
    "gives the phases of it."
)
FORMULATIONS_TEXT = (
    "A pressure of the solid as one more unknown, as a multiple of the displacement form in the same repetition; `!` "
    f"marks what is above {FORMULATION_BOUND}. Whole run: wall clock of all that `ffsi run` does but pictures; the "
    "others are the script's processor time. An incompressible solid is another problem than the compressible one, "
    "with other Newton iterations."
)


def level_of(case: str) -> int:
    """Return the mesh level of a case whose number of unknowns is the nearest to 30 000."""
    return LEVELS.get(case, LEVEL)


def scene_table(rows: Sequence[Mapping[str, Any]], *, reasons: bool = False) -> TextTable:
    """Return the ratios of every scene, on request with the phases of what is above its bound (marked with `!`)."""
    head = ["case", "level", "unknowns", "factorisation s"]
    head += [f"{SHORT.get(ratio.name, ratio.title)} (< {ratio.bound:g})" for ratio in RATIOS]
    head += ["coarser meshes", "iterations", "factorisations"]
    last = ["above the bound"] if reasons else []
    table = TextTable([*head, *last], title="Scenes: seconds / seconds of one factorisation")
    for row in rows:
        table.add(
            str(row["case"]),
            str(row["level"]),
            number(row.get("unknowns"), "{:d}"),
            number(row.get("one_factorization_seconds"), "{:.3f}"),
            *(marked(row.get(f"ratio_{ratio.name}"), ratio.bound) for ratio in RATIOS),
            number(_share(row, COARSER), "{:.2f}"),
            *(number(row.get(name), "{:d}") for name in ("iterations", "factorizations")),
            *("; ".join(above(row)) for _ in last),
        )
    return table


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
    nothing = float("nan")
    return float(row.get(f"{phase}_seconds", nothing) / row.get("one_factorization_seconds", nothing))


def formulation_rows(case: str, repetitions: Sequence[Sequence[Measurement]]) -> list[dict[str, Any]]:
    """Return one line per formulation: counts, and each cost as a multiple of the displacement form's.

    Args:
        case: name of the case.
        repetitions: per repetition, one run of each of `FORMULATIONS`; a quotient is the median over the repetitions.
    """
    rows = []
    for index, formulation in enumerate(FORMULATIONS):
        row = {**cost_row([runs[index] for runs in repetitions]), "case": case, "formulation": formulation}
        pairs = [(runs[index], runs[0]) for runs in repetitions if not runs[index].failure and not runs[0].failure]
        if pairs:
            row |= {
                f"quotient_{name}": median(_quotient(*pair, phases) for pair in pairs) for name, _, phases in COMPARED
            }
        rows.append(row)
    return rows


def _quotient(run: Measurement, base: Measurement, phases: Sequence[str]) -> float:
    first, second = (sum(item.timings.get(phase, float("nan")) for phase in phases) for item in (run, base))
    return first / second


def formulation_table(rows: Sequence[Mapping[str, Any]]) -> TextTable:
    """Return the costs of the formulations; a value above the bound is marked with `!`."""
    head = ["case", "formulation", "unknowns", "iterations", "factorisations", *(title for _, title, _ in COMPARED)]
    title = f"Formulations of the solid: seconds / seconds of the displacement form (below {FORMULATION_BOUND})"
    table = TextTable(head, left=2, title=title)
    for row in rows:
        table.add(
            str(row["case"]),
            str(row["formulation"]),
            *(number(row.get(name), "{:d}") for name in ("unknowns", "iterations", "factorizations")),
            *(marked(row.get(f"quotient_{name}"), FORMULATION_BOUND) for name, _, _ in COMPARED),
        )
    return table


def main(*, repeat: int = 1, out: Path | None = None, readme: Path | None = None) -> list[str]:
    """Run every steady scene of the catalogue and the formulations of a solid, one thread, and print what they cost.

    Args:
        repeat: runs per scene; seconds and ratios are the medians.
    """
    if repeat < 1:
        raise InputError(f"--repeat: at least one run, not {repeat}")
    study = Study("bench --scenes" + (f" --repeat {repeat}" if repeat > 1 else ""), out, readme, [BLOCK])
    run("turek-csm1", ["mesh.level=0"])  # what Python imports and FreeFEM reads from disk for the first time
    groups = [[run(case, [f"mesh.level={level_of(case)}"]) for _ in range(repeat)] for case in CASES.steady]
    compared = {case: [_formulations(case, solid) for _ in range(repeat)] for case, solid in FORMULATED.items()}
    scenes = [cost_row(group) for group in groups]
    forms = [row for case, repetitions in compared.items() for row in formulation_rows(case, repetitions)]
    for table in (scene_table(scenes), formulation_table(forms)):
        table.print()
    for row in scenes:
        for text in above(row):
            show.note(f"above the bound, {row['case']}: {text}")
    study.write({SCENES_CSV: lambda: pd.DataFrame(scenes), FORMULATIONS_CSV: lambda: pd.DataFrame(forms)})
    every = [item for group in groups for item in group]
    every += [item for repetitions in compared.values() for runs in repetitions for item in runs]
    written = study.written(every) + study.links("Every phase", (SCENES_CSV, FORMULATIONS_CSV))
    parts = [SCENES_TEXT, scene_table(scenes, reasons=True).markdown()]
    parts += [FORMULATIONS_TEXT, formulation_table(forms).markdown(), written]
    return study.publish([item.failure for item in every], {BLOCK: "\n\n".join(parts)})


def _formulations(case: str, solid: str) -> list[Measurement]:
    """Run a case in each formulation, one after the other."""
    level = f"mesh.level={level_of(case)}"
    return [run(case, [level, f"solid.{solid}.formulation={formulation}"]) for formulation in FORMULATIONS]
