"""`verify --unsteady`: the cases in time beside their published values, on two meshes and with two time steps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ffsi.result.pictures import to_small_png
from studies.harness import Study
from studies.kept_runs import run_all
from studies.verification.periodic_cases import LARGEST, PERIODIC_CASES, PeriodicCase
from studies.verification.periodic_output import COSTS_TEXT, Outcome, case_table, draw, to_frame
from studies.verification.section import markdown

BLOCK = "verification-unsteady"
CSV, MARKDOWN, PICTURE = (f"{BLOCK}.{ending}" for ending in ("csv", "md", "png"))
RUNS = Path("runs/verify")
EXPLANATION = (
    "Errors are (value - published) / |published|, of mean (max + min)/2, amplitude (max - min)/2 and frequency over "
    "the last period; `!` marks what is above its bound. The bounds are meant for meshes of at most "
    f"{LARGEST} unknowns; the first row of each table has the mesh and the time step of the catalogue and must meet "
    "them. " + COSTS_TEXT
)
Groups = Sequence[tuple[PeriodicCase, Sequence[Outcome]]]


def main(
    *,
    jobs: int = 1,
    out: Path | None = None,
    readme: Path | None = None,
    runs: Path = RUNS,
    cases: Sequence[PeriodicCase] = PERIODIC_CASES,
) -> list[str]:
    """Run every case until it is periodic, print errors and costs, and write them down. A second call goes on."""
    study = Study("verify --unsteady", out, readme, [BLOCK])
    plans = [plan for case in cases for plan in case.runs]
    done = run_all({plan.name: plan.scene for plan in plans}, runs, jobs, "verify --unsteady")
    outcomes = [Outcome(plan, run) for plan, run in zip(plans, done, strict=True)]
    groups = [(case, [item for item in outcomes if item.plan.case == case]) for case in cases]
    for case, own in groups:
        case_table(case, own).print()
    written = study.written(done)
    study.write({
        CSV: lambda: to_frame(outcomes),
        MARKDOWN: lambda: document(groups, written),
        PICTURE: lambda: to_small_png(draw(groups)),
    })  # fmt: skip
    more = study.links("Last periods, and errors over seconds", [PICTURE])
    return study.publish([run.failure for run in done], {BLOCK: f"{tables(groups)}\n\n{written} {EXPLANATION}{more}"})


def tables(groups: Groups) -> str:
    """Return the table of every case, each under its name, in Markdown."""
    return markdown(part for case, own in groups for part in (f"`{case.name}`", case_table(case, own)))


def document(groups: Groups, written: str) -> str:
    """Return `verification-unsteady.md`."""
    picture = f"![Last periods, and errors over seconds]({PICTURE})"
    return "\n\n".join(["# Verification of the cases in time", written, EXPLANATION, tables(groups), picture]) + "\n"
