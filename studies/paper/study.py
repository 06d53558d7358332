"""`python -m studies paper`: run the sweeps, and write figures, tables and `paper.md`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.result.pictures import to_small_png
from studies.harness import Study
from studies.paper.cases import CASES, Curve, PaperCase, all_curves
from studies.paper.document import document, overview
from studies.paper.pictures import draw, file_name
from studies.paper.sweeps import Outcome, load_scenes, run_sweeps

OUT = Path("results/paper")
RUNS = Path("runs/paper")
LEVEL = 2
MARKDOWN = "paper.md"


def main(
    cases: Sequence[int] | None = None,
    *,
    level: int = LEVEL,
    jobs: int = 1,
    out: Path = OUT,
    runs: Path = RUNS,
) -> list[str]:
    """Compute the paper's cases and write CSV, PNG and `paper.md`; a second call resumes the sweeps.

    Args:
        cases: numbers of the paper's cases, 1 to 3; None: all.
        level: mesh level.

    Returns:
        The failures of all sweeps, as `Result.failure`: failed checks and crashes. Where a sweep ends is a finding and
        no failure, unless none of its points was solved.
    """
    chosen = choose(cases)
    scenes = load_scenes(all_curves(chosen), level)
    Study("paper", out)
    outcomes = run_sweeps(scenes, runs, jobs)
    overview(chosen, outcomes).print()
    for outcome in outcomes.values():
        if outcome.end is not None:
            show.note(f"{outcome.curve.name} ended at {outcome.end[0]:g} m/s: {outcome.end[1]}")
    write(chosen, outcomes, out, command(cases, level))
    show.note(f"wrote {out / MARKDOWN}, its tables and figures")
    return [failure for outcome in outcomes.values() for failure in outcome.failures]


def choose(numbers: Sequence[int] | None) -> list[PaperCase]:
    """Return the cases with these numbers, in the paper's order.

    Raises:
        InputError: there is no such case.
    """
    known = [case.number for case in CASES]
    if wrong := [number for number in numbers or () if number not in known]:
        raise InputError(f"the paper has the cases {', '.join(map(str, known))}, not {wrong[0]}")
    return [case for case in CASES if numbers is None or case.number in numbers]


def command(numbers: Sequence[int] | None, level: int) -> str:
    """Return the command line that does the same."""
    chosen = "" if numbers is None else f" --cases {','.join(map(str, numbers))}"
    return "python -m studies paper" + ("" if level == LEVEL else f" --level {level}") + chosen


def write(cases: Sequence[PaperCase], outcomes: Mapping[Curve, Outcome], out: Path, written_by: str) -> None:
    """Write the tables, the figures and `paper.md`."""
    for curve, outcome in outcomes.items():
        folder.write_text(out / f"{curve.name}.csv", to_csv(outcome))
    names = []
    for case in cases:
        for kind, figure in draw(case, outcomes).items():
            names.append(file_name(case, kind))
            (out / names[-1]).write_bytes(to_small_png(figure))
    folder.write_text(out / MARKDOWN, document(cases, outcomes, names, written_by))


def to_csv(outcome: Outcome) -> str:
    """Return a sweep's table as CSV: eight digits, two for the check, which is rounding error."""
    table = outcome.published
    if "check_maximum" in table:
        table["check_maximum"] = [f"{value:.1e}" if pd.notna(value) else "" for value in table["check_maximum"]]
    return table.to_csv(index=False, float_format="%.8g")
