"""Strongly coupled fluid-structure interaction in 2D: monolithic ALE in FreeFEM, driven and verified from Python.

    import ffsi

    result = ffsi.solve("turek-fsi1")  # a case of ffsi.CASES, the path of a TOML file, or a scene
    result.quantities["drag"]  # N per metre depth

    scene = ffsi.load_scene("turek-fsi1", ["mesh.level=1", "fluid.viscosity=0.9 Pa s"])
    scene = ffsi.with_values(scene, {"inflow.mean_velocity": 0.25})
    table = ffsi.sweep(scene, {"fluid.density": [900, 1000]}, "runs/densities")  # pandas
    figure = ffsi.Study("runs/densities").plot("fluid.density", "drag")  # matplotlib

Numbers are SI; a scene also takes strings with a unit. `python -m ffsi --help` is the command line.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ffsi.files.errors import InputError
    from ffsi.freefem import FreeFEMError
    from ffsi.hemodynamics.result import Result
    from ffsi.report.study import Study
    from ffsi.run.direct import load_result
    from ffsi.run.levels import levels
    from ffsi.run.one_scene import resume, solve
    from ffsi.run.sensitivities import sensitivities
    from ffsi.run.sweep import sweep
    from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values

__all__ = [
    "CASES",
    "FreeFEMError",
    "InputError",
    "Result",
    "Scene",
    "SceneError",
    "Study",
    "levels",
    "load_result",
    "load_scene",
    "resume",
    "sensitivities",
    "solve",
    "sweep",
    "with_values",
]

_HOMES = {
    **dict.fromkeys(("CASES", "Scene", "SceneError", "load_scene", "with_values"), "ffsi.scene"),
    "Result": "ffsi.hemodynamics.result",
    "load_result": "ffsi.run.direct",
    **dict.fromkeys(("resume", "solve"), "ffsi.run.one_scene"),
    "FreeFEMError": "ffsi.freefem",
    "InputError": "ffsi.files.errors",
    "Study": "ffsi.report.study",
    "levels": "ffsi.run.levels",
    "sensitivities": "ffsi.run.sensitivities",
    "sweep": "ffsi.run.sweep",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: the command line must not wait for matplotlib."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'ffsi' has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names, whether they were used or not."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
