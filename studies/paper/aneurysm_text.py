"""`aneurysm.md`: figures 15 to 18, tables of the aneurysm's quantities, and what the paper does not state."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ffsi.hemodynamics.parts import NECK_ZONE, PARTS
from ffsi.hemodynamics.result import Result
from studies.tables import NOTHING, TextTable, number

if TYPE_CHECKING:
    from studies.verification.aneurysm import AneurysmVariant

INTRODUCTION = (
    "Section 5.4 and figures 15 to 18 of *Finite Element Method for Strongly Coupled Fluid-Structure Interaction of a "
    "Vertical Flap in a Channel and Aneurysm Hemodynamics*. The paper prints no number of it, neither of the geometry "
    "nor of the walls, the inflow or the results; it states the Carreau constants, which are used here. So the figures "
    "can be compared by eye only. SI units, per metre of depth."
)
CAPTIONS = {
    "figure-15-mesh": "Figure 15 (left): the mesh; red and green: the walls of vessel and dome, blue: the lumen.",
    "figure-16-effective-stress": "Figure 16: effective (von Mises) stress in the walls at systole, plane "
    "strain; the colours end at the largest value away from clamped faces and corners. "
    "Dashed: the walls at rest.",
    "figure-17-pressure-aneurysm": "Figure 17: pressure at systole.",
    "figure-18-velocity-aneurysm": "Figure 18 (top): velocity at systole.",
    "figure-18-velocity-dome": "Figure 18 (bottom): the same in the dome, with a range of colours of its own.",
    "aneurysm-steady-walls": "Wall shear stress and pressure along the outer wall, steady flow.",
    "aneurysm-cycle-walls": "Time-averaged wall shear stress, oscillatory shear index and relative residence time "
    "along the outer wall, last cycle.",
}
OPEN = (
    ("outline of the lumen and thickness of the walls", "a published rebuild (ffsi/data/aneurysm.json)"),
    ("walls", "incompressible neo-Hookean, plane strain, density 1120 kg/m³, end faces clamped"),
    ("Young's modulus of the vessel's wall", "1 MPa"),
    ("Young's modulus of the dome's wall", "0.1 MPa in the steady flow, 0.05 MPa in the pulsatile one"),
    ("outer sides of the walls", "free in the steady flow; in the pulsatile one held by 5e5 Pa/m (see below)"),
    ("blood", "density 1035 kg/m³; viscosity 3.5 mPa s where it is Newtonian"),
    (
        "inflow",
        "parabola, 0.05 m/s in its middle; pulsatile: 84 beats per minute, 0.153 to 0.649 m/s, from rest in 0.2 s",
    ),
    ("outlet", "do-nothing"),
)
FREE_WALLS = (
    "The support: the end faces of the walls are clamped and their length is thirty times their thickness, so that "
    "without tissue around them they are a slender arch. The pressure of the pulsatile flow, which is mostly the "
    "inertia of the blood, is tens of times that of the steady one: without support the walls move by more than the "
    "vessel is wide (`ffsi run aneurysm-pulsatile --set support.stiffness=0`)."
)
_STEADY = (
    ("pressure_drop", "pressure drop (Pa)", "{:.4g}"),
    ("wss_mean_vessel", "WSS vessel (Pa)", "{:.4g}"),
    ("wss_mean_dome", "WSS dome, mean (Pa)", "{:.4g}"),
    ("wss_max_dome", "max (Pa)", "{:.4g}"),
    ("wss_min_dome", "min (Pa)", "{:.4g}"),
    ("dome_inflow", "flow into the dome (m²/s)", "{:.4g}"),
    ("turnover_time", "turnover (s)", "{:.4g}"),
    ("effective_stress_max_vessel", "stress vessel (Pa)", "{:.4g}"),
    ("effective_stress_max_dome", "stress dome (Pa)", "{:.4g}"),
    ("dome_displacement_max", "displacement dome (m)", "{:.3g}"),
    ("mass_balance", "mass balance", "{:.0e}"),
)


def document(results: Mapping[AneurysmVariant, Result], pictures: Collection[str], command: str) -> str:
    """Return `aneurysm.md`.

    Args:
        results: all computations.
        pictures: names of the figures that were written beside it.
        command: the command that wrote it.
    """
    first = next(iter(results.values()))
    used: Mapping[str, Any] = first.data.get("freefem") or {}
    origin = f"Written by `{command}` (FreeFEM {used.get('version', '?')} with {used.get('solver', '?')})."
    parts = ["# The paper's aneurysm", INTRODUCTION, origin, overview(results).markdown()]
    for name, caption in CAPTIONS.items():
        if f"{name}.png" in pictures:
            parts += [f"![{caption}]({name}.png)", f"*{caption}*"]
    parts += ["## Steady flow", steady_table(results).markdown(), _parts_text()]
    parts += ["## Four cycles at 84 beats per minute", cycle_table(results).markdown()]
    parts += [
        "TAWSS = (1/T) ∫ |τ| dt, OSI = ½ (1 - |∫ τ dt| / ∫ |τ| dt), RRT = 1 / ((1 - 2 OSI) TAWSS), τ the tangential "
        "viscous traction with the viscosity at the wall, summed by the script at every step. *Change*: difference of "
        "TAWSS to the cycle before, L2 norm over the walls."
    ]
    parts += [statements(results)]
    table = TextTable(("value", "used"), left=2)
    for row in OPEN:
        table.add(*row)
    return "\n\n".join([*parts, "## What the paper does not state", table.markdown(), FREE_WALLS]) + "\n"


def _parts_text() -> str:
    return (
        f"Neck: the walls within {NECK_ZONE:g} of its length from its two ends; there the stress is singular and "
        "belongs to no other part. Effective stress: largest value farther than two wall thicknesses from clamped "
        "faces and corners. Flow into the dome: what crosses the line between the neck's ends inwards; turnover: area "
        "of the dome over it."
    )


def overview(results: Mapping[AneurysmVariant, Result]) -> TextTable:
    """Return one row per computation: mesh, steps, seconds, how it ended."""
    head = ("flow", "walls, blood", "unknowns", "steps", "seconds", "largest check", "status")
    table = TextTable(head, left=2)
    for variant, result in results.items():
        check = [value for value in (result.data.get("check") or {}).values() if value is not None]
        steps = (result.data.get("time") or {}).get("steps")
        table.add(
            "pulsatile" if variant.pulsatile else "steady",
            variant.label,
            str(result.data.get("unknowns")),
            NOTHING if steps is None else str(steps),
            number((result.data.get("timings") or {}).get("script"), "{:.1f}"),
            number(max(check, default=None), "{:.0e}"),
            result.status if not result.failure else f"{result.status} ({result.failure})",
        )
    return table


def steady_table(results: Mapping[AneurysmVariant, Result]) -> TextTable:
    """Return one row per quantity, one column per steady computation."""
    chosen = {variant.label: result.quantities for variant, result in results.items() if not variant.pulsatile}
    table = TextTable(("", *chosen))
    for key, name, form in _STEADY:
        table.add(name, *(number(quantities.get(key), form) for quantities in chosen.values()))
    return table


def cycle_table(results: Mapping[AneurysmVariant, Result]) -> TextTable:
    """Return one row per pulsatile computation and part of the walls."""
    head = (
        "walls, blood",
        "part",
        "TAWSS mean (Pa)",
        "max",
        "min",
        "OSI mean",
        "max",
        "RRT mean (1/Pa)",
        "WSS peak (Pa)",
    )
    table = TextTable((*head, "change"), left=2)
    for variant, result in results.items():
        cycles: Sequence[Mapping[str, Any]] = result.data.get("cycles") or []
        if not variant.pulsatile or not cycles:
            continue
        last = cycles[-1]
        for part in PARTS:
            values = [
                ("tawss_mean", "{:.4g}"),
                ("tawss_max", "{:.4g}"),
                ("tawss_min", "{:.4g}"),
                ("osi_mean", "{:.3g}"),
            ]
            values += [("osi_max", "{:.3g}"), ("rrt_mean", "{:.4g}"), ("wss_peak", "{:.4g}")]
            cells = [number(last.get(f"{key}_{part}"), form) for key, form in values]
            change = number(last.get("tawss_change"), "{:.0e}") if part == PARTS[0] else ""
            table.add(variant.label if part == PARTS[0] else "", part, *cells, change)
    return table


def statements(results: Mapping[AneurysmVariant, Result]) -> str:
    """Return the paper's statements in words with the numbers found."""
    by_name = {variant.name: result for variant, result in results.items()}
    lines = []
    steady = by_name.get("steady-elastic")
    if steady is not None and steady.solved:
        wall = steady.wall
        assert wall is not None
        dome = wall[wall["part"] == "dome"]["pressure"]
        lines.append(
            "“The pressure on the wall is nearly constant when the flow is fully developed”. Here: in the dome of the "
            f"steady flow it is {dome.min():.4g} to {dome.max():.4g} Pa; along the vessel it falls by "
            f"{steady.quantities['pressure_drop']:.3g} Pa, as it must."
        )
        found = steady.quantities
        lines.append(
            "“the blood flow intensity is higher near the neck of the aneurysm”. Here: the wall shear stress at the "
            f"neck is {found['wss_mean_neck']:.3g} Pa on average, "
            f"{found['wss_mean_neck'] / found['wss_mean_dome']:.2g} times that of the dome; "
            f"{100 * found['dome_inflow'] / found['flow_rate_in']:.2g} % of the flow enters the dome."
        )
    if not lines:
        return ""
    return "What the paper says, and what is found:\n\n" + "\n".join(f"- {line}" for line in lines)
