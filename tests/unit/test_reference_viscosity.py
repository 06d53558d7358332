"""Viscosity laws: values, shear rate, exact flows, Jacobian, and what the checker refuses."""

import dataclasses

import numpy as np
import pytest
import test_reference_cases as cases
from manufactured import assert_derivative
from scipy.integrate import quad
from scipy.optimize import brentq
from test_reference_cases import HEIGHT, LENGTH
from test_reference_check import failing
from test_reference_step import beating, stepped
from test_reference_step_terms import random_state, random_step, rotation

from ffsi.reference import from_scene, terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.forces import compute_forces
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.materials import (
    IDENTITY,
    LinearElastic,
    MooneyRivlin,
    NeoHookean,
    SplitMaterial,
    StVenantKirchhoff,
    cofactor,
    determinant,
    dilatation,
)
from ffsi.reference.problem import Fluid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve
from ffsi.reference.system import System
from ffsi.reference.viscosity import Carreau, Casson, Newtonian, PowerLaw
from ffsi.scene import CASES, with_values
from ffsi.scene.materials import MATERIALS as SCENE_LAWS

BLOOD = Carreau(0.056, 0.00345, 10.976, -0.3216)
LAWS = [BLOOD, PowerLaw(0.03, 0.6, 0.05), Casson(0.004, 0.0035, 0.05)]


def name_of(law):
    return type(law).__name__


def test_limits_of_the_laws():
    none, much = np.array(0.0), np.array(1e30)
    assert BLOOD.at(none) == pytest.approx(0.056, rel=1e-14) and BLOOD.at(much) == pytest.approx(0.00345, rel=1e-6)
    # The classical form of Carreau's law, lambda = 3.313 s and the exponent (n - 1)/2 with n = 0.3568.
    expected = 0.00345 + (0.056 - 0.00345) * (1 + (3.313 * 7.0) ** 2) ** ((0.3568 - 1) / 2)
    assert BLOOD.at(np.array(49.0)) == pytest.approx(expected, rel=1e-4)
    assert PowerLaw(0.03, 0.6, 0.0).at(np.array(16.0)) == pytest.approx(0.03 * 4.0**-0.4, rel=1e-14)
    assert PowerLaw(0.03, 1.0, 0.1).at(np.array(16.0)) == pytest.approx(0.03, rel=1e-14)
    assert PowerLaw(0.03, 0.6, 0.5).at(none) == pytest.approx(0.03 * 0.5**-0.4, rel=1e-14)
    # Casson: the square root of the stress is the sum of those of the yield stress and of the viscous one.
    stress = Casson(0.004, 0.0035, 0.0).at(np.array(9.0)) * 3.0
    assert np.sqrt(stress) == pytest.approx(np.sqrt(0.004) + np.sqrt(0.0035 * 3.0), rel=1e-14)
    assert Casson(0.0, 0.0035, 0.1).at(np.array(9.0)) == pytest.approx(0.0035, rel=1e-14)
    assert [law.outlet for law in LAWS] == pytest.approx([0.00345, 0.0, 0.0035], rel=1e-14)
    assert [PowerLaw(0.03, m, 0.05).outlet for m in (1.0, 1.4)] == pytest.approx([0.03, 0.03 * 0.05**0.4], rel=1e-14)
    assert Newtonian(0.7).outlet == Newtonian(0.7).at(much) == 0.7


@pytest.mark.parametrize("name", ["newtonian", "carreau", "power-law", "casson"])
def test_laws_of_a_scene_reach_the_problem(name):
    constants = {
        "newtonian": {"viscosity": 0.02},
        "carreau": {"viscosity_zero": 0.05, "viscosity_infinity": 0.004, "time_constant_squared": 9, "exponent": -0.3},
        "power-law": {"consistency": 0.03, "exponent": 0.6, "regularisation": 0.02},
        "casson": {"yield_stress": 0.005, "viscosity_infinity": 0.0035, "regularisation": 0.03},
    }[name]
    changes = {f"fluid.{key}": value for key, value in constants.items()} | {"fluid.law": name}
    fluid = problem_from_scene(with_values(CASES["turek-fsi1"], changes)).fluid
    expected = {
        "newtonian": Newtonian(0.02), "carreau": Carreau(0.05, 0.004, 9.0, -0.3),
        "power-law": PowerLaw(0.03, 0.6, 0.02), "casson": Casson(0.005, 0.0035, 0.03),
    }[name]  # fmt: skip
    assert fluid == Fluid(1000.0, expected)


@pytest.mark.parametrize("law", LAWS, ids=name_of)
def test_a_law_has_its_shear_rate_wall_force_and_jacobian(law):
    # v linear in the place x, on a mesh that is stretched and turned.
    slope, stretch = np.array([[0.4, 2.0], [-0.7, -0.4]]), np.array([[1.2, 0.3], [-0.2, 0.9]])
    mesh = cases.channel_mesh()
    state = cases.state_of(mesh, u=lambda x: x @ (stretch - np.eye(2)).T, v=lambda x: x @ (slope @ stretch).T)
    elements = System.build(cases.channel_problem(), mesh).fluid.elements
    flow = terms.Flow.at_points(
        elements, state.u[elements.nodes], state.v[elements.nodes], np.zeros((len(elements), 3))
    )
    squared = 2 * 0.4**2 + 2 * 0.4**2 + (2.0 - 0.7) ** 2
    np.testing.assert_allclose(flow.viscosity(law), law.at(np.array(squared)), rtol=1e-12)
    problem = cases.channel_problem(fluid=Fluid(0.0, law))
    system = System.build(problem, mesh)
    state = cases.state_of(mesh, v=lambda x: 3.0 * x[:, ::-1] * np.array([1.0, 0.0]))
    force = compute_forces(system, state, compute_residual(system, state)).parts["floor"]
    drag = 3.0 * float(law.at(np.array(9.0))) * LENGTH
    np.testing.assert_allclose(force.surface, [drag, 0.0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(force.residual, [drag, 0.0], rtol=1e-12, atol=1e-15)
    system, state = random_step(cases.channel_problem(fluid=Fluid(1.3, law)), cases.channel_mesh(4, 2))
    cases.assert_jacobian_is_the_derivative(system, state, random_state(system, 8))


def poiseuille(law, slope):
    """Velocity between two walls under the pressure gradient -``slope``, by quadrature of the shear rate."""

    def rate(stress):
        return brentq(lambda g: law.at(np.array(g * g)) * g - stress, 0.0, 1e6, xtol=1e-15, rtol=1e-14)

    def velocity(y):
        return quad(lambda r: rate(slope * r), abs(y - HEIGHT / 2), HEIGHT / 2, epsabs=1e-13)[0]

    return velocity


@pytest.mark.parametrize("law", LAWS, ids=name_of)
def test_plane_poiseuille_flow_solves_in_the_limit_of_fine_meshes(law):
    # The pressure gradient balances the stress at the wall: a shear rate of 10/s there.
    slope = 2.0 / HEIGHT * 10.0 * float(law.at(np.array(100.0)))
    exact = poiseuille(law, slope)
    heights = {}
    errors = []
    for ny in (8, 16, 32):
        mesh = cases.channel_mesh(4, ny)
        for y in np.unique(mesh.p2_coordinates[:, 1]):
            heights.setdefault(y, exact(y))
        v = np.array([heights[y] for y in mesh.p2_coordinates[:, 1]])
        state = cases.state_of(mesh, p=lambda x: slope * (LENGTH - x[:, 0]))
        state.v[:, 0] = v
        problem = cases.channel_problem(fluid=Fluid(1.3, law), outlet=Outlet("zero-traction"))
        equations = compute_residual(System.build(problem, mesh), state).equations
        # At the outlet the shear stress is not zero; inside all rows hold.
        inner = (mesh.p2_coordinates[:, 0] < LENGTH) & System.build(problem, mesh).rows.momentum
        momentum = equations["momentum"]
        errors.append(np.linalg.norm(momentum.residual[inner]) / np.linalg.norm(momentum.terms["viscosity"][inner]))
        assert equations["continuity"].relative < 1e-9
    # The rows of an interpolant are of one order less than its gradient.
    assert errors[2] < errors[1] / 1.9 < errors[0] / 1.9**2 and errors[2] < 0.05


@pytest.mark.parametrize("law", LAWS, ids=name_of)
def test_newton_converges_and_step_passes(law):
    problem, mesh = cases.flap_problem(fluid=Fluid(1.0, law), inflow=cases.flow_in(beating)), cases.flap_mesh(4)
    assert solve(System.build(problem, mesh), tolerance=1e-10).residual.equations["momentum"].relative < 1e-10
    arguments = stepped(problem, mesh)
    assert cases.check_step(*arguments).failures == []
    constant = dataclasses.replace(problem, fluid=Fluid(1.0, Newtonian(law.outlet)))
    for wrong in (constant, dataclasses.replace(problem, fluid=Fluid(1.0, slightly_other(law)))):
        assert {"momentum", "drag_difference"} <= failing(cases.check_step(wrong, *arguments[1:]))


def slightly_other(law):
    """The law with its last constant changed by a hundredth."""
    *_, last = (field.name for field in dataclasses.fields(law))
    return dataclasses.replace(law, **{last: 1.01 * getattr(law, last)})


def test_viscosity_of_the_old_state_is_that_of_its_shear_rate(monkeypatch):
    new_everywhere = terms.step_fluxes

    def wrong(fluid, step, new, old):
        viscosity = new.viscosity(fluid.viscosity)
        old_flux = viscosity[..., None, None] * (old.doubled_deformation_rate @ old.cofactor)
        right = new_everywhere(fluid, step, new, old)
        return right | {"viscosity": step.mean(new.viscous_flux(fluid.viscosity), old_flux)}

    problem, mesh = cases.channel_problem(fluid=Fluid(1.3, BLOOD), inflow=cases.flow_in(beating)), cases.channel_mesh()
    monkeypatch.setattr(terms, "step_fluxes", wrong)
    arguments = stepped(problem, mesh)
    monkeypatch.undo()
    assert "momentum" in failing(cases.check_step(*arguments))


def test_unknown_law_is_refused():
    scene = CASES["turek-cfd1"]
    fluid = scene.fluid.model_copy(update={"law": "cross"})
    with pytest.raises(ValueError, match="does not know the viscosity law 'cross'"):
        problem_from_scene(scene.model_copy(update={"fluid": fluid}))


LAMBDA, MU = 2.0, 0.7
# Every material with its Lame constants at rest.
C10, C01, BULK = 0.2, 0.15, LAMBDA + 2 / 3 * MU
PAPER = MooneyRivlin(75.0, 100.0, 5.6)
MATERIALS = [
    (StVenantKirchhoff(LAMBDA, MU), LAMBDA, MU), (LinearElastic(LAMBDA, MU), LAMBDA, MU),
    (NeoHookean(LAMBDA, MU), LAMBDA, MU), (MooneyRivlin(C10, C01, BULK), LAMBDA, MU),
    (PAPER, 5.6 - 2 / 3 * 350.0, 350.0),
]  # fmt: skip
SPLIT = [entry for entry in MATERIALS if isinstance(entry[0], SplitMaterial)]
GRADIENTS = np.random.default_rng(3).normal(size=(50, 2, 2)) * 0.3
GRADIENTS = GRADIENTS[determinant(IDENTITY + GRADIENTS) > 0.3]


ROTATION = rotation(0.7)
# Half turns of solids compressed and sheared to a fifth of their area.
SQUEEZED = np.array(
    [
        rotation(angle) @ np.array([[stretch, shear], [0.0, 0.2 / stretch]]) @ rotation(-0.4) - IDENTITY
        for angle, stretch, shear in [(2.9, 0.2, 0.1), (-2.0, 0.45, 0.3), (1.3, 1.0, -0.5), (3.1, 1.5, 0.0)]
    ]
)


@pytest.fixture(params=MATERIALS, ids=lambda entry: "paper" if entry[0] is PAPER else type(entry[0]).__name__)
def known(request):
    return request.param


material = pytest.fixture(lambda known: known[0])


@pytest.fixture
def objective(material):
    if isinstance(material, LinearElastic):
        pytest.skip("a law of small rotations")
    return material


@pytest.fixture(params=SPLIT, ids=lambda entry: "paper" if entry[0] is PAPER else type(entry[0]).__name__)
def split(request):
    return request.param


def eliminated(material, gradient):
    """Stress dW_0/dF - p cof F with the pressure that the volume equation of the mixed form gives."""
    pressure = -material.volume_modulus * material.volume_slope(dilatation(gradient))
    return material.base_stress(gradient) - pressure[..., None, None] * cofactor(IDENTITY + gradient)


def test_all_laws_are_here_and_gradients_are_large():
    of_scenes = {"linear-elastic": LinearElastic, "st-venant-kirchhoff": StVenantKirchhoff}
    of_scenes |= {"neo-hookean": NeoHookean, "mooney-rivlin": MooneyRivlin}
    assert set(of_scenes) == set(from_scene.MATERIALS) == set(SCENE_LAWS)
    assert {*of_scenes.values()} == {type(material) for material, *_ in MATERIALS}
    assert len(GRADIENTS) > 30 and determinant(IDENTITY + GRADIENTS).min() < 0.5
    np.testing.assert_allclose(determinant(IDENTITY + SQUEEZED), 0.2, rtol=1e-14)


@pytest.mark.parametrize("gradients", [GRADIENTS, SQUEEZED], ids=["random", "squeezed and turned"])
def test_stress_is_the_complex_step_derivative_of_the_energy(material, gradients):
    assert_derivative(material.first_piola(gradients), material.energy, gradients)


def assert_stiffness(stress_of, lame_lambda, lame_mu):
    """Plane strain at rest: stresses xx, yy, xy of the strains xx, yy and the shear 2 e_xy."""
    young = lame_mu * (3 * lame_lambda + 2 * lame_mu) / (lame_lambda + lame_mu)
    nu = lame_lambda / (2 * (lame_lambda + lame_mu))
    expected = np.array([[1 - nu, nu, 0], [nu, 1 - nu, 0], [0, 0, 0.5 - nu]]) * young / ((1 + nu) * (1 - 2 * nu))
    found = np.zeros((3, 3))
    for column, gradient in enumerate(([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]])):
        stress = stress_of(1e-30j * np.array(gradient)).imag / 1e-30
        assert stress[0, 1] == stress[1, 0]
        found[:, column] = stress[0, 0], stress[1, 1], stress[0, 1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_small_strains_are_linear_elastic_and_keep_their_digits(known):
    material, lame_lambda, lame_mu = known
    small = 1e-9 * GRADIENTS
    strain = 0.5 * (small + small.transpose(0, 2, 1))
    trace = np.trace(strain, axis1=1, axis2=2)
    hooke = lame_lambda * trace[:, None, None] * IDENTITY + 2 * lame_mu * strain
    np.testing.assert_allclose(material.first_piola(small), hooke, rtol=0, atol=1e-8 * np.abs(hooke).max())
    assert_stiffness(material.first_piola, lame_lambda, lame_mu)
    turn = material.first_piola(1e-30j * np.array([[0.0, -1.0], [1.0, 0.0]])).imag / 1e-30
    np.testing.assert_allclose(turn, 0.0, atol=1e-15 * material.stiffness)
    strain = np.array([[1e-13, 1e-13], [1e-13, 0.0]])
    found = material.first_piola(strain)
    np.testing.assert_allclose(found[0, 1], 2 * lame_mu * 1e-13, rtol=2e-12)
    np.testing.assert_allclose(found[1, 1], lame_lambda * 1e-13, rtol=2e-12)


def test_stress_is_objective_and_isotropic_and_none_at_rest(objective):
    for gradients in (GRADIENTS, SQUEEZED):
        turned = ROTATION @ (IDENTITY + gradients) - IDENTITY
        expected = ROTATION @ objective.first_piola(gradients)
        close = 2e-14 * np.abs(expected).max()
        np.testing.assert_allclose(objective.first_piola(turned), expected, rtol=0, atol=close)
        np.testing.assert_allclose(objective.energy(turned), objective.energy(gradients), rtol=0, atol=close)
    turned = objective.first_piola((IDENTITY + GRADIENTS) @ ROTATION - IDENTITY)
    expected = objective.first_piola(GRADIENTS) @ ROTATION
    np.testing.assert_allclose(turned, expected, rtol=0, atol=2e-14 * np.abs(expected).max())
    assert (objective.first_piola(np.zeros((2, 2))) == 0.0).all() and objective.energy(np.zeros((2, 2))) == 0.0
    for angle in (0.7, -2.0, 3.0):
        stress = objective.first_piola(rotation(angle) - IDENTITY)
        np.testing.assert_allclose(stress, 0.0, atol=1e-15 * objective.stiffness)


def test_stiffness_is_the_modulus_of_uniaxial_strain(material):
    stretch = np.diag([1e-9, 0.0])
    np.testing.assert_allclose(material.first_piola(stretch)[0, 0], 1e-9 * material.stiffness, rtol=1e-8)


@pytest.mark.parametrize("gradients", [GRADIENTS, SQUEEZED], ids=["random", "squeezed and turned"])
def test_stress_of_the_mixed_form_is_the_derivative_of_its_energy(split, gradients):
    material, *_ = split
    assert_derivative(material.base_stress(gradients), material.base_energy, gradients)


def test_mixed_form_is_objective_linear_at_rest_and_the_displacement_form(split):
    material, lame_lambda, lame_mu = split
    change = np.array([-0.9, -0.3, 0.0, 0.4, 3.0])
    derivative = material.volume_energy(change + 1e-30j).imag / 1e-30
    np.testing.assert_allclose(material.volume_slope(change), derivative, rtol=1e-14)
    assert material.volume_slope(1e-30j + np.zeros(1)).imag[0] == 1e-30
    assert (material.base_stress(np.zeros((2, 2))) == 0.0).all() and material.base_energy(np.zeros((2, 2))) == 0.0
    for angle in (0.7, -2.0, 3.0):
        stress = material.base_stress(rotation(angle) - IDENTITY)
        np.testing.assert_allclose(stress, 0.0, atol=1e-15 * material.base_stiffness)
    pressure = np.linspace(-1.0, 2.0, len(GRADIENTS))[:, None, None]
    turned = ROTATION @ (IDENTITY + GRADIENTS) - IDENTITY
    stress, other = (material.base_stress(h) - pressure * cofactor(IDENTITY + h) for h in (GRADIENTS, turned))
    np.testing.assert_allclose(other, ROTATION @ stress, rtol=0, atol=2e-14 * np.abs(stress).max())
    assert_stiffness(lambda gradient: eliminated(material, gradient), lame_lambda, lame_mu)
    expected = material.first_piola(GRADIENTS)
    np.testing.assert_allclose(eliminated(material, GRADIENTS), expected, rtol=0, atol=1e-14 * np.abs(expected).max())


def test_stresses_are_the_formulas_of_document_and_textbook():
    deformation = IDENTITY + GRADIENTS
    inverse = np.linalg.inv(deformation).transpose(0, 2, 1)
    expected = MU * (deformation - inverse)
    np.testing.assert_allclose(NeoHookean(np.inf, MU).base_stress(GRADIENTS), expected, rtol=0, atol=1e-13)
    strain = 0.5 * (deformation.transpose(0, 2, 1) @ deformation - IDENTITY)
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    expected = deformation @ (LAMBDA * trace * IDENTITY + 2 * MU * strain)
    np.testing.assert_allclose(StVenantKirchhoff(LAMBDA, MU).first_piola(GRADIENTS), expected, rtol=0, atol=1e-14)
    jacobian = np.linalg.det(deformation)
    log, first = np.log(jacobian), (deformation**2).sum(axis=(1, 2)) + 1.0
    solid, energy = NeoHookean(LAMBDA, MU), MU / 2 * (first - 3 - 2 * log) + LAMBDA / 2 * log**2
    np.testing.assert_allclose(solid.energy(GRADIENTS), energy, rtol=0, atol=1e-13)
    expected = MU * (deformation - inverse) + LAMBDA * log[:, None, None] * inverse
    np.testing.assert_allclose(solid.first_piola(GRADIENTS), expected, rtol=0, atol=1e-13)


def test_mooney_rivlin_is_the_formula_in_three_dimensions():
    # Invariants of the 3D tensor C = F^T F with F33 = 1, from its eigenvalues.
    spatial = np.zeros((len(GRADIENTS), 3, 3))
    spatial[:, :2, :2] = IDENTITY + GRADIENTS
    spatial[:, 2, 2] = 1.0
    a, b, c = np.linalg.eigvalsh(spatial.transpose(0, 2, 1) @ spatial).T
    jacobian = np.sqrt(a * b * c)
    first, second = a + b + c, a * b + b * c + c * a
    energy = (
        C10 * (jacobian ** (-2 / 3) * first - 3) + C01 * (jacobian ** (-4 / 3) * second - 3)
        + BULK / 2 * (jacobian - 1) ** 2
    )  # fmt: skip
    solid = MooneyRivlin(C10, C01, BULK)
    np.testing.assert_allclose(solid.energy(GRADIENTS), energy, rtol=0, atol=1e-13)
    # The stress as the document has it.
    jacobian, first, second = (value[:, None, None] for value in (jacobian, first, second))
    deformation = spatial[:, :2, :2]
    inverse = np.linalg.inv(deformation).transpose(0, 2, 1)
    base = 2 * C10 * jacobian ** (-2 / 3) * (deformation - first / 3 * inverse)
    base += 2 * C01 * jacobian ** (-4 / 3) * (deformation + (jacobian**2 - 2 / 3 * second) * inverse)
    np.testing.assert_allclose(MooneyRivlin(C10, C01, np.inf).base_stress(GRADIENTS), base, rtol=0, atol=1e-13)
    expected = base + BULK * (jacobian - 1) * jacobian * inverse
    np.testing.assert_allclose(solid.first_piola(GRADIENTS), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("solid", [NeoHookean(LAMBDA, MU), MooneyRivlin(C10, C01, BULK), PAPER], ids=str)
def test_logarithms_and_powers_resist_ever_more_and_give_no_stress_where_inverted(solid):
    pressure = [-solid.first_piola(np.diag([squeezed - 1.0, 0.0]))[0, 0] for squeezed in (0.5, 0.1, 0.01)]
    assert 0.0 < pressure[0] < pressure[1] / 5.0 < pressure[2] / 50.0
    for flat in (0.0, -0.5):
        assert not np.isfinite(solid.first_piola(np.diag([flat - 1.0, 0.0]))[1, 1])


def test_cofactor_is_determinant_times_inverse_transposed():
    deformation = IDENTITY + GRADIENTS
    expected = np.linalg.det(deformation)[:, None, None] * np.linalg.inv(deformation).transpose(0, 2, 1)
    np.testing.assert_allclose(cofactor(deformation), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(determinant(deformation), np.linalg.det(deformation), rtol=0, atol=1e-14)
