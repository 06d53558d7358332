"""How far each mesh motion carries the sweep of the flap over the inflow velocity, and at what cost."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from ffsi.cli import show
from ffsi.report.curves import FAILURE, LINES, dress
from ffsi.report.tables import label
from ffsi.result.pictures import to_small_png
from ffsi.result.views import INK
from ffsi.run.chain import run_chain
from ffsi.scene import load_scene
from studies.harness import Study, multiples
from studies.tables import Column, TextTable, columns, number, table

VELOCITY = "inflow.mean_velocity"
COMMON = 0.12  # mean velocity at which mesh motions are compared, m/s
LEVEL = 1


class Motion(NamedTuple):
    """A mesh motion: its name in the tables, and the values of `MeshMotion`."""

    name: str
    kind: str
    stiffness_exponent: float
    distance_exponent: float
    divergence_weight: float

    @property
    def settings(self) -> list[str]:
        """The values as KEY=VALUE of a scene."""
        return [f"mesh_motion.{key}={value}" for key, value in self._asdict().items() if key != "name"]


class Sweep(NamedTuple):
    """A case of the catalogue, solved for one mean velocity (m/s) after the other."""

    case: str
    title: str
    velocities: tuple[float, ...]


COLOURS = {"harmonic": LINES[0], "linear-elastic": LINES[2], "hyperelastic": LINES[1]}
STYLES = ((("o", ":"), ("s", "-")), (("D", "-."), ("^", "--")))  # marker and line, by distance and by size
MOTIONS = (
    Motion("harmonic, constant", "harmonic", 0, 0, 0),
    Motion("harmonic, size", "harmonic", 1, 0, 1),
    Motion("harmonic, size and distance", "harmonic", 1, 1, 1),
    Motion("harmonic, distance", "harmonic", 0, 2, 0),
    Motion("linear-elastic, size", "linear-elastic", 1, 0, 1),
    Motion("linear-elastic, size and distance", "linear-elastic", 1, 1, 1),
    Motion("hyperelastic, size", "hyperelastic", 1, 0, 5),
    Motion("hyperelastic, constant", "hyperelastic", 0, 0, 5),
)
SWEEPS = (
    Sweep("flap-neo-hookean", "rigid roof", multiples(0.02, 15)),
    Sweep("flap-neo-hookean-roof", "elastic roof", multiples(0.01, 12)),
)


@dataclass(frozen=True)
class Track:
    """What one mesh motion made of a sweep."""

    sweep: Sweep  # what was to be solved
    motion: Motion  # the mesh motion
    points: Sequence[Mapping[str, Any]]  # the content of `result.json` of each point, the one that was not solved last

    @property
    def solved(self) -> dict[float, Mapping[str, Any]]:
        """The result of each point that Newton's method solved by its mean velocity, whatever the checker says."""
        pairs = zip(self.sweep.velocities, self.points, strict=False)
        return {velocity: data for velocity, data in pairs if data["failure"] in ("", "check")}

    @property
    def end(self) -> tuple[float, str] | None:
        """Mean velocity (m/s) at which the sweep ended before its last point, and the program's reason."""
        at = len(self.solved)
        return None if at >= len(self.points) else (self.sweep.velocities[at], str(self.points[at]["reason"]))

    @property
    def row(self) -> dict[str, Any]:
        """The line of the tables; what is not known is missing."""
        common = self.solved.get(COMMON, {})
        last = list(self.solved.values())[-1] if self.solved else {}
        complete = "≥ " if len(self.solved) == len(self.sweep.velocities) else ""
        return {
            "roof": self.sweep.title.removesuffix(" roof"),
            **self.motion._asdict(),
            "reaches": complete + number(max(self.solved, default=None), "{:g}"),
            "min_jacobian_last": _jacobian(last),
            "min_jacobian": _jacobian(common),
            "tip_ux": common.get("quantities", {}).get("tip_ux"),
            "seconds": common.get("timings", {}).get("script"),
            **{name: common.get("newton", {}).get(name) for name in ("iterations", "factorizations")},
            **{name: last.get("timings", {}).get(name) for name in ("one_factorization", "one_jacobian")},
            "ended": self.end and self.end[1].partition(" (last good state")[0],  # evidence follows in brackets
        }


def _jacobian(data: Mapping[str, Any]) -> float | None:
    return (data.get("quantities") or {}).get("min_jacobian_fluid")


def run(sweep: Sweep, motion: Motion) -> Track:
    """Solve a sweep with a mesh motion, every point checked, with one thread and in a temporary folder."""
    scene = load_scene(sweep.case, [*motion.settings, f"mesh.level={LEVEL}"])
    values = [{VELOCITY: velocity} for velocity in sweep.velocities]
    with (
        show.progress(f"{sweep.case}, {motion.name}", len(values)) as on_event,
        tempfile.TemporaryDirectory(prefix=f"ffsi-{sweep.case}-") as directory,
    ):
        results = run_chain(scene, values, Path(directory) / "chain", draw="none", on_event=on_event)
    solved = next((number for number, result in enumerate(results) if not result.solved), len(results))
    return Track(sweep, motion, [result.data for result in results[: solved + 1]])


COLUMNS = columns(
    "roof | mesh motion, stiffness = name | m = stiffness_exponent :g | n = distance_exponent :g | "
    f"β = divergence_weight :g | reaches m/s = reaches | min J there = min_jacobian_last :.3f | min J at {COMMON:g} = "
    "min_jacobian :.3f | tip u_x = tip_ux :.5f | seconds :.1f | iterations | factorisations = factorizations | "
    "one factorisation s = one_factorization :.3f | one Jacobian s = one_jacobian :.3f"
)
ENDED = Column("ended by", "ended")


def motion_table(tracks: Sequence[Track], *more: Column) -> TextTable:
    """Return one row per sweep and mesh motion."""
    title = "Mesh motions: how far they carry the flap"
    return table((track.row for track in tracks), (*COLUMNS, *more), left=2, title=title)


def frame(tracks: Sequence[Track]) -> pd.DataFrame:
    """Return one row per computed point; counts and script seconds are those of the sweep so far."""
    jacobians = ("min_jacobian_fluid", "min_jacobian_solid")
    quantities = (*jacobians, "drag", "lift", "tip_ux", "tip_uy")
    timings = ("script", "one_factorization", "one_jacobian", "one_residual", "one_solve")
    return pd.DataFrame([
        {
            "case": track.sweep.case,
            **{"motion" if key == "name" else key: value for key, value in track.motion._asdict().items()},
            "level": LEVEL,
            VELOCITY: velocity,
            **{name: data[name] for name in ("status", "reason", "unknowns")},
            **{name: (data.get("quantities") or {}).get(name) for name in quantities},
            # Of what a failed point has reached only min J stays, which tells why it failed.
            **{f"reached_{name}": (data.get("reached") or {}).get(name) for name in jacobians},
            **{name: data["newton"].get(name) for name in ("iterations", "factorizations")},
            **{f"{name}_seconds": data["timings"].get(name) for name in timings},
        }
        for track in tracks
        for velocity, data in zip(track.sweep.velocities, track.points, strict=False)
    ])  # fmt: skip


def draw(tracks: Sequence[Track]) -> Figure:
    """Draw min J of the fluid mesh over the mean velocity, one panel per sweep; a cross where a sweep failed."""
    sweeps = list(dict.fromkeys(track.sweep for track in tracks))
    figure = Figure(figsize=(10.5, 4.6), layout="constrained", facecolor="white")
    panels = list(figure.subplots(1, len(sweeps), sharey=True, squeeze=False)[0])
    for axes, sweep in zip(panels, sweeps, strict=True):
        for track in tracks:
            if track.sweep == sweep:
                _, kind, size, distance, _ = track.motion
                marker, line = STYLES[distance > 0][size > 0]
                values = [math.nan if (x := _jacobian(data)) is None else x for data in track.solved.values()]
                style = {"marker": marker, "linestyle": line, "markersize": 4.5, "linewidth": 1.5}
                axes.plot(list(track.solved), values, label=track.motion.name, color=COLOURS[kind], **style)
                if track.end is not None:
                    cross = {**FAILURE, "label": "_failed"}
                    axes.plot([track.end[0]], [0.0], color=COLOURS[kind], clip_on=False, zorder=4, **cross)
        axes.set(xlim=(0.0, None), ylim=(0.0, 1.0))
        dress(axes, f"{sweep.case}, {sweep.title}", label(VELOCITY), "")
    panels[0].set_ylabel("min J of the fluid mesh; a cross: not converged", color=INK)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9, labelcolor=INK)
    return figure


def main(*, out: Path | None = None) -> list[str]:
    """Run both sweeps with every mesh motion; where one ends is no failure, unless none solved any point of it."""
    study = Study("bench --mesh-motion", out, name="mesh-motion")
    tracks = [run(sweep, motion) for sweep in SWEEPS for motion in MOTIONS]
    ends = [
        f"{track.sweep.title}, {track.motion.name}: failed at {track.end[0]:g} m/s: {track.end[1]}"
        for track in tracks
        if track.end is not None
    ]
    for line in ends:
        show.note(line)
    sizes = {track.sweep.title: track.points[0]["unknowns"] for track in tracks if track.points}
    study.finish(
        [data for track in tracks for data in track.points], [motion_table(tracks)],
        {"mesh-motion.csv": lambda: frame(tracks), "mesh-motion.png": lambda: to_small_png(draw(tracks))}, "%.6g",
        table=motion_table(tracks, ENDED), ends=ends, level=LEVEL, common=f"{COMMON:g}",
        sizes=", ".join(f"{size} unknowns ({title})" for title, size in sizes.items()),
    )  # fmt: skip
    failures = [data["failure"] for track in tracks for data in track.points if data["failure"] in ("check", "crash")]
    for sweep in SWEEPS:
        failures += [] if any(track.solved for track in tracks if track.sweep == sweep) else ["not-converged"]
    return failures
