"""Whether error bars cover the errors: every steady case beside its own finest mesh, `verify --errors`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from ffsi.report.curves import dress
from ffsi.result.pictures import to_png
from ffsi.scene import CASES, load_scene
from studies.harness import PLAIN, Run, Study, run_one, side_by_side
from studies.tables import columns, logarithmic, percent, table

RUNS = Path("runs/errors")
LEVELS, FINEST = (0, 1, 2), 4
MORE = {f"flap-{law} at {u} m/s": (f"flap-{law}", (f"inflow.mean_velocity={u}",))
        for law, u in (("svk", 0.02), ("neo-hookean", 0.03), ("mooney-rivlin-roof", 0.04))}  # fmt: skip
"""Scenes on which no bar was tuned, by their names: cases with other settings."""
COLUMNS = columns(
    "case | levels with bars = meshes :d | values = count :d | covered :d | effectivity, median = effectivity :.2f | "
    "bar / error, median = width :.1f"
)


def scenes() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return case and settings by the name of what runs."""
    steady = {name: (name, ()) for name in CASES if load_scene(name).time is None}
    return {**steady, **MORE}


def rows_of(name: str, coarse: Sequence[Run], fine: Run) -> list[dict[str, Any]]:
    """Return a row for every quantity with a bar on a coarse mesh: value, error, estimate, bar."""
    found = []
    for run in coarse:
        for quantity, error in (run.data.get("errors") or {}).items():
            value, reference = run.value(quantity), fine.value(quantity)
            wrong = reference - value
            # What vanishes by symmetry has no error to compare with; a coefficient is its force again.
            if math.isnan(wrong) or abs(wrong) < 1e-10 * abs(reference) or quantity.endswith("_coefficient"):
                continue
            found.append(
                {
                    "case": name, "level": run.level, "quantity": quantity, "value": value, "error": wrong,
                    "estimate": error["estimate"], "bar": error["bar"], "covered": abs(wrong) <= error["bar"],
                    "effectivity": error["estimate"] / wrong, "width": error["bar"] / abs(wrong),
                }
            )  # fmt: skip
    return found


def summary(name: str, rows: pd.DataFrame) -> dict[str, Any]:
    """Return how many values there are, how many errors are covered, and medians."""
    return {
        "case": name, "meshes": len(rows[["case", "level"]].drop_duplicates()), "count": len(rows),
        "covered": int(rows["covered"].sum()), "effectivity": rows["effectivity"].median(),
        "width": rows["width"].median(),
    }  # fmt: skip


def main(jobs: int = 1, runs: Path = RUNS, out: Path | None = None) -> list[str]:
    """Run what is missing; return the failures. Files in `out`: errors.md, errors.csv, errors.png."""
    study = Study("verify --errors", out, name="errors")
    tasks = {}
    for name, (case, settings) in scenes().items():
        for level in (*LEVELS, FINEST):
            scene = load_scene(case, [*settings, *PLAIN, f"mesh.level={level}"])
            at = f"{name.replace(' ', '-').replace('/', '-')}-{level}"
            tasks[name, level] = partial(run_one, at, scene, runs / at, error=level != FINEST)
    done = side_by_side(tasks, jobs, "errors")
    data = [
        row for name in scenes() for row in rows_of(name, [done[name, level] for level in LEVELS], done[name, FINEST])
    ]
    rows = pd.DataFrame(data)
    per_case = [summary(str(name), own) for name, own in rows.groupby("case", sort=False)]
    whole = summary("all", rows)
    shown = table([*per_case, whole], COLUMNS)
    without = [f"{name} on level {level}" for (name, level), run in done.items() if level != FINEST and _bare(run.data)]
    return study.finish(
        [run.data for run in done.values()], [shown],
        {"errors.csv": lambda: rows, "errors.png": lambda: to_png(_picture(rows))}, table=shown, whole=whole,
        part=percent(whole["covered"] / whole["count"])[1:], without=without, levels=LEVELS, finest=FINEST,
    )  # fmt: skip


def _bare(data: Mapping[str, Any]) -> bool:
    return not data.get("failure") and not data.get("errors")


def _picture(rows: pd.DataFrame) -> Figure:
    figure = Figure(figsize=(6.4, 5.2), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    relative = rows.assign(x=(rows["error"] / rows["value"]).abs(), y=(rows["bar"] / rows["value"]).abs())
    for level, own in relative.groupby("level"):
        axes.plot(own["x"], own["y"], "o", markersize=3.5, label=f"level {level}")
    axes.axline((1e-4, 1e-4), slope=1, color="#777", linewidth=0.8)
    logarithmic(axes)
    axes.legend(frameon=False)
    dress(axes, "", "relative error", "relative error bar")
    return figure
