"""Mesh files of structured meshes, the scenes that read them, and their checked results."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ffsi.files.arrays import RawMesh
from ffsi.hemodynamics.result import Result
from ffsi.run.one_scene import solve
from ffsi.scene import Scene


def write_mesh(path: Path, mesh: RawMesh, regions: Mapping[str, int], curves: Mapping[str, int]) -> Path:
    """Write a mesh with the names of its regions and labels in Gmsh's format, lengths in m."""
    data = [mesh.region, mesh.label]
    meshio.Mesh(
        mesh.vertices, [("triangle", mesh.triangles), ("line", mesh.edges)],
        cell_data={"gmsh:physical": data, "gmsh:geometrical": data},
        field_data={name: np.array([number, 2]) for name, number in regions.items()} | {name: np.array([number,
            1]) for name, number in curves.items()},
    ).write(path, file_format="gmsh22")  # fmt: skip
    return path


def checked(scene: Scene, folder: Path, **options: Any) -> Result:
    """Solve a scene; the checker has nothing to say."""
    result = solve(scene, folder, **options)
    assert result.checked, result.reason
    return result


def scene_on(path: Path, boundaries: Mapping[str, Any], regions: Mapping[str, str], **tables: Any) -> Scene:
    geometry = {"kind": "mesh", "file": str(path), "regions": dict(regions), "boundaries": dict(boundaries)}
    geometry |= {key: tables.pop(key) for key in ("inlets", "parts", "curved") if key in tables}
    return Scene.model_validate(
        {"name": "own", "geometry": geometry, "output": {"pictures": False, "vtu": False}, **tables}
    )
