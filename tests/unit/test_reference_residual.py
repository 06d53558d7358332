"""Every term against exact flows and deformations; Newton from scratch: Jacobian, convergence, refusals."""

import dataclasses

import numpy as np
import pytest
import test_reference_cases as cases
from structured import structured_mesh
from test_reference_cases import HEIGHT, LENGTH, MEAN_VELOCITY, box_problem, channel_mesh, channel_problem, state_of

from ffsi.files.arrays import RawState
from ffsi.reference.conditions import Inflow, Outlet
from ffsi.reference.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Fluid, MeshMotion, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import ConvergenceError, damped_step, solve
from ffsi.reference.system import System
from ffsi.reference.viscosity import Newtonian

ANGLE = 0.6
ROTATION = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
STRETCH = np.diag([1.3, 0.8])
DEFORMATION = ROTATION @ STRETCH
DENSITY, VISCOSITY = 1.3, 0.05
# Where all terms of an equation vanish its scale is 1e-7 of what cancels in them.
ROUNDING = 2e-9


def deformed_state(mesh, velocity, pressure):
    """State on a mesh stretched and rotated by DEFORMATION; fields are given in the rotated frame's coordinates."""
    return state_of(
        mesh, u=lambda x: x @ (DEFORMATION - np.eye(2)).T, v=lambda x: velocity(x @ STRETCH) @ ROTATION.T,
        p=lambda x: pressure(x @ STRETCH),
    )  # fmt: skip


def relative(problem, mesh, state):
    return compute_residual(System.build(problem, mesh), state).relative


def test_flows_on_a_deformed_mesh_are_exact():
    height, mesh = STRETCH[1, 1] * HEIGHT, channel_mesh()
    state = deformed_state(
        mesh, velocity=lambda x: np.column_stack([x[:, 1] * (height - x[:, 1]), 0 * x[:, 1]]),
        pressure=lambda x: -2 * VISCOSITY * x[:, 0],
    )  # fmt: skip
    found = relative(box_problem(), mesh, state)
    assert max(found.values()) < 1e-13
    state.v[:] *= 1.001
    assert relative(box_problem(), mesh, state)["momentum"] > 1e-4
    # v = (a, b x) has the acceleration (0, a b); with gravity the pressure is rho (g . x - a b y).
    a, b, gravity = 0.7, 1.9, np.array([0.3, -0.8])
    turned = ROTATION @ gravity
    state = deformed_state(
        mesh, velocity=lambda x: np.column_stack([a + 0 * x[:, 0], b * x[:, 0]]),
        pressure=lambda x: DENSITY * (x @ gravity - a * b * x[:, 1]),
    )  # fmt: skip
    problem = box_problem(gravity=(turned[0], turned[1]))
    found = relative(problem, mesh, state)
    assert max(found.values()) < 1e-13
    for wrong in (dict(gravity=(0.0, 0.0)), dict(fluid=Fluid(2 * DENSITY, Newtonian(VISCOSITY)))):
        assert relative(dataclasses.replace(problem, **wrong), mesh, state)["momentum"] > 1e-2
    state = state_of(mesh, v=lambda x: np.column_stack([x[:, 0], -0.999 * x[:, 1]]))
    assert relative(box_problem(), mesh, state)["continuity"] == pytest.approx(1e-3, rel=1e-2)


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.0])
def test_do_nothing_outlet_holds_for_stagnation_flow_in_any_direction(turn):
    # v = (c x, -c y), p = mu c satisfies -p n + mu (grad v) n = 0 at a vertical outlet and solves Stokes.
    c, rotation = 0.4, np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    flat = channel_mesh()
    mesh = dataclasses.replace(flat, vertices=flat.vertices @ rotation.T)
    state = state_of(
        mesh, v=lambda x: (x @ rotation) * np.array([c, -c]) @ rotation.T, p=lambda x: np.full(len(x), VISCOSITY * c),
    )  # fmt: skip
    problem = channel_problem(fluid=Fluid(0.0, Newtonian(VISCOSITY)))
    assert relative(problem, mesh, state)["momentum"] < 1e-13
    # Free of traction is another condition: -p + 2 mu c = 0.
    open_end = dataclasses.replace(problem, outlet=Outlet("zero-traction"))
    assert relative(open_end, mesh, state)["momentum"] > 1e-2
    state.p[:] *= 2.0
    assert relative(open_end, mesh, state)["momentum"] < 1e-13


def test_linear_mesh_motion_is_its_energy_s_derivative_and_has_a_scale():
    # For a linear u, u . R(u) is twice the energy: the sum of alpha_K A_K (|H|^2 + beta (tr H)^2).
    exponent, weight = 1.5, 0.7
    problem, mesh = cases.flap_problem(mesh_motion=MeshMotion(exponent, weight)), graded_flap_mesh()
    gradient = np.array([[0.02, 0.11], [-0.05, 0.03]])
    state = state_of(mesh, u=lambda x: x @ gradient.T)
    rows = compute_residual(System.build(problem, mesh), state).equations["mesh_motion"].residual
    area = cases.areas(mesh)[mesh.region == 1]
    alpha = (area.max() / area) ** exponent
    expected = (alpha * area).sum() * ((gradient**2).sum() + weight * np.trace(gradient) ** 2)
    np.testing.assert_allclose((state.u * rows).sum(), expected, rtol=1e-13)
    assert area.max() / area.min() > 1.2
    assert relative(cases.flap_problem(), mesh, state)["mesh_motion"] > 1e-3
    mesh = cases.flap_mesh(4)
    state = state_of(mesh, u=lambda x: x @ gradient.T)
    assert relative(cases.flap_problem(), mesh, state)["mesh_motion"] < ROUNDING
    # Each component is an equation of its own: a scale by component would be the residual itself.
    state = state_of(mesh, u=lambda x: np.column_stack([x[:, 0] * x[:, 1], 0 * x[:, 0]]))
    problem = cases.flap_problem(mesh_motion=MeshMotion(0.0, 0.0))
    assert relative(problem, mesh, state)["mesh_motion"] < ROUNDING
    state = state_of(mesh, u=lambda x: np.column_stack([x[:, 0] ** 2, 0 * x[:, 0]]))
    assert relative(problem, mesh, state)["mesh_motion"] > 0.1


def _wiggle(points):
    """Displacement that leaves the outline of the channel and makes its triangles unequal."""
    return 0.2 * np.sin(3.0 * points[:, ::-1]) * points * np.array([LENGTH, HEIGHT] - points)


def graded_flap_mesh():
    mesh = cases.flap_mesh(4)
    return dataclasses.replace(mesh, vertices=mesh.vertices + _wiggle(mesh.vertices))


def test_hyperelastic_mesh_motion_is_the_derivative_of_its_energy():
    # The energy by its definition and its derivative by a complex step: neither knows the stress.
    exponent, weight = 1.5, 0.7
    problem, mesh = cases.flap_problem(mesh_motion=MeshMotion(exponent, weight, "hyperelastic")), graded_flap_mesh()
    system, rng = System.build(problem, mesh), np.random.default_rng(6)
    state = state_of(mesh, u=lambda x: 0.008 * rng.normal(size=x.shape))
    residual = compute_residual(system, state)
    assert 0.1 < residual.min_jacobian < 0.9
    elements, area = system.fluid.elements, cases.areas(mesh)[mesh.region == 1]
    alpha = (area.max() / area) ** exponent

    def energy(u):
        f = np.eye(2) + np.einsum("tai,tqaj->tqij", u[elements.nodes], elements.gradients)
        log = np.log(f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0])
        density = 0.5 * ((f**2).sum(axis=(2, 3)) - 2.0) - log + 0.5 * weight * log**2
        return (alpha[:, None] * elements.weights * density).sum()

    rows = residual.equations["mesh_motion"].residual
    for _ in range(5):
        direction = rng.normal(size=state.u.shape)
        expected = energy(state.u + 1e-30j * direction).imag / 1e-30
        assert (rows * direction).sum() == pytest.approx(expected, rel=1e-12)


def test_hyperelastic_mesh_motion_is_linear_elasticity_for_small_displacements():
    mesh, problem = graded_flap_mesh(), cases.flap_problem(mesh_motion=MeshMotion(1.0, 0.7, "hyperelastic"))
    for state in (
        state_of(mesh, u=lambda x: 0 * x + np.array([0.3, -0.2])),
        state_of(mesh, u=lambda x: x @ (ROTATION - np.eye(2)).T + np.array([0.3, -0.2])),
    ):
        equation = compute_residual(System.build(problem, mesh), state).equations["mesh_motion"]
        for term in equation.terms.values():
            np.testing.assert_allclose(term, 0.0, atol=1e-14)
    # The linear equation is not: a rotation by a finite angle strains it.
    assert relative(cases.flap_problem(), mesh, state)["mesh_motion"] > 1e-3
    weight, mesh = 0.7, graded_flap_mesh()
    rng, size = np.random.default_rng(7), 1e-8
    state = state_of(mesh, u=lambda x: size * rng.normal(size=x.shape))
    rows, expected = (
        compute_residual(System.build(cases.flap_problem(mesh_motion=motion), mesh), state).equations["mesh_motion"]
        for motion in (MeshMotion(1.0, weight, "hyperelastic"), MeshMotion(1.0, weight, "linear-elastic"))
    )
    np.testing.assert_allclose(rows.residual, expected.residual, rtol=0, atol=1e-5 * np.abs(expected.residual).max())
    mesh, problem = cases.flap_mesh(4), cases.flap_problem(mesh_motion=MeshMotion(1.0, 0.7, "hyperelastic"))
    state = state_of(mesh, u=lambda x: 0.05 * np.sin(3.0 * x[:, ::-1]) * x)
    equation = compute_residual(System.build(problem, mesh), state).equations["mesh_motion"]
    assert equation.terms.keys() == {"shape", "volume"}
    norms = {name: np.linalg.norm(term[equation.rows]) for name, term in equation.terms.items()}
    assert equation.scale(equation.rows) == pytest.approx(max(norms.values()), rel=1e-14)
    whole = np.linalg.norm((equation.terms["shape"] + equation.terms["volume"])[equation.rows])
    assert equation.relative == pytest.approx(whole / max(norms.values()), rel=1e-14)


def test_linear_elastic_mesh_motion_is_hookes_law():
    mesh, rng = graded_flap_mesh(), np.random.default_rng(8)
    state = state_of(mesh, u=lambda x: rng.normal(size=x.shape))
    system = System.build(cases.flap_problem(mesh_motion=MeshMotion(1.5, 0.7, "linear-elastic")), mesh)
    equation = compute_residual(system, state).equations["mesh_motion"]
    assert equation.terms.keys() == {"d/dx", "d/dy", "divergence", "transposed"}
    elements = system.fluid.elements
    gradient = np.einsum("tai,tqaj->tqij", state.u[elements.nodes], elements.gradients)
    strain = 0.5 * (gradient + gradient.swapaxes(2, 3))
    hooke = 2.0 * strain + 0.7 * np.trace(strain, axis1=2, axis2=3)[..., None, None] * np.eye(2)
    weights = elements.weights * (elements.area.max() / elements.area)[:, None] ** 1.5
    expected = np.zeros_like(equation.residual)
    np.add.at(expected, elements.nodes, np.einsum("tq,tqij,tqaj->tai", weights, hooke, elements.gradients))
    np.testing.assert_allclose(equation.residual, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    state = state_of(mesh, u=lambda x: x @ np.array([[0.0, -0.01], [0.01, 0.0]]).T + np.array([0.3, -0.2]))
    residual = compute_residual(system, state).equations["mesh_motion"].residual
    np.testing.assert_allclose(residual, 0.0, atol=1e-14)
    # The harmonic one has: its d/dx and d/dy parts do not cancel.
    assert relative(cases.flap_problem(mesh_motion=MeshMotion(1.5, 0.7)), mesh, state)["mesh_motion"] > 1e-3


def bar_of_three():
    """Three unit squares in a row, the middle one solid, and its problem's boundaries."""

    def label(x, y):
        if x in (1.0, 2.0):
            return 5
        return 6 if 1.0 < x < 2.0 else 3

    mesh = structured_mesh(np.arange(4.0), np.arange(2.0), lambda x, y: 1 + (1.0 < x < 2.0), label)
    boundaries = (Boundary("walls", 3, "no-slip"), Boundary("surface", 5, "interface"), Boundary("ends", 6, "clamped"))
    return mesh, boundaries


@pytest.mark.parametrize("kind", ["harmonic", "linear-elastic", "hyperelastic"])
def test_stiffness_by_the_distance_from_the_interface(kind):
    # The centroids nearest to it, (2/3, 1/3) and (7/3, 2/3), lie sqrt(5)/6 from the middle of its edge; the others,
    # (1/3, 2/3) and (8/3, 1/3), sqrt(17)/6. All areas are equal.
    mesh, boundaries = bar_of_three()
    rng, exponent = np.random.default_rng(9), 1.5
    state = state_of(mesh, u=lambda x: 0.02 * rng.normal(size=x.shape))
    rows, alpha = [], []
    for n in (0.0, exponent):
        problem = cases.flap_problem(boundaries=boundaries, mesh_motion=MeshMotion(1.0, 0.7, kind, n))
        system = System.build(problem, mesh)
        rows.append(compute_residual(system, state).equations["mesh_motion"].residual)
        alpha.append(system.fluid.alpha)
    np.testing.assert_array_equal(alpha[0], 1.0)
    near = mesh.vertices[system.fluid.elements.vertices].mean(axis=1)[:, 0]
    factor = np.where((near > 0.5) & (near < 2.5), (17.0 / 5.0) ** (exponent / 2.0), 1.0)
    np.testing.assert_allclose(alpha[1], factor, rtol=1e-14)
    # A node that only one triangle has: its row is that of n = 0 times the triangle's factor.
    nodes, count = np.unique(system.fluid.elements.nodes, return_counts=True)
    for node in nodes[count == 1]:
        triangle = np.flatnonzero((system.fluid.elements.nodes == node).any(axis=1))[0]
        np.testing.assert_allclose(rows[1][node], factor[triangle] * rows[0][node], rtol=1e-12, atol=1e-16)
    assert np.abs(rows[1] - rows[0]).max() > 0.1 * np.abs(rows[0]).max()


def test_kinematics_distance_and_smallest_jacobian():
    mesh, problem = cases.roof_mesh(4), cases.roof_problem(mesh_motion=MeshMotion(0.0, 1.0, "harmonic", 1.0))
    system = System.build(problem, mesh)
    nodes = np.unique(mesh.edge_nodes[np.isin(mesh.label, [5, 10])])
    centroids = mesh.vertices[system.fluid.elements.vertices].mean(axis=1)
    offset = centroids[:, None] - mesh.p2_coordinates[nodes]
    distance = np.hypot(*offset.transpose(2, 0, 1)).min(axis=1)
    np.testing.assert_allclose(system.fluid.alpha, distance.max() / distance, rtol=1e-13)
    mesh, problem = cases.flap_mesh(4), cases.flap_problem(mesh_motion=MeshMotion(1.0, 0.7, "hyperelastic"))
    state = state_of(mesh, u=lambda x: x * np.array([-1.5, 0.0]))
    assert relative(problem, mesh, state)["mesh_motion"] == np.inf
    state = state_of(mesh, p=lambda x: np.full(len(x), np.nan))
    assert relative(problem, mesh, state)["momentum"] == np.inf
    mesh = cases.flap_mesh(4)
    for squeezed in (0.4, 0.7):
        state = state_of(mesh, u=lambda x, s=squeezed: x * np.array([s - 1.0, 0.0]))
        found = compute_residual(System.build(cases.flap_problem(), mesh), state).min_jacobian
        assert found == pytest.approx(squeezed, rel=1e-13)
    state = state_of(mesh, v=lambda x: np.column_stack([4.0 + 0 * x[:, 0], 3.0 + 0 * x[:, 0]]))
    solid = np.unique(mesh.p2[mesh.region == 2])
    state.v[solid] = 0.0
    assert relative(cases.flap_problem(), mesh, state)["kinematics"] == 0.0
    state.v[solid[5]] = [0.0, -0.05]
    assert relative(cases.flap_problem(), mesh, state)["kinematics"] == pytest.approx(0.01)


def test_loads_of_solids_are_stress_weight_and_traction():
    problem, mesh = cases.cantilever_problem(gravity=(0.0, 0.0)), channel_mesh(region=2)
    gradient = np.array([[0.1, 0.3], [-0.2, 0.15]])
    state, system = state_of(mesh, u=lambda x: x @ gradient.T), System.build(problem, mesh)
    residual = compute_residual(system, state).equations["momentum"].residual
    outside = np.unique(mesh.edge_nodes)
    np.testing.assert_allclose(np.delete(residual, outside, axis=0), 0.0, atol=1e-13)
    deformation = np.eye(2) + gradient
    strain = 0.5 * (deformation.T @ deformation - np.eye(2))
    stress = deformation @ (60.0 * np.trace(strain) * np.eye(2) + 60.0 * strain)
    right = np.unique(mesh.edge_nodes[mesh.label == 2])
    inner = right[(mesh.p2_coordinates[right, 1] > 0) & (mesh.p2_coordinates[right, 1] < HEIGHT)]
    total = residual[inner].sum(axis=0)
    # Simpson's weights: a corner of the side carries a sixth of its last edge.
    np.testing.assert_allclose(total, stress[:, 0] * (HEIGHT - 2 * HEIGHT / 4 / 6), rtol=1e-13)
    mesh = channel_mesh(region=2)
    rows = compute_residual(System.build(cases.cantilever_problem(), mesh), state_of(mesh)).equations["momentum"].terms
    np.testing.assert_allclose(rows["gravity"].sum(axis=0), [0.0, 1.5 * LENGTH * HEIGHT], rtol=1e-14)
    mesh = channel_mesh()
    state = deformed_state(mesh, velocity=lambda x: 0 * x, pressure=lambda x: 0 * x[:, 0])
    rows = compute_residual(System.build(box_problem(gravity=(0.0, -2.0)), mesh), state).equations["momentum"].terms
    weight = DENSITY * 2.0 * np.linalg.det(DEFORMATION) * LENGTH * HEIGHT
    np.testing.assert_allclose(rows["gravity"].sum(axis=0), [0.0, weight], rtol=1e-14)
    mesh, load = channel_mesh(grading=1.5, region=2), (1.5, -0.8)
    problem = cases.loaded_problem(traction=load)
    equation = compute_residual(System.build(problem, mesh), state_of(mesh, u=lambda x: 0.1 * x)).equations["momentum"]
    found = equation.terms["traction"]
    np.testing.assert_allclose(found.sum(axis=0), -np.array(load) * HEIGHT, rtol=1e-14)
    # Its moment as well, by the linear function y.
    moment = (mesh.p2_coordinates[:, 1:] * found).sum(axis=0)
    np.testing.assert_allclose(moment, -np.array(load) * HEIGHT**2 / 2, rtol=1e-14)
    assert (found[mesh.p2_coordinates[:, 0] < LENGTH] == 0.0).all()
    equation = compute_residual(System.build(cases.cantilever_problem(), mesh), state_of(mesh)).equations["momentum"]
    assert "traction" not in equation.terms


def test_rows_and_prescribed_values():
    mesh = cases.flap_mesh(4)
    rows = System.build(cases.flap_problem(), mesh).rows
    solid = np.isin(np.arange(mesh.n_p2), mesh.p2[mesh.region == 2])
    x, y = mesh.p2_coordinates.T
    on_wall = (y == 0.0) | (y == HEIGHT)
    np.testing.assert_array_equal(rows.v_given, on_wall | (x == 0.0))
    np.testing.assert_array_equal(rows.u_given, on_wall | (x == 0.0) | (x == LENGTH))
    np.testing.assert_array_equal(rows.momentum, ~rows.v_given)
    np.testing.assert_array_equal(rows.kinematics, solid & ~rows.v_given)
    np.testing.assert_array_equal(rows.mesh_motion, ~solid & ~rows.u_given)
    np.testing.assert_array_equal(rows.continuity, ~rows.p_given)
    inside = (mesh.vertices[:, 0] > 0.75) & (mesh.vertices[:, 0] < 1.0) & (mesh.vertices[:, 1] < 0.5)
    np.testing.assert_array_equal(rows.p_given, inside)
    mesh, problem = cases.bump_mesh(), cases.bump_problem()
    rows = System.build(problem, mesh).rows
    assert rows.u_given.all()
    inlet = mesh.p2_coordinates[:, 0] == 0.0
    np.testing.assert_allclose(rows.prescribed.v[inlet, 0], cases.profile(mesh.p2_coordinates[inlet, 1]), rtol=1e-15)
    assert (rows.prescribed.v[~inlet] == 0.0).all() and (rows.prescribed.v[:, 1] == 0.0).all()
    *centre, radius = (1.0, -0.3, 0.5)
    middle = mesh.edge_nodes[mesh.label == 5, 2]
    moved = (mesh.p2_coordinates + rows.prescribed.u)[middle] - centre
    np.testing.assert_allclose(np.hypot(*moved.T), radius, rtol=1e-15)
    assert np.abs(rows.prescribed.u[middle]).max() > 1e-3
    assert (np.delete(rows.prescribed.u, middle, axis=0) == 0.0).all()
    mesh = channel_mesh()
    values = System.build(channel_problem(inflow=Inflow(lambda s, time: np.ones_like(s))), mesh).rows.prescribed.v[:, 0]
    x, y = mesh.p2_coordinates.T
    np.testing.assert_array_equal(values, (x == 0.0) & (y > 0.0) & (y < HEIGHT))
    mesh = channel_mesh(region=2)
    arc = Boundary("root", 1, "clamped", circle=(0.5, 0.5, np.hypot(0.5, 0.5)))
    boundaries = (arc, *cases.cantilever_problem().boundaries[1:])
    rows = System.build(cases.cantilever_problem(boundaries=boundaries), mesh).rows
    np.testing.assert_array_equal(rows.u_given, mesh.p2_coordinates[:, 0] == 0.0)
    assert (rows.prescribed.u == 0.0).all()


def test_an_inflow_keeps_its_flow_rate_whatever_its_walls_take_away():
    mesh = channel_mesh()
    edges = mesh.edge_nodes[mesh.label == 1]
    y = mesh.p2_coordinates[:, 1]

    def carried(profile):
        v = System.build(channel_problem(inflow=Inflow(lambda s, time: profile(s), kept=True)), mesh).rows.prescribed.v
        nodal = v[edges, 0]
        return np.abs(np.diff(y[edges[:, :2]])[:, 0]) @ (nodal @ [1, 1, 4]) / 6, nodal

    flow, nodal = carried(np.ones_like)
    assert flow == pytest.approx(HEIGHT, rel=1e-14)
    np.testing.assert_allclose(nodal[nodal > 0], 1 / (1 - 1 / (3 * len(edges))), rtol=1e-14)
    assert carried(lambda s: s**2 * (HEIGHT - s) ** 2)[0] == pytest.approx(HEIGHT**5 / 30, rel=1e-13)
    parabola = carried(lambda s: s * (HEIGHT - s))[1]
    np.testing.assert_allclose(parabola, y[edges] * (HEIGHT - y[edges]), rtol=1e-14, atol=1e-16)
    np.testing.assert_array_equal(carried(lambda s: s - HEIGHT / 2)[1].max(), y[edges][:, 2].max() - HEIGHT / 2)


def test_wrong_meshes_are_refused():
    mesh = channel_mesh()
    with pytest.raises(ValueError, match=r"the mesh has the regions \[1\], expected \[1, 2\]"):
        System.build(cases.flap_problem(), mesh)
    boundaries = channel_problem().boundaries
    with pytest.raises(
        ValueError, match=r"6 edges of the outer boundary have no boundary of the problem, labels \[4\]"
    ):
        System.build(channel_problem(boundaries=boundaries[:3]), mesh)
    with pytest.raises(ValueError, match=r"no edge of the mesh has the label \[9\]"):
        System.build(channel_problem(boundaries=(*boundaries, Boundary("ghost", 9, "free"))), mesh)
    round_roof = (*boundaries[:2], Boundary("roof", 3, "no-slip", circle=(1.0, 0.0, 1.0)), boundaries[3])
    with pytest.raises(ValueError, match=r"roof: a vertex is .* radii off the circle"):
        System.build(channel_problem(boundaries=round_roof), mesh)


@pytest.mark.parametrize(("changes", "message"), [
    (dict(fluid=None, solids={}), "neither a fluid nor a solid"),
    (dict(mesh_motion=None), "fluid and solid together need a mesh motion"),
    (dict(mesh_motion=MeshMotion(1.0, 1.0, "elastic")), "mesh motion 'elastic', accepted"),
    (dict(solids={1: cases.flap_problem().solids[2]}), "solid in region 1, solids start at 2"),
    (dict(boundaries=(Boundary("a", 3, "wall"),)), r"unknown boundary role \['wall'\]"),
    (dict(boundaries=(Boundary("a", 3, "free"), Boundary("b", 3, "free"))), "two boundaries have the same label"),
])  # fmt: skip
def test_incomplete_problems_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        cases.flap_problem(**changes)


# The counts that exact Newton achieves: a wrong Jacobian needs more.
POISEUILLE_ITERATIONS = 4
FLAP_ITERATIONS = 5
BUMP_ITERATIONS = 4
CANTILEVER_ITERATIONS = 6

KINDS = ["harmonic", "linear-elastic", "hyperelastic"]


@pytest.fixture(scope="module", params=KINDS)
def random_flap(request):
    mesh, rng = cases.flap_mesh(4), np.random.default_rng(4)
    state = RawState(
        u=0.005 * rng.normal(size=(mesh.n_p2, 2)),
        v=rng.normal(size=(mesh.n_p2, 2)),
        p=rng.normal(size=len(mesh.vertices)),
    )
    system = System.build(cases.flap_problem(mesh_motion=MeshMotion(1.5, 0.6, request.param, 0.8)), mesh)
    assert compute_residual(system, state).min_jacobian > 0.1
    return system, state


def test_jacobian_is_the_derivative_and_poiseuille_flow_exact(random_flap):
    system, state = random_flap
    rng = np.random.default_rng(5)
    change = RawState(*(rng.normal(size=field.shape) for field in state.fields))
    cases.assert_jacobian_is_the_derivative(system, state, change, 1e-6, 1e-7)
    mesh = channel_mesh()
    # The continuity's terms vanish in this flow, which leaves rounding of about 1e-10 of its scale.
    solution = solve(System.build(channel_problem(), mesh), tolerance=1e-9)
    x, y = mesh.p2_coordinates.T
    drop = 12.0 * 0.05 * MEAN_VELOCITY / HEIGHT**2
    np.testing.assert_allclose(solution.state.v, np.column_stack([cases.profile(y), 0 * x]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(solution.state.p, drop * (LENGTH - mesh.vertices[:, 0]), rtol=0, atol=1e-12)
    assert (solution.state.u == 0.0).all() and len(solution.steps) == POISEUILLE_ITERATIONS
    solution = solve(System.build(channel_problem(outlet=Outlet("zero-traction")), mesh))
    assert np.abs(solution.state.v[:, 1]).max() > 1e-2 * MEAN_VELOCITY
    solution = solve(System.build(cases.bump_problem(), cases.bump_mesh()))
    assert len(solution.steps) == BUMP_ITERATIONS and solution.residual.relative.keys() == {"momentum", "continuity"}


# The first two materials have the Lame constants 60 and 30 at rest; the last one hardly changes its volume.
@pytest.mark.parametrize(("changes", "iterations"), [
    *((dict(mesh_motion=MeshMotion(1.0, 1.0, kind, 0.5)), FLAP_ITERATIONS) for kind in KINDS),
    (dict(solids={2: Solid(2.0, NeoHookean(60.0, 30.0))}), FLAP_ITERATIONS),
    (dict(solids={2: Solid(2.0, MooneyRivlin(6.0, 9.0, 80.0))}), FLAP_ITERATIONS),
    (dict(solids={2: Solid(2.0, MooneyRivlin(6.0, 9.0, 800.0))}), FLAP_ITERATIONS + 1),
], ids=str)  # fmt: skip
def test_flap_converges_quadratically(changes, iterations):
    solution = solve(System.build(cases.flap_problem(**changes), cases.flap_mesh()), tolerance=1e-10)
    assert solution.steps == [1.0] * iterations and np.abs(solution.state.u).max() > 0.05
    # Quadratic: the digits double. 2.5 leaves room for the constant; a wrong Jacobian gives a factor of 1.
    *_, before, last = solution.corrections
    assert np.log(last) / np.log(before) > 1.6
    assert solution.residuals[-1] < 1e-10 < 1e-8 < solution.residuals[-2]


@pytest.mark.parametrize("traction", [None, (1.5, -0.8)], ids=["sags", "is pulled"])
def test_cantilever_makes_its_potential_energy_stationary(traction):
    # The energy knows nothing of the stress formula: its derivative by a complex step, in random directions.
    mesh = channel_mesh(nx=12, region=2)
    system = System.build(cases.loaded_problem(traction=traction) if traction else cases.cantilever_problem(), mesh)
    solution = solve(system)
    assert np.abs(solution.state.u).max() > 0.1 and (traction or len(solution.steps) == CANTILEVER_ITERATIONS)
    part = system.solids[2]
    # The load's work on the tip by Simpson's rule, edge by edge.
    tip = mesh.edge_nodes[mesh.label == 2]
    length = np.hypot(*np.diff(mesh.vertices[mesh.edges[mesh.label == 2]], axis=1)[:, 0].T)

    def potential(u):
        local = u[part.elements.nodes]
        gradient = np.einsum("tai,tqaj->tqij", local, part.elements.gradients)
        stored = (part.law.material.energy(gradient) * part.elements.weights).sum()
        if traction:
            return stored - (length[:, None] * ((u @ traction)[tip] @ np.diag([1.0, 1.0, 4.0])) / 6.0).sum()
        height = np.einsum("qa,ta->tq", part.elements.basis, local[..., 1])
        return stored + part.law.density * (height * part.elements.weights).sum()

    for seed in range(5):
        direction = np.random.default_rng(seed).normal(size=solution.state.u.shape)
        direction[system.rows.u_given] = 0.0
        at_solution = potential(solution.state.u + 1e-30j * direction).imag / 1e-30
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
    problem = cases.loaded_problem(boundaries=boundaries, solids={2: Solid(0.0, material)}, traction=(0.0, load))
    solution = solve(System.build(problem, mesh), tolerance=1e-8)
    tip = np.argmin(np.abs(mesh.p2_coordinates - [1.0, thickness / 2]).sum(axis=1))
    # This coarse mesh is a little too stiff: the differences halve with the element size.
    np.testing.assert_allclose(solution.state.u[tip], [-0.05643, 0.30172], rtol=5e-3)


def test_inverting_steps_and_too_few_iterations_are_refused():
    soft = {2: Solid(2.0, StVenantKirchhoff(4.0, 2.0))}
    with pytest.raises(ConvergenceError, match=r"every step turns a triangle inside out|not converged"):
        solve(System.build(cases.flap_problem(solids=soft), cases.flap_mesh()))
    system = System.build(cases.cantilever_problem(), channel_mesh(region=2))
    rest = state_of(system.mesh)
    squeeze = state_of(system.mesh, u=lambda x: -2.5 * x * np.array([1.0, 0.0]))
    state, residual, step = damped_step(system, rest, squeeze)
    assert step == 0.25
    np.testing.assert_array_equal(state.u, 0.25 * squeeze.u)
    assert residual.min_jacobian == pytest.approx(1.0 - 2.5 / 4, rel=1e-13)
    with pytest.raises(ConvergenceError, match="every step turns a triangle inside out"):
        damped_step(system, rest, RawState(1e4 * squeeze.u, squeeze.v, squeeze.p))
    with pytest.raises(ConvergenceError, match=r"flap: not converged, relative residuals \[.*, .*\]"):
        solve(System.build(cases.flap_problem(), cases.flap_mesh(4)), max_iterations=2)
    loose = tuple(dataclasses.replace(b, role="free") for b in cases.cantilever_problem().boundaries)
    assert loose[0] == Boundary("root", 1, "free")
    with pytest.raises(ConvergenceError):
        solve(System.build(cases.cantilever_problem(boundaries=loose), channel_mesh(region=2)))


@pytest.mark.parametrize("kind", KINDS)
def test_start_with_an_inverted_triangle_is_an_error(kind):
    system = System.build(cases.flap_problem(mesh_motion=MeshMotion(1.0, 1.0, kind)), cases.flap_mesh(4))
    start = state_of(system.mesh)
    start.u[np.flatnonzero(system.rows.mesh_motion)[0]] += 1.0
    with pytest.raises(ConvergenceError, match="the start turns a triangle inside out"):
        solve(system, start=start)


def test_starts_that_help_and_steps_that_invert():
    system = System.build(cases.flap_problem(mesh_motion=MeshMotion(1.0, 1.0, "hyperelastic")), cases.flap_mesh(4))
    squeeze = state_of(system.mesh, u=lambda x: -2.5 * x * np.array([1.0, 0.0]))
    _, residual, step = damped_step(system, state_of(system.mesh), squeeze)
    assert step == 0.25 and residual.min_jacobian == pytest.approx(1.0 - 2.5 / 4, rel=1e-13)
    assert np.isfinite(max(residual.relative.values()))
    system = System.build(cases.flap_problem(), cases.flap_mesh(4))
    first = solve(system)
    neighbour = System.build(cases.flap_problem(gravity=(0.01, -0.051)), system.mesh)
    again = solve(neighbour, start=first.state)
    assert len(again.steps) == 2 < len(first.steps) and np.abs(again.state.u - first.state.u).max() > 1e-6
    spoiled = RawState(first.state.u + 1e-3, first.state.v + 1e-3, first.state.p)
    np.testing.assert_allclose(solve(system, start=spoiled).state.u, first.state.u, rtol=0, atol=1e-11)
