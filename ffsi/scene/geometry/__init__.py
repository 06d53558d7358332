"""The geometries, each in a module of its own; a scene chooses one by its ``kind``."""

from typing import Annotated

from pydantic import Field

from ffsi.scene.geometry.base import ElementSizes, GeometryBase, Physics
from ffsi.scene.geometry.channel_cavity import ChannelCavity
from ffsi.scene.geometry.channel_cylinder import Beam, ChannelCylinder
from ffsi.scene.geometry.flap_channel import FlapChannel

Geometry = Annotated[FlapChannel | ChannelCylinder | ChannelCavity, Field(discriminator="kind")]

__all__ = [
    "Beam",
    "ChannelCavity",
    "ChannelCylinder",
    "ElementSizes",
    "FlapChannel",
    "Geometry",
    "GeometryBase",
    "Physics",
]
