"""What a run costs in units of one factorisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from ffsi.hemodynamics.result import Result
from ffsi.scene import load_scene
from studies.harness import solved
from studies.measurement import Measurement
from studies.tables import number

SOLVER = ("residual", "jacobian", "factorize", "solve")
WORDS = {"jacobian": "Jacobian", "factorize": "factorise"}  # phases that are called otherwise in tables
COARSER = "coarser_meshes"


@dataclass(frozen=True)
class Ratio:
    """A cost in units of one factorisation on the final mesh: the sum of `phases`, which should be below `bound`."""

    name: str
    title: str
    phases: tuple[str, ...]
    bound: float


# Phases are summed over the whole run, coarser meshes included; one_* is the median of a single one on the final mesh.
RATIOS = (
    Ratio("newton", "residual + Jacobian + factorise + solve", SOLVER, 5.0),
    Ratio("one_jacobian", "one Jacobian", ("one_jacobian",), 1.0),
    Ratio("one_residual", "one residual", ("one_residual",), 0.05),
    Ratio("overhead", "mesh + operators + output + check", ("mesh", "operators", "output", "check"), 4.0),
)


def ratios(timings: Mapping[str, float]) -> dict[str, float]:
    """Return each of `RATIOS` from the timings of one run (s); NaN where a phase was not timed."""
    return {ratio.name: in_factorizations(timings, ratio.phases) for ratio in RATIOS}


def in_factorizations(timings: Mapping[str, float], phases: Sequence[str]) -> float:
    """Return the sum of some phases in units of one factorisation; NaN where one was not timed."""
    unit = timings.get("one_factorization") or float("nan")
    return sum(timings.get(phase, float("nan")) for phase in phases) / unit


def cost_row(runs: Sequence[Measurement]) -> dict[str, Any]:
    """Return sizes, Newton's counts and the medians of seconds and ratios over the runs of one scene on one level."""
    solved = [run for run in runs if not run.failure]
    row: dict[str, Any] = {
        "case": runs[0].case,
        "level": runs[0].level,
        "status": "converged" if len(solved) == len(runs) else "failed",
        "runs": len(runs),
    }
    if not solved:
        return row
    data = solved[0].data
    row |= {
        "unknowns": data["unknowns"],
        "triangles": data["triangles"],
        "iterations": data["newton"]["iterations"],
        "factorizations": data["newton"]["factorizations"],
    }
    times = pd.DataFrame([run.timings for run in solved]).median()
    row |= {"script_seconds": times.get("script"), "seconds": times.get("total")}
    row |= {f"{name}_seconds": value for name, value in times.items() if name not in ("script", "total")}
    costs = pd.DataFrame([ratios(run.timings) for run in solved]).median()
    row |= {f"ratio_{name}": value for name, value in costs.items()}
    return row


def marked(value: float | None, bound: float, form: str = "") -> str:
    """Return a number, with `!` if it is above its bound."""
    text = number(value, form or ("{:.3f}" if bound < 1 else "{:.2f}"))
    return f"{text} !" if value is not None and value > bound else text


def run(case: str, settings: Sequence[str] = ()) -> Measurement:
    """Run and check a catalogue case, with one thread, in a temporary folder and without pictures.

    A process that dies is a Measurement with the failure `crash`. The timings of a solved run also hold
    `coarser_meshes`: the script's seconds until Newton's method had finished on the last but one mesh.

    Raises:
        SceneError: there is no such case, or a setting is not valid.
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    scene = load_scene(case, [*settings, "output.pictures=false"])
    data = solved(
        scene,
        " ".join([case, *settings]),
        lambda result: {"timings": {**result.data["timings"], COARSER: coarser_seconds(result)}},
    )
    return Measurement(case, scene.mesh.level, data)


def coarser_seconds(result: Result) -> float:
    """Return the script's seconds until the first guess on the final mesh was there."""
    history = result.history
    before = history[history["stage"] < history["stage"].max()]
    return 0.0 if before.empty else float(before["seconds"].max())
