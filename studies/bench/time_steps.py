"""Error against the time step: the beam swinging under gravity (CSM3) over its first period."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ffsi.scene import Scene, load_scene
from studies.kept_runs import TimeRun, run_all
from studies.tables import NOTHING, TextTable, number, percent
from studies.verification.periodic_cases import PLAIN

CASE = "turek-csm3"
LEVEL, END = 0, 1.0  # s; a little more than a period
STEPS = (0.04, 0.02, 0.01, 0.005, 0.0025)  # s
FINEST = 0.0003125  # s, what the others are compared with
SIGNAL = "tip_uy"
EXPLANATION = (
    f"Error against the time step: {CASE} on mesh level {LEVEL} to t = {END:g} s; the largest difference of the tip's "
    f"u_y from that with dt {FINEST:g} s, over its largest value, and the order from one step to the next."
)


def scene(step: float) -> Scene:
    """Return what is solved with a time step in s."""
    settings = (f"mesh.level={LEVEL}", f"time.step={step!r}", f"time.end={END!r}", "time.stop=end")
    return load_scene(CASE, [*settings, *PLAIN])


def run(runs: Path) -> list[TimeRun]:
    """Run every time step, the finest one last, or find the runs that an earlier call has finished."""
    return run_all({f"{CASE}-step-{step:g}": scene(step) for step in (*STEPS, FINEST)}, runs)


def rows(runs: Sequence[TimeRun]) -> list[dict[str, Any]]:
    """Return error and order of every time step but the finest; no error where a run failed."""
    *coarse, finest = runs
    found: list[dict[str, Any]] = []
    before = math.nan
    for step, item in zip(STEPS, coarse, strict=True):
        error = math.nan if item.failure or finest.failure else difference(item, finest)
        found.append(
            {
                "case": CASE, "step": step, "steps": item.steps, "seconds": item.seconds,
                "seconds_per_step": item.seconds_per_step, "error": error, "order": math.log2(before / error),
            }
        )  # fmt: skip
        before = error
    return found


def difference(item: TimeRun, finest: TimeRun) -> float:
    """Return the largest difference at the times of the coarser run, over the largest value; dimensionless."""
    times, values = (item.history[name].to_numpy(dtype=np.float64) for name in ("time", SIGNAL))
    other, exact = (finest.history[name].to_numpy(dtype=np.float64) for name in ("time", SIGNAL))
    at = np.abs(other[:, None] - times[None, :]).argmin(axis=0)
    return float(np.abs(values - exact[at]).max() / np.abs(exact).max())


def table(found: Sequence[Mapping[str, Any]]) -> TextTable:
    """Return one row per time step."""
    result = TextTable(["dt s", "steps", "seconds", "per step", "error of u_y", "order"], left=0, title=CASE)
    for item in found:
        result.add(
            f"{item['step']:g}",
            str(item["steps"]),
            number(item["seconds"]),
            number(item["seconds_per_step"], "{:.3f}"),
            NOTHING if math.isnan(item["error"]) else percent(item["error"]).removeprefix("+"),
            number(item["order"], "{:.2f}"),
        )
    return result
