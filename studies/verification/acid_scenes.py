"""Scenes of `studies.verification.acid`: tests from the literature, on structured meshes that are made here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import meshio
import numpy as np

from ffsi.files.arrays import Floats
from ffsi.scene import Scene, with_values

Name = Callable[[float, float], str]
"""Name of the boundary on which the middle of an edge, or of the region in which a point, lies; empty in none."""


class Grid(NamedTuple):
    """A mesh of the rectangles between lines, each split in two."""

    x: Floats
    y: Floats
    region: Name
    curve: Name
    place: Callable[[Floats], Floats] = np.copy  # moves its points (n, 2)


def scenes_of(test: str, table: Mapping[str, Any], folder: Path) -> dict[str, Scene]:
    """Return the scenes of a test by the names of their runs, its table as in studies/data/acid.toml."""
    return {name: scene for series in table["series"] for name, scene in _of_series(test, table, series, folder)}


def _of_series(
    test: str, table: Mapping[str, Any], series: Mapping[str, Any], folder: Path
) -> Iterator[tuple[str, Scene]]:
    n, step, more = series.get("n", 0), series.get("step", 0.0), series.get("more", {})
    plan = [(m, 0.0) for m in series.get("meshes", ())] or [(n, step), (2 * n, step), (2 * n, step / 2)]
    if finer := series.get("finer"):
        plan = [(n, step / 2), (n, step), (finer, step)]
    for m, k in plan[-1:] if series.get("finest") else plan:
        mesh = write(folder / f"{test}{m}{''.join(f'-{value}' for value in more.values())}.msh", GRIDS[test](m, **more))
        own = {"geometry": {"kind": "mesh", "file": str(mesh), **table["scene"]["geometry"]}}
        plain = {"name": f"acid-{test}", "output": {"pictures": False, "vtu": False}}
        scene = Scene.model_validate({**table["scene"], **own, **plain})
        values = {**series.get("set", {}), **({"time.step": k} if k else {})}
        yield f"{series['name']}-{m}" + (f"-{k:g}" if k else ""), with_values(scene, values)


# Meshes ---------------------------------------------------------------------------------------------------------------


def write(path: Path, grid: Grid) -> Path:
    """Write a mesh in Gmsh's format."""
    x, y, region, curve, place = grid
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


def over_floor(
    sides: tuple[float, float], levels: tuple[float, float], body: tuple[float, float], held: str = "root"
) -> Name:
    """Return the curves of a channel between two sides, floor and ceiling, on whose floor a body stands."""

    def curve(x: float, y: float) -> str:
        if y in levels:
            return held if y == levels[0] and body[0] < x < body[1] else "walls"
        return {sides[0]: "in", sides[1]: "out"}.get(x, "")

    return curve


INNER, OUTER = 1.0, 2.0  # radii of the cylinder
SLIT = 0.01  # in the ring's outer wall, rad


def cylinder(n: int) -> Grid:
    """A quarter of the cylinder, n elements across."""

    def curve(r: float, angle: float) -> str:
        return {0.0: "x", np.pi / 2: "y"}.get(angle) or {INNER: "inside", OUTER: "outside"}.get(r, "")

    radii, angles = np.linspace(INNER, OUTER, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1)
    return Grid(radii, angles, lambda r, angle: "rubber", curve, turned)


def ring(n: int) -> Grid:
    """A quarter of ring and fluid, n elements across the ring."""
    half = np.linspace(0, (np.pi / 2 - SLIT) / 2, 4 * n + 1)
    angles = np.concatenate([half, np.pi / 2 - half[::-1]])
    radii = np.concatenate([np.linspace(0.95, 1.05, n + 1)[:-1], dense(1.05, 1.5, 5 * n, 0.9)])

    def curve(r: float, angle: float) -> str:
        if angle in (0.0, np.pi / 2) or r < 1.5:
            return {0.0: "x", np.pi / 2: "y"}.get(angle, "")
        return "slit" if abs(angle - np.pi / 4) < SLIT / 2 else "rest" if angle < angles[1] else "wall"

    return Grid(radii, angles, lambda r, angle: "ring" if r < 1.05 else "water", curve, turned)


def collapsible(n: int) -> Grid:
    """A channel whose roof gives way, one element thick."""

    def region(x: float, y: float) -> str:
        return "water" if y < 1 else "wall" if 5 < x < 15 else ""

    def curve(x: float, y: float) -> str:
        if y > 1:
            return "above" if y == 1.05 else "ends"
        return {0.0: "in", 25.0: "out"}.get(x) or ("rigid" if y in (0.0, 1.0) else "")

    up, down = np.linspace(1, 0, 6 * n + 1) ** 1.6, np.linspace(0, 1, 8 * n + 1) ** 1.6
    x = np.concatenate([5 - 5 * up, dense(5, 15, 16 * n)[1:], 15 + 10 * down[1:]])
    return Grid(x, np.array([*dense(0, 1, 5 * n), 1.05]), region, curve)


def leaflet(n: int, thick: float) -> Grid:
    """The channel with 2 elements across the leaflet, whose thickness is in m."""
    half = thick / 2
    up, down = widening(0.04 / n, 1.2, 0.5 / n, 1 - half), widening(0.04 / n, 1.15, 0.24 / n, 7 - half)
    x = np.round(np.concatenate([1 - half - up[::-1], [1.0], 1 + half + down]), 12)
    y = np.concatenate([np.linspace(0, 0.5, 8 * n + 1), 0.5 + widening(1 / 32 / n, 1.2, 0.12 / n, 0.5)[1:]])
    curve = over_floor((0.0, 8.0), (0.0, 1.0), (1 - half, 1 + half))
    return Grid(x, y, lambda x, y: "leaflet" if abs(x - 1) < half and y < 0.5 else "water", curve)


def blob(n: int) -> Grid:
    """A half disk on the floor: a rectangle of the grid, bent with what is around it."""

    def bent(flat: Floats) -> Floats:
        away = flat - [1.5, -0.5]
        size = np.abs(away).max(axis=1)
        weight = np.clip(np.where(size < 0.5, 2 * size, 2 - 2 * size), 0, 1)
        return np.asarray(flat + away * (weight * (size / np.maximum(np.hypot(*away.T), 1e-9) - 1))[:, None])

    down = 2 + 4.5 * np.linspace(0, 1, 8 * n + 1) ** 1.3
    x = np.concatenate([np.linspace(0, 1, 4 * n + 1), np.linspace(1, 2, 6 * n + 1)[1:], down[1:]])
    y = np.concatenate([np.linspace(-0.5, 0, 3 * n + 1), np.linspace(0, 1, 5 * n + 1)[1:]])
    curve = over_floor((0.0, 6.5), (-0.5, 1.0), (1.0, 2.0), "base")
    return Grid(x, y, lambda x, y: "blob" if 1 < x < 2 and y < 0 else "water", curve, bent)


def mok(n: int) -> Grid:
    """The cavity with n x n rectangles, and its membrane of two rows under it."""
    thick = 0.002

    def curve(x: float, y: float) -> str:
        if x in (0.0, 1.0):
            return "ends" if y < 0 else {0.0: "in", 1.0: "out"}[x] if y > 0.875 else "sides"
        return {1.0: "lid"}.get(y, "")

    lines = np.linspace(0, 1, n + 1)
    rows = np.concatenate([[-thick, -thick / 2], lines])
    return Grid(lines, rows, lambda x, y: "water" if y > 0 else "membrane", curve)


def flap(n: int) -> Grid:
    """The channel with 2 n elements across the flap."""
    half = 0.05
    away = half + (3 - half) * np.linspace(0, 1, 12 * n + 1) ** 2
    x = np.concatenate([-away[::-1], np.linspace(-half, half, 2 * n + 1)[1:-1], away])
    y = np.concatenate([np.linspace(0, 1, 10 * n + 1), 1 + 3 * np.linspace(0, 1, 8 * n + 1)[1:] ** 1.5])
    curve = over_floor((-3.0, 3.0), (0.0, 4.0), (-half, half))
    return Grid(x, y, lambda x, y: "steel" if abs(x) < half and y < 1 else "water", curve)


def wall(n: int) -> Grid:
    """Wall's channel, cm from the middle of the square, n elements across the plate behind it."""
    half = 0.03
    near, far = half + (0.5 - half) * np.linspace(0, 1, 3 * n + 1) ** 1.4, np.linspace(0, 1, 6 * n + 1) ** 1.8
    away = np.round(np.concatenate([near[:-1], 0.5 + 5.5 * far]), 12)
    up, down = np.linspace(1, 0, 5 * n + 1) ** 1.6, np.linspace(0, 1, 8 * n + 1) ** 1.5
    plate = np.linspace(0.5, 4.5, 14 * n + 1)
    x = np.concatenate([-0.5 - 5 * up, dense(-0.5, 0.5, 4 * n, 0.5)[1:-1], plate[:-1], 4.5 + 9.5 * down])
    y = np.concatenate([-away[::-1], np.linspace(-half, half, n + 1)[1:-1], away])

    def region(x: float, y: float) -> str:
        if abs(x) < 0.5 and abs(y) < 0.5:
            return ""
        return "plate" if 0.5 < x < 4.5 and abs(y) < half else "air"

    def curve(x: float, y: float) -> str:
        if abs(y) == 6:
            return "sides"
        return {-5.5: "in", 14.0: "out"}.get(x) or ("root" if x == 0.5 and abs(y) < half else "square")

    return Grid(x, y, region, curve)


GRIDS: Mapping[str, Callable[..., Grid]] = {
    make.__name__: make for make in (cylinder, ring, collapsible, leaflet, blob, mok, flap, wall)
}
