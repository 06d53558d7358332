"""The boundaries of a scene: those of its geometry, and what the scene's tables by name make of them."""

from __future__ import annotations

from dataclasses import replace

from ffsi.scene.boundaries import Boundary
from ffsi.scene.model import Scene


def boundaries(scene: Scene) -> list[Boundary]:
    """Return the boundaries of the scene, sorted by label.

    Vertices lie on the circles of all arcs; given displacements move mid-edge nodes of no-slip boundaries only.
    """
    found = scene.geometry.outline(scene.physics)
    if scene.support is not None:
        found = [replace(boundary, role="supported") if boundary.outer else boundary for boundary in found]
    if scene.geometry.kind != "mesh":  # a mesh knows its own
        found = [_told(scene, side) for side in found]
    pressed = [name for name, inlet in scene.inlet.items() if inlet.pressure is not None]
    found = [
        replace(side, role="outlet") if side.role == "inlet" and side.opening in pressed else side for side in found
    ]
    return sorted(found, key=lambda boundary: boundary.label)


def _told(scene: Scene, side: Boundary) -> Boundary:
    """Return a boundary of a built-in geometry as the scene's tables by name say it is."""
    name = side.name
    match side.role:
        case "no-slip" if name in scene.walls:
            return replace(side, moving=name)
        case "free" if name in scene.loads:
            return replace(side, role="loaded", load=name)
        case "inlet" if name in scene.inlet:
            return replace(side, opening=name)
        case "outlet" if name in scene.outlets:
            return replace(side, opening=name)
    return side
