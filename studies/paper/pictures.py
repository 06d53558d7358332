"""Figures 3 to 14: fields at the highest velocity, and curves over the mean inflow velocity."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from ffsi.report import curves
from ffsi.result import pictures
from studies.paper.cases import MEAN_VELOCITY, Curve, PaperCase
from studies.paper.sweeps import Outcome

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


def draw(case: PaperCase, outcomes: Mapping[Curve, Outcome]) -> dict[str, Figure]:
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


def file_name(case: PaperCase, kind: str) -> str:
    """Return the name of a figure's file, such as `figure-03-velocity.png`."""
    return f"figure-{case.figures[kind]:02d}-{kind}.png"
