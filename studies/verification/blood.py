"""`verify --blood`: flow of blood beside exact flows, and the aneurysm from mesh to mesh and cycle to cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from ffsi.hemodynamics.result import Result, load_result
from ffsi.scene import Scene
from studies.harness import Study
from studies.kept_runs import TimeRun, run_all
from studies.verification.aneurysm_cases import ANEURYSM_CASES, level_changes
from studies.verification.blood_tables import EXPLANATION, TABLES
from studies.verification.measured import SECONDS, Measured, Row, to_frame
from studies.verification.oscillating_channel import OSCILLATING_CASES
from studies.verification.plane_blood import PLANE_CASES
from studies.verification.section import markdown

BLOCK = "blood"
CSV, MARKDOWN = "blood.csv", "blood.md"
RUNS = Path("runs/verify-blood")


class BloodCase(Protocol):
    """A run, and what is measured of it."""

    @property
    def group(self) -> str:
        """Name of the group of rows that it belongs to."""

    @property
    def folder(self) -> str:
        """Name of the run folder."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What the first cells of its row say."""

    @property
    def level(self) -> int:
        """Mesh level."""

    @property
    def scene(self) -> Scene:
        """What is solved."""

    def measure(self, result: Result) -> Mapping[str, Measured]:
        """Return numbers of a solved run by quantity."""


CASES: tuple[BloodCase, ...] = (*PLANE_CASES, *OSCILLATING_CASES, *ANEURYSM_CASES)


def main(
    *,
    jobs: int = 1,
    out: Path | None = None,
    readme: Path | None = None,
    runs: Path = RUNS,
    cases: Sequence[BloodCase] = CASES,
) -> list[str]:
    """Run everything, print its tables, and write them down. A second call goes on."""
    study = Study("verify --blood", out, readme, [BLOCK])
    done = run_all({case.folder: case.scene for case in cases}, runs, jobs, "verify --blood")
    rows = [_row(case, run) for case, run in zip(cases, done, strict=True)]
    rows += level_changes(rows)
    for table in TABLES:
        if (made := table.of(rows)).body:
            made.print()
    written = study.written(done)
    study.write({CSV: lambda: to_frame(rows, TABLES), MARKDOWN: lambda: document(rows, written)}, digits="%.10g")
    text = f"{tables(rows, short=True)}\n\n{written} {EXPLANATION}{study.links('All meshes', [MARKDOWN])}"
    return study.publish([run.failure for run in done], {BLOCK: text})


def _row(case: BloodCase, run: TimeRun) -> Row:
    """Return what a run comes to."""
    numbers = {"unknowns": Measured(float(run.data.get("unknowns") or "nan"))}
    if not run.failure:
        numbers |= {SECONDS: Measured(run.seconds), "check": Measured(run.check_maximum)}
        numbers |= case.measure(load_result(run.directory))
    if not run.failure and run.scene.time is not None:
        numbers["seconds_per_step"] = Measured(run.seconds_per_step)
    return Row(case.group, case.folder, case.labels, case.level, numbers, run.failure)


def tables(rows: Sequence[Row], *, short: bool = False) -> str:
    """Return all tables that have rows, each under its text, in Markdown."""
    made = [(table.text, table.of(rows, short=short)) for table in TABLES]
    return markdown(part for text, table in made if table.body for part in (text, table))


def document(rows: Sequence[Row], written: str) -> str:
    """Return `blood.md`."""
    return "\n\n".join(["# Flow of blood", written, EXPLANATION, tables(rows)]) + "\n"
