"""Orders in time of the schemes, with manufactured fields that the elements hold exactly: every error is of time."""

import dataclasses

import numpy as np
import pytest
from manufactured import LAMBDA, MU, SOLID_DENSITY, SWINGING, Exact, beating, parabolas, planes, vector
from test_reference_manufactured import LAWS, assert_orders, both_system, fluid_system, nodal, solid_system
from test_reference_step import WRONG_FLUID, wrong_pressure

from ffsi.reference import terms
from ffsi.reference.materials import NeoHookean, StVenantKirchhoff
from ffsi.reference.problem import Solid
from ffsi.reference.solve import solve_step
from ffsi.reference.step import Step

pytestmark = pytest.mark.long

SCHEMES = {"crank-nicolson": lambda k: 0.5, "shifted": lambda k: 0.5 + k, "backward-euler": lambda k: 1.0}
ORDERS = {"crank-nicolson": 2, "shifted": 2, "backward-euler": 1}


def march(system, start, k, theta, count):
    state = start
    for number in range(1, count + 1):
        state = solve_step(system, state, Step(k, theta, number * k), tolerance=1e-9).state
    return state


def time_errors(system, exact, scheme, end=0.4, counts=(8, 16)):
    """Largest nodal errors at the end, (number of step sizes, 4): of u, v, p, ps.

    A pressure that is a multiplier has one value for the step, that of the time n + theta; that of a mixed solid is one
    at the end of the step.
    """
    compressible = any(solid.formulation == "mixed" for solid in system.problem.solids.values())
    errors = []
    for count in counts:
        k = end / count
        theta = SCHEMES[scheme](k)
        state = march(system, nodal(system, exact, 0.0), k, theta, count)
        final, between = nodal(system, exact, end), nodal(system, exact, end - k + theta * k)
        ps = final.ps if compressible else between.ps
        pairs = ((state.u, final.u), (state.v, final.v), (state.p, between.p), (state.ps, ps))
        errors.append([np.abs(found - expected).max(initial=0.0) for found, expected in pairs])
    return np.array(errors)


def sheared(x, t):
    """Displacement of a mesh that is stretched and that a parabola shears: J = 1 + swinging."""
    return SWINGING(t) * vector(x[:, 0] + x[:, 1] ** 2, 0.0)


def unsheared(place, t):
    """Reference points of places on the sheared mesh."""
    s, (x, y) = SWINGING(t), place.T
    return vector((x - s * y**2) / (1.0 + s), y)


def fluid_on_a_moving_mesh():
    """Quadratic velocity and linear pressure of X on a mesh that is sheared."""
    return Exact(
        u=sheared, velocity=lambda x, t: beating(t) * parabolas(unsheared(x, t)),
        p=lambda x, t: 5.0 * beating(t) * planes(unsheared(x, t)),
    )  # fmt: skip


def fluid_above_a_shear(solid_pressure=None):
    """Both are sheared by a linear displacement; the fluid flows at its own velocity but at the interface."""

    def displacement(x, t):
        return SWINGING(t) * vector(x[:, 1], 0.0)

    def solid_velocity(x, t):
        return SWINGING.rate(t) * vector(x[:, 1], 0.0)

    def velocity(place, t):
        x = place - displacement(place, t)
        return solid_velocity(x, t) + beating(t) * (x[:, 1:] - 0.5) * vector(1 + x[:, 0] - x[:, 1], 0.5 - x[:, 0])

    return Exact(
        u=displacement, velocity=velocity, p=lambda x, t: 5.0 * beating(t) * planes(x - displacement(x, t)),
        solid_velocity=solid_velocity, solid_pressure=solid_pressure,
    )  # fmt: skip


def pressed(x, t):
    return 4.0 * beating(t) * planes(x)


INCOMPRESSIBLE = Solid(SOLID_DENSITY, NeoHookean(np.inf, MU), "incompressible")


def swelling_solid():
    """Homogeneous deformation of a mixed solid: its pressure is a function of J, and neither depends on the place."""
    shape = np.array([[1.0, 0.4], [0.3, 0.8]])

    def pressure(x, t):
        jacobian = np.linalg.det(np.eye(2) + SWINGING(t) * shape)
        return np.broadcast_to(-LAMBDA * np.log(jacobian) / jacobian, x.shape[:1])

    exact = Exact(
        u=lambda x, t: SWINGING(t) * x @ shape.T, solid_velocity=lambda x, t: SWINGING.rate(t) * x @ shape.T,
        solid_pressure=pressure,
    )  # fmt: skip
    return solid_system(2, exact, Solid(SOLID_DENSITY, NeoHookean(LAMBDA, MU), "mixed")), exact


def sheared_solid():
    """An incompressible solid, sheared by a parabola, with a pressure that it is free to choose."""
    exact = Exact(
        u=lambda x, t: SWINGING(t) * vector(x[:, 1] ** 2, 0.0),
        solid_velocity=lambda x, t: SWINGING.rate(t) * vector(x[:, 1] ** 2, 0.0), solid_pressure=pressed,
    )  # fmt: skip
    return solid_system(2, exact, INCOMPRESSIBLE), exact


@pytest.mark.parametrize("scheme", SCHEMES)
def test_fluids_converge_in_time(scheme):
    exact = fluid_on_a_moving_mesh()
    errors = time_errors(fluid_system(2, exact), exact, scheme)
    assert_orders(errors[:, 1:3], 2 * [ORDERS[scheme]])
    # A linear velocity has the same shear rate everywhere: the viscosity depends on the time only.
    law, viscosity = LAWS["carreau"]
    exact = dataclasses.replace(
        fluid_on_a_moving_mesh(), u=lambda x, t: SWINGING(t) * vector(x[:, 0] + x[:, 1], 0.0),
        velocity=lambda x, t: beating(t) * vector(0.5 + 2.0 * x[:, 1], 0.3 * x[:, 0]),
        p=lambda x, t: 5.0 * beating(t) * planes(x), viscosity=viscosity,
    )  # fmt: skip
    errors = time_errors(fluid_system(2, exact, law), exact, scheme)
    assert_orders(errors[:, 1:3], 2 * [ORDERS[scheme]])
    # The implicit pressure is that of the time n + theta, to which the momentum of the step belongs.
    exact = Exact(
        u=lambda x, t: 0.0 * x + 0.0 * t, velocity=lambda x, t: beating(t) * parabolas(x),
        p=lambda x, t: beating(t) * planes(x),
    )  # fmt: skip
    errors = time_errors(fluid_system(2, exact), exact, scheme)
    assert_orders(errors[:, 1:3], 2 * [ORDERS[scheme]])


@pytest.mark.parametrize("scheme", SCHEMES)
def test_solid_converges_in_time(scheme):
    exact = Exact(
        u=lambda x, t: SWINGING(t) * parabolas(x), solid_velocity=lambda x, t: SWINGING.rate(t) * parabolas(x)
    )
    system = solid_system(2, exact, Solid(SOLID_DENSITY, StVenantKirchhoff(LAMBDA, MU)))
    errors = time_errors(system, exact, scheme)
    assert_orders(errors[:, :2], 2 * [ORDERS[scheme]])


@pytest.mark.parametrize("make", [swelling_solid, sheared_solid])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_solid_with_a_pressure_converges_in_time(make, scheme):
    errors = time_errors(*make(), scheme, counts=(16, 32))
    assert_orders(errors[:, :2], 2 * [ORDERS[scheme]])
    assert_orders_of_pressure(errors[:, 3], make is swelling_solid, scheme)


def assert_orders_of_pressure(errors, compressible, scheme):
    """That of an incompressible solid accelerates v, whose error alternates from step to step as J = 1 binds u only."""
    if compressible or scheme == "backward-euler":
        assert_orders(errors, ORDERS[scheme])
    else:
        assert np.log2(errors[0] / errors[1]) > 1.2


@pytest.mark.parametrize("scheme", SCHEMES)
def test_fluids_and_solids_converge_in_time(scheme):
    exact = fluid_above_a_shear()
    errors = time_errors(both_system(2, exact), exact, scheme)
    assert_orders(errors[:, :3], 3 * [ORDERS[scheme]])
    exact = fluid_above_a_shear(pressed)
    errors = time_errors(both_system(2, exact, solid=INCOMPRESSIBLE), exact, scheme)
    assert_orders(errors[:, :3], 3 * [ORDERS[scheme]])
    assert_orders_of_pressure(errors[:, 3], False, scheme)


@pytest.mark.parametrize(("wrong", "order"), [
    ("no mesh velocity", 0), ("J of the new state", 1), ("pressure on the new surface", 1),
])  # fmt: skip
def test_wrong_term_on_a_moving_mesh_lowers_the_order(wrong, order, monkeypatch):
    monkeypatch.setattr(terms, "fluid_step", WRONG_FLUID[wrong])
    exact = fluid_on_a_moving_mesh()
    errors = time_errors(fluid_system(2, exact), exact, "crank-nicolson", counts=(16, 32))
    assert_orders(errors[:, 1], order)


@pytest.mark.parametrize(("make", "formulation"), [(swelling_solid, "mixed"), (sheared_solid, "incompressible")])
def test_pressure_of_the_solid_on_the_new_surface_lowers_the_order(make, formulation, monkeypatch):
    monkeypatch.setattr(terms, "solid_step", wrong_pressure("new", formulation))
    assert_orders(time_errors(*make(), "crank-nicolson")[:, 0], 1)
