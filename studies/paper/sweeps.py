"""The paper's three cases, each a sweep, and sweeps to compare them with; their figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result, load_result
from ffsi.report import curves
from ffsi.result import pictures
from ffsi.run import sweep
from ffsi.scene import Scene, load_scene
from studies.harness import side_by_side
from studies.runs import multiples

OUT, RUNS = Path("results/paper"), Path("runs/paper")
LEVEL = 2
MEAN_VELOCITY = "inflow.mean_velocity"
NOT_REACHED = "not-reached"
LOCAL = ("seconds", "folder", "point")  # columns that differ from machine to machine or name a folder
FIELDS = ("velocity", "pressure")
PANELS: dict[str, tuple[curves.Panel, ...]] = {
    "displacement": (
        ("Flap, middle of the tip", "$u_x$ (m)", {"tip_ux": "$u_x$"}),
        ("Flap, middle of the tip", "$u_y$ (m)", {"tip_uy": "$u_y$"}),
        ("Roof, middle of the wet side", "$u_x$ (m)", {"roof_ux": "$u_x$"}),
        ("Roof, middle of the wet side", "$u_y$ (m)", {"roof_uy": "$u_y$"}),
    ),
    "forces": (
        ("Drag on the flap", "force per depth (N/m)", {"drag": "drag"}),
        ("Lift on the flap", "force per depth (N/m)", {"lift": "lift"}),
    ),
}


class Curve(NamedTuple):
    """One sweep over the mean inflow velocity."""

    name: str  # name of its folder and of its table
    label: str  # name in the legends
    scene: str  # case of the catalogue
    velocities: tuple[float, ...]  # mean inflow velocities in m/s, in the order of the continuation
    settings: tuple[str, ...] = ()  # what differs from the catalogue's case, as KEY=VALUE


class PaperCase(NamedTuple):
    """One of the paper's cases."""

    number: int  # 1 to 3; section 5.1 to 5.3
    title: str  # materials of flap and roof
    curve: Curve  # its sweep
    comparisons: tuple[Curve, ...] = ()  # sweeps that are drawn beside it in the curves

    @property
    def curves(self) -> tuple[Curve, ...]:
        """The case's own sweep, then the comparisons."""
        return (self.curve, *self.comparisons)

    @property
    def figures(self) -> dict[str, int]:
        """The paper's number of each figure: velocity, pressure, displacement and forces."""
        first = 3 * self.number
        return {"velocity": first, "pressure": first + 1, "displacement": first + 2, "forces": 11 + self.number}

    def file(self, kind: str) -> str:
        """Return the name of a figure's file, such as `figure-03-velocity.png`."""
        return f"figure-{self.figures[kind]:02d}-{kind}.png"


# The paper's step is 0.0055 m/s in cases 2 and 3, its pictures belong to 0.12 m/s.
SLOW = (*multiples(0.0055, 10), 0.06, 0.07, 0.08, 0.09, 0.1, 0.11, 0.12)
STEPS = multiples(0.012, 10)
FAST = (*STEPS, 0.14, 0.16, 0.18, 0.2)
_STIFF = ("solid.flap.bulk_modulus=1.75e4",)
CASES = (
    PaperCase(
        1,
        "St. Venant-Kirchhoff flap, rigid walls",
        Curve("case-1", "root size 0.01 m", "flap-svk", STEPS),
        # The flap collapses at its root corner, the earlier the finer the mesh is there.
        (
            Curve("svk-root-0.005", "root size 0.005 m", "flap-svk", STEPS, ("mesh.root_size=0.005",)),
            Curve("svk-root-0.0025", "root size 0.0025 m", "flap-svk", STEPS, ("mesh.root_size=0.0025",)),
        ),
    ),
    PaperCase(
        2,
        "neo-Hookean flap, St. Venant-Kirchhoff roof",
        Curve("case-2", "elastic roof", "flap-neo-hookean-roof", SLOW),
        (Curve("neo-hookean-rigid-roof", "rigid roof", "flap-neo-hookean", FAST),),
    ),
    PaperCase(
        3,
        "Mooney-Rivlin flap, St. Venant-Kirchhoff roof",
        Curve("case-3", "elastic roof, K = 5.6 Pa", "flap-mooney-rivlin-roof", SLOW),
        (
            Curve("mooney-rivlin-rigid-roof", "rigid roof, K = 5.6 Pa", "flap-mooney-rivlin", SLOW),
            Curve(
                "mooney-rivlin-rigid-roof-stiff-bulk", "rigid roof, K = 17500 Pa", "flap-mooney-rivlin", SLOW, _STIFF
            ),
        ),
    ),
)


def all_curves(cases: Iterable[PaperCase]) -> list[Curve]:
    """Return the sweeps of the cases, each once."""
    return list(dict.fromkeys(curve for case in cases for curve in case.curves))


@dataclass(frozen=True)
class Outcome:
    """A sweep that was run."""

    curve: Curve  # what was asked for
    scene: Scene  # the scene of every point but for the mean velocity
    directory: Path  # the sweep's folder
    table: pd.DataFrame  # one row per point, as `ffsi.sweep` returns it

    @cached_property
    def solved(self) -> pd.DataFrame:
        """The rows of the points that were solved, the highest mean velocity last."""
        return self.table[self.table["failure"] == ""].sort_values(MEAN_VELOCITY)

    @property
    def published(self) -> pd.DataFrame:
        """The table without what belongs to one machine.

        Of what a failed point has reached only min J stays, which tells why it failed.
        """
        names = [str(name) for name in self.table if name not in LOCAL]
        return self.table[[name for name in names if "reached_" not in name or name.startswith("reached_min_jacobian")]]

    @property
    def end(self) -> tuple[float, str] | None:
        """Mean velocity (m/s) at which the sweep ended before its last point, and the program's reason."""
        failed = self.table[~self.table["failure"].isin(("", NOT_REACHED))]
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


Outcomes = Mapping[Curve, Outcome]


def load_scenes(curves: Iterable[Curve], level: int) -> dict[Curve, Scene]:
    """Return the scene of each sweep on the given mesh level, without the pictures of a run, drawn here otherwise."""
    common = (f"mesh.level={level}", "output.pictures=false")
    return {curve: load_scene(curve.scene, [*curve.settings, *common]) for curve in curves}


def run_sweeps(scenes: Mapping[Curve, Scene], runs: Path, jobs: int = 1) -> dict[Curve, Outcome]:
    """Run the sweeps, or what is missing of them, in folders `level-N/NAME`."""

    def run(curve: Curve, on_event: OnEvent) -> Outcome:
        scene = scenes[curve]
        directory = runs / f"level-{scene.mesh.level}" / curve.name
        table = sweep.sweep(scene, {MEAN_VELOCITY: curve.velocities}, directory, on_event=on_event)
        return Outcome(curve, scene, directory, table)

    points = sum(len(curve.velocities) for curve in scenes)
    return side_by_side({curve: partial(run, curve) for curve in scenes}, jobs, "paper", points)


def draw(case: PaperCase, outcomes: Outcomes) -> dict[str, Figure]:
    """Return a case's figures by kind: `velocity`, `pressure`, `displacement`, `forces`; those without values miss."""
    found: dict[str, Figure] = {}
    outcome = outcomes[case.curve]
    if outcome.highest is not None:
        title = f"Case {case.number}: {case.title}, mean inflow velocity {outcome.highest_velocity:g} m/s"
        found = {kind: pictures.draw(kind, outcome.highest.fields, title) for kind in FIELDS}
    tables = {curve.label: outcomes[curve].table for curve in case.curves}
    for kind, panels in PANELS.items():
        figure = curves.compare_sweeps(tables, MEAN_VELOCITY, panels)
        if figure is not None:
            found[kind] = figure
    return found
