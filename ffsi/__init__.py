"""Strongly coupled fluid-structure interaction in 2D: monolithic ALE in FreeFEM, driven and verified from Python.

import ffsi

result = ffsi.solve(ffsi.load_scene("turek-fsi1", ["mesh.level=1"]))
result.quantities["drag"]  # N per metre depth
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ffsi.hemodynamics.result import Result, load_result
    from ffsi.run.solve import resume, solve
    from ffsi.run.sweep import sweep
    from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values

__all__ = [
    "CASES",
    "Result",
    "Scene",
    "SceneError",
    "load_result",
    "load_scene",
    "resume",
    "solve",
    "sweep",
    "with_values",
]

_HOMES = {
    **dict.fromkeys(("CASES", "Scene", "SceneError", "load_scene", "with_values"), "ffsi.scene"),
    **dict.fromkeys(("Result", "load_result"), "ffsi.hemodynamics.result"),
    **dict.fromkeys(("resume", "solve"), "ffsi.run.solve"),
    "sweep": "ffsi.run.sweep",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: the command line must not wait for matplotlib."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'ffsi' has no attribute {name!r}")
