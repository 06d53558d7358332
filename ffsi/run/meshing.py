"""The mesh of a scene, before anything is solved."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from ffsi.files import folder
from ffsi.files.arrays import RawMesh, read_mesh
from ffsi.freefem import find_freefem, run_script
from ffsi.freefem.events import Event, OnEvent
from ffsi.scene import Scene, stored
from ffsi.script.render import render_mesh


@dataclass(frozen=True)
class Meshed:
    """The mesh that a scene is computed on, and the number of unknowns on it."""

    mesh: RawMesh
    unknowns: int


def mesh_of(scene: Scene, on_event: OnEvent | None = None) -> Meshed:
    """Let the scene's script make its mesh, and nothing else.

    Raises:
        FreeFEMNotFound: no FreeFEM on this machine.
        FreeFEMError: the mesh cannot be made, or not of elements of these sizes.
    """
    installation = find_freefem()
    unknowns = 0

    def listen(event: Event) -> None:
        nonlocal unknowns
        if event.kind == "mesh":
            unknowns = int(event.fields["unknowns"])
        if on_event is not None:
            on_event(event)

    with tempfile.TemporaryDirectory(prefix="ffsi-mesh-") as name:
        path = Path(name)
        folder.write_text(path / folder.SCRIPT, render_mesh(scene, mumps=installation.has_mumps))
        stored(scene, path)
        script = path / folder.SCRIPT
        run_script(script, {"out": name}, installation=installation, cwd=path, on_event=listen)
        return Meshed(read_mesh(path / folder.MESH), unknowns)
