"""The checker without dimensions: the same state in other units of length, mass and time has the same numbers.

The units differ by powers of two, so that not even a rounding differs; what has no size of its own, a fluid at rest
beside a high pressure, is judged like anything else.
"""

import dataclasses

import numpy as np
import pytest
import test_reference_cases as cases
from test_reference_conditions import vessel_problem
from test_reference_step import K, quantities_of

from ffsi.files.arrays import RawState
from ffsi.files.cycles import WallCycle
from ffsi.reference.conditions import Inflow, Outlet
from ffsi.reference.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff
from ffsi.reference.ordinary import weighted
from ffsi.reference.problem import Fluid, MeshMotion, Solid
from ffsi.reference.quantities import energies
from ffsi.reference.residual import compute_residual
from ffsi.reference.solve import solve
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.reference.viscosity import Carreau, Newtonian
from ffsi.reference.wall import Passage, cycle_difference, wall_shear

# Units of length, mass and time: each from a millionth to a million.
SMALL, LARGE = 2.0**-20, 2.0**20
UNITS = [
    *((SMALL, 1.0, 1.0), (LARGE, 1.0, 1.0), (1.0, SMALL, 1.0), (1.0, LARGE, 1.0), (1.0, 1.0, SMALL), (1.0, 1.0, LARGE)),
    *((SMALL, LARGE, SMALL), (LARGE, SMALL, LARGE), (SMALL, SMALL, LARGE)),
]


class Units:
    """What one metre, kilogram and second come to, and what is made of them."""

    def __init__(self, length, mass, time):
        self.length, self.mass, self.time = length, mass, time
        self.velocity, self.density = length / time, mass / length**3
        self.pressure = mass / (length * time**2)
        self.viscosity = self.pressure * time
        self.force = self.pressure * length
        self.flow = length * self.velocity

    def problem(self, problem):
        p = problem
        law = {
            StVenantKirchhoff: lambda m: StVenantKirchhoff(m.lame_lambda * self.pressure, m.lame_mu * self.pressure),
            NeoHookean: lambda m: NeoHookean(m.lame_lambda * self.pressure, m.lame_mu * self.pressure),
            MooneyRivlin: lambda m: MooneyRivlin(*(c * self.pressure for c in (m.c10, m.c01, m.bulk_modulus))),
        }
        solids = {
            region: Solid(s.density * self.density, law[type(s.material)](s.material), s.formulation)
            for region, s in p.solids.items()
        }
        scaled = {"solids": solids, "gravity": tuple(g * self.length / self.time**2 for g in p.gravity)}
        scaled["traction"] = tuple(t * self.pressure for t in p.traction)
        scaled["points"] = {name: tuple(x * self.length for x in point) for name, point in p.points.items()}
        scaled["boundaries"] = tuple(
            dataclasses.replace(b, circle=b.circle and tuple(x * self.length for x in b.circle)) for b in p.boundaries
        )
        if p.mean_velocity is not None:
            scaled["mean_velocity"] = p.mean_velocity * self.velocity
        if p.reference_length is not None:
            scaled["reference_length"] = p.reference_length * self.length
        if p.fluid is not None:
            v = p.fluid.viscosity
            if isinstance(v, Newtonian):
                viscosity = Newtonian(v.mu * self.viscosity)
            else:
                rest, infinity = v.rest * self.viscosity, v.infinity * self.viscosity
                viscosity = Carreau(rest, infinity, v.squared_time * self.time**2, v.exponent)
            scaled["fluid"] = Fluid(p.fluid.density * self.density, viscosity)
        if p.inflow is not None:
            velocity = p.inflow.velocity
            scaled["inflow"] = dataclasses.replace(
                p.inflow, velocity=lambda s, time: velocity(s / self.length, time / self.time) * self.velocity,
                start=tuple(x * self.length for x in p.inflow.start),
            )  # fmt: skip
        if (o := p.outlet) is not None:
            resistance, ramp = self.pressure / self.flow, o.ramp
            scaled["outlet"] = dataclasses.replace(
                o, pressure=o.pressure * self.pressure, resistance=o.resistance * resistance,
                distal=o.distal * resistance, compliance=o.compliance * self.time / resistance,
                ramp=ramp and (lambda time: ramp(time / self.time)),
            )  # fmt: skip
        if p.support is not None:
            stiffness = p.support.stiffness * self.pressure / self.length
            damping = p.support.damping * self.pressure / self.velocity
            scaled["support"] = dataclasses.replace(p.support, stiffness=stiffness, damping=damping)
        return dataclasses.replace(p, **scaled)

    def mesh(self, mesh):
        return dataclasses.replace(mesh, vertices=mesh.vertices * self.length)

    def state(self, state):
        p = self.pressure
        return RawState(state.u * self.length, state.v * self.velocity, state.p * p, state.ps * p)

    def step(self, step):
        return Step(step.k * self.time, step.theta, step.time * self.time)


def steady(problem, mesh):
    """A solved state, somewhat wrong everywhere, so that no number vanishes."""
    system = System.build(problem, mesh)
    return problem, mesh, noisy(system, solve(system, tolerance=1e-8).state, 1e-6)


def noisy(system, state, size, seed=3):
    rng = np.random.default_rng(seed)
    fields = (state.u, state.v, state.p, state.ps)
    return RawState(*(f + size * (np.abs(f).max(initial=0.0)) * rng.normal(size=f.shape) for f in fields))


BODY = {"names": {2: "flap"}, "points": {"tip": (1.0, 0.31), "probe": (0.8, 0.2)}}
STEADY = {
    "fluid": lambda: (cases.bump_problem(gravity=(0.1, -0.2), outlet=Outlet("resistance", 0.3, 2.0)),
        cases.bump_mesh()),
    "carreau": lambda: (cases.bump_problem(fluid=Fluid(1.1, Carreau(0.4, 0.05, 1.5, -0.3))), cases.bump_mesh()),
    "fsi": lambda: (cases.flap_problem(**BODY), cases.flap_mesh(6)),
    "hyperelastic": lambda: (cases.flap_problem(mesh_motion=MeshMotion(1.0, 0.8, "hyperelastic", 0.5)),
        cases.flap_mesh(6)),
    "solid": lambda: (cases.cantilever_problem(), cases.channel_mesh(nx=12, region=2)),
    "mixed": lambda: (vessel_problem(), cases.roof_mesh(4)),
}  # fmt: skip


def numbers_of(report):
    return {name: value for name, value in vars(report).items() if isinstance(value, float)}


@pytest.mark.parametrize("case", STEADY)
def test_steady_numbers_are_free_of_units(case):
    problem, mesh, state = steady(*STEADY[case]())
    quantities = {name: value * (1 + 1e-6) for name, value in quantities_of(System.build(problem, mesh), state).items()}
    expected = numbers_of(cases.check_state(problem, mesh, state, quantities))
    assert all(value > 1e-9 for value in expected.values())
    for units in map(Units, *zip(*UNITS, strict=True)):
        other, moved, there = units.problem(problem), units.mesh(mesh), units.state(state)
        system = System.build(other, moved)
        told = {name: value * (1 + 1e-6) for name, value in quantities_of(system, there).items()}
        assert numbers_of(cases.check_state(other, moved, there, told)) == pytest.approx(expected, rel=1e-10, abs=0)


@pytest.mark.parametrize("still", [False, True], ids=["moving", "still"])
def test_numbers_of_a_step_are_free_of_units(still):
    problem, mesh = vessel_problem(names={2: "block", 3: "roof"}), cases.roof_mesh(4)
    if still:  # nothing comes in
        problem = dataclasses.replace(problem, inflow=Inflow(lambda s, time: 0.0 * s))
    rng = np.random.default_rng(7)
    old = cases.state_of(mesh, u=lambda x: 1e-3 * rng.normal(size=x.shape), v=lambda x: rng.normal(size=x.shape))
    old = dataclasses.replace(old, ps=rng.normal(size=(2, len(mesh.vertices))))
    new, step, reservoir = (
        noisy(None, dataclasses.replace(old, p=rng.normal(size=old.p.shape)), 1e-2), Step(K, 0.6, 3 * K), 0.7,
    )  # fmt: skip

    def found(units):
        there = units.problem(problem), units.mesh(mesh), units.state(old), units.state(new), units.step(step)
        system = System.build(*there[:2]).stepping(there[2], there[4], reservoir * units.pressure)
        quantities = {name: 1.001 * value for name, value in quantities_of(system, there[3]).items()}
        report = cases.check_step(*there, quantities, reservoir=reservoir * units.pressure)
        energy = energies(system, there[3], {"elastic": 0.0, "dissipated": 0.0})
        shear = wall_shear(system, there[3])
        passage = Passage(step.start * units.time, step.time * units.time, shear, shear)
        cycle = WallCycle(
            1, passage.start, passage.end, shear.nodes, *passage.integrals(passage.start, passage.end),
            1.01 * shear.size,
        )  # fmt: skip
        return numbers_of(report) | {
            "energy": energy["kinetic"].value / (units.force * units.length),
            "elastic": energy["elastic"].scale / (units.force * units.length),
            "cycle": cycle_difference(cycle, [passage]),
            "correction": weighted(system, there[3], noisy(None, there[3], 1e-3)),
        }

    expected = found(Units(1.0, 1.0, 1.0))
    for units in UNITS:
        assert found(Units(*units)) == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("units", UNITS)
def test_noise_of_a_rest_is_no_error_and_a_motion_is(units):
    units, still = Units(*units), Inflow(lambda s, time: 0.0 * s)
    stiff = {2: Solid(2.0, StVenantKirchhoff(60e9, 30e9))}
    rest, mesh = (
        cases.flap_problem(inflow=still, gravity=(0.0, 0.0), outlet=Outlet("pressure", 1e5), solids=stiff),
        cases.flap_mesh(6),
    )
    for size, passes in ((1e-13, True), (1e-4, False)):
        rng = np.random.default_rng(5)
        noise = size * rng.normal(size=(mesh.n_p2, 2)) * ~System.build(rest, mesh).rows.v_given[:, None]
        level = RawState(0.0 * noise, noise, np.full(len(mesh.vertices), 1e5))
        report = cases.check_state(units.problem(rest), units.mesh(mesh), units.state(level), {})
        assert (max(report.continuity, report.kinematics) <= 1e-8) == passes


def test_neither_pressure_nor_density_hides_what_is_wrong():
    for level in (0.0, 1e4, 1e8):
        problem, mesh = cases.channel_problem(outlet=Outlet("pressure", level)), cases.channel_mesh()
        state = solve(System.build(cases.channel_problem(outlet=Outlet("pressure", 0.0)), mesh), tolerance=1e-9).state
        high = dataclasses.replace(state, p=state.p + level)
        found = compute_residual(System.build(problem, mesh), high).relative
        assert found["momentum"] < 1e-8
        wrong = dataclasses.replace(high, v=high.v.copy())
        free = np.flatnonzero(System.build(problem, mesh).rows.momentum)
        wrong.v[free[len(free) // 2]] += 1e-5
        changed = compute_residual(System.build(problem, mesh), wrong).relative
        assert changed["momentum"] > 1e-6 or level == 1e8
        assert changed["continuity"] > 1e-6
    problem, mesh = cases.flap_problem(), cases.flap_mesh(6)
    heavy = dataclasses.replace(problem, solids={2: Solid(2e9, StVenantKirchhoff(60e9, 30e9))})
    system = System.build(heavy, mesh)
    state = solve(system, tolerance=1e-9).state
    wrong = dataclasses.replace(state, v=state.v.copy())
    inside = np.flatnonzero(system.rows.mesh_motion)
    wrong.v[inside[len(inside) // 2]] += 1e-6
    assert compute_residual(system, wrong).relative["momentum"] > 1e-8
