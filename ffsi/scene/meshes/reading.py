"""From a mesh file to points, triangles and lines, each with all the groups that it belongs to."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ffsi.files.arrays import Floats, Ints
from ffsi.scene.errors import SceneError, count, fault, names, nearest, short
from ffsi.scene.meshes.msh import is_msh, read_msh

# Cell data that hold the numbers of groups, by the formats that write them.
_GMSH, _GEOMETRICAL = "gmsh:physical", "gmsh:geometrical"
_KNOWN_DATA = (_GMSH, "medit:ref", "su2:tag", "cell_tags")
_DIMENSION = {"triangle": 2, "line": 1}
_SECOND_ORDER = re.compile(r"(triangle|line)\d+")
_QUADS = re.compile(r"(quad|polygon)\d*")
_OUT_OF_RANGE = re.compile(r"index (-?\d+) is out of bounds")
# Rotations that lay the plane with a constant coordinate into z = constant.
_TURNS = {"x": "Rotate {{0, 1, 0}, {0, 0, 0}, Pi/2}", "y": "Rotate {{1, 0, 0}, {0, 0, 0}, -Pi/2}"}
_KEYWORD = re.compile(r"^\*\s*(NODE|ELEMENT|ELSET|INCLUDE)\s*(?:,(.*))?$", re.IGNORECASE)
_ELSET = re.compile(r"\bELSET\s*=\s*([^,]*)", re.IGNORECASE)
_MARKER = re.compile(r"^\s*MARKER_TAG\s*=(.*)$", re.MULTILINE)
# What FreeFEM writes: into .mesh a section that meshio does not know, into .msh a format of its own.
_SUBDOMAINS = re.compile(r"^SubDomainFromGeom\s+\d[\d\s-]*", re.MULTILINE)
_SINGLE = re.compile(r"^(MeshVersionFormatted\s+)[01]\b", re.MULTILINE)  # meshio would read single precision
_COUNTS = re.compile(r"\s*(\d{1,9})[ \t]+(\d{1,9})[ \t]+(\d{1,9})[ \t]*\r?\n")
FAR = 1e100
"""Larger coordinates are none: products of three of them have no value."""
PLANE = 1e-9
"""How far the nodes may be from a plane, in sizes of the mesh."""


class Group(NamedTuple):
    """Cells (ascending) with the same name or number in a file; none where it names what it does not hold."""

    name: str | None
    number: int | None
    cells: Ints

    @property
    def title(self) -> str:
        """What messages call it."""
        return str(self.number) if self.name is None else self.name


class MeshFile(NamedTuple):
    """Points (n, 2) in the unit of a file, triangles (nt, 3) and lines (nl, 2) of these, groups of both."""

    points: Floats
    triangles: Ints
    lines: Ints
    regions: tuple[Group, ...]
    curves: tuple[Group, ...]


def read_mesh_file(path: Path) -> MeshFile:
    """Read a mesh of plane triangles.

    Args:
        path: a file of Gmsh (versions 2 and 4.1), of FreeFEM's `savemesh` (.mesh, .msh), or of any other format that
            meshio reads.

    Raises:
        SceneError: the file is missing, damaged or unreadable, holds other elements than linear triangles and lines, or
            does not lie in a plane z = constant.
    """
    _refuse_no_file(path)
    with path.open("rb") as file:
        gmsh = is_msh(file.read(200))
    points, cells, groups = _read_gmsh(path) if gmsh else _read_other(path)
    triangles, lines = cells["triangle"], cells["line"]
    if not len(triangles):
        raise fault("the file holds no triangle")
    _refuse_strange_nodes(points, triangles, lines)
    if not (near := (np.abs(points) < FAR).all(axis=1)).all():
        node = int(np.argmin(near))
        what = f"beyond {FAR:g}" if np.isfinite(points[node]).all() else "not finite"
        raise fault(f"the coordinates of node {node + 1} are {what}")
    _refuse_third_dimension(points, triangles)
    triangles, regions = _once(triangles, groups["triangle"])
    return MeshFile(np.ascontiguousarray(points[:, :2]), triangles, lines, regions, groups["line"])


_Content = tuple[Floats, dict[str, Ints], dict[str, tuple[Group, ...]]]  # points, cells and groups by type


def _read_gmsh(path: Path) -> _Content:
    found = read_msh(path)
    _refuse_elements([(kind, len(cells)) for kind, cells in found.elements.items()])
    none = np.zeros(0, dtype=np.int64)
    cells = {kind: found.elements.get(kind, none.reshape(0, dimension + 1)) for kind, dimension in _DIMENSION.items()}
    groups = {
        kind: tuple(
            Group(found.names.get(key), key[1], found.groups.get(key, none))
            for key in (found.groups | found.names)
            if key[0] == dimension
        )
        for kind, dimension in _DIMENSION.items()
    }
    return found.points, cells, groups


def _read_other(path: Path) -> _Content:
    if path.suffix.lower() == ".inp":
        _refuse_lost_sets(path)
    mesh = _read(path)
    families = _marker_names(path) if "su2:tag" in mesh.cell_data else getattr(mesh, "cell_tags", {})
    points = np.asarray(mesh.points, dtype=np.float64)
    _refuse_elements([(block.type, len(block.data)) for block in mesh.cells])
    cells = {kind: _cells(mesh, kind) for kind in _DIMENSION}
    return points, cells, {kind: tuple(_groups(mesh, kind, families)) for kind in _DIMENSION}


def _once(triangles: Ints, groups: Sequence[Group]) -> tuple[Ints, tuple[Group, ...]]:
    """Leave out triangles that are there before: some formats write one for each of its groups."""
    _, first, same = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True, return_inverse=True)
    if len(first) == len(triangles):
        return triangles, tuple(groups)
    kept = np.sort(first)
    number = np.searchsorted(kept, first[same.ravel()])
    return triangles[kept], tuple(group._replace(cells=np.unique(number[group.cells])) for group in groups)


def _refuse_no_file(path: Path) -> None:
    try:
        there = path.is_file()
        size = path.stat().st_size if there else 0
    except OSError as error:
        raise fault(f"cannot be read: {error.strerror}") from None
    if there and not size:
        raise fault("the file is empty")
    if not there and path.is_dir():
        raise fault("this is a folder; accepted: a file that meshio reads (.msh, .mesh, .vtu, .vtk, ...)")
    if not there and path.exists():
        raise fault("this is no ordinary file")
    if not there:
        siblings = sorted(other.name for other in path.parent.iterdir()) if path.parent.is_dir() else []
        guess = nearest(path.name, siblings)
        hint = f' (did you mean "{guess}"?)' if guess else ""
        raise fault(f"no such file in {path.parent}; accepted: what meshio reads (.msh, .mesh, .vtu, .vtk, ...){hint}")


def _read(path: Path) -> Any:
    """Call meshio, which prints and leaves the process where it fails."""
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            if (text := _as_medit(path)) is None:
                return meshio.read(path)
            with tempfile.NamedTemporaryFile("w", suffix=".mesh") as file:
                file.write(text)
                file.flush()
                return meshio.read(file.name)
    except SceneError:
        raise
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever a malformed file leads to
        if "at least one array to concatenate" in str(error):
            raise fault("the file holds no elements") from None
        if (node := _unknown_node(error)) is not None:
            raise fault(f"a triangle or a line has the node{node}, which the file does not hold") from None
        reason = " ".join(f"{error}".split()) if isinstance(error, Exception) else ""
        reason = reason or " ".join(said.getvalue().split()) or type(error).__name__
        raise fault(f"meshio cannot read it: {reason[:200]}") from None


def _as_medit(path: Path) -> str | None:
    """Return Medit text that meshio reads whole, also of what FreeFEM's `savemesh` wrote; None of any other file."""
    if path.suffix.lower() not in (".mesh", ".msh"):
        return None
    try:
        text = path.read_text(encoding="ascii")
    except UnicodeDecodeError:
        return None
    if path.suffix.lower() == ".mesh":
        return _SINGLE.sub(r"\g<1>2", _SUBDOMAINS.sub("", text))
    if not (found := _COUNTS.match(text)):
        return None
    lines, first = text[found.end() :].splitlines(), 0
    sections = {"Vertices": int(found[1]), "Triangles": int(found[2]), "Edges": int(found[3])}
    if len(lines) < sum(sections.values()):
        told = " + ".join(f"{number} {name.lower()}" for name, number in sections.items())
        raise fault(f"its first line says {told}, and {count(len(lines), 'line')} follow")
    medit = ["MeshVersionFormatted 2", "Dimension 2"]
    for name, number in sections.items():
        medit += [name, str(number), *lines[first : first + number]]
        first += number
    return "\n".join([*medit, "End", ""])


def _unknown_node(error: BaseException) -> str | None:
    """Return the number, where it is known, of a node that made meshio fail; None if something else did."""
    if isinstance(error, KeyError) and isinstance(error.args[0], int | np.integer):
        return f" {error.args[0]}"
    return "" if isinstance(error, IndexError) and _OUT_OF_RANGE.match(str(error)) else None


def _refuse_strange_nodes(points: Floats, triangles: Ints, lines: Ints) -> None:
    for noun, cells in (("triangle", triangles), ("line", lines)):
        bad = ((cells < 0) | (cells >= len(points))).any(axis=1)
        if bad.any():
            known = next((points[n, :2] for n in cells[np.argmax(bad)] if 0 <= n < len(points)), None)
            where = "" if known is None else f"; it has a node at ({known[0]:.6g}, {known[1]:.6g})"
            text = f"{count(int(bad.sum()), noun)} with a node that the file does not hold"
            raise fault(f"{text}, the first is number {int(np.argmax(bad)) + 1} of the {noun}s{where}")


def _refuse_elements(blocks: Sequence[tuple[str, int]]) -> None:
    """Refuse all elements but triangles, lines and points."""
    total: dict[str, int] = {}
    for kind, number in blocks:
        total[kind] = total.get(kind, 0) + number
    for kind, number in total.items():
        if kind in (*_DIMENSION, "vertex") or not number:
            continue
        if _SECOND_ORDER.fullmatch(kind):
            hint = f'{count(number, "element")} of the type "{kind}"'
            raise fault(f"elements of higher order are not accepted (in Gmsh: Mesh.ElementOrder = 1); it has {hint}")
        if _QUADS.fullmatch(kind):
            raise fault(f"only triangles are accepted; it has {count(number, 'quadrilateral')} (in Gmsh: no Recombine)")
        raise fault(f'only plane triangles are accepted; it has {count(number, "element")} of the type "{kind}"')


def _refuse_third_dimension(points: Floats, triangles: Ints) -> None:
    if points.shape[1] < 3:
        return
    used = points[np.unique(triangles)]
    low, high = used.min(axis=0), used.max(axis=0)
    flat = high - low <= PLANE * (high - low).max()
    if flat[2]:
        return
    text = f"the mesh must lie in a plane z = constant; z goes from {low[2]:.6g} to {high[2]:.6g}"
    for axis, name in enumerate("xy"):
        if flat[axis]:
            text += f", {name} is {low[axis]:.6g} everywhere (in Gmsh: {_TURNS[name]} {{ Surface{{:}}; }})"
    raise fault(text)


def _cells(mesh: Any, kind: str) -> Ints:
    blocks = [block.data for block in mesh.cells if block.type == kind]
    width = _DIMENSION[kind] + 1
    return np.concatenate(blocks).astype(np.int64) if blocks else np.zeros((0, width), dtype=np.int64)


def _groups(mesh: Any, kind: str, families: dict[int, list[str]]) -> Iterator[Group]:
    """Yield the groups of the triangles or lines: those with numbers, of which a family has names, then named sets."""
    blocks = [number for number, block in enumerate(mesh.cells) if block.type == kind]
    data = _number_data(mesh, blocks)
    if data is not None and blocks:
        numbers = np.concatenate([np.asarray(mesh.cell_data[data][block]) for block in blocks]).astype(np.int64)
        yield from _numbered(np.abs(numbers) if data == _GMSH else numbers, data, families)
    first = np.cumsum([0, *(len(mesh.cells[block].data) for block in blocks)])
    for name, members in mesh.cell_sets.items():
        parts = [np.asarray(members[block], dtype=np.int64) + first[i] for i, block in enumerate(blocks)
                 if members[block] is not None]  # fmt: skip
        cells = np.unique(np.concatenate(parts)) if parts else np.zeros(0, dtype=np.int64)
        if len(cells):
            yield Group(name, None, cells)


def _numbered(numbers: Ints, data: str, families: dict[int, list[str]]) -> Iterator[Group]:
    """Yield the groups of cells with the same number, or where numbers stand for families (MED, SU2), the same name."""
    for name in dict.fromkeys(name for members in families.values() for name in members):
        cells = np.flatnonzero(np.isin(numbers, [number for number, members in families.items() if name in members]))
        if len(cells):
            yield Group(name, None, cells)
    for number in np.unique(numbers).tolist():
        if number not in families and not (number == 0 and data == _GMSH):  # Gmsh's mark of no group
            yield Group(None, number, np.flatnonzero(numbers == number))


def _number_data(mesh: Any, blocks: Sequence[int]) -> str | None:
    """Return the name of the cell data that hold the numbers of the groups; None if there are none."""
    for name in _KNOWN_DATA:
        if name in mesh.cell_data:
            return name
    found = [
        name
        for name, values in mesh.cell_data.items()
        if name != _GEOMETRICAL
        and all(
            np.asarray(values[block]).ndim == 1 and np.asarray(values[block]).dtype.kind in "iu" for block in blocks
        )
    ]
    if len(found) > 1:
        text = (
            f"several cell data hold whole numbers: {names(found)}; accepted: one of them, the numbers of the regions"
        )
        raise fault(f"{text} and boundaries")
    return found[0] if found else None


# Names of groups that meshio loses --------------------------------------------------------------------------------


def _refuse_lost_sets(path: Path) -> None:
    """Refuse a file of Abaqus with sets that meshio would give to other elements, or to fewer."""
    sets: set[str] = set()
    nodes = 0
    listed = False
    owned: set[bool] = set()  # whether elements are in a set from the start
    for number, keyword, options, first in _keywords(path):
        found = _ELSET.search(options)
        name = found[1].strip() if found else None
        what = ""
        if keyword == "NODE":
            nodes += 1
            what = "a second list of nodes" if nodes > 1 else ""
        elif keyword == "INCLUDE":
            what = "another file is included"
        elif name in sets:
            what = f"a second set {short(name)}"
        elif keyword == "ELSET" and not first.strip().split(",")[0].strip().isdigit():
            what = "a set that is not a list of elements"
        elif keyword == "ELSET":
            listed = True
        elif listed:
            what = "elements after a set"
        elif len(owned := owned | {name is not None}) > 1:
            what = "elements in a set from the start beside others"
        if what:
            text = f"line {number}: {what}, which meshio does not keep"
            accepted = "one *NODE, then all *ELEMENT with an ELSET or all without, then *ELSET of numbers, each once"
            raise fault(f"{text}; accepted: {accepted}, or another format (.msh)")
        if name is not None:
            sets.add(name)


def _keywords(path: Path) -> Iterator[tuple[int, str, str, str]]:
    """Yield line, keyword and options of each keyword that matters, and the line after it."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines, start=1):
        if found := _KEYWORD.match(line.strip()):
            following = lines[number] if number < len(lines) else ""
            yield number, found[1].upper(), found[2] or "", following


def _marker_names(path: Path) -> dict[int, list[str]]:
    """Return the names of the markers of an SU2 file by the numbers that meshio gives them, no two the same."""
    found: dict[int, list[str]] = {}
    number = 0
    for name in _MARKER.findall(path.read_text(encoding="utf-8", errors="replace")):
        text = name.strip()
        number = int(text) if re.fullmatch(r"[+-]?\d{1,9}", text) else number + 1
        if number in found:
            raise fault(f"the markers {short(found[number][0])} and {short(text)} cannot be told apart; rename one")
        found[number] = [text]
    return found
