"""The sweeps behind the figures: run or resume them, and what became of each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import pandas as pd

from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result, load_result
from ffsi.run import sweep
from ffsi.scene import Scene, load_scene
from studies.harness import side_by_side
from studies.paper.cases import MEAN_VELOCITY, Curve

SOLVED = ("",)  # failures of points with values
NOT_REACHED = "not-reached"
LOCAL = ("seconds", "folder", "point")  # columns that differ from machine to machine or name a folder
DEFINING = (MEAN_VELOCITY, "status", "checked", "reason", "failure")


@dataclass(frozen=True)
class Outcome:
    """A sweep that was run.

    Attributes:
        curve: what was asked for.
        scene: the scene of every point but for the mean velocity.
        directory: the sweep's folder.
        table: one row per point, as `ffsi.sweep` returns it.
    """

    curve: Curve
    scene: Scene
    directory: Path
    table: pd.DataFrame

    @cached_property
    def solved(self) -> pd.DataFrame:
        """The rows of the points that were solved, the highest mean velocity last."""
        return self.table[self.table["failure"].isin(SOLVED)].sort_values(MEAN_VELOCITY)

    @property
    def published(self) -> pd.DataFrame:
        """The table without what belongs to one machine.

        Of what a failed point has reached only min J stays, which tells why it failed.
        """
        names = [str(name) for name in self.table if name not in LOCAL]
        reached = "reached_"
        return self.table[[name for name in names if reached not in name or name.startswith(f"{reached}min_jacobian")]]

    @property
    def end(self) -> tuple[float, str] | None:
        """Mean velocity (m/s) at which the sweep ended before its last point, and the program's reason."""
        failed = self.table[~self.table["failure"].isin((*SOLVED, NOT_REACHED))]
        return None if failed.empty else (float(failed[MEAN_VELOCITY].iloc[0]), str(failed["reason"].iloc[0]))

    @property
    def highest_velocity(self) -> float | None:
        """The highest mean velocity that was solved, m/s; None if no point was."""
        return None if self.solved.empty else float(self.solved[MEAN_VELOCITY].iloc[-1])

    @cached_property
    def highest(self) -> Result | None:
        """The solved point of the highest mean velocity; None if no point was solved."""
        if self.solved.empty:
            return None
        row = self.solved.iloc[-1]
        return load_result(self.directory / str(row["folder"]), int(row["point"]))

    @property
    def failures(self) -> list[str]:
        """What went wrong, as `Result.failure`.

        Where a sweep ends is a finding and no failure, unless no point at all was solved.
        """
        found = [str(failure) for failure in self.table["failure"]]
        return found if self.solved.empty else [name for name in found if name in ("check", "crash")]


def load_scenes(curves: Iterable[Curve], level: int) -> dict[Curve, Scene]:
    """Return the scene of each sweep on the given mesh level, without the pictures of a run, drawn here otherwise.

    Raises:
        SceneError: a case, a setting or the level is not valid.
    """
    common = (f"mesh.level={level}", "output.pictures=false")
    return {curve: load_scene(curve.scene, [*curve.settings, *common]) for curve in curves}


def run_sweeps(scenes: Mapping[Curve, Scene], runs: Path, jobs: int = 1) -> dict[Curve, Outcome]:
    """Run the sweeps, or what is missing of them.

    Args:
        scenes: the sweeps, as of `load_scenes`.
        runs: where their folders are, `level-N/NAME`.
        jobs: sweeps at a time.

    Raises:
        InputError: a folder holds a sweep with another definition.
        FreeFEMNotFound: no FreeFEM on this machine.
    """

    def run(curve: Curve, on_event: OnEvent) -> Outcome:
        scene = scenes[curve]
        directory = runs / f"level-{scene.mesh.level}" / curve.name
        table = sweep.sweep(scene, {MEAN_VELOCITY: curve.velocities}, directory, on_event=on_event)
        return Outcome(curve, scene, directory, table)

    points = sum(len(curve.velocities) for curve in scenes)
    return side_by_side({curve: partial(run, curve) for curve in scenes}, jobs, "paper", points)
