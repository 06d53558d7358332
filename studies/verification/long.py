"""`verify --long`: whether the large oscillations stay as they are over many periods, and the mesh with them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ffsi.report.history import time_history
from ffsi.result.oscillation import BLOCK as PERIODS
from ffsi.result.oscillation import Oscillation, blocks
from ffsi.result.pictures import to_small_png
from ffsi.scene import CASES, Scene, load_scene
from studies.harness import Study
from studies.kept_runs import TimeRun, run_all
from studies.tables import NOTHING, TextTable, number, percent
from studies.verification.periodic import RUNS
from studies.verification.periodic_cases import PLAIN
from studies.verification.periodic_output import COSTS_TEXT, cost_cells, cost_head, marked

BLOCK = "long"
CSV, MARKDOWN = "long.csv", "long.md"
SIGNAL = "tip_uy"
BOUND = 1e-2
"""Largest accepted change of the amplitude from the last but one block to the last."""
EXPLANATION = (
    f"Blocks of {PERIODS} periods of the tip's u_y each, from half of the final amplitude on: the amplitude is "
    f"(max - min)/2 of a block. The change between the last two blocks must be below {100 * BOUND:g} %; `!` marks what "
    "is not. min J: the smallest J = det F of fluid mesh and beam in a block. " + COSTS_TEXT
)


@dataclass(frozen=True)
class LongCase:
    """A case of the catalogue that is run to a time in s, with the catalogue's mesh and time step."""

    name: str
    end: float

    @property
    def folder(self) -> str:
        """Name of the run folder."""
        return f"{self.name}-long"

    @property
    def picture(self) -> str:
        """Name of the picture: `long-fsi2.png`."""
        return f"long-{self.name.removeprefix('turek-')}.png"

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return load_scene(self.name, [f"time.end={self.end!r}", "time.stop=end", *PLAIN])


LONG_CASES = (LongCase("turek-fsi2", 35.0), LongCase("turek-fsi3", 20.0))


@dataclass(frozen=True)
class LongRun:
    """What became of a long run."""

    case: LongCase
    run: TimeRun

    @property
    def complete(self) -> bool:
        """Whether it came to its end."""
        return not self.run.failure and float(self.run.in_time.get("reached", 0.0)) >= self.case.end * (1 - 1e-9)

    @cached_property
    def blocks(self) -> list[Oscillation]:
        """The successive blocks of two periods."""
        history = self.run.history
        try:
            return blocks(history["time"], history[SIGNAL]) if len(history) else []
        except ValueError:  # a value is not finite
            return []

    @property
    def changes(self) -> list[float]:
        """Change of the amplitude of each block from the one before, relative to its own; NaN of the first one."""
        sizes = [math.nan, *(block.amplitude for block in self.blocks)]
        return [(after - before) / after for before, after in itertools.pairwise(sizes)]

    @property
    def last_change(self) -> float:
        """Change between the last two blocks; NaN with fewer."""
        return self.changes[-1] if self.changes else math.nan

    @cached_property
    def least_jacobians(self) -> list[float]:
        """Smallest J of each block."""
        times, values = (self.run.history[name].to_numpy(dtype=np.float64) for name in ("time", "min_jacobian"))
        return [float(values[(times >= block.start) & (times <= block.end)].min()) for block in self.blocks]


def summary_table(runs: Sequence[LongRun]) -> TextTable:
    """Return one row per run: costs, amplitude and J of the last block, and the last change with its bound."""
    last = ["blocks", "u_y amplitude m", f"last change (< {100 * BOUND:g} %)", "min J first", "last"]
    table = TextTable(["case", *cost_head(), *last, "least", "check"])
    for item in runs:
        costs = cost_cells(item.run, CASES[item.case.name].time.step)  # type: ignore[union-attr]
        costs[2] += "" if item.complete else " !"
        least = item.least_jacobians
        table.add(
            item.case.name,
            *costs,
            str(len(item.blocks)),
            number(item.blocks[-1].amplitude, "{:.5f}") if item.blocks else NOTHING,
            marked(item.last_change, BOUND),
            *(number(value, "{:.4f}") for value in ((least[0], least[-1], min(least)) if least else (None,) * 3)),
            number(item.run.check_maximum, "{:.0e}"),
        )
    return table


def block_table(item: LongRun) -> TextTable:
    """Return every block of a run."""
    head = ["block", "from t in s", "to t in s", "frequency in Hz", "mean in m", "amplitude in m", "change", "min J"]
    table = TextTable(head, title=item.case.name)
    rows = zip(item.blocks, item.changes, item.least_jacobians, strict=True)
    for count, (block, change, least) in enumerate(rows, start=1):
        table.add(
            str(count),
            f"{block.start:.3f}",
            f"{block.end:.3f}",
            f"{block.frequency:.4f}",
            f"{block.mean:.6f}",
            f"{block.amplitude:.6f}",
            percent(change),
            f"{least:.4f}",
        )
    return table


def to_frame(runs: Sequence[LongRun]) -> pd.DataFrame:
    """Return one row per block of every run; a run without blocks has one row."""
    rows: list[dict[str, Any]] = []
    for item in runs:
        reached = item.run.in_time.get("reached")
        common = {
            "case": item.case.name, "level": item.run.scene.mesh.level, "unknowns": item.run.data.get("unknowns"),
            "complete": item.complete, "reached": reached, "check_maximum": item.run.check_maximum,
        }  # fmt: skip
        of_blocks = [
            {
                "block": count, "start": block.start, "end": block.end, "frequency": block.frequency,
                "mean": block.mean, "amplitude": block.amplitude, "change": change, "min_jacobian": least,
            }
            for count, (block, change, least) in enumerate(
                zip(item.blocks, item.changes, item.least_jacobians, strict=True), start=1
            )
        ]  # fmt: skip
        rows += [common | block for block in of_blocks] or [common]
    return pd.DataFrame(rows)


def main(
    *,
    jobs: int = 1,
    out: Path | None = None,
    readme: Path | None = None,
    runs: Path = RUNS,
    cases: Sequence[LongCase] = LONG_CASES,
) -> list[str]:
    """Run the long cases, print amplitudes and J of their blocks, and write them down. A second call goes on."""
    study = Study("verify --long", out, readme, [BLOCK])
    done = run_all({case.folder: case.scene for case in cases}, runs, jobs, "verify --long")
    found = [LongRun(case, run) for case, run in zip(cases, done, strict=True)]
    summary_table(found).print()
    written = study.written(done)
    drawn = {item.case.picture: figure for item in found if (figure := _draw(item)) is not None}
    study.write({
        CSV: lambda: to_frame(found),
        MARKDOWN: lambda: document(found, written),
        **{name: partial(to_small_png, figure) for name, figure in drawn.items()},
    })  # fmt: skip
    files = study.links("More", [MARKDOWN, *(case.picture for case in cases)])
    text = f"{summary_table(found).markdown()}\n\n{written} {EXPLANATION}{files}"
    return study.publish([run.failure for run in done], {BLOCK: text})


def _draw(item: LongRun) -> Figure | None:
    last = item.blocks[-1] if item.blocks else None
    period = (last.end - (last.end - last.start) / PERIODS, last.end) if last else None
    return time_history(item.run.history, period)


def document(found: Sequence[LongRun], written: str) -> str:
    """Return `long.md`."""
    parts = ["# Long runs", written, EXPLANATION, summary_table(found).markdown()]
    for item in found:
        parts += [f"## {item.case.name}", f"![{item.case.name} over time]({item.case.picture})"]
        parts.append(block_table(item).markdown())
    return "\n\n".join(parts) + "\n"
