"""What a time step costs, of FSI3 at full swing and of the pulsatile aneurysm with Carreau blood; what it is worth.

By the velocity alone with kept factors, and by plain Newton. Error against the time step: CSM3 over its first period.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

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
from studies.bench.steady import SOLVER, WORDS
from studies.harness import PLAIN, Place, Run, Study, repeated, run_all
from studies.tables import Column, TextTable, columns, table, unsigned

RUNS = Path("runs/bench-unsteady")
STEPS = {"condensed": 100, "newton": 6}  # that are measured: a cycle of the inflow, or two periods of FSI3 and some
RATIO_BOUND = 10.0
WORD = {"condensed": "condensed", "newton": "plain Newton"}


class Size(NamedTuple):
    """A case on a mesh."""

    name: str  # of the run folders
    title: str  # of the case, in the table
    case: str  # of the catalogue
    settings: tuple[str, ...]  # of the scene
    step: float  # time step, s
    developed: float  # when the motion is, s
    bound: float  # of the seconds that a step takes

    def scene(self, end: float, step: str = "condensed") -> Scene:
        """Return the case on this mesh to a time in s, with the solver `step`."""
        steps = (f"time.step={self.step!r}", f"time.end={end!r}", "time.stop=end", f"solver.step={step}")
        return load_scene(self.case, [*self.settings, *steps, *PLAIN])


_FLAG, _VESSEL = ("turek-fsi3",) * 2, ("aneurysm-pulsatile, Carreau", "aneurysm-pulsatile")
_BLOOD, _CYCLE = ("fluid.law=carreau", f"time.output_interval={60 / 84!r}"), (0.6 / 84, 60 / 84)
SIZES = (
    Size("13k", *_FLAG, ("mesh.level=1", "mesh.size_factor=1.1"), 0.005, 10.0, 0.12),
    Size("30k", *_FLAG, ("mesh.level=2",), 0.005, 5.0, 0.28),
    Size("13k-carreau", *_VESSEL, ("mesh.level=1", *_BLOOD), *_CYCLE, 0.12),
    Size("30k-carreau", *_VESSEL, ("mesh.level=2", "mesh.size_factor=0.9", *_BLOOD), *_CYCLE, 0.28),
)


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


def measure(size: Size, step: str, count: int, source: Path, directory: Path) -> Run:
    """Go on from the developed motion for `count` steps, and one before and one after them that do not count."""
    checkpoint = newest_checkpoint(source)
    if checkpoint is None:
        raise InputError(f"{source} holds no checkpoint; remove it, and call again")
    start_from(source, checkpoint, size.scene(checkpoint.time + (count + 2) * size.step, step), directory)
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
        return Run(name, data)
    return Run(name, data, history=counted(directory, checkpoint.step))


def counted(directory: Path, before: int) -> pd.DataFrame:
    """Return the steps after `before` but the first and last one, with `took`, seconds, and `rebuilds`, new factors."""
    new = read_history(directory).iloc[before:]
    newton = pd.read_csv(directory / folder.HISTORY)
    rebuilds = newton.groupby("step")["factorized"].sum().reindex(new.index + 1, fill_value=0).to_numpy()
    return new.assign(took=new["seconds"].diff(), rebuilds=rebuilds).iloc[1:-1]


def row(size: Size, step: str, runs: Sequence[Run], start: Run) -> dict[str, Any]:
    """Return the medians of what the steps of runs cost; the phases of `start`, a run without steps, are taken off."""
    solved = [run for run in runs if not run.failure]
    status = "converged" if len(solved) == len(runs) else "failed"
    found = {"case": size.case, "mesh": size.name, "solver": step, "runs": len(runs), "status": status}
    if not solved:
        return found
    setup = {} if start.failure else start.timings
    values = []
    for run in solved:
        steps, seconds = run.history, run.history["took"].to_numpy()
        line = {
            "steps": len(steps), "median_seconds": np.median(seconds), "mean_seconds": np.mean(seconds),
            "largest_seconds": seconds.max(), "iterations_per_step": steps["iterations"].mean(),
            "rebuilds_per_100_steps": 100 * (steps["rebuilds"].sum() / len(steps)),
        }  # fmt: skip
        for name in SOLVER:
            own = run.timings.get(name, math.nan) - setup.get(name, math.nan)
            line[f"{name}_seconds"] = max(own, 0.0) / len(steps)
        values.append(line | {"swing": np.ptp(steps["tip_uy"]) / 2})
    found |= {name: solved[0].data[name] for name in ("unknowns", "triangles")} | {"step": size.step}
    return found | {str(name): value for name, value in pd.DataFrame(values).median().items()}


COLUMNS = (
    *columns("case = title | unknowns | solver = word | s per step, median = median | mean | bound :.2f"),
    Column(f"ratio (> {RATIO_BOUND:g})", "ratio", "{:.1f}", least=RATIO_BOUND),
    *columns("iterations per step = iterations_per_step :.1f | rebuilds in 100 steps = rebuilds_per_100_steps :.1f"),
    *(Column(f"{WORDS.get(name, name)} s", f"{name}_seconds", "{:.3f}") for name in SOLVER),
    Column("u_y ± m", "swing", "{:.3g}"),
)


def step_table(rows: Sequence[Mapping[str, Any]], sizes: Sequence[Size] = SIZES) -> TextTable:
    """Return one row per mesh and solver; `!` marks what misses its bound."""
    by_name = {size.name: size for size in sizes}
    lines = []
    for item in rows:
        size, word = by_name[item["mesh"]], WORD[item["solver"]]
        bound = size.bound if item["solver"] == "condensed" else math.inf
        cells = {name: Column("", f"{name}_seconds", "{:.3f}", bound).cell(item) for name in ("median", "mean")}
        bounded = {} if math.isinf(bound) else {"bound": bound}
        lines.append({**item, "title": size.title, "word": word, **bounded, **cells})
    return table(lines, COLUMNS, title="Seconds per time step")


# Error against the time step: the beam swinging under gravity (CSM3) over its first period ----------------------------

BEAM = "turek-csm3"
LEVEL, END = 0, 1.0  # s; a little more than a period
TIME_STEPS = (0.04, 0.02, 0.01, 0.005, 0.0025)  # s
FINEST = 0.0003125  # s, what the others are compared with
ERROR_COLUMNS = (
    *columns("dt s = step :g | steps | seconds :.1f | per step = seconds_per_step :.3f"),
    Column("error of u_y", lambda row: unsigned(row["error"])),
    Column("order", "order", "{:.2f}"),
)


def run_time_steps(runs: Path) -> list[Run]:
    """Run every time step, the finest one last, or find the runs that an earlier call has finished."""
    settings = (f"mesh.level={LEVEL}", f"time.end={END!r}", "time.stop=end", *PLAIN)
    scenes = {step: load_scene(BEAM, [*settings, f"time.step={step!r}"]) for step in (*TIME_STEPS, FINEST)}
    return run_all({f"{BEAM}-step-{step:g}": scene for step, scene in scenes.items()}, runs)


def error_rows(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return of every time step but the finest the largest error of u_y over its largest value, and the order."""
    *coarse, finest = runs
    found: list[dict[str, Any]] = []
    before = math.nan
    for step, item in zip(TIME_STEPS, coarse, strict=True):
        (times, values), (other, exact) = (run.history[["time", "tip_uy"]].to_numpy(float).T for run in (item, finest))
        at = np.abs(other[:, None] - times[None, :]).argmin(axis=0)
        error = math.nan
        if not (item.failure or finest.failure):
            error = float(np.abs(values - exact[at]).max() / np.abs(exact).max())
        costs = {name: item.steps[name] for name in ("steps", "seconds", "seconds_per_step")}
        found.append({"case": BEAM, "step": step, **costs, "error": error, "order": math.log2(before / error)})
        before = error
    return found


def main(
    *, repeat: int = 1, out: Place = None, readme: Place = None, runs: Path = RUNS, sizes: Sequence[Size] = SIZES
) -> list[str]:
    """Run each case to its developed motion, and print what steps cost from there; then errors over time steps."""
    study = Study(repeated("bench --unsteady", repeat), out, readme, "bench-unsteady")
    rows: list[dict[str, Any]] = []
    done: list[Run] = []
    for size in sizes:
        (source,) = run_all({f"{size.name}-developed": size.scene(size.developed)}, runs)
        done.append(source)
        if source.failure:
            continue
        pair = []
        for step, times in (("condensed", repeat), ("newton", 1)):
            start, *own = [
                measure(size, step, STEPS[step] if i else 0, runs / source.name, runs / f"{size.name}-{step}-{i}")
                for i in range(times + 1)
            ]
            done += [start, *own]
            pair.append(row(size, step, own, start))
        if all("mean_seconds" in item for item in pair):
            pair[0]["ratio"] = pair[1]["mean_seconds"] / pair[0]["mean_seconds"]
        rows += pair
    refined = run_time_steps(runs)
    done += refined
    errors = error_rows(refined)
    costs, error_table = step_table(rows, sizes), table(errors, ERROR_COLUMNS, left=0, title=BEAM)
    files = {"bench-unsteady.csv": lambda: pd.DataFrame(rows), "bench-time-steps.csv": lambda: pd.DataFrame(errors)}
    return study.finish(
        [item.data for item in done], [costs, error_table], files,
        costs=costs, errors=error_table, steps=STEPS, beam=BEAM, level=LEVEL, end=END, finest=FINEST,
    )  # fmt: skip
