"""Values with units."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from ffsi.scene import Newtonian, Scene, SceneError
from ffsi.scene.numerics import Solver
from ffsi.scene.units import Quantity, to_si
from ffsi.scene.validation import models


@pytest.mark.parametrize(("text", "unit", "value"), [
    ("3.5 mPa s", "Pa s", 0.0035), ("3.5mPa*s", "Pa s", 0.0035), ("1 cP", "Pa s", 0.001), ("1 kg/(m s)", "Pa s", 1.0),
    ("1 kg/m/s", "Pa s", 1.0), ("2 N s/m^2", "Pa s", 2.0), ("3 µPa s", "Pa s", 3e-6), ("2.5 m", "m", 2.5),
    ("25cm", "m", 0.25), ("+.5e1 mm", "m", 0.005), ("-1 inch", "m", -0.0254), ("0.012 m/s", "m/s", 0.012),
    ("12 mm/s", "m/s", 0.012), ("36 km/h", "m/s", 10.0), ("9.81 m s^-2", "m/s^2", 9.81), ("9.81 m/s²", "m/s^2", 9.81),
    ("1 g/cm^3", "kg/m^3", 1000.0), ("1 g/cm**3", "kg/m^3", 1000.0), ("1060 kg/m3", "kg/m^3", 1060.0),
    ("0.5 MPa", "Pa", 5e5), ("120 mmHg", "Pa", 15998.68641), ("2 min", "s", 120.0),
])  # fmt: skip
def test_conversion(text: str, unit: str, value: float) -> None:
    assert to_si(text, unit) == pytest.approx(value, rel=1e-7 if "mmHg" in text else 1e-15, abs=0.0)


@pytest.mark.parametrize("text", [
    "", "m", "1", "1 2 m", "1 m s", "1 m^2", "1 kg", "1 degC", "1 m m^-2", "1..2 m", "1 m/", "1 m//s", "9**9**9 m",
    "1 m**99", "1 (m", "__import__('os') m", "1 __class__", "1 m; 2", "1e9999 m", "0x10 m", "nan m", "inf m",
    "1 m" + " " * 80,
])  # fmt: skip
def test_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"unit|number|dimension|convert"):
        to_si(text, "m")


def test_numbers_are_si_and_become_floats() -> None:
    fluid = Newtonian(density=1, viscosity=np.float64(2e-3))
    assert (fluid.density, fluid.viscosity) == (1.0, 0.002) and type(fluid.density) is float
    assert type(fluid.viscosity) is float and type(Solver(max_iterations=np.int64(7)).max_iterations) is int
    assert Solver(max_iterations=7.0).max_iterations == 7


@pytest.mark.parametrize("value", [True, None, float("nan"), float("inf"), 1j, [1.0], 10**400, "1e-3"])
def test_no_number(value: Any) -> None:
    with pytest.raises(SceneError):
        Newtonian(density=1, viscosity=value)


def fields(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, field in model.model_fields.items():
        yield prefix + name, field
        inner = models(field.annotation)
        if field.annotation is not None and str(field.annotation).startswith("dict"):
            inner = models(field.annotation.__args__[1])
        for table in inner:
            yield from fields(table, f"{prefix}{name}.")


def quantities(thing: Any) -> list[Quantity]:
    found = [item for item in getattr(thing, "metadata", []) if type(item) is Quantity]
    found += [item for item in getattr(thing, "__metadata__", []) if type(item) is Quantity]
    inner = getattr(thing, "annotation", None)
    parts = [*getattr(thing, "__args__", ()), *([inner] if inner is not None else [])]
    return found + [item for part in parts for item in quantities(part)]


def test_every_description_states_the_unit() -> None:
    seen = 0
    for key, field in fields(Scene):
        assert field.description, key
        for quantity in quantities(field):
            expected = "dimensionless" if quantity.unit == "1" else f", {quantity.unit}"
            assert field.description.endswith(expected), key
            seen += 1
    assert seen > 40
