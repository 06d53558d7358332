"""Binary files of a run folder: the mesh and the raw unknowns (docs/formats.md).

A file is a sequence of arrays, each an int64 length followed by that many int64 or float64 values, little endian
(FreeFEM's ``bfstream``). This module knows the layout and nothing of the physics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ffsi.files.errors import InputError
from ffsi.files.machine import writing
from ffsi.files.reading import MEGABYTE, read_bytes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MESH_VERSION = 1
MAX_BYTES = 20_000 * MEGABYTE
_INT = np.dtype("<i8")
_FLOAT = np.dtype("<f8")


def distinct(numbers: Ints) -> Ints:
    """Return the numbers that occur, sorted: `np.unique`, which for them alone loads numpy.ma."""
    return np.unique(numbers, return_index=True)[0]


class RawFileError(InputError):
    """A binary file is truncated or does not hold what docs/formats.md says."""


@dataclass(frozen=True)
class RawMesh:
    """A mesh of straight triangles with the numbering of its quadratic nodes.

    ``vertices`` (nv, 2) metres; ``triangles`` (nt, 3) vertex numbers; ``region`` (nt,); ``edges`` (ne, 2) vertex
    numbers of the labelled edges, the fluid-solid interface among them; ``label`` (ne,); ``p2`` (nt, 6) P2 node numbers
    of each triangle, its three vertices first, then the mid-edge nodes opposite to them.
    """

    vertices: Floats
    triangles: Ints
    region: Ints
    edges: Ints
    label: Ints
    p2: Ints

    def __post_init__(self) -> None:
        """Refuse arrays whose shapes or numbers do not fit together."""
        nv, nt, ne = len(self.vertices), len(self.triangles), len(self.edges)
        shapes = {"vertices": (nv, 2), "triangles": (nt, 3), "region": (nt,), "edges": (ne, 2), "label": (ne,)}
        for name, expected in {**shapes, "p2": (nt, 6)}.items():
            if (shape := getattr(self, name).shape) != expected:
                raise RawFileError(f"mesh: {name} has shape {shape}, expected {expected}")
        if nt == 0:
            raise RawFileError("mesh: it has no triangle")
        for name, numbers in (("triangles", self.triangles), ("edges", self.edges)):
            if numbers.size and not 0 <= numbers.min() <= numbers.max() < nv:
                raise RawFileError(f"mesh: {name} names a vertex outside 0..{nv - 1}")
        if not np.isfinite(self.vertices).all():
            bad = _first_bad(self.vertices.sum(axis=1))
            raise RawFileError(f"mesh: the coordinates of vertex {bad} are not finite")
        # Before anything of the size that a number names is made.
        if not 0 <= self.p2.min() <= self.p2.max() < self.p2.size:
            raise RawFileError(f"mesh: a P2 node outside 0..{self.p2.size - 1}")
        if not np.bincount(self.p2.ravel()).all():
            raise RawFileError("mesh: the P2 node numbers are not 0, 1, 2, ... without a gap")

    @property
    def n_p2(self) -> int:
        """Number of P2 nodes."""
        return int(self.p2.max()) + 1

    @cached_property
    def vertex_nodes(self) -> Ints:
        """P2 node of each vertex, (nv,); -1 for a vertex of no triangle."""
        nodes = np.full(len(self.vertices), -1, dtype=np.int64)
        nodes[self.triangles] = self.p2[:, :3]
        return nodes

    @cached_property
    def p2_coordinates(self) -> Floats:
        """Reference coordinates of the P2 nodes, (n2, 2) metres; a mid-edge node is the middle of its straight edge."""
        corners = self.vertices[self.triangles]
        coordinates = np.empty((self.n_p2, 2))
        coordinates[self.p2[:, :3]] = corners
        coordinates[self.p2[:, 3:]] = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
        return coordinates

    @cached_property
    def sides(self) -> Ints:
        """Key of every triangle side, (nt, 3) integers; side k lies opposite to vertex k, equal keys are one edge."""
        return self._key(np.roll(self.triangles, -1, axis=1), np.roll(self.triangles, -2, axis=1))

    @cached_property
    def edge_keys(self) -> Ints:
        """Key of every labelled edge, (ne,), to be found among ``sides``."""
        return self._key(self.edges[:, 0], self.edges[:, 1])

    @cached_property
    def edge_nodes(self) -> Ints:
        """P2 nodes of the labelled edges, (ne, 3): first vertex, second vertex, mid-edge node.

        Raises ``RawFileError`` if an edge is no side of a triangle.
        """
        keys, where = np.unique(self.sides, return_index=True)
        position = np.minimum(np.searchsorted(keys, self.edge_keys), len(keys) - 1)
        missing = np.flatnonzero(keys[position] != self.edge_keys)
        if missing.size:
            raise RawFileError(f"mesh: edge {missing[0]} is no side of any triangle")
        middle = self.p2[:, 3:].ravel()[where[position]]
        return np.column_stack([self.vertex_nodes[self.edges], middle])

    def _key(self, first: Ints, second: Ints) -> Ints:
        return np.minimum(first, second) * len(self.vertices) + np.maximum(first, second)


@dataclass(frozen=True)
class RawState:
    """The unknowns of one solution: ``u`` (n2, 2) metres, ``v`` (n2, 2) metres per second, ``p`` (nv,) pascals.

    ``ps`` (number of mixed solids, nv) pascals: the pressure of each mixed solid, zero at vertices of none of its
    triangles; (0, nv) if it is not given.
    """

    u: Floats
    v: Floats
    p: Floats
    ps: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        """Give the pressures of no mixed solid the width that sums of states need."""
        if not len(self.ps):
            object.__setattr__(self, "ps", np.zeros((0, len(self.p))))

    @property
    def fields(self) -> tuple[Floats, Floats, Floats, Floats]:
        """All unknowns: u, v, p, ps."""
        return self.u, self.v, self.p, self.ps


def read_arrays(path: Path, dtypes: Sequence[type], more: type | None = None) -> list[NDArray[np.generic]]:
    """Read the arrays of a binary file whose element types are known (``int`` or ``float``, one per array).

    With ``more`` any number of arrays of that type may follow. Raises ``RawFileError`` if the file ends early, goes on
    behind the last array, or has a senseless length, and ``OSError`` if it cannot be read.
    """
    path = Path(path)
    data, offset, kinds = read_bytes(path, MAX_BYTES), 0, list(dtypes)
    arrays: list[NDArray[np.generic]] = []
    while len(arrays) < len(kinds):
        place = f"array {len(arrays) + 1} of {len(kinds)}"
        if offset + 8 > len(data):
            raise RawFileError(f"{path}: truncated: {place} is missing")
        length = int(np.frombuffer(data, _INT, 1, offset)[0])
        offset += 8
        if length < 0 or offset + 8 * length > len(data):
            raise RawFileError(
                f"{path}: truncated: {place} announces {length} values, {(len(data) - offset) // 8} are left"
            )
        arrays.append(np.frombuffer(data, _INT if kinds[len(arrays)] is int else _FLOAT, length, offset))
        offset += 8 * length
        if len(arrays) == len(kinds) and more is not None and offset < len(data):
            kinds.append(more)
    if offset != len(data):
        raise RawFileError(f"{path}: {len(data) - offset} bytes follow the last of {len(kinds)} arrays")
    return arrays


def write_arrays(path: Path, arrays: Sequence[NDArray[np.generic]]) -> None:
    """Write integer and floating-point arrays, flattened in C order, in the format that ``read_arrays`` reads."""
    with writing(Path(path)), Path(path).open("wb") as file:
        for array in arrays:
            kind = _INT if np.issubdtype(array.dtype, np.integer) else _FLOAT
            file.write(np.array([array.size], dtype=_INT).tobytes())
            file.write(np.ascontiguousarray(array, dtype=kind).tobytes())


def read_mesh(path: Path) -> RawMesh:
    """Read ``mesh.bin``. Raises ``RawFileError`` if the version, the sizes or the numbers do not fit."""
    header, x, y, triangles, region, edges, label, p2 = read_arrays(path, (int, float, float, int, int, int, int, int))
    if len(header) != 5 or header[0] != MESH_VERSION:
        raise RawFileError(f"{path}: header {header.tolist()}, expected [{MESH_VERSION}, nv, nt, ne, n2]")
    _, nv, nt, ne, n2 = (int(number) for number in header)
    sizes = {"x": (x, nv), "y": (y, nv), "triangles": (triangles, 3 * nt), "region": (region, nt)}
    sizes |= {"edges": (edges, 2 * ne), "label": (label, ne), "p2": (p2, 6 * nt)}
    for name, (array, expected) in sizes.items():
        if len(array) != expected:
            raise RawFileError(f"{path}: {name} has {len(array)} values, the header says {expected}")
    numbers = (triangles.reshape(nt, 3), region, edges.reshape(ne, 2), label, p2.reshape(nt, 6))
    try:
        mesh = RawMesh(np.column_stack([x, y]).astype(np.float64), *(array.astype(np.int64) for array in numbers))
    except RawFileError as error:
        raise RawFileError(f"{path}: {error}") from None
    if mesh.n_p2 != n2:
        raise RawFileError(f"{path}: {mesh.n_p2} P2 nodes are used, the header says {n2}")
    return mesh


def write_mesh(path: Path, mesh: RawMesh) -> None:
    """Write ``mesh.bin``."""
    header = np.array([MESH_VERSION, len(mesh.vertices), len(mesh.triangles), len(mesh.edges), mesh.n_p2])
    x, y = mesh.vertices.T
    write_arrays(path, [header, x, y, mesh.triangles, mesh.region, mesh.edges, mesh.label, mesh.p2])


def read_state(path: Path, mesh: RawMesh) -> RawState:
    """Read ``point-0001.bin``, ``failed.bin`` or the state ``state-000123.bin`` of a time step of a run on ``mesh``.

    How many pressures of mixed solids follow is up to the file: this module does not know the scene.
    Raises ``RawFileError`` if the sizes do not fit the mesh or a value is not finite.
    """
    arrays = [array.astype(np.float64) for array in read_arrays(path, (float,) * 5, more=float)]
    names = ["ux", "uy", "vx", "vy", "p", *(f"ps {number}" for number in range(1, len(arrays) - 4))]
    for name, array in zip(names, arrays, strict=True):
        expected = len(mesh.vertices) if name.startswith("p") else mesh.n_p2
        if len(array) != expected:
            raise RawFileError(f"{path}: {name} has {len(array)} values, the mesh has {expected} such nodes")
        if not np.isfinite(array).all():
            raise RawFileError(f"{path}: {name} has a value that is not finite, the first at node {_first_bad(array)}")
    ux, uy, vx, vy, p, *ps = arrays
    return RawState(np.column_stack([ux, uy]), np.column_stack([vx, vy]), p, np.array(ps).reshape(-1, len(p)))


def write_state(path: Path, state: RawState) -> None:
    """Write the unknowns in the layout of ``point-0001.bin``."""
    write_arrays(path, [state.u[:, 0], state.u[:, 1], state.v[:, 0], state.v[:, 1], state.p, *state.ps])


def _first_bad(array: Floats) -> int:
    return int(np.flatnonzero(~np.isfinite(array))[0])
