"""From a file that meshio reads to points, triangles and lines, each with the groups that they belong to."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ffsi.scene.errors import names, nearest
from ffsi.scene.meshes.errors import count, fault

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Cell data that hold the numbers of groups, by the formats that write them.
_GMSH, _GEOMETRICAL = "gmsh:physical", "gmsh:geometrical"
_KNOWN_DATA = (_GMSH, "medit:ref", "su2:tag", "cell_tags")
_DIMENSION = {"triangle": 2, "line": 1}
_SECOND_ORDER = re.compile(r"(triangle|line)\d+")
_QUADS = re.compile(r"(quad|polygon)\d*")
_OUT_OF_RANGE = re.compile(r"index (-?\d+) is out of bounds")
_NAMES = re.compile(rb"\$PhysicalNames\s(.*?)\$EndPhysicalNames", re.DOTALL)
_NAME = re.compile(rb'^\s*(\d+)\s+(\d+)\s+"(.*)"\s*$', re.MULTILINE)


@dataclass(frozen=True)
class Group:
    """Cells of one dimension that carry the same name or number.

    Args:
        name: name in the file, None if it has only a number.
        number: number in the file, None if it has only a name.
        cells: numbers of the cells, in ascending order; none where the file names what it does not hold.
    """

    name: str | None
    number: int | None
    cells: Ints

    @property
    def title(self) -> str:
        """What messages call it."""
        return str(self.number) if self.name is None else self.name


@dataclass(frozen=True)
class MeshFile:
    """What a mesh file holds.

    Args:
        points: (n, 2) in the unit of the file.
        triangles: (nt, 3) numbers of points.
        lines: (nl, 2) numbers of points.
        regions: groups of triangles.
        curves: groups of lines.
    """

    points: Floats
    triangles: Ints
    lines: Ints
    regions: tuple[Group, ...]
    curves: tuple[Group, ...]


def read_mesh_file(path: Path) -> MeshFile:
    """Read a mesh of plane triangles.

    Args:
        path: a file of any format that meshio reads.

    Raises:
        MeshError: the file is missing or unreadable, holds other elements than linear triangles and lines, or is not
            plane.
    """
    mesh = _read(path)
    points = np.asarray(mesh.points, dtype=np.float64)
    _refuse_elements([(block.type, len(block.data)) for block in mesh.cells])
    triangles, lines = (_cells(mesh, kind) for kind in _DIMENSION)
    if not len(triangles):
        raise fault("the file holds no triangle")
    _refuse_strange_nodes(points, triangles, lines)
    if not np.isfinite(points).all():
        raise fault(f"the coordinates of node {int(np.argmin(np.isfinite(points).all(axis=1))) + 1} are not finite")
    _refuse_third_dimension(points, triangles)
    physical = _physical_names(path) if path.suffix.lower() == ".msh" else {}
    regions, curves = (tuple(_groups(mesh, kind, physical)) for kind in _DIMENSION)
    return MeshFile(np.ascontiguousarray(points[:, :2]), triangles, lines, regions, curves)


def _read(path: Path) -> Any:
    """Call meshio, which prints and leaves the process where it fails."""
    try:
        there = path.is_file()
        size = path.stat().st_size if there else 0
    except OSError as error:
        raise fault(f"cannot be read: {error.strerror}") from None
    if there and not size:
        raise fault("the file is empty")
    if not there and path.is_dir():
        raise fault("this is a folder; accepted: a file that meshio reads (.msh, .mesh, .vtu, .vtk, ...)")
    if not there:
        siblings = sorted(other.name for other in path.parent.iterdir()) if path.parent.is_dir() else []
        guess = nearest(path.name, siblings)
        hint = f' (did you mean "{guess}"?)' if guess else ""
        raise fault(f"no such file in {path.parent}; accepted: what meshio reads (.msh, .mesh, .vtu, .vtk, ...){hint}")
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio's readers raise whatever a malformed file leads to
        if "gmsh:physical" in str(error):
            text = "some elements belong to no physical group; save only those that do (in Gmsh: Mesh.SaveAll = 0)"
            raise fault(text) from None
        if "at least one array to concatenate" in str(error):
            raise fault("the file holds no elements") from None
        if (node := _unknown_node(error, path)) is not None:
            raise fault(f"a triangle or a line has the node{node}, which the file does not hold") from None
        reason = " ".join(f"{error}".split()) if isinstance(error, Exception) else ""
        reason = reason or " ".join(said.getvalue().split()) or type(error).__name__
        raise fault(f"meshio cannot read it: {reason[:200]}") from None


def _unknown_node(error: BaseException, path: Path) -> str | None:
    """Return the number, where it is known, of a node that made meshio fail; None if something else did."""
    if isinstance(error, KeyError) and isinstance(error.args[0], int | np.integer):
        return f" {error.args[0]}"
    found = _OUT_OF_RANGE.match(str(error)) if isinstance(error, IndexError) else None
    if found is None:
        return None
    return f" {int(found[1]) + 1}" if path.suffix.lower() == ".msh" else ""  # Gmsh counts from 1, meshio from 0


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
    low, high = used[:, 2].min(), used[:, 2].max()
    if high - low > 1e-9 * np.ptp(used, axis=0).max():
        raise fault(f"the mesh must lie in a plane z = constant; z goes from {low:.6g} to {high:.6g}")


def _cells(mesh: Any, kind: str) -> Ints:
    blocks = [block.data for block in mesh.cells if block.type == kind]
    width = _DIMENSION[kind] + 1
    return np.concatenate(blocks).astype(np.int64) if blocks else np.zeros((0, width), dtype=np.int64)


def _physical_names(path: Path) -> dict[tuple[int, int], str]:
    """Return the names of a Gmsh file by dimension and number; meshio mixes up equal names of two dimensions."""
    found = _NAMES.search(path.read_bytes())
    if found is None:
        return {}
    return {
        (int(dimension), int(number)): name.decode("utf-8", "replace")
        for dimension, number, name in _NAME.findall(found.group(1))
    }


def _groups(mesh: Any, kind: str, physical: dict[tuple[int, int], str]) -> Iterator[Group]:
    """Yield the groups of the triangles or lines: those with numbers, then other named sets, then empty ones."""
    dimension = _DIMENSION[kind]
    blocks = [number for number, block in enumerate(mesh.cells) if block.type == kind]
    seen = set()
    data = _number_data(mesh, blocks)
    if data is not None and blocks:
        numbers = np.concatenate([np.asarray(mesh.cell_data[data][block]) for block in blocks]).astype(np.int64)
        for number in np.unique(numbers).tolist():
            if data == _GMSH and number == 0:
                continue  # Gmsh's mark of a cell without a physical group
            name = physical.get((dimension, number))
            seen.add(name)
            yield Group(name, number, np.flatnonzero(numbers == number))
    first = np.cumsum([0, *(len(mesh.cells[block].data) for block in blocks)])
    for name, members in mesh.cell_sets.items():
        parts = [np.asarray(members[block], dtype=np.int64) + first[i] for i, block in enumerate(blocks)
                 if not name.startswith("gmsh:") and members[block] is not None]  # fmt: skip
        cells = np.unique(np.concatenate(parts)) if parts else np.zeros(0, dtype=np.int64)
        if len(cells) and name not in seen:
            seen.add(name)
            yield Group(name, None, cells)
    for (of, number), name in physical.items():
        if of == dimension and name not in seen:
            yield Group(name, number, np.zeros(0, dtype=np.int64))


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
