"""Forces against exact flows, on deformed meshes, and against the balance of momentum."""

import numpy as np
import pytest
from test_reference_cases import (
    HEIGHT,
    LENGTH,
    MEAN_VELOCITY,
    box_problem,
    bump_mesh,
    bump_problem,
    channel_mesh,
    channel_problem,
    flap_mesh,
    flap_problem,
    state_of,
)
from test_reference_residual import DEFORMATION, DENSITY, ROTATION, STRETCH, VISCOSITY, deformed_state

from ffsi.files.arrays import RawState
from ffsi.reference.forces import coefficient_scale, compute_forces
from ffsi.reference.problem import Boundary
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve
from ffsi.reference.system import System


def forces_of(problem, mesh, state):
    system = System.build(problem, mesh)
    return compute_forces(system, state, compute_residual(system, state))


@pytest.fixture(scope="module")
def flap():
    mesh = flap_mesh()
    system = System.build(flap_problem(), mesh)
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
    gravity, mesh = np.array([0.3, -0.8]), channel_mesh()
    acceleration, b, state = shear_flow(mesh, gravity)
    turned = ROTATION @ gravity
    forces = forces_of(box_problem(gravity=(turned[0], turned[1])), mesh, state)
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
    total = getattr(forces_of(box_problem(gravity=(turned[0], turned[1])), mesh, state).total, form)
    mass = DENSITY * np.linalg.det(DEFORMATION) * LENGTH * HEIGHT
    expected = mass * (gravity - np.array([0.0, acceleration]))
    np.testing.assert_allclose(ROTATION.T @ total, expected, rtol=1e-12)


def test_poiseuille_drag_of_the_floor_needs_the_rest_edges():
    mesh, problem = channel_mesh(), channel_problem()
    system, slope = System.build(problem, mesh), 6.0 * MEAN_VELOCITY / HEIGHT
    state = state_of(
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
    everything = System.build(flap_problem(boundaries=boundaries), system.mesh)
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
    alone = System.build(flap_problem(gravity=(0.0, 0.0)), system.mesh)
    return compute_residual(system, state).fluid_force - compute_residual(alone, state).fluid_force


def test_both_forms_approach_each_other_and_parts_add_up():
    found = []
    for n in (4, 8, 16):
        system = System.build(bump_problem(), bump_mesh(2 * n, n))
        solution = solve(system)
        force = compute_forces(system, solution.state, solution.residual).total
        found.append((force.surface[0], force.residual[0]))
    surface, residual = np.array(found).T
    gap = np.abs(surface - residual)
    assert (gap[1:] < gap[:-1] / 3.0).all()
    assert abs(residual[0] - residual[2]) < 0.15 * abs(surface[0] - residual[2])
    mesh = channel_mesh()
    state = RawState(np.zeros((mesh.n_p2, 2)), np.zeros((mesh.n_p2, 2)), np.ones(len(mesh.vertices)))
    forces = forces_of(box_problem(), mesh, state)
    expected = {"left": [-HEIGHT, 0], "right": [HEIGHT, 0], "roof": [0, LENGTH], "floor": [0, -LENGTH]}
    assert forces.parts.keys() == expected.keys()
    for part, force in expected.items():
        np.testing.assert_allclose(forces.parts[part].surface, force, rtol=0, atol=1e-14)
        np.testing.assert_allclose(forces.parts[part].residual, force, rtol=0, atol=1e-14)
    np.testing.assert_allclose(forces.total.residual, [0, 0], atol=1e-14)
    system = System.build(channel_problem(), channel_mesh())
    assert coefficient_scale(system) == pytest.approx(0.5 * DENSITY * MEAN_VELOCITY**2 * LENGTH, rel=1e-15)
    assert coefficient_scale(System.build(channel_problem(mean_velocity=None), channel_mesh())) is None
