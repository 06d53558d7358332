"""Catalogue, defaults, materials, TOML, overrides."""

import pickle
import tomllib

import pytest

from ffsi.scene import CASES, Newtonian, Scene, SceneError, load_scene, with_values
from ffsi.scene.flow import Inflow
from ffsi.scene.geometry import FlapChannel
from ffsi.scene.geometry.channel_cylinder import Beam, ChannelCylinder
from ffsi.scene.geometry.solids import Cantilever, CookMembrane
from ffsi.scene.materials import StVenantKirchhoff
from ffsi.scene.model import Traction
from ffsi.scene.outlet import Outlet

FLUIDS = ("turek-cfd1", "turek-cfd2", "turek-cfd3", "cylinder-2d1", "cylinder-2d2")
SOLIDS = ("turek-csm1", "turek-csm2", "turek-csm3", "cook", "cantilever")
BOTH = (
    *("flap-svk", "flap-neo-hookean", "flap-mooney-rivlin", "flap-neo-hookean-roof", "flap-mooney-rivlin-roof"),
    *("turek-fsi1", "turek-fsi2", "turek-fsi3", "cavity-flexible-floor"),
    *("aneurysm", "aneurysm-carreau", "aneurysm-pulsatile"),
)
PHYSICS = dict.fromkeys(FLUIDS, "fluid") | dict.fromkeys(SOLIDS, "solid") | dict.fromkeys(BOTH, "fsi")


def svk(**values: object) -> StVenantKirchhoff:
    return StVenantKirchhoff(material="st-venant-kirchhoff", density=1, **values)


def test_catalogue_physics_and_levels() -> None:
    assert {name: scene.physics for name, scene in CASES.items()} == PHYSICS and list(CASES) == sorted(PHYSICS)
    in_time = {"turek-cfd3", "turek-csm3", "turek-fsi2", "turek-fsi3", "cylinder-2d2", "aneurysm-pulsatile"}
    assert CASES.steady == [name for name in sorted(PHYSICS) if name not in in_time]
    assert all(scene.steady == (name not in in_time) for name, scene in CASES.items())
    assert all(name == scene.name and scene.description for name, scene in CASES.items())
    levels = {name: scene.mesh.level for name, scene in CASES.items()}
    assert levels == {name: 1 if name.startswith("flap-") else 2 for name in CASES}


@pytest.mark.parametrize(("case", "values"), [
    ("flap-svk", {"fluid.density": 1, "fluid.viscosity": 1e-3, "solid.flap.density": 1, "solid.flap.lame_lambda": 8,
     "solid.flap.lame_mu": 2, "inflow.mean_velocity": 0.12, "forces.reference_length": 0.2, "mesh.root_size": 0.01,
     "geometry.flap_left": 0.5, "geometry.flap_width": 0.04, "geometry.flap_height": 0.2, "geometry.length": 2.5,
     "geometry.height": 0.4}),
    ("flap-neo-hookean", {"solid.flap.density": 1, "solid.flap.lame_lambda": 8, "solid.flap.lame_mu": 2,
     "inflow.mean_velocity": 0.12, "mesh.level": 1, "mesh.root_size": None, "mesh_motion.divergence_weight": 5}),
    ("flap-mooney-rivlin", {"solid.flap.density": 1, "solid.flap.c10": 75, "solid.flap.c01": 100,
     "solid.flap.bulk_modulus": 5.6, "inflow.mean_velocity": 0.12, "mesh.level": 1, "mesh.root_size": None,
     "solid.flap.lame_mu": None}),
    ("flap-neo-hookean-roof", {"solid.flap.lame_lambda": 8, "solid.flap.lame_mu": 2, "solid.roof.density": 1,
     "solid.roof.lame_lambda": 8, "solid.roof.lame_mu": 2, "geometry.roof.thickness": 0.02,
     "inflow.mean_velocity": 0.055, "mesh.level": 1}),
    ("flap-mooney-rivlin-roof", {"solid.flap.c10": 75, "solid.flap.c01": 100, "solid.flap.bulk_modulus": 5.6,
     "solid.roof.density": 1, "solid.roof.lame_lambda": 8, "solid.roof.lame_mu": 2, "geometry.roof.thickness": 0.02,
     "inflow.mean_velocity": 0.055}),
    ("cook", {"geometry.width": 48, "geometry.left_height": 44, "geometry.rise": 44, "geometry.right_height": 16,
     "solid.membrane.density": 1, "solid.membrane.young_modulus": 200, "solid.membrane.poisson_ratio": 0.35,
     "traction.x": 0, "traction.y": 4, "mesh.level": 2, "gravity.y": None}),
    ("cantilever", {"geometry.length": 1, "geometry.thickness": 0.01, "solid.beam.young_modulus": 109200,
     "solid.beam.poisson_ratio": 0.3, "solid.beam.density": 1, "traction.x": 0, "traction.y": 1}),
    ("turek-cfd1", {"fluid.density": 1000, "fluid.viscosity": 1, "inflow.mean_velocity": 0.2}),
    ("turek-cfd2", {"fluid.density": 1000, "fluid.viscosity": 1, "inflow.mean_velocity": 1}),
    ("turek-csm1", {"solid.beam.density": 1000, "solid.beam.lame_mu": 5e5, "solid.beam.poisson_ratio": 0.4,
     "gravity.x": 0, "gravity.y": -2}),
    ("turek-csm2", {"solid.beam.density": 1000, "solid.beam.lame_mu": 2e6, "gravity.y": -2}),
    ("turek-fsi1", {"fluid.viscosity": 1, "solid.beam.density": 1000, "solid.beam.lame_mu": 5e5,
     "solid.beam.poisson_ratio": 0.4, "inflow.mean_velocity": 0.2, "forces.reference_length": 0.1,
     "geometry.length": 2.5, "geometry.height": 0.41, "geometry.beam.length": 0.35, "geometry.beam.thickness": 0.02}),
    ("turek-cfd3", {"fluid.density": 1000, "fluid.viscosity": 1, "inflow.mean_velocity": 2, "inflow.ramp": 2,
     "time.step": 0.005, "time.end": 12, "solver.step_tolerance": 3e-5}),
    ("turek-csm3", {"solid.beam.density": 1000, "solid.beam.lame_mu": 5e5, "solid.beam.poisson_ratio": 0.4,
     "gravity.y": -2, "time.step": 0.005, "time.end": 10}),
    ("turek-fsi2", {"fluid.density": 1000, "fluid.viscosity": 1, "solid.beam.density": 10000, "solid.beam.lame_mu": 5e5,
     "solid.beam.poisson_ratio": 0.4, "inflow.mean_velocity": 1, "inflow.ramp": 2, "mesh_motion.stiffness_exponent": 1,
     "mesh_motion.divergence_weight": 16, "time.step": 0.01, "time.end": 15, "time.shift": 1}),
    ("turek-fsi3", {"solid.beam.density": 1000, "solid.beam.lame_mu": 2e6, "inflow.mean_velocity": 2, "inflow.ramp": 2,
     "mesh_motion.divergence_weight": 16, "time.step": 0.005, "time.end": 10}),
    ("cylinder-2d2", {"fluid.density": 1, "fluid.viscosity": 1e-3, "inflow.mean_velocity": 1, "geometry.length": 2.2,
     "forces.reference_length": 0.1, "time.step": 0.0025, "time.end": 8}),
    ("cylinder-2d1", {"fluid.density": 1, "fluid.viscosity": 1e-3, "inflow.mean_velocity": 0.2, "geometry.length": 2.2,
     "geometry.height": 0.41, "forces.reference_length": 0.1}),
    ("aneurysm", {"fluid.density": 1035, "fluid.viscosity": 3.5e-3, "inflow.mean_velocity": 0.05 / 1.5,
     "solid.vessel.young_modulus": 1e6, "solid.dome.young_modulus": 1e5, "solid.vessel.density": 1120,
     "solid.dome.density": 1120}),
    ("cavity-flexible-floor", {"fluid.density": 1, "fluid.viscosity": 0.01, "inflow.mean_velocity": 1,
     "solid.floor.density": 1000, "solid.floor.young_modulus": 500, "solid.floor.poisson_ratio": 0.4,
     "forces.reference_length": 1}),
])  # fmt: skip
def test_catalogue_values(case: str, values: dict[str, float]) -> None:
    parameters = CASES[case].parameters()
    assert {key: parameters.get(key) for key in values} == values


def test_scenes_differ_in_what_they_are_named_for() -> None:
    assert list(CASES["turek-csm1"].parameters()) == [
        "geometry.length", "geometry.height", "geometry.cylinder_x", "geometry.cylinder_y",
        "geometry.cylinder_radius", "geometry.beam.length", "geometry.beam.thickness",
        "mesh.level", "mesh.size_factor", "mesh.growth", "mesh.far_size", "mesh.body_size", "mesh.corner_size",
        "solid.beam.density", "solid.beam.lame_mu", "solid.beam.poisson_ratio", "gravity.x", "gravity.y",
        "solver.tolerance", "solver.max_iterations", "solver.minimum_jacobian", "solver.reuse_ratio",
    ]  # fmt: skip
    assert type(CASES["turek-csm1"].parameters()["mesh.level"]) is int
    scene = CASES["cantilever"]
    assert isinstance(scene.geometry, Cantilever) and scene.traction is not None
    young, nu = scene.solid["beam"].young_poisson
    length, thickness = scene.geometry.length, scene.geometry.thickness
    bending = young * thickness**3 / (12 * (1 - nu**2))
    assert bending == pytest.approx(0.01, rel=1e-14)
    assert scene.traction.y * thickness * length**2 / bending == pytest.approx(scene.traction.y, rel=1e-14)
    base = CASES["flap-svk"].model_dump()
    for name in ("flap-neo-hookean", "flap-mooney-rivlin"):
        other = CASES[name].model_dump()
        different = {key for key in base if base[key] != other[key]}
        assert different == {"name", "description", "mesh", "solid"}
        assert other["mesh"] == base["mesh"] | {"root_size": None}
        assert other["solid"]["flap"]["material"] == name.removeprefix("flap-")
    for name in ("flap-neo-hookean", "flap-mooney-rivlin"):
        base, other = CASES[name].model_dump(), CASES[f"{name}-roof"].model_dump()
        different = {key for key in base if base[key] != other[key]}
        assert different == {"name", "description", "geometry", "solid", "inflow"}
        assert other["solid"]["flap"] == base["solid"]["flap"]
        assert other["solid"]["roof"] == CASES["flap-svk"].model_dump()["solid"]["flap"]
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
