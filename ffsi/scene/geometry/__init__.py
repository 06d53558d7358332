"""The geometries, each in a module of its own; a scene chooses one by its ``kind``."""

from typing import Annotated

from pydantic import Field

from ffsi.scene.geometry.aneurysm import Aneurysm, Stent
from ffsi.scene.geometry.base import ChannelGeometry, ElementSizes, GeometryBase, Inlet, Physics
from ffsi.scene.geometry.cantilever import Cantilever
from ffsi.scene.geometry.channel import Channel
from ffsi.scene.geometry.channel_cavity import ChannelCavity
from ffsi.scene.geometry.channel_cylinder import Beam, ChannelCylinder
from ffsi.scene.geometry.cook_membrane import CookMembrane
from ffsi.scene.geometry.flap_channel import FlapChannel, Roof
from ffsi.scene.geometry.mesh import MeshGeometry

Geometry = Annotated[
    FlapChannel | ChannelCylinder | ChannelCavity | Channel | Aneurysm | CookMembrane | Cantilever | MeshGeometry,
    Field(discriminator="kind"),
]

__all__ = [
    "Aneurysm",
    "Beam",
    "Cantilever",
    "Channel",
    "ChannelCavity",
    "ChannelCylinder",
    "ChannelGeometry",
    "CookMembrane",
    "ElementSizes",
    "FlapChannel",
    "Geometry",
    "GeometryBase",
    "Inlet",
    "MeshGeometry",
    "Physics",
    "Roof",
    "Stent",
]
