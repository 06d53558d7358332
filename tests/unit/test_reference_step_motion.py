"""What the schemes in time keep: rest, uniform flow on a moving mesh, the energy of a vibration."""

import math

import numpy as np
import pytest
from test_reference_cases import (
    cantilever_problem,
    channel_mesh,
    channel_problem,
    check_step,
    flap_mesh,
    flap_problem,
    flow_in,
    roof_mesh,
    roof_problem,
    state_of,
)
from test_reference_step import THETA, WRONG_FLUID, K, march, mean_of_first_piola, rest, wrong_pressure

from ffsi.reference import terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.materials import NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Manufactured, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System


@pytest.mark.parametrize(
    "make", [lambda **c: (flap_problem(**c), flap_mesh(4)), lambda **c: (roof_problem(**c), roof_mesh(4))]
)
def test_rest_stays_at_rest(make):
    problem, mesh = make(gravity=(0.0, 0.0), inflow=flow_in(lambda time: 0.0))
    system = System.build(problem, mesh)
    start = rest(system)
    solution = solve_step(system, start, Step(K, THETA, K))
    assert solution.steps == []
    for field in ("u", "v", "p", "ps"):
        assert (getattr(solution.state, field) == 0.0).all()
    report = check_step(problem, mesh, start, start, Step(K, THETA, K), {"drag": 0.0, "lift": 0.0})
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
    report = check_step(problem, mesh, *states[-2:], Step(K, theta, 3 * K), {"drag": 0.0, "lift": 0.0})
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
    start = solve(System.build(cantilever_problem(solids=solids, gravity=(0.0, load)), mesh)).state
    free = System.build(cantilever_problem(solids=solids, gravity=(0.0, 0.0)), mesh)
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
