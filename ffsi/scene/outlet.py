"""The outlet: natural condition, pressure behind it, backflow stabilisation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, StrictBool, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, names, short
from ffsi.scene.json_schema import absent, equals, every, given, when
from ffsi.scene.units import Compliance, NonNegativeResistance, Quantity, Resistance, Stress

# Keys of each kind, the needed ones first, then those that may be given.
KEYS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "do-nothing": ((), ()),
    "zero-traction": ((), ()),
    "pressure": (("pressure",), ()),
    "resistance": (("resistance",), ("pressure",)),
    "windkessel": (("proximal_resistance", "distal_resistance", "compliance"), ("pressure",)),
}
PRESSURES = {key for keys in KEYS.values() for key in (*keys[0], *keys[1])}


class Outlet(Table):
    """Natural condition at the outlet; Q is the flow rate through it in m^2/s, per metre of depth.

    The pressure behind the outlet is, by kind, `pressure` P; `resistance` P + R Q; `windkessel` R_p Q + p_c with
    C dp_c/dt + (p_c - P)/R_d = Q. In time P is multiplied by the ramp of the inflow. With `hydrostatic`, rho g.(x - x0)
    is added to it, the weight of fluid at rest below x0, the outlet's point against gravity's direction.
    """

    model_config = ConfigDict(
        json_schema_extra=every(
            when(
                equals("kind", kind),
                every([given(*needed), absent(*sorted(PRESSURES - {*needed, *optional}))]),
            )
            for kind, (needed, optional) in KEYS.items()
        )
    )

    kind: Literal["do-nothing", "zero-traction", "pressure", "resistance", "windkessel"] = Field(
        description='"do-nothing" (-p n + mu (grad v) n = 0), "zero-traction" (sigma n = 0), or do-nothing with a '
        'pressure behind it: "pressure", "resistance", "windkessel"'
    )
    pressure: Stress | None = Field(
        None, description="pressure P; behind the resistances, 0 if absent, with resistance and windkessel, Pa"
    )
    resistance: NonNegativeResistance | None = Field(None, description="resistance R, resistance only, Pa s/m^2")
    proximal_resistance: NonNegativeResistance | None = Field(
        None, description="resistance R_p between outlet and compliance, windkessel only, Pa s/m^2"
    )
    distal_resistance: Resistance | None = Field(
        None, description="resistance R_d behind the compliance, windkessel only, Pa s/m^2"
    )
    compliance: Compliance | None = Field(None, description="compliance C, windkessel only, m^2/Pa")
    backflow: Annotated[float, Quantity("1", above=0.0, at_most=1.0)] | None = Field(
        None,
        description="factor beta, usually 0.2 to 1, of the traction -beta rho min(v.n, 0) v against backflow, "
        "dimensionless",
    )

    hydrostatic: StrictBool | None = Field(
        None,
        description="whether the pressure behind the outlet grows along gravity as in fluid at rest, from its highest "
        "point on (true or false); needs gravity",
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        refuse(list(self._problems()))
        if self.pressure is None and "pressure" in KEYS[self.kind][1]:
            # Still under construction: the only place where a value of an outlet is set.
            object.__setattr__(self, "pressure", 0.0)
        return self

    def _problems(self) -> Iterator[Problem]:
        needed, optional = KEYS[self.kind]
        for key in needed:
            if getattr(self, key) is None:
                yield Problem(key, f"missing; {type(self).model_fields[key].description}")
        for key in sorted(PRESSURES):
            value = getattr(self, key)
            if value is not None and key not in (*needed, *optional):
                kinds = names(kind for kind, keys in KEYS.items() if key in (*keys[0], *keys[1]))
                yield Problem(key, f'not accepted with the kind "{self.kind}", only with {kinds}', short(value))

    @property
    def has_pressure(self) -> bool:
        """Whether there is a pressure behind the outlet."""
        return bool(KEYS[self.kind][0])
