"""Walls that move, and loads on solids, for the templates: arrays with a value for each label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ffsi.scene import Boundary, Scene
from ffsi.scene.walls import points_of

_WALL = ("velocity_x", "velocity_y", "rotation", "centre_x", "centre_y")
_LOAD = ("traction_x", "traction_y", "pressure")
_STEPS_FOR_UNIT = 100


def moving_walls(scene: Scene, outline: list[Boundary]) -> dict[str, Any]:
    """Return the macros of the moving walls by name, and their speed as a formula; nothing without any."""
    names = [side.moving for side in outline if side.moving]
    if not names:
        return {"moving": {}, "displaced": []}
    values = {f"wall{camel(key)}": variables("walls", names, key) for key in _WALL}
    for key in _WALL:
        numbers = [float(getattr(scene.walls[name], key)) for name in names]
        unit = "/unitLength" if key.startswith("centre") else ""
        pairs = zip(names, numbers, values[f"wall{camel(key)}"], strict=True)
        values[f"wall{camel(key)}"] = [
            f"{value!r}{unit}" if is_fixed(f"walls.{name}.{key}", value) else variable
            for name, value, variable in pairs
        ]
    if scene.time:
        waves = [scene.walls[name].expression for name in names]
        inflow = "InflowFactor(at)" if scene.inflow else "1."
        values["wallFactors"] = [f"Ramp(at)*({wave.to_freefem()})" if wave else inflow for wave in waves]
    walls = [scene.walls[name] for name in names]
    place = {"x": "px", "y": "py"}
    displaced = [
        (j, [each.to_freefem(place) for each in (*d, *(axis.derivative("t") for axis in d))])
        for j, d in enumerate(wall.displacement for wall in walls)
        if walls[j].displaced
    ]
    speeds = [f"abs({x})" for key in ("VelocityX", "VelocityY") for x in values[f"wall{key}"]]
    speeds += [f"abs({x})*unitLength" for x in values["wallRotation"]]
    for side in outline:
        wall = scene.walls.get(side.moving or "")
        if wall and wall.displaced and scene.time and (points := points_of(side, scene.geometry)) is not None:
            # A unit: not of the end, which can become a later one while checkpoints hold numbers in it.
            rates = wall.movement(points, _STEPS_FOR_UNIT * scene.time.step)[1]
            speeds.append(repr(float(abs(rates[np.isfinite(rates)]).max(initial=0.0))))
    return {
        "moving": arrays(values),
        "speed_of_walls": " + ".join(speeds),
        "displaced": displaced,
        "wall_displaced": [wall.displaced for wall in walls],
    }


def is_fixed(key: str, value: float) -> bool:
    """Return whether a number is none that a script can vary: a wall would go through itself, a solid gain inertia."""
    if key.startswith("solid."):
        return key.endswith(".density") and value == 0
    if key.startswith("point_forces."):
        return key.endswith((".x", ".y"))
    return key.startswith("walls.") and (value == 0 or key.endswith((".centre_x", ".centre_y")))


def named_loads(scene: Scene, outline: list[Boundary]) -> dict[str, Any]:
    """Return the macros of the loads by name, and which of their pressures follow the surface; nothing without any."""
    names = [side.load or "" for side in outline if side.role == "loaded"]  # "": the scene's traction
    points = list(scene.point_forces)  # behind the boundaries
    if not names and not points:
        return {"loads": {}}
    values = {f"load{camel(key)}": variables("loads", names, key) for key in _LOAD}
    for key, variable in zip(_LOAD, ("tractionX", "tractionY", "0."), strict=True):
        values[f"load{camel(key)}"] = [
            one if name else variable for name, one in zip(names, values[f"load{camel(key)}"], strict=True)
        ]
    for axis in "xy" if points else "":
        values[f"loadTraction{axis.upper()}"] += variables("pointForces", points, f"force_{axis}")
        places = [getattr(scene.point_forces[name], axis) for name in points]
        values[f"loadPoint{axis.upper()}"] = [f"{place!r}/unitLength" for place in places]
    values["loadPressure"] += ["0."] * len(points)
    if scene.time:
        waves = [scene.loads[name].expression.to_freefem() if name else "1." for name in names]
        waves += [scene.point_forces[name].expression.to_freefem() for name in points]
        values["loadWaveforms"] = [f"({wave})" for wave in waves]
    follows = [bool(name) and scene.loads[name].following for name in names]
    return {"loads": arrays(values), "load_follows": follows + [False] * len(points)}


def is_held(scene: Scene, side: Boundary) -> bool:
    """Return whether a side is held by springs: the scene's support, or those of a load."""
    return side.role == "supported" or bool(side.load and scene.loads[side.load].springs)


def held_sides(scene: Scene, outline: list[Boundary]) -> dict[str, str]:
    """Return the macros of the springs that hold sides; nothing without any."""
    held = [side.load or "" for side in outline if is_held(scene, side)]
    values = {
        f"held{camel(key)}": [
            f"support{camel(key)}"
            if not name
            else "0."
            if getattr(scene.loads[name], key) is None
            else f"loads{camel(name)}{camel(key)}"
            for name in held
        ]
        for key in ("stiffness", "damping")
    }
    return arrays(values) if held else {}


def camel(key: str) -> str:
    """Return the words of a key as a part of the name of a variable."""
    return "".join(word.capitalize() for word in key.split("_"))


def variables(table: str, names: Sequence[str], key: str) -> list[str]:
    """Return the script's variables of a key of several tables."""
    return [f"{table}{camel(name)}{camel(key)}" for name in names]


def arrays(values: dict[str, list[str]]) -> dict[str, str]:
    """Return lists of texts as FreeFEM's arrays."""
    return {name: f"[{', '.join(texts)}]" for name, texts in values.items()}
