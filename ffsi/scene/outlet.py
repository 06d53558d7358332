"""The outlet: natural condition, pressure behind it, backflow stabilisation."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Discriminator, Field, StrictBool, Tag, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, names, short
from ffsi.scene.json_schema import absent, equals, every, given, when
from ffsi.scene.units import Compliance, NonNegativeResistance, Quantity, Resistance, Stress


@dataclass(frozen=True)
class OutletLaw:
    """What is known of a kind of outlet.

    Args:
        traction: the condition, as a script states it.
        needed: keys that it needs.
        optional: keys that may be given.
        stores: whether its pressure follows in time from what came before.
    """

    traction: str
    needed: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    stores: bool = False

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that it takes."""
        return (*self.needed, *self.optional)


_TRACTION = "-p n + mu (grad v) n = "
OUTLETS = {
    "do-nothing": OutletLaw(_TRACTION + "0"),
    "zero-traction": OutletLaw("P N = 0"),
    "pressure": OutletLaw(_TRACTION + "- P n", ("pressure",)),
    "resistance": OutletLaw(_TRACTION + "- (P + R Q) n", ("resistance",), ("pressure",)),
    "windkessel": OutletLaw(
        _TRACTION + "- (R_p Q + p_c) n, C dp_c/dt + (p_c - P)/R_d = Q",
        ("proximal_resistance", "distal_resistance", "compliance"),
        ("pressure",),
        stores=True,
    ),
}
PRESSURES = {key for law in OUTLETS.values() for key in law.keys}


class Outlet(Table):
    """Natural condition at the outlet; Q is the flow rate through it in m^2/s, per metre of depth.

    The pressure behind the outlet is, by kind, `pressure` P; `resistance` P + R Q; `windkessel` R_p Q + p_c with
    C dp_c/dt + (p_c - P)/R_d = Q. In time P is multiplied by the ramp of the inflow. With `hydrostatic`, rho g.(x - x0)
    is added to it, the weight of fluid at rest below x0, the outlet's point against gravity's direction.
    """

    model_config = ConfigDict(
        json_schema_extra=every(
            when(equals("kind", kind), every([given(*law.needed), absent(*sorted(PRESSURES.difference(law.keys)))]))
            for kind, law in OUTLETS.items()
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
        if self.pressure is None and "pressure" in self.law.optional:
            self.fill(pressure=0.0)
        return self

    def _problems(self) -> Iterator[Problem]:
        for key in self.law.needed:
            if getattr(self, key) is None:
                yield Problem(key, f"missing; {type(self).model_fields[key].description}")
        for key in sorted(PRESSURES):
            value = getattr(self, key)
            if value is not None and key not in self.law.keys:
                kinds = names(kind for kind, law in OUTLETS.items() if key in law.keys)
                yield Problem(key, f'not accepted with the kind "{self.kind}", only with {kinds}', short(value))

    @property
    def law(self) -> OutletLaw:
        """What is known of the kind."""
        return OUTLETS[self.kind]

    @property
    def has_pressure(self) -> bool:
        """Whether there is a pressure behind the outlet."""
        return bool(self.law.needed)


def _number(value: Any) -> str:
    """Tell one table from several by name."""
    return (
        "several"
        if isinstance(value, Mapping) and any(isinstance(v, Mapping | Table) for v in value.values())
        else "one"
    )


Outlets = Annotated[
    Annotated[Outlet, Tag("one")] | Annotated[dict[str, Outlet], Tag("several")], Discriminator(_number)
]
"""The table of the only outlet, or those of several by name."""
