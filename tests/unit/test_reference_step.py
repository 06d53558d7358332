"""Time steps: their terms, what the checker refuses, and what the schemes keep."""

import csv
import dataclasses
import math

import numpy as np
import pytest
import test_reference_cases as cases
from test_reference_cases import HEIGHT, LENGTH, channel_mesh, channel_problem, flap_mesh, flow_in, state_of
from test_reference_check import LIES as STEADY_LIES
from test_reference_check import copy, failing, largest, lied

from ffsi.reference import momentum, terms
from ffsi.reference.forces import compute_forces
from ffsi.reference.problem import Boundary, Fluid
from ffsi.reference.quantities import at_outlet, energies, recompute
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.reference.viscosity import Newtonian

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
    found = recompute(system, state, forces) | at_outlet(system, state)
    return {name: quantity.value for name, quantity in found.items()}


def history_row(step, system, state, before=()):
    """Row of the history: of a step in its system, the row before it given."""
    quantities = quantities_of(system, state)
    names = ("drag", "lift", "flow_rate_out", "outlet_pressure", "tip_ux", "tip_uy", "min_jacobian")
    row = {"time": step.time, "step": step.k} | {name: quantities[name] for name in names if name in quantities}
    sums = {"elastic": 0.0, "dissipated": 0.0} | dict(before)
    row |= {name: quantity.value for name, quantity in energies(system, state, sums).items()}
    return row | {"work": 1.0, "iterations": 3, "factorized": 1, "seconds": 0.1}


def write_history(directory, rows):
    with (directory / "history.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)


def stepped(problem, mesh, count=3):
    """Arguments of ``check_step`` for the last of some steps from rest."""
    system = System.build(problem, mesh)
    *_, old, new = march(system, rest(system), count)
    step = Step(K, THETA, count * K)
    return problem, mesh, old, new, step, quantities_of(system.stepping(old, step), new)


def one_more(arguments):
    """The same for the step that follows."""
    problem, mesh, _, old, last, _ = arguments
    system, step = System.build(problem, mesh), dataclasses.replace(last, time=last.time + last.k)
    new = solve_step(system, old, step, tolerance=1e-11).state
    return problem, mesh, old, new, step, quantities_of(system.stepping(old, step), new)


flap = pytest.fixture(lambda: stepped(cases.flap_problem(inflow=flow_in(beating)), flap_mesh(4)), scope="module")
roof = pytest.fixture(lambda: stepped(cases.roof_problem(inflow=flow_in(beating)), cases.roof_mesh(4)), scope="module")
channel = pytest.fixture(lambda: stepped(channel_problem(inflow=flow_in(beating)), channel_mesh()), scope="module")
cantilever = pytest.fixture(lambda: stepped(cases.cantilever_problem(), channel_mesh(region=2)), scope="module")

CASES_OF_STEPS = ["flap", "roof", "channel", "cantilever"]


@pytest.mark.parametrize("case", CASES_OF_STEPS)
def test_step_passes(case, request):
    arguments = request.getfixturevalue(case)
    report = cases.check_step(*arguments)
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
    report = cases.check_step(problem, mesh, old, new, dataclasses.replace(step, **changes), quantities)
    expected = {"momentum"} if case == "channel" else {"momentum", "kinematics"}
    assert expected <= failing(report) <= expected | {"drag_difference", "lift_difference", "coefficient_difference"}


@pytest.mark.parametrize("case", ["flap", "roof", "channel"])
def test_inflow_of_another_time_is_seen(case, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    report = cases.check_step(problem, mesh, old, new, dataclasses.replace(step, time=step.time - K), quantities)
    assert failing(report) == {"dirichlet"}


@pytest.mark.parametrize("case", CASES_OF_STEPS)
def test_swapped_states_are_seen(case, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    report = cases.check_step(problem, mesh, new, old, step, quantities)
    assert "momentum" in failing(report) and ("kinematics" in failing(report)) == (case != "channel")
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


def end_surface(fluid, gravity, elements, step, new, old, w):
    local = FLUID_STEP(fluid, gravity, elements, step, new, old, w)
    return local | {"pressure": terms.against_gradient(new.pressure_flux, elements)}


WRONG_FLUID = {
    "no mesh velocity": no_mesh_velocity, "velocity of the fluid": other_mesh_velocity,
    "J = 1": with_jacobian(lambda new, old: np.ones_like(new)),
    "J of the new state": with_jacobian(lambda new, old: new),
    "J of the old state": with_jacobian(lambda new, old: old), "implicit convection": implicit("convection"),
    "implicit viscosity": implicit("viscosity"), "implicit gravity": implicit("gravity"),
    "pressure as a mean": mean_pressure, "pressure on the new surface": end_surface,
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG_FLUID)
def test_step_of_a_wrong_fluid_is_refused(wrong, flap, monkeypatch):
    monkeypatch.setattr(terms, "fluid_step", WRONG_FLUID[wrong])
    arguments = one_more(flap)
    assert cases.check_step(*arguments).failures == []
    monkeypatch.undo()
    found = failing(cases.check_step(*arguments))
    assert {"momentum"} <= found <= {"momentum", "drag_difference", "lift_difference", "coefficient_difference"}


def wrong_stress(weight):
    def wrong(solid, gravity, elements, step, new, old, p, old_p):
        return SOLID_STEP(solid, gravity, elements, dataclasses.replace(step, theta=weight), new, old, p, old_p)

    return wrong


def wrong_pressure(surface, formulation):
    """Pressure of the solids of one formulation: on the surface at the end of the step, or the new one in the mean."""

    def wrong(solid, gravity, elements, step, new, old, p, old_p):
        local = SOLID_STEP(solid, gravity, elements, step, new, old, p, old_p)
        if solid.formulation == formulation:
            motions = (new, new) if surface == "new" else (new, old)
            ends = [terms.solid_momentum(solid, gravity, elements, at.u, p)["pressure"] for at in motions]
            local["pressure"] = step.mean(*ends)
        return local

    return wrong


def mean_of_first_piola(name, formulation):
    """One stress of the solids of one formulation as the mean of both ends, which is not objective."""

    def wrong(solid, gravity, elements, step, new, old, p, old_p):
        local = SOLID_STEP(solid, gravity, elements, step, new, old, p, old_p)
        if solid.formulation == formulation:
            ends = [terms.solid_momentum(solid, gravity, elements, *at)[name] for at in ((new.u, p), (old.u, old_p))]
            local[name] = step.mean(*ends)
        return local

    return wrong


def implicit_outlet(system, law, outlet, sides, v):
    return {"outlet": terms.outlet(law.viscosity.outlet, v)}


@pytest.mark.parametrize(("module", "name", "wrong"), [
    (terms, "solid_step", wrong_stress(1.0)), (terms, "solid_step", wrong_stress(0.5)),
    (terms, "solid_step", wrong_pressure("new", "mixed")), (terms, "solid_step", wrong_pressure("mean", "mixed")),
    (terms, "solid_step", wrong_pressure("new", "incompressible")),
    (terms, "solid_step", mean_of_first_piola("pressure", "incompressible")),
    (terms, "solid_step", mean_of_first_piola("pressure", "mixed")),
    (terms, "solid_step", mean_of_first_piola("stress", "mixed")),
    (terms, "solid_step", mean_of_first_piola("stress", "incompressible")), (momentum, "outlet", implicit_outlet),
])  # fmt: skip
def test_step_of_a_wrong_solid_or_outlet_is_refused(module, name, wrong, roof, monkeypatch):
    monkeypatch.setattr(module, name, wrong)
    arguments = one_more(roof)
    assert cases.check_step(*arguments).failures == []
    monkeypatch.undo()
    assert failing(cases.check_step(*arguments)) == {"momentum"}


# A solid's displacement and velocity belong together, too.
LIES = STEADY_LIES | {
    "u in the solid": ("u", "solid", {"momentum", "kinematics"}),
    "u on the interface": ("u", "interface", {"mesh_motion", "momentum", "continuity", "kinematics"}),
    "v in the solid": ("v", "solid", {"momentum", "kinematics"}),
}


@pytest.mark.parametrize("case", ["flap", "roof"])
@pytest.mark.parametrize("lie", LIES)
def test_a_thousandth_of_one_unknown_is_seen(case, lie, request):
    problem, mesh, old, new, step, quantities = request.getfixturevalue(case)
    field, place, expected = LIES[lie]
    changed = lied(problem, mesh, new, field, place)
    assert expected <= failing(cases.check_step(problem, mesh, old, changed, step, quantities))


@pytest.mark.parametrize("field", ["u", "v"])
def test_a_thousandth_of_the_old_state_is_seen(flap, field):
    problem, mesh, old, new, step, quantities = flap
    for region in (1, 2):
        changed = copy(old)
        values = getattr(changed, field)
        inside = np.isin(np.arange(mesh.n_p2), mesh.p2[mesh.region == region])
        free = inside & ~np.isin(np.arange(mesh.n_p2), mesh.p2[mesh.region != region])
        values[largest(values, free)] *= 1.001
        found = failing(cases.check_step(problem, mesh, changed, new, step, quantities))
        assert "momentum" in found and ("kinematics" in found) == (region == 2)


def test_steady_solutions_solve_every_step_within_the_tolerance(roof, flap):
    problem, mesh, old, new, step, quantities = roof  # of two solids: a mixed and an incompressible one
    spoiled = dataclasses.replace(old, p=old.p + 1.0, ps=old.ps + np.array([[0.0], [1.0]]))
    assert cases.check_step(problem, mesh, spoiled, new, step, quantities).failures == []
    spoiled = dataclasses.replace(old, ps=old.ps * np.array([[1.001], [1.0]]))
    assert failing(cases.check_step(problem, mesh, spoiled, new, step, quantities)) == {"momentum"}
    problem, mesh, old, new, step, quantities = flap
    changed = dataclasses.replace(new, p=new.p * (1 + 1e-7))
    report = cases.check_step(problem, mesh, old, changed, step, quantities)
    assert report.tolerance == 1e-8 and "momentum" in failing(report)
    assert cases.check_step(problem, mesh, old, changed, step, quantities, tolerance=1e-5).passed
    other = rest(System.build(problem, flap_mesh(8)))
    for pair in ((other, new), (old, other)):
        with pytest.raises(ValueError, match="state of shapes"):
            cases.check_step(problem, mesh, *pair, step, quantities)
    problem, mesh = cases.flap_problem(inflow=flow_in(beating)), flap_mesh(4)
    system = System.build(problem, mesh)
    solution = solve(system, tolerance=1e-11)
    steady = compute_forces(system, solution.state, solution.residual).total
    for theta in (0.5, 1.0):
        step = Step(0.3, theta, 2 * math.pi / 4.0)  # the factor is one
        stepping = system.stepping(solution.state, step)
        report = cases.check_step(
            problem, mesh, solution.state, solution.state, step, quantities_of(stepping, solution.state)
        )
        assert report.failures == []
        np.testing.assert_allclose(report.forces.total.residual, steady.residual, rtol=1e-12)
        np.testing.assert_allclose(report.forces.total.surface, steady.surface, rtol=1e-12)


def test_forces_in_a_step_are_at_the_time_of_the_scheme(flap):
    problem, mesh, _, new, _, _ = flap
    found = failing(cases.check_step(*flap[:-1], quantities_of(System.build(problem, mesh), new)))
    assert found == {"drag_difference", "lift_difference", "coefficient_difference"}
    # Everything moves at one velocity; the pressure rho a (x - x_0) accelerates it.
    boundaries = tuple(Boundary(name, label, "no-slip", "box") for label, name in enumerate("abcd", start=1))
    problem, mesh = channel_problem(boundaries=boundaries), channel_mesh()
    before, after, moved = np.array([0.3, -0.1]), np.array([0.7, 0.4]), np.array([0.05, 0.01])
    acceleration, system = (after - before) / K, System.build(problem, mesh)
    old = state_of(mesh, v=lambda x: 0 * x + before)
    new = state_of(mesh, u=lambda x: 0 * x + moved, v=lambda x: 0 * x + after, p=lambda x: -1.3 * x @ acceleration)
    stepping = system.stepping(old, Step(K, THETA, K))
    residual = compute_residual(stepping, new)
    inner = np.setdiff1d(np.arange(mesh.n_p2), mesh.edge_nodes)
    np.testing.assert_allclose(residual.equations["momentum"].residual[inner], 0.0, atol=1e-14)
    total = compute_forces(stepping, new, residual).total
    for form in (total.surface, total.residual):
        np.testing.assert_allclose(form, -1.3 * acceleration * LENGTH * HEIGHT, rtol=1e-12)
    # Creeping shear flow has the stress mu b(t), everywhere; in the residual form it is that of the time n + theta,
    # also on the ends of the other sides, which do not cancel: the part is the corner of floor and outlet.
    flows = [dict(v=lambda x, b=b: b * x[:, ::-1] * np.array([1.0, 0.0])) for b in (0.4, 1.0)]
    force, normal = corner_forces(*flows)
    per_slope = -0.05 * normal[::-1]
    np.testing.assert_allclose(force.surface, 1.0 * per_slope, rtol=1e-12)
    np.testing.assert_allclose(force.residual, (THETA * 1.0 + (1 - THETA) * 0.4) * per_slope, rtol=1e-12)
    # A pressure p on a mesh that a linear displacement stretches and turns: all sides carry -p cof F N.
    gradients = [np.array([[0.2, 0.1], [-0.3, 0.1]]), np.array([[-0.1, 0.4], [0.2, 0.3]])]
    old, new = (dict(u=lambda x, g=g: x @ g.T, p=lambda x: 0 * x[:, 0] + 3.0) for g in gradients)
    force, normal = corner_forces(old, new)
    before, after = (np.linalg.det(np.eye(2) + g) * np.linalg.inv(np.eye(2) + g).T @ normal for g in gradients)
    np.testing.assert_allclose(force.surface, 3.0 * after, rtol=1e-12)
    np.testing.assert_allclose(force.residual, 3.0 * (THETA * after + (1 - THETA) * before), rtol=1e-12)


def corner_forces(old, new):
    """Forces at both ends of a step, in creeping flow, on floor and outlet together, and the sum of their N dS."""
    parts = {"outlet": "corner", "floor": "corner"}
    boundaries = tuple(Boundary(b.name, b.label, b.role, parts.get(b.name)) for b in channel_problem().boundaries)
    problem, mesh = channel_problem(fluid=Fluid(0.0, Newtonian(0.05)), boundaries=boundaries), channel_mesh()
    system = System.build(problem, mesh)
    old, new = (state_of(mesh, **fields) for fields in (old, new))
    stepping = system.stepping(old, Step(K, THETA, K))
    return compute_forces(stepping, new, compute_residual(stepping, new)).parts["corner"], np.array([HEIGHT, -LENGTH])
