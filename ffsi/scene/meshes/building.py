"""From a mesh file and the scene's names to a mesh with the regions and labels of the project (docs/formats.md)."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from ffsi.files.arrays import Floats, Ints
from ffsi.scene.boundaries import (
    CLAMPED,
    INLET,
    INLETS,
    LOADS,
    MOVING,
    OPENINGS_END,
    OUTLETS,
    SLIP,
    SLIP_X,
    SLIP_Y,
    SUPPORTED,
    SURFACE,
    Boundary,
    Inlet,
)
from ffsi.scene.errors import Problem, SceneError, count, fault, names, place, short
from ffsi.scene.meshes import topology as checks
from ffsi.scene.meshes.curves import FLUID, PARALLEL, ROLES, Curves, Naming, Part, chosen_groups, refuse_uncurved
from ffsi.scene.meshes.reading import MeshFile, read_mesh_file
from ffsi.scene.meshes.topology import Flags, Topology, cross

HELD = (CLAMPED, SUPPORTED)
"""Labels of boundaries that hold a solid."""
SLIPS = {SLIP_X: "slip_x", SLIP_Y: "slip_y", SLIP: "slip"}
"""Names of slip boundaries by the axis of their normal."""
STRAIGHT = 1e-6
"""How far the nodes of an inlet may be from a straight line, in lengths of the inlet."""
DIGITS = 13
"""Coordinates keep so many digits of the domain's size."""
NOISE = 100
"""Coordinates that differ by so many units of the last digit are equal: meshers write those of an axis-parallel edge
with noise, and FreeFEM's `interpolate` needs them equal to the last bit."""


@dataclass(frozen=True, eq=False)
class DomainMesh:
    """A mesh to compute on, lengths in m: vertices (nv, 2), triangles (nt, 3), counter-clockwise, their region (nt,).

    Edges (ne, 2) with a label (ne,) are boundaries and interfaces; the fluid, or the only triangle, is on their left.
    Areas are those of the regions by the scene's names, in the order of their numbers. A solid is loose that nothing
    holds, neither itself nor through another solid, or a piece of it: of each such piece the solid's name, its place in
    words, and the loads on it, "" for the support.
    The inlets are by name, the only one by "".
    """

    vertices: Floats
    triangles: Ints
    region: Ints
    edges: Ints
    label: Ints
    areas: dict[str, float]
    boundaries: tuple[Boundary, ...]
    inlets: dict[str, Inlet]
    loose: list[tuple[str, str, set[str]]]

    @cached_property
    def digest(self) -> str:
        """A text that is equal for equal meshes only."""
        arrays = (self.vertices, self.triangles, self.region, self.edges, self.label)
        return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()

    def in_solid(self, point: tuple[float, float]) -> bool:
        """Tell whether a point (m) lies in a solid, its boundary included."""
        corners = self.vertices[self.triangles[self.region != FLUID]]
        offset = np.asarray(point) - corners[:, 0]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        s, t = cross(offset, b) / cross(a, b), cross(a, offset) / cross(a, b)
        return bool(((s > -1e-9) & (t > -1e-9) & (s + t < 1 + 1e-9)).any())

    @property
    def solids_reach(self) -> str:
        """The box around the solids in words."""
        solid = self.vertices[self.triangles[self.region != FLUID]].reshape(-1, 2)
        (x0, y0), (x1, y1) = solid.min(axis=0), solid.max(axis=0)
        return f"x from {x0:.6g} to {x1:.6g} m, y from {y0:.6g} to {y1:.6g} m"

    @property
    def far_point(self) -> tuple[float, float]:
        """Vertex of the solids (m) that is farthest from all held (clamped or supported) ones, else from the centre."""
        solid = self.vertices[np.unique(self.triangles[self.region != FLUID])]
        held = self.vertices[np.unique(self.edges[np.isin(self.label, HELD)])]
        if not len(held):
            held = solid.mean(axis=0, keepdims=True)
        distance = np.asarray(KDTree(held).query(solid)[0])
        # Of equally distant ones the first in the order of x, then y: the numbering of a file has no meaning.
        best = solid[distance > (1 - 1e-9) * distance.max()]
        x, y = best[np.lexsort((best[:, 1], best[:, 0]))[0]]
        return float(x), float(y)


def domain_mesh(path: Path, unit: str, metres: float, naming: Naming) -> DomainMesh:
    """Read and check a mesh; the same file with the same names is read once.

    Args:
        path: the file.
        unit: name of its unit of length, for messages.
        metres: that unit in m.
        naming: the scene's names for what is in it.

    Raises:
        SceneError: it cannot be used.
    """
    try:
        version = path.stat()
    except (OSError, ValueError):  # reading it says what is wrong; ValueError: a path that cannot be one
        return _domain_mesh(path, unit, metres, naming)
    return _domain_mesh(path, unit, metres, naming, (version.st_mtime_ns, version.st_size))


@lru_cache(maxsize=16)
def _domain_mesh(path: Path, unit: str, metres: float, naming: Naming, _: tuple[int, int] | None = None) -> DomainMesh:
    file = read_mesh_file(path)
    region, titles = _regions(file, naming, unit)
    used, triangles = np.unique(file.triangles, return_inverse=True)
    vertices = _snapped(file.points[used] * metres)
    topology, turned = checks.counter_clockwise(vertices / metres, triangles.reshape(-1, 3), unit)
    checks.refuse_folds(topology, turned, region)
    checks.refuse_gaps(topology, titles)
    checks.refuse_overlaps(topology, titles)
    number = np.full(len(file.points), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    curves = Curves(topology, region, number[file.lines], file.curves)
    label, parts = curves.labels(naming)
    if "fluid" in naming.numbers:
        _refuse_parted_fluid(topology, region)
        _refuse_dry_solids(topology, region, naming)
    chosen = np.flatnonzero(label)
    edges = curves.directed[chosen]
    lengths = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
    areas = checks.areas(vertices, topology.triangles)
    by_number = sorted(naming.numbers.items(), key=lambda item: item[1])
    held = np.asarray(np.isin(topology.triangles, edges[label[chosen] == CLAMPED]).any(axis=1))
    solid = region != FLUID
    number_of = np.full(len(region), -1)
    if (piece := topology.components(solid)).size:
        slides = np.isin(label[chosen], [*SLIPS])
        along = (vertices[edges[:, 1]] - vertices[edges[:, 0]])[slides] / lengths[slides, None]
        # Pieces of solids with slip boundaries in two directions are held: there the sum of t t' has no kernel.
        owner = topology.left[1][chosen[slides]]
        number_of[solid] = piece
        of_solid = number_of[owner] >= 0
        directions = np.zeros((piece.max() + 1, 2, 2))
        np.add.at(directions, number_of[owner[of_solid]], along[of_solid, :, None] * along[of_solid, None, :])
        held[solid] |= np.linalg.eigvalsh(directions)[piece, 0] > PARALLEL
    loaded = {
        name: topology.left[1][chosen[label[chosen] == number]]
        for number, name in [(SUPPORTED, ""), *enumerate((name for name, _ in naming.loads), start=LOADS)]
    }
    meant = {
        value: _boundary(value, parts, naming, float(lengths[label[chosen] == value].sum()))
        for value in np.unique(label[chosen]).tolist()
    }
    bent = refuse_uncurved(naming.curved, {b.name: v for v, b in meant.items() if b.role == "no-slip"}, curves, label)
    return DomainMesh(
        vertices=vertices,
        triangles=topology.triangles,
        region=region,
        edges=edges,
        label=label[chosen],
        areas={name: float(areas[region == number].sum()) for name, number in by_number},
        boundaries=tuple(replace(b, curved=value in bent) for value, b in meant.items()),
        inlets={
            name: _inlet(
                vertices, edges[label[chosen] == number], unit, metres, f"inlets.{name}" if name else "boundaries.inlet"
            )
            for number, name in [(INLET, ""), *enumerate((name for name, _ in naming.inlets), start=INLETS)]
            if number in label
        },
        loose=[
            (name, where, {load for load, sides in loaded.items() if number in number_of[sides]})
            for (number, name), where in _pieces_without(topology, region, held, naming).items()
        ],
    )


def _boundary(label: int, parts: dict[int, Part], naming: Naming, length: float) -> Boundary:
    """Return what a label means."""
    if label in parts:
        part = parts[label]
        return Boundary(part.name, label, part.role, length, part.name, moving=part.moving)
    if MOVING <= label < MOVING + len(naming.moving):
        name = naming.moving[label - MOVING][0]
        return Boundary(name, label, "no-slip", length, moving=name)
    if LOADS <= label < LOADS + len(naming.loads):
        name = naming.loads[label - LOADS][0]
        return Boundary(name, label, "loaded", length, load=name)
    if INLETS <= label < OPENINGS_END:
        role, names_of, first = (
            ("inlet", naming.inlets, INLETS) if label < OUTLETS else ("outlet", naming.outlets, OUTLETS)
        )
        name = names_of[label - first][0]
        return Boundary(name, label, ROLES[role].role, length, opening=name)
    if label in SLIPS:
        return Boundary(SLIPS[label], label, "slip", length)
    if label == SURFACE:
        return Boundary("interface", label, "interface", length)
    name = next(key for key, meant in ROLES.items() if meant.label == label)
    return Boundary(name, label, ROLES[name].role, length, outer=label == SUPPORTED)


def _snapped(points: Floats) -> Floats:
    """Round coordinates; neighbours among them that differ by noise become equal; a second time nothing changes."""
    size = float(np.ptp(points, axis=0).max())
    digits = DIGITS - 1 - int(np.floor(np.log10(size))) if size > 0 else DIGITS
    found = np.empty_like(points)
    for axis, values in enumerate(np.rint(points * 10.0**digits).T):
        known, place_of = np.unique(values, return_inverse=True)
        begins = np.diff(known, prepend=-np.inf) > NOISE
        found[:, axis] = known[begins][np.cumsum(begins) - 1][place_of] / 10.0**digits
    return found + 0.0  # no -0.0


# Regions -------------------------------------------------------------------------------------------------------------


def _regions(file: MeshFile, naming: Naming, unit: str) -> tuple[Ints, list[str]]:
    """Return the region of each triangle, and what messages call it."""
    region = np.zeros(len(file.triangles), dtype=np.int64)
    titles = [""] * len(region)
    problems: list[Problem] = []
    for name, wanted in naming.regions:
        number = naming.numbers[name]
        for key, group in chosen_groups(wanted, file.regions, f"regions.{name}", "region", problems):
            twice = group.cells[~np.isin(region[group.cells], (0, number))]
            if twice.size:
                other = next(n for n, known in naming.numbers.items() if known == region[twice[0]])
                where = place(file.points[file.triangles[twice[0]]].mean(axis=0), unit)
                owner = f"regions.{other} = {short(titles[twice[0]])}"
                shares = f"shares {count(twice.size, 'triangle')} with {owner}, the first at {where}"
                text = f"is already {owner}" if titles[twice[0]] == group.title else shares
                problems.append(Problem(f"regions.{name}", text, short(key)))
                continue
            region[group.cells] = number
            for cell in group.cells.tolist():
                titles[cell] = group.title
    if problems:
        raise SceneError(problems)
    left = np.flatnonzero(region == 0)
    if left.size:
        where = place(file.points[file.triangles[left[0]]].mean(axis=0), unit)
        unused = [group.title for group in file.regions if (region[group.cells] == 0).any()]
        what = f"the mesh has the region {names(unused)}" if len(unused) == 1 else f"the mesh has {names(unused)}"
        if not unused:
            what = f"{count(left.size, 'triangle')} of the mesh belong to no region, the first at {where}"
        accepted = 'accepted: each region of the mesh once, as the "fluid" or as a solid with a name of its own'
        hint = "(in Gmsh: each surface in a physical group, and Mesh.SaveAll = 0)"
        raise fault(f"{what}, which is used nowhere; {accepted}" if unused else f"{what}; {accepted} {hint}", "regions")
    return region, titles


def _pieces_without(topology: Topology, region: Ints, marked: Flags, naming: Naming) -> dict[tuple[int, str], str]:
    """Return, by number and the scene's name of each solid in them, places in the connected pieces without a mark."""
    solid = np.flatnonzero(region != FLUID)
    if not solid.size:
        return {}
    piece = topology.components(region != FLUID)
    left = np.flatnonzero(~np.isin(piece, piece[marked[solid]]))
    pairs, first = np.unique(np.column_stack([piece, region[solid]])[left], axis=0, return_index=True)
    middles = topology.points[topology.triangles[solid[left[first]]]].mean(axis=1)
    name_of = {number: name for name, number in naming.numbers.items()}
    found = zip(pairs.tolist(), middles, strict=True)
    return {(number, name_of[of]): place(middle, topology.unit) for (number, of), middle in found}


# The fluid -----------------------------------------------------------------------------------------------------------


def _refuse_parted_fluid(topology: Topology, region: Ints) -> None:
    fluid = region == FLUID
    piece = topology.components(fluid)
    if piece.max() == 0:
        return
    triangles = np.flatnonzero(fluid)
    first = [topology.triangle_at(triangles[np.argmax(piece == number)]) for number in range(2)]
    text = f"the fluid falls into {piece.max() + 1} pieces that share no edge"
    raise fault(f"{text}: one has the triangle {first[0]}, another one {first[1]}", "regions.fluid")


def _refuse_dry_solids(topology: Topology, region: Ints, naming: Naming) -> None:
    pairs = topology.neighbours
    wet = np.zeros(len(region), dtype=np.bool_)
    wet[pairs[(region[pairs] == FLUID).any(axis=1)]] = True
    accepted = "accepted with a fluid: solids that share edges with it, themselves or through other solids"
    dry = {name: where for (_, name), where in _pieces_without(topology, region, wet, naming).items()}
    problems = [
        Problem(f"regions.{name}", f"its piece at {where} is not connected to the fluid; {accepted}")
        for name, where in dry.items()
    ]
    if problems:
        raise SceneError(problems)


def _inlet(vertices: Floats, edges: Ints, unit: str, metres: float, key: str) -> Inlet:
    """Return the inlet: its edges have the fluid on their left, and it runs the other way, from the end of the last."""
    firsts, lasts = set(edges[:, 0].tolist()), set(edges[:, 1].tolist())
    ends, starts = sorted(firsts - lasts), sorted(lasts - firsts)
    if len(starts) != 1 or len(ends) != 1:
        what = f"it has {len(starts)} pieces" if starts else "it closes on itself"
        raise fault(f"must be one connected straight piece; {what}", key)
    start, end = vertices[starts[0]], vertices[ends[0]]
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    offset = vertices[np.unique(edges)] - start
    away = np.abs(cross(along, offset))
    if away.max() > STRAIGHT * length:
        point = (start + offset[int(np.argmax(away))]) / metres
        text = f"must be straight; at {place(point, unit)} it is {away.max() / metres:.3g} {unit}"
        raise fault(f"{text} away from the line between its ends", key)
    inward = (float(along[1]), float(-along[0]) + 0.0)  # no -0.0
    return Inlet((float(start[0]), float(start[1])), inward, length)


# For FreeFEM ---------------------------------------------------------------------------------------------------------


def write_medit(mesh: DomainMesh, path: Path) -> None:
    """Write the mesh so that FreeFEM reads the same bits, in m, with the regions and labels of the project."""
    import meshio

    data = {"medit:ref": [mesh.region, mesh.label]}
    cells = [("triangle", mesh.triangles), ("line", mesh.edges)]
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    meshio.Mesh(mesh.vertices, cells, cell_data=data).write(partial, file_format="medit")
    partial.replace(path)


def stored_naming(mesh: DomainMesh, naming: Naming) -> Naming:
    """Return the names of a mesh that `write_medit` has written: its numbers."""
    labels = {
        key: tuple(
            str(e.label)
            for e in mesh.boundaries
            if not (e.moving or e.load or e.opening)
            and (e.label == meant.label or ((e.part or e.role == "slip") and e.role == meant.role))
        )
        for key, meant in ROLES.items()
        if key != "slip"  # which is a symmetry
    }
    return Naming(
        tuple((name, (str(number),)) for name, number in naming.numbers.items()),
        tuple((key, found) for key, found in labels.items() if found),
        tuple((edges.part, (str(edges.label),)) for edges in mesh.boundaries if edges.part),
        tuple((name, tuple(str(e.label) for e in mesh.boundaries if e.moving == name)) for name, _ in naming.moving),
        tuple((name, tuple(str(e.label) for e in mesh.boundaries if e.load == name)) for name, _ in naming.loads),
        tuple((name, (str(number),)) for number, (name, _) in enumerate(naming.inlets, start=INLETS)),
        tuple((name, (str(number),)) for number, (name, _) in enumerate(naming.outlets, start=OUTLETS)),
        naming.curved,
    )
