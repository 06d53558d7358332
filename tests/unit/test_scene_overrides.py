"""Scenes with some values changed."""

import math
from pathlib import Path

import pytest
from test_scene_materials import MOONEY_RIVLIN, NEO

from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values
from ffsi.scene.materials import NeoHookean, StVenantKirchhoff
from ffsi.scene.overrides import parse_overrides


def test_overrides_change_what_they_name_also_in_whole_tables() -> None:
    values = parse_overrides(["a=1", "a.b=1.5", "c=true", "d=text here", 'e="quoted"', "f=3.5 mPa s", "g=1979-05-27",
                              "h = x=y ", "i=1\nj=2", "k=[1, 2]", "a=2"])  # fmt: skip
    assert values == {"a": 2, "a.b": 1.5, "c": True, "d": "text here", "e": "quoted", "f": "3.5 mPa s",
                      "g": "1979-05-27", "h": "x=y", "i": "1\nj=2", "k": [1, 2]}  # fmt: skip
    overrides = ["fluid.viscosity=3.5 mPa s", "inflow.mean_velocity=0.06", 'mesh.far_size="9 cm"', "mesh.level=0"]
    changed, base = load_scene("flap-svk", overrides).parameters(), CASES["flap-svk"].parameters()
    different = {key: value for key, value in changed.items() if value != base[key]}
    assert different == {
        "fluid.viscosity": 0.0035, "inflow.mean_velocity": 0.06, "mesh.far_size": 0.09, "mesh.level": 0
    }  # fmt: skip
    assert load_scene("flap-svk") == CASES["flap-svk"]
    scene = load_scene("flap-svk", ["solid.flap.young_modulus=5.6", "solid.flap.poisson_ratio=0.4"])
    flap = scene.solid["flap"]
    assert flap.given_constants == ("young_modulus", "poisson_ratio")
    assert flap.lame == pytest.approx((8.0, 2.0), rel=1e-14)
    with pytest.raises(SceneError, match=r"uses the pair \(lame_lambda, lame_mu\)"):
        load_scene("flap-svk", ["solid.flap.young_modulus=5.6", "solid.flap.lame_mu=0.4"])
    table = 'solid.flap={material="neo-hookean", density=1, young_modulus=5.6, poisson_ratio=0.3}'
    flap = load_scene("flap-svk", [table, "solid.flap.poisson_ratio=0.4"]).solid["flap"]
    assert isinstance(flap, NeoHookean) and flap.lame == pytest.approx((8.0, 2.0), rel=1e-14)
    assert load_scene("flap-svk", [MOONEY, "solid.flap.c10=80"]).parameters()["solid.flap.c10"] == 80
    beam = 'solid.beam={material="st-venant-kirchhoff", density=1000, lame_mu=5e5, poisson_ratio=0.4}'
    scene = load_scene("turek-cfd1", [beam])
    assert scene.physics == "fsi" and scene.mesh_motion is not None
    beam = {"length": 0.3}
    scene = with_values(CASES["cylinder-2d1"], {"geometry.beam": beam, "geometry.beam.thickness": 0.01})
    assert scene.parameters()["geometry.beam.thickness"] == 0.01 and beam == {"length": 0.3}
    assert CASES["cylinder-2d1"].geometry.solid_names == ()


MOONEY = 'solid.flap={material="mooney-rivlin", density=1, c10=75, c01=100, bulk_modulus=5.6}'


def test_material_and_pair_are_switched_together() -> None:
    for case, name, law in [
        ("flap-svk", "neo-hookean", NeoHookean), ("flap-neo-hookean", "st-venant-kirchhoff", StVenantKirchhoff)
    ]:  # fmt: skip
        flap = load_scene(case, [f"solid.flap.material={name}"]).solid["flap"]
        assert isinstance(flap, law) and flap.lame == (8.0, 2.0)
    material, young, nu = "solid.flap.material=neo-hookean", "solid.flap.young_modulus=28", "solid.flap.poisson_ratio=0"
    flap = load_scene("flap-svk", [material, young, nu]).solid["flap"]
    assert isinstance(flap, NeoHookean) and flap.lame == (0.0, 14.0)
    beam = load_scene("turek-csm1", ["solid.beam.material=neo-hookean"]).solid["beam"]
    assert isinstance(beam, NeoHookean) and beam.given_constants == ("lame_mu", "poisson_ratio")
    flap = CASES["flap-mooney-rivlin"].solid["flap"]
    assert load_scene("flap-svk", [MOONEY]).solid["flap"] == flap
    constants = ["solid.flap.c10=75", "solid.flap.c01=100", "solid.flap.bulk_modulus=5.6"]
    material = "solid.flap.material=mooney-rivlin"
    assert load_scene("flap-svk", [*constants, material]).solid["flap"] == flap
    for missing in constants:
        with pytest.raises(SceneError, match=r": missing; ") as caught:
            load_scene("flap-svk", [material, *(text for text in constants if text != missing)])
        assert [problem.key for problem in caught.value.problems] == [missing.partition("=")[0]]
    changed = load_scene("flap-mooney-rivlin", ["solid.flap.bulk_modulus=17.5 kPa"])
    assert changed.parameters()["solid.flap.bulk_modulus"] == 17500.0
    back = ["solid.flap.material=st-venant-kirchhoff", "solid.flap.lame_lambda=8", "solid.flap.lame_mu=2"]
    assert load_scene("flap-mooney-rivlin", back).solid == CASES["flap-svk"].solid


INCOMPRESSIBLE = {"solid.flap.formulation": "incompressible"}


@pytest.mark.parametrize(("pair", "kept"), [
    ({"lame_lambda": 8, "lame_mu": 2}, {"lame_mu": 2.0}),
    ({"lame_mu": 2, "poisson_ratio": 0.4}, {"lame_mu": 2.0}),
    ({"young_modulus": 6, "poisson_ratio": 0.4}, {"young_modulus": 6.0}),
])  # fmt: skip
def test_incompressible_keeps_one_constant(pair: dict[str, float], kept: dict[str, float]) -> None:
    base = with_values(CASES["flap-svk"], {"solid.flap": NEO | pair})
    flap = with_values(base, INCOMPRESSIBLE).solid["flap"]
    assert flap.model_dump(exclude_none=True) == NEO | kept | {"formulation": "incompressible"}
    assert flap.lame == (math.inf, 2.0)
    for new in ({"lame_mu": 5.0}, {"young_modulus": 15.0}):
        values = INCOMPRESSIBLE | {f"solid.flap.{name}": value for name, value in new.items()}
        changed = with_values(base, values)
        assert changed.solid["flap"].model_dump(exclude_none=True) == NEO | new | {"formulation": "incompressible"}
        assert changed.solid["flap"].lame == (math.inf, 5.0) and Scene.from_toml(changed.to_toml()) == changed
        again = with_values(
            with_values(base, INCOMPRESSIBLE), {key: values[key] for key in values.keys() - INCOMPRESSIBLE}
        )
        assert again == changed
    for name, value in (("poisson_ratio", 0.3), ("lame_lambda", 3)):
        with pytest.raises(SceneError, match=rf"^solid.flap.{name} = .*: not accepted with formulation"):
            with_values(base, INCOMPRESSIBLE | {f"solid.flap.{name}": value})


def test_mixed_keeps_the_constants_and_goes_back() -> None:
    for case in ("flap-neo-hookean", "flap-mooney-rivlin"):
        mixed = load_scene(case, ["solid.flap.formulation=mixed"])
        expected = CASES[case].solid["flap"].model_dump() | {"formulation": "mixed"}
        assert mixed.solid["flap"].model_dump() == expected and Scene.from_toml(mixed.to_toml()) == mixed
        assert load_scene(case, ["solid.flap.formulation=displacement"]) == CASES[case]
    # A negative lambda, as the paper's bulk modulus makes it, is no obstacle: its volume equation divides by K.
    assert mixed.solid["flap"].lame[0] < 0
    scene = with_values(CASES["flap-neo-hookean"], INCOMPRESSIBLE)
    back = {"solid.flap.formulation": "displacement"}
    with pytest.raises(SceneError, match=r"^solid.flap.lame_lambda: missing beside lame_mu; accepted is exactly one"):
        with_values(scene, back)
    for pair in ({"lame_lambda": 8}, {"lame_lambda": 8, "lame_mu": 2}, {"poisson_ratio": 0.4},
                 {"young_modulus": 5.6, "poisson_ratio": 0.4}):  # fmt: skip
        flap = with_values(scene, back | {f"solid.flap.{name}": value for name, value in pair.items()}).solid["flap"]
        assert flap.lame == pytest.approx((8.0, 2.0), rel=1e-14) and not flap.mixed
    mooney = with_values(CASES["flap-mooney-rivlin"], INCOMPRESSIBLE)
    with pytest.raises(SceneError, match=r"^solid.flap.bulk_modulus: missing; bulk modulus K, Pa"):
        with_values(mooney, back)
    assert with_values(mooney, back | {"solid.flap.bulk_modulus": 5.6}) == CASES["flap-mooney-rivlin"]


def test_incompressible_mooney_rivlin_and_formulation_with_material() -> None:
    scene = with_values(CASES["flap-mooney-rivlin"], INCOMPRESSIBLE)
    flap = scene.solid["flap"]
    assert flap.model_dump(exclude_none=True) == MOONEY_RIVLIN | {"formulation": "incompressible"}
    assert "solid.flap.bulk_modulus" not in scene.parameters() and Scene.from_toml(scene.to_toml()) == scene
    with pytest.raises(SceneError, match=r"^solid.flap.bulk_modulus = 7 Pa: not accepted with formulation"):
        with_values(CASES["flap-mooney-rivlin"], INCOMPRESSIBLE | {"solid.flap.bulk_modulus": 7})
    with pytest.raises(SceneError, match=r"^solid.flap.bulk_modulus = 7 Pa: not accepted with formulation"):
        with_values(scene, {"solid.flap.bulk_modulus": 7})
    neo = {"solid.flap.material": "neo-hookean"}
    flap = with_values(CASES["flap-svk"], neo | INCOMPRESSIBLE).solid["flap"]
    assert flap == with_values(CASES["flap-neo-hookean"], INCOMPRESSIBLE).solid["flap"]
    mixed = load_scene("flap-neo-hookean", ["solid.flap.formulation=mixed"])
    svk_name = {"solid.flap.material": "st-venant-kirchhoff"}
    assert with_values(mixed, svk_name).solid == CASES["flap-svk"].solid
    incompressible = with_values(CASES["flap-neo-hookean"], INCOMPRESSIBLE)
    with pytest.raises(SceneError, match=r"^solid.flap.lame_lambda: missing beside lame_mu"):
        with_values(incompressible, svk_name)
    assert with_values(incompressible, svk_name | {"solid.flap.lame_lambda": 8}).solid == CASES["flap-svk"].solid
    # Between two materials that have the key, the formulation stays.
    constants = {f"solid.flap.{name}": value for name, value in (MOONEY_RIVLIN.items() - NEO.items())}
    mooney = with_values(incompressible, constants | {"solid.flap.material": "mooney-rivlin"}).solid["flap"]
    assert mooney == with_values(CASES["flap-mooney-rivlin"], INCOMPRESSIBLE).solid["flap"]


def test_mesh_motion_has_three_kinds() -> None:
    def kind(scene: Scene) -> str:
        assert scene.mesh_motion is not None
        return scene.mesh_motion.kind

    kinds = {name: kind(scene) for name, scene in CASES.items() if scene.physics == "fsi"}
    assert kinds == {
        "flap-svk": "hyperelastic", "flap-neo-hookean": "hyperelastic", "flap-mooney-rivlin": "hyperelastic",
        "flap-neo-hookean-roof": "hyperelastic", "flap-mooney-rivlin-roof": "hyperelastic",
        "turek-fsi1": "harmonic", "cavity-flexible-floor": "harmonic",
        "turek-fsi2": "linear-elastic", "turek-fsi3": "linear-elastic", "aneurysm": "hyperelastic",
        "aneurysm-carreau": "hyperelastic", "aneurysm-pulsatile": "harmonic",
    }  # fmt: skip
    for name in ("harmonic", "linear-elastic", "hyperelastic"):
        scene = load_scene("turek-fsi1", [f"mesh_motion.kind={name}", "mesh_motion.distance_exponent=1.5"])
        assert scene.parameters()["mesh_motion.distance_exponent"] == 1.5 and kind(scene) == name
        assert Scene.from_toml(scene.to_toml()) == scene
    assert kind(load_scene("turek-cfd1", [
        'solid.beam={material="st-venant-kirchhoff", density=1000, lame_mu=5e5, poisson_ratio=0.4}'
    ])) == "hyperelastic"  # fmt: skip


def test_load_scene_from_files(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + CASES["turek-fsi1"].to_toml().replace("\n", "\r\n").encode())
    assert load_scene(path) == CASES["turek-fsi1"] and load_scene(str(path), ["mesh.level=0"]).mesh.level == 0
    with pytest.raises(SceneError, match="folder") as caught:
        load_scene(str(tmp_path))
    assert caught.value.problems[0].nearest == str(path)
