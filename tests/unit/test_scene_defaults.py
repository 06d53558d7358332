"""What a scene that states little gets: it follows what the scene is, and what is stated stays."""

import copy
from typing import Any

import pytest
import tomli_w

from ffsi.run.chain import _chain_scenes
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values

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


def test_formulations_follow_poissons_ratio_and_sweeps_the_scene() -> None:
    scene = Scene.model_validate(FLAP)
    nearly = with_values(scene, {"solid.flap.poisson_ratio": 0.495})
    assert nearly.solid["flap"].formulation == "mixed"
    assert with_values(nearly, {"solid.flap.poisson_ratio": 0.3}) == with_values(
        scene, {"solid.flap.poisson_ratio": 0.3}
    )
    assert with_values(scene, {"solid.flap.material": "st-venant-kirchhoff"}).solid["flap"].mixed is False
    # One script for all points: a settled scene changes nothing but the values that vary.
    assert scene.settled() == scene
    scenes, _ = _chain_scenes(scene, [{"solid.flap.poisson_ratio": nu} for nu in (0.3, 0.495)])
    assert [point.solid["flap"].formulation for point in scenes] == ["displacement"] * 2
    # What decides about the mesh and not about the script is as in a single run, here and on another machine.
    low = {"geometry.flap_height": 0.1}
    assert with_values(scene.settled(), low) == with_values(scene, low)
    sent = Scene.from_toml(tomli_w.dumps(scene.settled().given()))
    assert sent == scene and with_values(sent, low) == with_values(scene, low)


@pytest.mark.parametrize("name", CASES)
def test_the_catalogue_states_what_it_has(name: str) -> None:
    scene = CASES[name]
    if scene.mesh_motion is not None:
        assert set(type(scene.mesh_motion).model_fields) == scene.mesh_motion.model_fields_set
    for solid in scene.solid.values():
        assert "formulation" in solid.model_fields_set or solid.material == "st-venant-kirchhoff"
    assert with_values(scene, {}) == scene


@pytest.mark.parametrize("key", ["inflow.ramp", "gravity", "time.output_interval", "inflow.mean_velocity"])
def test_none_removes_a_key(key: str) -> None:
    scene = load_scene("turek-fsi3", ["time.output_interval=0.1", "gravity.y=-2"])
    if key == "inflow.mean_velocity":
        with pytest.raises(SceneError, match=r"inflow.mean_velocity: missing"):
            load_scene("turek-fsi3", [f"{key}=none"])
        return
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
    with pytest.raises(SceneError, match=r'inflow.ramb.*did you mean "inflow.ramp"'):
        load_scene("turek-fsi3", ["inflow.ramb=none"])
    larger = ["geometry.cylinder_radius=0.1", "geometry.height=0.9", "geometry.cylinder_y=0.4"]
    sizes, stated = CASES["turek-fsi1"].mesh, CASES["turek-fsi3"].mesh
    twice = {key: 2 * getattr(sizes, key) for key in ("far_size", "body_size", "corner_size")}
    assert load_scene("turek-fsi1", larger).mesh == sizes.model_copy(update=twice)
    assert load_scene("turek-fsi3", larger).mesh == stated
