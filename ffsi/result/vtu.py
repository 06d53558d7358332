"""Quadratic triangles for ParaView: Fields -> VTU files; and as a meshio mesh."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import Floats
from ffsi.result.fields import Fields

if TYPE_CHECKING:
    import meshio

_QUADRATIC = 22  # VTK's number of a triangle with six nodes
_BLOCK = 2**15  # bytes that are compressed together


def to_meshio(fields: Fields, more: Mapping[str, Floats] | None = None) -> meshio.Mesh:
    """Return the reference mesh with its fields.

    Point data: `displacement` (m), `velocity` (m/s), `pressure` (Pa), with mixed solids `solid_pressure` (Pa), and
    `more` by name, (n,) or (n, 2); cell data: `region`. Vectors have three components (the third is zero), so that
    ParaView can warp by `displacement`.
    """
    import meshio

    return meshio.Mesh(
        points=_three(fields.points),
        cells=[("triangle6", fields.cells)],
        point_data=_point_data(fields, more),
        cell_data={"region": [fields.region]},
    )


def write_vtu(path: Path, fields: Fields, more: Mapping[str, Floats] | None = None) -> None:
    """Write what `to_meshio` holds as a compressed VTU file (quicker than meshio is loaded)."""
    cells = fields.cells
    ends, kinds = np.arange(6, cells.size + 1, 6), np.full(len(cells), _QUADRATIC, dtype=np.uint8)
    parts: dict[str, Mapping[str, np.ndarray]] = {
        "Points": {"Points": _three(fields.points)},
        "Cells": {"connectivity": cells.ravel(), "offsets": ends, "types": kinds},
        "PointData": _point_data(fields, more),
        "CellData": {"region": fields.region},
    }
    inner = "".join(
        f"<{part}>\n{''.join(_data_array(name, values) for name, values in arrays.items())}</{part}>\n"
        for part, arrays in parts.items()
    )
    folder.write_text(
        path,
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        'header_type="UInt32" compressor="vtkZLibDataCompressor">\n'
        f'<UnstructuredGrid>\n<Piece NumberOfPoints="{len(fields.points)}" NumberOfCells="{len(cells)}">\n{inner}'
        "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n",
    )


def _point_data(fields: Fields, more: Mapping[str, Floats] | None) -> dict[str, Floats]:
    names = ("displacement", "velocity", "pressure", *(["solid_pressure"] if fields.solid_pressure is not None else []))
    values = {name: getattr(fields, name) for name in names} | dict(more or {})
    return {name: _three(each) if each.ndim == 2 else each for name, each in values.items()}


def _data_array(name: str, values: np.ndarray) -> str:
    kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.itemsize)
    plain = values.astype(values.dtype.newbyteorder("<")).tobytes()
    blocks = [plain[i : i + _BLOCK] for i in range(0, len(plain), _BLOCK)] or [b""]
    packed = [zlib.compress(block, 1) for block in blocks]
    head = struct.pack(f"<{3 + len(packed)}I", len(packed), _BLOCK, len(blocks[-1]), *map(len, packed))
    text = (base64.b64encode(head) + base64.b64encode(b"".join(packed))).decode("ascii")
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'<DataArray type="{kind}" Name="{name}"{width} format="binary">\n{text}\n</DataArray>\n'


def write_series(directory: Path, states: Iterable[tuple[int, float, Fields, Mapping[str, Floats]]]) -> None:
    """Write a series in time for ParaView: `fields-000123.vtu` for every state, and `fields.pvd` with their times.

    A state is the number of its time step, the time in s, its fields and further point data.
    """
    entries = []
    for step, time, fields, more in states:
        name = f"fields-{step:06d}.vtu"
        write_vtu(directory / name, fields, more)
        entries.append(f'    <DataSet timestep="{time!r}" part="0" file="{name}"/>\n')
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    )
    folder.write_text(directory / folder.SERIES, head + "".join(entries) + "  </Collection>\n</VTKFile>\n")


def _three(vectors: np.ndarray) -> np.ndarray:
    return np.column_stack([vectors, np.zeros(len(vectors))])
