"""How far each mesh motion carries the sweep of the flap over the inflow velocity, and at what cost."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from ffsi.cli import show
from ffsi.freefem.events import OnEvent
from ffsi.report.curves import FAILURE, LINES
from ffsi.report.tables import label
from ffsi.result.pictures import FAINT, INK, to_small_png
from ffsi.run.chain import run_chain
from ffsi.scene import load_scene
from studies.harness import Study
from studies.measurement import Measurement
from studies.tables import NOTHING, TextTable, number

BLOCK = "mesh-motion"
CSV, MARKDOWN, PICTURE = "mesh-motion.csv", "mesh-motion.md", "mesh-motion.png"
VELOCITY = "inflow.mean_velocity"
COMMON = 0.12  # mean velocity at which mesh motions are compared, m/s
LEVEL = 1


@dataclass(frozen=True)
class Motion:
    """A mesh motion: its name in the tables, and the values of `MeshMotion`."""

    name: str
    kind: str
    stiffness_exponent: float
    distance_exponent: float
    divergence_weight: float

    @property
    def settings(self) -> list[str]:
        """The values as KEY=VALUE of a scene."""
        return [f"mesh_motion.{key}={value}" for key, value in asdict(self).items() if key != "name"]


@dataclass(frozen=True)
class Sweep:
    """A case of the catalogue, solved for one mean velocity (m/s) after the other."""

    case: str
    title: str
    velocities: tuple[float, ...]


def steps(size: float, count: int) -> tuple[float, ...]:
    """Return size, 2 size, ..., count size, without rounding errors."""
    return tuple(round(k * size, 10) for k in range(1, count + 1))


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
    Sweep("flap-neo-hookean", "rigid roof", steps(0.02, 15)),
    Sweep("flap-neo-hookean-roof", "elastic roof", steps(0.01, 12)),
)
EXPLANATION = (
    "Each mesh motion carries the neo-Hookean flap from one mean inflow velocity to the next (rigid roof: steps of "
    "0.02 m/s up to 0.3 m/s; elastic roof: 0.01 m/s up to 0.12 m/s) until a point does not converge. *Stiffness*: what "
    "alpha grows with, small area (m) and small distance from the interface (n). *Reaches*: the last converged point; "
    "≥: the sweep's last one. min J: smallest det F in the fluid mesh, there and at "
    f"{COMMON:g} m/s. Tip u_x (m) at {COMMON:g} m/s: a distorted mesh changes the result. Seconds, Newton iterations "
    f"and factorisations are those of all points up to {COMMON:g} m/s (seconds: the script's processor time, coarser "
    "meshes included); one factorisation and one Jacobian are medians over the sweep."
)


@dataclass(frozen=True)
class Track:
    """What one mesh motion made of a sweep.

    Attributes:
        sweep: what was to be solved.
        motion: the mesh motion.
        level: mesh level.
        points: the content of `result.json` of each point, the one that was not solved last.
    """

    sweep: Sweep
    motion: Motion
    level: int
    points: tuple[Mapping[str, Any], ...]

    @property
    def solved(self) -> list[tuple[float, Mapping[str, Any]]]:
        """Mean velocity and result of each point that Newton's method solved, whatever the checker says."""
        pairs = zip(self.sweep.velocities, self.points, strict=False)
        return [(velocity, data) for velocity, data in pairs if data["failure"] in ("", "check")]

    @property
    def reaches(self) -> float | None:
        """The last mean velocity that was solved, m/s; None if none was."""
        return self.solved[-1][0] if self.solved else None

    @property
    def complete(self) -> bool:
        """Whether every point was solved."""
        return len(self.solved) == len(self.sweep.velocities)

    @property
    def end(self) -> tuple[float, str] | None:
        """Mean velocity (m/s) at which the sweep ended before its last point, and the program's reason."""
        at = len(self.solved)
        if self.complete or at >= len(self.points):
            return None
        return self.sweep.velocities[at], str(self.points[at]["reason"])

    def at(self, velocity: float) -> Mapping[str, Any]:
        """Return the result at a mean velocity; empty if that was not solved."""
        return dict(self.solved).get(velocity, {})

    def row(self) -> dict[str, Any]:
        """Return the line of the tables; what is not known is missing."""
        last = self.solved[-1][1] if self.solved else {}
        common = self.at(COMMON)
        found = {
            "reaches": self.reaches,
            "min_jacobian_last": _jacobian(last),
            "min_jacobian": _jacobian(common),
            "tip_ux": common.get("quantities", {}).get("tip_ux"),
            "seconds": common.get("timings", {}).get("script"),
            "iterations": common.get("newton", {}).get("iterations"),
            "factorizations": common.get("newton", {}).get("factorizations"),
            "one_factorization": last.get("timings", {}).get("one_factorization"),
            "one_jacobian": last.get("timings", {}).get("one_jacobian"),
        }
        return {key: value for key, value in found.items() if value is not None}

    @property
    def failures(self) -> list[str]:
        """What went wrong, as `Result.failure`; where a sweep ends is a finding and no failure."""
        return [str(data["failure"]) for data in self.points if data["failure"] in ("check", "crash")]


def _jacobian(data: Mapping[str, Any]) -> float | None:
    return (data.get("quantities") or {}).get("min_jacobian_fluid")


def run(sweep: Sweep, motion: Motion, level: int, on_event: OnEvent | None = None) -> Track:
    """Solve a sweep with a mesh motion, every point checked, with one thread and in a temporary folder.

    Raises:
        SceneError: the level is not valid.
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    scene = load_scene(sweep.case, [*motion.settings, f"mesh.level={level}"])
    values = [{VELOCITY: velocity} for velocity in sweep.velocities]
    with tempfile.TemporaryDirectory(prefix=f"ffsi-{sweep.case}-") as directory:
        results = run_chain(scene, values, Path(directory) / "chain", draw="none", on_event=on_event)
    solved = next((number for number, result in enumerate(results) if not result.solved), len(results))
    return Track(sweep, motion, level, tuple(result.data for result in results[: solved + 1]))


def table(tracks: Sequence[Track], *, reasons: bool = False) -> TextTable:
    """Return one row per sweep and mesh motion, on request with what ended it in short."""
    head = (
        "roof",
        "mesh motion, stiffness",
        "m",
        "n",
        "β",
        "reaches m/s",
        "min J there",
        f"min J at {COMMON:g}",
        "tip u_x",
    )
    costs = ("seconds", "iterations", "factorisations", "one factorisation s", "one Jacobian s")
    last = ("ended by",) if reasons else ()
    found = TextTable((*head, *costs, *last), left=2, title="Mesh motions: how far they carry the flap")
    for track in tracks:
        row, motion = track.row(), track.motion
        exponents = (motion.stiffness_exponent, motion.distance_exponent, motion.divergence_weight)
        found.add(
            track.sweep.title.removesuffix(" roof"),
            motion.name,
            *(f"{value:g}" for value in exponents),
            ("≥ " if track.complete else "") + number(row.get("reaches"), "{:g}"),
            *(number(row.get(name), "{:.3f}") for name in ("min_jacobian_last", "min_jacobian")),
            number(row.get("tip_ux"), "{:.5f}"),
            number(row.get("seconds"), "{:.1f}"),
            *(number(row.get(name), "{:d}") for name in ("iterations", "factorizations")),
            *(number(row.get(name), "{:.3f}") for name in ("one_factorization", "one_jacobian")),
            *((short(track.end[1]) if track.end else NOTHING) for _ in last),
        )
    return found


def short(reason: str) -> str:
    """Return a reason without the evidence that follows it in brackets."""
    return reason.partition(" (last good state")[0]


def ends(tracks: Sequence[Track]) -> list[str]:
    """Return one line for each sweep that ended early: where, and the program's reason."""
    return [
        f"{track.sweep.title}, {track.motion.name}: failed at {track.end[0]:g} m/s: {track.end[1]}"
        for track in tracks
        if track.end is not None
    ]


def frame(tracks: Sequence[Track]) -> pd.DataFrame:
    """Return one row per computed point; counts and script seconds are those of the sweep so far."""
    quantities = ("min_jacobian_fluid", "min_jacobian_solid", "drag", "lift", "tip_ux", "tip_uy")
    timings = ("script", "one_factorization", "one_jacobian", "one_residual", "one_solve")
    rows = []
    for track in tracks:
        for velocity, data in zip(track.sweep.velocities, track.points, strict=False):
            known = {name: (data.get("quantities") or {}).get(name) for name in quantities}
            # Of what a failed point has reached only min J stays, which tells why it failed.
            reached = data.get("reached") or {}
            known |= {f"reached_{name}": reached.get(name) for name in quantities if name.startswith("min")}
            rows.append(
                {
                    "case": track.sweep.case,
                    "motion": track.motion.name,
                    **{key: value for key, value in asdict(track.motion).items() if key != "name"},
                    "level": track.level,
                    VELOCITY: velocity,
                    "status": data["status"],
                    "reason": data["reason"],
                    "unknowns": data["unknowns"],
                    **known,
                    **{name: data["newton"].get(name) for name in ("iterations", "factorizations")},
                    **{f"{name}_seconds": data["timings"].get(name) for name in timings},
                }
            )
    return pd.DataFrame(rows)


def draw(tracks: Sequence[Track]) -> Figure:
    """Draw min J of the fluid mesh over the mean velocity, one panel per sweep; a cross where a sweep failed."""
    sweeps = list(dict.fromkeys(track.sweep for track in tracks))
    figure = Figure(figsize=(10.5, 4.6), layout="constrained", facecolor="white")
    panels = list(figure.subplots(1, len(sweeps), sharey=True, squeeze=False)[0])
    for axes, sweep in zip(panels, sweeps, strict=True):
        for track in tracks:
            if track.sweep == sweep:
                colour, marker, line = _style(track.motion)
                points = [
                    (velocity, value) for velocity, data in track.solved if (value := _jacobian(data)) is not None
                ]
                x, y = zip(*points, strict=True) if points else ((), ())
                style = {"color": colour, "marker": marker, "linestyle": line, "markersize": 4.5, "linewidth": 1.5}
                axes.plot(x, y, label=track.motion.name, **style)
                if track.end is not None:
                    cross = {**FAILURE, "label": "_failed"}
                    axes.plot([track.end[0]], [0.0], color=colour, clip_on=False, zorder=4, **cross)
        axes.set_title(f"{sweep.case}, {sweep.title}", loc="left", fontsize=11, color=INK)
        axes.set_xlabel(label(VELOCITY), color=INK)
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 1.0)
        axes.grid(True, color="#e3e6ea", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(colors=INK, labelsize=9, width=0.6)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(FAINT)
    panels[0].set_ylabel("min J of the fluid mesh; a cross: not converged", color=INK)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9, labelcolor=INK)
    return figure


def _style(motion: Motion) -> tuple[str, str, str]:
    """Return colour (by kind), marker and line (by what the stiffness grows with)."""
    colour = {"harmonic": LINES[0], "linear-elastic": LINES[2], "hyperelastic": LINES[1]}[motion.kind]
    size, distance = motion.stiffness_exponent > 0, motion.distance_exponent > 0
    marker, line = {
        (False, False): ("o", ":"),
        (True, False): ("s", "-"),
        (True, True): ("^", "--"),
        (False, True): ("D", "-."),
    }[size, distance]
    return colour, marker, line


def main(*, level: int = LEVEL, out: Path | None = None, readme: Path | None = None) -> list[str]:
    """Run both sweeps with every mesh motion, and print how far each one carries.

    Args:
        level: mesh level.

    Returns:
        The failures, as `Result.failure`: failed checks and crashes. Where a sweep ends is a finding and no failure,
        unless no mesh motion solved any point of it.
    """
    study = Study("bench --mesh-motion" + (f" --level {level}" if level != LEVEL else ""), out, readme, [BLOCK])
    tracks = []
    for sweep in SWEEPS:
        for motion in MOTIONS:
            with show.progress(f"{sweep.case}, {motion.name}", len(sweep.velocities)) as on_event:
                tracks.append(run(sweep, motion, level, on_event))
    table(tracks).print()
    for line in ends(tracks):
        show.note(line)
    written = study.written(_measurements(tracks))
    study.write({
        CSV: lambda: frame(tracks),
        MARKDOWN: lambda: document(tracks, written),
        PICTURE: lambda: to_small_png(draw(tracks)),
    }, digits="%.6g")  # fmt: skip
    files = study.links("More", (MARKDOWN, PICTURE))
    parts = [EXPLANATION, table(tracks, reasons=True).markdown(), written + files]
    return study.publish(_failures(tracks), {BLOCK: "\n\n".join(parts)})


def document(tracks: Sequence[Track], written: str) -> str:
    """Return `mesh-motion.md`."""
    parts = ["# Mesh motions", f"{written} {_mesh(tracks)}", EXPLANATION, f"![min J over velocity]({PICTURE})"]
    parts += [table(tracks, reasons=True).markdown(), "## What ended the sweeps"]
    lines = "\n".join(f"- {line}." for line in ends(tracks)) or "Every sweep went to its last point."
    return "\n\n".join([*parts, lines, f"Every point: [{CSV}]({CSV})."]) + "\n"


def _mesh(tracks: Sequence[Track]) -> str:
    sizes = {track.sweep.title: track.points[0]["unknowns"] for track in tracks if track.points}
    return f"Mesh level {tracks[0].level}: {', '.join(f'{size} unknowns ({title})' for title, size in sizes.items())}."


def _measurements(tracks: Sequence[Track]) -> list[Measurement]:
    return [Measurement(track.sweep.case, track.level, data) for track in tracks for data in track.points]


def _failures(tracks: Sequence[Track]) -> list[str]:
    found = [name for track in tracks for name in track.failures]
    for sweep in dict.fromkeys(track.sweep for track in tracks):
        if not any(track.solved for track in tracks if track.sweep == sweep):
            found.append("not-converged")
    return found
