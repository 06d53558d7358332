"""Forces from outside: gravity, traction, and the support of walls."""

from __future__ import annotations

from pydantic import Field

from ffsi.scene.base import Table
from ffsi.scene.units import Acceleration, FoundationDamping, FoundationStiffness, Stress


class Gravity(Table):
    """Acceleration by gravity, on fluid and solids."""

    x: Acceleration = Field(0.0, description="x component, m/s^2")
    y: Acceleration = Field(0.0, description="y component, m/s^2")


class Traction(Table):
    """Dead traction on the loaded boundary: it keeps its direction, and counts per reference length."""

    x: Stress = Field(0.0, description="x component, Pa")
    y: Stress = Field(0.0, description="y component, Pa")


class Support(Table):
    """Elastic support of the outer sides of walls by their surroundings: the traction is -(stiffness u + damping v)."""

    stiffness: FoundationStiffness = Field(0.0, description="stiffness per reference length of the wall, Pa/m")
    damping: FoundationDamping = Field(0.0, description="damping per reference length of the wall, Pa s/m")
