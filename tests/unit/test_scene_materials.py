"""Materials: their constants, formulations and conversions."""

import math
from typing import Literal, get_args

import pytest
from pydantic import Field

from ffsi.scene import CASES, SceneError
from ffsi.scene.materials import MATERIALS, Elastic, MooneyRivlin, NeoHookean, Solid, StVenantKirchhoff
from ffsi.scene.units import Modulus


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


def test_materials_are_their_constants_and_values_at_rest() -> None:
    assert tuple(MATERIALS.values()) == get_args(get_args(Solid)[0])
    assert {name: law.model_fields["material"].annotation for name, law in MATERIALS.items()} == {
        name: Literal[name] for name in MATERIALS
    }

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
