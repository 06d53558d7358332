"""Stress is the derivative of the energy, and the energy is the material's."""

import numpy as np
import pytest

from ffsi.reference import from_scene
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
from ffsi.scene.materials import MATERIALS as SCENE_LAWS

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


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


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
    stress = material.first_piola(gradients)
    for i in range(2):
        for j in range(2):
            step = np.zeros((2, 2), dtype=complex)
            step[i, j] = 1e-30j
            derivative = material.energy(gradients + step).imag / 1e-30
            np.testing.assert_allclose(stress[:, i, j], derivative, rtol=0, atol=1e-14 * np.abs(stress).max())


def test_small_strains_are_linear_elastic_and_keep_their_digits(known):
    material, lame_lambda, lame_mu = known
    small = 1e-9 * GRADIENTS
    strain = 0.5 * (small + small.transpose(0, 2, 1))
    trace = np.trace(strain, axis1=1, axis2=2)
    hooke = lame_lambda * trace[:, None, None] * IDENTITY + 2 * lame_mu * strain
    np.testing.assert_allclose(material.first_piola(small), hooke, rtol=0, atol=1e-8 * np.abs(hooke).max())
    young = lame_mu * (3 * lame_lambda + 2 * lame_mu) / (lame_lambda + lame_mu)
    nu = lame_lambda / (2 * (lame_lambda + lame_mu))
    # Plane strain: stresses xx, yy, xy of the strains xx, yy and the shear 2 e_xy.
    expected = np.array([[1 - nu, nu, 0], [nu, 1 - nu, 0], [0, 0, 0.5 - nu]]) * young / ((1 + nu) * (1 - 2 * nu))
    found = np.zeros((3, 3))
    for column, gradient in enumerate(([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]])):
        stress = material.first_piola(1e-30j * np.array(gradient)).imag / 1e-30
        assert stress[0, 1] == stress[1, 0]
        found[:, column] = stress[0, 0], stress[1, 1], stress[0, 1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
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
    stress = material.base_stress(gradients)
    for i in range(2):
        for j in range(2):
            step = np.zeros((2, 2), dtype=complex)
            step[i, j] = 1e-30j
            derivative = material.base_energy(gradients + step).imag / 1e-30
            np.testing.assert_allclose(stress[:, i, j], derivative, rtol=0, atol=1e-14 * np.abs(stress).max())


def test_mixed_form_is_objective_linear_at_rest_and_the_displacement_form(split):
    material, *_ = split
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
    material, lame_lambda, lame_mu = split
    young = lame_mu * (3 * lame_lambda + 2 * lame_mu) / (lame_lambda + lame_mu)
    nu = lame_lambda / (2 * (lame_lambda + lame_mu))
    expected = np.array([[1 - nu, nu, 0], [nu, 1 - nu, 0], [0, 0, 0.5 - nu]]) * young / ((1 + nu) * (1 - 2 * nu))
    found = np.zeros((3, 3))
    for column, gradient in enumerate(([[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 0.5], [0.5, 0]])):
        stress = eliminated(material, 1e-30j * np.array(gradient)).imag / 1e-30
        found[:, column] = stress[0, 0], stress[1, 1], stress[0, 1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    material, *_ = split
    expected = material.first_piola(GRADIENTS)
    np.testing.assert_allclose(eliminated(material, GRADIENTS), expected, rtol=0, atol=1e-14 * np.abs(expected).max())


def test_stresses_are_the_formulas_of_document_and_textbook():
    deformation = IDENTITY + GRADIENTS
    inverse = np.linalg.inv(deformation).transpose(0, 2, 1)
    expected = MU * (deformation - inverse)
    np.testing.assert_allclose(NeoHookean(np.inf, MU).base_stress(GRADIENTS), expected, rtol=0, atol=1e-13)
    jacobian = np.linalg.det(deformation)[:, None, None]
    first = (deformation**2).sum(axis=(1, 2))[:, None, None] + 1.0
    second = first - 1.0 + jacobian**2
    expected = 2 * C10 * jacobian ** (-2 / 3) * (deformation - first / 3 * inverse)
    expected += 2 * C01 * jacobian ** (-4 / 3) * (deformation + (jacobian**2 - 2 / 3 * second) * inverse)
    np.testing.assert_allclose(MooneyRivlin(C10, C01, np.inf).base_stress(GRADIENTS), expected, rtol=0, atol=1e-13)
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
    expected = (
        2 * C10 * jacobian ** (-2 / 3) * (deformation - first / 3 * inverse)
        + 2 * C01 * jacobian ** (-4 / 3) * (deformation + (jacobian**2 - 2 / 3 * second) * inverse)
        + BULK * (jacobian - 1) * jacobian * inverse
    )
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
