"""The same scene in other units of length, mass and time: what must not change a computation."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pint

from ffsi.hemodynamics.result import Result
from ffsi.result.quantities import unit
from ffsi.run.one_scene import solve
from ffsi.scene import CASES, MeshGeometry, Scene, load_scene
from ffsi.scene.flow import PROFILES, WOMERSLEY
from ffsi.scene.waveforms import named_waveforms
from ffsi.script.render import limits

FACTORS = [factors for factors in itertools.product((1e-6, 1.0, 1e6), repeat=3) if factors != (1.0, 1.0, 1.0)]
"""Factors on lengths, masses and times, every mixture of small and large units."""
WALL_CLOCK = ("solver.time_limit",)
_REGISTRY = pint.UnitRegistry()
_DIMENSIONS = ("[length]", "[mass]", "[time]")


def factor_of(unit: str, length: float, mass: float, time: float, exponent: float = 1.0) -> float:
    """Return by what a number in a unit is multiplied; `exponent` is the m of "Pa s^m"."""
    text = re.sub(r"\^m$", f"^({exponent!r})", unit)
    dimension = _REGISTRY.Quantity(1.0, text.replace(" s", "*s").replace("^", "**")).dimensionality
    powers = (float(dimension.get(name, 0)) for name in _DIMENSIONS)
    factor = 1.0
    for base, power in zip((length, mass, time), powers, strict=True):
        factor *= base**power
    return factor


def in_units(scene: Scene, length: float, mass: float, time: float, folder: Path | None = None) -> Scene:
    """Return the scene in which every number with a dimension is multiplied by these factors of its units.

    Formulas get their variables divided, so that their values stay; the mesh of a file is written to `folder` with
    other coordinates. Seconds on the wall's clock stay seconds.
    """
    table: dict[str, Any] = scene.model_dump(exclude_none=True)
    for key, value in scene.parameters().items():
        bounds = limits(scene, key)
        unit = getattr(bounds, "unit", "1")
        if unit == "1" or key in WALL_CLOCK:
            continue
        *path, last = key.split(".")
        inner = table
        for name in path:
            inner = inner[name]
        inner[last] = value * factor_of(unit, length, mass, time, inner.get("exponent", 1.0))
    inflow = table.get("inflow", {})
    if inflow and inflow["profile"] not in (*PROFILES, WOMERSLEY):
        inflow["profile"] = _divided(inflow["profile"], {"y": length, "H": length})
    if inflow.get("waveform") and inflow["waveform"] not in named_waveforms():
        inflow["waveform"] = _divided(inflow["waveform"], {"t": time})
    if isinstance(scene.geometry, MeshGeometry):
        assert folder is not None, "a mesh of a file needs a folder for the other one"
        stored = scene.geometry.store(folder)
        mesh = meshio.read(folder / stored.file)
        mesh.points = mesh.points * length
        mesh.write(folder / stored.file, file_format="medit")
        table["geometry"] |= stored.model_dump(include={"unit", "regions", "boundaries", "parts"}, exclude_none=True)
        table["geometry"]["file"] = str(folder / stored.file)
    return Scene.model_validate(table)


def _divided(formula: str, factors: dict[str, float]) -> str:
    for name, factor in factors.items():
        if factor != 1.0:
            formula = re.sub(rf"\b{name}\b", f"({name}/{factor!r})", formula)
    return formula


def differences(scaled: Result, result: Result, length: float, mass: float, time: float) -> dict[str, float]:
    """Return by how much a run in other units differs from the run: each field and quantity, relative to its size."""
    assert scaled.converged, scaled.reason
    assert result.converged, result.reason
    found: dict[str, float] = {}
    for field, of in {"displacement": "m", "velocity": "m/s", "pressure": "Pa"}.items():
        here = getattr(result.fields, field)
        there = getattr(scaled.fields, field) / factor_of(of, length, mass, time)
        found[field] = float(np.nanmax(np.abs(there - here), initial=0.0)) / max(np.nanmax(np.abs(here)), 1e-300)
    here, there = result.last_quantities, scaled.last_quantities
    assert here.keys() == there.keys()
    size = {"1": 1.0}  # of all in a unit: a lift that is rounding beside the drag is no size of its own
    for name, value in here.items():
        size[unit(name)] = max(size.get(unit(name), 0.0), abs(value))
    for name, value in here.items():
        other = there[name] / factor_of(unit(name), length, mass, time)
        found[name] = abs(other - value) / max(size[unit(name)], 1e-300)
    return found


def first_steps(case: str, count: int) -> list[str]:
    """Return the settings that end a case of the catalogue after some steps; none of a steady one."""
    time = CASES[case].time
    if time is None:
        return []
    end = f"{count * time.step!r}"
    return [f"time.end={end}", f"time.output_interval={end}", "time.stop=end"]


def compare(case: str, settings: list[str], length: float, mass: float, time: float, folder: Path) -> float:
    """Solve a scene and the same in other units; return the largest difference, with the same iterations."""
    scene = load_scene(case, settings)
    result = solve(scene, folder / "here")
    scaled = solve(in_units(scene, length, mass, time), folder / "there")
    found = differences(scaled, result, length, mass, time)
    worst = max(found, key=lambda name: found[name])
    print(f"{case} with units of {length:g}, {mass:g}, {time:g}: {worst} {found[worst]:.1e}")
    count = "iterations" if scene.time else "iteration"
    assert scaled.history[count].tolist() == result.history[count].tolist()
    return found[worst]
