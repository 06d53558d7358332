"""Meshes of the user's own: read with meshio, checked, given the regions and labels of the project."""

from ffsi.scene.meshes.building import DomainMesh, domain_mesh, stored_naming, write_medit
from ffsi.scene.meshes.errors import FILE, MeshError
from ffsi.scene.meshes.naming import Naming

__all__ = ["FILE", "DomainMesh", "MeshError", "Naming", "domain_mesh", "stored_naming", "write_medit"]
