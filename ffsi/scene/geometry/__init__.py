"""The geometries, each in a module of its own; a scene chooses one by its ``kind``."""

from typing import Annotated

from pydantic import Field

from ffsi.scene.geometry.aneurysm import Aneurysm
from ffsi.scene.geometry.base import ChannelGeometry, GeometryBase, Physics
from ffsi.scene.geometry.channel import Channel
from ffsi.scene.geometry.channel_cavity import ChannelCavity
from ffsi.scene.geometry.channel_cylinder import ChannelCylinder
from ffsi.scene.geometry.flap_channel import FlapChannel
from ffsi.scene.geometry.mesh import MeshGeometry
from ffsi.scene.geometry.solids import Cantilever, CookMembrane

Geometry = Annotated[
    FlapChannel | ChannelCylinder | ChannelCavity | Channel | Aneurysm | CookMembrane | Cantilever | MeshGeometry,
    Field(discriminator="kind"),
]

__all__ = [
    "Aneurysm",
    "Channel",
    "ChannelGeometry",
    "FlapChannel",
    "Geometry",
    "GeometryBase",
    "MeshGeometry",
    "Physics",
]
