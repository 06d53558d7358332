"""Numbers with units: a value is a number in SI or a string with a unit, such as "3.5 mPa s"."""

from __future__ import annotations

import contextlib
import functools
import math
import numbers
import operator
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Annotated, Any, cast

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ffsi.scene.errors import number_text

if TYPE_CHECKING:
    import pint

_LIMIT = 60
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)(?![\d.])\s*(.*?)\s*", re.DOTALL)
_FACTOR = r"[A-Za-zµμ]+(?:(?:\^|\*\*)?-?\d)?"
_PRODUCT = rf"{_FACTOR}(?:\s*[ *.·]\s*{_FACTOR})*"
# After "/" either one unit or a bracket: "kg/m s" could mean two things.
_UNIT = re.compile(rf"{_PRODUCT}(?:\s*/\s*(?:{_FACTOR}|\(\s*{_PRODUCT}\s*\)))*")
# The same in a JSON schema, which can say neither what a unit measures nor more of a range than a sign.
_WITH_UNIT = _NUMBER.pattern.replace("(.*?)", _UNIT.pattern.replace(r"-?\d", r"-?\d|[²³]"))
_POSITIVE, _NOT_NEGATIVE = r"(?=\s*\+?[\d.]*[1-9])", r"(?!\s*-[\d.]*[1-9])"
_EXAMPLES = {
    "m": "20 cm",
    "m/s": "12 mm/s",
    "m/s^2": "981 cm/s^2",
    "kg/m^3": "1 g/cm^3",
    "Pa s": "3.5 mPa s",
    "Pa": "0.5 MPa",
    "N/m": "2 N/mm",
    "m^2/s": "1 cm^2/s",
    "Pa s/m^2": "2 kPa s/m^2",
    "m^2/Pa": "3 mm^2/kPa",
    "Pa/m": "1 kPa/mm",
    "Pa s/m": "2 kPa s/m",
    "s": "10 min",
    "1/s": "2 s^-1",
    "s^2": "10 s^2",
}


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    # Decimal keeps "3.5 mPa s" at exactly 0.0035. Loaded on first use: it takes a noticeable fraction of a second.
    return pint.UnitRegistry(non_int_type=Decimal)


def _canonical(unit: str) -> str:
    """Return the unit in the form that pint reads: "mPa s" -> "mPa*s", "kg/m3" -> "kg/m**3"."""
    unit = re.sub(r"\s*[*.·](?!\*)\s*(?=[A-Za-zµμ])|(?<=[\w)])\s+(?=[A-Za-zµμ])", "*", unit)
    return re.sub(r"(?<=[A-Za-zµμ])(?:\^|\*\*)?(-?\d)", r"**(\1)", unit)


def to_si(text: str, unit: str) -> float:
    """Convert a string with a unit to a number in an SI unit.

    Args:
        text: number and unit, such as "3.5 mPa s", "1 g/cm^3" or "0.012 m/s".
        unit: the SI unit of the result, such as "Pa s".

    Raises:
        ValueError: the text is no number with a unit, the unit is unknown or has another dimension.
    """
    text = text.replace("²", "^2").replace("³", "^3")
    found = _NUMBER.fullmatch(text) if len(text) <= _LIMIT else None
    if found is None:
        raise ValueError("not a number with a unit")
    number, given = found.groups()
    if not given:
        raise ValueError("the unit is missing")
    if not _UNIT.fullmatch(given):
        raise ValueError(f'"{given}" cannot be read as a unit (write it like "mPa s" or "kg/(m s)")')
    import pint  # takes a third of a second to load

    registry = _registry()
    try:
        quantity = registry.Quantity(Decimal(number), _canonical(given))
        return float(quantity.to(_canonical(unit)).magnitude)
    except pint.UndefinedUnitError as error:
        unknown = error.unit_names if isinstance(error.unit_names, str) else ", ".join(error.unit_names)
        raise ValueError(f'"{unknown}" is not a known unit') from None
    except pint.DimensionalityError:
        raise ValueError(f'"{given}" has the wrong dimension') from None
    except (pint.PintError, ArithmeticError, LookupError, TypeError, ValueError):  # LookupError: m^0
        raise ValueError(f'"{given}" cannot be converted to {unit}') from None


class Checked(ABC):
    """Annotation of a field: how its values are checked."""

    @property
    @abstractmethod
    def accepted(self) -> str:
        """Description of the values that are accepted."""

    @abstractmethod
    def __call__(self, value: Any) -> Any:
        """Return a value as the field has it.

        Raises:
            PydanticCustomError: it is not accepted.
        """

    def refused(self, reason: str | None = None) -> PydanticCustomError:
        """Return the error of a value."""
        accepted = f"accepted: {self.accepted}"
        return PydanticCustomError("refused", "{text}", {"text": f"{reason}; {accepted}" if reason else accepted})

    @property
    @abstractmethod
    def json_schema(self) -> dict[str, Any]:
        """JSON schema of the values as a TOML file holds them."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Let pydantic take the JSON schema from this object."""
        return self.json_schema

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Let pydantic check the field by this object."""
        return core_schema.no_info_plain_validator_function(cast(Callable[[Any], Any], self))


# Bounds by name: how they are written, compared, and called in a JSON schema.
_BOUNDS: dict[str, tuple[str, Callable[[float, float], bool], str]] = {
    "above": (">", operator.gt, "exclusiveMinimum"),
    "at_least": (">=", operator.ge, "minimum"),
    "below": ("<", operator.lt, "exclusiveMaximum"),
    "at_most": ("<=", operator.le, "maximum"),
}


@dataclass(frozen=True)
class Quantity(Checked):
    """Annotation of a float field: its SI unit and the range that is accepted.

    The unit is "1" for a number without dimension, "Pa s^m" where m is a value of the scene; bounds are in it.
    """

    unit: str
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None

    @property
    def bounds(self) -> dict[str, float]:
        """The bounds that there are, by name."""
        return {name: bound for name in _BOUNDS if (bound := getattr(self, name)) is not None}

    @property
    def range(self) -> str:
        """The range that is accepted, such as "> 0 and <= 1"; empty for all numbers."""
        return " and ".join(f"{_BOUNDS[name][0]} {number_text(bound)}" for name, bound in self.bounds.items())

    @property
    def accepted(self) -> str:
        """Description of the values that are accepted."""
        text = f"a number {self.range}".rstrip()
        if self.unit == "1":
            return text
        example = _EXAMPLES.get(self.unit)
        return f"{text} in {self.unit}" + (f', or a string with a unit such as "{example}"' if example else "")

    def __call__(self, value: Any) -> float:
        """Return the value in SI; refuse what is no finite number, has a wrong dimension or is out of range."""
        if isinstance(value, str):
            if self.unit not in _EXAMPLES:
                raise self.refused("text is not accepted here")
            try:
                number = to_si(value, self.unit)
            except ValueError as error:
                raise self.refused(str(error)) from None
        elif hasattr(value, "magnitude"):  # a quantity of pint, of whatever registry
            import pint

            try:
                number = float(value.to(_canonical(self.unit)).magnitude)
                with contextlib.suppress(ValueError):  # the same digits as of the text, if its unit is one of ours
                    number = to_si(f"{value.magnitude} {value.units:C}", self.unit)
            except (pint.PintError, TypeError, ValueError):
                raise self.refused("the unit does not fit") from None
        elif isinstance(value, bool) or not isinstance(value, numbers.Real | Decimal):
            raise self.refused("not a number")
        else:
            try:
                number = float(value)
            except OverflowError:
                raise self.refused("too large") from None
        if not math.isfinite(number):
            raise self.refused("not a finite number")
        self._inside(number)
        return number

    def _inside(self, number: float) -> None:
        if not all(_BOUNDS[name][1](number, bound) for name, bound in self.bounds.items()):
            raise self.refused("out of range")

    @property
    def json_schema(self) -> dict[str, Any]:
        """JSON schema: a number in the range, or a text that may be one with a unit."""
        number = {"type": "number", **{_BOUNDS[name][2]: bound for name, bound in self.bounds.items()}}
        if self.unit not in _EXAMPLES:
            return number
        sign = _POSITIVE if self.above == 0 else _NOT_NEGATIVE if self.at_least == 0 else ""
        text = {"type": "string", "maxLength": _LIMIT, "pattern": f"^{sign}{_WITH_UNIT}$"}
        return {"anyOf": [number, {**text, "examples": [_EXAMPLES[self.unit]]}]}


class Count(Quantity):
    """Annotation of a whole-number field with inclusive bounds."""

    def __init__(self, minimum: int, maximum: int) -> None:
        """Take the bounds."""
        super().__init__("1", at_least=minimum, at_most=maximum)

    @property
    def accepted(self) -> str:
        """Description of the values that are accepted."""
        return f"a whole number from {self.at_least} to {self.at_most}"

    def __call__(self, value: Any) -> int:
        """Return the value as int; 2.0 counts as 2."""
        is_whole = isinstance(value, int) or (isinstance(value, numbers.Real) and float(value).is_integer())
        if isinstance(value, bool) or not is_whole:
            raise self.refused("not a whole number")
        self._inside(value)
        return int(value)

    @property
    def json_schema(self) -> dict[str, Any]:
        """JSON schema."""
        return {"type": "integer", "minimum": self.at_least, "maximum": self.at_most}


Number = Annotated[float, Quantity("1")]
PositiveNumber = Annotated[float, Quantity("1", above=0.0)]
NonNegativeNumber = Annotated[float, Quantity("1", at_least=0.0)]
Length = Annotated[float, Quantity("m", above=0.0)]
Coordinate = Annotated[float, Quantity("m")]
Speed = Annotated[float, Quantity("m/s", at_least=0.0)]
Acceleration = Annotated[float, Quantity("m/s^2")]
Density = Annotated[float, Quantity("kg/m^3", above=0.0)]
NonNegativeDensity = Annotated[float, Quantity("kg/m^3", at_least=0.0)]
Viscosity = Annotated[float, Quantity("Pa s", above=0.0)]
Consistency = Annotated[float, Quantity("Pa s^m", above=0.0)]
Modulus = Annotated[float, Quantity("Pa", above=0.0)]
NonNegativeModulus = Annotated[float, Quantity("Pa", at_least=0.0)]
Stress = Annotated[float, Quantity("Pa")]
LineForce = Annotated[float, Quantity("N/m")]
Duration = Annotated[float, Quantity("s", above=0.0)]
SquaredTime = Annotated[float, Quantity("s^2", above=0.0)]
Rate = Annotated[float, Quantity("1/s", at_least=0.0)]
ShearRate = Annotated[float, Quantity("1/s", above=0.0)]
FlowRate = Annotated[float, Quantity("m^2/s", at_least=0.0)]
Resistance = Annotated[float, Quantity("Pa s/m^2", above=0.0)]
NonNegativeResistance = Annotated[float, Quantity("Pa s/m^2", at_least=0.0)]
Compliance = Annotated[float, Quantity("m^2/Pa", above=0.0)]
FoundationStiffness = Annotated[float, Quantity("Pa/m", at_least=0.0)]
FoundationDamping = Annotated[float, Quantity("Pa s/m", at_least=0.0)]
