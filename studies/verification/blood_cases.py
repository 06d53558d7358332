"""The runs of `verify --blood`: plane channels, Womersley's flow, and the aneurysm of the catalogue."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import read_mesh, read_state
from ffsi.hemodynamics.result import Result
from ffsi.hemodynamics.walls import wall_labels, wall_points, wall_shear_stress
from ffsi.scene import CASES, Aneurysm, Scene
from studies.verification.exact_flows import (
    DENSITY,
    HEIGHT,
    PERIOD,
    RATE,
    VISCOSITY,
    Measured,
    bent_flow,
    oscillating_flow,
    plane_flow,
    worst,
)
from studies.verification.far_from_dome import far_flow

_MIDDLE = 0.4, 0.6  # part of the length; ahead of it the inlet is felt, behind it the outlet
_SAMPLES, _ACROSS = 9, 41
_CYCLES, _SAVED, _LENGTH = 3, 16, 2.0  # of Womersley's flow; m


def _channel(name: str, length: float, height: float, tables: Mapping[str, Any]) -> Scene:
    return Scene.model_validate({
        "name": name,
        "geometry": {"kind": "channel", "length": length, "height": height},
        "outlet": {"kind": "do-nothing"},
        "output": {"pictures": False, "vtu": False},
        **tables,
    })  # fmt: skip


class BloodCase(NamedTuple):
    """A run, and what is measured of it."""

    group: str  # name of the group of rows that it belongs to
    folder: str  # name of the run folder
    labels: tuple[str, ...]  # what the first cells of its row say
    level: int  # mesh level
    scene: Callable[[], Scene]  # what is solved
    measure: Callable[[Result], Mapping[str, Measured]]  # numbers of a solved run by quantity


def plane_case(name: str, fluid: Mapping[str, Any], gradient: float) -> BloodCase:
    """Return the flow of a fluid, given by its table in a scene, that a pressure gradient in Pa/m drives.

    The mean velocity is given, and a power of the distance from the middle as profile. It has the exact ratio of
    largest and mean velocity, so that a short vessel is enough to leave the inlet behind.
    """
    label = f"plane-{name.lower().replace(' ', '-')}-{gradient:g}"
    half_height, length = 1e-3, 13e-3
    # Rows from 35 micrometres at the walls, where the stress is largest, to 70 in the middle, where a Carreau fluid has
    # its thick core.
    mesh = {"level": 0, "body_size": 3.5e-5, "growth": 0.04, "far_size": 0.9e-3}

    def with_inflow(inflow: Mapping[str, Any]) -> Scene:
        return _channel(label, length, 2 * half_height, {"mesh": mesh, "fluid": fluid, "inflow": inflow})

    @cache
    def exact() -> tuple[float, float]:
        blood = with_inflow({"mean_velocity": 1.0}).fluid
        assert blood is not None
        return plane_flow(blood, gradient, half_height)

    def scene() -> Scene:
        mean, largest = exact()
        power = float(f"{1 / (largest / mean - 1):.4g}")
        profile = f"{(power + 1) / power:.15g} * (1 - abs(2 * y / H - 1)^{power})"
        return with_inflow({"mean_velocity": mean, "profile": profile})

    def measure(result: Result) -> dict[str, Measured]:
        """Return pressure gradient (Pa/m), and where they are farthest off largest velocity and wall shear stress."""
        x = np.linspace(*_MIDDLE, _SAMPLES) * length
        found = result.sample(np.column_stack([x, np.full_like(x, half_height)]))
        raw = read_mesh(result.directory / folder.MESH)
        points = wall_points(raw, wall_labels(result.scene))
        state = read_state(result.directory / str(result.state_file), raw)
        assert result.scene.fluid is not None
        wall = np.hypot(*wall_shear_stress(points, state, result.scene.fluid).T)
        place = points.position[:, 0] / length
        return {
            "mean": Measured(exact()[0]),
            "gradient": Measured(-float(np.polyfit(x, found["p"], 1)[0]), gradient),
            "largest": worst(found["vx"].to_numpy(), exact()[1]),
            "wall_shear_stress": worst(wall[(place > _MIDDLE[0]) & (place < _MIDDLE[1])], gradient * half_height),
        }

    return BloodCase("plane", label, (name, f"{gradient:g}"), 0, scene, measure)


def oscillating_case(level: int, step: float) -> BloodCase:
    """Return Womersley's flow from rest, on a mesh level with a time step in s."""
    label = f"oscillating-level-{level}-steps-{round(PERIOD / step)}"
    tables = {
        "mesh": {"level": level},
        "fluid": {"density": DENSITY, "viscosity": VISCOSITY},
        "inflow": {"flow_rate": RATE, "profile": "womersley", "waveform": "sinus"},
        "time": {"step": step, "end": _CYCLES * PERIOD, "output_interval": PERIOD / _SAVED},
    }
    scene = partial(_channel, label, _LENGTH, HEIGHT, tables)
    return BloodCase("oscillating", label, (str(level), f"{step:g}"), level, scene, measure_oscillation)


def measure_oscillation(result: Result) -> dict[str, Measured]:
    """Return the largest differences of velocity and pressure drop, relative to their largest exact values.

    Over the saved states of the last cycle, across the channel at inlet, middle and outlet.
    """
    y = np.linspace(0, HEIGHT, _ACROSS)
    steps = [step for step in result.saved_steps if step.time > (_CYCLES - 1) * PERIOD * (1 + 1e-9)]
    differences, sizes = np.zeros(2), np.zeros(2)
    for step in steps:
        fields = result.fields_of(step)
        velocity, _ = oscillating_flow(y, step.time)
        for x in (0.0, _LENGTH / 2, _LENGTH):
            found = fields.sample(np.column_stack([np.full_like(y, x), y]))
            differences[0] = max(differences[0], np.hypot(found["vx"] - velocity, found["vy"]).max())
        # Where the pressure of a step belongs: at its weighted time.
        _, gradient = oscillating_flow(y, step.time - (1 - step.theta) * step.k)
        p = fields.sample([(0.0, HEIGHT / 2), (_LENGTH, HEIGHT / 2)])["p"]
        differences[1] = max(differences[1], abs(p[0] - p[1] - _LENGTH * gradient))
        sizes = np.maximum(sizes, [np.abs(velocity).max(), _LENGTH * abs(gradient)])
    velocity_difference, drop_difference = differences / sizes
    return {
        "steps": Measured(float(result.data["time"]["steps"])),
        "velocity_difference": Measured(float(velocity_difference)),
        "pressure_difference": Measured(float(drop_difference)),
    }


@dataclass(frozen=True)
class AneurysmVariant:
    """A computation of the catalogue's aneurysm."""

    pulsatile: bool  # whether the flow is
    elastic: bool  # whether the walls are, else rigid
    carreau: bool  # whether blood is a Carreau fluid, else Newtonian
    # Whether the elastic walls of a steady flow have the support that those of the pulsatile one have.
    held: bool = False

    @property
    def name(self) -> str:
        """Name of its folder."""
        words = ["pulsatile" if self.pulsatile else "steady", "elastic" if self.elastic else "rigid"]
        return "-".join(words + ["carreau"] * self.carreau + ["held"] * self.held)

    @property
    def label(self) -> str:
        """Name in legends and tables."""
        walls = "elastic" + (", held" if self.held else "") if self.elastic else "rigid"
        return f"{walls}, {'Carreau' if self.carreau else 'Newtonian'}"

    def scene(self, level: int) -> Scene:
        """Return the scene on a mesh level, without the pictures of a run."""
        table = CASES["aneurysm-pulsatile" if self.pulsatile else "aneurysm"].model_dump(exclude_none=True)
        table["name"] = f"aneurysm-{self.name}"
        table["mesh"]["level"] = level
        table["output"] |= {"pictures": False, "vtu": False}
        if self.carreau:
            table["fluid"] = CASES["aneurysm-carreau"].model_dump()["fluid"]
        if self.held:
            table["support"] = CASES["aneurysm-pulsatile"].model_dump()["support"]
        if self.pulsatile:
            # Twenty states per cycle: one of them is near the systole.
            table["time"]["output_interval"] = table["inflow"]["period"] / 20
        if not self.elastic:
            for key in ("solid", "mesh_motion", "support"):
                table.pop(key, None)
        return Scene.model_validate(table)


VARIANTS = tuple(AneurysmVariant(*kind) for kind in product((False, True), (True, False), (False, True)))
HELD = AneurysmVariant(pulsatile=False, elastic=True, carreau=False, held=True)


def aneurysm_case(variant: AneurysmVariant, level: int) -> BloodCase:
    """Return a variant on a mesh level."""

    def measure(result: Result) -> dict[str, Measured]:
        """Return what `result.json` has of it; of a steady flow also the flow far from the dome."""
        if variant.pulsatile:
            last, steps = result.data["cycles"][-1], result.data["time"]["steps"]
            names = ("tawss_mean_dome", "tawss_min_dome", "osi_max_dome", "tawss_change")
            return {"steps": Measured(float(steps)), **{name: Measured(last[name]) for name in names}}
        found = result.quantities
        names = ("mass_balance", "wss_mean_dome", "effective_stress_max", "dome_displacement_max")
        assert isinstance(result.scene.geometry, Aneurysm) and result.scene.fluid is not None
        _, inner, outer, _ = result.scene.geometry.radii
        straight = bent_flow(result.scene.fluid, inner, outer, found["flow_rate_in"]).gradient * math.pi / 2
        return {
            **{name: Measured(found[name]) for name in names if name in found},
            "pressure_drop": Measured(found["pressure_drop"], straight),
            **far_flow(result),
        }

    group = "pulsatile" if variant.pulsatile else "steady"
    label = f"aneurysm-{variant.name}-level-{level}"
    return BloodCase(group, label, (variant.label, str(level)), level, partial(variant.scene, level), measure)


_DENSITY = {"density": 1035.0}
PLANE_CASES = (
    plane_case("Newtonian", {"law": "newtonian", "viscosity": 3.5e-3} | _DENSITY, 100.0),
    *(plane_case("Carreau", {"law": "carreau"} | _DENSITY, gradient) for gradient in (10.0, 100.0, 1000.0)),
    plane_case("power law", {"law": "power-law", "consistency": 0.0147, "exponent": 0.7755} | _DENSITY, 100.0),
    plane_case("Casson", {"law": "casson", "yield_stress": 0.005, "viscosity_infinity": 0.0035} | _DENSITY, 500.0),
)
OSCILLATING_CASES = (oscillating_case(0, 0.0125), oscillating_case(1, 0.00625))
ANEURYSM_CASES = (
    *(aneurysm_case(variant, level) for variant in (*VARIANTS[:4], HELD) for level in (1, 2, 3)),
    aneurysm_case(VARIANTS[4], 1),
    *(aneurysm_case(variant, 2) for variant in VARIANTS[4:]),
)
