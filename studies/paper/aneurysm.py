"""Section 5.4 of the paper: the aneurysm, steady and pulsatile, elastic and rigid, Newtonian and Carreau."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result, load_result
from ffsi.report import walls
from ffsi.result import pictures
from ffsi.run.one_scene import solve
from ffsi.scene import Scene
from studies.harness import Study
from studies.paper.aneurysm_text import document
from studies.verification.aneurysm import VARIANTS, AneurysmVariant

OUT = Path("results/paper")
RUNS = Path("runs/paper")
LEVEL = 2
MARKDOWN = "aneurysm.md"
_FINISHED = ("", "check")


def main(*, level: int = LEVEL, out: Path = OUT, runs: Path = RUNS) -> list[str]:
    """Compute the variants and write figures, curves and `aneurysm.md`; what a call before has solved is kept.

    Args:
        level: mesh level.
    """
    scenes = {variant: variant.scene(level) for variant in VARIANTS}
    Study("paper --aneurysm", out)
    results: dict[AneurysmVariant, Result] = {}
    with show.progress("aneurysm", len(scenes)) as on_event:
        for variant, scene in scenes.items():
            directory = runs / f"aneurysm-level-{level}" / variant.name
            found = solved_before(scene, directory)
            results[variant] = found or solve(scene, directory, on_event=on_event)
    write(results, out, "python -m studies paper --aneurysm" + ("" if level == LEVEL else f" --level {level}"))
    show.note(f"wrote {out / MARKDOWN}, its tables and figures")
    return [result.failure for result in results.values()]


def solved_before(scene: Scene, directory: Path) -> Result | None:
    """Return the result in a folder, if it is that of the scene and was solved."""
    try:
        result = load_result(directory)
    except InputError:
        return None
    same = tomllib.loads(result.scene.to_toml()) == tomllib.loads(scene.to_toml())
    return result if same and result.failure in _FINISHED else None


def write(results: Mapping[AneurysmVariant, Result], out: Path, written_by: str) -> None:
    """Write the curves along the walls, the figures and `aneurysm.md`."""
    solved = {variant: result for variant, result in results.items() if result.solved}
    for variant, result in solved.items():
        wall = result.wall
        if wall is not None:
            if variant.pulsatile:
                wall = wall[wall["cycle"] == wall["cycle"].max()]
            folder.write_text(out / f"aneurysm-{variant.name}-wall.csv", wall.to_csv(index=False, float_format="%.6g"))
    names = []
    for name, figure in draw(solved).items():
        names.append(f"{name}.png")
        (out / names[-1]).write_bytes(pictures.to_small_png(figure))
    folder.write_text(out / MARKDOWN, document(results, names, written_by))


def systole(result: Result) -> float:
    """Return the time (s) of the largest inflow in the last cycle."""
    inflow, time = result.scene.inflow, result.scene.time
    assert inflow is not None and time is not None and inflow.period is not None
    t = time.end - inflow.period * np.linspace(1, 0, 2001)
    return float(t[int(inflow.factor(t).argmax())])


def draw(results: Mapping[AneurysmVariant, Result]) -> dict[str, Figure]:
    """Return the figures by name; those whose runs are missing miss."""
    found: dict[str, Figure] = {}
    by_name = {variant.name: result for variant, result in results.items()}
    steady = {variant.label: result.wall for variant, result in results.items() if not variant.pulsatile}
    if "steady-elastic" in by_name:
        found["figure-15-mesh"] = walls.mesh_picture(by_name["steady-elastic"].fields)
    if "pulsatile-elastic" in by_name:
        found |= _at_systole(by_name["pulsatile-elastic"])
    if steady:
        panels = [("wss", "wall shear stress (Pa)"), ("pressure", "pressure (Pa)")]
        found["aneurysm-steady-walls"] = walls.along_walls(
            {name: walls.outer_wall(table) for name, table in steady.items() if table is not None},
            panels,
            "Steady flow, peak velocity 0.05 m/s",
            logarithmic=walls.OVER_DECADES,
        )
    cycles = {variant.label: result.wall for variant, result in results.items() if variant.pulsatile}
    last = {
        name: walls.outer_wall(table[table["cycle"] == table["cycle"].max()])
        for name, table in cycles.items()
        if table is not None
    }
    if last:
        panels = [("tawss", "TAWSS (Pa)"), ("osi", "OSI"), ("rrt", "RRT (1/Pa)")]
        found["aneurysm-cycle-walls"] = walls.along_walls(
            last, panels, "Last cycle at 84 beats per minute", walls.OVER_DECADES
        )
    return found


def _at_systole(result: Result) -> dict[str, Figure]:
    step = min(result.saved_steps, key=lambda step: abs(step.time - systole(result)))
    fields, state = result.fields_of(step), result.aneurysm_at(step.new)
    inflow = result.scene.inflow
    assert inflow is not None and inflow.period is not None
    title = f"Systole, {(step.time % inflow.period) / inflow.period:.2f} of a cycle"
    corner = np.array(state.geometry.neck)
    low = np.array([fields.deformed[:, 0].min(), corner[:, 1].min()])
    high = np.array([corner[:, 0].max(), fields.deformed[np.unique(fields.cells[fields.region == 3]), 1].max()])
    margin = 0.05 * (high - low)
    return {
        "figure-16-effective-stress": walls.wall_stress(
            fields, state.point_data["effective_stress"], state.quantities["effective_stress_max"], title
        ),
        "figure-17-pressure-aneurysm": pictures.draw("pressure", fields, title),
        "figure-18-velocity-aneurysm": pictures.draw("velocity", fields, title),
        "figure-18-velocity-dome": walls.velocity_within(fields, (low - margin, high + margin), f"{title}: the dome"),
    }
