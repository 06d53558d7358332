"""Stress is the derivative of the energy, and the energy is the material's."""

import numpy as np
import pytest

from ffsi.reference.materials import IDENTITY, PseudoSolid, StVenantKirchhoff, cofactor, determinant

LAMBDA, MU = 2.0, 0.7
# Every material with its Lame constants at rest.
MATERIALS = [(StVenantKirchhoff(LAMBDA, MU), LAMBDA, MU), (PseudoSolid(LAMBDA), LAMBDA, 1.0)]
GRADIENTS = np.random.default_rng(3).normal(size=(50, 2, 2)) * 0.3
GRADIENTS = GRADIENTS[determinant(IDENTITY + GRADIENTS) > 0.3]
ROTATION = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])


@pytest.fixture(params=MATERIALS, ids=lambda entry: type(entry[0]).__name__)
def known(request):
    return request.param


@pytest.fixture
def material(known):
    return known[0]


def test_gradients_are_many_and_large():
    assert len(GRADIENTS) > 30
    assert determinant(IDENTITY + GRADIENTS).min() < 0.5


def test_stress_is_the_complex_step_derivative_of_the_energy(material):
    stress = material.first_piola(GRADIENTS)
    for i in range(2):
        for j in range(2):
            step = np.zeros((2, 2), dtype=complex)
            step[i, j] = 1e-30j
            derivative = material.energy(GRADIENTS + step).imag / 1e-30
            np.testing.assert_allclose(stress[:, i, j], derivative, rtol=0, atol=1e-14 * np.abs(stress).max())


def test_small_strain_limit_is_hookes_law(known):
    material, lame_lambda, lame_mu = known
    small = 1e-9 * GRADIENTS
    strain = 0.5 * (small + small.transpose(0, 2, 1))
    trace = np.trace(strain, axis1=1, axis2=2)
    hooke = lame_lambda * trace[:, None, None] * IDENTITY + 2 * lame_mu * strain
    np.testing.assert_allclose(material.first_piola(small), hooke, rtol=0, atol=1e-8 * np.abs(hooke).max())


def test_stress_turns_with_the_frame(material):
    deformation = IDENTITY + GRADIENTS
    turned = material.first_piola(ROTATION @ deformation - IDENTITY)
    np.testing.assert_allclose(turned, ROTATION @ material.first_piola(GRADIENTS), rtol=0, atol=2e-14)


def test_stress_is_isotropic(material):
    turned = material.first_piola((IDENTITY + GRADIENTS) @ ROTATION - IDENTITY)
    np.testing.assert_allclose(turned, material.first_piola(GRADIENTS) @ ROTATION, rtol=0, atol=2e-14)


def test_rest_and_rotation_are_free_of_stress(material):
    assert (material.first_piola(np.zeros((2, 2))) == 0.0).all()
    np.testing.assert_allclose(material.first_piola(ROTATION - IDENTITY), 0.0, atol=1e-15)


def test_stiffness_is_the_modulus_of_uniaxial_strain(material):
    stretch = np.diag([1e-9, 0.0])
    np.testing.assert_allclose(material.first_piola(stretch)[0, 0], 1e-9 * material.stiffness, rtol=1e-8)


def test_st_venant_kirchhoff_is_the_textbook_formula():
    deformation = IDENTITY + GRADIENTS
    strain = 0.5 * (deformation.transpose(0, 2, 1) @ deformation - IDENTITY)
    trace = np.trace(strain, axis1=1, axis2=2)[:, None, None]
    expected = deformation @ (LAMBDA * trace * IDENTITY + 2 * MU * strain)
    np.testing.assert_allclose(StVenantKirchhoff(LAMBDA, MU).first_piola(GRADIENTS), expected, rtol=0, atol=1e-14)


def test_pseudo_solid_is_the_formula_of_the_document():
    deformation = IDENTITY + GRADIENTS
    inverse = np.linalg.inv(deformation).transpose(0, 2, 1)
    log = np.log(np.linalg.det(deformation))[:, None, None]
    solid = PseudoSolid(LAMBDA)
    np.testing.assert_allclose(solid.shape_stress(GRADIENTS), deformation - inverse, rtol=0, atol=1e-13)
    np.testing.assert_allclose(solid.volume_stress(GRADIENTS), LAMBDA * log * inverse, rtol=0, atol=1e-13)
    norm = (deformation**2).sum(axis=(1, 2))
    energy = 0.5 * (norm - 2.0) - log.ravel() + 0.5 * LAMBDA * log.ravel() ** 2
    np.testing.assert_allclose(solid.energy(GRADIENTS), energy, rtol=0, atol=1e-13)


def test_pseudo_solid_resists_ever_more_and_has_no_stress_where_it_is_inverted():
    solid = PseudoSolid(LAMBDA)
    pressure = [-solid.first_piola(np.diag([squeezed - 1.0, 0.0]))[0, 0] for squeezed in (0.5, 0.1, 0.01)]
    assert 0.0 < pressure[0] < pressure[1] / 5.0 < pressure[2] / 50.0
    for flat in (0.0, -0.5):
        assert not np.isfinite(solid.first_piola(np.diag([flat - 1.0, 0.0]))[1, 1])


def test_small_strains_keep_their_digits(known):
    material, lame_lambda, lame_mu = known
    strain = np.array([[1e-13, 1e-13], [1e-13, 0.0]])
    found = material.first_piola(strain)
    np.testing.assert_allclose(found[0, 1], 2 * lame_mu * 1e-13, rtol=1e-12)
    np.testing.assert_allclose(found[1, 1], lame_lambda * 1e-13, rtol=1e-12)


def test_cofactor_is_determinant_times_inverse_transposed():
    deformation = IDENTITY + GRADIENTS
    expected = np.linalg.det(deformation)[:, None, None] * np.linalg.inv(deformation).transpose(0, 2, 1)
    np.testing.assert_allclose(cofactor(deformation), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(determinant(deformation), np.linalg.det(deformation), rtol=0, atol=1e-14)
