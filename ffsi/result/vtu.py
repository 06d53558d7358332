"""Quadratic triangles for ParaView: Fields <-> meshio <-> VTU files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import meshio
import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import Floats
from ffsi.result.fields import Fields


def to_meshio(fields: Fields, more: Mapping[str, Floats] | None = None) -> meshio.Mesh:
    """Return the reference mesh with its fields.

    Point data: `displacement` (m), `velocity` (m/s), `pressure` (Pa) and, with mixed solids, `solid_pressure` (Pa);
    cell data: `region`. Vectors have three components (the third is zero), so that ParaView can warp by `displacement`.

    Args:
        fields: the fields.
        more: further point data by name, (n,) or (n, 2).
    """
    point_data = {
        "displacement": _three(fields.displacement),
        "velocity": _three(fields.velocity),
        "pressure": fields.pressure,
    }
    if fields.solid_pressure is not None:
        point_data["solid_pressure"] = fields.solid_pressure
    for name, values in (more or {}).items():
        point_data[name] = _three(values) if values.ndim == 2 else values
    return meshio.Mesh(
        points=_three(fields.points),
        cells=[("triangle6", fields.cells)],
        point_data=point_data,
        cell_data={"region": [fields.region]},
    )


def write_vtu(path: Path, fields: Fields, more: Mapping[str, Floats] | None = None) -> None:
    """Write fields and further point data as a compressed VTU file of quadratic triangles, reference configuration."""
    partial = path.with_name(f".{path.name}.part")
    to_meshio(fields, more).write(partial, file_format="vtu", binary=True, compression="zlib")
    partial.replace(path)


def write_series(directory: Path, states: Iterable[tuple[int, float, Fields, Mapping[str, Floats]]]) -> None:
    """Write a series in time for ParaView: `fields-000123.vtu` for every state, and `fields.pvd` with their times.

    Args:
        directory: where the files go.
        states: number of the time step, time in s, fields and further point data of every state.
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


def read_vtu(path: Path) -> Fields:
    """Read back what `write_vtu` has written.

    Raises:
        ValueError: the file holds other cells than quadratic triangles.
    """
    mesh = meshio.read(path, file_format="vtu")
    if [block.type for block in mesh.cells] != ["triangle6"]:
        raise ValueError(f"{path} does not hold exactly one block of quadratic triangles")
    return Fields(
        points=mesh.points[:, :2],
        cells=np.asarray(mesh.cells[0].data, dtype=np.int64),
        region=np.asarray(mesh.cell_data["region"][0], dtype=np.int64),
        displacement=mesh.point_data["displacement"][:, :2],
        velocity=mesh.point_data["velocity"][:, :2],
        pressure=mesh.point_data["pressure"],
        solid_pressure=mesh.point_data.get("solid_pressure"),
    )


def _three(vectors: np.ndarray) -> np.ndarray:
    return np.column_stack([vectors, np.zeros(len(vectors))])
