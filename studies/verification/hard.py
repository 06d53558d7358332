"""`verify --hard`: scenes outside of the catalogue, each solved rightly or refused with the right cause."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from studies.harness import Study
from studies.tables import TextTable, number
from studies.verification.hard_entries import load, select
from studies.verification.hard_runs import Outcome, run_all
from studies.verification.hard_verdicts import FAILED, GOOD, VERDICTS, Verdict, judge
from studies.verification.section import markdown

CSV, MARKDOWN = "hard.csv", "hard.md"
RUNS = Path("runs/hard")
EXPLANATION = (
    "Scenes that are harder than those of the catalogue, or just beside them, on mesh level 0, with what is expected "
    "of each (studies/data/hard). Solved: converged, checked, and every number as expected. Refused rightly: "
    "not solved, and the cause is named. Failed: not solved although it should be, or at too high a cost. Wrong: "
    "converged and checked, but a number is not as expected, or what should fail was solved. No claim: "
    "nothing is expected, or what it is compared with is not solved."
)
Judged = Sequence[tuple[Outcome, Verdict]]


def main(*, jobs: int = 1, out: Path | None = None, runs: Path = RUNS, only: str | None = None) -> list[str]:
    """Run the hard cases, print what is not as expected, and write all down. A second call runs what is missing.

    Args:
        only: patterns of names such as `h-*,k-creep`; None: all.

    Returns:
        For each case empty, or its failure as of a Result: of a wrong number or cause `check`.
    """
    study = Study("verify --hard" + (f" --only '{only}'" if only else ""), out)
    titles, entries = load()
    outcomes = run_all(select(entries, only), runs, jobs)
    judged = [(outcome, judge(outcome, outcomes)) for outcome in outcomes.values()]
    counts(judged, titles).print()
    if table := bad_ones(judged):
        table.print()
    written = study.written(outcomes.values())
    study.write({CSV: lambda: to_frame(judged), MARKDOWN: lambda: document(judged, titles, written)}, digits=None)
    return ["" if verdict.word in GOOD else _failure(outcome, verdict) for outcome, verdict in judged]


def _failure(outcome: Outcome, verdict: Verdict) -> str:
    known = outcome.failure in ("not-converged", "not-reached", "stopped", "crash")
    return outcome.failure if verdict.word == FAILED and known else "check"


def counts(judged: Judged, titles: Mapping[str, str]) -> TextTable:
    """Return how many cases of each group have which verdict."""
    table = TextTable(["group", "cases", *VERDICTS])
    by_group = {title: [item for item in judged if item[0].entry.group == key] for key, title in titles.items()}
    for title, items in [*by_group.items(), ("all", list(judged))]:
        if items:
            found = Counter(verdict.word for _, verdict in items)
            table.add(title, str(len(items)), *(str(found[word] or "") for word in VERDICTS))
    return table


def bad_ones(judged: Judged) -> TextTable | None:
    """Return what is not as expected; None if all is."""
    table = TextTable(["not as expected", "verdict", "what came out"], left=3)
    for outcome, verdict in judged:
        if verdict.word not in GOOD:
            table.add(outcome.entry.id, verdict.word, _shown(verdict))
    return table if table.body else None


def cases(judged: Judged) -> TextTable:
    """Return a row per case."""
    table = TextTable(
        ["case", "what", "verdict", "came out (expected), or the reason", "iterations", "min J", "s"], left=4
    )
    for outcome, verdict in judged:
        table.add(
            outcome.entry.id,
            outcome.entry.what,
            verdict.word,
            _shown(verdict),
            number(outcome.value("iterations"), "{:.0f}"),
            number(outcome.value("min_jacobian"), "{:.3f}"),
            number(outcome.seconds or None),
        )
    return table


def _shown(verdict: Verdict) -> str:
    text = "; ".join(verdict.shown).replace("|", "\\|").replace("\n", " ")
    return text if len(text) < 300 else f"{text[:297]}..."


def document(judged: Judged, titles: Mapping[str, str], written: str) -> str:
    """Return `hard.md`."""
    parts: list[str | TextTable] = ["# Hard cases", written, EXPLANATION, counts(judged, titles)]
    if table := bad_ones(judged):
        parts += ["## Not as expected", table]
    for group, title in titles.items():
        if items := [item for item in judged if item[0].entry.group == group]:
            parts += [f"## {title}", cases(items)]
    return markdown(parts) + "\n"


def to_frame(judged: Judged) -> pd.DataFrame:
    """Return one row per case."""
    return pd.DataFrame([_row(outcome, verdict) for outcome, verdict in judged])


def _row(outcome: Outcome, verdict: Verdict) -> dict[str, Any]:
    entry = outcome.entry
    return {
        "id": entry.id, "what": entry.what, "case": entry.case, "set": json.dumps(dict(entry.set)),
        "vary": json.dumps(dict(entry.vary)) if entry.vary else "", "expected": entry.outcome, "why": entry.why,
        "note": entry.note, "verdict": verdict.word, "shown": "; ".join(verdict.shown), "failure": outcome.failure,
        "reason": outcome.reason, "warnings": "; ".join(outcome.warnings), "iterations": outcome.value("iterations"),
        "min_jacobian": outcome.value("min_jacobian"), "seconds": outcome.seconds,
    }  # fmt: skip
