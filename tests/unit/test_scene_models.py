"""Catalogue, defaults, scenes in time, TOML."""

import math
import pickle
import tomllib

import numpy as np
import pytest

from ffsi.scene import CASES, Newtonian, Scene, SceneError, load_scene, with_values
from ffsi.scene.flow import Inflow
from ffsi.scene.geometry import FlapChannel
from ffsi.scene.geometry.channel_cylinder import Beam, ChannelCylinder
from ffsi.scene.geometry.solids import CookMembrane
from ffsi.scene.model import Traction
from ffsi.scene.outlet import Outlet
from ffsi.scene.time import Time


def test_the_catalogue_has_names_descriptions_and_its_steady_cases() -> None:
    """Its values are those of edp/ (test_render.py)."""
    assert list(CASES) == sorted(CASES) and CASES.steady == [name for name, scene in CASES.items() if not scene.time]
    assert all(name == scene.name and scene.description for name, scene in CASES.items())
    assert all(scene.steady == (name in CASES.steady) for name, scene in CASES.items())


def test_solids_are_in_the_order_of_the_geometry() -> None:
    table = CASES["flap-neo-hookean-roof"].model_dump(exclude_none=True)
    table["solid"] = {name: table["solid"][name] for name in ("roof", "flap")}
    scene = Scene.model_validate(table)
    assert list(scene.solid) == list(scene.geometry.solid_names) == ["flap", "roof"]
    assert list(scene.exact_areas()) == ["fluid", "flap", "roof"]
    assert scene.to_toml() == CASES["flap-neo-hookean-roof"].to_toml()


def test_roofs_tractions_and_the_same_scene_in_python() -> None:
    roof = 'solid.roof={material="st-venant-kirchhoff", density=1, lame_lambda=8, lame_mu=2}'
    velocity = "inflow.mean_velocity=0.055"
    scene = load_scene("flap-neo-hookean", ["geometry.roof.thickness=0.02", roof, velocity])
    expected = CASES["flap-neo-hookean-roof"]
    assert scene == with_values(expected, {"name": scene.name, "description": scene.description})
    assert load_scene("flap-neo-hookean", ["geometry.roof={}", roof, velocity]) == scene
    membrane = {"material": "st-venant-kirchhoff", "density": 1, "young_modulus": 1, "poisson_ratio": 0}
    scene = Scene(name="a", geometry=CookMembrane(), solid={"membrane": membrane}, traction=Traction(x="-2 kPa"))
    parameters = scene.parameters()
    assert (parameters["traction.x"], parameters["traction.y"]) == (-2000.0, 0.0)
    assert CookMembrane.default_sizes.items() <= scene.mesh.model_dump().items()
    assert (scene.forces, scene.mesh_motion, scene.fluid) == (None, None, None)
    assert Scene.from_toml(scene.to_toml()) == scene
    scene = load_scene("turek-fsi1", ["mesh.body_size=2 mm"])
    assert scene.mesh.body_size == 0.002 and scene.mesh.far_size == ChannelCylinder.default_sizes["far_size"]
    values = {"fluid": {"density": 1, "viscosity": 1}, "outlet": {"kind": "do-nothing"}, "inflow": {"mean_velocity": 1}}
    table = Scene.model_validate(
        {"name": "a", "geometry": {"kind": "channel-cylinder", "beam": {"length": 0.3}}, **values}
    )
    built = Scene(
        name="a", geometry=ChannelCylinder(beam=Beam(length=0.3)), fluid=Newtonian(density=1, viscosity=1),
        inflow=Inflow(mean_velocity=1), outlet=Outlet(kind="do-nothing"),
    )  # fmt: skip
    assert built == table and built.physics == "fluid"
    with pytest.raises(SceneError, match="a scene does not change"):
        CASES["flap-svk"].name = "other"  # type: ignore[misc]


@pytest.mark.parametrize("case", CASES)
def test_round_trip(case: str) -> None:
    scene = CASES[case]
    text = scene.to_toml()
    assert Scene.from_toml(text) == scene and Scene.from_toml(text).to_toml() == text
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_round_trip_keeps_awkward_values() -> None:
    scene = with_values(
        CASES["flap-svk"],
        {"description": 'quotes "and" \\ back \u00e9', "inflow.profile": "y**2 / H",
         "solver.time_limit": "1 h", "fluid.viscosity": 0.1 + 0.2, "output.vtu": False, "gravity.y": "-9.81 m/s^2"},
    )  # fmt: skip
    again = Scene.from_toml(scene.to_toml())
    assert again == scene and again != CASES["flap-svk"] and again.fluid is not None
    assert again.fluid.viscosity == 0.1 + 0.2 and again.solver.time_limit == 3600.0


def test_short_scene_is_filled_in() -> None:
    text = """
    name = "short"
    [geometry]
    kind = "flap-channel"
    flap_height = "15 cm"
    [fluid]
    density = "1 g/cm^3"
    viscosity = "3.5 mPa s"
    [solid.flap]
    material = "st-venant-kirchhoff"
    density = 1100
    young_modulus = "0.5 MPa"
    poisson_ratio = 0.3
    [inflow]
    mean_velocity = "12 mm/s"
    [outlet]
    kind = "zero-traction"
    """
    scene = Scene.from_toml(text)
    parameters = scene.parameters()
    assert parameters["geometry.flap_height"] == 0.15 and parameters["fluid.density"] == 1000.0
    assert parameters["fluid.viscosity"] == 0.0035 and parameters["inflow.mean_velocity"] == 0.012
    assert parameters["forces.reference_length"] == 0.15 and parameters["mesh_motion.stiffness_exponent"] == 1.0
    assert parameters["mesh_motion.divergence_weight"] == 5.0 and parameters["mesh_motion.distance_exponent"] == 0.0
    assert parameters["mesh.far_size"] == pytest.approx(0.75 * FlapChannel.default_sizes["far_size"])
    assert scene.mesh.far_size == scene.geometry.size * FlapChannel.default_sizes["far_size"]  # a lower flap, smaller
    assert "root_size" not in tomllib.loads(scene.to_toml())["mesh"] and scene.gravity is None


def test_theta_of_the_schemes() -> None:
    assert Time(step="5 ms", end=1).theta_of(0.005) == 0.505 and Time(step=0.1, end=1, shift=2).theta_of(0.1) == 0.7
    assert Time(step=0.1, end=1, shift=2).theta_of(0.05) == 0.6 and Time(step=10, end=10).theta_of(10) == 1.0
    assert Time(step=0.1, end=1, shift=0).theta_of(0.1) == 0.5
    assert Time(step=0.1, end=1, scheme="crank-nicolson").theta_of(0.1) == 0.5
    assert Time(step=0.1, end=1, scheme="backward-euler").theta_of(0.01) == 1.0


@pytest.mark.parametrize("case", CASES.steady)
def test_steady_scenes_know_nothing_of_time(case: str) -> None:
    scene = CASES[case]
    table = tomllib.loads(scene.to_toml())
    assert "time" not in table and not {"ramp", "waveform"} & table.get("inflow", {}).keys()
    assert not {"step", "step_tolerance"} & table["solver"].keys() and scene.solver.step is None
    assert not any(key.startswith("time.") or "step" in key or "ramp" in key for key in scene.parameters())


def test_a_steady_scene_becomes_one_in_time_and_back() -> None:
    steady = CASES["turek-fsi1"]
    scene = with_values(steady, {"time.step": "10 ms", "time.end": 2, "inflow.ramp": 1})
    assert (scene.solver.step, scene.solver.step_tolerance) == ("condensed", 3e-5) and not scene.steady
    assert Scene.from_toml(scene.to_toml()) == scene
    changed = with_values(scene, {"solver.step": "newton", "solver.step_tolerance": 1e-8})
    assert (changed.solver.step, changed.solver.step_tolerance) == ("newton", 1e-8)
    back = with_values(scene, {"time": None, "inflow.ramp": None, "solver.step": None, "solver.step_tolerance": None})
    assert back == steady
    # What matters in time only does not stand in the way of a steady computation.
    assert with_values(scene, {"time": None, "inflow.ramp": None}).solver.step == "condensed"


@pytest.mark.parametrize("case", ["cook", "cantilever", "turek-cfd1", "turek-csm1", "cavity-flexible-floor"])
def test_every_physics_can_be_in_time(case: str) -> None:
    scene = load_scene(case, ["time={step=0.1, end=1, stop='periodic', adaptive=true, output_interval=0.5}"])
    assert scene.time is not None and scene.time.stop == "periodic" and Scene.from_toml(scene.to_toml()) == scene


def test_mixed_solids_and_inflow_in_time() -> None:
    values = {"time.step": 0.1, "time.end": 1, "mesh_motion.kind": "linear-elastic", "solid.flap.formulation": "mixed"}
    scene = with_values(CASES["flap-neo-hookean"], values)
    assert scene.solid["flap"].mixed and scene.time is not None
    inflow = CASES["turek-fsi3"].inflow
    assert inflow is not None
    np.testing.assert_allclose(inflow.factor([0.0, 0.5, 1.0, 2.0, 9.0]), [0, (1 - math.sqrt(0.5)) / 2, 0.5, 1, 1])
    assert inflow.waveform_expression.to_freefem() == "1.0"
    beating = load_scene("turek-cfd3", ["inflow.waveform=1 + 0.2*sin(2*pi*t)^2"]).inflow
    assert beating is not None
    t = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(
        beating.factor(t), np.where(t < 2, (1 - np.cos(np.pi * t / 2)) / 2, 1) * (1 + 0.2 * np.sin(2 * np.pi * t) ** 2)
    )
    assert beating.waveform_expression.to_freefem() == "1.0 + 0.2 * sin(2.0 * pi * t) ^ 2.0"
    assert beating.waveform_expression.to_freefem({"t": "time"}) == "1.0 + 0.2 * sin(2.0 * pi * time) ^ 2.0"
    without = load_scene("cylinder-2d1", ["time={step=0.1, end=1}", "inflow.waveform='2'"]).inflow
    assert without is not None
    np.testing.assert_array_equal(without.factor([0.0, 1.0]), [2.0, 2.0])
    assert without.factor(0.5).shape == ()
