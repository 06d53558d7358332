"""The tables of `python -m studies verify --blood`: what stands in them, and every bound."""

from __future__ import annotations

from studies.verification.far_from_dome import RANGES, SLOWED
from studies.verification.measured import SECONDS, Column, MeasuredTable

CHECK = 1e-8
"""Largest accepted residual or difference that the independent checker finds, and the bound of the mass balance."""
PLANE, OSCILLATING, FAR, CHANGE, LONGEST = 1e-4, 5e-3, 3e-2, 1e-2, 900.0
_UNKNOWNS, _SECONDS = Column("unknowns", "unknowns", form="{:.0f}"), Column(SECONDS, "seconds", form="{:.1f}")
_CHECK = Column("check", "largest check", form="{:.0e}", bound=CHECK)
EXPLANATION = (
    "Errors are (value - exact) / |exact|; `!` marks what misses its bound. Seconds: processor time of the script, one "
    "thread. Largest check: the largest relative residual or difference that the independent checker finds, in time "
    "over all saved states. Mass balance: flow rate in less flow rate out, over the former."
)


def _far(ending: str) -> list[Column]:
    return [
        Column(f"{name}_{what}{ending}", f"{low:g}-{high:g}°: {title}", part="error", bound=FAR)
        for name, (low, high) in RANGES.items()
        for what, title in (("pressure", "Δp"), ("inner", "inner"), ("outer", "outer"))
    ]


TABLES = (
    MeasuredTable(
        "plane",
        "Plane channel, half height 1 mm, beside the exact flow of each viscosity law at a pressure gradient G: errors "
        "of the gradient at the given mean velocity, and where they are largest of the velocity in the middle and of "
        "the wall shear stress (WSS), which is G times the half height.",
        ("blood", "G Pa/m"),
        (
            _UNKNOWNS,
            _SECONDS,
            Column("mean", "mean velocity m/s", form="{:.6g}"),
            Column("gradient", "G", part="error", bound=PLANE),
            Column("largest", "largest velocity", part="error", bound=PLANE),
            Column("wall_shear_stress", "WSS", part="error", bound=PLANE),
            _CHECK,
        ),
    ),
    MeasuredTable(
        "oscillating",
        "Womersley's flow in a plane channel, Womersley number 3, flow rate 1 + 0.75 sin(2πt): largest differences "
        "over the third cycle, relative to the largest velocity and to the largest pressure drop.",
        ("level", "dt s"),
        (
            _UNKNOWNS,
            Column("steps", "steps", form="{:.0f}"),
            _SECONDS,
            Column("velocity_difference", "velocity", bound=OSCILLATING),
            Column("pressure_difference", "pressure drop", bound=OSCILLATING),
            _CHECK,
        ),
    ),
    MeasuredTable(
        "steady",
        "Aneurysm, steady: pressure drop from inlet to outlet, beside that of the bent vessel at rest without a dome; "
        "mean WSS on the dome; largest effective stress away from corners and clamped faces. *Held*: by the support "
        "that the walls have in the pulsatile flow.",
        ("walls, blood", "level"),
        (
            _UNKNOWNS,
            _SECONDS,
            Column("mass_balance", "mass balance", form="{:.0e}", bound=CHECK),
            Column("pressure_drop", "pressure drop Pa", form="{:.4f}"),
            Column("pressure_drop", "without a dome Pa", part="reference", form="{:.4f}"),
            Column("wss_mean_dome", "WSS dome Pa", form="{:.5f}"),
            Column("effective_stress_max", "effective stress Pa", form="{:.1f}"),
            _CHECK,
        ),
        finest=True,
    ),
    MeasuredTable(
        "levels",
        "Its changes from one mesh level to the next:",
        ("walls, blood",),
        tuple(
            Column(f"{name}_{level}", f"{title}, {level - 1} to {level}", bound=CHANGE if level == 3 else float("inf"))
            for name, title in (("wss_mean_dome", "WSS dome"), ("effective_stress_max", "effective stress"))
            for level in (2, 3)
        ),
    ),
    MeasuredTable(
        "steady",
        "The same far from the dome (angles around the bend's centre; inlet at 90°, neck from 126.5 to 141.4°, outlet "
        "at 180°), beside the fully developed flow in a bent channel between the deformed walls: pressure difference "
        "in the middle of the lumen over a range of angles, and at inner and outer wall the WSS of the edge that is "
        "farthest off.",
        ("walls, blood", "level"),
        _far(""),
        finest=True,
    ),
    MeasuredTable(
        "steady",
        "Elastic walls make the lumen wider towards the dome; blood that slows down gains pressure, and accelerated "
        "loses it. The same beside the developed flow with that inertia, to first order; what is left comes, as with "
        "rigid walls, from the inlet's parabola, the neck and the outlet.",
        ("walls, blood", "level"),
        _far(SLOWED),
        finest=True,
    ),
    MeasuredTable(
        "pulsatile",
        "Aneurysm, pulsatile, four cycles at 84 beats per minute: TAWSS and OSI on the dome in the last one; change of "
        "TAWSS from the third to the fourth cycle (L2 norm over the walls).",
        ("walls, blood", "level"),
        (
            _UNKNOWNS,
            Column("steps", "steps", form="{:.0f}"),
            Column(SECONDS, "seconds", form="{:.0f}", bound=LONGEST),
            Column("seconds_per_step", "per step", form="{:.3f}"),
            Column("tawss_mean_dome", "TAWSS mean Pa", form="{:.5f}"),
            Column("tawss_min_dome", "min Pa", form="{:.5f}", least=0.0),
            Column("osi_max_dome", "OSI max", form="{:.0e}"),
            Column("tawss_change", "change", form="{:.0e}", bound=CHANGE),
            _CHECK,
        ),
    ),
)
