"""What a scene that states little gets: it follows what the scene is, and what is stated stays."""

import copy
import math
from pathlib import Path
from typing import Any

import pytest
from test_scene_materials import MOONEY_RIVLIN, NEO

from ffsi.files.errors import InputError
from ffsi.run.chain import _chain_scenes
from ffsi.run.plan import plan
from ffsi.run.remote import task
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values
from ffsi.scene.materials import NeoHookean, StVenantKirchhoff
from ffsi.scene.overrides import parse_overrides

FLAP: dict[str, Any] = {
    "name": "own", "geometry": {"kind": "flap-channel"}, "fluid": {"density": 1.0, "viscosity": 1e-3},
    "solid": {"flap": {"material": "neo-hookean", "density": 1.0, "young_modulus": 5.6, "poisson_ratio": 0.4}},
    "inflow": {"mean_velocity": 0.06}, "outlet": {"kind": "do-nothing"},
}  # fmt: skip
IN_TIME = {"time.step": 0.01, "time.end": 1.0}


def motion(scene: Scene) -> tuple[str, float]:
    assert scene.mesh_motion is not None
    return scene.mesh_motion.kind, scene.mesh_motion.divergence_weight


def test_mesh_motion_follows_the_scene() -> None:
    steady = Scene.model_validate(FLAP)
    assert motion(steady) == ("hyperelastic", 5.0)
    in_time = with_values(steady, IN_TIME)
    assert motion(in_time) == ("linear-elastic", 16.0)
    assert motion(with_values(in_time, {"time": None})) == ("hyperelastic", 5.0)
    # The other keys of the table are kept, and a weight that is given.
    changed = with_values(steady, {"mesh_motion.stiffness_exponent": 0.5})
    assert motion(changed) == ("hyperelastic", 5.0)
    assert motion(with_values(changed, IN_TIME)) == ("linear-elastic", 16.0)
    assert with_values(changed, IN_TIME).mesh_motion.stiffness_exponent == 0.5
    assert motion(with_values(steady, {"mesh_motion.divergence_weight": 3.0, **IN_TIME})) == ("linear-elastic", 3.0)


@pytest.mark.parametrize(("kind", "weight"), [("harmonic", 1.0), ("linear-elastic", 16.0), ("hyperelastic", 5.0)])
def test_a_stated_kind_stays(kind: str, weight: float) -> None:
    steady = with_values(Scene.model_validate(FLAP), {"mesh_motion.kind": kind})
    assert motion(steady) == motion(with_values(steady, IN_TIME)) == (kind, weight)


@pytest.mark.parametrize(("material", "formulation"), [
    ({"material": "neo-hookean", "young_modulus": 1.0, "poisson_ratio": 0.4899}, "displacement"),
    ({"material": "neo-hookean", "young_modulus": 1.0, "poisson_ratio": 0.49}, "mixed"),
    ({"material": "neo-hookean", "lame_mu": 1.0, "poisson_ratio": 0.4999}, "mixed"),
    ({"material": "neo-hookean", "lame_mu": 1.0, "lame_lambda": 48.99}, "displacement"),
    ({"material": "neo-hookean", "lame_mu": 1.0, "lame_lambda": 49.0}, "mixed"),
    ({"material": "neo-hookean", "lame_mu": 1e-6, "lame_lambda": 49e-6}, "mixed"),
    ({"material": "mooney-rivlin", "c10": 0.25, "c01": 0.25, "bulk_modulus": 49.6}, "displacement"),
    ({"material": "mooney-rivlin", "c10": 0.25, "c01": 0.25, "bulk_modulus": 49.7}, "mixed"),
    ({"material": "neo-hookean", "young_modulus": 1.0, "poisson_ratio": 0.4999, "formulation": "displacement"},
     "displacement"),
    ({"material": "neo-hookean", "young_modulus": 1.0, "formulation": "incompressible"}, "incompressible"),
])  # fmt: skip
def test_nearly_incompressible_solids_are_mixed(material: dict[str, Any], formulation: str) -> None:
    table = copy.deepcopy(FLAP)
    table["solid"]["flap"] = {"density": 1.0, **material}
    scene = Scene.model_validate(table)
    assert scene.solid["flap"].formulation == formulation and Scene.from_toml(scene.to_toml()) == scene


def test_formulations_follow_poissons_ratio_also_in_a_sweep() -> None:
    scene = Scene.model_validate(FLAP)
    nearly = with_values(scene, {"solid.flap.poisson_ratio": 0.495})
    assert nearly.solid["flap"].formulation == "mixed"
    assert with_values(nearly, {"solid.flap.poisson_ratio": 0.3}) == with_values(
        scene, {"solid.flap.poisson_ratio": 0.3}
    )
    assert with_values(scene, {"solid.flap.material": "st-venant-kirchhoff"}).solid["flap"].mixed is False
    # Points of a chain have one script; a sweep has chains enough for every point to be as in a single run.
    points = [{"solid.flap.poisson_ratio": nu} for nu in (0.3, 0.495, 0.48, 0.499)]
    assert [[len(piece) for piece in plan(each, points)] for each in (scene, scene.settled())] == [[2, 2], [4]]
    with pytest.raises(InputError, match=r"poisson_ratio cannot change within one chain"):
        _chain_scenes(scene, points)
    # So here, and on another machine.
    sent = Scene.from_toml(task(scene, points, True, False, 0, [])["scene"])
    for values in (points[1], {"geometry.flap_height": 0.1}):
        assert sent == scene == scene.settled() and with_values(sent, values) == with_values(scene, values)


@pytest.mark.parametrize("name", CASES)
def test_the_catalogue_states_what_it_has(name: str) -> None:
    scene = CASES[name]
    if scene.mesh_motion is not None:
        assert set(type(scene.mesh_motion).model_fields) == scene.mesh_motion.model_fields_set
    for solid in scene.solid.values():
        assert "formulation" in solid.model_fields_set or solid.material == "st-venant-kirchhoff"
    assert with_values(scene, {}) == scene


def test_none_of_a_key_that_a_new_material_has_dropped() -> None:
    new = ["solid.flap.material=mooney-rivlin", *(f"solid.flap.{key}=1" for key in ("c10", "c01", "bulk_modulus"))]
    assert load_scene("flap-svk", [*new, "solid.flap.lame_mu=none"]) == load_scene("flap-svk", new)


@pytest.mark.parametrize("key", ["inflow.ramp", "gravity", "time.output_interval"])
def test_none_removes_a_key(key: str) -> None:
    scene = load_scene("turek-fsi3", ["time.output_interval=0.1", "gravity.y=-2"])
    there = scene.model_dump()
    for name in key.split("."):
        assert there[name] is not None
        there = there[name]
    there = with_values(scene, {key: None}).model_dump()
    for name in key.split("."):
        there = there[name]
    assert there is None
    assert with_values(with_values(scene, {key: None}), {key: None}) == with_values(scene, {key: None})


def test_none_as_a_text_and_sizes_by_the_body() -> None:
    assert load_scene("turek-fsi1", ['description="none"']).description == "none"
    with pytest.raises(SceneError, match=r"inflow.mean_velocity: missing"):
        load_scene("turek-fsi3", ["inflow.mean_velocity=none"])
    with pytest.raises(SceneError, match=r'inflow.ramb.*did you mean "inflow.ramp"'):
        load_scene("turek-fsi3", ["inflow.ramb=none"])
    larger = ["geometry.cylinder_radius=0.1", "geometry.height=0.9", "geometry.cylinder_y=0.4"]
    sizes, stated = CASES["turek-fsi1"].mesh, CASES["turek-fsi3"].mesh
    twice = {key: 2 * getattr(sizes, key) for key in ("far_size", "body_size", "corner_size")}
    assert load_scene("turek-fsi1", larger).mesh == sizes.model_copy(update=twice)
    assert load_scene("turek-fsi3", larger).mesh == stated


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
    for name in ("harmonic", "linear-elastic", "hyperelastic"):
        scene = load_scene("turek-fsi1", [f"mesh_motion.kind={name}", "mesh_motion.distance_exponent=1.5"])
        assert scene.parameters()["mesh_motion.distance_exponent"] == 1.5 and motion(scene)[0] == name
        assert Scene.from_toml(scene.to_toml()) == scene
    beam = 'solid.beam={material="st-venant-kirchhoff", density=1000, lame_mu=5e5, poisson_ratio=0.4}'
    assert motion(load_scene("turek-cfd1", [beam]))[0] == "hyperelastic"


def test_load_scene_from_files(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + CASES["turek-fsi1"].to_toml().replace("\n", "\r\n").encode())
    assert load_scene(path) == CASES["turek-fsi1"] and load_scene(str(path), ["mesh.level=0"]).mesh.level == 0
    with pytest.raises(SceneError, match="folder") as caught:
        load_scene(str(tmp_path))
    assert caught.value.problems[0].nearest == str(path)
