"""Materials, viscosity laws and values with units: constants, conversions, what is refused."""

import math
from collections.abc import Iterator
from typing import Any, Literal, get_args

import numpy as np
import pytest
from pydantic import BaseModel, Field
from test_scene_malformed import check

from ffsi.scene import CASES, Newtonian, Scene, SceneError, load_scene, with_values
from ffsi.scene.fluids import LAWS, Carreau, Casson, Fluid, PowerLaw
from ffsi.scene.materials import MATERIALS, Elastic, MooneyRivlin, NeoHookean, Solid, StVenantKirchhoff
from ffsi.scene.numerics import Solver
from ffsi.scene.units import Modulus, Quantity, to_si
from ffsi.scene.validation import models


def svk(**values: object) -> StVenantKirchhoff:
    return StVenantKirchhoff(material="st-venant-kirchhoff", density=1, **values)


def test_elastic_constants_convert_and_are_the_published_ones() -> None:
    young, nu = 1000.0, 0.25
    expected = (400.0, 400.0)
    assert svk(young_modulus=young, poisson_ratio=nu).lame == pytest.approx(expected, rel=1e-14)
    assert svk(lame_mu=400, poisson_ratio=nu).lame == pytest.approx(expected, rel=1e-14)
    assert svk(lame_lambda=400, lame_mu=400).lame == expected
    for solid in (svk(young_modulus=young, poisson_ratio=nu), svk(lame_mu=400, poisson_ratio=nu),
                  svk(lame_lambda=400, lame_mu=400)):  # fmt: skip
        assert solid.young_poisson == pytest.approx((young, nu), rel=1e-14)
    assert CASES["turek-fsi1"].solid["beam"].young_poisson == pytest.approx((1.4e6, 0.4), rel=1e-14)
    assert CASES["turek-fsi1"].solid["beam"].lame == pytest.approx((2.0e6, 0.5e6), rel=1e-14)
    assert CASES["flap-svk"].solid["flap"].young_poisson == pytest.approx((5.6, 0.4), rel=1e-14)
    assert svk(lame_lambda=-1, lame_mu=2).young_poisson[1] == pytest.approx(-0.5, rel=1e-14)
    assert svk(lame_mu=2, poisson_ratio=-0.5).lame == pytest.approx((-1, 2), rel=1e-14)
    assert svk(lame_mu=2, poisson_ratio=0.0).lame == (0.0, 2.0)
    for pair in ({"lame_lambda": 8, "lame_mu": 2}, {"young_modulus": 5.6, "poisson_ratio": 0.4},
                 {"lame_mu": 2, "poisson_ratio": 0.4}):  # fmt: skip
        solid = NeoHookean(material="neo-hookean", density=1, **pair)
        assert set(solid.given_constants) == set(pair) and solid.lame == pytest.approx((8.0, 2.0), rel=1e-14)
        assert solid.young_poisson == pytest.approx((5.6, 0.4), rel=1e-14)
    with pytest.raises(SceneError, match=r"^lame_lambda: the elastic constants are missing"):
        NeoHookean(material="neo-hookean", density=1)


def test_mooney_rivlin_at_rest_and_formulations() -> None:
    paper = CASES["flap-mooney-rivlin"].solid["flap"]
    assert isinstance(paper, MooneyRivlin) and paper.lame == pytest.approx((5.6 - 700 / 3, 350), rel=1e-14)
    assert paper.young_poisson == pytest.approx((17640 / 366.8, -683.2 / 733.6), rel=1e-14)
    assert paper.young_poisson[1] == pytest.approx(-0.93, abs=0.005)
    stiff = MooneyRivlin(material="mooney-rivlin", density=1, c10="75 Pa", c01=0, bulk_modulus="17.5 kPa")
    young, nu = stiff.young_poisson
    lame_lambda, lame_mu = stiff.lame
    assert lame_mu == 150 and young == pytest.approx(2 * lame_mu * (1 + nu), rel=1e-14)
    assert nu == pytest.approx(lame_lambda / (2 * (lame_lambda + lame_mu)), rel=1e-14)
    with pytest.raises(SceneError, match=r"^c10 = 0 Pa: c10 \+ c01 must be greater than 0 Pa$"):
        MooneyRivlin(material="mooney-rivlin", density=1, c10=0, c01=0, bulk_modulus=1)

    def kinds(solid: Elastic) -> tuple[bool, bool]:
        return solid.mixed, solid.incompressible

    assert kinds(svk(lame_lambda=8, lame_mu=2)) == (False, False)
    for law, values, volume in [
        (NeoHookean, NEO | {"lame_mu": 2}, {"lame_lambda": 8}), (MooneyRivlin, MOONEY_RIVLIN, {"bulk_modulus": 5.6})
    ]:  # fmt: skip
        assert kinds(law(**values, **volume)) == (False, False)
        assert kinds(law(**values, **volume, formulation="displacement")) == (False, False)
        assert kinds(law(**values, **volume, formulation="mixed")) == (True, False)
        assert kinds(law(**values, formulation="incompressible")) == (True, True)


NEO = {"material": "neo-hookean", "density": 1}
MOONEY_RIVLIN = {"material": "mooney-rivlin", "density": 1, "c10": 75, "c01": 100}


@pytest.mark.parametrize(("solid", "young", "nu", "lame_lambda", "mu", "bulk"), [
    (svk(lame_lambda=8, lame_mu=2), 5.6, 0.4, 8, 2, 28 / 3),
    (svk(young_modulus=5.6, poisson_ratio=0.4), 5.6, 0.4, 8, 2, 28 / 3),
    (NeoHookean(**NEO, lame_mu=2, poisson_ratio=0.4, formulation="mixed"), 5.6, 0.4, 8, 2, 28 / 3),
    (NeoHookean(**NEO, lame_mu=2, formulation="incompressible"), 6, 0.5, math.inf, 2, math.inf),
    (NeoHookean(**NEO, young_modulus="6 Pa", formulation="incompressible"), 6, 0.5, math.inf, 2, math.inf),
    (MooneyRivlin(**MOONEY_RIVLIN, bulk_modulus=700), 900, 2 / 7, 1400 / 3, 350, 700),
    (MooneyRivlin(**MOONEY_RIVLIN, bulk_modulus=700, formulation="mixed"), 900, 2 / 7, 1400 / 3, 350, 700),
    (MooneyRivlin(**MOONEY_RIVLIN, formulation="incompressible"), 1050, 0.5, math.inf, 350, math.inf),
])  # fmt: skip
def test_all_elastic_constants(
    solid: Elastic, young: float, nu: float, lame_lambda: float, mu: float, bulk: float
) -> None:
    expected = {"young_modulus": young, "poisson_ratio": nu, "lame_lambda": lame_lambda, "lame_mu": mu,
                "bulk_modulus": bulk}  # fmt: skip
    assert list(solid.elastic_constants) == list(expected)
    assert solid.elastic_constants == pytest.approx(expected, rel=1e-13)
    assert solid.lame == pytest.approx((lame_lambda, mu), rel=1e-13)
    assert solid.young_poisson == pytest.approx((young, nu), rel=1e-13)


@pytest.mark.parametrize(("known", "union", "key"), [(MATERIALS, Solid, "material"), (LAWS, Fluid, "law")])
def test_laws_are_those_of_the_union(known, union, key) -> None:
    assert tuple(known.values()) == get_args(get_args(union)[0])
    assert all(law.model_fields[key].annotation == Literal[name] for name, law in known.items())


def test_materials_are_their_constants_and_values_at_rest() -> None:
    class Gent(Elastic):
        material: Literal["gent"] = Field(description='material law: "gent"')
        shear: Modulus = Field(description="shear modulus, Pa")

        @property
        def lame(self) -> tuple[float, float]:
            return 4 * self.shear, self.shear

    solid = Gent(material="gent", density=1, shear="2 kPa")
    assert solid.elastic_constants == pytest.approx(
        {"young_modulus": 5600, "poisson_ratio": 0.4, "lame_lambda": 8000, "lame_mu": 2000, "bulk_modulus": 28000 / 3}
    )
    assert not solid.mixed


CASE = "turek-cfd1"
CASSON = "fluid={law='casson', density=1060, yield_stress='5 mPa', viscosity_infinity='3.5 mPa s'}"
POWER_LAW = "fluid={law='power-law', density=1060, consistency=0.0147, exponent=0.7755}"


@pytest.mark.parametrize(("overrides", "expected"), [
    ((), Newtonian(density=1000, viscosity=1)),
    (("fluid.law=newtonian",), Newtonian(density=1000, viscosity=1)),
    (("fluid={density=2, viscosity=3}",), Newtonian(density=2, viscosity=3)),
    (("fluid.law=carreau",), Carreau(density=1000)),
    (("fluid.law=carreau", "fluid.exponent=-0.25", "fluid.time_constant_squared=4 s^2", "fluid.density=1060"),
     Carreau(density=1060, exponent=-0.25, time_constant_squared=4)),
    ((CASSON,), Casson(density=1060, yield_stress=0.005, viscosity_infinity=0.0035)),
    ((CASSON, "fluid.regularisation=0.1 s^-1"),
     Casson(density=1060, yield_stress=0.005, viscosity_infinity=0.0035, regularisation=0.1)),
    ((POWER_LAW,), PowerLaw(density=1060, consistency=0.0147, exponent=0.7755, regularisation=0.01)),
    ((POWER_LAW, "fluid.exponent=1.2"), PowerLaw(density=1060, consistency=0.0147, exponent=1.2)),
])  # fmt: skip
def test_a_law_has_its_own_constants(overrides: tuple[str, ...], expected: Fluid) -> None:
    scene = load_scene(CASE, list(overrides))
    assert type(scene.fluid) is type(expected) and scene.fluid == expected and Scene.from_toml(scene.to_toml()) == scene


def test_carreau_is_blood_and_a_new_law_keeps_what_it_knows() -> None:
    """The constants of the paper's equation (30)."""
    assert Carreau(density=1060).model_dump(exclude_none=True) == {
        "density": 1060, "viscosity_zero": 0.056, "viscosity_infinity": 0.00345, "time_constant_squared": 10.976,
        "exponent": -0.3216, "law": "carreau",
    }  # fmt: skip
    casson = load_scene(CASE, [CASSON])
    carreau = with_values(casson, {"fluid.law": "carreau", "fluid.viscosity_zero": 1.0})
    assert carreau.fluid == Carreau(density=1060, viscosity_zero=1, viscosity_infinity=0.0035)
    assert with_values(casson, {"fluid.law": "newtonian", "fluid.viscosity": 2.0}).fluid == Newtonian(
        density=1060, viscosity=2
    )
    with pytest.raises(SceneError, match="fluid: not accepted"):
        with_values(CASES["cook"], {"fluid.law": "carreau", "fluid.density": 1.0})


@pytest.mark.parametrize(("overrides", "fragments"), [
    (["fluid.law=bingham"], ['fluid.law = "bingham":', '"newtonian", "carreau", "power-law", "casson"']),
    (["fluid.law=carreau", "fluid.viscosity_zero=3e-3"],
     ["fluid.viscosity_zero = 0.003 Pa s:", "at least viscosity_infinity = 0.00345 Pa s"]),
    (["fluid.law=3"], ["fluid.law = 3:", "accepted:"]),
    (["fluid.law=power-law"], ["fluid.consistency: missing;", "consistency c, Pa s^m", "\nfluid.exponent: missing;"]),
    (["fluid.law=casson"], ["fluid.yield_stress: missing;", "\nfluid.viscosity_infinity: missing;", "Pa s"]),
    (["fluid.law=carreau", "fluid.viscosity=1"], ["fluid.viscosity = 1:", "unknown key", 'with the law "carreau"']),
    (["fluid.viscosity_zero=1"], ["fluid.viscosity_zero = 1:", 'with the law "newtonian" has "density"']),
    (["fluid.law=carreau", "fluid.exponent=0.3568"], ["fluid.exponent = 0.3568:", ">= -0.5 and < 0"]),
    (["fluid.law=carreau", "fluid.time_constant_squared=3 s"],
     ["fluid.time_constant_squared =", "wrong dimension", 'such as "10 s^2"']),
    ([POWER_LAW, "fluid.consistency=1 Pa s"], ["fluid.consistency", "text", "a number > 0 in Pa s^m"]),
    ([POWER_LAW, "inflow.profile=womersley", "inflow.waveform=mca", "time.step=0.1", "time.end=1"],
     ['inflow.profile = "womersley":', 'fluid.law = "power-law"']),
    ([CASSON, "fluid.regularization=1"], ["fluid.regularization", 'mean "fluid.regularisation"']),
])  # fmt: skip
def test_malformed_laws(overrides: list[str], fragments: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(CASE, overrides)
    check(caught.value, fragments)


@pytest.mark.parametrize("fluid", [5, "blood", [1.0]])
def test_a_fluid_is_a_table(fluid: Any) -> None:
    with pytest.raises(SceneError, match=r"^fluid = .*: must be a table"):
        with_values(CASES[CASE], {"fluid": fluid})


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
