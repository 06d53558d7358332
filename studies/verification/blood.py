"""`verify --blood`: flow of blood beside exact flows, and the aneurysm from mesh to mesh and cycle to cycle."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.hemodynamics.result import load_result
from studies.harness import Study
from studies.runs import Run, run_all
from studies.tables import Column, TextTable, bounded, markdown, table
from studies.verification.blood_cases import (
    ANEURYSM_CASES,
    OSCILLATING_CASES,
    PLANE_CASES,
    BloodCase,
)
from studies.verification.exact_flows import Measured
from studies.verification.far_from_dome import RANGES, SLOWED

BLOCK, CSV, MARKDOWN = "blood", "blood.csv", "blood.md"
RUNS = Path("runs/verify-blood")
CHECK = 1e-8
"""Largest accepted residual or difference that the independent checker finds, and the bound of the mass balance."""
PLANE, OSCILLATING, FAR, CHANGE, LONGEST = 1e-4, 5e-3, 3e-2, 1e-2, 900.0
CHANGES = {"wss_mean_dome": "WSS dome", "effective_stress_max": "effective stress"}
EXPLANATION = (
    "Errors are (value - exact) / |exact|; `!` marks what misses its bound. Seconds: processor time of the script, one "
    "thread. Largest check: the largest relative residual or difference that the independent checker finds, in time "
    "over all saved states. Mass balance: flow rate in less flow rate out, over the former."
)
CASES = (*PLANE_CASES, *OSCILLATING_CASES, *ANEURYSM_CASES)


@dataclass(frozen=True)
class Row:
    """What one run, or several, come to."""

    group: str  # the group of rows that it belongs to
    case: str  # name of the run
    labels: tuple[str, ...]  # what its first cells say
    level: int  # mesh level
    numbers: Mapping[str, Measured] = field(default_factory=dict)  # by quantity
    failure: str = ""  # empty, or why there are hardly any numbers, as `Result.failure`

    @property
    def cells(self) -> dict[str, Any]:
        """What columns show: of each quantity `NAME`, its value, `NAME.reference` and `NAME.error`."""
        found: dict[str, Any] = {f"label {i}": label for i, label in enumerate(self.labels)}
        for name, item in self.numbers.items():
            found |= {name: item.value, f"{name}.reference": item.reference, f"{name}.error": item.error}
        return found | ({"seconds": f"failed ({self.failure})"} if self.failure else {})


@dataclass(frozen=True)
class BloodTable:
    """A table of one group of rows."""

    group: str  # its rows
    text: str  # what stands above it, in Markdown
    labels: tuple[str, ...]  # headings of the first cells
    columns: Sequence[Column]  # the others
    finest: bool = False  # whether a short version has the rows of the finest mesh only

    def of(self, rows: Iterable[Row], *, short: bool = False) -> TextTable:
        """Return the table of those rows of its group that failed or have one of its quantities."""
        names = {quantity(column) for column in self.columns}
        own = [row for row in rows if row.group == self.group and (row.failure or names & row.numbers.keys())]
        if short and self.finest:
            own = [row for row in own if row.level == max(row.level for row in own)]
        labels = [Column(head, f"label {i}") for i, head in enumerate(self.labels)]
        return table([row.cells for row in own], [*labels, *self.columns], title=self.text)


def quantity(column: Column) -> str:
    """Return the name of the quantity that a column shows."""
    return str(column.of).partition(".")[0]


_UNKNOWNS, _SECONDS = Column("unknowns", "unknowns", "{:.0f}"), Column("seconds", "seconds", "{:.1f}")
_STEPS, _CHECK = Column("steps", "steps", "{:.0f}"), bounded("largest check", "check", CHECK, "{:.0e}")
_WALLS = ("walls, blood", "level")


def _far(ending: str) -> list[Column]:
    return [
        bounded(f"{low:g}-{high:g}°: {title}", f"{name}_{what}{ending}.error", FAR)
        for name, (low, high) in RANGES.items()
        for what, title in (("pressure", "Δp"), ("inner", "inner"), ("outer", "outer"))
    ]


TABLES = (
    BloodTable(
        "plane",
        "Plane channel, half height 1 mm, beside the exact flow of each viscosity law at a pressure gradient G: errors "
        "of the gradient at the given mean velocity, and where they are largest of the velocity in the middle and of "
        "the wall shear stress (WSS), which is G times the half height.",
        ("blood", "G Pa/m"),
        (
            *(_UNKNOWNS, _SECONDS, Column("mean velocity m/s", "mean", "{:.6g}")),
            *(bounded("G", "gradient.error", PLANE), bounded("largest velocity", "largest.error", PLANE)),
            *(bounded("WSS", "wall_shear_stress.error", PLANE), _CHECK),
        ),
    ),
    BloodTable(
        "oscillating",
        "Womersley's flow in a plane channel, Womersley number 3, flow rate 1 + 0.75 sin(2πt): largest differences "
        "over the third cycle, relative to the largest velocity and to the largest pressure drop.",
        ("level", "dt s"),
        (
            *(_UNKNOWNS, _STEPS, _SECONDS, bounded("velocity", "velocity_difference", OSCILLATING)),
            *(bounded("pressure drop", "pressure_difference", OSCILLATING), _CHECK),
        ),
    ),
    BloodTable(
        "steady",
        "Aneurysm, steady: pressure drop from inlet to outlet, beside that of the bent vessel at rest without a dome; "
        "mean WSS on the dome; largest effective stress away from corners and clamped faces. *Held*: by the support "
        "that the walls have in the pulsatile flow.",
        _WALLS,
        (
            *(_UNKNOWNS, _SECONDS, bounded("mass balance", "mass_balance", CHECK, "{:.0e}")),
            Column("pressure drop Pa", "pressure_drop", "{:.4f}"),
            Column("without a dome Pa", "pressure_drop.reference", "{:.4f}"),
            Column("WSS dome Pa", "wss_mean_dome", "{:.5f}"),
            Column("effective stress Pa", "effective_stress_max", "{:.1f}"),
            _CHECK,
        ),
        finest=True,
    ),
    BloodTable(
        "levels",
        "Its changes from one mesh level to the next:",
        ("walls, blood",),
        [
            column
            for name, title in CHANGES.items()
            for column in (
                Column(f"{title}, 1 to 2", f"{name}_2", "%"),
                bounded(f"{title}, 2 to 3", f"{name}_3", CHANGE),
            )
        ],
    ),
    BloodTable(
        "steady",
        "The same far from the dome (angles around the bend's centre; inlet at 90°, neck from 126.5 to 141.4°, outlet "
        "at 180°), beside the fully developed flow in a bent channel between the deformed walls: pressure difference "
        "in the middle of the lumen over a range of angles, and at inner and outer wall the WSS of the edge that is "
        "farthest off.",
        _WALLS,
        _far(""),
        finest=True,
    ),
    BloodTable(
        "steady",
        "Elastic walls make the lumen wider towards the dome; blood that slows down gains pressure, and accelerated "
        "loses it. The same beside the developed flow with that inertia, to first order; what is left comes, as with "
        "rigid walls, from the inlet's parabola, the neck and the outlet.",
        _WALLS,
        _far(SLOWED),
        finest=True,
    ),
    BloodTable(
        "pulsatile",
        "Aneurysm, pulsatile, four cycles at 84 beats per minute: TAWSS and OSI on the dome in the last one; change of "
        "TAWSS from the third to the fourth cycle (L2 norm over the walls).",
        _WALLS,
        (
            *(_UNKNOWNS, _STEPS, bounded("seconds", "seconds", LONGEST, "{:.0f}")),
            Column("per step", "seconds_per_step", "{:.3f}"),
            Column("TAWSS mean Pa", "tawss_mean_dome", "{:.5f}"),
            Column("min Pa (≥ 0)", "tawss_min_dome", "{:.5f}", least=0.0),
            Column("OSI max", "osi_max_dome", "{:.0e}"),
            *(bounded("change", "tawss_change", CHANGE, "{:.0e}"), _CHECK),
        ),
    ),
)


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
    done = run_all({case.folder: case.scene() for case in cases}, runs, jobs, study.command)
    rows = [_row(case, run, runs / case.folder) for case, run in zip(cases, done, strict=True)]
    rows += level_changes(rows)
    for item in TABLES:
        if (made := item.of(rows)).body:
            made.print()
    written = study.written(run.data for run in done)
    parts = ["# Flow of blood", written, EXPLANATION, _tables(rows)]
    study.write({CSV: lambda: to_frame(rows), MARKDOWN: lambda: markdown(parts) + "\n"}, digits="%.10g")
    text = f"{_tables(rows, short=True)}\n\n{written} {EXPLANATION}{study.links('All meshes', [MARKDOWN])}"
    return study.publish([run.failure for run in done], {BLOCK: text})


def _row(case: BloodCase, run: Run, directory: Path) -> Row:
    """Return what a run comes to."""
    numbers = {"unknowns": float(run.data.get("unknowns") or "nan")}
    if run.failure:
        measured: dict[str, Measured] = {}
    else:
        numbers |= {"seconds": run.seconds, "check": run.check_maximum}
        measured = dict(case.measure(load_result(directory)))
        if len(run.history):
            measured["seconds_per_step"] = Measured(run.steps["seconds_per_step"])
    found = {name: Measured(value) for name, value in numbers.items()} | measured
    return Row(case.group, case.folder, case.labels, case.level, found, run.failure)


def level_changes(rows: Sequence[Row]) -> list[Row]:
    """Return a row for every steady variant: what changes from one mesh level to the next, relative to the finer one.

    Quantities: `wss_mean_dome_2`, the change from level 1 to 2, `effective_stress_max_3`, ...
    """
    steady = [row for row in rows if row.group == "steady" and not row.failure]
    found = []
    for label in dict.fromkeys(row.labels[0] for row in steady):
        own = sorted((row for row in steady if row.labels[0] == label), key=lambda row: row.level)
        numbers = {
            f"{name}_{finer.level}": Measured(1 - coarser.numbers[name].value / finer.numbers[name].value)
            for coarser, finer in itertools.pairwise(own)
            for name in CHANGES
            if name in finer.numbers and finer.level == coarser.level + 1
        }
        found.append(Row("levels", own[-1].case.rpartition("-level-")[0], (label,), own[-1].level, numbers))
    return found


def _tables(rows: Sequence[Row], *, short: bool = False) -> str:
    """Return all tables that have rows, each under its text, in Markdown."""
    made = [item.of(rows, short=short) for item in TABLES]
    return markdown(part for item in made if item.body for part in (item.title, item))


def to_frame(rows: Iterable[Row]) -> pd.DataFrame:
    """Return one line per row and quantity; a row without numbers has one line.

    Columns: `group`, `case`, `level`, `failure`, `quantity`, `value`, `reference`, `error`, and `bound`, the largest
    accepted size of the error or, without a reference, of the value; NaN where there is none.
    """
    bounds = {
        (item.group, quantity(column)): column.bound
        for item in TABLES
        for column in item.columns
        if math.isfinite(column.bound)
    }
    lines: list[dict[str, Any]] = []
    for row in rows:
        common = {name: getattr(row, name) for name in ("group", "case", "level", "failure")}
        lines += [
            common
            | {"quantity": name, "value": item.value, "reference": item.reference, "error": item.error}
            | {"bound": bounds.get((row.group, name), math.nan)}
            for name, item in row.numbers.items()
        ] or [common]
    return pd.DataFrame(lines)
