"""Inlets, outlets with a pressure, backflow and supports: exact solutions, Jacobians, and what the checker refuses."""

import dataclasses
import math

import numpy as np
import pytest
import test_reference_cases as cases
from scipy.integrate import quad
from test_reference_cases import HEIGHT, LENGTH, MEAN_VELOCITY
from test_reference_check import failing
from test_reference_step import K, beating, quantities_of, rest
from test_reference_step_terms import random_step

from ffsi.files.arrays import RawState
from ffsi.reference import terms
from ffsi.reference.conditions import Inflow, Outlet, Series, Support, womersley
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.materials import StVenantKirchhoff
from ffsi.reference.problem import Boundary, Fluid, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.reference.viscosity import Newtonian
from ffsi.scene import CASES, with_values

VISCOSITY = 0.05
FLOW = MEAN_VELOCITY * HEIGHT
SLOPE = 12.0 * VISCOSITY * MEAN_VELOCITY / HEIGHT**2  # of the pressure of plane Poiseuille flow
WINDKESSEL = Outlet("windkessel", 0.4, resistance=1.5, distal=4.0, compliance=0.07)


@pytest.mark.parametrize(("start", "inward", "label"), [
    ((0, 0), (1, 0), 1), ((LENGTH, HEIGHT), (-1, 0), 2), ((LENGTH, 0), (0, 1), 4), ((0, HEIGHT), (0, -1), 3),
])  # fmt: skip
def test_inlet_of_any_direction(start, inward, label):
    # An unsymmetric profile tells both ends of the inlet from each other.
    mesh = cases.channel_mesh()
    boundaries = tuple(
        Boundary(str(number), number, "inlet" if number == label else "no-slip") for number in (1, 2, 3, 4)
    )
    inflow = Inflow(lambda s, time: (1.0 + time) * (s + s**2), start, inward)
    problem = cases.channel_problem(boundaries=boundaries, inflow=inflow)
    system, nodes = System.build(problem, mesh), np.unique(mesh.edge_nodes[mesh.label == label])
    along = np.abs(mesh.p2_coordinates[nodes] - np.array(start)).sum(axis=1)  # both axes: one difference is zero
    ends = along == along.max()
    expected = ((along + along**2) * ~ends)[:, None] * np.array(inward)  # a wall wins at a common node
    np.testing.assert_allclose(system.rows.prescribed.v[nodes], expected, rtol=0, atol=1e-14)
    later = system.stepping(rest(system), Step(K, 0.5, 0.7)).rows.prescribed.v[nodes]
    np.testing.assert_allclose(later, 1.7 * expected, rtol=0, atol=1e-14)


def poiseuille_system(outlet, factor=None, density=1.3, mesh=None):
    problem = cases.channel_problem(
        fluid=Fluid(density, Newtonian(VISCOSITY)), outlet=outlet, inflow=cases.flow_in(factor)
    )
    return System.build(problem, mesh or cases.channel_mesh())


@pytest.mark.parametrize(("outlet", "pressure"), [
    (Outlet("pressure", 0.7), 0.7),
    (Outlet("pressure", 0.7, backflow=0.5), 0.7),  # nothing comes back
    (Outlet("resistance", 0.7, resistance=2.0), 0.7 + 2.0 * FLOW),
    (WINDKESSEL, 0.4 + 5.5 * FLOW),
])  # fmt: skip
def test_steady_pressure_at_the_outlet(outlet, pressure):
    system = poiseuille_system(outlet)
    solution, nodes = solve(system, tolerance=1e-9), system.mesh.p2_coordinates
    np.testing.assert_allclose(solution.state.v[:, 0], cases.profile(nodes[:, 1]), rtol=0, atol=1e-8)
    np.testing.assert_allclose(solution.state.p, pressure + SLOPE * (LENGTH - system.mesh.vertices[:, 0]), rtol=1e-7)
    quantities = quantities_of(system, solution.state)
    assert quantities["flow_rate_out"] == pytest.approx(FLOW, rel=1e-8)
    assert quantities["outlet_pressure"] == pytest.approx(pressure, rel=1e-8)
    assert cases.check_state(system.problem, system.mesh, solution.state, quantities).failures == []
    for name, value in quantities.items():
        if name in ("flow_rate_out", "outlet_pressure"):
            for lied in (quantities | {name: value * (1 + 2e-8)}, {k: v for k, v in quantities.items() if k != name}):
                report = cases.check_state(system.problem, system.mesh, solution.state, lied)
                assert failing(report) == {"outlet_difference"}


OUTLETS = [
    Outlet("do-nothing", hydrostatic=True), Outlet("zero-traction", hydrostatic=True),
    Outlet("pressure", 0.7, hydrostatic=True), Outlet("resistance", 0.7, resistance=2.0, hydrostatic=True),
    dataclasses.replace(WINDKESSEL, hydrostatic=True),
]  # fmt: skip


@pytest.mark.parametrize("outlet", OUTLETS, ids=lambda outlet: outlet.kind)
@pytest.mark.parametrize("gravity", [(0.0, -9.0), (0.0, 9.0), (3.0, -9.0)])
def test_fluid_rests_before_a_hydrostatic_outlet(outlet, gravity):
    mesh, fluid = cases.channel_mesh(), Fluid(1.3, Newtonian(VISCOSITY))
    still = Inflow(lambda s, time: 0.0 * s)
    problem = cases.channel_problem(fluid=fluid, outlet=outlet, inflow=still, gravity=gravity)
    top = np.array([LENGTH, HEIGHT if gravity[1] < 0 else 0.0])  # of the outlet, against gravity
    level = outlet.pressure
    state = cases.state_of(mesh, p=lambda x: level + 1.3 * ((x - top) @ np.array(gravity)))
    system = System.build(problem, mesh)
    for each in (system, system.stepping(state, Step(K, 0.6, K), level)):
        found = compute_residual(each, state).relative
        assert found["momentum"] < 1e-13 and found["continuity"] == 0.0
    assert max(solve(system, tolerance=1e-9).state.v.ravel()) < 1e-12
    for wrong in (
        dict(outlet=dataclasses.replace(outlet, hydrostatic=False)),
        dict(gravity=(gravity[0], -gravity[1])),
        dict(fluid=Fluid(1.3001, Newtonian(VISCOSITY))),
    ):
        other = System.build(dataclasses.replace(problem, **wrong), mesh)
        assert compute_residual(other, state).relative["momentum"] > 1e-6


def quasi_steady(outlet, theta_of, count, end=0.3, factor=None):
    """Pressures at the outlet, of the time n + theta, and of the reservoir in creeping flow, by steps from t = 0."""
    system, k = poiseuille_system(outlet, factor, density=0.0), end / count
    theta = theta_of(k)
    flow = factor or (lambda time: 1.0)
    state, reservoir = (
        cases.state_of(system.mesh, v=lambda x: flow(0.0) * np.column_stack([cases.profile(x[:, 1]), 0 * x[:, 1]])),
        0.0,
    )
    found = []
    for number in range(1, count + 1):
        step = Step(k, theta, number * k)
        state = solve_step(system, state, step, tolerance=1e-9, reservoir=reservoir).state
        mean = theta * flow(step.time) + (1 - theta) * flow(step.start)
        at_outlet = state.p[system.mesh.vertices[:, 0] == LENGTH]
        before = state.p[system.mesh.vertices[:, 0] == 0.0]
        np.testing.assert_allclose(before - at_outlet, mean * SLOPE * LENGTH, rtol=1e-7)
        reservoir = float(outlet.reservoir_after(step, mean * FLOW, mean * FLOW, reservoir)) if outlet.distal else 0.0
        found.append((at_outlet.mean(), reservoir))
    return found, Step(k, theta, end).between


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
def test_pressure_in_a_step_is_that_of_its_time_between(theta):
    def ramp(time):
        return 1.0 + 2.0 * time

    outlet = Outlet("resistance", 0.7, resistance=2.0, ramp=ramp)
    found, between = quasi_steady(outlet, lambda k: theta, 3, factor=beating)
    mean = theta * beating(0.3) + (1 - theta) * beating(0.2)
    assert between == pytest.approx(0.2 + theta * 0.1, rel=1e-14)
    assert found[-1][0] == pytest.approx(0.7 * ramp(between) + 2.0 * mean * FLOW, rel=1e-9)
    assert outlet.at_end(Step(0.1, theta, 0.3), FLOW, 9.0) == pytest.approx(0.7 * ramp(0.3) + 2.0 * FLOW, rel=1e-14)


@pytest.mark.parametrize(("theta_of", "order"), [(lambda k: 0.5, 2), (lambda k: 0.5 + k, 2), (lambda k: 1.0, 1)])
def test_windkessel_fills_like_its_differential_equation(theta_of, order):
    # C dp/dt + (p - P)/R_d = Q with a constant flow rate, from p = 0.
    outlet = WINDKESSEL
    last = outlet.pressure + outlet.distal * FLOW

    def exact(time):
        return last * (1.0 - math.exp(-time / (outlet.distal * outlet.compliance)))

    errors = []
    for count in (6, 12):
        found, between = quasi_steady(outlet, theta_of, count)
        pressure, reservoir = found[-1]
        errors.append([reservoir - exact(0.3), pressure - outlet.resistance * FLOW - exact(between)])
    np.testing.assert_allclose(np.log2(np.abs(errors[0]) / np.abs(errors[1])), order, atol=0.3)


def test_outlets_and_supports_hold():
    last = WINDKESSEL.pressure + WINDKESSEL.distal * FLOW
    after = WINDKESSEL.reservoir_after(Step(K, 0.6, K), FLOW, FLOW, last)
    assert after == pytest.approx(last, rel=1e-14)
    assert WINDKESSEL.during(Step(K, 0.6, K), FLOW, FLOW, last) == pytest.approx(WINDKESSEL.steady(FLOW), rel=1e-14)
    # v_x = y - 1/2 comes back below the height 1/2, an edge's end; w = (1, 0) and w = (0, 1).
    mesh, outlet = cases.channel_mesh(6, 4), Outlet("zero-traction", backflow=0.4)
    system = poiseuille_system(outlet, mesh=mesh)
    state = cases.state_of(mesh, v=lambda x: np.column_stack([x[:, 1] - 0.5, 1.0 + x[:, 1]]))
    found = compute_residual(system, state).equations["momentum"].terms["backflow"].sum(axis=0)
    expected = [
        quad(lambda y: -0.4 * 1.3 * (y - 0.5) * (y - 0.5), 0.0, 0.5)[0],
        quad(lambda y: -0.4 * 1.3 * (y - 0.5) * (1.0 + y), 0.0, 0.5)[0],
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    away = cases.state_of(mesh, v=lambda x: np.column_stack([0.1 + x[:, 1], 1.0 + x[:, 1]]))
    assert not compute_residual(system, away).equations["momentum"].terms["backflow"].any()
    # Nothing else holds it, and it does not bulge: u_y at the bottom is the traction by the stiffness.
    mesh = cases.channel_mesh(region=2)
    system = System.build(supported_block(solids={2: Solid(2.0, StVenantKirchhoff(0.0, 30.0))}), mesh)
    state = solve(system, tolerance=1e-11).state
    bottom = np.unique(mesh.edge_nodes[mesh.label == 4])
    np.testing.assert_allclose(state.u[bottom, 1], -1.5 / 20.0, rtol=1e-9)
    force = compute_residual(system, state).equations["momentum"].terms["support"].sum(axis=0)
    np.testing.assert_allclose(force, [0.0, -1.5 * LENGTH], rtol=1e-10, atol=1e-10)
    system, state = random_step(supported_block(), cases.channel_mesh(region=2))
    found = compute_residual(system, state).equations["momentum"].terms["support"]
    step, old, mesh = system.increment.step, system.increment.old, system.mesh
    force = 20.0 * step.mean(state.u, old.u) + 3.0 * step.mean(state.v, old.v)
    edges = mesh.edge_nodes[mesh.label == 4]
    # Mass matrix of the quadratic line element with the nodes 0, 1, 1/2.
    mass = np.array([[4, -1, 2], [-1, 4, 2], [2, 2, 16]]) / 30 * (LENGTH / len(edges))
    expected = np.zeros_like(found)
    np.add.at(expected, edges, mass @ force[edges])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def supported_block(**changes):
    boundaries = (
        Boundary("left", 1, "free"), Boundary("right", 2, "free"), Boundary("top", 3, "loaded"),
        Boundary("bottom", 4, "supported"),
    )  # fmt: skip
    values = dict(boundaries=boundaries, gravity=(0.0, 0.0), traction=(0.0, -1.5), support=Support(20.0, 3.0))
    return cases.cantilever_problem(**(values | changes))


# All of them together -------------------------------------------------------------------------------------------------

# The outer side of the roof is supported, the flow comes back at the outlet while the inflow turns.
HELD = Support(8.0, 0.5)


def vessel_problem(**changes):
    boundaries = tuple(
        dataclasses.replace(b, role="supported") if b.role == "free" else b for b in cases.roof_problem().boundaries
    )
    values = dict(
        boundaries=boundaries, support=HELD,
        outlet=dataclasses.replace(WINDKESSEL, backflow=0.6, ramp=lambda time: 1.0 - 0.5 * math.exp(-5.0 * time)),
        inflow=cases.flow_in(lambda time: math.cos(8.0 * time)),
    )  # fmt: skip
    return cases.roof_problem(**(values | changes))


@pytest.mark.parametrize("steady", [True, False])
def test_jacobian_is_the_derivative(steady):
    system, state = random_step(vessel_problem(), cases.roof_mesh(4))
    if steady:
        system = System.build(vessel_problem(), cases.roof_mesh(4))
    rng = np.random.default_rng(5)
    change = RawState(*(1e-3 * rng.normal(size=field.shape) for field in state.fields))
    cases.assert_jacobian_is_the_derivative(system, state, change, 1e-3)


@pytest.fixture(scope="module")
def vessel():
    """Arguments of ``check_step`` for the last of some steps, and the reservoir at its start."""
    problem, mesh = vessel_problem(), cases.roof_mesh(4)
    system = System.build(problem, mesh)
    states, reservoir = [rest(system)], 0.3
    for number in range(1, 5):
        step, start = Step(K, 0.6, number * K), reservoir
        states.append(solve_step(system, states[-1], step, tolerance=1e-11, reservoir=start).state)
        quantities = quantities_of(system.stepping(states[-2], step, start), states[-1])
        reservoir = quantities["windkessel_new"]
    return problem, mesh, *states[-2:], step, quantities, start


def check(vessel, problem=None, reservoir=None, **lies):
    own, *arguments, quantities, start = vessel
    return cases.check_step(
        problem or own, *arguments, quantities | lies, reservoir=start if reservoir is None else reservoir
    )


def test_step_with_all_conditions_passes(vessel):
    _, _, _, new, _, quantities, _ = vessel
    assert check(vessel).failures == []
    assert new.v[np.unique(vessel[1].edge_nodes[vessel[1].label == 2]), 0].min() < 0.0  # it does come back
    assert abs(quantities["windkessel_new"] / quantities["windkessel_old"] - 1.0) > 0.01


@pytest.mark.parametrize("changes", [
    dict(pressure=0.401), dict(resistance=1.501), dict(distal=4.01), dict(compliance=0.0701), dict(backflow=0.601),
    dict(backflow=0.0), dict(ramp=None), dict(kind="resistance"), dict(kind="do-nothing"), dict(kind="zero-traction"),
], ids=str)  # fmt: skip
def test_step_with_another_outlet_is_refused(vessel, changes):
    problem = vessel[0]
    other = dataclasses.replace(problem, outlet=dataclasses.replace(problem.outlet, **changes))
    assert "momentum" in failing(check(vessel, other))


@pytest.mark.parametrize("held", [Support(8.01, 0.5), Support(8.0, 0.505), Support(0.0, 0.0)], ids=str)
def test_step_with_another_support_is_refused(vessel, held):
    assert "momentum" in failing(check(vessel, dataclasses.replace(vessel[0], support=held)))


def test_step_from_another_reservoir_is_refused(vessel):
    assert {"momentum", "outlet_difference"} <= failing(check(vessel, reservoir=vessel[-1] * 1.001))


@pytest.mark.parametrize("name", ["flow_rate_out", "outlet_pressure", "windkessel_old", "windkessel_new"])
def test_reported_outlet_is_checked(vessel, name):
    *_, quantities, _ = vessel
    assert failing(check(vessel, **{name: quantities[name] * (1 + 1e-4)})) == {"outlet_difference"}
    assert failing(check(vessel, **{name: math.nan})) == {"outlet_difference"}


def test_steady_solid_is_not_damped():
    held = Solid(2.0, StVenantKirchhoff(60.0, 30.0))
    problem, mesh = supported_block(solids={2: held}), cases.channel_mesh(region=2)
    states = [
        solve(System.build(dataclasses.replace(problem, support=Support(20.0, damping)), mesh)).state
        for damping in (0.0, 100.0)
    ]
    np.testing.assert_array_equal(states[0].u, states[1].u)


@pytest.mark.parametrize("role", ["inlet", "outlet", "supported"])
def test_boundary_without_its_condition_is_refused(role):
    key = {"inlet": "inflow", "outlet": "outlet", "supported": "support"}[role]
    with pytest.raises(ValueError, match=f"a boundary with the role {role}, but nothing that says what it does"):
        vessel_problem(**{key: None})
    with pytest.raises(ValueError, match="outlet kind 'open', accepted"):
        Outlet("open")


def test_complex_step_passes_the_kink_of_the_backflow():
    v = np.array([[[-0.3, 0.2], [0.5, 0.1], [0.2, -0.1]]])
    change, normal = v + 1j * 1e-30 * np.ones_like(v), np.array([[0.5, 0.1]])
    slope = terms.backflow(1.0, normal, change).imag / 1e-30
    numeric = (terms.backflow(1.0, normal, v + 1e-6) - terms.backflow(1.0, normal, v - 1e-6)) / 2e-6
    np.testing.assert_allclose(slope, numeric, rtol=1e-5, atol=1e-8)


WIDTH, MEAN, NU, PERIOD = 0.02, 0.3, 4e-6, 0.9
WAVEFORM = Series(PERIOD, (1.0, 0.4, -0.2, 0.05), (0.0, 0.3, 0.1, -0.1))
IN_TIME = {"time.step": 0.01, "time.end": 1.0}


def mean_of(values):
    points, weights = np.polynomial.legendre.leggauss(200)
    return weights @ values(0.5 * WIDTH * (points + 1.0)) / 2.0


@pytest.mark.parametrize("time", [0.0, 0.21, 0.6, 5.3])
def test_womersley_flow_has_the_waveform_as_its_flow_rate_and_rests_at_the_walls(time):
    velocity = womersley(WAVEFORM, MEAN, WIDTH, NU)
    angle = 2 * np.pi / PERIOD * time * np.arange(4)
    waveform = np.cos(angle) @ np.array(WAVEFORM.cosine) + np.sin(angle) @ np.array(WAVEFORM.sine)
    assert WAVEFORM(time) == pytest.approx(waveform, rel=1e-14)
    assert mean_of(lambda s: velocity(s, time)) == pytest.approx(MEAN * waveform, rel=1e-12)
    np.testing.assert_allclose(velocity(np.array([0.0, WIDTH]), time), 0.0, atol=1e-14)


def test_womersley_flow_and_the_series_of_a_scene():
    # dv/dt - nu d2v/ds2 is the pressure gradient, one number over the height.
    velocity = womersley(WAVEFORM, MEAN, WIDTH, NU)
    s, k, h = np.linspace(0.002, 0.018, 9), 1e-4, 1e-5
    for time in (0.1, 0.5):
        acceleration = (velocity(s, time + k) - velocity(s, time - k)) / (2 * k)
        curvature = (velocity(s + h, time) - 2 * velocity(s, time) + velocity(s - h, time)) / h**2
        gradient = acceleration - NU * curvature
        np.testing.assert_allclose(gradient, gradient.mean(), rtol=0, atol=1e-4 * np.abs(acceleration).max())
    one, s = Series(PERIOD, (0.0, 1.0), (0.0, 0.0)), np.linspace(0.0, WIDTH, 11)
    slow = womersley(one, MEAN, WIDTH, 1e3 * NU)(s, 0.0)
    np.testing.assert_allclose(slow, 6 * MEAN * s * (WIDTH - s) / WIDTH**2, atol=1e-3 * MEAN)
    # A layer at the wall so thin that exp(b h) overflows.
    fast = womersley(one, MEAN, WIDTH, 1e-14)(s, 0.0)
    np.testing.assert_allclose(fast[1:-1], MEAN, rtol=1e-3)
    np.testing.assert_allclose(fast[[0, -1]], 0.0, atol=1e-12)
    scene = scene_of(inflow__waveform="mca")
    series, inflow = scene.inflow.fourier, problem_from_scene(scene).inflow
    angle = 2 * np.pi / series.period * 0.2 * np.arange(len(series.cosine))
    waveform = np.cos(angle) @ np.array(series.cosine) + np.sin(angle) @ np.array(series.sine)
    ramp, middle = 0.5 - 0.5 * math.cos(math.pi / 2), 1.5 * scene.inflow.mean_velocity
    assert inflow.velocity(np.array([0.205]), 0.2)[0] == pytest.approx(ramp * waveform * middle, rel=1e-13)


def scene_of(**changes):
    changes = {key.replace("__", "."): value for key, value in changes.items()}
    return with_values(CASES["turek-fsi3"], IN_TIME | {"inflow.ramp": 0.4} | changes)


@pytest.mark.parametrize(
    ("law", "viscosity"),
    [({}, 1.0), ({"fluid__law": "carreau", "fluid__viscosity_zero": 0.9, "fluid__viscosity_infinity": 0.7}, 0.7)],
)  # fmt: skip
def test_womersley_profile_of_a_scene_reaches_the_problem(law, viscosity):
    scene = scene_of(inflow__waveform="mca", inflow__profile="womersley", **law)
    series = scene.inflow.fourier
    own = womersley(
        Series(series.period, series.cosine, series.sine), scene.inflow.mean_velocity, 0.41,
        viscosity / scene.fluid.density,
    )  # fmt: skip
    s = np.linspace(0.0, 0.41, 7)
    found = problem_from_scene(scene).inflow.velocity(s, 0.3)
    np.testing.assert_allclose(found, (0.5 - 0.5 * math.cos(0.75 * math.pi)) * own(s, 0.3), rtol=1e-12, atol=1e-15)


def test_outlets_and_support_of_a_scene_reach_the_problem():
    outlet = problem_from_scene(scene_of(outlet__kind="resistance", outlet__resistance=2.0)).outlet
    assert (outlet.kind, outlet.resistance, outlet.pressure, outlet.backflow) == ("resistance", 2.0, 0.0, 0.0)
    changes = dict(proximal_resistance=3.0, distal_resistance=4.0, compliance=0.1, pressure=5.0, backflow=0.5)
    outlet = problem_from_scene(
        scene_of(outlet__kind="windkessel", **{f"outlet__{key}": value for key, value in changes.items()})
    ).outlet
    assert outlet.pressure_at(0.2) == pytest.approx(2.5, rel=1e-14)
    assert outlet.pressure_at(0.4) == outlet.pressure_at(0.7) == 5.0
    assert outlet == Outlet("windkessel", 5.0, 3.0, 4.0, 0.1, 0.5, outlet.ramp)
    roof = CASES["flap-neo-hookean-roof"]
    problem = problem_from_scene(with_values(roof, {"support.stiffness": 3.0, "support.damping": 0.2}))
    assert problem.support == Support(3.0, 0.2) and problem.labels("supported") == [7] and not problem.labels("free")
    assert problem_from_scene(roof).support is None
    scene = scene_of(inflow__waveform="mca", inflow__profile="womersley")
    wrong = scene.model_copy(update={"inflow": scene.inflow.model_copy(update={"period": None})})
    with pytest.raises(ValueError, match="needs a fluid and the Fourier series"):
        problem_from_scene(wrong)
