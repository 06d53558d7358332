"""`python -m studies paper`: `paper.md`, its tables and figures, and the words of the paper beside what is found."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from ffsi.cli import show
from ffsi.files import folder
from ffsi.report import formulas
from ffsi.result.pictures import to_small_png
from ffsi.scene import Newtonian, Scene
from ffsi.scene.geometry import FlapChannel
from studies.harness import Study, origin
from studies.paper.sweeps import (
    CASES,
    FIELDS,
    LEVEL,
    MEAN_VELOCITY,
    NOT_REACHED,
    OUT,
    RUNS,
    Outcome,
    Outcomes,
    PaperCase,
    all_curves,
    draw,
    load_scenes,
    run_sweeps,
)
from studies.tables import NOTHING, Column, TextTable, columns, markdown, number, table

MARKDOWN = "paper.md"
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
COLUMNS = columns(
    f"v_mean (m/s) = {MEAN_VELOCITY} :g | drag (N/m) = drag :.5g | lift (N/m) = lift :.5g | "
    "C_D = drag_coefficient :.5g | C_L = lift_coefficient :.5g | tip_ux (m) = tip_ux :.5g | tip_uy (m) = tip_uy :.5g | "
    "roof_ux (m) = roof_ux :.5g | roof_uy (m) = roof_uy :.5g | min_jacobian :.4f | "
    "before the failure = reached_min_jacobian :.4f | check = check_maximum :.0e"
)
COLUMNS_TEXT = (
    "`check` is the largest relative residual or difference that the independent checker finds, `min_jacobian` the "
    "smallest det F in fluid mesh and solids, of a point that failed that of the last state before. The tip is the "
    "middle of the flap's top, `roof` the middle of the roof's wet side. All quantities are in the CSV files."
)


def main(
    *,
    level: int = LEVEL,
    jobs: int = 1,
    out: Path = OUT,
    runs: Path = RUNS,
    cases: Sequence[PaperCase] = CASES,
) -> list[str]:
    """Compute the paper's cases and write CSV, PNG and `paper.md`; a second call resumes the sweeps."""
    scenes = load_scenes(all_curves(cases), level)
    Study("paper", out)
    outcomes = run_sweeps(scenes, runs, jobs)
    overview(cases, outcomes).print()
    names = []
    for curve, outcome in outcomes.items():
        if outcome.end is not None:
            show.note(f"{curve.name} ended at {outcome.end[0]:g} m/s: {outcome.end[1]}")
        folder.write_text(out / f"{curve.name}.csv", to_csv(outcome))
    for case in cases:
        for kind, figure in draw(case, outcomes).items():
            names.append(case.file(kind))
            (out / names[-1]).write_bytes(to_small_png(figure))
    folder.write_text(out / MARKDOWN, document(cases, outcomes, names))
    show.note(f"wrote {out / MARKDOWN}, its tables and figures")
    return [failure for outcome in outcomes.values() for failure in outcome.failures]


def to_csv(outcome: Outcome) -> str:
    """Return a sweep's table as CSV: eight digits, two for the check, which is rounding error."""
    table = outcome.published
    if "check_maximum" in table:
        table["check_maximum"] = [f"{value:.1e}" if pd.notna(value) else "" for value in table["check_maximum"]]
    return table.to_csv(index=False, float_format="%.8g")


def document(cases: Sequence[PaperCase], outcomes: Outcomes, pictures: Collection[str]) -> str:
    """Return `paper.md`; `pictures` are the names of the figures that were written beside it."""
    compared = [curve for curve in outcomes if all(curve != case.curve for case in cases)]
    last = [outcome.highest.data for outcome in outcomes.values() if outcome.highest is not None]
    levels = sorted({outcome.scene.mesh.level for outcome in outcomes.values()})
    written = origin("python -m studies paper", last[:1], f", mesh level {' and '.join(map(str, levels))}")
    parts: list[str | TextTable] = ["# The paper's flap in a channel", INTRODUCTION, VELOCITIES, written]
    parts += [overview(cases, outcomes), COLUMNS_TEXT]
    for case in cases:
        parts += [f"## Case {case.number}: {case.title}", *_case(case, outcomes, pictures)]
    if compared:
        parts.append("## Sweeps for comparison")
    for curve in compared:
        title = f"<summary>{curve.scene}, {curve.label}: {_result(outcomes[curve])}</summary>"
        parts += [f"<details>{title}", *_sweep(outcomes[curve]), "</details>"]
    parts += ["## Formulas: the paper and the standard form", _remarks(cases, outcomes)]
    return markdown([*parts, "## What the paper does not state", open_values(cases, outcomes)]) + "\n"


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
    return table(points.to_dict("records"), [*shown, Column("status", _status)], left=0)


def _status(row: Mapping[str, str]) -> str:
    return f"{row['status']} ({row['failure']})" if row["failure"] else row["status"]


def open_values(cases: Sequence[PaperCase], outcomes: Outcomes) -> TextTable:
    """Return the values of the scenes that the paper leaves open."""
    found: dict[tuple[str, str], list[str]] = {}
    for case in cases:
        for item in _open(outcomes[case.curve].scene):
            found.setdefault(item, []).append(str(case.number))
    rows = [(name, ", ".join(numbers), value) for (name, value), numbers in found.items()]
    return TextTable(("value", "cases", "used"), rows, left=3)


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


def _case(case: PaperCase, outcomes: Outcomes, pictures: Collection[str]) -> list[str | TextTable]:
    outcome = outcomes[case.curve]
    parts: list[str | TextTable] = []
    for kind, figure in case.figures.items():
        name = case.file(kind)
        if name in pictures:
            at = f", at {outcome.highest_velocity:g} m/s" if kind in FIELDS else ""
            parts += [f"![Figure {figure}]({name})", f"*Figure {figure}{at}: {CAPTIONS[kind]}*"]
        else:
            parts.append(f"*Figure {figure}: nothing was solved, there is no picture.*")
    parts += _sweep(outcome)
    last = outcome.highest
    if last is not None and (remark := formulas.solid_remark(last)):
        parts.append(remark)
    words = [f"- Section {section}: “{quote}”. Here: {found}" for section, quote, found in statements(case, outcomes)]
    return [*parts, "What the paper says, and what is found:", "\n".join(words)] if words else parts


def _result(outcome: Outcome) -> str:
    solved = f"{len(outcome.solved)} of {len(outcome.table)} points solved"
    return solved if outcome.end is None else f"{solved}, failed at {outcome.end[0]:g} m/s"


def _sweep(outcome: Outcome) -> list[str | TextTable]:
    name = f"{outcome.curve.name}.csv"
    parts: list[str | TextTable] = [point_table(outcome), f"[{name}]({name})"]
    if outcome.end is None:
        return parts
    velocity, reason = outcome.end
    skipped = int((outcome.table["failure"] == NOT_REACHED).sum())
    rest = f" Points after it that were not tried: {skipped}." if skipped else ""
    return [*parts, f"The sweep ended at {velocity:g} m/s: {reason}.{rest}"]


def _remarks(cases: Sequence[PaperCase], outcomes: Outcomes) -> str:
    """Return every remark once, with the numbers of its cases where these are not all."""
    found: dict[formulas.Remark, list[int]] = {}
    for case in cases:
        for remark in formulas.remarks(outcomes[case.curve].scene):
            found.setdefault(remark, []).append(case.number)
    lines = []
    for remark, numbers in found.items():
        where = "" if len(numbers) == len(cases) else f" (case {' and '.join(map(str, numbers))})"
        lines.append(f"- **{remark.topic}{where}.** Paper: {remark.paper} Here: {remark.here}")
    return "\n".join(lines)


def statements(case: PaperCase, outcomes: Outcomes) -> list[tuple[str, str, str]]:
    """Return what the paper says about a case in words: its section, its words, and what is found.

    It prints no number that could be compared. Empty if no point was solved.
    """
    outcome, stiff = outcomes[case.curve], outcomes.get(CASES[2].curve)
    rows, geometry = outcome.solved, outcome.scene.geometry
    assert isinstance(geometry, FlapChannel)
    if rows.empty:
        return []
    first, last = _at(rows.iloc[0]), _at(rows.iloc[-1])
    sizes = np.hypot(rows["tip_ux"], rows.get("tip_uy", 0.0)).tolist()  # of the tip's way, m
    small, large = (f"{100 * size / geometry.flap_height:.3g} % of the flap's height" for size in (sizes[0], sizes[-1]))
    tip = f"at {last} the tip moves by {sizes[-1]:.3g} m, {large}."
    roof = "the roof of this computation is rigid."
    if "roof_uy" in rows:
        rise = rows["roof_uy"].iloc[-1]
        roof = (
            f"at {last} the middle of the roof rises by {rise:.3g} m, {100 * rise / geometry.height:.3g} % of the "
            f"channel's height; the tip of the flap moves by {sizes[-1]:.3g} m. The paper states neither the roof's "
            "thickness nor how it is held, see below."
        )
    if case.number == 1:
        word = "it grows at every step" if bool((np.diff(sizes) > 0).all()) else "it does not grow at every step"
        grows = "the displacement of the flap increases with the increase in the value of the flow velocity"
        moves = f"the tip moves by {small} at {first} and {large} at {last}."
        return [
            ("5", "relatively small beam displacements (around 4%)", moves),
            ("5.1", "the significant deformation of the flap", tip),
            ("6", grows, f"{word}: {sizes[0]:.3g} m at {first}, {sizes[-1]:.3g} m at {last}."),
        ]
    if case.number == 2:
        minor = "the SVK material model has a relatively minor impact on the behavior of the top roof"
        small_one = ("5.2", "the small deformation of the flap under the fluid flow", tip)
        return [small_one, ("5.2", minor, roof), *(_both_roofs(outcome, stiff) if stiff else [])]
    smaller = (
        "The displacement of the vertical flap in the y-direction was found to be significantly less than that in the "
        "x-direction"
    )
    ratio = abs(rows["tip_uy"].iloc[-1] / rows["tip_ux"].iloc[-1])
    return [
        ("5.3", "the very little deformation of the flap under the fluid flow", tip),
        ("6", smaller, f"at {last} the ratio of the two is {ratio:.2g}."),
        ("6", "most of the flow's effects being directed towards the top roof", roof),
    ]


def _both_roofs(soft: Outcome, stiff: Outcome) -> list[tuple[str, str, str]]:
    """Return the statement about soft and stiff flaps, at the highest velocity that both sweeps have reached."""
    if "roof_uy" not in soft.solved or "roof_uy" not in stiff.solved:
        return []
    both = pd.merge(soft.solved, stiff.solved, on=MEAN_VELOCITY, suffixes=("", "_stiff"))
    if both.empty:
        return []
    last = both.sort_values(MEAN_VELOCITY).iloc[-1]
    quote = (
        "if the flap undergoes significant deformation, the diversion of flow towards the top roof is reduced, "
        "resulting in less deformation of the roof"
    )
    found = (
        f"at {_at(last)} the middle of the roof rises by {last['roof_uy']:.3g} m over this flap and by "
        f"{last['roof_uy_stiff']:.3g} m over the stiff one of case 3."
    )
    return [("6", quote, found)]


def _at(row: pd.Series) -> str:
    return f"{row[MEAN_VELOCITY]:g} m/s"
