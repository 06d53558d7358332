"""Walls that move along themselves, for the templates."""

from __future__ import annotations

from typing import Any

from ffsi.scene import Boundary, Scene

_NUMBERS = ("velocity_x", "velocity_y", "rotation", "centre_x", "centre_y")


def moving_walls(scene: Scene, outline: list[Boundary]) -> dict[str, Any]:
    """Return the macros of the script by name: arrays with a value for each label of a moving wall; nothing without."""
    names = [side.moving for side in outline if side.moving]
    if not names:
        return {"moving": {}}

    def variables(key: str) -> list[str]:
        words = "".join(word.capitalize() for word in key.split("_"))
        return [f"walls{name.capitalize()}{words}" for name in names]

    values = {"wall" + "".join(word.capitalize() for word in key.split("_")): variables(key) for key in _NUMBERS}
    if scene.time:
        waves = [scene.walls[name].expression for name in names]
        values["wallFactors"] = [f"Ramp(at)*({wave.to_freefem()})" if wave else "InflowFactor(at)" for wave in waves]
    speeds = [f"abs({x})" for key in _NUMBERS[:2] for x in variables(key)]
    speeds += [f"abs({x})*unitLength" for x in variables("rotation")]
    macros = {name: f"[{', '.join(texts)}]" for name, texts in values.items()}
    return {"moving": macros, "speed_of_walls": " + ".join(speeds)}
