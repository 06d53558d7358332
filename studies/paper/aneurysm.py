"""Section 5.4 of the paper: the aneurysm, steady and pulsatile, elastic and rigid, Newtonian and Carreau."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.arrays import Floats
from ffsi.hemodynamics.parts import NECK_ZONE, PARTS
from ffsi.hemodynamics.result import Result, load_result
from ffsi.report import walls
from ffsi.result import pictures
from ffsi.result.fields import FLUID, Fields
from ffsi.result.pictures import canvas
from ffsi.result.quantities import check_maximum
from ffsi.result.views import INK, Scale
from studies.harness import Study, origin, run_all
from studies.paper.flap import LEVEL, OUT, RUNS
from studies.tables import TextTable, columns, document, number, table
from studies.verification.blood import VARIANTS, AneurysmVariant

_STEADY = columns(
    "pressure drop (Pa) = pressure_drop :.4g | WSS vessel (Pa) = wss_mean_vessel :.4g | "
    "WSS dome, mean (Pa) = wss_mean_dome :.4g | max (Pa) = wss_max_dome :.4g | min (Pa) = wss_min_dome :.4g | "
    "flow into the dome (m²/s) = dome_inflow :.4g | turnover (s) = turnover_time :.4g | "
    "stress vessel (Pa) = effective_stress_max_vessel :.4g | stress dome (Pa) = effective_stress_max_dome :.4g | "
    "displacement dome (m) = dome_displacement_max :.3g | mass balance = mass_balance :.0e"
)
CYCLE = columns(
    "walls, blood = label | part | TAWSS mean (Pa) = tawss_mean :.4g | max = tawss_max :.4g | "
    "min = tawss_min :.4g | OSI mean = osi_mean :.3g | max = osi_max :.3g | "
    "RRT mean (1/Pa) = rrt_mean :.4g | WSS peak (Pa) = wss_peak :.4g | change"
)
OVERVIEW = columns(
    "flow | walls, blood = label | unknowns | steps | seconds :.1f | largest check = check :.0e | status"
)
Results = Mapping[AneurysmVariant, Result]


def main(*, level: int = LEVEL, out: Path = OUT, runs: Path = RUNS) -> list[str]:
    """Compute the variants and write figures, curves and `aneurysm.md`; a second call goes on."""
    scenes = {variant: variant.scene(level) for variant in VARIANTS}
    Study("paper --aneurysm", out)
    kept = runs / f"aneurysm-level-{level}"
    run_all({variant.name: scene for variant, scene in scenes.items()}, kept)
    results = {variant: load_result(kept / variant.name) for variant in scenes}
    solved = {variant: result for variant, result in results.items() if result.solved}
    for variant, result in solved.items():
        wall = result.wall
        if wall is not None:
            wall = wall[wall["cycle"] == wall["cycle"].max()] if variant.pulsatile else wall
            folder.write_text(out / f"aneurysm-{variant.name}-wall.csv", wall.to_csv(index=False, float_format="%.6g"))
    names = []
    for name, figure in draw(solved).items():
        names.append(f"{name}.png")
        (out / names[-1]).write_bytes(pictures.to_small_png(figure))
    folder.write_text(out / "aneurysm.md", text_of(results, names))
    show.note(f"wrote {out / 'aneurysm.md'}, its tables and figures")
    return [result.failure for result in results.values()]


def systole(result: Result) -> float:
    """Return the time (s) of the largest inflow in the last cycle."""
    inflow, time = result.scene.inflow, result.scene.time
    assert inflow is not None and time is not None and inflow.period is not None
    t = time.end - inflow.period * np.linspace(1, 0, 2001)
    return float(t[int(inflow.factor(t).argmax())])


def draw(results: Results) -> dict[str, Figure]:
    """Return the figures by name; those whose runs are missing miss."""
    found: dict[str, Figure] = {}
    by_name = {variant.name: result for variant, result in results.items()}
    if "steady-elastic" in by_name:
        found["figure-15-mesh"] = mesh_picture(by_name["steady-elastic"].fields)
    if "pulsatile-elastic" in by_name:
        found |= _at_systole(by_name["pulsatile-elastic"])
    tables = {variant: result.wall for variant, result in results.items() if result.wall is not None}
    steady = {variant.label: walls.outer_wall(table) for variant, table in tables.items() if not variant.pulsatile}
    cycles = {variant.label: walls.outer_wall(table) for variant, table in tables.items() if variant.pulsatile}
    last = {label: table[table["cycle"] == table["cycle"].max()] for label, table in cycles.items()}
    if steady:
        panels = [("wss", "wall shear stress (Pa)"), ("pressure", "pressure (Pa)")]
        title = "Steady flow, peak velocity 0.05 m/s"
        found["aneurysm-steady-walls"] = walls.along_walls(steady, panels, title, walls.OVER_DECADES)
    if last:
        panels = [("tawss", "TAWSS (Pa)"), ("osi", "OSI"), ("rrt", "RRT (1/Pa)")]
        title = "Last cycle at 84 beats per minute"
        found["aneurysm-cycle-walls"] = walls.along_walls(last, panels, title, walls.OVER_DECADES)
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
        "figure-18-velocity-dome": velocity_within(fields, (low - margin, high + margin), f"{title}: the dome"),
    }


def mesh_picture(fields: Fields, title: str = "") -> Figure:
    """Draw the triangles before the deformation: the fluid blue, the walls of the vessel red, of the dome green."""
    figure, axes = canvas(title, (fields.points.min(axis=0), fields.points.max(axis=0)))
    colours = ["#c7dbef", "#d98c86", "#8fbf8a"]
    for region in np.unique(fields.region).tolist():
        corners = fields.points[fields.cells[fields.region == region, :3]]
        axes.add_collection(
            PolyCollection(list(corners), facecolors=colours[region - 1], edgecolors=INK, linewidths=0.3)
        )
    return figure


def velocity_within(fields: Fields, window: tuple[Floats, Floats], title: str = "") -> Figure:
    """Draw the velocity within a window (its lower left and upper right corner, m), with colours of its own.

    The range of the colours is that of the upper left half of the window, so that the flow past a dome does not hide
    the one in it.
    """
    low, high = window
    centre = fields.deformed[fields.cells].mean(axis=1)
    across = (centre - low) / (high - low)
    inside = ((across > -0.1) & (across < 1.1)).all(axis=1)  # what sticks out is cut off by the axes
    half = inside & (across[:, 1] > across[:, 0]) & (fields.region == FLUID)
    speed = np.hypot(*fields.velocity.T)
    top = float(speed[np.unique(fields.cells[half])].max())
    shown = fields.velocity * np.minimum(1.0, top / np.maximum(speed, 1e-300))[:, None]
    part = replace(fields, cells=fields.cells[inside], region=fields.region[inside], velocity=shown)
    return pictures.velocity(part, title, Scale(0.0, top, window))


def text_of(results: Results, drawn: Collection[str]) -> str:
    """Return `aneurysm.md`; `drawn` are the names of the figures that were written beside it."""
    rows = [
        {
            **result.data,
            "flow": "pulsatile" if variant.pulsatile else "steady",
            "label": variant.label,
            "steps": (result.data.get("time") or {}).get("steps"),
            "seconds": (result.data.get("timings") or {}).get("script"),
            "check": check_maximum(result.data),
            "status": result.status if not result.failure else f"{result.status} ({result.failure})",
        }
        for variant, result in results.items()
    ]
    steady = {variant.label: result.quantities for variant, result in results.items() if not variant.pulsatile}
    quantities = [[column.head, *(column.cell(item) for item in steady.values())] for column in _STEADY]
    first = {variant.name: result for variant, result in results.items()}.get("steady-elastic")
    wall = first.wall if first is not None and first.solved else None
    return document(
        "aneurysm", written=origin("python -m studies paper --aneurysm", rows[:1]), drawn=drawn, neck=NECK_ZONE,
        overview=table(rows, OVERVIEW, left=2), steady=TextTable(("", *steady), quantities),
        cycles=cycle_table(results), elastic={} if first is None or wall is None else first.quantities,
        dome=None if wall is None else wall[wall["part"] == "dome"]["pressure"],
    ) + "\n"  # fmt: skip


def cycle_table(results: Results) -> TextTable:
    """Return one row per pulsatile computation and part of the walls."""
    rows: list[dict[str, Any]] = []
    for variant, result in results.items():
        for last in (result.data.get("cycles") or [])[-1:] if variant.pulsatile else []:
            for part in PARTS:
                first = part == PARTS[0]
                change = number(last.get("tawss_change"), "{:.0e}") if first else ""
                numbers = {name.removesuffix(f"_{part}"): value for name, value in last.items()}
                rows.append({**numbers, "label": variant.label if first else "", "part": part, "change": change})
    return table(rows, CYCLE, left=2)
