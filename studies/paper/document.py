"""`paper.md`: figures, tables, where each sweep ended, and where the paper's formulas differ from what is computed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import pandas as pd

from ffsi.report import formulas
from ffsi.scene import Newtonian, Scene
from ffsi.scene.geometry import FlapChannel
from studies.paper.cases import MEAN_VELOCITY, Curve, PaperCase
from studies.paper.pictures import FIELDS, file_name
from studies.paper.statements import statements
from studies.paper.sweeps import NOT_REACHED, Outcome
from studies.tables import NOTHING, TextTable, number

INTRODUCTION = (
    "Sections 5.1 to 5.3 and figures 3 to 14 of *Finite Element Method for Strongly Coupled Fluid-Structure "
    "Interaction of a Vertical Flap in a Channel and Aneurysm Hemodynamics*. The paper prints no computed number of "
    "these cases, neither in a table nor in its text: its figures can be compared by eye, its statements in words with "
    "the numbers below. SI units, forces of the fluid on the flap per metre of depth, positive along +x and +y."
)
VELOCITIES = (
    "Velocities: the paper's inflow has a maximum of 0.3 m/s in the text (a mean of 0.2 m/s), its figures belong to "
    "“v = 0.12 m/s”, which is read as the mean: ten of its steps of 0.012 m/s in case 1. In cases 2 and 3 ten steps of "
    "0.0055 m/s end at 0.055 m/s; the sweeps go on from there towards 0.12 m/s."
)
CAPTIONS = {
    "velocity": "velocity magnitude and direction. The arrows' length grows like the root of the speed.",
    "pressure": "pressure contours. The few extreme values at sharp corners lie outside of the colour bar's range.",
    "displacement": "displacement over the mean inflow velocity; every marker is one computed point.",
    "forces": "drag and lift over the mean inflow velocity; every marker is one computed point.",
}
# Column, head and format of the tables.
COLUMNS = (
    (MEAN_VELOCITY, "v_mean (m/s)", "{:g}"),
    ("drag", "drag (N/m)", "{:.5g}"),
    ("lift", "lift (N/m)", "{:.5g}"),
    ("drag_coefficient", "C_D", "{:.5g}"),
    ("lift_coefficient", "C_L", "{:.5g}"),
    ("tip_ux", "tip_ux (m)", "{:.5g}"),
    ("tip_uy", "tip_uy (m)", "{:.5g}"),
    ("roof_ux", "roof_ux (m)", "{:.5g}"),
    ("roof_uy", "roof_uy (m)", "{:.5g}"),
    ("min_jacobian", "min_jacobian", "{:.4f}"),
    ("reached_min_jacobian", "before the failure", "{:.4f}"),
    ("check_maximum", "check", "{:.0e}"),
)
COLUMNS_TEXT = (
    "`check` is the largest relative residual or difference that the independent checker finds, `min_jacobian` the "
    "smallest det F in fluid mesh and solids, of a point that failed that of the last state before. The tip is the "
    "middle of the flap's top, `roof` the middle of the roof's wet side. All quantities are in the CSV files."
)


def document(
    cases: Sequence[PaperCase], outcomes: Mapping[Curve, Outcome], pictures: Collection[str], command: str
) -> str:
    """Return `paper.md`.

    Args:
        cases: the computed cases.
        outcomes: all their sweeps.
        pictures: names of the figures that were written beside it.
        command: the command that wrote it.
    """
    compared = [curve for curve in outcomes if all(curve != case.curve for case in cases)]
    parts = ["# The paper's flap in a channel", INTRODUCTION, VELOCITIES, _origin(outcomes.values(), command)]
    parts += [overview(cases, outcomes).markdown(), COLUMNS_TEXT]
    for case in cases:
        parts += [f"## Case {case.number}: {case.title}", *_case(case, outcomes, pictures)]
    if compared:
        parts.append("## Sweeps for comparison")
    for curve in compared:
        title = f"<summary>{curve.scene}, {curve.label}: {_result(outcomes[curve])}</summary>"
        parts += [f"<details>{title}", *_sweep(outcomes[curve]), "</details>"]
    parts += ["## Formulas: the paper and the standard form", *_remarks(cases, outcomes)]
    parts += ["## What the paper does not state", open_values(cases, outcomes).markdown()]
    return "\n\n".join(parts) + "\n"


def overview(cases: Sequence[PaperCase], outcomes: Mapping[Curve, Outcome]) -> TextTable:
    """Return one row per sweep: mesh, how many points were solved, the highest velocity, and where it ended."""
    head = ("sweep", "scene", "unknowns", "points solved", "highest v_mean (m/s)", "failed at (m/s)")
    table = TextTable(head, left=2, title="Sweeps over the mean inflow velocity")
    names = {case.curve: f"case {case.number}" for case in cases}
    for curve, outcome in outcomes.items():
        last = outcome.highest
        settings = "".join(f", {setting}" for setting in curve.settings)
        table.add(
            names.get(curve, "comparison"),
            curve.scene + settings,
            NOTHING if last is None else str(last.data["unknowns"]),
            f"{len(outcome.solved)} of {len(outcome.table)}",
            number(outcome.highest_velocity, "{:g}"),
            NOTHING if outcome.end is None else f"{outcome.end[0]:g}",
        )
    return table


def point_table(outcome: Outcome) -> TextTable:
    """Return one row per point of a sweep."""
    points = outcome.published
    columns = [column for column in COLUMNS if column[0] in points and points[column[0]].notna().any()]
    table = TextTable([*(head for _, head, _ in columns), "status"], left=0)
    for _, row in points.iterrows():
        table.add(*(number(row[name], form) for name, _, form in columns), _status(row))
    return table


def open_values(cases: Sequence[PaperCase], outcomes: Mapping[Curve, Outcome]) -> TextTable:
    """Return the values of the scenes that the paper leaves open."""
    table = TextTable(("value", "cases", "used"), left=3)
    found: dict[tuple[str, str], list[str]] = {}
    for case in cases:
        for name, value in _open(outcomes[case.curve].scene):
            found.setdefault((name, value), []).append(str(case.number))
    for (name, value), numbers in found.items():
        table.add(name, ", ".join(numbers), value)
    return table


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


def _origin(outcomes: Collection[Outcome], command: str) -> str:
    last = next((last for outcome in outcomes if (last := outcome.highest) is not None), None)
    used: Mapping[str, str] = (last.data.get("freefem") or {}) if last else {}
    solver = f"FreeFEM {used.get('version', '?')} with {used.get('solver', '?')}"
    levels = sorted({outcome.scene.mesh.level for outcome in outcomes})
    return f"Written by `{command}` ({solver}, mesh level {' and '.join(map(str, levels))})."


def _case(case: PaperCase, outcomes: Mapping[Curve, Outcome], pictures: Collection[str]) -> list[str]:
    outcome = outcomes[case.curve]
    parts = []
    for kind, figure in case.figures.items():
        name = file_name(case, kind)
        if name in pictures:
            at = f", at {outcome.highest_velocity:g} m/s" if kind in FIELDS else ""
            parts += [f"![Figure {figure}]({name})", f"*Figure {figure}{at}: {CAPTIONS[kind]}*"]
        else:
            parts.append(f"*Figure {figure}: nothing was solved, there is no picture.*")
    parts += _sweep(outcome)
    last = outcome.highest
    if last is not None and (remark := formulas.solid_remark(last)):
        parts.append(remark)
    words = [f"- Section {item.section}: “{item.quote}”. Here: {item.found}" for item in statements(case, outcomes)]
    return [*parts, "What the paper says, and what is found:", "\n".join(words)] if words else parts


def _result(outcome: Outcome) -> str:
    solved = f"{len(outcome.solved)} of {len(outcome.table)} points solved"
    return solved if outcome.end is None else f"{solved}, failed at {outcome.end[0]:g} m/s"


def _sweep(outcome: Outcome) -> list[str]:
    name = f"{outcome.curve.name}.csv"
    parts = [point_table(outcome).markdown(), f"[{name}]({name})"]
    if outcome.end is None:
        return parts
    velocity, reason = outcome.end
    skipped = int((outcome.table["failure"] == NOT_REACHED).sum())
    rest = f" Points after it that were not tried: {skipped}." if skipped else ""
    return [*parts, f"The sweep ended at {velocity:g} m/s: {reason}.{rest}"]


def _remarks(cases: Sequence[PaperCase], outcomes: Mapping[Curve, Outcome]) -> list[str]:
    """Return every remark once, with the numbers of its cases where these are not all."""
    found: dict[formulas.Remark, list[int]] = {}
    for case in cases:
        for remark in formulas.remarks(outcomes[case.curve].scene):
            found.setdefault(remark, []).append(case.number)
    lines = []
    for remark, numbers in found.items():
        where = "" if len(numbers) == len(cases) else f" (case {' and '.join(map(str, numbers))})"
        lines.append(f"- **{remark.topic}{where}.** Paper: {remark.paper} Here: {remark.here}")
    return ["\n".join(lines)]


def _status(row: pd.Series) -> str:
    failure = str(row["failure"])
    return str(row["status"]) if failure == "" else f"{row['status']} ({failure})"
