"""Viscosity laws: values, shear rate, exact flows, Jacobian, and what the checker refuses."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from test_reference_cases import (
    HEIGHT,
    LENGTH,
    assert_jacobian_is_the_derivative,
    channel_mesh,
    channel_problem,
    check_step,
    flap_mesh,
    flap_problem,
    flow_in,
    state_of,
)
from test_reference_check import failing
from test_reference_step import beating, stepped
from test_reference_step_terms import random_state, random_step

from ffsi.reference import terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.forces import compute_forces
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.problem import Fluid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve
from ffsi.reference.system import System
from ffsi.reference.viscosity import Carreau, Casson, Newtonian, PowerLaw
from ffsi.scene import CASES, with_values

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
    mesh = channel_mesh()
    state = state_of(mesh, u=lambda x: x @ (stretch - np.eye(2)).T, v=lambda x: x @ (slope @ stretch).T)
    elements = System.build(channel_problem(), mesh).fluid.elements
    flow = terms.Flow.at_points(
        elements, state.u[elements.nodes], state.v[elements.nodes], np.zeros((len(elements), 3))
    )
    squared = 2 * 0.4**2 + 2 * 0.4**2 + (2.0 - 0.7) ** 2
    np.testing.assert_allclose(flow.viscosity(law), law.at(np.array(squared)), rtol=1e-12)
    problem = channel_problem(fluid=Fluid(0.0, law))
    system = System.build(problem, mesh)
    state = state_of(mesh, v=lambda x: 3.0 * x[:, ::-1] * np.array([1.0, 0.0]))
    force = compute_forces(system, state, compute_residual(system, state)).parts["floor"]
    drag = 3.0 * float(law.at(np.array(9.0))) * LENGTH
    np.testing.assert_allclose(force.surface, [drag, 0.0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(force.residual, [drag, 0.0], rtol=1e-12, atol=1e-15)
    system, state = random_step(channel_problem(fluid=Fluid(1.3, law)), channel_mesh(4, 2))
    assert_jacobian_is_the_derivative(system, state, random_state(system, 8))


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
        mesh = channel_mesh(4, ny)
        for y in np.unique(mesh.p2_coordinates[:, 1]):
            heights.setdefault(y, exact(y))
        v = np.array([heights[y] for y in mesh.p2_coordinates[:, 1]])
        state = state_of(mesh, p=lambda x: slope * (LENGTH - x[:, 0]))
        state.v[:, 0] = v
        problem = channel_problem(fluid=Fluid(1.3, law), outlet=Outlet("zero-traction"))
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
    problem, mesh = flap_problem(fluid=Fluid(1.0, law), inflow=flow_in(beating)), flap_mesh(4)
    assert solve(System.build(problem, mesh), tolerance=1e-10).residual.equations["momentum"].relative < 1e-10
    arguments = stepped(problem, mesh)
    assert check_step(*arguments).failures == []
    constant = dataclasses.replace(problem, fluid=Fluid(1.0, Newtonian(law.outlet)))
    for wrong in (constant, dataclasses.replace(problem, fluid=Fluid(1.0, slightly_other(law)))):
        assert {"momentum", "drag_difference"} <= failing(check_step(wrong, *arguments[1:]))


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

    problem, mesh = channel_problem(fluid=Fluid(1.3, BLOOD), inflow=flow_in(beating)), channel_mesh()
    monkeypatch.setattr(terms, "step_fluxes", wrong)
    arguments = stepped(problem, mesh)
    monkeypatch.undo()
    assert "momentum" in failing(check_step(*arguments))


def test_unknown_law_is_refused():
    scene = CASES["turek-cfd1"]
    fluid = scene.fluid.model_copy(update={"law": "cross"})
    with pytest.raises(ValueError, match="does not know the viscosity law 'cross'"):
        problem_from_scene(scene.model_copy(update={"fluid": fluid}))
