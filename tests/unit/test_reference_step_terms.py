"""Terms of a time step and its Jacobian, and what the schemes keep: rest, uniform flow, the energy of a vibration."""

import math

import numpy as np
import pytest
import test_reference_cases as cases
from test_reference_cases import channel_mesh, channel_problem, flap_mesh, flap_problem, flow_in, profile, state_of
from test_reference_step import THETA, WRONG_FLUID, K, beating, march, mean_of_first_piola, rest, wrong_pressure

from ffsi.files.arrays import RawState
from ffsi.reference import terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.materials import NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Manufactured, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.reference.terms import step_stress


def random_state(system, seed, size=0.006):
    rng, mesh = np.random.default_rng(seed), system.mesh
    shape = (mesh.n_p2, 2)
    u, pressed = size * rng.normal(size=shape), system.rows.incompressibility
    p = rng.normal(size=len(mesh.vertices))
    return RawState(u, rng.normal(size=shape), p, rng.normal(size=pressed.shape) * pressed)


def random_step(problem, mesh):
    system, step = System.build(problem, mesh), Step(K, 0.7, 0.3)
    return system.stepping(random_state(system, 1), step), random_state(system, 2)


class Points:
    """Fields of a state at the quadrature points, by the formulas of docs/theory.md."""

    def __init__(self, elements, state):
        u, v = state.u[elements.nodes], state.v[elements.nodes]
        self.f = np.eye(2) + np.einsum("tai,tqaj->tqij", u, elements.gradients)
        self.j = np.linalg.det(self.f)
        self.cof = self.j[..., None, None] * np.linalg.inv(self.f).swapaxes(-1, -2)
        self.g = np.einsum("tai,tqaj->tqij", v, elements.gradients) @ self.cof.swapaxes(-1, -2)
        self.v = np.einsum("qa,tai->tqi", elements.basis, v)
        self.u = np.einsum("qa,tai->tqi", elements.basis, u)
        self.p = np.einsum("qa,ta->tq", elements.p1, state.p[elements.vertices])

    def viscous(self, viscosity):
        return (viscosity / self.j)[..., None, None] * (self.g + self.g.swapaxes(-1, -2)) @ self.cof


def assemble(elements, n2, density=None, flux=None):
    total = np.zeros((n2, 2))
    if density is not None:
        np.add.at(total, elements.nodes, np.einsum("tq,qa,tqi->tai", elements.weights, elements.basis, density))
    if flux is not None:
        np.add.at(total, elements.nodes, np.einsum("tq,tqij,tqaj->tai", elements.weights, flux, elements.gradients))
    return total


def test_terms_of_the_fluid_are_the_formulas_of_the_document():
    gravity = np.array([0.3, -0.8])
    system, state = random_step(channel_problem(gravity=(0.3, -0.8)), channel_mesh())
    elements, step, law = system.fluid.elements, system.increment.step, system.fluid.law
    new, old = Points(elements, state), Points(elements, system.increment.old)
    w = (new.u - old.u) / K
    theta, n2 = step.theta, system.mesh.n_p2
    j_theta = (theta * new.j + (1 - theta) * old.j)[..., None]
    carried = [np.einsum("tqij,tqj->tqi", at.g, at.v - w) for at in (new, old)]
    viscous = [at.viscous(law.viscosity.mu) for at in (new, old)]
    expected = {
        "inertia": assemble(elements, n2, law.density * j_theta * (new.v - old.v) / K),
        "convection": assemble(elements, n2, law.density * (theta * carried[0] + (1 - theta) * carried[1])),
        "viscosity": assemble(elements, n2, flux=theta * viscous[0] + (1 - theta) * viscous[1]),
        "pressure": assemble(elements, n2, flux=-new.p[..., None, None] * (theta * new.cof + (1 - theta) * old.cof)),
        "gravity": assemble(elements, n2, -law.density * j_theta * gravity),
    }
    residual = compute_residual(system, state)
    found = residual.equations["momentum"].terms
    assert found.keys() == {*expected, "outlet"}
    for name, term in expected.items():
        np.testing.assert_allclose(found[name], term, rtol=0, atol=1e-13 * np.abs(term).max(), err_msg=name)
    np.testing.assert_allclose(residual.fluid_force, sum(expected.values()), rtol=0, atol=1e-12)
    outlets = []
    for at in (state, system.increment.old):
        steady = System.build(system.problem, system.mesh)
        outlets.append(compute_residual(steady, at).equations["momentum"].terms["outlet"])
    np.testing.assert_allclose(found["outlet"], theta * outlets[0] + (1 - theta) * outlets[1], rtol=0, atol=1e-15)


@pytest.mark.parametrize("formulation", ["displacement", "mixed", "incompressible"])
def test_terms_of_a_solid_are_the_formulas_of_the_document(formulation):
    lame_lambda, mu, density = 60.0 if formulation != "incompressible" else math.inf, 30.0, 1.5
    solid = Solid(density, NeoHookean(lame_lambda, mu), formulation)
    system, state = random_step(cases.cantilever_problem(solids={2: solid}), channel_mesh(region=2))
    elements, step, n2 = system.solids[2].elements, system.increment.step, system.mesh.n_p2
    new, old = Points(elements, state), Points(elements, system.increment.old)

    def between(stress, old_stress):
        """F_theta (theta S + (1 - theta) S_n) of the first Piola-Kirchhoff stresses at both ends."""
        second, old_second = np.linalg.inv(new.f) @ stress, np.linalg.inv(old.f) @ old_stress
        mean = step.theta * new.f + (1 - step.theta) * old.f
        return mean @ (step.theta * second + (1 - step.theta) * old_second)

    stresses = []
    for at in (new, old):
        stress = mu * (at.f - at.cof / at.j[..., None, None])
        if formulation == "displacement":
            stress = stress + (lame_lambda * np.log(at.j) / at.j)[..., None, None] * at.cof
        stresses.append(stress)
    expected = {
        "stress in region 2": assemble(elements, n2, flux=between(*stresses)),
        "inertia": assemble(elements, n2, density * (new.v - old.v) / K),
        "gravity": assemble(elements, n2, density * np.broadcast_to([0.0, 1.0], new.v.shape)),
    }
    if formulation != "displacement":
        p, p_old = (
            np.einsum("qa,ta->tq", elements.p1, at.ps[0][elements.vertices])[..., None, None]
            for at in (state, system.increment.old)
        )
        flux = between(-p * new.cof, -p_old * old.cof)
        if formulation == "incompressible":
            flux = -p * (step.theta * new.cof + (1 - step.theta) * old.cof)
        expected["pressure in region 2"] = assemble(elements, n2, flux=flux)
    residual = compute_residual(system, state)
    found = residual.equations["momentum"].terms
    assert found.keys() == expected.keys()
    for name, term in expected.items():
        np.testing.assert_allclose(found[name], term, rtol=0, atol=1e-13 * np.abs(term).max(), err_msg=name)
    before = system.increment.old
    left = (state.u - before.u) / K - step.theta * state.v - (1 - step.theta) * before.v
    free = system.mesh.p2_coordinates[:, 0] > 0.0
    largest_velocity = np.hypot(*state.v.T).max()
    assert residual.kinematics == pytest.approx(np.abs(left[free]).max() / largest_velocity, rel=1e-13)


def rotation(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin], [sin, cos]])


STRETCH, OLD_STRETCH = np.array([[1.2, 0.1], [0.1, 0.9]]), np.array([[0.95, -0.2], [-0.2, 1.1]])


def ends(new, old, material):
    """Displacement gradients and first Piola-Kirchhoff stresses, (new, old), of two deformations."""
    gradients = new - np.eye(2), old - np.eye(2)
    return gradients, tuple(material.first_piola(gradient) for gradient in gradients)


def test_stress_of_a_step_does_the_work_that_the_energy_changes_by():
    material = StVenantKirchhoff(60.0, 30.0)
    gradients, stresses = ends(rotation(0.9) @ STRETCH, rotation(0.2) @ OLD_STRETCH, material)
    change = material.energy(gradients[0]) - material.energy(gradients[1])

    def work(stress):
        return (stress * (gradients[0] - gradients[1])).sum()

    midpoint = Step(K, 0.5, 0.3)
    assert work(step_stress(midpoint, gradients, stresses)) == pytest.approx(change, rel=1e-12)
    assert work(midpoint.mean(*stresses)) != pytest.approx(change, rel=1e-2)
    assert work(step_stress(Step(K, 0.6, 0.3), gradients, stresses)) != pytest.approx(change, rel=1e-2)


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("material", [StVenantKirchhoff(60.0, 30.0), NeoHookean(60.0, 30.0)])
def test_stress_of_a_step_that_turns_a_body_turns_with_it(material, theta):
    new, old = (rotation(angle) @ STRETCH for angle in (0.9, 0.2))
    step = Step(K, theta, 0.3)
    second = np.linalg.inv(STRETCH) @ material.first_piola(STRETCH - np.eye(2))
    found = step_stress(step, *ends(new, old, material))
    np.testing.assert_allclose(found, (theta * new + (1 - theta) * old) @ second, rtol=0, atol=1e-13 * 60.0)
    # What a rigid rotation of both ends does to the stress is the rotation.
    turned = step_stress(step, *ends(rotation(0.4) @ new, rotation(0.4) @ old, material))
    np.testing.assert_allclose(turned, rotation(0.4) @ found, rtol=0, atol=1e-13 * 60.0)


def test_inertia_is_the_one_more_term():
    system, state = random_step(cases.roof_problem(), cases.roof_mesh(4))
    found = compute_residual(system, state).equations["momentum"].terms["inertia"]
    old, expected = system.increment.old, np.zeros_like(found)
    for part in (system.fluid, *system.solids.values()):
        new_at, old_at = Points(part.elements, state), Points(part.elements, old)
        factor = part.law.density
        if part is system.fluid:
            factor = factor * (0.7 * new_at.j + 0.3 * old_at.j)[..., None]
        expected += assemble(part.elements, len(found), factor * (new_at.v - old_at.v) / K)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(found).max())
    system, state = random_step(cases.roof_problem(), cases.roof_mesh(4))
    found = compute_residual(system, state).equations
    steady = compute_residual(System.build(system.problem, system.mesh), state).equations
    for name in ("continuity", "mesh_motion", "incompressibility"):
        np.testing.assert_array_equal(found[name].residual, steady[name].residual)


STEP_PROBLEMS = {
    "roof": (cases.roof_problem(), cases.roof_mesh(4)),
    "channel": (channel_problem(), channel_mesh(4, 2)),
    "cantilever": (cases.cantilever_problem(), channel_mesh(4, 2, region=2)),
}


@pytest.mark.parametrize("name", STEP_PROBLEMS)
def test_jacobian_of_a_step_is_the_derivative_of_its_residual(name):
    system, state = random_step(*STEP_PROBLEMS[name])
    cases.assert_jacobian_is_the_derivative(system, state, random_state(system, 8))


def test_solid_alone_has_velocities_and_inflow_its_time():
    mesh = channel_mesh(region=2)
    steady = System.build(cases.cantilever_problem(), mesh)
    rows = steady.stepping(rest(steady), Step(K, THETA, K)).rows
    free = mesh.p2_coordinates[:, 0] > 0.0
    assert steady.rows.v_given.all() and not steady.rows.kinematics.any()
    for found, expected in ((rows.v_given, ~free), (rows.u_given, ~free), (rows.kinematics, free)):
        np.testing.assert_array_equal(found, expected)
    problem, mesh = channel_problem(inflow=flow_in(beating)), channel_mesh()
    system = System.build(problem, mesh)
    inlet = mesh.p2_coordinates[:, 0] == 0.0
    heights = profile(mesh.p2_coordinates[inlet, 1])
    stepping = system.stepping(rest(system), Step(K, THETA, 0.4))
    np.testing.assert_allclose(stepping.rows.prescribed.v[inlet, 0], beating(0.4) * heights, rtol=1e-15)
    np.testing.assert_array_equal(system.rows.prescribed.v[inlet, 0], heights)


@pytest.mark.parametrize("numbers", [
    (0.0, 0.5, 1.0), (-0.1, 0.5, 1.0), (0.1, 0.0, 1.0), (0.1, 1.1, 1.0), (math.nan, 1, 1), (0.1, 1, math.inf),
])  # fmt: skip
def test_numbers_that_are_no_step_are_refused(numbers):
    with pytest.raises(ValueError, match="no time step"):
        Step(*numbers)


@pytest.mark.parametrize(
    "make", [lambda **c: (flap_problem(**c), flap_mesh(4)), lambda **c: (cases.roof_problem(**c), cases.roof_mesh(4))]
)
def test_rest_stays_at_rest(make):
    problem, mesh = make(gravity=(0.0, 0.0), inflow=flow_in(lambda time: 0.0))
    system = System.build(problem, mesh)
    start = rest(system)
    solution = solve_step(system, start, Step(K, THETA, K))
    assert solution.steps == []
    for field in ("u", "v", "p", "ps"):
        assert (getattr(solution.state, field) == 0.0).all()
    report = cases.check_step(problem, mesh, start, start, Step(K, THETA, K), {"drag": 0.0, "lift": 0.0})
    assert report.failures == []


def told(displacement, velocity):
    """Fluid in a box whose mesh and walls move as told, without sources."""
    boundaries = (Boundary("walls", 1, "no-slip"), Boundary("roof", 3, "no-slip"), Boundary("floor", 4, "no-slip"))
    exact = Manufactured(displacement, velocity, lambda system: np.zeros((system.mesh.n_p2, 2)))
    return channel_problem(
        boundaries=(*boundaries, Boundary("outlet", 2, "outlet")), outlet=Outlet("zero-traction"), manufactured=exact
    )


def turned(x, t):
    cos, sin = np.cos(1.3 * t), np.sin(1.3 * t)
    return x @ np.array([[cos - 1.0, sin], [-sin, cos - 1.0]]) + t * np.array([0.4, -0.2])


def rippled(x, t):
    return 0.05 * np.sin(3.0 * x[:, ::-1] + 5.0 * t)


@pytest.mark.parametrize("motion", [turned, rippled])
@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_uniform_flow_stays_uniform_on_a_moving_mesh(motion, theta):
    wind = np.array([0.8, -0.3])
    problem, mesh = told(motion, lambda x, t: np.broadcast_to(wind, x.shape)), channel_mesh()
    system = System.build(problem, mesh)
    states = march(
        system, state_of(mesh, u=lambda x: motion(x, 0.0), v=lambda x: 0 * x + wind), 3, theta=theta, tolerance=1e-8
    )
    assert np.abs(states[-1].u - states[0].u).max() > 0.02
    np.testing.assert_allclose(states[-1].v, np.broadcast_to(wind, states[-1].v.shape), rtol=0, atol=1e-13)
    np.testing.assert_allclose(states[-1].p, 0.0, atol=1e-12)
    report = cases.check_step(problem, mesh, *states[-2:], Step(K, theta, 3 * K), {"drag": 0.0, "lift": 0.0})
    assert report.momentum < 1e-8


def shear(points):
    return np.column_stack([0.9 * points[:, 1], 0.0 * points[:, 1]])


@pytest.mark.parametrize(("k", "shift"), [(1e-5, 0.0), (1e-5, 0.5)])
def test_rounding_of_a_short_step_is_no_residual(k, shift):
    # In uniform flow all terms vanish: what is left of v - v_n, over k, and of grad v, times w, is their last digits.
    mesh, wind = channel_mesh(), np.array([0.8, -0.3])
    rng = np.random.default_rng(3)
    noise = np.spacing(1.0) * rng.choice([-1.0, 0.0, 1.0], size=(2, mesh.n_p2, 2))
    old = state_of(mesh, v=lambda x: wind + noise[0])
    new = state_of(mesh, u=lambda x: 0 * x + shift, v=lambda x: wind + (noise[1] if shift == 0.0 else noise[0]))
    problem = told(lambda x, t: 0 * x, lambda x, t: 0 * x)
    stepping = System.build(problem, mesh).stepping(old, Step(k, 0.5, k))
    assert 1e-12 < compute_residual(stepping, new).relative["momentum"] < 1e-8


def drifting(x, t):
    return 0.0 * x + t * np.array([0.4, -0.2])


def stretched(x, t):
    return np.sin(2.0 * t) * np.column_stack([0.5 * x[:, 1], 0.3 * x[:, 0] + 0.4 * x[:, 1]])


@pytest.mark.parametrize("motion", [drifting, turned, stretched])
@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_shear_flow_stays_on_a_mesh_that_moves(motion, theta, monkeypatch):
    # Steady in space, but at a moving node v changes: the mesh velocity and J_theta make up for it, to the last digit.
    def velocity(x, t):
        return (x + motion(x, t)) @ np.array([[0.0, 0.0], [0.9, 0.0]])

    mesh = channel_mesh(4, 2)
    old, new = (state_of(mesh, u=lambda x, t=t: motion(x, t), v=lambda x, t=t: velocity(x, t)) for t in (0.3, 0.4))
    system = System.build(told(motion, velocity), mesh).stepping(old, Step(K, theta, 0.4))
    inner = np.setdiff1d(np.arange(mesh.n_p2), mesh.edge_nodes)

    def left():
        return np.abs(compute_residual(system, new).equations["momentum"].residual[inner]).max()

    # The viscous stress is the same everywhere: it leaves nothing inside.
    assert left() < 1e-14
    for wrong in ("no mesh velocity", "velocity of the fluid", "J = 1"):
        if (wrong, motion) != ("J = 1", drifting) and (wrong, motion) != ("J = 1", turned):
            monkeypatch.setattr(terms, "fluid_step", WRONG_FLUID[wrong])
            assert left() > 1e-4


def energy(system, state):
    """Kinetic and strain energy of a solid; an incompressible one has W_0 only."""
    part = system.solids[2]
    gradient = terms.gradient_of(state.u[part.elements.nodes], part.elements.gradients)
    material = part.law.material
    stored = material.energy(gradient) if part.law.mixed_material is None else material.base_energy(gradient)
    speed = part.elements.basis @ state.v[part.elements.nodes]
    return ((stored + 0.5 * part.law.density * (speed**2).sum(axis=-1)) * part.elements.weights).sum()


def released(load, theta, solid=None, count=20):
    """Energies of a cantilever, bent by its weight and released, while it swings to the other side."""
    solids = {2: solid or Solid(1.5, StVenantKirchhoff(60.0, 30.0))}
    mesh = channel_mesh(8, 4, region=2)
    start = solve(System.build(cases.cantilever_problem(solids=solids, gravity=(0.0, load)), mesh)).state
    free = System.build(cases.cantilever_problem(solids=solids, gravity=(0.0, 0.0)), mesh)
    states = march(free, start, count, theta=theta, tolerance=1e-9)
    tip = np.argmax(mesh.p2_coordinates.sum(axis=1))
    heights = [state.u[tip, 1] for state in states]
    assert max(heights) > 0.2 * abs(heights[0])
    return np.array([energy(free, state) for state in states])


def test_crank_nicolson_keeps_the_energy_of_a_free_vibration(monkeypatch):
    # Exactly for St. Venant-Kirchhoff; with the mean of the first Piola-Kirchhoff stresses up to the square of u.
    def drift(load):
        energies = released(load, 0.5)
        return np.abs(energies / energies[0] - 1.0).max()

    assert drift(-0.1) < 1e-12
    monkeypatch.setattr(terms, "solid_step", mean_of_first_piola("stress", "displacement"))
    assert drift(-0.1) > 1e-6


def test_other_schemes_take_their_energy_from_a_free_vibration():
    energies = released(-0.01, 1.0)
    assert (np.diff(energies) < 0.0).all() and energies[-1] < 0.6 * energies[0]
    energies = released(-0.01, 0.5 + 0.1 * K)
    assert 0.9 * energies[0] < energies[-1] < 0.999 * energies[0]


def test_pressure_of_an_incompressible_solid_does_no_work(monkeypatch):
    # J is quadratic in F, so p (cof F + cof F_n)/2 does no work in a step that keeps J; p cof F does some. With J = 1
    # the stress of W_0 is linear in C as well, so its work is the change of W_0; J is 1 in the mean only.
    def drift():
        energies = released(-1.0, 0.5, Solid(1.5, NeoHookean(math.inf, 30.0), "incompressible"))
        return np.abs(energies / energies[0] - 1.0).max()

    assert drift() < 1e-5
    monkeypatch.setattr(terms, "solid_step", wrong_pressure("new", "incompressible"))
    assert drift() > 1e-3
