"""`verify --blood`: flow of blood beside exact flows, and the aneurysm from mesh to mesh and cycle to cycle."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ffsi.hemodynamics.result import Result, load_result
from ffsi.scene import CASES as CATALOGUE
from ffsi.scene import Aneurysm, Scene, with_values
from studies.harness import Place, Run, Study, run_all
from studies.tables import Column, TextTable, columns, table
from studies.verification import exact_flows as flows
from studies.verification.exact_flows import RANGES, SLOWED, Measured, far_flow, worst

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
        return flows.plane_flow(blood, gradient, half_height)

    def scene() -> Scene:
        mean, largest = exact()
        power = float(f"{1 / (largest / mean - 1):.4g}")
        profile = f"{(power + 1) / power:.15g} * (1 - abs(2 * y / H - 1)^{power})"
        return with_inflow({"mean_velocity": mean, "profile": profile})

    def measure(result: Result) -> dict[str, Measured]:
        """Return pressure gradient (Pa/m), and where they are farthest off largest velocity and wall shear stress."""
        x = np.linspace(*_MIDDLE, _SAMPLES) * length
        found = result.sample(np.column_stack([x, np.full_like(x, half_height)]))
        assert result.wall is not None
        wall = result.wall[(result.wall["x"] / length).between(*_MIDDLE)]["wss"].to_numpy()
        return {
            "mean": Measured(exact()[0]),
            "gradient": Measured(-float(np.polyfit(x, found["p"], 1)[0]), gradient),
            "largest": worst(found["vx"].to_numpy(), exact()[1]),
            "wall_shear_stress": worst(wall, gradient * half_height),
        }

    return BloodCase("plane", label, (name, f"{gradient:g}"), 0, scene, measure)


def oscillating_case(level: int, step: float) -> BloodCase:
    """Return Womersley's flow from rest, on a mesh level with a time step in s."""
    label = f"oscillating-level-{level}-steps-{round(flows.PERIOD / step)}"
    tables = {
        "mesh": {"level": level},
        "fluid": {"density": flows.DENSITY, "viscosity": flows.VISCOSITY},
        "inflow": {"flow_rate": flows.RATE, "profile": "womersley", "waveform": "sinus"},
        "time": {"step": step, "end": _CYCLES * flows.PERIOD, "output_interval": flows.PERIOD / _SAVED},
    }
    scene = partial(_channel, label, _LENGTH, flows.HEIGHT, tables)
    return BloodCase("oscillating", label, (str(level), f"{step:g}"), level, scene, measure_oscillation)


def measure_oscillation(result: Result) -> dict[str, Measured]:
    """Return the largest differences of velocity (at inlet, middle, outlet) and drop, over the largest exact values."""
    y = np.linspace(0, flows.HEIGHT, _ACROSS)
    steps = [step for step in result.saved_steps if step.time > (_CYCLES - 1) * flows.PERIOD * (1 + 1e-9)]
    differences, sizes = np.zeros(2), np.zeros(2)
    for step in steps:
        fields = result.fields_of(step)
        velocity, _ = flows.oscillating_flow(y, step.time)
        for x in (0.0, _LENGTH / 2, _LENGTH):
            found = fields.sample(np.column_stack([np.full_like(y, x), y]))
            differences[0] = max(differences[0], np.hypot(found["vx"] - velocity, found["vy"]).max())
        # Where the pressure of a step belongs: at its weighted time.
        _, gradient = flows.oscillating_flow(y, step.time - (1 - step.theta) * step.k)
        p = fields.sample([(0.0, flows.HEIGHT / 2), (_LENGTH, flows.HEIGHT / 2)])["p"]
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
        held = CATALOGUE["aneurysm-pulsatile"]
        base = held if self.pulsatile else CATALOGUE["aneurysm"]
        values: dict[str, Any] = {"mesh.level": level, "output.pictures": False, "output.vtu": False}
        if self.carreau:
            values["fluid"] = CATALOGUE["aneurysm-carreau"].model_dump()["fluid"]
        if self.held:
            values["support"] = held.model_dump()["support"]
        if self.pulsatile:  # twenty states per cycle: one of them is near the systole
            assert base.inflow is not None and base.inflow.period is not None
            values["time.output_interval"] = base.inflow.period / 20
        if not self.elastic:
            values |= dict.fromkeys(("solid", "mesh_motion", "support"))
        return with_values(base, values).model_copy(update={"name": f"aneurysm-{self.name}"})


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
        straight = flows.bent_flow(result.scene.fluid, inner, outer, found["flow_rate_in"]).gradient * math.pi / 2
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


RUNS = Path("runs/verify-blood")
CHECK = 1e-8
"""Largest accepted residual or difference that the independent checker finds, and the bound of the mass balance."""
PLANE, OSCILLATING, FAR, CHANGE, LONGEST = 1e-4, 5e-3, 3e-2, 1e-2, 900.0
CHANGES = {"wss_mean_dome": "WSS dome", "effective_stress_max": "effective stress"}
CASES = (*PLANE_CASES, *OSCILLATING_CASES, *ANEURYSM_CASES)


@dataclass(frozen=True)
class Row:
    """What one run, or several, come to."""

    group: str  # the group of rows that it belongs to
    case: str  # name of the run
    labels: tuple[str, ...]  # what its first cells say
    level: int  # mesh level
    numbers: Mapping[str, Measured] = field(default_factory=dict)  # by quantity
    failure: str = ""  # empty, or why there are hardly any numbers, as `Result.failure`

    @property
    def cells(self) -> dict[str, Any]:
        """What columns show: of each quantity `NAME`, its value, `NAME.reference` and `NAME.error`."""
        found: dict[str, Any] = {f"label {i}": label for i, label in enumerate(self.labels)}
        for name, item in self.numbers.items():
            found |= {name: item.value, f"{name}.reference": item.reference, f"{name}.error": item.error}
        return found | ({"seconds": f"failed ({self.failure})"} if self.failure else {})


@dataclass(frozen=True)
class BloodTable:
    """A table of one group of rows."""

    group: str  # its rows
    title: str  # on the terminal, and its name in the document
    labels: tuple[str, ...]  # headings of the first cells
    columns: Sequence[Column]  # the others
    finest: bool = False  # whether a short version has the rows of the finest mesh only

    @property
    def bounds(self) -> dict[str, float]:
        """The bound of each quantity, infinite if there is none."""
        found: dict[str, float] = {}
        for column in self.columns:
            name = str(column.of).partition(".")[0]
            found[name] = min(column.bound, found.get(name, math.inf))
        return found

    def of(self, rows: Iterable[Row], *, short: bool = False) -> TextTable:
        """Return the table of those rows of its group that failed or have one of its quantities."""
        own = [row for row in rows if row.group == self.group and (row.failure or self.bounds.keys() & row.numbers)]
        if short and self.finest:
            own = [row for row in own if row.level == max(row.level for row in own)]
        labels = [Column(head, f"label {i}") for i, head in enumerate(self.labels)]
        return table([row.cells for row in own], [*labels, *self.columns], title=self.title)


_WALLS = ("walls, blood", "level")
_CHECK = f"largest check = check :.0e < {CHECK}"


def _far(ending: str) -> list[Column]:
    return columns("|".join(
        f"{low:g}-{high:g}°: {title} = {name}_{what}{ending}.error :% < {FAR}"
        for name, (low, high) in RANGES.items()
        for what, title in (("pressure", "Δp"), ("inner", "inner"), ("outer", "outer"))
    ))  # fmt: skip


TABLES = (
    BloodTable("plane", "Plane channel", ("blood", "G Pa/m"),
        columns(f"unknowns :.0f | seconds :.1f | mean velocity m/s = mean :.6g | G = gradient.error :% < {PLANE} | "
            f"largest velocity = largest.error :% < {PLANE} | WSS = wall_shear_stress.error :% < {PLANE} | {_CHECK}")),
    BloodTable("oscillating", "Womersley's flow", ("level", "dt s"),
        columns(f"unknowns :.0f | steps :.0f | seconds :.1f | velocity = velocity_difference :% < {OSCILLATING} | "
            f"pressure drop = pressure_difference :% < {OSCILLATING} | {_CHECK}")),
    BloodTable("steady", "Steady aneurysm", _WALLS,
        columns(f"unknowns :.0f | seconds :.1f | mass balance = mass_balance :.0e < {CHECK} | "
            "pressure drop Pa = pressure_drop :.4f | without a dome Pa = pressure_drop.reference :.4f | "
            f"WSS dome Pa = wss_mean_dome :.5f | effective stress Pa = effective_stress_max :.1f | {_CHECK}"),
        finest=True),
    BloodTable("levels", "Changes by level", ("walls, blood",), columns("|".join(
        f"{title}, 1 to 2 = {name}_2 :% | {title}, 2 to 3 = {name}_3 :% < {CHANGE}"
        for name, title in CHANGES.items()))),
    BloodTable("steady", "Far from the dome", _WALLS, _far(""), finest=True),
    BloodTable("steady", "Slowed flow", _WALLS, _far(SLOWED), finest=True),
    BloodTable("pulsatile", "Pulsatile aneurysm", _WALLS,
        (*columns(f"unknowns :.0f | steps :.0f | seconds :.0f < {LONGEST} | per step = seconds_per_step :.3f | "
            "TAWSS mean Pa = tawss_mean_dome :.5f"), Column("min Pa (≥ 0)", "tawss_min_dome", "{:.5f}", least=0.0),
        *columns(f"OSI max = osi_max_dome :.0e | change = tawss_change :.0e < {CHANGE} | {_CHECK}"))),
)  # fmt: skip


def main(
    *, jobs: int = 1, out: Place = None, readme: Place = None, runs: Path = RUNS, cases: Sequence[BloodCase] = CASES
) -> list[str]:
    """Run everything, print its tables, and write them down. A second call goes on."""
    study = Study("verify --blood", out, readme, "blood")
    done = run_all({case.folder: case.scene() for case in cases}, runs, jobs, study.command)
    rows = [_row(case, run, runs / case.folder) for case, run in zip(cases, done, strict=True)]
    rows += level_changes(rows)
    whole, short = ({item.title: item.of(rows, short=part) for item in TABLES} for part in (False, True))
    return study.finish(
        [run.data for run in done], [item for item in whole.values() if item.body],
        {"blood.csv": lambda: to_frame(rows)}, "%.10g", whole=whole, short=short,
    )  # fmt: skip


def _row(case: BloodCase, run: Run, directory: Path) -> Row:
    """Return what a run comes to."""
    numbers = {"unknowns": float(run.data.get("unknowns") or "nan")}
    if run.failure:
        measured: dict[str, Measured] = {}
    else:
        numbers |= {"seconds": run.seconds, "check": run.check_maximum}
        measured = dict(case.measure(load_result(directory)))
        if len(run.history):
            measured["seconds_per_step"] = Measured(run.steps["seconds_per_step"])
    found = {name: Measured(value) for name, value in numbers.items()} | measured
    return Row(case.group, case.folder, case.labels, case.level, found, run.failure)


def level_changes(rows: Sequence[Row]) -> list[Row]:
    """Return a row for every steady variant: `wss_mean_dome_2`, the change from level 1 to 2 over the finer, ..."""
    steady = [row for row in rows if row.group == "steady" and not row.failure]
    found = []
    for label in dict.fromkeys(row.labels[0] for row in steady):
        own = sorted((row for row in steady if row.labels[0] == label), key=lambda row: row.level)
        numbers = {
            f"{name}_{finer.level}": Measured(1 - coarser.numbers[name].value / finer.numbers[name].value)
            for coarser, finer in itertools.pairwise(own)
            for name in CHANGES
            if name in finer.numbers and finer.level == coarser.level + 1
        }
        found.append(Row("levels", own[-1].case.rpartition("-level-")[0], (label,), own[-1].level, numbers))
    return found


def to_frame(rows: Iterable[Row]) -> pd.DataFrame:
    """Return one line per row and quantity; a row without numbers has one line.

    Columns: `group`, `case`, `level`, `failure`, `quantity`, `value`, `reference`, `error`, and `bound`, the largest
    accepted size of the error or, without a reference, of the value; NaN where there is none.
    """
    bounds = {(item.group, name): bound for item in TABLES for name, bound in item.bounds.items() if bound < math.inf}
    lines: list[dict[str, Any]] = []
    for row in rows:
        common = {name: getattr(row, name) for name in ("group", "case", "level", "failure")}
        lines += [
            common
            | {"quantity": name, "value": item.value, "reference": item.reference, "error": item.error}
            | {"bound": bounds.get((row.group, name), math.nan)}
            for name, item in row.numbers.items()
        ] or [common]
    return pd.DataFrame(lines)
