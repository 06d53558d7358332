"""Small structured cases which the tests of the reference checker share, and tests of their meshes."""

import dataclasses
import math

import numpy as np
from structured import structured_mesh

from ffsi.files.arrays import RawMesh, RawState
from ffsi.reference import check
from ffsi.reference import solve as solving
from ffsi.reference.conditions import Inflow, Outlet
from ffsi.reference.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Fluid, MeshMotion, Problem, Solid
from ffsi.reference.residual import compute_residual
from ffsi.reference.system import System
from ffsi.reference.viscosity import Newtonian

LENGTH, HEIGHT = 2.0, 1.0
MEAN_VELOCITY = 0.3
BLOCK = (0.75, 1.0, 0.5)  # left, right, top of the elastic block on the floor
ROOF = (0.5, 1.5, 0.25)  # left, right, thickness of the elastic part of the roof
ENDS = {0.0: 1, LENGTH: 2}  # labels of the left and the right one, by x
BUMP = (1.0, -0.3, 0.5)  # centre and radius of the circle whose top stands out of the floor


def profile(y):
    return 6.0 * MEAN_VELOCITY * y / HEIGHT * (1.0 - y / HEIGHT)


def flow_in(factor=None):
    """Inflow with the profile, times a function of the time."""
    return Inflow(lambda s, time: (factor(time) if factor else 1.0) * profile(s))


def in_block(x, y):
    return BLOCK[0] < x < BLOCK[1] and y < BLOCK[2]


def flap_mesh(n=8):
    """Channel with a block on its floor; n rectangles over the height."""

    def label(x, y):
        if x in ENDS:
            return ENDS[x]
        if y in (0.0, HEIGHT):
            return 6 if y == 0.0 and in_block(x, y) else 3
        return 5

    return structured_mesh(
        np.linspace(0, LENGTH, 2 * n + 1), np.linspace(0, HEIGHT, n + 1), lambda x, y: 1 + in_block(x, y), label
    )


def flap_problem(**changes) -> Problem:
    """The block bends by about a sixth of its height, so every nonlinearity counts."""
    values = dict(
        name="flap", fluid=Fluid(density=1.0, viscosity=Newtonian(0.02)),
        boundaries=(
            Boundary("inlet", 1, "inlet"), Boundary("outlet", 2, "outlet"), Boundary("walls", 3, "no-slip"),
            Boundary("surface", 5, "interface", part="flap"), Boundary("root", 6, "clamped"),
        ),
        solids={2: Solid(2.0, StVenantKirchhoff(60.0, 30.0))}, gravity=(0.01, -0.05), outlet=Outlet("do-nothing"),
        mesh_motion=MeshMotion(stiffness_exponent=1.0, divergence_weight=1.0), inflow=flow_in(),
        mean_velocity=MEAN_VELOCITY, reference_length=0.5,
    )  # fmt: skip
    return Problem(**(values | changes))


def roof_mesh(n=8):
    """Channel with a block on its floor and an elastic roof, regions 2 and 3; n rectangles over the height."""

    def label(x, y):
        if y > HEIGHT:
            return 11 if x in ROOF[:2] else 7
        if x in ENDS:
            return ENDS[x]
        if y == HEIGHT:
            return 10 if ROOF[0] < x < ROOF[1] else 3
        if y == 0.0:
            return 6 if in_block(x, y) else 3
        return 5

    def region(x, y):
        if y > HEIGHT:
            return 3 if ROOF[0] < x < ROOF[1] else 0
        return 1 + in_block(x, y)

    y = np.concatenate([np.linspace(0, HEIGHT, n + 1), HEIGHT + ROOF[2] * np.array([0.5, 1.0])])
    return structured_mesh(np.linspace(0, LENGTH, 2 * n + 1), y, region, label)


def roof_problem(**changes) -> Problem:
    """Two solids of different materials, both with a pressure of their own: the block and a softer roof."""
    boundaries = (
        *flap_problem().boundaries, Boundary("outer side", 7, "free"), Boundary("roof", 10, "interface"),
        Boundary("roof ends", 11, "clamped"),
    )  # fmt: skip
    solids = {
        2: Solid(2.0, NeoHookean(60.0, 30.0), "mixed"),
        3: Solid(1.0, MooneyRivlin(1.0, 0.6, math.inf), "incompressible"),
    }
    return flap_problem(**(dict(boundaries=boundaries, solids=solids) | changes))


def channel_mesh(nx=6, ny=4, grading=1.0, region=1) -> RawMesh:
    """Rectangle with the labels 1 left, 2 right, 3 top, 4 floor; ``grading`` above 1 narrows the cells to the floor."""
    x, y = np.linspace(0, LENGTH, nx + 1), HEIGHT * np.linspace(0, 1, ny + 1) ** grading
    return structured_mesh(x, y, lambda x, y: region, lambda x, y: ENDS.get(x) or (4 if y == 0.0 else 3))


def channel_problem(**changes) -> Problem:
    values = dict(
        name="channel", fluid=Fluid(density=1.3, viscosity=Newtonian(0.05)),
        boundaries=(
            Boundary("inlet", 1, "inlet"), Boundary("outlet", 2, "outlet"), Boundary("roof", 3, "no-slip"),
            Boundary("floor", 4, "no-slip", part="floor"),
        ),
        outlet=Outlet("do-nothing"), inflow=flow_in(), mean_velocity=MEAN_VELOCITY, reference_length=LENGTH,
    )  # fmt: skip
    return Problem(**(values | changes))


def box_problem(**changes) -> Problem:
    """Fluid in a box without open sides: every boundary node is constrained, every inner one has a row."""
    boundaries = tuple(
        Boundary(name, label, "no-slip", part=name)
        for label, name in enumerate(("left", "right", "roof", "floor"), start=1)
    )
    return channel_problem(boundaries=boundaries, **changes)


def bump_mesh(nx=16, ny=8) -> RawMesh:
    """Channel whose floor follows the top of a circle, label 5."""
    xc, yc, radius = BUMP
    half = np.sqrt(radius**2 - yc**2)
    x = np.concatenate(
        [
            np.linspace(0, xc - half, nx // 4 + 1),
            np.linspace(xc - half, xc + half, nx // 2 + 1)[1:-1],
            np.linspace(xc + half, LENGTH, nx // 4 + 1),
        ]
    )
    flat = structured_mesh(
        x, np.linspace(0, HEIGHT, ny + 1), lambda x, y: 1,
        lambda x, y: ENDS.get(x) or (3 if y == HEIGHT or abs(x - xc) > half else 5),
    )  # fmt: skip
    vx, vy = flat.vertices.T
    rise = np.maximum(yc + np.sqrt(np.maximum(radius**2 - (vx - xc) ** 2, 0.0)), 0.0)
    rise[np.isclose(abs(vx - xc), half)] = 0.0
    return dataclasses.replace(flat, vertices=np.column_stack([vx, vy + rise * (1.0 - vy / HEIGHT)]))


def bump_problem(**changes) -> Problem:
    boundaries = (
        Boundary("inlet", 1, "inlet"), Boundary("outlet", 2, "outlet"), Boundary("walls", 3, "no-slip"),
        Boundary("bump", 5, "no-slip", part="bump", circle=BUMP),
    )  # fmt: skip
    return channel_problem(boundaries=boundaries, **changes)


def cantilever_problem(**changes) -> Problem:
    """An elastic block, clamped at its left side, that sags under its weight."""
    values = dict(
        name="cantilever", fluid=None,
        boundaries=(
            Boundary("root", 1, "clamped"), Boundary("tip", 2, "free"), Boundary("top", 3, "free"),
            Boundary("bottom", 4, "free"),
        ),
        solids={2: Solid(1.5, StVenantKirchhoff(60.0, 30.0))}, gravity=(0.0, -1.0),
    )  # fmt: skip
    return Problem(**(values | changes))


def loaded_problem(**changes) -> Problem:
    boundaries = (Boundary("root", 1, "clamped"), Boundary("tip", 2, "loaded"), *cantilever_problem().boundaries[2:])
    return cantilever_problem(**(dict(boundaries=boundaries, gravity=(0.0, 0.0), traction=(1.5, -0.8)) | changes))


def state_of(mesh, u=None, v=None, p=None) -> RawState:
    """Nodal values of functions of the coordinates (n, 2); zero where none is given."""
    points = mesh.p2_coordinates
    return RawState(
        u=u(points) if u else np.zeros_like(points),
        v=v(points) if v else np.zeros_like(points),
        p=p(mesh.vertices) if p else np.zeros(len(mesh.vertices)),
    )


def check_state(problem, mesh, state, quantities, tolerance=check.TOLERANCE):
    return check.check_state(System.build(problem, mesh), state, quantities, tolerance)


def check_step(problem, mesh, old, new, step, quantities, tolerance=check.TOLERANCE, reservoir=0.0):
    system = System.build(problem, mesh).stepping(old, step, reservoir)
    return check.check_state(system, new, quantities, tolerance)


def assert_jacobian_is_the_derivative(system, state, change, step=1e-4, close=1e-6):
    """The Jacobian times a change of the state is the central difference of the residual, in the rows of each field."""

    def moved(t):
        new = solving.moved(state, change, t)
        return solving.residual_vector(system, new, compute_residual(system, new))

    expected = (moved(step) - moved(-step)) / (2.0 * step)
    found = solving.jacobian(system, state) @ np.concatenate([field.ravel() for field in change.fields])
    cuts = np.cumsum([field.size for field in state.fields])[:-1]
    for rows, wanted in zip(np.split(found, cuts), np.split(expected, cuts), strict=True):
        np.testing.assert_allclose(rows, wanted, rtol=0, atol=close * np.abs(wanted).max(initial=0.0))


def areas(mesh):
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 2, 0)
    return 0.5 * ((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])


def test_meshes_and_labels_cover_their_regions():
    mesh, block = flap_mesh(), (BLOCK[1] - BLOCK[0]) * BLOCK[2]
    np.testing.assert_allclose(areas(mesh)[mesh.region == 2].sum(), block, rtol=1e-14)
    np.testing.assert_allclose(areas(mesh)[mesh.region == 1].sum(), LENGTH * HEIGHT - block, rtol=1e-14)
    for other in (mesh, channel_mesh(grading=2.0), bump_mesh()):
        assert areas(other).min() > 0.0
    mesh = flap_mesh(8)
    lengths = np.linalg.norm(np.diff(mesh.vertices[mesh.edges], axis=1)[:, 0], axis=1)
    found = {int(label): float(lengths[mesh.label == label].sum()) for label in np.unique(mesh.label)}
    width, top = BLOCK[1] - BLOCK[0], BLOCK[2]
    expected = {1: HEIGHT, 2: HEIGHT, 3: 2 * LENGTH - width, 5: 2 * top + width, 6: width}
    assert found.keys() == expected.keys()
    for label, length in expected.items():
        np.testing.assert_allclose(found[label], length, rtol=1e-14)
    mesh = roof_mesh(4)
    left, right, thickness = ROOF
    np.testing.assert_allclose(areas(mesh)[mesh.region == 3].sum(), (right - left) * thickness, rtol=1e-14)
    lengths = np.linalg.norm(np.diff(mesh.vertices[mesh.edges], axis=1)[:, 0], axis=1)
    found = {label: lengths[mesh.label == label].sum() for label in (7, 10, 11)}
    assert found == {7: right - left, 10: right - left, 11: 2 * thickness}
    mesh = structured_mesh(
        np.linspace(0, 1, 5), np.linspace(0, 1, 5), lambda x, y: int(max(abs(x - 0.5), abs(y - 0.5)) > 0.25),
        lambda x, y: 1,
    )  # fmt: skip
    assert len(mesh.triangles) == 24 and (np.unique(mesh.triangles) == np.arange(len(mesh.vertices))).all()
    # V - E + F = 0 for a ring: E from the P2 nodes, which are vertices and edges.
    assert len(mesh.vertices) - (mesh.n_p2 - len(mesh.vertices)) + len(mesh.triangles) == 0
