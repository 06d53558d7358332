"""Every reported quantity is recomputed: exact values of known states, and one lie after the other."""

import dataclasses
import json
import math

import numpy as np
import pytest
import test_reference_cases as cases
from test_reference_cases import HEIGHT, LENGTH, MEAN_VELOCITY
from test_reference_check import CHANGES, failing, scene_mesh, solved, write_run
from test_reference_residual import DEFORMATION, DENSITY, ROTATION, STRETCH, VISCOSITY, deformed_state
from test_reference_step_runs import rewrite, run, solved_run  # noqa: F401

from ffsi.files.arrays import RawState, write_state
from ffsi.reference.check import check_run
from ffsi.reference.forces import coefficient_scale, compute_forces
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.problem import Boundary
from ffsi.reference.quantities import Quantity, compare, recompute
from ffsi.reference.relative import largest, norm, relative
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve
from ffsi.reference.system import System
from ffsi.scene import CASES, with_values


def found_of(problem, mesh, state):
    system = System.build(problem, mesh)
    return recompute(system, state, compute_forces(system, state, compute_residual(system, state)))


def test_displacements_and_pressures_are_interpolated():
    mesh = cases.flap_mesh()
    state = cases.state_of(mesh, u=lambda x: 1e-3 * np.column_stack([x[:, 0] ** 2 - x[:, 1], x[:, 0] * x[:, 1]]))
    solid = mesh.vertices[mesh.triangles[mesh.region == 2][0]]
    inside, edge = solid.T @ [0.5, 0.2, 0.3], solid.T @ [0.3, 0.7, 0.0]
    points = {"tip": tuple(inside), "probe": tuple(edge), "corner": tuple(solid[1])}
    found = found_of(cases.flap_problem(points=points), mesh, state)
    for name, (x, y) in points.items():
        assert found[f"{name}_ux"].value == pytest.approx(1e-3 * (x**2 - y), rel=1e-12)
        assert found[f"{name}_uy"].value == pytest.approx(1e-3 * x * y, rel=1e-12)
    state = cases.state_of(mesh, u=lambda x: np.outer(1 + 0 * x[:, 0], [1, 1e-6]))
    small = found_of(cases.flap_problem(points=points), mesh, state)["tip_uy"]  # its rounding is that of the other one
    assert small.difference(1e-6 + 2e-14) < 1e-8 < small.difference(1e-6 * (1 + 1e-6))
    mesh = cases.bump_mesh()
    state, problem = cases.state_of(mesh, p=lambda x: 7.0 - 3.0 * x[:, 0]), cases.bump_problem()
    found = found_of(problem, mesh, state)
    inlet, outlet = (mesh.edges[np.isin(mesh.label, problem.labels(role))] for role in ("inlet", "outlet"))
    length = mesh.vertices[outlet[0, 0], 0] - mesh.vertices[inlet[0, 0], 0]
    assert found["pressure_drop"].value == pytest.approx(3.0 * length, rel=1e-12)
    mesh, problem = cases.channel_mesh(), cases.channel_problem()
    # Two vertices of the floor, one diameter apart: the ends of a circle around the middle.
    floor = np.unique(mesh.vertices[np.unique(mesh.edges[mesh.label == 3]), 0])
    y = float(mesh.vertices[mesh.edges[mesh.label == 3][0, 0], 1])
    circle = (float(floor[1] + floor[3]) / 2, y, float(floor[3] - floor[1]) / 2)
    state = cases.state_of(mesh, p=lambda x: np.exp(x[:, 0]))
    walls = [Boundary("cylinder", 3, "clamped", None, circle) if b.label == 3 else b for b in problem.boundaries]
    found = found_of(dataclasses.replace(problem, boundaries=tuple(walls)), mesh, state)
    assert found["pressure_difference"].value == pytest.approx(math.exp(floor[1]) - math.exp(floor[3]), rel=1e-12)
    covered = (circle[0] + 0.1 * circle[2], y, circle[2])
    walls = [Boundary("cylinder", 3, "clamped", None, covered) if b.label == 3 else b for b in problem.boundaries]
    assert "pressure_difference" not in found_of(dataclasses.replace(problem, boundaries=tuple(walls)), mesh, state)


def test_place_of_the_smallest_jacobian():
    mesh, names = cases.flap_mesh(), {2: "flap"}
    state = cases.state_of(
        mesh, u=lambda x: 0.05 * np.column_stack([np.sin(2 * x[:, 1]) * x[:, 0] ** 2, -(x[:, 1] ** 3)])
    )
    found = found_of(cases.flap_problem(names=names), mesh, state)
    assert found["min_jacobian"].value == min(found[f"min_jacobian_{name}"].value for name in ("fluid", "solid"))
    # In the flap J = det(I + grad u) at the reported place: of the exact field up to the elements' error.
    x, y = (found[f"min_jacobian_flap_{component}"].value for component in "xy")
    gradient = 0.05 * np.array([[2 * x * math.sin(2 * y), 2 * math.cos(2 * y) * x**2], [0.0, -3 * y**2]])
    assert found["min_jacobian_solid"].value == pytest.approx(np.linalg.det(np.eye(2) + gradient), abs=2e-3)
    assert {f"min_jacobian_{name}_{c}" for name in ("flap", "fluid") for c in "xy"} <= found.keys()
    mesh = cases.flap_mesh()
    system = System.build(cases.flap_problem(names={2: "flap"}), mesh)
    state = cases.state_of(mesh)  # J = 1 everywhere
    forces = compute_forces(system, state, compute_residual(system, state))
    x, y = system.solids[2].elements.p1[3] @ mesh.vertices[system.solids[2].elements.vertices[5]]
    told = {"min_jacobian_flap_x": float(x), "min_jacobian_flap_y": float(y)}
    assert compare(recompute(system, state, forces, told), told).difference < 1e-15
    told["min_jacobian_flap_x"] += 1e-3
    assert compare(recompute(system, state, forces, told), told).difference > 1e-6


def test_unknown_missing_and_undefined_quantities_differ():
    known = {"tip_uy": Quantity.of(2.0, 3.0), "lift": Quantity.of(0.0, 5.0)}
    assert compare(known, {"tip_uy": 2.0, "lift": 0.0}, known).difference == 0.0
    worst = compare(known, {"tip_uy": 2.0, "cost": 1.0})
    assert (worst.difference, worst.words) == (math.inf, "cost is reported, which nobody recomputes")
    worst = compare(known, {"lift": 0.0}, known)
    assert (worst.difference, worst.words) == (math.inf, "tip_uy is not reported, recomputed 2")
    for wrong in (math.nan, None, "2", True):
        assert not compare(known, {"tip_uy": wrong, "lift": 0.0}).difference <= 1e-8
        assert not compare(known, {"lift": 0.0, "tip_uy": wrong}).difference <= 1e-8
    worst = compare(known, {"tip_uy": 2.5, "lift": 1e-12})
    assert worst.difference == pytest.approx(0.25) and worst.words == "tip_uy is reported as 2.5, recomputed 2"
    # Five newtons that cancel leave rounding.
    assert compare(known, {"lift": 4e-15}).difference < 1e-8 < compare(known, {"lift": 6e-15}).difference
    assert (relative(0.0, 0.0), relative(-1e-300, 0.0), relative(-3.0, 2.0)) == (0.0, math.inf, 1.5)
    assert math.isnan(relative(math.nan, 1.0)) and math.isnan(relative(1.0, math.nan))
    assert (largest([]), largest([1.0, 3.0])) == (0.0, 3.0)
    assert math.isnan(largest([1.0, math.nan])) and math.isnan(largest([math.nan, 1.0]))
    assert norm(np.array([3e-200, 4e-200])) == pytest.approx(5e-200)
    assert norm(np.array([3e200, 4e200])) == pytest.approx(5e200) and norm(np.zeros((0, 2))) == 0.0
    assert math.isnan(norm([1.0, math.nan])) and norm([1.0, math.inf]) == math.inf


@pytest.fixture(scope="module")
def steady():
    scene = with_values(CASES["flap-svk"], CHANGES)
    return scene, *solved(problem_from_scene(scene), scene_mesh(scene))[1:]


def check(directory, scene, mesh, state, quantities):
    write_run(directory, mesh, state, {"quantities": quantities})
    return check_run(directory, scene)


def test_every_quantity_of_a_steady_run_is_checked(tmp_path, steady):
    *folder, quantities = steady
    report = check(tmp_path, *folder, quantities)
    assert report.failures == [] and report.quantities_difference < 1e-15
    names = {"drag_surface", "pressure_drop", "tip_ux", "tip_uy", "min_jacobian", "min_jacobian_flap_x"}
    assert names | {"min_jacobian_fluid_y", "min_jacobian_solid", "lift_surface"} <= quantities.keys()
    for name, value in quantities.items():
        if name.removesuffix("_coefficient") in ("drag", "lift"):
            continue  # numbers of their own
        for changes in ({name: value + 1e-6}, {name: None}):
            report = check(tmp_path, *folder, quantities | changes)
            assert failing(report) == {"quantities_difference"}, name
            assert f"({name} is reported as " in report.failures[0]
        report = check(tmp_path, *folder, {other: quantities[other] for other in quantities if other != name})
        assert f"({name} is not reported, recomputed {value:.12g})" in report.failures[0]
    report = check(tmp_path, *folder, quantities | {"viscous_drag": 1.0})
    assert failing(report) == {"quantities_difference"}
    assert "viscous_drag is reported, which nobody recomputes" in report.failures[0]


def test_quantities_of_rows_are_checked_and_forces_of_nothing_unknown(run):  # noqa: F811
    mesh = cases.channel_mesh(region=2)  # a solid alone
    report = cases.check_state(cases.cantilever_problem(), mesh, cases.state_of(mesh), {"drag": 0.0})
    assert report.drag_difference is None and "(drag is reported, which nobody recomputes)" in report.failures[-1]
    directory, scene, entries = run
    lines, number = lines_of(directory), entries[0]["step"]
    for name in ("drag", "lift", "tip_ux", "tip_uy", "min_jacobian", "kinetic", "elastic", "dissipated"):
        value = float(lines[number].split(",")[lines[0].split(",").index(name)])
        changed(directory, with_cell(lines, number, name, repr(value + 1e-6)))
        report = check_run(directory, scene)
        assert failing(report) == {"quantities_difference"}
        assert f" in step {number} at 0.1 s ({name} is reported as " in report.failures[0]
    for name in ("work", "iterations", "seconds"):  # the exceptions
        changed(directory, with_cell(lines, number, name, "7"))
        assert check_run(directory, scene).passed
    column = lines[0].split(",").index("tip_uy")
    changed(directory, [",".join(cell for i, cell in enumerate(line.split(",")) if i != column) for line in lines])
    assert "(tip_uy is not reported, recomputed" in check_run(directory, scene).failures[0]
    changed(directory, [f"{line},{'cost' if i == 0 else 1}" for i, line in enumerate(lines)])
    assert "(cost is reported, which nobody recomputes)" in check_run(directory, scene).failures[0]


def lines_of(directory):
    return (directory / "history.csv").read_text().splitlines()


def changed(directory, lines):
    (directory / "history.csv").write_text("\n".join(lines) + "\n")


def with_cell(lines, row, name, value):
    cells = lines[row].split(",")
    cells[lines[0].split(",").index(name)] = value
    return [*lines[:row], ",".join(cells), *lines[row + 1 :]]


@pytest.mark.parametrize(("damage", "message"), [
    (lambda lines: [*lines[:2], *lines[3:]], r"row 2: a step of 0\.05 s from 0\.05 s does not end at 0\.15"),
    (lambda lines: lines[:-1], r"no step 4, the last is 3"), (lambda lines: lines[:1], r"no step 2, the last is 0"),
    (lambda lines: [*lines[:3], lines[2], *lines[3:]], r"row 3: .* from 0\.1 s does not end at 0\.1 s"),
    (lambda lines: [*lines, lines[-1]], r"row 5: .* does not end at"),
    (lambda lines: [lines[0], lines[2], lines[1], *lines[3:]], r"row 1: a step of 0\.05 s from 0\.0 s"),
    (lambda lines: with_cell(lines, 3, "tip_uy", "1x-3"), r"row 3: tip_uy = '1x-3' is no finite number"),
    (lambda lines: with_cell(lines, 1, "drag", "nan"), r"row 1: drag = 'nan' is no finite number"),
    (lambda lines: with_cell(lines, 1, "seconds", ""), r"row 1: seconds = '' is no finite number"),
    (lambda lines: with_cell(lines, 3, "step", "0.04"), r"row 3: a step of 0\.04 s"),
    (lambda lines: with_cell(lines, 3, "time", "0.16"), r"row 3: .* does not end at 0\.16 s"),
    (lambda lines: [*lines[:2], lines[2] + ",1", *lines[3:]], r"row 2 has \d+ cells, the head \d+"),
    (lambda lines: [*lines[:4], lines[4][:30]], r"row 4 has \d+ cells"),
    (lambda lines: [lines[0].replace("time", "tome"), *lines[1:]], r"history\.csv: no column time"),
    (lambda lines: [lines[0].replace("lift", "drag"), *lines[1:]], r"a column is there twice"),
    (lambda lines: [], r"history\.csv: no (table|column)"),
])  # fmt: skip
def test_history_with_a_damaged_row_is_refused(run, damage, message):  # noqa: F811
    directory, scene, _ = run
    changed(directory, damage(lines_of(directory)))
    with pytest.raises(ValueError, match=message):
        check_run(directory, scene)


def test_rows_that_do_not_belong_to_the_steps_are_refused(run):  # noqa: F811
    directory, scene, entries = run
    rewrite(directory, entries[:1])
    with pytest.raises(ValueError, match=r"history\.csv: 4 rows, but the last step is 2"):
        check_run(directory, scene)
    rewrite(directory, [entries[0] | {"step": 3}, entries[1]])
    with pytest.raises(ValueError, match=r"row 3 is a step of 0\.05 s that ends at 0\.15\d* s; .* ends at 0\.1 s"):
        check_run(directory, scene)


def test_point_of_a_run_in_time_is_the_last_state(run, solved_run):  # noqa: F811
    directory, scene, _ = run
    _, _, states, *_ = solved_run
    outcome = json.loads((directory / "point-0001.json").read_text())
    outcome["quantities"]["tip_uy"] += 1e-6
    (directory / "point-0001.json").write_text(json.dumps(outcome))
    assert "(tip_uy is reported as " in check_run(directory, scene).failures[0]
    write_state(directory / "point-0001.bin", states[-2])
    with pytest.raises(ValueError, match=r"point-0001\.bin: not the state at the end of the last step"):
        check_run(directory, scene)


def forces_of(problem, mesh, state):
    system = System.build(problem, mesh)
    return compute_forces(system, state, compute_residual(system, state))


@pytest.fixture(scope="module")
def flap():
    mesh = cases.flap_mesh()
    system = System.build(cases.flap_problem(), mesh)
    return system, solve(system)


def shear_flow(mesh, gravity):
    """v = (a, b x) under gravity on the deformed mesh: convection, pressure and viscous stress are all at work."""
    a, b = 0.7, 1.9
    return (
        a * b, b,
        deformed_state(mesh, velocity=lambda x: np.column_stack([a + 0 * x[:, 0], b * x[:, 0]]),
            pressure=lambda x: DENSITY * (x @ gravity - a * b * x[:, 1])),
    )  # fmt: skip


@pytest.mark.parametrize("form", ["surface", "residual"])
def test_forces_on_a_deformed_box_are_exact(form):
    gravity, mesh = np.array([0.3, -0.8]), cases.channel_mesh()
    acceleration, b, state = shear_flow(mesh, gravity)
    turned = ROTATION @ gravity
    forces = forces_of(cases.box_problem(gravity=(turned[0], turned[1])), mesh, state)
    width, height = STRETCH[0, 0] * LENGTH, STRETCH[1, 1] * HEIGHT
    # Force of the fluid on a wall with normal n out of the fluid: the integral of p n - mu b (n_y, n_x), rotated frame.
    over_floor = DENSITY * gravity[0] * width**2 / 2
    over_left = DENSITY * (gravity[1] - acceleration) * height**2 / 2
    expected = {
        "floor": np.array([VISCOSITY * b * width, -over_floor]), "left": np.array([-over_left, VISCOSITY * b * height]),
    }  # fmt: skip
    for part, force in expected.items():
        np.testing.assert_allclose(ROTATION.T @ getattr(forces.parts[part], form), force, rtol=1e-13)
    acceleration, _, state = shear_flow(mesh, gravity)
    total = getattr(forces_of(cases.box_problem(gravity=(turned[0], turned[1])), mesh, state).total, form)
    mass = DENSITY * np.linalg.det(DEFORMATION) * LENGTH * HEIGHT
    expected = mass * (gravity - np.array([0.0, acceleration]))
    np.testing.assert_allclose(ROTATION.T @ total, expected, rtol=1e-12)


def test_poiseuille_drag_of_the_floor_needs_the_rest_edges():
    mesh, problem = cases.channel_mesh(), cases.channel_problem()
    system, slope = System.build(problem, mesh), 6.0 * MEAN_VELOCITY / HEIGHT
    state = cases.state_of(
        mesh, v=lambda x: np.column_stack([slope * x[:, 1] * (1 - x[:, 1] / HEIGHT), 0 * x[:, 1]]),
        p=lambda x: 2 * VISCOSITY * slope / HEIGHT * (LENGTH - x[:, 0]),
    )  # fmt: skip
    residual = compute_residual(system, state)
    force = compute_forces(system, state, residual).parts["floor"].residual
    weight = 2 * VISCOSITY * slope / HEIGHT * LENGTH**2 / 2
    np.testing.assert_allclose(force, [VISCOSITY * slope * LENGTH, -weight], rtol=1e-13)
    floor = np.unique(mesh.edge_nodes[mesh.label == 4])
    without = -residual.fluid_force[floor].sum(axis=0)
    assert abs(without[0] / force[0] - 1.0) > 1e-2


def test_forces_of_a_solved_flap_are_fluxes_and_reactions(flap):
    system, solution = flap
    boundaries = tuple(Boundary(b.name, b.label, b.role, b.name) for b in system.problem.boundaries)
    everything = System.build(cases.flap_problem(boundaries=boundaries), system.mesh)
    residual = compute_residual(everything, solution.state)
    total = compute_forces(everything, solution.state, residual).total.residual
    terms = residual.equations["momentum"].terms
    convection = terms["convection"].sum(axis=0)
    # The outlet's rows hold with the do-nothing term, which is no force of the fluid on what lies outside.
    fluid_weight = -(residual.fluid_force - terms["convection"] - terms["pressure"] - terms["viscosity"]).sum(axis=0)
    inner = np.setdiff1d(np.arange(system.mesh.n_p2), np.unique(system.fluid.sides.nodes))
    np.testing.assert_allclose(residual.fluid_force[inner], 0.0, atol=1e-10)
    np.testing.assert_allclose(total, fluid_weight - convection, rtol=1e-9)
    mesh, terms = system.mesh, solution.residual.equations["momentum"].terms
    root = np.unique(mesh.edge_nodes[mesh.label == 6])
    corners = np.intersect1d(root, mesh.edge_nodes[mesh.label == 5])
    # The solid is in balance: what the fluid's rows give to the interface, apart from the two corner nodes, the rest
    # of the solid's rows takes.
    solid = terms["stress in region 2"] + terms["gravity"] - _fluid_gravity(system, solution.state)
    interface = np.setdiff1d(np.unique(mesh.edge_nodes[mesh.label == 5]), corners)
    fluid = solution.residual.fluid_force
    np.testing.assert_allclose(solid[interface].sum(axis=0), -fluid[interface].sum(axis=0), rtol=1e-9)
    np.testing.assert_allclose(
        solid[np.setdiff1d(np.unique(mesh.p2[mesh.region == 2]), np.r_[root, interface])], 0, atol=1e-9
    )


def _fluid_gravity(system, state):
    alone = System.build(cases.flap_problem(gravity=(0.0, 0.0)), system.mesh)
    return compute_residual(system, state).fluid_force - compute_residual(alone, state).fluid_force


def test_both_forms_approach_each_other_and_parts_add_up():
    found = []
    for n in (4, 8, 16):
        system = System.build(cases.bump_problem(), cases.bump_mesh(2 * n, n))
        solution = solve(system)
        force = compute_forces(system, solution.state, solution.residual).total
        found.append((force.surface[0], force.residual[0]))
    surface, residual = np.array(found).T
    gap = np.abs(surface - residual)
    assert (gap[1:] < gap[:-1] / 3.0).all()
    assert abs(residual[0] - residual[2]) < 0.15 * abs(surface[0] - residual[2])
    mesh = cases.channel_mesh()
    state = RawState(np.zeros((mesh.n_p2, 2)), np.zeros((mesh.n_p2, 2)), np.ones(len(mesh.vertices)))
    forces = forces_of(cases.box_problem(), mesh, state)
    expected = {"left": [-HEIGHT, 0], "right": [HEIGHT, 0], "roof": [0, LENGTH], "floor": [0, -LENGTH]}
    assert forces.parts.keys() == expected.keys()
    for part, force in expected.items():
        np.testing.assert_allclose(forces.parts[part].surface, force, rtol=0, atol=1e-14)
        np.testing.assert_allclose(forces.parts[part].residual, force, rtol=0, atol=1e-14)
    np.testing.assert_allclose(forces.total.residual, [0, 0], atol=1e-14)
    system = System.build(cases.channel_problem(), cases.channel_mesh())
    assert coefficient_scale(system) == pytest.approx(0.5 * DENSITY * MEAN_VELOCITY**2 * LENGTH, rel=1e-15)
    assert coefficient_scale(System.build(cases.channel_problem(mean_velocity=None), cases.channel_mesh())) is None
