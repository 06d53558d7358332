"""Time steps: their terms, what the checker refuses, and what the schemes keep."""

import dataclasses
import json
import math

import numpy as np
import pytest
from test_reference_cases import (
    HEIGHT,
    LENGTH,
    cantilever_problem,
    channel_mesh,
    channel_problem,
    flap_mesh,
    flap_problem,
    profile,
    roof_mesh,
    roof_problem,
    state_of,
)
from test_reference_check import copy, failing, largest, scene_mesh

from ffsi.rawfiles import RawState, write_mesh, write_state
from ffsi.reference import momentum, terms
from ffsi.reference.check import check_run, check_step
from ffsi.reference.forces import coefficient_scale, compute_forces
from ffsi.reference.from_scene import problem_from_scene, refuse_other_step
from ffsi.reference.materials import NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Fluid, Manufactured, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import jacobian, residual_vector, solve, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.scene import CASES, with_values

K, THETA = 0.1, 0.6


def beating(time):
    return 1.0 + 0.5 * math.sin(4.0 * time)


def rest(system):
    zero = state_of(system.mesh)
    return dataclasses.replace(zero, ps=np.zeros(system.rows.incompressibility.shape))


def march(system, start, count, k=K, theta=THETA, tolerance=1e-11):
    """States at the times 0, k, 2 k, ..."""
    states = [start]
    for number in range(1, count + 1):
        states.append(solve_step(system, states[-1], Step(k, theta, number * k), tolerance=tolerance).state)
    return states


def quantities_of(system, state):
    forces = compute_forces(system, state, compute_residual(system, state))
    if forces.total is None:
        return {}
    drag, lift = forces.total.residual
    unit = coefficient_scale(system)
    return {"drag": drag, "lift": lift, "drag_coefficient": drag / unit, "lift_coefficient": lift / unit}


def stepped(problem, mesh, count=3):
    """Arguments of ``check_step`` for the last of some steps from rest."""
    system = System.build(problem, mesh)
    *_, old, new = march(system, rest(system), count)
    step = Step(K, THETA, count * K)
    return problem, mesh, old, new, step, quantities_of(system.stepping(old, step), new)


@pytest.fixture(scope="module")
def flap():
    return stepped(flap_problem(inflow_factor=beating), flap_mesh(4))


@pytest.fixture(scope="module")
def roof():
    return stepped(roof_problem(inflow_factor=beating), roof_mesh(4))


@pytest.fixture(scope="module")
def channel():
    return stepped(channel_problem(inflow_factor=beating), channel_mesh())


@pytest.fixture(scope="module")
def cantilever():
    return stepped(cantilever_problem(), channel_mesh(region=2))


CASES_OF_STEPS = ["flap", "roof", "channel", "cantilever"]


# Terms ----------------------------------------------------------------------------------------------------------------


def random_state(system, seed, size=0.006):
    rng, mesh = np.random.default_rng(seed), system.mesh
    shape = (mesh.n_p2, 2)
    u = size * rng.normal(size=shape)
    pressed = system.rows.incompressibility
    p = rng.normal(size=len(mesh.vertices))
    return RawState(u, rng.normal(size=shape), p, rng.normal(size=pressed.shape) * pressed)


def random_step(problem, mesh):
    """System of a step from a random state, and a random state at its end."""
    system = System.build(problem, mesh)
    step = Step(K, 0.7, 0.3)
    return system.stepping(random_state(system, 1), step), random_state(system, 2)


class Points:
    """Fields of a state at the quadrature points, by the formulas of docs/discretisation.md."""

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
    viscous = [at.viscous(law.viscosity) for at in (new, old)]
    expected = {
        "inertia": assemble(elements, n2, law.density * j_theta * (new.v - old.v) / K),
        "convection": assemble(elements, n2, law.density * (theta * carried[0] + (1 - theta) * carried[1])),
        "viscosity": assemble(elements, n2, flux=theta * viscous[0] + (1 - theta) * viscous[1]),
        "pressure": assemble(elements, n2, flux=-new.p[..., None, None] * new.cof),
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


@pytest.mark.parametrize("formulation", ["displacement", "mixed"])
def test_terms_of_a_solid_are_the_formulas_of_the_document(formulation):
    lame_lambda, mu, density = 60.0, 30.0, 1.5
    solid = Solid(density, NeoHookean(lame_lambda, mu), formulation)
    system, state = random_step(cantilever_problem(solids={2: solid}), channel_mesh(region=2))
    elements, step, n2 = system.solids[2].elements, system.increment.step, system.mesh.n_p2
    new, old = Points(elements, state), Points(elements, system.increment.old)
    stresses = []
    for at in (new, old):
        stress = mu * (at.f - at.cof / at.j[..., None, None])
        if formulation == "displacement":
            stress = stress + (lame_lambda * np.log(at.j) / at.j)[..., None, None] * at.cof
        stresses.append(stress)
    expected = {
        "stress in region 2": assemble(elements, n2, flux=step.theta * stresses[0] + (1 - step.theta) * stresses[1]),
        "inertia": assemble(elements, n2, density * (new.v - old.v) / K),
        "gravity": assemble(elements, n2, density * np.broadcast_to([0.0, 1.0], new.v.shape)),
    }
    if formulation == "mixed":
        pressure = np.einsum("qa,ta->tq", elements.p1, state.ps[0][elements.vertices])
        expected["pressure in region 2"] = assemble(elements, n2, flux=-pressure[..., None, None] * new.cof)
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


def test_inertia_is_one_term_of_fluid_and_solids():
    system, state = random_step(roof_problem(), roof_mesh(4))
    found = compute_residual(system, state).equations["momentum"].terms["inertia"]
    old = system.increment.old
    expected = np.zeros_like(found)
    for part in (system.fluid, *system.solids.values()):
        new_at, old_at = Points(part.elements, state), Points(part.elements, old)
        factor = part.law.density
        if part is system.fluid:
            factor = factor * (0.7 * new_at.j + 0.3 * old_at.j)[..., None]
        expected += assemble(part.elements, len(found), factor * (new_at.v - old_at.v) / K)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(found).max())


def test_other_equations_are_those_of_the_new_state():
    system, state = random_step(roof_problem(), roof_mesh(4))
    found = compute_residual(system, state).equations
    steady = compute_residual(System.build(system.problem, system.mesh), state).equations
    for name in ("continuity", "mesh_motion", "incompressibility"):
        np.testing.assert_array_equal(found[name].residual, steady[name].residual)


STEP_PROBLEMS = {
    "roof": (roof_problem(), roof_mesh(4)),
    "channel": (channel_problem(), channel_mesh(4, 2)),
    "cantilever": (cantilever_problem(), channel_mesh(4, 2, region=2)),
}


@pytest.mark.parametrize("name", STEP_PROBLEMS)
def test_jacobian_of_a_step_is_the_derivative_of_its_residual(name):
    system, state = random_step(*STEP_PROBLEMS[name])
    exact, differences = (jacobian(system, state, method) for method in ("complex-step", "divided-difference"))
    np.testing.assert_allclose(differences.toarray(), exact.toarray(), rtol=0, atol=1e-6 * np.abs(exact.data).max())
    change = random_state(system, 8)
    fields = [(getattr(state, field), getattr(change, field)) for field in ("u", "v", "p", "ps")]

    def moved(t):
        new = RawState(*(value + t * direction for value, direction in fields))
        return residual_vector(system, new, compute_residual(system, new))

    expected = (moved(1e-4) - moved(-1e-4)) / 2e-4
    found = exact @ np.concatenate([direction.ravel() for _, direction in fields])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_solid_alone_has_velocities_in_time():
    mesh = channel_mesh(region=2)
    steady = System.build(cantilever_problem(), mesh)
    rows = steady.stepping(rest(steady), Step(K, THETA, K)).rows
    free = mesh.p2_coordinates[:, 0] > 0.0
    assert steady.rows.v_given.all() and not steady.rows.kinematics.any()
    for found, expected in ((rows.v_given, ~free), (rows.u_given, ~free), (rows.kinematics, free)):
        np.testing.assert_array_equal(found, expected)


def test_inflow_is_that_of_the_new_time():
    problem, mesh = channel_problem(inflow_factor=beating), channel_mesh()
    system = System.build(problem, mesh)
    inlet = mesh.p2_coordinates[:, 0] == 0.0
    heights = profile(mesh.p2_coordinates[inlet, 1])
    stepping = system.stepping(rest(system), Step(K, THETA, 0.4))
    np.testing.assert_allclose(stepping.rows.prescribed.v[inlet, 0], beating(0.4) * heights, rtol=1e-15)
    np.testing.assert_array_equal(system.rows.prescribed.v[inlet, 0], heights)


@pytest.mark.parametrize(
    "numbers",
    [(0.0, 0.5, 1.0), (-0.1, 0.5, 1.0), (0.1, 0.0, 1.0), (0.1, 1.1, 1.0), (math.nan, 1, 1), (0.1, 1, math.inf)],
)
def test_numbers_that_are_no_step_are_refused(numbers):
    with pytest.raises(ValueError, match="no time step"):
        Step(*numbers)


def test_state_of_another_mesh_is_an_error(flap):
    problem, mesh, old, new, step, quantities = flap
    other = rest(System.build(problem, flap_mesh(8)))
    for pair in ((other, new), (old, other)):
        with pytest.raises(ValueError, match="state of shapes"):
            check_step(problem, mesh, *pair, step, quantities)


# What the checker accepts and refuses ---------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES_OF_STEPS)
def test_step_passes(case, request):
    arguments = request.getfixturevalue(case)
    report = check_step(*arguments)
    assert report.failures == []
    numbers = {name for name in ("continuity", "kinematics", "mesh_motion", "incompressibility", "drag_difference")}
    absent = {name for name in numbers if getattr(report, name) is None}
    assert (
        absent
        == {
            "flap": {"incompressibility"},
            "roof": set(),
            "channel": {"kinematics", "mesh_motion", "incompressibility"},
            "cantilever": numbers - {"kinematics"},
        }[case]
    )


@pytest.mark.parametrize("case", CASES_OF_STEPS)
@pytest.mark.parametrize(
    "changes", [dict(theta=THETA + 1e-3), dict(theta=THETA - 1e-3), dict(k=K * 1.001), dict(k=K * 0.999)], ids=str
)
def test_wrong_theta_and_wrong_length_are_seen(case, changes, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    report = check_step(problem, mesh, old, new, dataclasses.replace(step, **changes), quantities)
    expected = {"momentum"} if case == "channel" else {"momentum", "kinematics"}
    assert expected <= failing(report) <= expected | {"drag_difference", "lift_difference", "coefficient_difference"}


@pytest.mark.parametrize("case", ["flap", "roof", "channel"])
def test_inflow_of_another_time_is_seen(case, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    report = check_step(problem, mesh, old, new, dataclasses.replace(step, time=step.time - K), quantities)
    assert failing(report) == {"dirichlet"}


@pytest.mark.parametrize("case", CASES_OF_STEPS)
def test_swapped_states_are_seen(case, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    report = check_step(problem, mesh, new, old, step, quantities)
    assert "momentum" in failing(report)
    assert ("kinematics" in failing(report)) == (case != "channel")
    assert ("dirichlet" in failing(report)) == (case != "cantilever")


FLUID_STEP, SOLID_STEP, OUTLET = terms.fluid_step, terms.solid_step, momentum.outlet


def no_mesh_velocity(fluid, gravity, elements, step, new, old, w):
    return FLUID_STEP(fluid, gravity, elements, step, new, old, 0.0 * w)


def other_mesh_velocity(fluid, gravity, elements, step, new, old, w):
    return FLUID_STEP(fluid, gravity, elements, step, new, old, new.velocity)


def with_jacobian(factor):
    """Inertia with another factor than J_theta."""

    def wrong(fluid, gravity, elements, step, new, old, w):
        local = FLUID_STEP(fluid, gravity, elements, step, new, old, w)
        inertia = fluid.density * factor(new.jacobian, old.jacobian)[..., None] * step.rate(new.velocity, old.velocity)
        return local | {"inertia": terms.against_value(inertia, elements)}

    return wrong


def implicit(name):
    """One term of the fluid at the new state only."""

    def wrong(fluid, gravity, elements, step, new, old, w):
        local = FLUID_STEP(fluid, gravity, elements, step, new, old, w)
        return local | {name: FLUID_STEP(fluid, gravity, elements, step, new, new, w)[name]}

    return wrong


def mean_pressure(fluid, gravity, elements, step, new, old, w):
    local = FLUID_STEP(fluid, gravity, elements, step, new, old, w)
    flux = step.mean(new.pressure_flux, old.pressure_flux)
    return local | {"pressure": terms.against_gradient(flux, elements)}


WRONG_FLUID = {
    "no mesh velocity": no_mesh_velocity,
    "velocity of the fluid": other_mesh_velocity,
    "J = 1": with_jacobian(lambda new, old: np.ones_like(new)),
    "J of the new state": with_jacobian(lambda new, old: new),
    "J of the old state": with_jacobian(lambda new, old: old),
    "implicit convection": implicit("convection"),
    "implicit viscosity": implicit("viscosity"),
    "implicit gravity": implicit("gravity"),
    "pressure as a mean": mean_pressure,
}


@pytest.mark.parametrize("wrong", WRONG_FLUID)
def test_step_of_a_wrong_fluid_is_refused(wrong, monkeypatch):
    problem, mesh = flap_problem(inflow_factor=beating), flap_mesh(4)
    monkeypatch.setattr(terms, "fluid_step", WRONG_FLUID[wrong])
    arguments = stepped(problem, mesh)
    assert check_step(*arguments).failures == []
    monkeypatch.undo()
    found = failing(check_step(*arguments))
    assert {"momentum"} <= found <= {"momentum", "drag_difference", "lift_difference", "coefficient_difference"}


def wrong_stress(weight):
    def wrong(solid, gravity, elements, step, new, old, p):
        return SOLID_STEP(solid, gravity, elements, dataclasses.replace(step, theta=weight), new, old, p)

    return wrong


def mean_solid_pressure(solid, gravity, elements, step, new, old, p):
    local = SOLID_STEP(solid, gravity, elements, step, new, old, p)
    if "pressure" in local:
        before = terms.solid_momentum(solid, gravity, elements, old.u, p)["pressure"]
        local["pressure"] = step.mean(local["pressure"], before)
    return local


def implicit_outlet(system, fluid, nodes, v):
    return terms.outlet(fluid.law.viscosity, v)


@pytest.mark.parametrize(
    ("module", "name", "wrong"),
    [
        (terms, "solid_step", wrong_stress(1.0)),
        (terms, "solid_step", wrong_stress(0.5)),
        (terms, "solid_step", mean_solid_pressure),
        (momentum, "outlet", implicit_outlet),
    ],
)
def test_step_of_a_wrong_solid_or_outlet_is_refused(module, name, wrong, monkeypatch):
    monkeypatch.setattr(module, name, wrong)
    arguments = stepped(roof_problem(inflow_factor=beating), roof_mesh(4))
    assert check_step(*arguments).failures == []
    monkeypatch.undo()
    assert failing(check_step(*arguments)) == {"momentum"}


# What is changed by a thousandth of itself (at its largest value), and which checks must see it.
LIES = {
    "u in the solid": ("u", "solid", {"momentum", "kinematics"}),
    "u in the fluid": ("u", "fluid", {"mesh_motion", "momentum", "continuity"}),
    "u on the interface": ("u", "interface", {"mesh_motion", "momentum", "continuity", "kinematics"}),
    "v in the solid": ("v", "solid", {"momentum", "kinematics"}),
    "v in the fluid": ("v", "fluid", {"momentum", "continuity"}),
    "v at the inlet": ("v", "inlet", {"dirichlet"}),
    "p": ("p", "wet", {"momentum"}),
}


@pytest.mark.parametrize("case", ["flap", "roof"])
@pytest.mark.parametrize("lie", LIES)
def test_a_thousandth_of_one_unknown_is_seen(case, lie, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    field, place, expected = LIES[lie]
    rows = System.build(problem, mesh).rows
    solid, fluid = (np.isin(np.arange(mesh.n_p2), mesh.p2[(mesh.region == 1) == wet]) for wet in (False, True))
    places = {
        "solid": solid & ~fluid & ~rows.u_given,
        "fluid": fluid & rows.mesh_motion,
        "interface": solid & fluid & ~rows.u_given,
        "inlet": mesh.p2_coordinates[:, 0] == 0.0,
        "wet": ~rows.p_given,
    }
    changed = copy(new)
    values = getattr(changed, field)
    where = largest(values, places[place])
    assert values[where] != 0.0
    values[where] *= 1.001
    assert expected <= failing(check_step(problem, mesh, old, changed, step, quantities))


@pytest.mark.parametrize("field", ["u", "v"])
def test_a_thousandth_of_the_old_state_is_seen(flap, field):
    problem, mesh, old, new, step, quantities = flap
    for region in (1, 2):
        changed = copy(old)
        values = getattr(changed, field)
        inside = np.isin(np.arange(mesh.n_p2), mesh.p2[mesh.region == region])
        free = inside & ~np.isin(np.arange(mesh.n_p2), mesh.p2[mesh.region != region])
        values[largest(values, free)] *= 1.001
        found = failing(check_step(problem, mesh, changed, new, step, quantities))
        assert "momentum" in found
        assert ("kinematics" in found) == (region == 2)


def test_old_pressure_is_not_used(roof):
    problem, mesh, old, new, step, quantities = roof
    spoiled = dataclasses.replace(old, p=old.p + 1.0, ps=old.ps + 1.0)
    assert check_step(problem, mesh, spoiled, new, step, quantities).failures == []


def test_tolerance_is_that_of_the_caller(flap):
    problem, mesh, old, new, step, quantities = flap
    changed = dataclasses.replace(new, p=new.p * (1 + 1e-7))
    report = check_step(problem, mesh, old, changed, step, quantities)
    assert report.tolerance == 1e-8
    assert "momentum" in failing(report)
    assert check_step(problem, mesh, old, changed, step, quantities, tolerance=1e-5).passed


def test_steady_solution_solves_every_step():
    problem, mesh = flap_problem(inflow_factor=beating), flap_mesh(4)
    system = System.build(problem, mesh)
    solution = solve(system, tolerance=1e-11)
    steady = compute_forces(system, solution.state, solution.residual).total
    for theta in (0.5, 1.0):
        step = Step(0.3, theta, 2 * math.pi / 4.0)  # the factor is one
        stepping = system.stepping(solution.state, step)
        report = check_step(
            problem, mesh, solution.state, solution.state, step, quantities_of(stepping, solution.state)
        )
        assert report.failures == []
        np.testing.assert_allclose(report.forces.total.residual, steady.residual, rtol=1e-12)
        np.testing.assert_allclose(report.forces.total.surface, steady.surface, rtol=1e-12)


# Forces ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["drag", "lift", "drag_coefficient", "lift_coefficient"])
def test_reported_forces_are_checked(flap, name):
    *arguments, quantities = flap
    lied = quantities | {name: quantities[name] * (1 + 2e-8)}
    check = f"{name}_difference" if name in ("drag", "lift") else "coefficient_difference"
    assert failing(check_step(*arguments, lied)) == {check}


def test_forces_of_the_steady_momentum_are_refused(flap):
    problem, mesh, _, new, _, _ = flap
    wrong = quantities_of(System.build(problem, mesh), new)
    assert failing(check_step(*flap[:-1], wrong)) == {"drag_difference", "lift_difference", "coefficient_difference"}


def test_force_on_an_accelerated_box_is_that_of_its_fluid():
    # Everything moves at one velocity; the pressure rho a (x - x_0) accelerates it.
    boundaries = tuple(Boundary(name, label, "no-slip", "box") for label, name in enumerate("abcd", start=1))
    problem, mesh = channel_problem(boundaries=boundaries), channel_mesh()
    before, after, moved = np.array([0.3, -0.1]), np.array([0.7, 0.4]), np.array([0.05, 0.01])
    acceleration = (after - before) / K
    system = System.build(problem, mesh)
    old = state_of(mesh, v=lambda x: 0 * x + before)
    new = state_of(mesh, u=lambda x: 0 * x + moved, v=lambda x: 0 * x + after, p=lambda x: -1.3 * x @ acceleration)
    stepping = system.stepping(old, Step(K, THETA, K))
    residual = compute_residual(stepping, new)
    inner = np.setdiff1d(np.arange(mesh.n_p2), mesh.edge_nodes)
    np.testing.assert_allclose(residual.equations["momentum"].residual[inner], 0.0, atol=1e-14)
    total = compute_forces(stepping, new, residual).total
    for form in (total.surface, total.residual):
        np.testing.assert_allclose(form, -1.3 * acceleration * LENGTH * HEIGHT, rtol=1e-12)


def test_force_in_residual_form_has_the_mean_of_the_viscous_stress():
    # Creeping shear flow has the stress mu b(t), everywhere; in the residual form it is that of the time n + theta,
    # also on the ends of the other sides, which do not cancel: the part is the corner of floor and outlet.
    parts = {"outlet": "corner", "floor": "corner"}
    boundaries = tuple(Boundary(b.name, b.label, b.role, parts.get(b.name)) for b in channel_problem().boundaries)
    problem, mesh = channel_problem(fluid=Fluid(0.0, 0.05), boundaries=boundaries), channel_mesh()
    system = System.build(problem, mesh)
    old, new = (state_of(mesh, v=lambda x, b=b: b * x[:, ::-1] * np.array([1.0, 0.0])) for b in (0.4, 1.0))
    stepping = system.stepping(old, Step(K, THETA, K))
    force = compute_forces(stepping, new, compute_residual(stepping, new)).parts["corner"]
    per_slope = 0.05 * np.array([LENGTH, -HEIGHT])
    np.testing.assert_allclose(force.surface, 1.0 * per_slope, rtol=1e-12)
    np.testing.assert_allclose(force.residual, (THETA * 1.0 + (1 - THETA) * 0.4) * per_slope, rtol=1e-12)


# What the schemes keep ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make", [lambda **c: (flap_problem(**c), flap_mesh(4)), lambda **c: (roof_problem(**c), roof_mesh(4))]
)
def test_rest_stays_at_rest(make):
    problem, mesh = make(gravity=(0.0, 0.0), inflow_factor=lambda time: 0.0)
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
    nothing = {1: lambda x, t: np.zeros_like(x)}
    exact = Manufactured(displacement, velocity, nothing, {1: lambda x, t: np.zeros((len(x), 2, 2))})
    return channel_problem(
        boundaries=(*boundaries, Boundary("outlet", 2, "outlet")), outlet="zero-traction", manufactured=exact
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


def test_crank_nicolson_keeps_the_energy_of_a_free_vibration():
    # Exactly where the stress is linear in the strain; otherwise up to the square of the strain.
    drifts = [np.abs(energies / energies[0] - 1.0).max() for energies in (released(-0.1, 0.5), released(-0.01, 0.5))]
    assert drifts[1] < 1e-6
    assert drifts[0] / drifts[1] == pytest.approx(100.0, rel=0.1)


def test_backward_euler_takes_energy_from_a_free_vibration():
    energies = released(-0.01, 1.0)
    assert (np.diff(energies) < 0.0).all()
    assert energies[-1] < 0.6 * energies[0]


def test_shifted_crank_nicolson_takes_little_energy():
    energies = released(-0.01, 0.5 + 0.1 * K)
    assert 0.9 * energies[0] < energies[-1] < 0.999 * energies[0]


@pytest.mark.parametrize(("pressure_term", "least", "most"), [(SOLID_STEP, 1e-3, 1e-2), (mean_solid_pressure, 0, 1e-6)])
def test_implicit_pressure_of_an_incompressible_solid_works_as_documented(pressure_term, least, most, monkeypatch):
    # J is quadratic in F, so p (cof F + cof F_n)/2 does no work in a step that keeps J; p cof F does some.
    monkeypatch.setattr(terms, "solid_step", pressure_term)
    energies = released(-1.0, 0.5, Solid(1.5, NeoHookean(math.inf, 30.0), "incompressible"))
    assert least <= np.abs(energies / energies[0] - 1.0).max() <= most


# Run folders ----------------------------------------------------------------------------------------------------------

CHANGES = {
    "inflow.mean_velocity": 0.05,
    "solid.flap.lame_lambda": 800.0,
    "solid.flap.lame_mu": 200.0,
    "mesh_motion.kind": "harmonic",
    "time.step": 0.05,
    "time.end": 0.18,
    "inflow.ramp": 0.12,
}


@pytest.fixture(scope="module")
def solved_run():
    """Scene in time, its mesh, states by the number of the step, and the entries of two checked steps."""
    scene = with_values(CASES["flap-svk"], CHANGES)
    mesh = scene_mesh(scene)
    system = System.build(problem_from_scene(scene), mesh)
    states, time, entries = [rest(system)], 0.0, []
    for number, k in enumerate((0.05, 0.05, 0.05, 0.03), start=1):
        time += k
        step, old = Step(k, 0.5 + k, time), states[-1]
        states.append(solve_step(system, old, step, tolerance=1e-11).state)
        if number in (2, 4):
            entry = {"step": number, "time": time, "k": k, "theta": step.theta}
            entry |= {"old": f"state-{number - 1:06d}.bin", "new": f"state-{number:06d}.bin"}
            entries.append(entry | {"quantities": quantities_of(system.stepping(old, step), states[-1])})
    return scene, mesh, states, entries


@pytest.fixture
def run(tmp_path, solved_run):
    """Run folder, its scene, and a copy of the entries of its list."""
    scene, mesh, states, entries = solved_run
    write_mesh(tmp_path / "mesh.bin", mesh)
    for number, state in enumerate(states[1:], start=1):
        write_state(tmp_path / f"state-{number:06d}.bin", state)
    values = {key: value for key, value in CHANGES.items() if not isinstance(value, str)}
    (tmp_path / "point-0001.json").write_text(json.dumps({"parameters": values}))
    rewrite(tmp_path, entries)
    return tmp_path, scene, [entry | {"quantities": dict(entry["quantities"])} for entry in entries]


def rewrite(directory, entries):
    (directory / "steps.json").write_text(json.dumps(entries))


def test_run_folder_of_steps_is_checked(run):
    directory, scene, entries = run
    report = check_run(directory, scene)
    assert report.failures == []
    assert report.kinematics is not None
    assert report.forces.total.residual[0] == entries[1]["quantities"]["drag"]
    for name in ("drag_coefficient", "lift_coefficient"):  # not every step needs them
        del entries[0]["quantities"][name]
    rewrite(directory, entries)
    report = check_run(directory, scene)
    assert report.passed
    assert report.coefficient_difference < 1e-12


def test_worst_step_counts(run):
    directory, scene, entries = run
    drag = entries[0]["quantities"]["drag"]
    entries[0]["quantities"]["drag"] *= 1.0 + 1e-6
    entries[1]["quantities"]["drag"] *= 1.0 + 1e-7
    rewrite(directory, entries)
    report = check_run(directory, scene)
    assert report.drag_difference == pytest.approx(1e-6, rel=1e-3)
    assert failing(report) == {"drag_difference"}
    first, second = report.failures
    assert " in step 2 at 0.1 s, allowed is 1e-08" in first
    assert second.startswith(f"recomputed: drag {drag:.12g} N/m") and second.endswith(" in step 2 at 0.1 s")
    del entries[1]["quantities"]["drag"]
    rewrite(directory, entries)
    assert " is inf in step 4 at 0.18 s" in check_run(directory, scene).failures[0]


def test_number_that_is_none_in_one_step_fails(run):
    directory, scene, entries = run
    entries[1]["quantities"]["lift"] = math.nan
    rewrite(directory, entries)
    report = check_run(directory, scene)
    assert failing(report) == {"lift_difference"}
    assert "is nan in step 4 at 0.18 s" in report.failures[0]


def test_inverted_triangle_in_one_step_fails(run, solved_run):
    directory, scene, entries = run
    _, mesh, states, _ = solved_run
    for entry in entries:
        changed = copy(states[entry["step"]])
        changed.u[largest(mesh.p2_coordinates, System.build(problem_from_scene(scene), mesh).rows.mesh_motion)[0]] += (
            1.0
        )
        write_state(directory / entry["new"], changed)
        report = check_run(directory, scene)
        assert report.min_jacobian < 0.0
        (text,) = (text for text in report.failures if text.startswith("min_jacobian: "))
        assert f" in step {entry['step']} at " in text
        write_state(directory / entry["new"], states[entry["step"]])


def test_exchanged_files_are_seen(run):
    directory, scene, entries = run
    entries[0]["old"], entries[1]["old"] = entries[1]["old"], entries[0]["old"]
    rewrite(directory, entries)
    assert {"momentum", "kinematics"} <= failing(check_run(directory, scene))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(k=0.051, theta=0.551), r"k = 0\.051 s, at most 0\.05 s"),
        (dict(theta=0.5), r"theta = 0\.5, expected 0\.55"),
        (dict(theta=1.0), r"theta = 1\.0, expected 0\.55"),
        (dict(time=0.04), r"its start is at -0\.01\d* s"),
        (dict(time=0.19), r"its end is at 0\.19 s, the last at 0\.18 s"),
        (dict(k=0.0), "no time step: k = 0.0 s"),
    ],
    ids=str,
)
def test_step_that_the_scene_does_not_have_is_refused(run, changes, message):
    directory, scene, entries = run
    rewrite(directory, [entries[0] | changes])
    with pytest.raises(ValueError, match=message):
        check_run(directory, scene)


def test_run_with_other_parameters_than_the_scene_is_refused(run):
    directory, scene, _ = run
    other = with_values(scene, {"inflow.ramp": 0.13})
    with pytest.raises(ValueError, match=r"the run used inflow\.ramp = 0\.12 but the scene says 0\.13"):
        check_run(directory, other)


def test_run_without_checked_steps_is_refused(run):
    directory, scene, entries = run
    rewrite(directory, [])
    with pytest.raises(ValueError, match=r"steps\.json: no step is listed"):
        check_run(directory, scene)
    rewrite(directory, [{key: value for key, value in entries[0].items() if key not in ("k", "old")}])
    with pytest.raises(ValueError, match=r"steps\.json: an entry without k, old"):
        check_run(directory, scene)
    (directory / "steps.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"steps\.json"):
        check_run(directory, scene)


def test_missing_state_of_a_step_is_an_error(run):
    directory, scene, entries = run
    (directory / entries[1]["old"]).unlink()
    with pytest.raises(FileNotFoundError, match=r"state-000003\.bin"):
        check_run(directory, scene)


@pytest.mark.parametrize(
    ("scheme", "theta"), [("backward-euler", 1.0), ("crank-nicolson", 0.5), ("shifted-crank-nicolson", 0.54)]
)
def test_theta_of_the_schemes(scheme, theta):
    changes = {"mesh_motion.kind": "harmonic", "time.step": 0.02, "time.end": 1.0, "time.shift": 2.0}
    scene = with_values(CASES["flap-svk"], changes | {"time.scheme": scheme})
    refuse_other_step(scene, Step(0.02, theta, 0.5))
    with pytest.raises(ValueError, match=r"theta = .*, expected"):
        refuse_other_step(scene, Step(0.02, theta - 1e-6, 0.5))


def test_steady_scene_has_no_steps():
    with pytest.raises(ValueError, match="flap-svk: a time step, but the scene is steady"):
        refuse_other_step(CASES["flap-svk"], Step(0.1, 0.5, 0.5))
