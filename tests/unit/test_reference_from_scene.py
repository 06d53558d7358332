"""Every scene of the catalogue becomes the problem that it describes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from ffsi.reference.from_scene import problem_from_scene, refuse_other_parameters
from ffsi.reference.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Fluid, MeshMotion, Solid
from ffsi.reference.viscosity import Newtonian
from ffsi.scene import CASES, boundaries, with_values
from ffsi.scene import materials as scene_laws


@pytest.mark.parametrize("name", CASES)
def test_every_case_is_known(name):
    scene = CASES[name]
    problem = problem_from_scene(scene)
    assert problem.name == name and [b.label for b in problem.boundaries] == [b.label for b in boundaries(scene)]
    assert (problem.fluid is None) == (scene.fluid is None)
    assert list(problem.solids) == list(range(2, 2 + len(scene.solid)))


def test_turek_fsi1_has_the_published_values_in_their_places():
    problem = problem_from_scene(CASES["turek-fsi1"])
    assert problem.fluid == Fluid(density=1000.0, viscosity=Newtonian(1.0)) and problem.solids.keys() == {2}
    assert problem.solids[2].density == 1000.0
    material = problem.solids[2].material
    np.testing.assert_allclose([material.lame_lambda, material.lame_mu], [2e6, 0.5e6], rtol=1e-12)
    assert problem.outlet.kind == "do-nothing" and problem.reference_length == 0.1 and problem.mean_velocity == 0.2
    np.testing.assert_allclose(problem.inflow.velocity(np.array([0.0, 0.205, 0.41]), 0.0), [0, 0.3, 0], atol=1e-15)
    circles = {b.name: b.circle for b in problem.boundaries if b.circle}
    assert circles == {"cylinder": (0.2, 0.2, 0.05), "root": (0.2, 0.2, 0.05)}
    assert problem.parts() == {"cylinder": [4], "beam": [5]}
    changes = {
        "gravity.x": 0.5, "gravity.y": -2.0, "mesh_motion.stiffness_exponent": 1.7, "outlet.kind": "zero-traction",
    }  # fmt: skip
    problem = problem_from_scene(with_values(CASES["flap-svk"], changes | {"mesh_motion.divergence_weight": 0.3}))
    assert problem.gravity == (0.5, -2.0) and problem.mesh_motion == MeshMotion(1.7, 0.3, "hyperelastic")
    assert problem.outlet.kind == "zero-traction" and problem.solids == {2: Solid(1.0, StVenantKirchhoff(8.0, 2.0))}


@pytest.mark.parametrize("kind", ["harmonic", "linear-elastic", "hyperelastic"])
def test_mesh_motion_reaches_the_problem(kind):
    changes = {"mesh_motion.kind": kind, "mesh_motion.distance_exponent": 1.5}
    problem = problem_from_scene(with_values(CASES["turek-fsi1"], changes))
    assert problem.mesh_motion == MeshMotion(1.0, 1.0, kind, 1.5)


def test_materials_loads_and_inflow_reach_the_problem():
    problem = problem_from_scene(with_values(CASES["cook"], {"traction.x": 0.5}))
    assert problem.traction == (0.5, 4.0) and problem.labels("loaded") == [12]
    assert problem_from_scene(CASES["turek-csm1"]).traction == (0.0, 0.0)
    neo = dict(material="neo-hookean", lame_mu=2.0)
    mooney = dict(material="mooney-rivlin", c10=3.0, c01=2.0)
    for scene, expected in (
        (cook_of(scene_laws.NeoHookean, **neo, lame_lambda=8.0, formulation="mixed"), NeoHookean(8.0, 2.0)),
        (cook_of(scene_laws.NeoHookean, **neo, formulation="incompressible"), NeoHookean(math.inf, 2.0)),
        (cook_of(scene_laws.MooneyRivlin, **mooney, bulk_modulus=9.0, formulation="mixed"), MooneyRivlin(3, 2, 9)),
        (cook_of(scene_laws.MooneyRivlin, **mooney, formulation="incompressible"), MooneyRivlin(3, 2, math.inf)),
    ):
        problem = problem_from_scene(scene)
        assert problem.solids == {2: Solid(1.0, expected, scene.solid["membrane"].formulation)}
        assert problem.mixed_regions == [2]
    solids = {name: problem_from_scene(CASES[f"flap-{name}"]).solids for name in ("neo-hookean", "mooney-rivlin")}
    assert solids == {
        "neo-hookean": {2: Solid(1.0, NeoHookean(8.0, 2.0))},
        "mooney-rivlin": {2: Solid(1.0, MooneyRivlin(75.0, 100.0, 5.6))},
    }
    for name, solid in solids.items():
        lame_lambda, lame_mu = CASES[f"flap-{name}"].solid["flap"].lame
        assert solid[2].material.stiffness == pytest.approx(lame_lambda + 2 * lame_mu, rel=1e-14)
    problem = problem_from_scene(with_values(CASES["flap-svk"], {"inflow.profile": "uniform"}))
    np.testing.assert_array_equal(problem.inflow.velocity(np.array([0.1, 0.2]), 0.0), [0.12, 0.12])
    problem = problem_from_scene(CASES["turek-fsi2"])
    grown = middle_of(problem)
    assert [grown(t) for t in (0.0, 1.0, 2.0, 7.0)] == pytest.approx([0.0, 0.75, 1.5, 1.5], abs=1e-15)
    assert grown(0.5) == pytest.approx(0.75 * (1.0 - math.sqrt(0.5)), rel=1e-14)
    scene = with_values(CASES["cylinder-2d2"], {"inflow.waveform": "sin(pi * t / 8)"})
    swung = middle_of(problem_from_scene(scene))
    assert swung(0.5) == pytest.approx(0.75 * math.sin(math.pi / 16), rel=1e-14)
    assert swung(4.0) == pytest.approx(1.5, rel=1e-14)
    changes = {"mesh_motion.kind": "harmonic", "time.step": 0.01, "time.end": 1.0}
    constant = middle_of(problem_from_scene(with_values(CASES["flap-svk"], changes)), 0.2)
    assert constant(0.0) == constant(0.7) == middle_of(problem_from_scene(CASES["flap-svk"]), 0.2)(0.0)
    assert constant(0.0) == pytest.approx(1.5 * 0.12, rel=1e-14)


def test_two_solids_their_inflow_and_what_is_unknown():
    problem = problem_from_scene(CASES["flap-mooney-rivlin-roof"])
    assert problem.solids == {
        2: Solid(1.0, MooneyRivlin(75.0, 100.0, 5.6)), 3: Solid(1.0, StVenantKirchhoff(8.0, 2.0)),
    }  # fmt: skip
    assert problem.labels("interface") == [5, 10] and problem.labels("clamped") == [6, 11]
    assert problem.parts() == {"flap": [5]} and problem.mixed_regions == []
    problem = problem_from_scene(CASES["turek-csm1"])
    assert problem.fluid is None and problem.inflow is None and problem.outlet is None
    assert problem.gravity == (0.0, -2.0)
    scene = CASES["flap-svk"]
    fake = SimpleNamespace(**{key: getattr(scene, key) for key in (*type(scene).model_fields, "physics", "outlets")})
    fake.solid = {"flap": SimpleNamespace(material="rubber", density=1.0)}
    fake.inflow = None
    with pytest.raises(ValueError, match=r"solid\.flap: the reference checker does not know the material 'rubber'"):
        problem_from_scene(fake)
    refuse_other_parameters(scene, {"fluid.viscosity": 1e-3 * (1 + 1e-12), "unknown.key": 5.0})
    with pytest.raises(ValueError, match=r"fluid\.viscosity = 0\.00100001 but the scene says 0\.001"):
        refuse_other_parameters(scene, {"fluid.viscosity": 1.00001e-3})


def cook_of(law, **constants):
    return CASES["cook"].model_copy(update={"solid": {"membrane": law(density=1.0, **constants)}})


def middle_of(problem, s=0.205):
    """Velocity at one place of the inlet as a function of the time."""
    return lambda time: float(problem.inflow.velocity(np.array([s]), time)[0])
