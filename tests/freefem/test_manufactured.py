"""Manufactured solutions through FreeFEM: orders in space and time of the ALE fluid, of solids, and of both."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import manufactured
import numpy as np
import pytest
from conftest import scene_of
from manufactured import DENSITY, LAMBDA, MU, SOLID_DENSITY, SWINGING, VISCOSITY, Exact, Swing, beating, det, vector
from told import FLUID, SOLID, Solution, both_mesh, replaced, solid_mesh, told, write

from ffsi.files.arrays import read_mesh, read_state
from ffsi.freefem import run_script
from ffsi.scene import Scene

WEIGHT = 0.7
LAW = f"density={SOLID_DENSITY}, lame_mu={MU}"
SOLIDS = {
    "st-venant-kirchhoff": f'{{material="st-venant-kirchhoff", {LAW}, lame_lambda={LAMBDA}}}',
    "mixed": f'{{material="neo-hookean", formulation="mixed", {LAW}, lame_lambda={LAMBDA}}}',
    "incompressible": f'{{material="neo-hookean", formulation="incompressible", {LAW}}}',
}
FLUIDS = {
    "newtonian": f"{{density={DENSITY}, viscosity={VISCOSITY}}}",
    "carreau": f'{{law="carreau", density={DENSITY}, viscosity_zero=0.3, viscosity_infinity=0.04, '
    "time_constant_squared=9.0, exponent=-0.35}",
}
BOTH = (
    f"solid.flap={SOLIDS['st-venant-kirchhoff']}",
    *("mesh_motion.kind=harmonic", "mesh_motion.stiffness_exponent=0", f"mesh_motion.divergence_weight={WEIGHT}"),
    *("inflow.mean_velocity=1", "inflow.ramp=1"),  # the scale of the corrections, and no impulsive start
)


def solid(swing: Swing, field: Callable, pressure: Callable | None = None) -> Solution:
    exact = Exact(
        u=lambda x, t: swing(t) * field(x), solid_velocity=lambda x, t: swing.rate(t) * field(x),
        solid_pressure=pressure,
    )  # fmt: skip
    return Solution({SOLID: exact})


def both(
    swing: Swing,
    shape: Callable,
    slope: Callable,
    parts: Mapping[int, Callable],
    stream: Callable,
    stream_gradient: Callable,
    pressure: Callable,
) -> Solution:
    """Exact fields above and below the interface y = S(t) shape(x), which is Y = 0 in the reference domain.

    Fluid and solid are displaced by S (0, shape) + S Y part. The fluid's velocity is free of divergence: that of the
    interface, and the curl of (y - S shape)^2 times a stream function. Velocities agree on the interface, tractions
    jump.
    """

    def field(region):
        return lambda x: vector(0.0 * x[:, 0], shape(x[:, 0])) + x[:, 1:] * parts[region](x)

    def velocity(place, t):
        x, y = place.T
        above = y - swing(t) * shape(x)
        value, (by_x, by_y) = stream(place), stream_gradient(place)
        curl = vector(
            2 * above * value + above**2 * by_y, 2 * above * swing(t) * slope(x) * value - above**2 * by_x,
        )  # fmt: skip
        return vector(0.0 * x, swing.rate(t) * shape(x)) + beating(t) * curl

    fluid = Exact(
        u=lambda x, t: swing(t) * field(FLUID)(x), velocity=velocity, p=lambda place, t: beating(t) * pressure(place),
    )  # fmt: skip
    return Solution({FLUID: fluid, **solid(swing, field(SOLID)).exact}, WEIGHT)


def stretch(x):
    return vector(0.9 * x[:, 0] + 0.5 * x[:, 1], 0.4 * x[:, 1] - 0.6 * x[:, 0])


def pressure_of_stretch(x, t):
    """Pressure of the mixed neo-Hookean solid, the same at all points."""
    jacobian = det(np.eye(2) + SWINGING(t) * np.array([[[0.9, 0.5], [-0.6, 0.4]]]))
    return -LAMBDA * np.log(jacobian) / jacobian + 0.0 * x[:, 0]


def planes_above(stream: Callable, gradient: tuple[float, float]) -> Solution:
    """Linear displacements, a linear pressure, a velocity of one degree more than the stream function."""
    return both(
        SWINGING, shape=lambda x: 0.3 + 0.8 * x, slope=lambda x: 0.8 + 0.0 * x,
        parts={FLUID: lambda x: vector(0.6 + 0.0 * x[:, 0], 1.6), SOLID: lambda x: vector(-0.5 + 0.0 * x[:, 0], 0.7)},
        stream=stream, stream_gradient=lambda x: gradient, pressure=lambda x: 5.0 * manufactured.planes(x),
    )  # fmt: skip


def thinning(solution: Solution) -> Solution:
    """The same fields of a shear-thinning fluid."""
    law = {"viscosity": lambda squared: 0.04 + 0.26 * (1.0 + 9.0 * squared) ** -0.35, "far_viscosity": 0.04}
    return replace(solution, exact={**solution.exact, FLUID: replace(solution.exact[FLUID], **law)})


# In space. Without displacement at the start its interpolant is at equilibrium; another one, whose strain is of second
# order only, would set the solid in motion.
AT_REST = Swing(0.0)
WAVES = {
    "solid": solid(AT_REST, lambda x: 0.5 * manufactured.waves(2 * x)),
    "both": both(AT_REST, shape=lambda x: np.sin(2 * x + 0.4), slope=lambda x: 2 * np.cos(2 * x + 0.4),
        parts={FLUID: lambda x: manufactured.waves(x)[:, ::-1], SOLID: manufactured.waves},
        stream=lambda x: np.cos(1.2 * x[:, 0] - 0.7 * x[:, 1]),
        stream_gradient=lambda x: np.array([[-1.2], [0.7]]) * np.sin(1.2 * x[:, 0] - 0.7 * x[:, 1]),
        pressure=lambda x: 2.0 * np.cos(2 * x[:, 0] + 1.5 * x[:, 1]) * np.sin(1.0 + x[:, 1])),
}  # fmt: skip
# In time: fields that the elements hold exactly, so that every error is one of time.
EXACT = {
    "solid": solid(SWINGING, manufactured.parabolas),
    "both": planes_above(lambda x: 1.0 + 0.4 * x[:, 0] - 0.6 * x[:, 1], (0.4, -0.6)),
    # A parabola shears: J = 1, linear F.
    "incompressible": solid(SWINGING, lambda x: vector(x[:, 1] ** 2, 0.0 * x[:, 0]),
        lambda x, t: 5.0 * beating(t) * manufactured.planes(x)),
    "mixed": solid(SWINGING, stretch, pressure_of_stretch),
}  # fmt: skip
# A fluid on a mesh that moves as told: the same with all of the solid prescribed.
TOLD_MESH = ("fluid", "carreau")
COUPLED = ("both", "hyperelastic")
WAVES["fluid"], WAVES["carreau"] = WAVES["both"], thinning(WAVES["both"])
for fields in (WAVES, EXACT):
    stiff = replace(fields["both"].exact[FLUID], hyperelastic_mesh=True)
    fields["hyperelastic"] = replace(fields["both"], exact={**fields["both"].exact, FLUID: stiff})
# The shear rate of a linear velocity is the same at all points.
EXACT["fluid"], EXACT["carreau"] = EXACT["both"], thinning(planes_above(lambda x: 1.0 + 0.0 * x[:, 0], (0.0, 0.0)))


def scene_in_time(kind: str, k: float, end: float, *settings: str) -> Scene:
    time = (f"time.step={k!r}", f"time.end={end!r}", "solver.step_tolerance=1e-10", *settings)
    if kind in COUPLED or kind in TOLD_MESH:
        motion = ["mesh_motion.kind=hyperelastic"] if kind == "hyperelastic" else []
        return scene_of("flap-svk", f"fluid={FLUIDS.get(kind, FLUIDS['newtonian'])}", *BOTH, *motion, *time)
    law = SOLIDS.get(kind, SOLIDS["st-venant-kirchhoff"])
    return scene_of("cantilever", f"solid.beam={law}", "traction.y=0", *time)


@pytest.fixture
def errors_of(installation, tmp_path) -> Callable[..., dict[tuple[int, str], float]]:
    """Run from 0 to the end in so many steps; return the L2 errors there by region and field."""

    def errors_of(kind, solution, n, steps, *settings, end, mutation=()):
        k = end / steps
        scene = scene_in_time(kind, k, end, *settings)
        text = told(scene, hold=kind in TOLD_MESH)
        for right, wrong in mutation:
            text = replaced(text, right, wrong)
        out = tmp_path / f"{n}-{steps}"
        out.mkdir()
        (out / "case.edp").write_text(text, encoding="utf-8")
        write(out, solution, both_mesh(n) if scene.fluid else solid_mesh(n), np.linspace(0, end, steps + 1))
        done = run_script(
            out / "case.edp", {"out": out}, installation=installation, log=out / "log", cwd=out, time_limit=60
        )
        assert done.status == "converged", done.reason
        mesh = read_mesh(out / "mesh.bin")
        # An implicit pressure is that of t_n + theta k, one that follows from J is that of the end.
        between = end if kind == "mixed" else end - k + scene.time.theta_of(k) * k
        errors = solution.errors(mesh, read_state(out / "point-0001.bin", mesh), end, between)
        if kind in TOLD_MESH:
            del errors[SOLID, "u"], errors[SOLID, "v"]
        return errors

    return errors_of


def orders(coarse, fine):
    """Orders by region and field from a run to one of half the size or step, where errors are more than rounding."""
    return {key: float(np.log2(coarse[key] / fine[key])) for key in fine if coarse[key] > 1e-12}


def orders_in_time(errors_of, kind, *settings, mutation=()):
    runs = [errors_of(kind, EXACT[kind], 2, steps, *settings, end=0.4, mutation=mutation) for steps in (8, 16)]
    return orders(*runs)


@pytest.mark.parametrize("kind", WAVES)
def test_orders_in_space(kind, errors_of):
    runs = [errors_of(kind, WAVES[kind], n, steps, end=0.2) for n, steps in ((4, 10), (8, 20))]
    found = orders(*runs)
    assert found == pytest.approx({key: 2 if key[1] == "p" else 3 for key in found}, abs=0.25)


@pytest.mark.parametrize(("scheme", "order"), [("shifted-crank-nicolson", 2), ("backward-euler", 1)])
@pytest.mark.parametrize("kind", EXACT)
def test_orders_in_time(kind, scheme, order, errors_of):
    # The volume of an incompressible solid is a condition on u. Without damping its pressure would alternate from the
    # first step on, with an amplitude of order 1.
    shift = ["time.shift=3"] if kind == "incompressible" else []
    found = orders_in_time(errors_of, kind, f"time.scheme={scheme}", *shift)
    assert found == pytest.approx(dict.fromkeys(found, order), abs=0.2)


def test_newtons_method_solves_the_same_steps(errors_of):
    found = orders_in_time(errors_of, "both", "time.scheme=crank-nicolson", "solver.step=newton")
    assert found == pytest.approx(dict.fromkeys(found, 2), abs=0.2)


def new_gradients(*pairs):
    """The pressure's surface at the end of the step instead of its mean."""
    return [(f"work = timeTheta*{new}; work += {old};", f"work = {new};") for new, old in pairs]


# Kind, what is made of the script, largest order that the worst field may still have.
MUTATIONS = {
    "pressure on the new surface": ("both",
        new_gradients(("F11", "oldF11"), ("F22", "oldF22"), ("a(:, DXUY)", "oldF21"), ("a(:, DYUX)", "oldF12")), 1.2),
    "pressure of a solid on its new surface": ("incompressible",
        [("G(:, k) *= timeTheta; G(:, k) += solidOldGradient[s](:, k);", "G(:, k) *= 1;")], 1.2),
    "no mesh velocity": ("both", [(f"meshV{c} *= 1/timeK;", f"meshV{c} = 0;") for c in "XY"], 0.2),
    "J of the new state": ("both",
        [("work = fluidDensity*(1-timeTheta)*oldJ;", "work = fluidDensity*(1-timeTheta)*fluidJ;")], 1.7),
    "stress of the new state": ("solid", [("solidSecond[s] *= timeTheta; solidSecond[s] += solidOldSecond[s];", "")],
        1.2),
    "no outlet's term of the old state": ("both", [("(outletXY, 1-timeTheta,", "(outletXY, 0,")], 0.5),
    "convection": ("both", [("S11 += G12.*relativeY;", "S11 -= G12.*relativeY;")], 0.2),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "mutation", "most"), MUTATIONS.values(), ids=MUTATIONS)
def test_an_error_in_the_script_lowers_the_order(kind, mutation, most, errors_of):
    found = orders_in_time(errors_of, kind, mutation=mutation)
    assert min(found.values()) < most
