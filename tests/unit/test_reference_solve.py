"""Newton's method from scratch: its Jacobian, exact flows, quadratic convergence, and what it refuses."""

import dataclasses

import numpy as np
import pytest
from structured import structured_mesh
from test_reference_cases import (
    HEIGHT,
    LENGTH,
    MEAN_VELOCITY,
    assert_jacobian_is_the_derivative,
    bump_mesh,
    bump_problem,
    cantilever_problem,
    channel_mesh,
    channel_problem,
    flap_mesh,
    flap_problem,
    loaded_problem,
    profile,
    state_of,
)

from ffsi.files.arrays import RawState
from ffsi.reference.conditions import Outlet
from ffsi.reference.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, MeshMotion, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import ConvergenceError, damped_step, solve
from ffsi.reference.system import System

# The counts that exact Newton achieves: a wrong Jacobian needs more.
POISEUILLE_ITERATIONS = 4
FLAP_ITERATIONS = 5
BUMP_ITERATIONS = 4
CANTILEVER_ITERATIONS = 6

KINDS = ["harmonic", "linear-elastic", "hyperelastic"]


@pytest.fixture(scope="module", params=KINDS)
def random_flap(request):
    mesh, rng = flap_mesh(4), np.random.default_rng(4)
    state = RawState(
        u=0.005 * rng.normal(size=(mesh.n_p2, 2)),
        v=rng.normal(size=(mesh.n_p2, 2)),
        p=rng.normal(size=len(mesh.vertices)),
    )
    system = System.build(flap_problem(mesh_motion=MeshMotion(1.5, 0.6, request.param, 0.8)), mesh)
    assert compute_residual(system, state).min_jacobian > 0.1
    return system, state


def test_jacobian_is_the_derivative_and_poiseuille_flow_exact(random_flap):
    system, state = random_flap
    rng = np.random.default_rng(5)
    change = RawState(*(rng.normal(size=field.shape) for field in state.fields))
    assert_jacobian_is_the_derivative(system, state, change, 1e-6, 1e-7)
    mesh = channel_mesh()
    # The continuity's terms vanish in this flow, which leaves rounding of about 1e-10 of its scale.
    solution = solve(System.build(channel_problem(), mesh), tolerance=1e-9)
    x, y = mesh.p2_coordinates.T
    drop = 12.0 * 0.05 * MEAN_VELOCITY / HEIGHT**2
    np.testing.assert_allclose(solution.state.v, np.column_stack([profile(y), 0 * x]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(solution.state.p, drop * (LENGTH - mesh.vertices[:, 0]), rtol=0, atol=1e-12)
    assert (solution.state.u == 0.0).all() and len(solution.steps) == POISEUILLE_ITERATIONS
    solution = solve(System.build(channel_problem(outlet=Outlet("zero-traction")), mesh))
    assert np.abs(solution.state.v[:, 1]).max() > 1e-2 * MEAN_VELOCITY
    solution = solve(System.build(bump_problem(), bump_mesh()))
    assert len(solution.steps) == BUMP_ITERATIONS and solution.residual.relative.keys() == {"momentum", "continuity"}


@pytest.mark.parametrize("kind", KINDS)
def test_flap_converges_quadratically(kind):
    problem = flap_problem(mesh_motion=MeshMotion(1.0, 1.0, kind, 0.5))
    solution = solve(System.build(problem, flap_mesh()), tolerance=1e-10)
    assert len(solution.steps) == FLAP_ITERATIONS and solution.steps == [1.0] * FLAP_ITERATIONS
    assert np.abs(solution.state.u).max() > 0.05
    # Quadratic: the digits double. 2.5 leaves room for the constant; a wrong Jacobian gives a factor of 1.
    *_, before, last = solution.corrections
    assert np.log(last) / np.log(before) > 1.6
    assert solution.residuals[-1] < 1e-10 < 1e-6 < solution.residuals[-2]


# The first two have the Lame constants 60 and 30 at rest; the last one hardly changes its volume.
@pytest.mark.parametrize(("material", "iterations"), [
    (NeoHookean(60.0, 30.0), FLAP_ITERATIONS),
    (MooneyRivlin(6.0, 9.0, 80.0), FLAP_ITERATIONS),
    (MooneyRivlin(6.0, 9.0, 800.0), FLAP_ITERATIONS + 1),
], ids=str)  # fmt: skip
def test_hyperelastic_flap_converges_quadratically(material, iterations):
    system = System.build(flap_problem(solids={2: Solid(2.0, material)}), flap_mesh())
    solution = solve(system, tolerance=1e-10)
    assert solution.steps == [1.0] * iterations and np.abs(solution.state.u).max() > 0.05
    *_, before, last = solution.corrections
    assert np.log(last) / np.log(before) > 1.6
    assert solution.residuals[-1] < 1e-10 < 1e-8 < solution.residuals[-2]


@pytest.mark.parametrize("material", [NeoHookean(60.0, 30.0), MooneyRivlin(6.0, 9.0, 80.0)], ids=str)
def test_jacobian_of_hyperelastic_solids_is_the_derivative(material):
    system = System.build(cantilever_problem(solids={2: Solid(1.5, material)}), channel_mesh(region=2))
    state, rng = state_of(system.mesh), np.random.default_rng(6)
    state.u[:] = 0.01 * rng.normal(size=state.u.shape)
    change = RawState(*(rng.normal(size=field.shape) for field in state.fields))
    assert_jacobian_is_the_derivative(system, state, change, 1e-6, 1e-7)


def test_sagging_cantilever_makes_its_potential_energy_stationary():
    # The energy knows nothing of the stress formula: its derivative by a complex step, in random directions.
    mesh, problem = channel_mesh(nx=12, region=2), cantilever_problem()
    system = System.build(problem, mesh)
    solution = solve(system)
    assert len(solution.steps) == CANTILEVER_ITERATIONS and np.abs(solution.state.u).max() > 0.1
    part = system.solids[2]

    def potential(u):
        local = u[part.elements.nodes]
        gradient = np.einsum("tai,tqaj->tqij", local, part.elements.gradients)
        stored = (part.law.material.energy(gradient) * part.elements.weights).sum()
        height = np.einsum("qa,ta->tq", part.elements.basis, local[..., 1])
        return stored + part.law.density * (height * part.elements.weights).sum()

    for seed in range(5):
        direction = np.random.default_rng(seed).normal(size=solution.state.u.shape)
        direction[system.rows.u_given] = 0.0
        at_solution = potential(solution.state.u + 1e-30j * direction).imag / 1e-30
        at_rest = potential(1e-30j * direction).imag / 1e-30
        assert abs(at_solution) < 1e-9 * abs(at_rest)


def test_loaded_cantilever_makes_its_potential_energy_stationary():
    mesh, load = channel_mesh(nx=12, region=2), np.array([1.5, -0.8])
    system = System.build(loaded_problem(), mesh)
    state = solve(system).state
    assert np.abs(state.u).max() > 0.1
    part = system.solids[2]
    # The load's work on the tip by Simpson's rule, edge by edge.
    tip = mesh.edge_nodes[mesh.label == 2]
    length = np.hypot(*np.diff(mesh.vertices[mesh.edges[mesh.label == 2]], axis=1)[:, 0].T)

    def potential(u):
        gradient = np.einsum("tai,tqaj->tqij", u[part.elements.nodes], part.elements.gradients)
        stored = (part.law.material.energy(gradient) * part.elements.weights).sum()
        return stored - (length[:, None] * ((u @ load)[tip] @ np.diag([1.0, 1.0, 4.0])) / 6.0).sum()

    for seed in range(3):
        direction = np.random.default_rng(seed).normal(size=state.u.shape)
        direction[system.rows.u_given] = 0.0
        at_solution = potential(state.u + 1e-30j * direction).imag / 1e-30
        at_rest = potential(1e-30j * direction).imag / 1e-30
        assert abs(at_solution) < 1e-9 * abs(at_rest)


def test_slender_cantilever_follows_the_elastica():
    # Plane strain: E / (1 - nu^2) h^3 / 12 is the bending stiffness. Mattiasson (1981) for P L^2 / (E I) = 1.
    young, nu, thickness = 109200.0, 0.3, 0.01
    material = StVenantKirchhoff(young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu)))
    load = young / (1 - nu**2) * thickness**3 / 12 / thickness
    boundaries = (Boundary("root", 6, "clamped"), Boundary("sides", 7, "free"), Boundary("tip", 12, "loaded"))
    mesh = structured_mesh(
        np.linspace(0, 1, 51), np.linspace(0, thickness, 3), lambda x, y: 2, lambda x, y: {0.0: 6, 1.0: 12}.get(x, 7)
    )
    problem = loaded_problem(boundaries=boundaries, solids={2: Solid(0.0, material)}, traction=(0.0, load))
    solution = solve(System.build(problem, mesh), tolerance=1e-8)
    tip = np.argmin(np.abs(mesh.p2_coordinates - [1.0, thickness / 2]).sum(axis=1))
    # This coarse mesh is a little too stiff: the differences halve with the element size.
    np.testing.assert_allclose(solution.state.u[tip], [-0.05643, 0.30172], rtol=5e-3)


def test_inverting_steps_and_too_few_iterations_are_refused():
    soft = {2: Solid(2.0, StVenantKirchhoff(4.0, 2.0))}
    with pytest.raises(ConvergenceError, match=r"every step turns a triangle inside out|not converged"):
        solve(System.build(flap_problem(solids=soft), flap_mesh()))
    system = System.build(cantilever_problem(), channel_mesh(region=2))
    rest = state_of(system.mesh)
    squeeze = state_of(system.mesh, u=lambda x: -2.5 * x * np.array([1.0, 0.0]))
    state, residual, step = damped_step(system, rest, squeeze)
    assert step == 0.25
    np.testing.assert_array_equal(state.u, 0.25 * squeeze.u)
    assert residual.min_jacobian == pytest.approx(1.0 - 2.5 / 4, rel=1e-13)
    with pytest.raises(ConvergenceError, match="every step turns a triangle inside out"):
        damped_step(system, rest, RawState(1e4 * squeeze.u, squeeze.v, squeeze.p))
    with pytest.raises(ConvergenceError, match=r"flap: not converged, relative residuals \[.*, .*\]"):
        solve(System.build(flap_problem(), flap_mesh(4)), max_iterations=2)
    loose = tuple(dataclasses.replace(b, role="free") for b in cantilever_problem().boundaries)
    assert loose[0] == Boundary("root", 1, "free")
    with pytest.raises(ConvergenceError):
        solve(System.build(cantilever_problem(boundaries=loose), channel_mesh(region=2)))


@pytest.mark.parametrize("kind", KINDS)
def test_start_with_an_inverted_triangle_is_an_error(kind):
    system = System.build(flap_problem(mesh_motion=MeshMotion(1.0, 1.0, kind)), flap_mesh(4))
    start = state_of(system.mesh)
    start.u[np.flatnonzero(system.rows.mesh_motion)[0]] += 1.0
    with pytest.raises(ConvergenceError, match="the start turns a triangle inside out"):
        solve(system, start=start)


def test_starts_that_help_and_steps_that_invert():
    system = System.build(flap_problem(mesh_motion=MeshMotion(1.0, 1.0, "hyperelastic")), flap_mesh(4))
    squeeze = state_of(system.mesh, u=lambda x: -2.5 * x * np.array([1.0, 0.0]))
    _, residual, step = damped_step(system, state_of(system.mesh), squeeze)
    assert step == 0.25 and residual.min_jacobian == pytest.approx(1.0 - 2.5 / 4, rel=1e-13)
    assert np.isfinite(max(residual.relative.values()))
    system = System.build(flap_problem(), flap_mesh(4))
    first = solve(system)
    neighbour = System.build(flap_problem(gravity=(0.01, -0.051)), system.mesh)
    again = solve(neighbour, start=first.state)
    assert len(again.steps) == 2 < len(first.steps) and np.abs(again.state.u - first.state.u).max() > 1e-6
    spoiled = RawState(first.state.u + 1e-3, first.state.v + 1e-3, first.state.p)
    np.testing.assert_allclose(solve(system, start=spoiled).state.u, first.state.u, rtol=0, atol=1e-11)
