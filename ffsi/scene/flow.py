"""What drives the flow, inflow and outlet; and the scale of the forces."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, field_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, names, nearest, short
from ffsi.scene.expressions import Expression, ExpressionError
from ffsi.scene.units import Duration, Length, Speed

_TIME = ("t",)
PROFILES = {"parabolic": "1.5 * 4 * y * (H - y) / H^2", "uniform": "1"}


class Inflow(Table):
    """Velocity at the inlet, normal to it and inwards: mean_velocity * profile(y), in time * ramp(t) * waveform(t).

    y is the distance from the inlet's start (`geometry.inlet`).

    The ramp is (1 - cos(pi t/ramp))/2 until t = ramp and 1 from then on.
    """

    mean_velocity: Speed = Field(description="mean velocity of the built-in profiles, m/s")
    profile: str = Field(
        "parabolic",
        description='"parabolic", "uniform" or a dimensionless formula in y (along the inlet) and H (its length), '
        "both in m",
    )
    ramp: Duration | None = Field(
        None, description="time in which the inflow grows from rest by a cosine (none if absent; needs a table time), s"
    )
    waveform: str | None = Field(
        None, description='dimensionless formula in t (s), a factor on the inflow; needs a table time; "1" if absent'
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

    @field_validator("waveform")
    @classmethod
    def _readable_waveform(cls, waveform: str | None) -> str | None:
        try:
            if waveform is not None:
                Expression.parse(waveform, _TIME)
        except ExpressionError as error:
            refuse([Problem("", f"{error}; accepted: a formula in t", short(waveform))])
        return waveform

    @property
    def expression(self) -> Expression:
        """The profile as a formula in y and H (both in m), dimensionless."""
        return Expression.parse(PROFILES.get(self.profile, self.profile))

    @property
    def waveform_expression(self) -> Expression:
        """The waveform as a formula in t (s), dimensionless; "1" if none is given. The ramp is no part of it."""
        return Expression.parse("1" if self.waveform is None else self.waveform, _TIME)

    def factor(self, t: ArrayLike) -> NDArray[np.float64]:
        """Return ramp times waveform at the times t (s, from 0), dimensionless."""
        times = np.asarray(t, dtype=np.float64)
        waveform = self.waveform_expression.evaluate(t=times)
        if self.ramp is None:
            return waveform
        return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.clip(times / self.ramp, 0.0, 1.0))) * waveform)


class Outlet(Table):
    """Natural condition at the outlet."""

    kind: Literal["do-nothing", "zero-traction"] = Field(
        description='"do-nothing" (-p n + mu (grad v) n = 0) or "zero-traction" (sigma n = 0)'
    )


class Forces(Table):
    """Scale of the force coefficients C = 2 f / (density mean_velocity^2 reference_length)."""

    reference_length: Length = Field(description="reference length, m")
