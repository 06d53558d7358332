"""What the report shows of blood flow: curves along the walls, their parts, cycles, stress in elastic walls."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from ffsi.hemodynamics.aneurysm import AneurysmState
from ffsi.hemodynamics.result import Result
from ffsi.report import walls
from ffsi.report.tables import Rows, cell, with_unit
from ffsi.result.quantities import WORDS, in_table, unit
from ffsi.scene import Aneurysm

_OF_A_PART = re.compile(rf"({'|'.join(in_table('parts'))})_(mean|max|min|peak)_")
_FORM = ".4g"


def _curves(result: Result) -> list[tuple[Figure, str]]:
    table = result.wall
    if table is None or table.empty:
        return []
    if "cycle" in table:
        last = int(table["cycle"].max())
        table = table[table["cycle"] == last]
        panels = [("tawss", "TAWSS (Pa)"), ("osi", "OSI"), ("rrt", "RRT (1/Pa)")]
        text = f"Time-averaged wall shear stress, oscillatory shear index and relative residence time of cycle {last}"
    else:
        panels = [("wss", "wall shear stress (Pa)"), ("pressure", "pressure (Pa)")]
        in_time = result.data.get("time")
        text = "Wall shear stress and pressure" + (f" at t = {in_time['reached']:g} s" if in_time else "")
    outer = walls.outer_wall(table)
    if not outer.empty:
        figure = walls.along_walls({"": outer}, panels, result.title, logarithmic=walls.OVER_DECADES)
        return [(figure, f"{text} along the outer wall, over the reference arc length; all walls: wall.csv.")]
    lines = {
        f"{line}: {', '.join(dict.fromkeys(part['part']))}": part for line, part in table.groupby("line", sort=False)
    }
    along = "distance along each wall in its direction, the fluid to the left (mm)"
    figure = walls.along_walls(lines, panels, result.title, along=along)
    return [(figure, f"{text} along the walls, one curve per connected line, over the reference arc length.")]


def has_stress(result: Result) -> bool:
    """Return whether the picture of the stress is one of those of the walls."""
    return isinstance(result.scene.geometry, Aneurysm) and bool(result.scene.solid)


def _stress(result: Result) -> list[tuple[Figure, str]]:
    state = result.walls
    if not isinstance(state, AneurysmState) or not state.scene.solid:
        return []
    figure = walls.wall_stress(
        state.fields, state.point_data["effective_stress"], state.quantities["effective_stress_max"], result.title
    )
    text = (
        "Effective stress (von Mises) in the deformed walls; dashed: before the deformation. The colours end at the "
        "largest value away from corners and clamped faces, where the stress is singular."
    )
    return [(figure, text)]


PICTURES = {"curves along the walls": _curves, "picture of the effective stress": _stress}
"""Functions that return figures of a result, each with its caption, by what they are in words."""


# Tables -------------------------------------------------------------------------------------------------------------


def of_a_part(quantity: str) -> bool:
    """Return whether a quantity belongs into the table of the parts."""
    return bool(_OF_A_PART.match(quantity))


def part_table(result: Result) -> Rows | None:
    """Return a table with one row per part of the walls: mean, largest, smallest; None without walls.

    Of the last cycle where the run has cycles, else of the last state.
    """
    values, heading = _of_parts(result)
    columns: dict[str, str] = {}  # without the part
    parts: dict[str, None] = {}
    for name in values:
        if (match := _OF_A_PART.match(name)) is not None:
            columns.setdefault(match.group(), f"{WORDS[match.group(1)]} {match.group(2)}")
            parts.setdefault(name.removeprefix(match.group()))
    if not parts:
        return None
    head = ["part", *(with_unit(text, column) for column, text in columns.items())]
    body = [[part, *(cell(values.get(f"{column}{part}"), _FORM) for column in columns)] for part in parts]
    return Rows(head, body, [False, *[True] * len(columns)], heading)


def _of_parts(result: Result) -> tuple[Mapping[str, Any], str]:
    if cycles := result.data.get("cycles"):
        return cycles[-1], f"Parts of the walls, cycle {cycles[-1]['number']}"
    in_time = result.data.get("time")
    when = f" at t = {in_time['reached']:g} s" if in_time else ""
    return result.last_quantities, f"Parts of the walls{when}"


def cycle_table(result: Result) -> Rows | None:
    """Return one row per cycle: its time, mean TAWSS and OSI of each part, changes; None without cycles."""
    cycles = result.data.get("cycles")
    if not cycles:
        return None
    shown = [name for start in ("tawss_mean_", "osi_mean_") for name in cycles[-1] if name.startswith(start)]
    head = ["cycle", "start (s)", "end (s)"]
    for name in shown:
        family, _, part = name.split("_", 2)
        head.append(with_unit(f"{WORDS[family]} mean, {part}", name))
    head += ["TAWSS change", "OSI change"]
    body = [
        [
            str(cycle["number"]), cell(cycle["start"], ".5g"), cell(cycle["end"], ".5g"),
            *(cell(cycle.get(name), _FORM) for name in shown),
            *(cell(cycle.get(name), ".1e") for name in ("tawss_change", "osi_change")),
        ]
        for cycle in cycles
    ]  # fmt: skip
    return Rows(head, body, [True] * len(head), "Cycles")


def flow_table(result: Result) -> Rows | None:
    """Return flow rates, flow into the dome and largest stress of the last state of a run in time; None without."""
    last = result.last_quantities
    if result.data.get("time") is None or "flow_rate_in" not in last:
        return None
    names = [name for name in last if name in in_table("flow") or name.startswith(in_table("walls"))]
    return Rows(
        ["quantity", "value", "unit"], [[name, cell(last[name], ".8g"), unit(name)] for name in names],
        [False, True, False], f"Flow at t = {result.data['time']['reached']:g} s",
    )  # fmt: skip
