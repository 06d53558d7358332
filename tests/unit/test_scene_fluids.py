"""Viscosity laws of a scene: keys, defaults, what is refused."""

from typing import Any, Literal, get_args

import pytest
from test_scene_malformed import check

from ffsi.scene import CASES, Newtonian, Scene, SceneError, load_scene, with_values
from ffsi.scene.fluids import LAWS, Carreau, Casson, Fluid, PowerLaw

CASE = "turek-cfd1"
CASSON = "fluid={law='casson', density=1060, yield_stress='5 mPa', viscosity_infinity='3.5 mPa s'}"
POWER_LAW = "fluid={law='power-law', density=1060, consistency=0.0147, exponent=0.7755}"


def test_laws_are_those_of_the_union() -> None:
    assert tuple(LAWS.values()) == get_args(get_args(Fluid)[0])
    assert {name: law.model_fields["law"].annotation for name, law in LAWS.items()} == {
        name: Literal[name] for name in LAWS
    }


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
    assert Carreau(density=1060).model_dump() == {
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
    (["fluid.law=careau"], ['fluid.law = "careau":', 'mean "carreau"']),
    (["fluid.law=3"], ["fluid.law = 3:", "accepted:"]),
    (["fluid.law=power-law"], ["fluid.consistency: missing;", "consistency c, Pa s^m", "fluid.exponent: missing;"]),
    (["fluid.law=casson"], ["fluid.yield_stress: missing;", "fluid.viscosity_infinity: missing;", "Pa s"]),
    (["fluid.law=carreau", "fluid.viscosity=1"], ["fluid.viscosity = 1:", "unknown key", 'with the law "carreau"']),
    (["fluid.viscosity_zero=1"], ["fluid.viscosity_zero = 1:", 'with the law "newtonian" has "density"']),
    (["fluid.law=carreau", "fluid.viscosity_zer=1"], ["fluid.viscosity_zer", 'mean "fluid.viscosity_zero"']),
    (["fluid.law=carreau", "fluid.viscosity_zero=0"], ["fluid.viscosity_zero = 0:", "> 0 in Pa s"]),
    (["fluid.law=carreau", "fluid.exponent=0.3568"], ["fluid.exponent = 0.3568:", ">= -0.5 and < 0"]),
    (["fluid.law=carreau", "fluid.exponent=-0.6"], ["fluid.exponent = -0.6:", ">= -0.5 and < 0"]),
    (["fluid.law=carreau", "fluid.time_constant_squared=3 s"],
     ["fluid.time_constant_squared =", "wrong dimension", 'such as "10 s^2"']),
    (["fluid.law=carreau", "fluid.time_constant_squared=-1"], ["fluid.time_constant_squared = -1:", "> 0 in s^2"]),
    ([POWER_LAW, "fluid.exponent=0"], ["fluid.exponent = 0:", "> 0"]),
    ([POWER_LAW, "fluid.consistency=1 Pa s"], ["fluid.consistency", "text", "a number > 0 in Pa s^m"]),
    ([POWER_LAW, "fluid.regularisation=0"], ["fluid.regularisation = 0:", "> 0 in 1/s"]),
    ([POWER_LAW, "inflow.profile=womersley", "inflow.waveform=mca", "time.step=0.1", "time.end=1"],
     ['inflow.profile = "womersley":', 'fluid.law = "power-law"']),
    ([CASSON, "fluid.yield_stress=-1 Pa"], ["fluid.yield_stress", ">= 0 in Pa"]),
    ([CASSON, "fluid.yield_stress=nan"], ["fluid.yield_stress = nan:", "finite"]),
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
