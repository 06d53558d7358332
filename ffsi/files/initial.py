"""The state that a run in time starts from: that of another run, in its folder or copied into the new one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import Ints, RawMesh, RawState, read_mesh, read_state, write_mesh, write_state
from ffsi.files.machine import writing

STORED = "initial"
"""How the names of its files in a run folder begin (docs/formats.md)."""


@dataclass(frozen=True, eq=False)
class Initial:
    """A state on its mesh, reference coordinates in m."""

    mesh: RawMesh
    state: RawState

    @classmethod
    def read(cls, where: str) -> Initial:
        """Return the last state of a run folder, or a copy by the beginning of its files' names.

        Raises:
            InputError: no such state, or a damaged one.
            OSError: its files cannot be read.
        """
        path = Path(where)
        mesh, state = path / folder.MESH, path / folder.numbered(folder.STATE, 1)
        if not path.is_dir():
            mesh, state = (path.with_name(f"{path.name}-{what}.bin") for what in ("mesh", "state"))
        found = read_mesh(mesh)
        return cls(found, read_state(state, found))

    def write(self, directory: Path) -> None:
        """Copy it into a folder, with the mesh in the format of Medit beside it, as the script reads it."""
        write_mesh(directory / f"{STORED}-mesh.bin", self.mesh)
        write_state(directory / f"{STORED}-state.bin", self.state)
        mesh, path = self.mesh, directory / f"{STORED}.mesh"
        rows = {
            "Vertices": [f"{x!r} {y!r} 0" for x, y in mesh.vertices.tolist()],
            "Triangles": _rows(mesh.triangles + 1, mesh.region),
            "Edges": _rows(mesh.edges + 1, mesh.label),
        }
        parts = [f"{name}\n{len(lines)}\n" + "\n".join(lines) for name, lines in rows.items()]
        with writing(path):
            path.write_text("\n".join(["MeshVersionFormatted 2\nDimension 2", *parts, "End\n"]), encoding="ascii")

    @property
    def digest(self) -> str:
        """A text that is equal for equal states only."""
        arrays = (self.mesh.vertices, self.mesh.triangles, self.mesh.region, self.mesh.p2, *self.state.fields)
        return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def _rows(numbers: Ints, labels: Ints) -> list[str]:
    return [" ".join(map(str, row)) for row in np.column_stack([numbers, labels]).tolist()]
