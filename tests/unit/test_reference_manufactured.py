"""Method of manufactured solutions: the orders in space. The sources are those of tests/manufactured.py."""

import manufactured
import numpy as np
import pytest
from manufactured import DENSITY, LAMBDA, MU, SOLID_DENSITY, VISCOSITY, Exact, det, divergence, gradient, vector
from structured import structured_mesh

from ffsi.files.arrays import RawState
from ffsi.reference import terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.elements import Elements, gauss_rule, line_basis, scatter
from ffsi.reference.materials import NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Boundary, Fluid, Manufactured, MeshMotion, Problem, Solid
from ffsi.reference.solve import solve
from ffsi.reference.system import System, outline
from ffsi.reference.viscosity import Carreau, Casson, Newtonian, PowerLaw


def manufactured_of(exact, velocity, regions):
    fields = {1: (exact.fluid_force, exact.fluid_stress), 2: (exact.solid_force, exact.solid_stress)}

    def force(system):
        return -sum(work(system, region, *fields[region], 0.0) for region in regions)

    def mass(system):
        elements = system.fluid.elements
        points = points_of(system, elements)
        density = exact.mass(points.reshape(-1, 2), 0.0).reshape(points.shape[:2])
        return -scatter(
            ((density * elements.weights) @ elements.p1)[..., None], elements.vertices, len(system.mesh.vertices)
        )

    return Manufactured(exact.u, velocity, force, mass if 1 in regions else None)


def points_of(system, elements):
    """Quadrature points of the triangles, (n, 7, 2)."""
    return elements.p1 @ system.mesh.vertices[elements.vertices]


def work(system, region, force, stress, time):
    """Work (n2, 2) of a force per volume in a region and of the traction P N on the boundary of the region."""
    mesh, elements = system.mesh, (system.fluid if region == 1 else system.solids[region]).elements
    points = points_of(system, elements)
    values = force(points.reshape(-1, 2), time).reshape(points.shape)
    total = scatter(terms.against_value(values, elements), elements.nodes, mesh.n_p2)
    sides, (parameters, weights) = outline(mesh, region), gauss_rule()
    points = mesh.p2_coordinates[sides.nodes[:, :1]] + parameters[:, None] * sides.tangent[:, None]
    tensor = stress(points.reshape(-1, 2), time).reshape(*points.shape, 2)
    local = np.einsum("q,qa,nqij,nj->nai", weights, line_basis(parameters)[0], tensor, sides.normal)
    return total + scatter(local, sides.nodes, mesh.n_p2)


def fluid_system(n, exact, law=None):
    boundaries = (Boundary("walls", 1, "no-slip"), Boundary("outlet", 2, "outlet"))
    problem = Problem(
        name="fluid", fluid=Fluid(DENSITY, law or Newtonian(VISCOSITY)), boundaries=boundaries,
        outlet=Outlet("zero-traction"), manufactured=manufactured_of(exact, exact.v, [1]),
    )  # fmt: skip
    grid = np.linspace(0, 1, n + 1)
    return System.build(problem, structured_mesh(grid, grid, lambda x, y: 1, lambda x, y: 1 + (x == 1.0)))


def solid_system(n, exact, solid):
    boundaries = (Boundary("root", 6, "clamped"), Boundary("sides", 7, "free"))
    problem = Problem(
        name="solid", fluid=None, boundaries=boundaries, solids={2: solid},
        manufactured=manufactured_of(exact, exact.solid_velocity, [2]),
    )  # fmt: skip
    grid = np.linspace(0, 1, n + 1)
    return System.build(problem, structured_mesh(grid, grid, lambda x, y: 2, lambda x, y: 6 if x in (0, 1) else 7))


def both_system(n, exact, kind, slip):
    """Fluid above the height 1/2, solid below; the upper side is open, the lower one free; slip at the others."""

    def velocity(x, t):
        return np.where(x[:, 1:] < 0.5, exact.solid_velocity(x, t), exact.v(x, t))

    def label(x, y):
        if y in (0.0, 0.5, 1.0):
            return {0.0: 7, 0.5: 5, 1.0: 2}[y]
        return 1 if y > 0.5 else 6

    problem = Problem(
        name="both", fluid=Fluid(DENSITY, Newtonian(VISCOSITY)),
        boundaries=(
            Boundary("walls", 1, "slip" if slip else "no-slip"), Boundary("outlet", 2, "outlet"),
            Boundary("interface", 5, "interface"), Boundary("ends", 6, "slip" if slip else "clamped"),
            Boundary("floor", 7, "free"),
        ),
        solids={2: Solid(SOLID_DENSITY, StVenantKirchhoff(LAMBDA, MU))}, outlet=Outlet("zero-traction"),
        mesh_motion=MeshMotion(0.0, 0.7, kind), manufactured=manufactured_of(exact, velocity, [1, 2]),
    )  # fmt: skip
    grid = np.linspace(0, 1, n + 1)
    return System.build(problem, structured_mesh(grid, grid, lambda x, y: 1 + (y < 0.5), label))


def nodal(system, exact, t):
    nodes, vertices = system.mesh.p2_coordinates, system.mesh.vertices
    wet, p = system.rows.continuity, np.zeros(len(vertices))
    if exact.p is not None:
        p[wet] = exact.p(exact.place(vertices[wet], t), t)
    v, pressed = system.problem.manufactured.velocity(nodes, t), system.rows.incompressibility
    ps = exact.solid_pressure(vertices, t) * pressed if exact.solid_pressure is not None else np.zeros(pressed.shape)
    return RawState(exact.u(nodes, t), v, p, ps)


def l2_error(system, elements: Elements, values, function, linear=False):
    """L2 norm over some triangles of the difference between nodal values, of P2 or linear, and a function of X."""
    points = elements.p1 @ system.mesh.vertices[elements.vertices]
    found = elements.p1 @ values[elements.vertices][..., None] if linear else elements.basis @ values[elements.nodes]
    expected = function(points.reshape(-1, 2)).reshape(found.shape)
    return np.sqrt((((found - expected) ** 2).sum(axis=-1) * elements.weights).sum())


def assert_orders(errors, expected):
    """The last two of errors (sizes, quantities), after halving mesh or step, fall with the expected orders."""
    *_, coarse, fine = np.array(errors)
    np.testing.assert_allclose(np.log2(coarse / fine), expected, rtol=0, atol=0.25)


def vortices(x):
    return vector(np.sin(x[:, 0]) * np.cos(x[:, 1]), -0.8 * np.cos(x[:, 0]) * np.sin(x[:, 1]))


def hills(x):
    return np.cos(2 * x[:, 0] + 1.5 * x[:, 1]) * np.sin(x[:, 1])


def steady(field):
    return lambda x, t: field(x)


def test_differences_are_exact_and_let_a_complex_step_through():
    points = np.random.default_rng(1).uniform(size=(9, 2))
    x, y = points.T
    expected = np.stack(
        [vector(np.cos(x) * np.cos(y), -np.sin(x) * np.sin(y)),
         0.8 * vector(np.sin(x) * np.sin(y), -np.cos(x) * np.cos(y))],
        axis=1,
    )  # fmt: skip
    np.testing.assert_allclose(gradient(vortices, points), expected, rtol=0, atol=1e-13)
    # Both components are eigenfunctions of the Laplacian.
    laplacian = divergence(lambda z: gradient(vortices, z), points)
    np.testing.assert_allclose(laplacian, -2.0 * vortices(points), rtol=0, atol=1e-12)


# Laws of the checker, and their viscosities of the squared shear rate.
LAWS = {
    "newtonian": (Newtonian(VISCOSITY), lambda g2: VISCOSITY + 0 * g2),
    "carreau": (Carreau(0.3, 0.04, 9.0, -0.35), lambda g2: 0.04 + 0.26 * (1 + 9 * g2) ** -0.35),
    "power-law": (PowerLaw(0.08, 0.6, 0.1), lambda g2: 0.08 * (g2 + 0.01) ** -0.2),
    "casson": (Casson(0.02, 0.05, 0.1), lambda g2: (0.05**0.5 + 0.02**0.5 * (g2 + 0.01) ** -0.25) ** 2),
}


@pytest.mark.parametrize("name", LAWS)
def test_fluid_on_a_deformed_mesh_converges_in_space(name):
    law, viscosity = LAWS[name]
    exact = Exact(
        lambda x, t: 0.08 * manufactured.waves(x), velocity=steady(vortices), p=steady(hills), viscosity=viscosity
    )
    errors = []
    for n in (6, 12):
        system = fluid_system(n, exact, law)
        state = solve(system, start=nodal(system, exact, 0.0)).state
        elements = system.fluid.elements
        v = l2_error(system, elements, state.v, lambda x: exact.v(x, 0.0))
        p = l2_error(system, elements, state.p, lambda x: hills(exact.place(x, 0.0)), linear=True)
        errors.append([v, p])
    assert_orders(errors, [3, 2])


def test_solids_converge_in_space():
    exact = Exact(u=lambda x, t: 0.1 * manufactured.waves(x), solid_velocity=lambda x, t: 0.0 * x + 0.0 * t)
    errors = []
    for n in (6, 12):
        system = solid_system(n, exact, Solid(SOLID_DENSITY, StVenantKirchhoff(LAMBDA, MU)))
        state = solve(system, start=nodal(system, exact, 0.0)).state
        errors.append([l2_error(system, system.solids[2].elements, state.u, lambda x: 0.1 * manufactured.waves(x))])
    assert_orders(errors, [3])

    def pressure(x, t):
        jacobian = det(np.eye(2) + gradient(lambda z: 0.1 * manufactured.waves(z), x))
        return -LAMBDA * np.log(jacobian) / jacobian

    assert_orders(
        solid_errors(manufactured.waves, pressure, Solid(SOLID_DENSITY, NeoHookean(LAMBDA, MU), "mixed")), [3, 2]
    )

    def shear(x):
        return vector(3.0 * np.sin(1.5 * x[:, 1]), 0.0)

    solid = Solid(SOLID_DENSITY, NeoHookean(np.inf, MU), "incompressible")
    assert_orders(solid_errors(shear, lambda x, t: 4.0 * hills(x), solid), [3, 2])


def solid_errors(shape, pressure, solid):
    """L2 errors on two meshes of u, which is a tenth of ``shape``, and of the solid's pressure."""
    exact = Exact(lambda x, t: 0.1 * shape(x), solid_velocity=lambda x, t: 0.0 * x + 0.0 * t, solid_pressure=pressure)
    errors = []
    for n in (6, 12):
        system = solid_system(n, exact, solid)
        state, elements = solve(system, start=nodal(system, exact, 0.0)).state, system.solids[2].elements
        u = l2_error(system, elements, state.u, lambda x: 0.1 * shape(x))
        errors.append([u, l2_error(system, elements, state.ps[0], lambda x: pressure(x, 0.0), linear=True)])
    return errors


@pytest.mark.parametrize("slip", [False, True])
@pytest.mark.parametrize("kind", ["harmonic", "linear-elastic"])
def test_fluid_and_solid_converge_in_space(kind, slip):
    # The fluid rests at the interface, which the harmonic displacement bends: it is where X_2 = 1/2.
    def velocity(place, t):
        x = preimage(place)
        return (x[:, 1:] - 0.5) * waves(x)

    def preimage(place):
        x = place
        for _ in range(25):
            x = place - harmonic(x)
        return x

    def harmonic(x):
        """Gradient of a harmonic function: free of divergence, so it solves every linear mesh motion."""
        grown = 0.06 * np.exp(np.pi * (x[:, 1] - 1))  # along both sides, without shear there
        return vector(-np.sin(np.pi * x[:, 0]) * grown, np.cos(np.pi * x[:, 0]) * grown)

    def waves(x):
        """Zero across both sides."""
        return vector(np.sin(np.pi * x[:, 0]) * np.cos(x[:, 1]), np.cos(x[:, 0] - 1.2 * x[:, 1]))

    exact = Exact(steady(harmonic), velocity, steady(hills), solid_velocity=lambda x, t: 0.0 * x + 0.0 * t)
    errors = []
    for n in (6, 12):
        system = both_system(n, exact, kind, slip)
        state = solve(system, start=nodal(system, exact, 0.0)).state
        fluid, solid = system.fluid.elements, system.solids[2].elements
        u = np.hypot(*(l2_error(system, elements, state.u, harmonic) for elements in (fluid, solid)))
        v = l2_error(system, fluid, state.v, lambda x: (x[:, 1:] - 0.5) * waves(x))
        p = l2_error(system, fluid, state.p, lambda x: hills(exact.place(x, 0.0)), linear=True)
        errors.append([u, v, p])
    assert_orders(errors, [3.2 if slip else 3, 3, 2])  # of u before the largest error is that of the solid
