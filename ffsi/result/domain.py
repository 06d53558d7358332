"""What a scene is computed on, in numbers: the area of each region, role and length of each boundary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ffsi.files.arrays import RawMesh, distinct
from ffsi.result.fields import FLUID
from ffsi.scene import Scene, boundaries
from ffsi.scene.boundaries import Role

CONDITIONS: dict[Role, str] = {
    "inlet": "the fluid comes in with the given velocity",
    "outlet": "the fluid goes out, see the table outlet",
    "no-slip": "rigid wall of the fluid",
    "interface": "fluid and solid move together",
    "clamped": "the solid is held",
    "free": "nothing acts on the solid",
    "loaded": "the traction acts on the solid",
    "supported": "the elastic support acts on the solid",
    "slip": "no motion across, no friction along",
}
"""What each role of a boundary means."""
PRESSED = "the fluid comes in by the given pressure"


def intended(scene: Scene) -> dict[str, Any]:
    """Return what the scene says, before anything is meshed: the exact areas and lengths; of a mesh file, its own.

    `regions`: area in m^2 by name; `boundaries`: `role` and `length` in m by name.
    """
    lengths = {boundary.label: boundary.exact_length for boundary in boundaries(scene)}
    return {"regions": scene.exact_areas(), "boundaries": _by_name(scene, lengths)}


def meshed(scene: Scene, mesh: RawMesh) -> dict[str, Any]:
    """Return the same of the mesh that a run was computed on: of its straight triangles and edges."""
    corners = mesh.vertices[mesh.triangles]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    first = FLUID if scene.fluid is not None else FLUID + 1
    numbered = enumerate(scene.exact_areas(), start=first)
    regions = {name: float(areas[mesh.region == number].sum()) for number, name in numbered}
    ends = mesh.vertices[mesh.edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    by_label = {label: float(lengths[mesh.label == label].sum()) for label in distinct(mesh.label).tolist()}
    return {"regions": regions, "boundaries": _by_name(scene, by_label)}


def _by_name(scene: Scene, lengths: Mapping[int, float]) -> dict[str, dict[str, Any]]:
    """Return role and length of each boundary; a body part can have the name of another boundary."""
    found: dict[str, dict[str, Any]] = {}
    for boundary in boundaries(scene):
        name = boundary.name if boundary.name not in found else f"{boundary.name} (part)"
        # An inlet with a pressure has the natural condition of an outlet.
        role = "inlet" if boundary.opening in scene.inlet else boundary.role
        found[name] = {"role": role, "length": lengths.get(boundary.label, 0.0)}
    return found


def words(domain: Mapping[str, Any]) -> list[str]:
    """Return two lines: the regions with their areas, the boundaries with their roles and lengths."""
    regions = [f"{name} {area:.6g} m²" for name, area in domain["regions"].items()]
    sides = [
        f"{name}{'' if name == side['role'] else ' (' + side['role'] + ')'} {side['length']:.6g} m"
        for name, side in domain["boundaries"].items()
    ]
    return [f"regions: {', '.join(regions)}", f"boundaries: {', '.join(sides)}"]
