"""What drives the flow, inflow and outlet; and the scale of the forces."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, names, nearest, short
from ffsi.scene.expressions import Expression, ExpressionError
from ffsi.scene.units import Length, Speed

PROFILES = {"parabolic": "1.5 * 4 * y * (H - y) / H^2", "uniform": "1"}


class Inflow(Table):
    """Velocity at the inlet: v_x = mean_velocity * profile(y), v_y = 0."""

    mean_velocity: Speed = Field(description="mean velocity of the built-in profiles, m/s")
    profile: str = Field(
        "parabolic",
        description='"parabolic", "uniform" or a dimensionless formula in y and H, both in m (H: channel height)',
    )

    @field_validator("profile")
    @classmethod
    def _readable(cls, profile: str) -> str:
        try:
            Expression.parse(PROFILES.get(profile, profile))
        except ExpressionError as error:
            accepted = f"{error}; accepted: {names(PROFILES)} or a formula in y and H"
            refuse([Problem("", accepted, short(profile), nearest(profile, PROFILES))])
        return profile

    @property
    def expression(self) -> Expression:
        """The profile as a formula in y and H (both in m), dimensionless."""
        return Expression.parse(PROFILES.get(self.profile, self.profile))


class Outlet(Table):
    """Natural condition at the outlet."""

    kind: Literal["do-nothing", "zero-traction"] = Field(
        description='"do-nothing" (-p n + mu (grad v) n = 0) or "zero-traction" (sigma n = 0)'
    )


class Forces(Table):
    """Scale of the force coefficients C = 2 f / (density mean_velocity^2 reference_length)."""

    reference_length: Length = Field(description="reference length, m")
