"""Quadratic triangles for ParaView: Fields -> meshio -> VTU files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import Floats
from ffsi.result.fields import Fields

if TYPE_CHECKING:
    import meshio


def to_meshio(fields: Fields, more: Mapping[str, Floats] | None = None) -> meshio.Mesh:
    """Return the reference mesh with its fields.

    Point data: `displacement` (m), `velocity` (m/s), `pressure` (Pa), with mixed solids `solid_pressure` (Pa), and
    `more` by name, (n,) or (n, 2); cell data: `region`. Vectors have three components (the third is zero), so that
    ParaView can warp by `displacement`.
    """
    import meshio

    names = ("displacement", "velocity", "pressure", *(["solid_pressure"] if fields.solid_pressure is not None else []))
    values = {name: getattr(fields, name) for name in names} | dict(more or {})
    return meshio.Mesh(
        points=_three(fields.points),
        cells=[("triangle6", fields.cells)],
        point_data={name: _three(each) if each.ndim == 2 else each for name, each in values.items()},
        cell_data={"region": [fields.region]},
    )


def write_vtu(path: Path, fields: Fields, more: Mapping[str, Floats] | None = None) -> None:
    """Write fields and further point data as a compressed VTU file of quadratic triangles, reference configuration."""
    partial = path.with_name(f".{path.name}.part")
    to_meshio(fields, more).write(partial, file_format="vtu", binary=True, compression="zlib")
    partial.replace(path)


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
