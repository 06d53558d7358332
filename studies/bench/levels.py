"""Error against seconds over the mesh levels, and what assembly costs beside a factorisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ffsi.files.errors import InputError
from ffsi.report.curves import LINES, MARKERS
from ffsi.result.pictures import FAINT, INK, to_png
from ffsi.scene import load_scene
from studies.bench.costs import RATIOS, cost_row, marked
from studies.harness import Study
from studies.measurement import Measurement, measure
from studies.tables import TextTable, number, percent
from studies.verification.sources import COLUMNS, ReferenceSet, reference_sets

BOUNDS = (
    "The bounds are meant for about 30 000 unknowns (level 2); `!` marks what is above them. Level 0 starts from rest, "
    "with new factors in every iteration; the sums of the other levels contain the coarser meshes."
)


def to_row(runs: Sequence[Measurement]) -> dict[str, Any]:
    """Return the line of one level: the medians over its runs of seconds and ratios, and the errors.

    `error_0_drag` is the relative error of the drag against the first of the case's compared sources.
    """
    row = cost_row(runs)
    solved = next((run for run in runs if not run.failure), None)
    if solved is None:
        return row
    for index, source in enumerate(compared(solved.case)):
        row |= {f"error_{index}_{name}": error for name, error in solved.errors(source).items()}
    return row


def compared(case: str) -> list[ReferenceSet]:
    """Return the sources that the case's errors are taken against."""
    return [source for source in reference_sets(case) if source.compared]


def level_table(rows: Sequence[Mapping[str, Any]], case: str) -> TextTable:
    """Return sizes, seconds, errors against the published values, and Newton's counts on the final mesh."""
    source = compared(case)[0] if compared(case) else None
    names = list(source.values) if source else []
    title = f"{case}: errors against {source.source}" if source else case
    head = ["level", "unknowns", "triangles", "script s", "total s", *(COLUMNS[name] for name in names)]
    table = TextTable([*head, "iterations", "factorisations"], title=title)
    for row in rows:
        table.add(
            str(row["level"]),
            *(number(row.get(name), "{:d}") for name in ("unknowns", "triangles")),
            *(number(row.get(name), "{:.2f}") for name in ("script_seconds", "seconds")),
            *_errors(row, 0, names),
            *(number(row.get(name), "{:d}") for name in ("iterations", "factorizations")),
        )
    return table


def further_table(rows: Sequence[Mapping[str, Any]], index: int, source: ReferenceSet) -> TextTable:
    """Return the errors against the case's source number `index`."""
    table = TextTable(["level", *(COLUMNS[name] for name in source.values)], title=f"errors against {source.source}")
    for row in rows:
        table.add(str(row["level"]), *_errors(row, index, list(source.values)))
    return table


def ratio_table(rows: Sequence[Mapping[str, Any]]) -> TextTable:
    """Return the ratios with their bounds; a value above its bound is marked with `!`."""
    head = ["level", "unknowns", "one factorisation s", *(f"{ratio.title} (below {ratio.bound:g})" for ratio in RATIOS)]
    table = TextTable(head, title="seconds / seconds of one factorisation on the final mesh")
    for row in rows:
        table.add(
            str(row["level"]),
            number(row.get("unknowns"), "{:d}"),
            number(row.get("one_factorization_seconds"), "{:.3f}"),
            *(marked(row.get(f"ratio_{ratio.name}"), ratio.bound) for ratio in RATIOS),
        )
    return table


def _errors(row: Mapping[str, Any], index: int, names: Sequence[str]) -> list[str]:
    return [percent(row.get(f"error_{index}_{name}", float("nan"))) for name in names]


def draw(rows: Sequence[Mapping[str, Any]], case: str) -> Figure:
    """Draw |relative error| of each quantity over the script's seconds, one panel per source."""
    sources = compared(case)
    figure = Figure(figsize=(5.2 * max(1, len(sources)), 4.2), layout="constrained", facecolor="white")
    panels = np.atleast_1d(figure.subplots(1, max(1, len(sources)), sharey=True))
    for index, (axes, source) in enumerate(zip(panels, sources, strict=False)):
        for i, name in enumerate(source.values):
            key = f"error_{index}_{name}"
            points = [(row["script_seconds"], 100 * abs(row[key])) for row in rows if key in row]
            if not points:
                continue
            seconds, errors = zip(*points, strict=True)
            label = f"${COLUMNS[name]}$" if "_" in COLUMNS[name] else COLUMNS[name]
            style = {"color": LINES[i % len(LINES)], "marker": MARKERS[i % len(MARKERS)]}
            axes.loglog(seconds, errors, label=label, linewidth=1.4, markersize=5, **style)
        axes.set_title(f"{case}, against {source.source}", loc="left", fontsize=11, color=INK)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("seconds of the FreeFEM script, one thread", color=INK)
        axes.grid(True, which="both", color="#e3e6ea", linewidth=0.6)
        axes.tick_params(colors=INK, labelsize=9, width=0.6)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(FAINT)
    if sources:
        panels[0].set_ylabel("relative error (%)", color=INK)
        panels[0].legend(frameon=False, fontsize=9, labelcolor=INK)
    return figure


USUAL = (0, 1, 2, 3, 4)


def main(
    levels: Sequence[int] = USUAL,
    case: str = "turek-fsi1",
    *,
    repeat: int = 1,
    out: Path | None = None,
    readme: Path | None = None,
) -> list[str]:
    """Run a case on several mesh levels, one thread, and print errors, seconds and ratios.

    Args:
        levels: mesh levels.
        case: name of a catalogue case.
        repeat: runs per level; seconds and ratios are the medians.
    """
    load_scene(case, [])
    if repeat < 1:
        raise InputError(f"--repeat: at least one run, not {repeat}")
    options = f" --levels {','.join(map(str, levels))}" if tuple(levels) != USUAL else ""
    options += (f" --case {case}" if case != "turek-fsi1" else "") + (f" --repeat {repeat}" if repeat > 1 else "")
    study = Study(f"bench{options}", out, readme, ["bench"])
    runs = [[measure(case, level) for _ in range(repeat)] for level in levels]
    rows = [to_row(group) for group in runs]
    tables = [level_table(rows, case)]
    tables += [further_table(rows, index, source) for index, source in enumerate(compared(case)) if index]
    tables.append(ratio_table(rows))
    for table in tables:
        table.print()
    csv, picture = f"bench-{case}.csv", f"bench-{case}.png"
    study.write({csv: lambda: pd.DataFrame(rows), picture: lambda: to_png(draw(rows, case))})
    every = [run for group in runs for run in group]
    more = f"{study.written(every)} {BOUNDS}{study.links('Error over seconds', [picture])}"
    return study.publish([run.failure for run in every], {"bench": f"{tables[-1].markdown()}\n\n{more}"})
