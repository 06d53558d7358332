"""`python -m studies paper`: three cases, each a sweep, sweeps beside them, and `paper.md` with tables and figures."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from ffsi.cli import show
from ffsi.files import folder
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result, load_result
from ffsi.report import curves, formulas
from ffsi.result import pictures
from ffsi.result.pictures import to_small_png
from ffsi.run import sweep
from ffsi.scene import Newtonian, Scene, load_scene
from ffsi.scene.geometry import FlapChannel
from studies.harness import Study, multiples, origin, side_by_side
from studies.tables import NOTHING, Column, TextTable, columns, document, number, table

OUT, RUNS = Path("results/paper"), Path("runs/paper")
LEVEL = 2
MEAN_VELOCITY = "inflow.mean_velocity"
K = TypeVar("K")
NOT_REACHED = "not-reached"
LOCAL = ("seconds", "folder", "point")  # columns that differ from machine to machine or name a folder
FIELDS = ("velocity", "pressure")
_PLACES = {"tip": "Flap, middle of the tip", "roof": "Roof, middle of the wet side"}
PANELS: dict[str, tuple[curves.Panel, ...]] = {
    "displacement": tuple(
        (place, f"$u_{x}$ (m)", {f"{name}_u{x}": f"$u_{x}$"}) for name, place in _PLACES.items() for x in "xy"
    ),
    "forces": tuple((f"{x.title()} on the flap", "force per depth (N/m)", {x: x}) for x in ("drag", "lift")),
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
    PaperCase(1, "St. Venant-Kirchhoff flap, rigid walls", Curve("case-1", "root size 0.01 m", "flap-svk", STEPS), (
        # The flap collapses at its root corner, the earlier the finer the mesh is there.
        Curve("svk-root-0.005", "root size 0.005 m", "flap-svk", STEPS, ("mesh.root_size=0.005",)),
        Curve("svk-root-0.0025", "root size 0.0025 m", "flap-svk", STEPS, ("mesh.root_size=0.0025",)),
    )),
    PaperCase(2, "neo-Hookean flap, St. Venant-Kirchhoff roof",
        Curve("case-2", "elastic roof", "flap-neo-hookean-roof", SLOW),
        (Curve("neo-hookean-rigid-roof", "rigid roof", "flap-neo-hookean", FAST),)),
    PaperCase(3, "Mooney-Rivlin flap, St. Venant-Kirchhoff roof",
        Curve("case-3", "elastic roof, K = 5.6 Pa", "flap-mooney-rivlin-roof", SLOW), (
        Curve("mooney-rivlin-rigid-roof", "rigid roof, K = 5.6 Pa", "flap-mooney-rivlin", SLOW),
        Curve("mooney-rivlin-rigid-roof-stiff-bulk", "rigid roof, K = 17500 Pa", "flap-mooney-rivlin", SLOW, _STIFF),
    )),
)  # fmt: skip


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
        """The table without what belongs to one machine; of what a failed point has reached min J, which tells why."""
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
    def skipped(self) -> int:
        """How many points behind the end were not tried."""
        return int((self.table["failure"] == NOT_REACHED).sum())

    @property
    def failures(self) -> list[str]:
        """What went wrong, as `Result.failure`; where a sweep ends is a finding, unless no point at all was solved."""
        found = [str(failure) for failure in self.table["failure"]]
        return found if self.solved.empty else [name for name in found if name in ("check", "crash")]


Outcomes = Mapping[Curve, Outcome]


def load_scenes(cases: Iterable[PaperCase], level: int) -> dict[Curve, Scene]:
    """Return the scene of each sweep on the given mesh level, without the pictures of a run, drawn here otherwise."""
    common = (f"mesh.level={level}", "output.pictures=false")
    curves = (curve for case in cases for curve in case.curves)
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


COLUMNS = columns(
    f"v_mean (m/s) = {MEAN_VELOCITY} :g | drag (N/m) = drag :.5g | lift (N/m) = lift :.5g | "
    "C_D = drag_coefficient :.5g | C_L = lift_coefficient :.5g | tip_ux (m) = tip_ux :.5g | tip_uy (m) = tip_uy :.5g | "
    "roof_ux (m) = roof_ux :.5g | roof_uy (m) = roof_uy :.5g | min_jacobian :.4f | "
    "before the failure = reached_min_jacobian :.4f | check = check_maximum :.0e"
)


def main(
    *, level: int = LEVEL, jobs: int = 1, out: Path = OUT, runs: Path = RUNS, cases: Sequence[PaperCase] = CASES
) -> list[str]:
    """Compute the paper's cases and write CSV, PNG and `paper.md`; a second call resumes the sweeps."""
    scenes = load_scenes(cases, level)
    Study("paper", out)
    outcomes = run_sweeps(scenes, runs, jobs)
    overview(cases, outcomes).print()
    names = []
    for curve, outcome in outcomes.items():
        if outcome.end is not None:
            show.note(f"{curve.name} ended at {outcome.end[0]:g} m/s: {outcome.end[1]}")
        points = outcome.published
        if "check_maximum" in points:  # rounding error: two digits
            points["check_maximum"] = [f"{x:.1e}" if pd.notna(x) else "" for x in points["check_maximum"]]
        folder.write_text(out / f"{curve.name}.csv", points.to_csv(index=False, float_format="%.8g"))
    for case in cases:
        for kind, figure in draw(case, outcomes).items():
            names.append(case.file(kind))
            (out / names[-1]).write_bytes(to_small_png(figure))
    folder.write_text(out / "paper.md", text_of(cases, outcomes, names))
    show.note(f"wrote {out / 'paper.md'}, its tables and figures")
    return [failure for outcome in outcomes.values() for failure in outcome.failures]


def text_of(cases: Sequence[PaperCase], outcomes: Outcomes, pictures: Collection[str]) -> str:
    """Return `paper.md`; `pictures` are the names of the figures that were written beside it."""
    last = [outcome.highest.data for outcome in outcomes.values() if outcome.highest is not None]
    levels = sorted({outcome.scene.mesh.level for outcome in outcomes.values()})
    own = {case.number: outcomes[case.curve] for case in cases}
    found = _by_cases({number: _open(outcome.scene) for number, outcome in own.items()})
    rows = [(name, ", ".join(map(str, numbers)), value) for (name, value), numbers in found.items()]
    return document(
        "paper", cases=cases, outcomes=outcomes, pictures=pictures, fields=FIELDS, overview=overview(cases, outcomes),
        written=origin("python -m studies paper", last[:1], f", mesh level {' and '.join(map(str, levels))}"),
        tables={curve: point_table(outcome) for curve, outcome in outcomes.items()},
        numbers={number: numbers_of(outcome, outcomes.get(CASES[2].curve)) for number, outcome in own.items()},
        solid_remarks={n: formulas.solid_remark(x.highest) if x.highest else "" for n, x in own.items()},
        remarks=_by_cases({number: formulas.remarks(outcome.scene) for number, outcome in own.items()}),
        values=TextTable(("value", "cases", "used"), rows, left=3),
    ) + "\n"  # fmt: skip


def _by_cases(found: Mapping[int, Iterable[K]]) -> dict[K, list[int]]:
    """Return what is true of cases, by their numbers, with the numbers of those of which it is."""
    numbers: dict[K, list[int]] = {}
    for case, items in found.items():
        for item in items:
            numbers.setdefault(item, []).append(case)
    return numbers


def overview(cases: Sequence[PaperCase], outcomes: Outcomes) -> TextTable:
    """Return one row per sweep: mesh, how many points were solved, the highest velocity, and where it ended."""
    names = {case.curve: f"case {case.number}" for case in cases}
    rows = [
        (
            names.get(curve, "comparison"),
            ", ".join([curve.scene, *curve.settings]),
            NOTHING if outcome.highest is None else str(outcome.highest.data["unknowns"]),
            f"{len(outcome.solved)} of {len(outcome.table)}",
            number(outcome.highest_velocity, "{:g}"),
            NOTHING if outcome.end is None else f"{outcome.end[0]:g}",
        )
        for curve, outcome in outcomes.items()
    ]
    head = ("sweep", "scene", "unknowns", "points solved", "highest v_mean (m/s)", "failed at (m/s)")
    return TextTable(head, rows, left=2, title="Sweeps over the mean inflow velocity")


def point_table(outcome: Outcome) -> TextTable:
    """Return one row per point of a sweep."""
    points = outcome.published
    shown = [column for column in COLUMNS if column.of in points and points[column.of].notna().any()]
    failures = [f" ({failure})" if failure else "" for failure in points["failure"]]
    rows = points.assign(status=points["status"] + failures).to_dict("records")
    return table(rows, [*shown, Column("status", "status")], left=0)


def _open(scene: Scene) -> list[tuple[str, str]]:
    geometry, fluid = scene.geometry, scene.fluid
    assert isinstance(geometry, FlapChannel) and isinstance(fluid, Newtonian) and scene.forces is not None
    found = [
        ("left side of the flap", f"x = {geometry.flap_left:g} m"),
        ("density of the fluid", f"{fluid.density:g} kg/m³, the density of Table 1"),
        ("dynamic viscosity", f"{fluid.viscosity:g} Pa s"),
        ("length L in C_D and C_L", f"{scene.forces.reference_length:g} m, the flap's height"),
    ]
    if scene.mesh.root_size is not None:
        found.append(("element size at the flap's root corners", f"{scene.mesh.root_size:g} m"))
    if geometry.roof is not None:
        strip = f"[0, {geometry.length:g}] x [{geometry.height:g}, {geometry.height + geometry.roof.thickness:g}] m"
        found.append(("elastic roof", f"the strip {strip}, clamped at its two ends, its upper side free"))
    return found


def numbers_of(outcome: Outcome, stiff: Outcome | None) -> dict[str, Any]:
    """Return what the paper's statements are compared with, of its case 2 also the roof over the stiff flap of case 3.

    `sizes`: of the tip's way (m) by velocity; `rise` of the roof (m); nothing if no point was solved.
    """
    rows, geometry = outcome.solved, outcome.scene.geometry
    assert isinstance(geometry, FlapChannel)
    if rows.empty:
        return {}
    ux, uy = rows["tip_ux"], rows.get("tip_uy", 0.0 * rows["tip_ux"])
    sizes = np.hypot(ux, uy).tolist()
    first, last = (f"{rows[MEAN_VELOCITY].iloc[i]:g} m/s" for i in (0, -1))
    found = {"first": first, "last": last, "sizes": sizes, "grows": bool((np.diff(sizes) > 0).all())}
    found |= {"height": geometry.flap_height, "channel": geometry.height, "ratio": abs(uy.iloc[-1] / ux.iloc[-1])}
    if "roof_uy" in rows:
        found["rise"] = rows["roof_uy"].iloc[-1]
    if stiff is not None and {"roof_uy"} <= set(rows) & set(stiff.solved):
        # At the highest velocity that both sweeps have reached.
        both = pd.merge(rows, stiff.solved, on=MEAN_VELOCITY, suffixes=("", "_stiff")).sort_values(MEAN_VELOCITY)
        for row in both.tail(1).to_dict("records"):
            found["both"] = dict(velocity=row[MEAN_VELOCITY], soft=row["roof_uy"], stiff=row["roof_uy_stiff"])
    return found
