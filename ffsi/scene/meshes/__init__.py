"""Meshes of the user's own: read with meshio, checked, given the regions and labels of the project."""
