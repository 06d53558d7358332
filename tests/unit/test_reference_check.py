"""The checker accepts a solution and refuses it after the smallest lie, naming what is wrong."""

import dataclasses
import json
import math

import numpy as np
import pytest
import test_reference_cases as cases
from structured import structured_mesh

from ffsi.files.arrays import RawState, read_mesh, read_state, write_mesh, write_state
from ffsi.reference import check, terms
from ffsi.reference.check import check_run
from ffsi.reference.conditions import Outlet
from ffsi.reference.forces import Forces, compute_forces
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.materials import MooneyRivlin, NeoHookean
from ffsi.reference.problem import Boundary, MeshMotion, Solid
from ffsi.reference.quantities import recompute
from ffsi.reference.solve import solve
from ffsi.reference.system import System
from ffsi.scene import CASES, with_values


def solved(problem, mesh):
    system = System.build(problem, mesh)
    solution = solve(system, tolerance=1e-11)
    found = recompute(system, solution.state, compute_forces(system, solution.state, solution.residual))
    return problem, mesh, solution.state, {name: quantity.value for name, quantity in found.items()}


flap = pytest.fixture(lambda: solved(cases.flap_problem(), cases.flap_mesh()), scope="module")


@pytest.fixture(scope="module")
def hyperelastic_flap():
    return solved(cases.flap_problem(mesh_motion=MeshMotion(1.0, 1.0, "hyperelastic")), cases.flap_mesh())


@pytest.fixture(scope="module")
def mixed_flap():
    solids = {2: Solid(2.0, NeoHookean(60.0, 30.0), "mixed")}
    return solved(
        cases.flap_problem(solids=solids, mesh_motion=MeshMotion(0.5, 0.7, "linear-elastic", 1.0)), cases.flap_mesh()
    )


@pytest.fixture(scope="module")
def loaded():
    solids = {2: Solid(1.5, MooneyRivlin(6.0, 9.0, math.inf), "incompressible")}
    return solved(cases.loaded_problem(solids=solids), cases.channel_mesh(nx=12, region=2))


bump = pytest.fixture(lambda: solved(cases.bump_problem(), cases.bump_mesh()), scope="module")
cantilever = pytest.fixture(
    lambda: solved(cases.cantilever_problem(), cases.channel_mesh(nx=12, region=2)), scope="module"
)


def write_run(directory, mesh, state, outcome, point=1):
    """Write a run folder as a FreeFEM script would leave it."""
    write_mesh(directory / "mesh.bin", mesh)
    write_state(directory / f"point-{point:04d}.bin", state)
    (directory / f"point-{point:04d}.json").write_text(json.dumps(outcome))


def copy(state):
    return RawState(state.u.copy(), state.v.copy(), state.p.copy(), state.ps.copy())


def failing(report):
    return {name for text in report.failures if (name := text.split(":")[0]) != "recomputed"}


def largest(values, where):
    """Index of the largest absolute value among the nodes where the mask holds."""
    masked = np.where(where if values.ndim == 1 else where[:, None], np.abs(values), -1.0)
    return np.unravel_index(masked.argmax(), values.shape)


@pytest.mark.parametrize("case", ["flap", "hyperelastic_flap", "mixed_flap", "bump", "cantilever", "loaded"])
def test_solution_passes(case, request):
    report = cases.check_state(*request.getfixturevalue(case))
    assert report.failures == [] and report.passed and report.momentum < 1e-9 and report.min_jacobian > 0.0


def test_equations_that_a_scene_has_not_are_none(flap, mixed_flap, bump, cantilever, loaded):
    wet = {"continuity", "kinematics", "mesh_motion", "drag_difference", "lift_difference"}

    def absent(case):
        report = cases.check_state(*case)
        return {name for name in wet | {"momentum", "incompressibility"} if getattr(report, name) is None}

    assert absent(mixed_flap) == set() and absent(flap) == {"incompressibility"}
    assert absent(bump) == {"kinematics", "mesh_motion", "incompressibility"}
    assert absent(cantilever) == wet | {"incompressibility"} and absent(loaded) == wet


def lied(problem, mesh, state, field, place):
    """The state with a thousandth more in one unknown, which is the largest at a place."""
    rows = System.build(problem, mesh).rows
    solid, fluid = (np.isin(np.arange(mesh.n_p2), mesh.p2[(mesh.region == 1) == wet]) for wet in (False, True))
    places = {
        "solid": solid & ~fluid & ~rows.u_given, "fluid": fluid & rows.mesh_motion,
        "interface": solid & fluid & ~rows.u_given, "inlet": mesh.p2_coordinates[:, 0] == 0.0, "wet": ~rows.p_given,
    }  # fmt: skip
    changed = copy(state)
    values = getattr(changed, field)
    where = largest(values, places[place])
    assert values[where] != 0.0
    values[where] *= 1.001
    return changed


# What is changed by a thousandth of itself (at its largest value), and which checks must see it.
LIES = {
    "u in the solid": ("u", "solid", {"momentum"}),
    "u in the fluid": ("u", "fluid", {"mesh_motion", "momentum", "continuity"}),
    "u on the interface": ("u", "interface", {"mesh_motion", "momentum", "continuity"}),
    "v in the fluid": ("v", "fluid", {"momentum", "continuity"}), "v at the inlet": ("v", "inlet", {"dirichlet"}),
    "p": ("p", "wet", {"momentum"}),
}  # fmt: skip


@pytest.mark.parametrize("case", ["flap", "hyperelastic_flap", "mixed_flap"])
@pytest.mark.parametrize("lie", LIES)
def test_a_thousandth_of_one_unknown_is_seen(case, lie, request):
    problem, mesh, state, quantities = request.getfixturevalue(case)
    field, place, expected = LIES[lie]
    report = cases.check_state(problem, mesh, lied(problem, mesh, state, field, place), quantities)
    assert not report.passed and expected <= failing(report)


@pytest.mark.parametrize(("case", "equation", "term", "expected"), [
    ("mixed_flap", "mesh_motion", "transposed", {"mesh_motion"}),
    ("mixed_flap", "mesh_motion", "divergence", {"mesh_motion"}),
    ("mixed_flap", "solid_momentum", "stress", {"momentum"}),
    ("mixed_flap", "solid_momentum", "pressure", {"momentum"}),
    ("mixed_flap", "incompressibility", "rest", {"incompressibility"}),
    ("mixed_flap", "incompressibility", "du_x/dX", {"incompressibility"}),
    ("loaded", "solid_momentum", "pressure", {"momentum"}),
    ("loaded", "incompressibility", "rest", {"incompressibility"}),
    ("loaded", "incompressibility", "du_y/dY", {"incompressibility"}),
])  # fmt: skip
@pytest.mark.parametrize("factor", [-1.0, 1.0001])
def test_wrong_sign_or_factor_of_a_term_is_seen(case, equation, term, expected, factor, request, monkeypatch):
    solution, function = request.getfixturevalue(case), getattr(terms, equation)

    def wrong(*arguments):
        local = function(*arguments)
        return local | {term: factor * local[term]}

    monkeypatch.setattr(terms, equation, wrong)
    assert failing(cases.check_state(*solution)) - {"drag_difference", "lift_difference"} == expected


def test_wrong_pressures_velocities_and_prescribed_values_are_seen(mixed_flap, loaded, flap, bump):
    for case, expected in ((mixed_flap, {"momentum", "incompressibility"}), (loaded, {"momentum"})):
        problem, mesh, state, quantities = case
        changed = copy(state)
        changed.ps[:] *= -1.0
        assert failing(cases.check_state(problem, mesh, changed, quantities)) == expected
    problem, mesh, state, quantities = mixed_flap
    both = ~System.build(problem, mesh).rows.p_given & System.build(problem, mesh).rows.incompressibility[0]
    changed = copy(state)
    changed.ps[0, both] = state.p[both]
    assert {"momentum", "incompressibility"} <= failing(cases.check_state(problem, mesh, changed, quantities))
    problem, mesh, state, quantities = flap
    changed = copy(state)
    only_solid = np.setdiff1d(mesh.p2[mesh.region == 2], mesh.p2[mesh.region == 1])
    changed.v[only_solid[3], 1] = 1e-3 * np.abs(state.v).max()
    rows = System.build(problem, mesh).rows
    assert rows.kinematics[only_solid[3]]
    assert failing(cases.check_state(problem, mesh, changed, quantities)) == {"kinematics"}
    wall = largest(mesh.p2_coordinates, System.build(problem, mesh).rows.v_given)[0]
    for field in ("u", "v"):
        changed = copy(state)
        getattr(changed, field)[wall] += 1e-7
        assert "dirichlet" in failing(cases.check_state(problem, mesh, changed, quantities))
    changed = copy(state)
    changed.p[System.build(problem, mesh).rows.p_given] = 1e-7
    assert failing(cases.check_state(problem, mesh, changed, quantities)) == {"dirichlet"}
    problem, mesh, state, quantities = bump
    changed = copy(state)
    changed.u[mesh.edge_nodes[mesh.label == 5, 2]] = 0.0  # straight edges instead of the circle
    assert "dirichlet" in failing(cases.check_state(problem, mesh, changed, quantities))


@pytest.mark.parametrize(("name", "check"), [
    ("drag", "drag_difference"), ("lift", "lift_difference"), ("drag_coefficient", "coefficient_difference"),
    ("lift_coefficient", "coefficient_difference"),
])  # fmt: skip
def test_reported_forces_are_checked(bump, name, check):
    problem, mesh, state, quantities = bump
    lied = quantities | {name: quantities[name] * (1 + 2e-8)}
    report = cases.check_state(problem, mesh, state, lied)
    assert failing(report) == {check} and getattr(report, check) == pytest.approx(2e-8, rel=1e-4)
    assert any(text.startswith("recomputed: drag ") for text in report.failures)


def test_missing_forces_and_moved_nodes_are_seen(bump, hyperelastic_flap, flap):
    problem, mesh, state, quantities = bump
    assert failing(cases.check_state(problem, mesh, state, {})) == {"drag_difference", "lift_difference"}
    assert failing(cases.check_state(problem, mesh, state, quantities | {"drag": math.nan})) == {"drag_difference"}
    # Pressure of one pascal in a box pushes the floor down, without drag but for rounding.
    mesh = cases.channel_mesh()
    walls = (Boundary("floor", 4, "no-slip", "floor"), *(Boundary(f"wall {k}", k, "no-slip") for k in (1, 2, 3)))
    problem = cases.channel_problem(boundaries=walls)
    state = RawState(np.zeros((mesh.n_p2, 2)), np.zeros((mesh.n_p2, 2)), np.ones(len(mesh.vertices)))
    report = cases.check_state(problem, mesh, state, {"drag": 3e-16, "lift": -2.0})
    assert report.drag_difference < 1e-8 and report.lift_difference < 1e-14
    assert failing(cases.check_state(problem, mesh, state, {"drag": 1e-12, "lift": -2.0})) == {"drag_difference"}
    problem, mesh, state, quantities = hyperelastic_flap
    for node in np.flatnonzero(System.build(problem, mesh).rows.mesh_motion)[::17]:
        changed = copy(state)
        changed.u[node, 1] += 1e-6
        assert "mesh_motion" in failing(cases.check_state(problem, mesh, changed, quantities))
    for (problem, *_), (_, mesh, state, quantities) in ((flap, hyperelastic_flap), (hyperelastic_flap, flap)):
        assert failing(cases.check_state(problem, mesh, state, quantities)) == {"mesh_motion"}


@pytest.mark.parametrize("case", ["flap", "hyperelastic_flap"])
def test_inverted_triangle_fails(case, request):
    problem, mesh, state, quantities = request.getfixturevalue(case)
    changed = copy(state)
    node = largest(mesh.p2_coordinates, System.build(problem, mesh).rows.mesh_motion)[0]
    changed.u[node] += 1.0
    report = cases.check_state(problem, mesh, changed, quantities)
    assert report.min_jacobian < 0.0 and {"min_jacobian", "mesh_motion"} <= failing(report)


def test_a_solution_does_not_solve_another_problem_or_fit_another_mesh(flap, mixed_flap, loaded):
    _, mesh, state, quantities = flap
    for changes, expected in (
        (dict(gravity=(0.01, -0.0501)), {"momentum"}),
        (dict(outlet=Outlet("zero-traction")), {"momentum"}),
        (dict(mesh_motion=MeshMotion(1.0, 1.01)), {"mesh_motion"}),
        (dict(inflow=cases.flow_in(lambda time: 1.001)), {"dirichlet"}),
        (dict(reference_length=0.51), {"coefficient_difference"}),
    ):
        assert expected <= failing(cases.check_state(cases.flap_problem(**changes), mesh, state, quantities))
    for (problem, mesh, state, quantities), changes, expected in (
        (mixed_flap, dict(solids={2: Solid(2.0, NeoHookean(60.1, 30.0), "mixed")}), {"incompressibility"}),
        (mixed_flap, dict(solids={2: Solid(2.0, NeoHookean(-60.0, 30.0), "mixed")}), {"incompressibility"}),
        (mixed_flap, dict(solids={2: Solid(2.0, NeoHookean(60.0, 30.1), "mixed")}), {"momentum"}),
        (mixed_flap, dict(solids={2: Solid(2.0, NeoHookean(60.0, 30.0), "incompressible")}), {"incompressibility"}),
        (mixed_flap, dict(mesh_motion=MeshMotion(0.5, 0.7, "harmonic", 1.0)), {"mesh_motion"}),
        (mixed_flap, dict(mesh_motion=MeshMotion(0.5, 0.7, "linear-elastic", -1.0)), {"mesh_motion"}),
        (mixed_flap, dict(mesh_motion=MeshMotion(0.5, 0.7, "linear-elastic", 1.001)), {"mesh_motion"}),
        (mixed_flap, dict(mesh_motion=MeshMotion(0.5, 0.7, "linear-elastic")), {"mesh_motion"}),
        (loaded, dict(traction=(-1.5, 0.8)), {"momentum"}),
        (loaded, dict(traction=(1.5, -0.8001)), {"momentum"}),
        (loaded, dict(traction=(0.0, 0.0)), {"momentum"}),
        (loaded, dict(solids={2: Solid(1.5, MooneyRivlin(6.0, 9.0, 1e4), "mixed")}), {"incompressibility"}),
    ):
        report = cases.check_state(dataclasses.replace(problem, **changes), mesh, state, quantities)
        assert failing(report) == expected, changes
    problem, _, state, quantities = flap
    with pytest.raises(ValueError, match="state of shapes"):
        cases.check_state(problem, cases.flap_mesh(4), state, quantities)


def scene_mesh(scene):
    g = scene.geometry
    left, right, top = g.flap_left, g.flap_left + g.flap_width, g.flap_height

    def label(x, y):
        if x in (0.0, g.length):
            return 1 if x == 0.0 else 2
        if y in (0.0, g.height):
            return 6 if y == 0.0 and left < x < right else 3
        return 5

    x = np.concatenate([np.linspace(0, left, 9), np.linspace(left, right, 3)[1:], np.linspace(right, g.length, 9)[1:]])
    y = np.concatenate([np.linspace(0, top, 5), np.linspace(top, g.height, 5)[1:]])
    return structured_mesh(x, y, lambda x, y: 1 + (left < x < right and y < top), label)


# Slow and stiff enough for the coarse mesh.
CHANGES = {"inflow.mean_velocity": 0.05, "solid.flap.lame_lambda": 800.0, "solid.flap.lame_mu": 200.0}


@pytest.fixture
def run(tmp_path):
    """Run folder of a solved scene, with its scene and outcome."""
    scene = with_values(CASES["flap-svk"], CHANGES)
    _, mesh, state, quantities = solved(problem_from_scene(scene), scene_mesh(scene))
    outcome = {"parameters": CHANGES, "quantities": quantities}
    write_run(tmp_path, mesh, state, outcome, point=2)
    return tmp_path, scene, outcome


def test_run_folders_are_checked_for_the_pressures_of_their_solids(run):
    directory, scene, outcome = run
    report = check_run(directory, scene, point=2)
    assert report.failures == [] and report.forces.total.residual[0] == outcome["quantities"]["drag"]
    assert report.forces.parts.keys() == {"flap"}
    outcome["quantities"]["drag"] *= 1.0 + 1e-6
    (directory / "point-0002.json").write_text(json.dumps(outcome))
    assert failing(check_run(directory, scene, point=2)) == {"drag_difference"}
    directory, scene, _ = run
    mesh = read_mesh(directory / "mesh.bin")
    state = read_state(directory / "point-0002.bin", mesh)
    more = dataclasses.replace(state, ps=np.zeros((1, len(state.p))))
    write_state(directory / "point-0002.bin", more)
    with pytest.raises(ValueError, match="the state has pressures of 1 mixed solids, the problem 0"):
        check_run(directory, scene, point=2)


def test_run_folder_of_a_mixed_scene_is_checked(tmp_path):
    changes = CHANGES | {"solid.flap.formulation": "mixed"}
    scene = with_values(CASES["flap-neo-hookean"], changes)
    _, mesh, state, quantities = solved(problem_from_scene(scene), scene_mesh(scene))
    write_run(tmp_path, mesh, state, {"quantities": quantities})
    report = check_run(tmp_path, scene)
    assert report.failures == [] and report.incompressibility < 1e-10
    write_state(tmp_path / "point-0001.bin", RawState(state.u, state.v, state.p))
    with pytest.raises(ValueError, match="the state has pressures of 0 mixed solids, the problem 1"):
        check_run(tmp_path, scene)


def test_run_folders_with_other_parameters_or_points_are_refused(run):
    directory, scene, _ = run
    other = with_values(scene, {"inflow.mean_velocity": 0.06})
    with pytest.raises(ValueError, match=r"the run used inflow\.mean_velocity = 0\.05 but the scene says 0\.06"):
        check_run(directory, other, point=2)
    with pytest.raises(FileNotFoundError, match=r"point-0001\.json"):
        check_run(directory, scene)


def test_prescribed_values_are_compared_on_their_own_scale_unless_they_are_rounding():
    values, given, old = np.array([1e-3 + 1e-9, 1.0]), np.array([True, False]), np.zeros(2)
    assert check._deviation(values, np.array([1e-3, 0.0]), given, old) == pytest.approx(1e-6)
    values[0] = 3e-17
    assert check._deviation(values, np.array([1e-17, 0.0]), given, old) == pytest.approx(2e-12)


@pytest.mark.parametrize("jacobian", [-1.5, -0.29, -1e-300, 0.0, math.nan])
def test_triangle_turned_inside_out_fails_whatever_the_residuals_say(jacobian):
    def report(*jacobians):
        found = [check._Findings({"dirichlet": 0.0}, each, Forces({}, None), " in step 7") for each in jacobians]
        return check._report(found, 1e-8)

    assert report(0.5, 1e-300).failures == []
    for jacobians in ((jacobian,), (0.5, jacobian), (jacobian, 0.5)):
        assert failing(report(*jacobians)) == {"min_jacobian"} and not report(*jacobians).min_jacobian > 0.0
        assert "in step 7" in report(*jacobians).failures[0]


@pytest.mark.parametrize("name", ["momentum", "dirichlet", "wall_difference", "quantities_difference", "step_error"])
def test_number_that_is_none_fails_in_whatever_step(name):
    for numbers in ((math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0)):
        found = [check._Findings({"dirichlet": 0.0, name: each}, 1.0, Forces({}, None), "") for each in numbers]
        assert failing(check._report(found, 1e-8)) == {name}
