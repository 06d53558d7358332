"""A bent vessel with an elastic outer wall as a mesh file with names, to be broken in one place or another."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import tomli_w

from ffsi.scene import Scene, boundaries

INNER, LUMEN, OUTER = 10.0, 13.0, 14.0  # radii in mm: the rigid inner wall, the interface, the vessel's outside
TURN = np.pi / 3  # the angle through which the vessel bends
LUMEN_REGION, WALL_REGION = 1, 2
CURVES = {"in": 11, "out": 12, "inner": 13, "ends": 14, "outside": 15, "interface": 16}


@dataclass
class Drawing:
    """What a mesh file is made of; numbers of points count from 0."""

    points: np.ndarray
    triangles: np.ndarray
    region: np.ndarray
    lines: np.ndarray
    curve: np.ndarray
    names: dict[str, tuple[int, int]] = field(default_factory=dict)

    def write(self, path: Path, form: str = "gmsh22", data: str = "gmsh:physical") -> Path:
        cells = [("triangle", self.triangles), ("line", self.lines)]
        mesh = meshio.Mesh(
            self.points, cells, cell_data={data: [self.region, self.curve]},
            field_data={name: np.array(value) for name, value in self.names.items()},
        )  # fmt: skip
        if form.startswith("gmsh"):
            mesh.cell_data["gmsh:geometrical"] = mesh.cell_data[data]
        mesh.write(path, file_format=form)
        return path


def vessel(along: int = 6, across: int = 3, wall: int = 1) -> Drawing:
    """Return the vessel; its inlet is the radius at angle 0 turned by 0.3 radians, coordinates in mm."""
    radii = np.concatenate([np.linspace(INNER, LUMEN, across + 1), np.linspace(LUMEN, OUTER, wall + 1)[1:]])
    angles = 0.3 + np.linspace(0.0, TURN, along + 1)
    points = np.array([(r * np.cos(a), r * np.sin(a)) for a in angles for r in radii])
    width = len(radii)
    corner = lambda i, j: i * width + j  # noqa: E731
    triangles, region = [], []
    for i in range(along):
        for j in range(width - 1):
            a, b, c, d = corner(i, j), corner(i, j + 1), corner(i + 1, j + 1), corner(i + 1, j)
            triangles += [(a, b, c), (a, c, d)]
            region += [LUMEN_REGION if j < across else WALL_REGION] * 2
    lines, curve = [], []
    for j in range(width - 1):
        name = ("in", "out") if j < across else ("ends", "ends")
        for i, key in zip((0, along), name, strict=True):
            lines.append((corner(i, j), corner(i, j + 1)))
            curve.append(CURVES[key])
    for i in range(along):
        for j, key in ((0, "inner"), (width - 1, "outside"), (across, "interface")):
            lines.append((corner(i, j), corner(i + 1, j)))
            curve.append(CURVES[key])
    names = {"lumen": (LUMEN_REGION, 2), "wall": (WALL_REGION, 2), **{key: (n, 1) for key, n in CURVES.items()}}
    return Drawing(points, np.array(triangles), np.array(region), np.array(lines), np.array(curve), names)


def scene_table(file: str = "vessel.msh", **geometry: Any) -> dict[str, Any]:
    """Return the scene of the vessel; a key given as None is left out."""
    table = {
        "kind": "mesh", "file": file, "unit": "mm", "regions": {"fluid": "lumen", "wall": "wall"},
        "boundaries": {"inlet": "in", "outlet": "out", "walls": "inner", "clamped": "ends"}, **geometry,
    }  # fmt: skip
    return {
        "name": "vessel", "geometry": {key: value for key, value in table.items() if value is not None},
        "fluid": {"density": 1060, "viscosity": "3.5 mPa s"},
        "solid": {"wall": {"material": "neo-hookean", "density": 1100, "young_modulus": "40 kPa",
            "poisson_ratio": 0.4}},
        "inflow": {"mean_velocity": "5 cm/s"}, "outlet": {"kind": "do-nothing"},
    }  # fmt: skip


def write_scene(folder: Path, table: dict[str, Any] | None = None, drawing: Drawing | None = None) -> Path:
    """Write the vessel's mesh and its scene into a folder; return the scene's path."""
    (drawing or vessel()).write(folder / "vessel.msh")
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps(table or scene_table()))
    return path


def beam_scene(file: Path, clamped: str | int, region: str | int = "beam") -> Scene:
    return Scene.from_toml(
        tomli_w.dumps(
            {
                "name": "beam",
                "geometry": {"kind": "mesh", "file": str(file), "regions": {"beam": region},
                    "boundaries": {"clamped": clamped}},
                "solid": {"beam": {"material": "neo-hookean", "density": 1, "young_modulus": 1, "poisson_ratio": 0.3}},
            }
        )
    )  # fmt: skip


def lengths(found: Scene) -> dict[str, float]:
    return {boundary.name: round(boundary.exact_length, 9) for boundary in boundaries(found)}
