"""What a time step costs, of FSI3 at full swing and of the pulsatile aneurysm with Carreau blood.

By the velocity alone with kept factors, and by plain Newton.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.checkpoints import Checkpoint
from ffsi.files.errors import InputError
from ffsi.files.history import read_history
from ffsi.files.manifest import begin, newest_checkpoint
from ffsi.freefem import FreeFEMError, FreeFEMNotFound, find_freefem
from ffsi.hemodynamics.result import load_result
from ffsi.run.one_scene import resume
from ffsi.scene import Scene, load_scene
from ffsi.script.render import render
from studies.bench import time_steps
from studies.bench.costs import SOLVER, WORDS, marked
from studies.harness import Study
from studies.kept_runs import TimeRun, run_one
from studies.tables import TextTable, number
from studies.verification.periodic_cases import PLAIN

BLOCK = "bench-unsteady"
CSV, STEPS_CSV = "bench-unsteady.csv", "bench-time-steps.csv"
RUNS = Path("runs/bench-unsteady")
STEPS = {"condensed": 100, "newton": 6}  # that are measured: a cycle of the inflow, or two periods of FSI3 and some
RATIO_BOUND = 10.0
WORD = {"condensed": "condensed", "newton": "plain Newton"}
CARREAU = "aneurysm-pulsatile, Carreau"
EXPLANATION = (
    "turek-fsi3 from where the beam swings with its full amplitude, dt 0.005 s; aneurysm-pulsatile with Carreau blood "
    "from its second cycle on, dt a hundredth of a cycle. *condensed*: `solver.step` as it is in the catalogue, "
    f"{STEPS['condensed']} steps; *plain Newton*: the whole Jacobian with new factors in every iteration, "
    f"{STEPS['newton']} steps from the same checkpoint. Seconds: processor time of the script. The first step of the "
    "process, which sets everything up (the factors that the checkpoint names among it), and the last one, which is "
    "solved to round-off, do not count. Ratio: of the means. Phases: seconds per step, what a process without counted "
    "steps needs taken off. `!` marks what misses its bound."
)


@dataclass(frozen=True)
class Size:
    """A case on a mesh.

    Attributes:
        name: of the run folders.
        title: of the case, in the table.
        case: of the catalogue.
        unknowns: what the mesh is meant to have.
        settings: of the scene.
        step: time step, s.
        developed: when the motion is, s.
        bound: of the seconds that a step takes.
    """

    name: str
    title: str
    case: str
    unknowns: int
    settings: tuple[str, ...]
    step: float
    developed: float
    bound: float

    def scene(self, end: float, step: str = "condensed") -> Scene:
        """Return the case on this mesh to a time in s, with the solver `step`."""
        steps = (f"time.step={self.step!r}", f"time.end={end!r}", "time.stop=end", f"solver.step={step}")
        return load_scene(self.case, [*self.settings, *steps, *PLAIN])


_BLOOD = ("fluid.law=carreau", f"time.output_interval={60 / 84!r}")
SIZES = (
    Size("13k", "turek-fsi3", "turek-fsi3", 13_000, ("mesh.level=1", "mesh.size_factor=1.1"), 0.005, 10.0, 0.12),
    Size("30k", "turek-fsi3", "turek-fsi3", 30_000, ("mesh.level=2",), 0.005, 5.0, 0.28),
    Size("13k-carreau", CARREAU, "aneurysm-pulsatile", 13_000, ("mesh.level=1", *_BLOOD), 0.6 / 84, 60 / 84, 0.12),
    Size(
        "30k-carreau",
        CARREAU,
        "aneurysm-pulsatile",
        30_000,
        ("mesh.level=2", "mesh.size_factor=0.9", *_BLOOD),
        0.6 / 84,
        60 / 84,
        0.28,
    ),
)


@dataclass(frozen=True)
class Steps:
    """The measured steps of one process.

    Attributes:
        data: content of its `result.json`.
        seconds: of each measured step.
        iterations: per step.
        rebuilds: new factors per step.
        phases: seconds of the process in the phases `SOLVER`.
        swing: half the range of the tip's u_y, m.
    """

    data: Mapping[str, Any]
    seconds: Sequence[float] = ()
    iterations: float = math.nan
    rebuilds: float = math.nan
    phases: Mapping[str, float] = field(default_factory=dict)
    swing: float = math.nan

    @property
    def failure(self) -> str:
        """As `Result.failure`."""
        return str(self.data.get("failure", ""))


def develop(size: Size, runs: Path) -> TimeRun:
    """Run to the developed motion, or find it where an earlier call has left it."""
    name = f"{size.name}-developed"
    with show.progress(f"{size.case} {name}") as on_event:
        return run_one(name, size.scene(size.developed), runs / name, on_event)


def start_from(source: Path, checkpoint: Checkpoint, scene: Scene, directory: Path) -> None:
    """Make a run folder in which `scene` goes on from a checkpoint of another run on the same mesh."""
    folder.prepare(directory)
    folder.write_text(directory / folder.SCRIPT, render(scene, mumps=find_freefem().has_mumps))
    folder.write_text(directory / folder.SCENE, scene.to_toml())
    for name in (folder.TIME_HISTORY, folder.HISTORY, checkpoint.path.name):
        shutil.copy(source / name, directory / name)
    with (source / folder.STEPS).open(encoding="utf-8") as steps:  # its saved states stay where they are
        folder.write_text(directory / folder.STEPS, steps.readline())
    begin(directory, Checkpoint(directory / checkpoint.path.name, checkpoint.step, checkpoint.time))


def measure(size: Size, step: str, count: int, source: Path, directory: Path) -> Steps:
    """Go on from the developed motion for `count` steps, and one before and one after them that do not count."""
    checkpoint = newest_checkpoint(source)
    if checkpoint is None:
        raise InputError(f"{source} holds no checkpoint; remove it, and call again")
    scene = size.scene(checkpoint.time + (count + 2) * size.step, step)
    start_from(source, checkpoint, scene, directory)
    name = f"{size.case} {size.name}, {WORD[step]}"
    try:
        with show.progress(name) as on_event:
            resume(directory, on_event=on_event)
    except FreeFEMNotFound:
        raise
    except FreeFEMError:  # the result says so
        pass
    data = load_result(directory).data
    if data.get("failure"):
        show.error(f"{name}: {data['reason']}; what there is lies in {directory}")
        return Steps(data)
    return steps_of(data, directory, checkpoint.step)


def steps_of(data: Mapping[str, Any], directory: Path, before: int) -> Steps:
    """Return what the steps after the step `before` cost, without the first and the last one."""
    new = read_history(directory).iloc[before:]
    counted = new.iloc[1:-1]
    newton = pd.read_csv(directory / folder.HISTORY)
    fresh = newton.loc[newton["step"].between(before + 2, before + len(new) - 1), "factorized"].sum()
    swing = counted["tip_uy"].to_numpy(dtype=np.float64)
    return Steps(
        data,
        new["seconds"].diff().iloc[1:-1].tolist(),
        float(counted["iterations"].mean()),
        float(fresh) / max(len(counted), 1),
        {name: data["timings"].get(name, math.nan) for name in SOLVER},
        float(np.ptp(swing)) / 2 if len(swing) else math.nan,
    )


def row(size: Size, step: str, runs: Sequence[Steps], start: Steps) -> dict[str, Any]:
    """Return what the steps of several runs cost: of each number the median over the runs.

    Args:
        size: the mesh.
        step: the solver.
        runs: several runs of the same steps.
        start: a run without counted steps; its phases are not those of steps.
    """
    solved = [run for run in runs if not run.failure]
    found: dict[str, Any] = {"case": size.case, "mesh": size.name, "solver": step, "runs": len(runs)}
    found |= {"status": "converged" if len(solved) == len(runs) else "failed"}
    if not solved:
        return found
    values = [
        {
            "steps": len(run.seconds),
            "median_seconds": float(np.median(run.seconds)),
            "mean_seconds": float(np.mean(run.seconds)),
            "largest_seconds": max(run.seconds),
            "iterations_per_step": run.iterations,
            "rebuilds_per_100_steps": 100 * run.rebuilds,
            **{
                f"{name}_seconds": max(value - start.phases.get(name, math.nan), 0.0) / len(run.seconds)
                for name, value in run.phases.items()
            },
            "swing": run.swing,
        }
        for run in solved
    ]
    data = solved[0].data
    found |= {"unknowns": data["unknowns"], "triangles": data["triangles"], "step": size.step}
    return found | {str(name): value for name, value in pd.DataFrame(values).median().items()}


def table(rows: Sequence[Mapping[str, Any]], sizes: Sequence[Size] = SIZES) -> TextTable:
    """Return one row per mesh and solver; `!` marks what misses its bound."""
    head = ["case", "unknowns", "solver", "s per step, median", "mean", "bound", f"ratio (> {RATIO_BOUND:g})"]
    head += ["iterations per step", "rebuilds in 100 steps", *(f"{WORDS.get(name, name)} s" for name in SOLVER)]
    result = TextTable([*head, "u_y ± m"], left=1, title="Seconds per time step")
    by_name = {size.name: size for size in sizes}
    for item in rows:
        kept = item["solver"] == "condensed"
        size = by_name[item["mesh"]]
        bound = size.bound if kept else math.inf
        ratio = item.get("ratio")
        result.add(
            size.title,
            number(item.get("unknowns"), "{:d}"),
            WORD[item["solver"]],
            *(marked(item.get(f"{name}_seconds"), bound, "{:.3f}") for name in ("median", "mean")),
            number(bound if kept else None, "{:.2f}"),
            number(ratio) + (" !" if ratio is not None and ratio < RATIO_BOUND else ""),
            number(item.get("iterations_per_step")),
            number(item.get("rebuilds_per_100_steps")),
            *(number(item.get(f"{name}_seconds"), "{:.3f}") for name in SOLVER),
            number(item.get("swing"), "{:.3g}"),
        )
    return result


def main(
    *,
    repeat: int = 1,
    out: Path | None = None,
    readme: Path | None = None,
    runs: Path = RUNS,
    sizes: Sequence[Size] = SIZES,
) -> list[str]:
    """Run each case to its developed motion, measure steps from there with both solvers, and print what they cost.

    Then the error against the time step, of CSM3.

    Args:
        repeat: runs of the condensed solver on each mesh; its numbers are the medians.
    """
    if repeat < 1:
        raise InputError(f"--repeat: at least one run, not {repeat}")
    study = Study("bench --unsteady" + (f" --repeat {repeat}" if repeat > 1 else ""), out, readme, [BLOCK])
    rows: list[dict[str, Any]] = []
    done: list[TimeRun | Steps] = []
    for size in sizes:
        source = develop(size, runs)
        done.append(source)
        if source.failure:
            continue
        pair = []
        for step, times in (("condensed", repeat), ("newton", 1)):
            start, *own = [
                measure(size, step, STEPS[step] if i else 0, source.directory, runs / f"{size.name}-{step}-{i}")
                for i in range(times + 1)
            ]
            done += [start, *own]
            pair.append(row(size, step, own, start))
        if all("mean_seconds" in item for item in pair):
            pair[0]["ratio"] = pair[1]["mean_seconds"] / pair[0]["mean_seconds"]
        rows += pair
    refined = time_steps.run(runs)
    done += refined
    errors = time_steps.rows(refined)
    tables = table(rows, sizes), time_steps.table(errors)
    for item in tables:
        item.print()
    study.write({CSV: lambda: pd.DataFrame(rows), STEPS_CSV: lambda: pd.DataFrame(errors)})
    written = study.written(done) + study.links("More", (CSV, STEPS_CSV))
    parts = [EXPLANATION, tables[0].markdown(), time_steps.EXPLANATION, tables[1].markdown(), written]
    return study.publish([item.failure for item in done], {BLOCK: "\n\n".join(parts)})
