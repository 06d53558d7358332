"""What a scene is: models with units, TOML in and out, the catalogue, boundaries and their roles."""

from ffsi.scene.boundaries import Boundary, Role
from ffsi.scene.catalogue import CASES
from ffsi.scene.errors import Problem, SceneError
from ffsi.scene.expressions import Expression, ExpressionError
from ffsi.scene.files import load_scene, scene_of, stored
from ffsi.scene.flow import Forces, Inflow
from ffsi.scene.fluids import Carreau, Casson, Fluid, Newtonian, PowerLaw
from ffsi.scene.geometry import (
    Aneurysm,
    Beam,
    Cantilever,
    Channel,
    ChannelCavity,
    ChannelCylinder,
    CookMembrane,
    ElementSizes,
    FlapChannel,
    Geometry,
    MeshGeometry,
    Physics,
    Roof,
    Stent,
)
from ffsi.scene.loads import Gravity, Support, Traction
from ffsi.scene.materials import MooneyRivlin, NeoHookean, Solid, StVenantKirchhoff
from ffsi.scene.model import Scene, boundaries
from ffsi.scene.numerics import Mesh, MeshMotion, Output, Solver
from ffsi.scene.outlet import Outlet
from ffsi.scene.overrides import parse_overrides, with_values
from ffsi.scene.time import Time
from ffsi.scene.units import to_si

__all__ = [
    "CASES",
    "Aneurysm",
    "Beam",
    "Boundary",
    "Cantilever",
    "Carreau",
    "Casson",
    "Channel",
    "ChannelCavity",
    "ChannelCylinder",
    "CookMembrane",
    "ElementSizes",
    "Expression",
    "ExpressionError",
    "FlapChannel",
    "Fluid",
    "Forces",
    "Geometry",
    "Gravity",
    "Inflow",
    "Mesh",
    "MeshGeometry",
    "MeshMotion",
    "MooneyRivlin",
    "NeoHookean",
    "Newtonian",
    "Outlet",
    "Output",
    "Physics",
    "PowerLaw",
    "Problem",
    "Role",
    "Roof",
    "Scene",
    "SceneError",
    "Solid",
    "Solver",
    "StVenantKirchhoff",
    "Stent",
    "Support",
    "Time",
    "Traction",
    "boundaries",
    "load_scene",
    "parse_overrides",
    "scene_of",
    "stored",
    "to_si",
    "with_values",
]
