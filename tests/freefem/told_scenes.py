"""Exact solutions of every term, and the scenes that have them: what test_manufactured runs."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import manufactured
import numpy as np
from manufactured import DENSITY, LAMBDA, MU, SOLID_DENSITY, SWINGING, VISCOSITY, Exact, Swing, beating, det, vector
from own_mesh import scene_on, write_mesh
from structured import structured_mesh
from told import CLAMPED, FLUID, INLET, INTERFACE, OPEN, OUTLET, SOLID, UPPER, WALL, Solution, both_mesh, solid_mesh

from ffsi.files.arrays import RawMesh
from ffsi.scene import Scene

WEIGHT = 0.7


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
stiff, thin = ({"hyperelastic_mesh": True}, {
    "viscosity": lambda squared: 0.04 + 0.26 * (1.0 + 9.0 * squared) ** -0.35, "far_viscosity": 0.04,
})  # fmt: skip
WAVES["carreau"] = WAVES["both"].with_fluid(**thin)
# The shear rate of a linear velocity is the same at all points.
EXACT["carreau"] = planes_above(lambda x: 1.0 + 0.0 * x[:, 0], (0.0, 0.0)).with_fluid(**thin)
for fields in (WAVES, EXACT):
    fields["hyperelastic"] = fields["both"].with_fluid(**stiff)


# What scenes say of boundaries, loads and solids: each kind has many terms at once. -----------------------------------

BEAT, TURN = "1+0.5*sin(3*t)", np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
WEIGHT_OF = np.array([0.5, -2.0])
PRESSURE, PULL, SPRING, DAMPER, PUSH, AT = 0.9, np.array([0.4, -0.3]), 5.0, 0.7, np.array([0.3, -0.5]), (0.61, 0.37)
DAMPED = {"viscosity": 0.4, "mass_damping": 0.8}


def loaded(swing: Swing = SWINGING, field: Callable = manufactured.parabolas, **law) -> Solution:
    """A solid with every load: its free sides, which have both damping and springs, and a point inside of it."""
    (exact,) = solid(swing, field).exact.values()
    exact = replace(exact, gravity=tuple(WEIGHT_OF), solid_viscosity=0.4, mass_damping=0.8, **law)

    def acting(x, t, normal):
        pressed = PRESSURE * np.einsum("nij,nj->ni", manufactured.cofactor(exact.deformation(x, t)), normal)
        return beating(t) * (pressed - PULL) + SPRING * exact.u(x, t) + DAMPER * exact.solid_velocity(x, t)

    return Solution({SOLID: exact}, acting={OPEN: acting}, forces=[(np.array(AT), lambda t: beating(t) * PUSH)])


IN_PLANE = {"lame_lambda": 2 * LAMBDA * MU / (LAMBDA + 2 * MU)}
EXACT["linear"], EXACT["plane stress"] = loaded(linear_elastic=True), loaded(**IN_PLANE)
EXACT["massless"] = loaded(solid_density=0.0)
WAVES["plane stress"] = loaded(AT_REST, lambda x: 0.5 * manufactured.waves(2 * x), **IN_PLANE)

# A fluid that a solid squeezes against a wall without friction, between an inlet with a pressure and two outlets.
SQUEEZE, INFLOW, BACKFLOW = 0.6, 0.8, 0.4
LOWER = {"pressure": 0.3, "resistance": 1.7}
RESISTANCES = {"proximal_resistance": 0.6, "distal_resistance": 2.0}
STORING = {"pressure": 0.2, "compliance": 0.3, "backflow": BACKFLOW, **RESISTANCES}


def openings(shape: Callable, pressure: Callable) -> Solution:
    """Velocities that are 0 at t = 0, as a Windkessel starts from rest; fluid comes back through the upper outlet."""
    turning = Swing(np.pi / 2)

    def height(t):
        return SQUEEZE * turning(t)

    def rate(t):
        return SQUEEZE * turning.rate(t)

    def u(x, t):
        return vector(x[:, 0] * (1 / (1 - height(t)) - 1), height(t) * (1 - x[:, 1]))

    def velocity(place, t):
        x, y = place.T
        above = np.sin(3 * t) * (y - height(t)) * shape(y)
        return vector(rate(t) * x / (1 - height(t)) + above, rate(t) * (1 - y) / (1 - height(t)))

    def u_below(x, t):
        return vector(x[:, 0] * (1 / (1 - height(t)) - 1) + turning(t) * x[:, 1], height(t) * (1 + 0.5 * x[:, 1]))

    def v_below(x, t):
        along = x[:, 0] * rate(t) / (1 - height(t)) ** 2
        return vector(along + turning.rate(t) * x[:, 1], rate(t) * (1 + 0.5 * x[:, 1]))

    fluid = Exact(u, velocity, p=lambda place, t: beating(t) * pressure(place), gravity=tuple(WEIGHT_OF))
    below = Exact(u=u_below, solid_velocity=v_below, gravity=tuple(WEIGHT_OF))

    points, weights = np.polynomial.legendre.leggauss(8)
    points, weights = (points + 1) / 2, weights / 2

    def flow(t, low, high):
        return (high - low) * weights @ fluid.v(vector(1.0, low + (high - low) * points), t)[:, 0]

    def stored(t):
        """Of C dp/dt + (p - P)/R = Q from p = P."""
        emptied = np.exp((points - 1) * t / (STORING["distal_resistance"] * STORING["compliance"]))
        came = sum(w * e * flow(t * at, 0.5, 1) for w, e, at in zip(weights, emptied, points, strict=True))
        return STORING["pressure"] + t * came / STORING["compliance"]

    def lower(x, t, normal):
        column = DENSITY * (x - [1, 0.5]) @ WEIGHT_OF  # its upper end lies highest
        return (LOWER["pressure"] + LOWER["resistance"] * flow(t, 0, 0.5) + column)[:, None] * normal

    def upper(x, t, normal):
        v = fluid.v(x, t)
        back = DENSITY * BACKFLOW * np.minimum((v * normal).sum(axis=1, keepdims=True), 0) * v
        return (stored(t) + STORING["proximal_resistance"] * flow(t, 0.5, 1)) * normal - back

    acting = {INLET: lambda x, t, normal: INFLOW * np.sin(3 * t) * normal, OUTLET: lower, UPPER: upper}
    return Solution({FLUID: fluid, SOLID: below}, WEIGHT, acting)


EXACT["openings"] = openings(lambda y: 0.4 - 1.1 * y, manufactured.planes)
WAVES["openings"] = openings(lambda y: np.cos(3 * y), lambda x: np.cos(2 * x[:, 0] + x[:, 1]))
EXACT["turned"] = EXACT["openings"].turned(TURN)
OPEN_KINDS = ("openings", "turned")


# Closed fluids: between two walls that the mesh follows, and in a disk whose rim turns.
LEVEL, SPIN, MIDDLE = 0.7, 1.5, np.array([0.5, 0.5])


def sheared() -> Solution:
    """Walls below and above that tilt, a parabola of the velocity between them."""

    def velocity(place, t):
        x, y = place.T
        above = y - AT_REST(t) * (x - 0.5)
        along = beating(t) * above * (1 - above)
        return vector(along, AT_REST.rate(t) * (x - 0.5) + AT_REST(t) * along)

    return Solution(
        {
            FLUID: Exact(
                u=lambda x, t: AT_REST(t) * vector(0.0 * x[:, 0], x[:, 0] - 0.5),
                velocity=velocity,
                p=lambda place, t: (
                    LEVEL
                    + beating(t)
                    * (0.4 * (place[:, 0] - 0.5) + 0.9 * (place[:, 1] - AT_REST(t) * (place[:, 0] - 0.5) - 0.5))
                ),
            )
        },
        WEIGHT,
    )


def spinning() -> Solution:
    return Solution({FLUID: Exact(
        u=lambda x, t: 0.0 * x + 0.0 * t,
        velocity=lambda x, t: SPIN * beating(t) * vector(0.5 - x[:, 1], x[:, 0] - 0.5),
        p=lambda x, t: LEVEL + beating(t) * (0.4 * (x[:, 0] - 0.5) - 0.8 * (x[:, 1] - 0.5)),
    )})  # fmt: skip


EXACT["tilting"], EXACT["spinning"] = sheared(), spinning()


def disk(n: int) -> RawMesh:
    """Around the middle of the unit square, of radius 1/2; its rim has chords."""
    mesh = wall_mesh(n)
    ray = mesh.vertices - MIDDLE
    size = np.hypot(*ray.T)[:, None]
    mesh.vertices[:] = MIDDLE + ray * np.divide(np.abs(ray).max(axis=1)[:, None], size, where=size > 0, out=0 * size)
    return mesh


def wall_mesh(n: int) -> RawMesh:
    grid = np.linspace(0, 1, n + 1)
    return structured_mesh(grid, grid, lambda x, y: FLUID, lambda x, y: WALL if y in (0, 1) else INLET)


def meshes(kind: str) -> Callable[[int], RawMesh]:
    if kind in OPEN_KINDS:
        split = functools.partial(both_mesh, half=UPPER)
        return split if kind == "openings" else lambda n: replace(split(n), vertices=split(n).vertices @ TURN)
    return {"tilting": wall_mesh, "spinning": disk}.get(kind, both_mesh if FLUID in EXACT[kind].exact else solid_mesh)


# Labels that the scenes give to boundaries, where they are others.
OPENINGS = {WALL: 18, INLET: 1000, OUTLET: 1100, UPPER: 1101}
LABELS = {kind: {OPEN: 20} for kind in ("linear", "plane stress", "massless")}
LABELS |= {"openings": OPENINGS, "turned": OPENINGS | {WALL: 19}}
LABELS |= {"tilting": {WALL: 30, INLET: 40}, "spinning": {INLET: 30, WALL: 31}}
NAMES = {"in": INLET, "low": OUTLET, "up": UPPER, "top": WALL, "wet": INTERFACE, "ends": CLAMPED, "open": OPEN}
SQUARE = {"material": "neo-hookean", "density": SOLID_DENSITY, "lame_mu": MU}
ELASTIC = {**SQUARE, "material": "st-venant-kirchhoff", "lame_lambda": LAMBDA}
SOLIDS = {
    "mixed": {**SQUARE, "formulation": "mixed", "lame_lambda": LAMBDA},
    "incompressible": {**SQUARE, "formulation": "incompressible"},
    "linear": {**ELASTIC, "material": "linear-elastic", **DAMPED},
    "plane stress": {**ELASTIC, "plane": "stress", **DAMPED},
    "massless": {**ELASTIC, **DAMPED, "density": 0},
}  # fmt: skip
CARREAU = {"law": "carreau", "viscosity_zero": 0.3, "viscosity_infinity": 0.04}
CARREAU |= {"time_constant_squared": 9.0, "exponent": -0.35}


def loads() -> dict:
    load = {"pressure": PRESSURE, "traction_x": PULL[0], "traction_y": PULL[1], "stiffness": SPRING, "damping": DAMPER}
    push = {"x": AT[0], "y": AT[1], "force_x": PUSH[0], "force_y": PUSH[1], "waveform": BEAT}
    return {"loads": {"open": {**load, "waveform": BEAT}}, "point_forces": {"push": push}}


def flow(kind: str) -> tuple[dict, dict]:
    """Boundaries of the fluid and their tables; a closed one is between walls that move."""
    if kind in OPEN_KINDS:
        low, up = {"kind": "resistance", "hydrostatic": True, **LOWER}, {"kind": "windkessel", **STORING}
        inlet = {"in": {"pressure": INFLOW, "waveform": "sin(3*t)"}}  # from 0 on: no steps of backward Euler
        return {"inlet": "in", "outlet": ["low", "up"], "slip": "top"}, {
            "inlet": inlet,
            "outlet": {"low": low, "up": up},
        }
    if kind == "tilting":
        return {"walls": ["in", "top"]}, {"walls": {"top": {"displacement_y": "0.2*sin(2*t)*(x-0.5)"}}}
    if kind == "spinning":  # about another point than the middle, and a translation that makes up for it
        turns = {
            "rotation": SPIN,
            "centre_x": 0.3,
            "centre_y": 0.9,
            "velocity_x": -0.4 * SPIN,
            "velocity_y": -0.2 * SPIN,
        }
        return {"walls": ["in", "top"]}, {"walls": dict.fromkeys(("in", "top"), turns | {"waveform": BEAT})}
    inflow = {"mean_velocity": 1, "ramp": 1}  # the scale of the corrections, and no impulsive start
    return {"inlet": "in", "outlet": "low", "walls": "top"}, {"inflow": inflow, "outlet": {"kind": "do-nothing"}}


def scene_in_time(folder: Path, kind: str, k: float, end: float, solver: str = "condensed", **time: object) -> Scene:
    exact, mesh = EXACT[kind], meshes(kind)(2)
    present = {name: label for name, label in NAMES.items() if label in mesh.label}
    bodies = {name: region for name, region in (("fluid", FLUID), ("block", SOLID)) if region in exact.exact}
    sides, tables = flow(kind) if FLUID in exact.exact else ({}, {})
    if FLUID in exact.exact:
        level = {} if exact.acting or SOLID in exact.exact else {"mean_pressure": LEVEL}
        law = CARREAU if kind == "carreau" else {"viscosity": VISCOSITY}
        tables |= {"fluid": {"density": DENSITY, **law, **level}}
    if SOLID in exact.exact:
        tables |= {"solid": {"block": SOLIDS.get(kind, ELASTIC)}}
        sides |= {"clamped": "ends", "loaded": "open"} if exact.forces else {"clamped": "ends"}
        tables |= loads() if exact.forces else {}
    if len(bodies) == 2:
        motion = {"kind": "hyperelastic" if kind == "hyperelastic" else "harmonic", "stiffness_exponent": 0}
        tables |= {"mesh_motion": {**motion, "divergence_weight": WEIGHT}}
    if exact.acting:
        tables |= {"gravity": dict(zip("xy", next(iter(exact.exact.values())).gravity, strict=True))}
    # The volume of an incompressible solid is a condition on u. Without damping its pressure would alternate from the
    # first step on, with an amplitude of order 1.
    shift = {"incompressible": 3.0, **dict.fromkeys(OPEN_KINDS, 0.1)}.get(kind, 1.0)
    steps = {"step": k, "end": end, "shift": shift, **time}
    path = write_mesh(folder / "own.msh", mesh, bodies, present)
    regions = dict(zip(bodies, bodies, strict=True))
    return scene_on(path, sides, regions, time=steps, solver={"step_tolerance": 1e-10, "step": solver}, **tables)
