"""What a scene is: models with units, TOML in and out, the catalogue, boundaries and their roles."""

from ffsi.scene.boundaries import Boundary
from ffsi.scene.errors import SceneError
from ffsi.scene.files import CASES, load_scene, scene_of, scenes_before, stored
from ffsi.scene.fluids import Newtonian
from ffsi.scene.geometry import Aneurysm, MeshGeometry
from ffsi.scene.model import Scene
from ffsi.scene.overrides import with_values
from ffsi.scene.sides import boundaries

__all__ = [
    "CASES",
    "Aneurysm",
    "Boundary",
    "MeshGeometry",
    "Newtonian",
    "Scene",
    "SceneError",
    "boundaries",
    "load_scene",
    "scene_of",
    "scenes_before",
    "stored",
    "with_values",
]
