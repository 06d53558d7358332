"""Scenes of `studies.verification.acid`: tests from the literature on structured meshes that are made here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from ffsi.files.arrays import Floats
from ffsi.scene import Scene

Name = Callable[[float, float], str]
"""Name of the boundary on which the middle of an edge, or of the region in which a point, lies; empty in none."""
Place = Callable[[Floats], Floats]
Scenes = dict[str, Scene]

# Meshes -----------------------------------------------------------------------------------------------------------


def grid(
    path: Path, x: Floats, y: Floats, region: Name, curve: Name, place: Callable[[Floats], Floats] = np.copy
) -> Path:
    """Write a mesh of the rectangles between grid lines, each split in two, its points (n, 2) moved by `place`."""
    nx, triangles, regions = len(x), [], []
    for j in range(len(y) - 1):
        for i in range(nx - 1):
            if name := region((x[i] + x[i + 1]) / 2, (y[j] + y[j + 1]) / 2):
                a = j * nx + i
                b, c, d = a + 1, a + 1 + nx, a + nx
                triangles += [(a, b, c), (a, c, d)] if (i + j) % 2 == 0 else [(a, b, d), (b, c, d)]
                regions += [name, name]
    flat = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    used, kept = np.unique(triangles, return_inverse=True)
    flat, cells = flat[used], kept.reshape(-1, 3)
    sides = np.sort(cells[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    named = [(edge, name) for edge in edges[count == 1] if (name := curve(*flat[edge].mean(axis=0)))]
    surfaces, lines = sorted(set(regions)), sorted({name for _, name in named})
    data = [np.array([surfaces.index(name) + 1 for name in regions]), np.array([lines.index(n) + 1 for _, n in named])]
    path.parent.mkdir(parents=True, exist_ok=True)
    meshio.Mesh(
        place(flat),
        [("triangle", cells), ("line", np.array([edge for edge, _ in named]))],
        cell_data={"gmsh:physical": data, "gmsh:geometrical": data},
        field_data={name: np.array([i + 1, 2]) for i, name in enumerate(surfaces)}
        | {name: np.array([i + 1, 1]) for i, name in enumerate(lines)},
    ).write(path, file_format="gmsh22")
    return path


def dense(start: float, end: float, n: int, share: float = 0.7) -> Floats:
    """Return n + 1 points that lie closer at both ends: there 1 - share of the mean distance apart."""
    s = np.linspace(0, 1, n + 1)
    return np.asarray(np.round(start + (end - start) * (s - share * np.sin(2 * np.pi * s) / (2 * np.pi)), 12))


def widening(first: float, growth: float, most: float, end: float) -> Floats:
    """Return points from 0 to an end, at first so far apart, then more by a factor, up to a most."""
    x, step = [0.0], first
    while x[-1] < end:
        x.append(x[-1] + step)
        step = min(step * growth, most)
    return np.array(x) * end / x[-1]


def turned(flat: Floats) -> Floats:
    """Return the points of radii and angles."""
    points: Floats = flat[:, :1] * np.column_stack([np.cos(flat[:, 1]), np.sin(flat[:, 1])])
    points[np.isclose(flat[:, 1], np.pi / 2), 0] = 0
    return points


def scene(name: str, mesh: Path, regions: Mapping[str, str], boundaries: Mapping[str, Any], **tables: Any) -> Scene:
    """Return a scene on a mesh of `grid`; its tip is at (x, y)."""
    x, y = tables.pop("tip")
    geometry = {"kind": "mesh", "file": str(mesh), "regions": regions, "boundaries": boundaries}
    geometry["tip"] = {"x": x, "y": y}
    plain = {"output": {"pictures": False, "vtu": False}}
    flows = {"outlet": {"kind": "do-nothing"}} if "fluid" in tables else {}
    return Scene.model_validate({"name": f"acid-{name}", "geometry": geometry, **plain, **flows, **tables})


def elastic(material: str, density: float, young: float, poisson: float) -> dict[str, Any]:
    """Return a table of a solid."""
    return {"material": material, "density": density, "young_modulus": young, "poisson_ratio": poisson}


def three(name: str, make: Callable[[Path, int, float], Scene], folder: Path, step: float, n: int = 1) -> Scenes:
    """Two meshes and two steps."""
    return {f"{name}-{m}-{k:g}": make(folder, m, k) for m, k in ((n, step), (2 * n, step), (2 * n, step / 2))}


def joined(groups: Iterable[Scenes]) -> Scenes:
    """Return all scenes of groups."""
    return {name: one for group in groups for name, one in group.items()}


# A cylinder under pressure ------------------------------------------------------------------------------------------

INNER, OUTER, SHEAR, PRESSURE = 1.0, 2.0, 1.0, 0.4


def cylinder(folder: Path) -> Scenes:
    """A quarter of a thick incompressible neo-Hookean cylinder between its lines of symmetry, on three meshes."""
    law = {"material": "neo-hookean", "formulation": "incompressible", "density": 1.0, "lame_mu": SHEAR}

    def curve(r: float, angle: float) -> str:
        return {0.0: "x", np.pi / 2: "y"}.get(angle) or {INNER: "inside", OUTER: "outside"}.get(r, "")

    found = {}
    for n in (8, 16, 32):
        radii, angles = np.linspace(INNER, OUTER, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1)
        mesh = grid(folder / f"cylinder{n}.msh", radii, angles, lambda r, angle: "rubber", curve, turned)
        found[f"cylinder-{n}"] = scene(
            "cylinder", mesh, {"rubber": "rubber"}, {"symmetry": ["x", "y"], "loaded": "inside"}, tip=(INNER, 0.0),
            solid={"rubber": law}, loads={"inside": {"pressure": PRESSURE}},
        )  # fmt: skip
    return found


# Ring in a fluid ----------------------------------------------------------------------------------------------------

SWINGS = {14: (0.05, 10.4), 140: (0.07, 14.28), 1400: (0.18, 36.0)}  # step and end of each density, four periods
SLIT = 0.01
AMPLITUDE = 5e-4


def ring(folder: Path) -> Scenes:
    """Two meshes and two steps of each density of the fluid."""
    return joined(three(f"ring-{rho}", partial(_ring, rho), folder, SWINGS[rho][0], 2) for rho in SWINGS)


def _ring(rho: float, folder: Path, n: int, step: float) -> Scene:
    """A quarter of ring and fluid, let go in its second mode.

    A fluid needs an inlet and an outlet: one edge at which nothing flows in, and a slit at 45 degrees, where the mode
    has no pressure, with a resistance that lets nothing out.
    """
    half = np.linspace(0, (np.pi / 2 - SLIT) / 2, 4 * n + 1)
    angles = np.concatenate([half, np.pi / 2 - half[::-1]])
    radii = np.concatenate([np.linspace(0.95, 1.05, n + 1)[:-1], dense(1.05, 1.5, 5 * n, 0.9)])

    def curve(r: float, angle: float) -> str:
        if angle in (0.0, np.pi / 2) or r < 1.5:
            return {0.0: "x", np.pi / 2: "y"}.get(angle, "")
        return "slit" if abs(angle - np.pi / 4) < SLIT / 2 else "rest" if angle < angles[1] else "wall"

    mesh = grid(folder / f"ring{n}.msh", radii, angles, lambda r, angle: "ring" if r < 1.05 else "water", curve, turned)
    cubed, turn = f"{AMPLITUDE}/sqrt(x^2+y^2)^3", "(1.5*sqrt(x^2+y^2)-2)"
    return scene(
        "ring", mesh, {"fluid": "water", "ring": "ring"},
        {"inlet": "rest", "outlet": "slit", "walls": "wall", "symmetry": ["x", "y"]}, tip=(1.05, 0.0),
        fluid={"density": rho, "viscosity": 1e-3 * rho}, solid={"ring": elastic("linear-elastic", 1000.0, 1e6, 0.3)},
        inflow={"mean_velocity": 0.0}, outlet={"kind": "resistance", "resistance": 1e9},
        start={
            "displacement_x": f"{cubed}*x*(x^2-y^2-2*y^2*{turn})",
            "displacement_y": f"{cubed}*y*(x^2-y^2+2*x^2*{turn})",
        },
        time={"scheme": "crank-nicolson", "step": step, "end": SWINGS[int(rho)][1]},
    )  # fmt: skip


# Collapsible channel ------------------------------------------------------------------------------------------------

WALLS = {"1": 1.0, "0.1": 0.1, "massless": 1e-3}


def collapsible(folder: Path) -> Scenes:
    """Two meshes and two steps of each density of the wall."""
    return joined(three(f"collapsible-{name}", partial(_collapsible, WALLS[name]), folder, 0.0125) for name in WALLS)


def _collapsible(rho: float, folder: Path, n: int, step: float) -> Scene:
    """A channel whose roof gives way, one element thick."""

    def region(x: float, y: float) -> str:
        return "water" if y < 1 else "wall" if 5 < x < 15 else ""

    def curve(x: float, y: float) -> str:
        if y > 1:
            return "above" if y == 1.05 else "ends"
        return {0.0: "in", 25.0: "out"}.get(x) or ("rigid" if y in (0.0, 1.0) else "")

    up, down = np.linspace(1, 0, 6 * n + 1) ** 1.6, np.linspace(0, 1, 8 * n + 1) ** 1.6
    x = np.concatenate([5 - 5 * up, dense(5, 15, 16 * n)[1:], 15 + 10 * down[1:]])
    mesh = grid(folder / f"collapsible{n}.msh", x, np.array([*dense(0, 1, 5 * n), 1.05]), region, curve)
    return scene(
        "collapsible", mesh, {"fluid": "water", "wall": "wall"},
        {"inlet": "in", "outlet": "out", "walls": "rigid", "clamped": "ends", "loaded": "above"}, tip=(10.0, 1.0),
        fluid={"density": 1.0, "viscosity": 0.02}, solid={"wall": elastic("st-venant-kirchhoff", rho, 4.55e8, 0.3)},
        loads={"above": {"pressure": 200.0, "waveform": "(1-cos(4*pi*min(t,0.25)))/2"}},
        inlet={"in": {"pressure": 6.0, "direction": "normal"}}, start={"velocity_x": "6*y*max(1-y,0)"},
        time={"step": step, "end": 1.5},
    )  # fmt: skip


# Lid-driven cavity with a flexible bottom, group B ------------------------------------------------------------------


def mok(folder: Path, end: float = 45.0) -> Scenes:
    """Two meshes and two steps."""
    return three("mok", partial(_mok, end), folder, 0.1, 16)


def _mok(end: float, folder: Path, n: int, step: float) -> Scene:
    """The cavity with n x n rectangles, and its membrane of two rows under it."""
    thick = 0.002

    def curve(x: float, y: float) -> str:
        if x in (0.0, 1.0):
            return "ends" if y < 0 else {0.0: "in", 1.0: "out"}[x] if y > 0.875 else "sides"
        return {1.0: "lid"}.get(y, "")

    lines = np.linspace(0, 1, n + 1)
    rows = np.concatenate([[-thick, -thick / 2], lines])
    mesh = grid(folder / f"mok{n}.msh", lines, rows, lambda x, y: "water" if y > 0 else "membrane", curve)
    return scene(
        "mok", mesh, {"fluid": "water", "bottom": "membrane"},
        {"inlet": "in", "outlet": "out", "walls": ["sides", "lid"], "clamped": "ends"}, tip=(0.5, -thick / 2),
        walls={"lid": {"velocity_x": 1.0}}, fluid={"density": 1.0, "viscosity": 0.01},
        solid={"bottom": elastic("st-venant-kirchhoff", 500.0, 250.0, 0.0)},
        inflow={"mean_velocity": 0.5, "profile": "2*y/H", "waveform": "1-cos(2*pi*t/5)", "period": 5.0},
        time={"step": step, "end": end, "checkpoint_interval": 5.0},
    )  # fmt: skip


# Perpendicular flap -------------------------------------------------------------------------------------------------


def flap(folder: Path) -> Scenes:
    """Two meshes and two steps, of a linear elastic solid."""
    return three("flap", _flap, folder, 0.02)


def _flap(folder: Path, n: int, step: float) -> Scene:
    """The channel with 2 n elements across the flap."""
    half = 0.05

    def curve(x: float, y: float) -> str:
        if y in (0.0, 4.0):
            return "root" if y == 0 and abs(x) < half else "walls"
        return {-3.0: "in", 3.0: "out"}.get(x, "")

    away = half + (3 - half) * np.linspace(0, 1, 12 * n + 1) ** 2
    x = np.concatenate([-away[::-1], np.linspace(-half, half, 2 * n + 1)[1:-1], away])
    y = np.concatenate([np.linspace(0, 1, 10 * n + 1), 1 + 3 * np.linspace(0, 1, 8 * n + 1)[1:] ** 1.5])
    mesh = grid(folder / f"flap{n}.msh", x, y, lambda x, y: "steel" if abs(x) < half and y < 1 else "water", curve)
    return scene(
        "flap", mesh, {"fluid": "water", "flap": "steel"},
        {"inlet": "in", "outlet": "out", "walls": "walls", "clamped": "root"}, tip=(0.0, 1.0),
        fluid={"density": 1.0, "viscosity": 1.0}, solid={"flap": elastic("linear-elastic", 3000.0, 4e6, 0.3)},
        inflow={"mean_velocity": 10.0, "profile": "uniform"}, time={"step": step, "end": 2.6},
    )  # fmt: skip


# Blob in treacle ----------------------------------------------------------------------------------------------------


def blob(folder: Path) -> Scenes:
    """Steady on two meshes; to 1 s on two meshes and with two steps."""
    return {f"blob-{n}": _blob(folder, n) for n in (2, 4)} | three("blob-1s", _blob, folder, 0.05)


def _blob(folder: Path, n: int, step: float = 0.0) -> Scene:
    """A half disk on the floor: a rectangle of the grid, bent with what is around it."""

    def bent(flat: Floats) -> Floats:
        away = flat - [1.5, -0.5]
        size = np.abs(away).max(axis=1)
        weight = np.clip(np.where(size < 0.5, 2 * size, 2 - 2 * size), 0, 1)
        return np.asarray(flat + away * (weight * (size / np.maximum(np.hypot(*away.T), 1e-9) - 1))[:, None])

    def curve(x: float, y: float) -> str:
        if y == -0.5:
            return "base" if 1 < x < 2 else "walls"
        return {0.0: "in", 6.5: "out"}.get(x) or {1.0: "walls"}.get(y, "")

    down = 2 + 4.5 * np.linspace(0, 1, 8 * n + 1) ** 1.3
    x = np.concatenate([np.linspace(0, 1, 4 * n + 1), np.linspace(1, 2, 6 * n + 1)[1:], down[1:]])
    y = np.concatenate([np.linspace(-0.5, 0, 3 * n + 1), np.linspace(0, 1, 5 * n + 1)[1:]])
    mesh = grid(folder / f"blob{n}.msh", x, y, lambda x, y: "blob" if 1 < x < 2 and y < 0 else "water", curve, bent)
    law = {"material": "linear-elastic", "density": 1.0, "lame_lambda": 500.0, "lame_mu": 50.0}
    in_time: dict[str, Any] = {"time": {"step": step, "end": 1.0}} if step else {}
    return scene(
        "blob", mesh, {"fluid": "water", "blob": "blob"},
        {"inlet": "in", "outlet": "out", "walls": "walls", "clamped": "base"}, tip=(1.5, 0.0),
        fluid={"density": 1.0, "viscosity": 1.0}, solid={"blob": law},
        inflow={"mean_velocity": 0.75} | ({"ramp": 2.0} if step else {}), **in_time,
    )  # fmt: skip


# Leaflet in a channel -----------------------------------------------------------------------------------------------

THICK = (0.05, 0.025, 0.0125)


def leaflet(folder: Path) -> Scenes:
    """Two meshes and two steps of the middle thickness, and the finest of them of the others."""
    every = joined(three(f"leaflet-{h}", partial(_leaflet, h), folder, 0.02) for h in THICK)
    return {name: one for name, one in every.items() if f"-{THICK[1]}-" in name or name.endswith("-2-0.01")}


def _leaflet(thick: float, folder: Path, n: int, step: float) -> Scene:
    """A leaflet of a beam's bending stiffness and mass per length at every thickness, two elements across."""
    half, ratio = thick / 2, THICK[0] / thick

    def curve(x: float, y: float) -> str:
        if y in (0.0, 1.0):
            return "root" if y == 0 and abs(x - 1) < half else "walls"
        return {0.0: "in", 8.0: "out"}.get(x, "")

    up, down = widening(0.04 / n, 1.2, 0.5 / n, 1 - half), widening(0.04 / n, 1.15, 0.24 / n, 7 - half)
    x = np.round(np.concatenate([1 - half - up[::-1], [1.0], 1 + half + down]), 12)
    y = np.concatenate([np.linspace(0, 0.5, 8 * n + 1), 0.5 + widening(1 / 32 / n, 1.2, 0.12 / n, 0.5)[1:]])
    mesh = grid(
        folder / f"leaflet{thick}-{n}.msh", x, y, lambda x, y: "leaflet" if abs(x - 1) < half and y < 0.5 else "water",
        curve,
    )  # fmt: skip
    return scene(
        "leaflet", mesh, {"fluid": "water", "leaflet": "leaflet"},
        {"inlet": "in", "outlet": "out", "walls": "walls", "clamped": "root"}, tip=(1.0, 0.5),
        fluid={"density": 1.0, "viscosity": 0.005},
        solid={"leaflet": elastic("st-venant-kirchhoff", ratio, 4550 * ratio**3, 0.3)},
        inflow={"mean_velocity": 1.0, "ramp": 1.0, "waveform": "1.5-0.5*cos(pi*t)", "period": 2.0},
        mesh_motion={"kind": "hyperelastic"}, time={"step": step, "end": 1.0},
    )  # fmt: skip
