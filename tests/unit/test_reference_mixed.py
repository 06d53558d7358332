"""Solids with a pressure of their own: exact solutions, volume, energies, rows, and several solids in one scene."""

import dataclasses
import math

import numpy as np
import pytest
import test_reference_cases as cases
from scipy.optimize import brentq
from test_reference_cases import HEIGHT, LENGTH

from ffsi.files.arrays import RawState
from ffsi.reference.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve
from ffsi.reference.system import System

MU, LAMBDA = 30.0, 60.0
MIXED = [
    Solid(1.5, NeoHookean(LAMBDA, MU), "mixed"), Solid(1.5, NeoHookean(math.inf, MU), "incompressible"),
    Solid(1.5, MooneyRivlin(6.0, 9.0, 80.0), "mixed"), Solid(1.5, MooneyRivlin(6.0, 9.0, math.inf), "incompressible"),
]  # fmt: skip


def name_of(solid):
    return f"{type(solid.material).__name__}, {solid.formulation}"


solid = pytest.fixture(lambda request: request.param, params=MIXED, ids=name_of)


def cantilever(solid, nx=12, ny=6):
    return System.build(cases.cantilever_problem(solids={2: solid}), cases.channel_mesh(nx, ny, region=2))


def stretched(solid, stretch, lateral, traction, pressure):
    """Solve a block whose left side is held at the width of the homogeneous solution; return the largest errors."""
    mesh = cases.channel_mesh(grading=1.5, region=2)
    system = System.build(cases.loaded_problem(solids={2: solid}, traction=(traction, 0.0)), mesh)
    exact, rows = cases.state_of(mesh, u=lambda x: x * [stretch - 1.0, lateral - 1.0]), system.rows
    prescribed = np.where(rows.u_given[:, None], exact.u, 0.0)
    held = dataclasses.replace(rows, prescribed=dataclasses.replace(rows.prescribed, u=prescribed))
    solution = solve(dataclasses.replace(system, rows=held), tolerance=1e-12)
    assert solution.state.ps.shape == (1, len(mesh.vertices))
    return np.abs(solution.state.u - exact.u).max(), np.abs(solution.state.ps - pressure).max()


def test_blocks_are_stretched_by_the_textbook_traction():
    stretch, solid = 1.4, Solid(0.0, NeoHookean(math.inf, MU), "incompressible")
    traction = MU * (stretch - stretch**-3)  # P11; P22 = 0 makes p = mu (1/l^2 - 1) with F = diag(l, 1/l)
    errors = stretched(solid, stretch, 1.0 / stretch, traction, MU * (stretch**-2 - 1.0))
    assert max(errors) < 1e-10
    # Plane strain: I1 = I2 = l^2 + l^-2 + 1, so both constants act alike: W = (C10 + C01)(I1 - 3), mu = 2 (C10 + C01).
    c10, c01, stretch = 6.0, 9.0, 0.8
    mu = 2.0 * (c10 + c01)
    # p of the split form also carries the deviatoric part of W_0; P22 = 0 determines it.
    solid = Solid(0.0, MooneyRivlin(c10, c01, math.inf), "incompressible")
    base = solid.material.base_stress(np.diag([stretch - 1.0, 1.0 / stretch - 1.0]))
    pressure = base[1, 1] / stretch
    errors = stretched(solid, stretch, 1.0 / stretch, mu * (stretch - stretch**-3), pressure)
    assert max(errors) < 1e-10

    def lateral_stress(b):
        return MU * (b - 1.0 / b) + LAMBDA * np.log(stretch * b) / b

    stretch = 1.4
    lateral = brentq(lateral_stress, 0.5, 1.0, xtol=1e-15)
    traction = MU * (stretch - 1.0 / stretch) + LAMBDA * np.log(stretch * lateral) / stretch
    pressure = -LAMBDA * np.log(stretch * lateral) / (stretch * lateral)
    errors = stretched(Solid(0.0, NeoHookean(LAMBDA, MU), "mixed"), stretch, lateral, traction, pressure)
    assert max(errors) < 1e-10


def test_incompressible_solids_keep_their_area_and_mixed_ones_converge():
    for material in (NeoHookean(math.inf, MU), MooneyRivlin(6.0, 9.0, math.inf)):
        system = cantilever(Solid(1.5, material, "incompressible"))
        state = solve(system, tolerance=1e-12).state
        assert np.abs(state.u).max() > 0.3
        elements = system.solids[2].elements
        deformation = np.eye(2) + np.einsum("tai,tqaj->tqij", state.u[elements.nodes], elements.gradients)
        area = (np.linalg.det(deformation) * elements.weights).sum()
        assert abs(area - LENGTH * HEIGHT) < 1e-10
    # Mooney-Rivlin: the volume equation of the neo-Hookean solid tends to another one, ln J / J = 0 in the mean.
    exact = solve(cantilever(MIXED[3])).state
    for factor in (1e4, 1e6):
        near = solve(cantilever(Solid(1.5, MooneyRivlin(6.0, 9.0, factor * MU), "mixed"))).state
        assert np.abs(near.u - exact.u).max() < 2.0 / factor and np.abs(near.ps - exact.ps).max() < 1e3 / factor
    distances = []
    for n in (4, 8, 16):
        tips = []
        for formulation in ("displacement", "mixed"):
            system = cantilever(Solid(1.5, NeoHookean(LAMBDA, MU), formulation), 2 * n, n)
            state = solve(system).state
            tips.append(state.u[np.argmax(system.mesh.p2_coordinates.sum(axis=1))])
        distances.append(np.linalg.norm(tips[1] - tips[0]) / np.linalg.norm(tips[0]))
    assert distances[0] < 5e-3 and distances[0] > 2 * distances[1] > 4 * distances[2]


def random_state(system, seed):
    rng, mesh = np.random.default_rng(seed), system.mesh
    zero = np.zeros(len(mesh.vertices))
    pressures = rng.normal(size=system.rows.incompressibility.shape) * system.rows.incompressibility
    return RawState(0.005 * rng.normal(size=(mesh.n_p2, 2)), np.zeros((mesh.n_p2, 2)), zero, pressures)


def test_rows_are_the_derivatives_of_the_lagrangian(solid):
    # W_0 - p (J - 1) - p^2 / (2 K) knows no stress. The volume equation of the mixed neo-Hookean solid is none of its
    # derivatives: ln J / J is no function whose integral the law for the momentum would be.
    system = cantilever(solid)
    state, elements, material = random_state(system, 3), system.solids[2].elements, solid.material
    residual = compute_residual(system, state)
    bulk = material.volume_modulus if solid.formulation == "mixed" else math.inf

    def lagrangian(u, p):
        h = np.einsum("tai,tqaj->tqij", u[elements.nodes], elements.gradients)
        f = np.eye(2) + h
        change = f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0] - 1.0
        at = np.einsum("qa,ta->tq", elements.p1, p[elements.vertices])
        weight = solid.density * np.einsum("qa,ta->tq", elements.basis, u[elements.nodes][..., 1])
        return ((material.base_energy(h) - at * change - at**2 / (2 * bulk) + weight) * elements.weights).sum()

    rng, (pressure,) = np.random.default_rng(4), state.ps
    momentum = residual.equations["momentum"].residual
    volume = residual.equations["incompressibility"].residual.ravel()
    for _ in range(3):
        direction = rng.normal(size=state.u.shape)
        expected = lagrangian(state.u + 1e-30j * direction, pressure).imag / 1e-30
        assert (momentum * direction).sum() == pytest.approx(expected, rel=1e-11)
        if solid != MIXED[0]:
            direction = rng.normal(size=pressure.shape)
            expected = -lagrangian(state.u, pressure + 1e-30j * direction).imag / 1e-30
            assert (volume * direction).sum() == pytest.approx(expected, rel=1e-11)


def test_volume_of_the_mixed_neo_hookean_solid_is_the_formula_of_the_document():
    system = cantilever(MIXED[0])
    state, elements = random_state(system, 5), system.solids[2].elements
    f = np.eye(2) + np.einsum("tai,tqaj->tqij", state.u[elements.nodes], elements.gradients)
    jacobian = np.linalg.det(f)
    pressure = np.einsum("qa,ta->tq", elements.p1, state.ps[0][elements.vertices])
    constraint = np.log(jacobian) / jacobian + pressure / LAMBDA
    expected = np.zeros(len(system.mesh.vertices))
    np.add.at(expected, elements.vertices, np.einsum("tq,tq,qa->ta", elements.weights, constraint, elements.p1))
    equation = compute_residual(system, state).equations["incompressibility"]
    assert equation.terms.keys() == {"du_x/dX", "du_y/dY", "rest"}
    np.testing.assert_allclose(equation.residual.ravel(), expected, rtol=0, atol=1e-14 * np.abs(expected).max())


def test_jacobian_is_the_derivative_and_newton_converges_quadratically(solid):
    system = cantilever(solid)
    equation = compute_residual(system, random_state(system, 6)).equations["momentum"]
    assert equation.terms.keys() == {"gravity", "stress in region 2", "pressure in region 2"}
    solids = {2: Solid(2.0, StVenantKirchhoff(60.0, 30.0)), 3: solid}
    system = System.build(cases.roof_problem(solids=solids), cases.roof_mesh(4))
    cases.assert_jacobian_is_the_derivative(system, random_state(system, 7), random_state(system, 8))
    system = System.build(cases.flap_problem(solids={2: dataclasses.replace(solid, density=2.0)}), cases.flap_mesh())
    solution = solve(system, tolerance=1e-10)
    assert solution.steps == [1.0] * 5 and np.abs(solution.state.u).max() > 0.05
    *_, before, last = solution.corrections
    assert np.log(last) / np.log(before) > 1.6
    system = cantilever(solid)
    first = solve(system)
    assert np.abs(first.state.ps).max() > 1.0 and len(solve(system, start=first.state).steps) == 0


def test_solids_without_a_pressure_are_solved_too():
    system = System.build(cases.cantilever_problem(), cases.channel_mesh(region=2))
    assert solve(system).state.ps.shape == (0, len(system.mesh.vertices))
    assert "incompressibility" not in compute_residual(system, cases.state_of(system.mesh)).equations
    solids = {2: Solid(2.0, StVenantKirchhoff(60.0, 30.0)), 3: Solid(1.0, NeoHookean(20.0, 10.0))}
    system = System.build(cases.roof_problem(solids=solids), cases.roof_mesh(4))
    solution = solve(system)
    assert failing(system.problem, system.mesh, solution.state) == set()
    assert {f"stress in region {region}" for region in solids} < solution.residual.equations["momentum"].terms.keys()


@pytest.fixture(scope="module")
def roof():
    problem, mesh = cases.roof_problem(), cases.roof_mesh()
    system = System.build(problem, mesh)
    return problem, mesh, solve(system, tolerance=1e-11).state


def failing(problem, mesh, state):
    report = cases.check_state(problem, mesh, state, {})
    return {text.split(":")[0] for text in report.failures} - {"recomputed", "drag_difference", "lift_difference"}


def test_two_mixed_solids_pass_and_wrong_pressures_are_refused(roof):
    problem, mesh, state = roof
    assert (
        failing(problem, mesh, state) == set() and cases.check_state(problem, mesh, state, {}).incompressibility < 1e-10
    )
    for region in (2, 3):
        assert np.abs(state.u[np.unique(mesh.p2[mesh.region == region])]).max() > 0.02
    for region, pressure in zip((2, 3), state.ps, strict=True):
        inside = np.isin(np.arange(len(mesh.vertices)), mesh.triangles[mesh.region == region])
        assert np.abs(pressure[inside]).max() > 0.1 and (pressure[~inside] == 0.0).all()
    problem, mesh, _ = roof
    rows = System.build(problem, mesh).rows
    for region, row, given in zip((2, 3), rows.incompressibility, rows.ps_given, strict=True):
        inside = np.isin(np.arange(len(mesh.vertices)), mesh.triangles[mesh.region == region])
        np.testing.assert_array_equal(row, inside)
        np.testing.assert_array_equal(given, ~inside)
    assert (rows.prescribed.ps == 0.0).all()
    problem, mesh, state = roof
    for k in (0, 1):
        changed = state.ps.copy()
        changed[k, np.flatnonzero(System.build(problem, mesh).rows.ps_given[k])[3]] = 1e-7 * np.abs(changed).max()
        assert failing(problem, mesh, dataclasses.replace(state, ps=changed)) == {"dirichlet"}
    for k, expected in ((0, {"momentum", "incompressibility"}), (1, {"momentum"})):
        changed = state.ps.copy()
        changed[k, np.abs(changed[k]).argmax()] *= 1.001
        assert failing(problem, mesh, dataclasses.replace(state, ps=changed)) == expected
    first, second = problem.solids[2], problem.solids[3]
    exchanged = dataclasses.replace(problem, solids={2: second, 3: first})
    assert {"momentum", "incompressibility"} <= failing(exchanged, mesh, state)
    backwards = dataclasses.replace(state, ps=state.ps[::-1])
    assert {"momentum", "incompressibility", "dirichlet"} <= failing(problem, mesh, backwards)
    # The order in which the mapping names its regions means nothing.
    assert failing(dataclasses.replace(problem, solids={3: second, 2: first}), mesh, state) == set()


@pytest.mark.parametrize("count", [0, 1, 3])
def test_state_of_another_number_of_mixed_solids_is_an_error(roof, count):
    problem, mesh, state = roof
    changed = dataclasses.replace(state, ps=np.zeros((count, len(mesh.vertices))))
    with pytest.raises(ValueError, match=f"flap: the state has pressures of {count} mixed solids, the problem 2"):
        cases.check_state(problem, mesh, changed, {})
    with pytest.raises(ValueError, match="state of shapes"):
        cases.check_state(problem, mesh, dataclasses.replace(state, ps=np.zeros((2, 5))), {})


@pytest.mark.parametrize(("material", "formulation", "message"), [
    (StVenantKirchhoff(60.0, 30.0), "mixed", "StVenantKirchhoff has no mixed form"),
    (StVenantKirchhoff(60.0, 30.0), "incompressible", "StVenantKirchhoff has no incompressible form"),
    (NeoHookean(60.0, 30.0), "hybrid", "formulation 'hybrid', accepted"),
    (NeoHookean(math.inf, 30.0), "displacement", "no displacement form, its stiffness is infinite"),
    (NeoHookean(math.inf, 30.0), "mixed", "no mixed form, its volume modulus must be finite and not zero"),
    (NeoHookean(0.0, 30.0), "mixed", "no mixed form, its volume modulus must be finite and not zero"),
])  # fmt: skip
def test_formulations_that_a_material_has_not_are_refused(material, formulation, message):
    with pytest.raises(ValueError, match=message):
        Solid(1.0, material, formulation)


def test_what_a_problem_lacks_is_refused():
    with pytest.raises(ValueError, match="a traction but no loaded boundary"):
        cases.cantilever_problem(traction=(0.0, 1.0))
    motion = dataclasses.replace(cases.flap_problem().mesh_motion, distance_exponent=1.0)
    with pytest.raises(ValueError, match="by the distance from the interface, but no interface"):
        cases.channel_problem(mesh_motion=motion)
    boundaries = tuple(b for b in cases.roof_problem().boundaries if b.name != "roof")
    with pytest.raises(ValueError, match="4 edges between fluid and solid are no interface of the problem"):
        System.build(cases.roof_problem(boundaries=(*boundaries, Boundary("roof", 10, "free"))), cases.roof_mesh(4))
