"""Translation of a scene into the checker's problem."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats
from ffsi.reference import materials, viscosity
from ffsi.reference.conditions import Inflow, Load, Outlet, PointForce, Series, Support, womersley
from ffsi.reference.problem import FLUID_REGION, Boundary, Fluid, MeshMotion, Problem, Solid
from ffsi.reference.step import Step
from ffsi.scene import Scene, boundaries
from ffsi.scene.walls import Motion

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Scripts may write their parameters with fewer digits than they compute with.
_SAME = 1e-9
# A step that would leave less than this part of it before an output or the end goes to there at once.
_SLIVER = 1e-3
# A waveform that is smaller than this at the start is at rest: a Fourier series meets zero up to rounding only.
_REST = 1e-12
# Part of a step over which the rate of a displacement is a difference.
_STENCIL = 0.02
# Number of the first steps that damp a jump.
_DAMPED_STEPS = 2


def _in_plane(solid: Any) -> tuple[float, float]:
    """Constants (lambda, mu) that tie stress and strain in the plane, of a plate those without stress across it."""
    young, nu = solid.young_poisson
    return (young * nu / (1.0 - nu**2), young / (2.0 + 2.0 * nu)) if solid.plane == "stress" else solid.lame


# The law of each material of a scene, from the scene's solid: a new material has its entry here.
MATERIALS: dict[str, Callable[[Any], materials.Material]] = {
    "st-venant-kirchhoff": lambda solid: materials.StVenantKirchhoff(*_in_plane(solid)),
    "linear-elastic": lambda solid: materials.LinearElastic(*_in_plane(solid)),
    "neo-hookean": lambda solid: materials.NeoHookean(*solid.lame),
    "mooney-rivlin": lambda solid: materials.MooneyRivlin(
        solid.c10, solid.c01, math.inf if solid.bulk_modulus is None else solid.bulk_modulus
    ),
}


# The viscosity of each law of a scene's fluid.
VISCOSITIES: dict[str, Callable[[Any], viscosity.Viscosity]] = {
    "newtonian": lambda fluid: viscosity.Newtonian(fluid.viscosity),
    "carreau": lambda fluid: viscosity.Carreau(
        fluid.viscosity_zero, fluid.viscosity_infinity, fluid.time_constant_squared, fluid.exponent
    ),
    "power-law": lambda fluid: viscosity.PowerLaw(fluid.consistency, fluid.exponent, fluid.regularisation),
    "casson": lambda fluid: viscosity.Casson(fluid.yield_stress, fluid.viscosity_infinity, fluid.regularisation),
}


# The outlet of each kind, from that of a scene, but for what all kinds have.
OUTLETS: dict[str, Callable[[Any], Outlet]] = {
    "do-nothing": lambda outlet: Outlet("do-nothing"),
    "zero-traction": lambda outlet: Outlet("zero-traction"),
    "pressure": lambda outlet: Outlet("pressure", outlet.pressure),
    "resistance": lambda outlet: Outlet("resistance", outlet.pressure, outlet.resistance),
    "windkessel": lambda outlet: Outlet(
        "windkessel", outlet.pressure, outlet.proximal_resistance, outlet.distal_resistance, outlet.compliance
    ),
}


def problem_from_scene(scene: Scene) -> Problem:
    """Return the problem that a scene describes, in SI units.

    Raises ``ValueError`` if the scene has something that the checker does not know, such as a new material.
    """
    return Problem(
        name=scene.name,
        fluid=Fluid(scene.fluid.density, _viscosity(scene.fluid)) if scene.fluid else None,
        boundaries=tuple(
            Boundary(
                b.name,
                b.label,
                b.role,
                b.part,
                b.circle,
                _motion(scene, b.moving),
                _load(scene, b.load),
                **_opening(scene, b),
                displacement=_displacement(scene, b.moving),
                curved=b.curved,
                sampled=_sampled(scene, b.moving),
            )
            for b in boundaries(scene)
        ),
        solids={
            region: Solid(
                solid.density,
                material_of(solid, f"solid.{name}"),
                getattr(solid, "formulation", "displacement"),
                solid.viscosity or 0.0,
                solid.mass_damping or 0.0,
            )
            for region, (name, solid) in enumerate(scene.solid.items(), start=FLUID_REGION + 1)
        },
        gravity=(scene.gravity.x, scene.gravity.y) if scene.gravity else (0.0, 0.0),
        inflow=_inflow(scene),
        outlet=_outlet(scene, scene.only_outlet) if scene.only_outlet and not _parted(scene) else None,
        support=Support(scene.support.stiffness, scene.support.damping) if scene.support else None,
        traction=(scene.traction.x, scene.traction.y) if scene.traction else (0.0, 0.0),
        mesh_motion=MeshMotion(m.stiffness_exponent, m.divergence_weight, m.kind, m.distance_exponent)
        if (m := scene.mesh_motion)
        else None,
        point_forces=tuple(map(_point_force, scene.point_forces.values())),
        mean_velocity=scene.mean_velocity,
        mean_pressure=scene.fluid.mean_pressure if scene.fluid else None,
        reference_length=scene.forces.reference_length if scene.forces else None,
        names=dict(enumerate(scene.solid, start=FLUID_REGION + 1)),
        points=({"tip": scene.tip} if scene.tip else {}) | scene.probes,
    )


def _inflow(scene: Scene) -> Inflow | None:
    """Flow into the scene; a steady one has neither ramp nor waveform, and in its system the time is 0."""
    if scene.inflow is None:
        return None
    inlet, ramp = scene.geometry.inlet, _ramp(scene)  # type: ignore[union-attr]
    if scene.inflow.profile != "womersley":
        return _separable(scene, scene.inflow, inlet)
    if (waves := _series(scene.inflow)) is None or scene.fluid is None or scene.inflow.mean_velocity is None:
        raise ValueError(f"{scene.name}: Womersley's profile needs a fluid and the Fourier series of its flow rate")
    kinematic = _viscosity(scene.fluid).outlet / scene.fluid.density
    flow = womersley(waves, scene.inflow.mean_velocity, inlet.height, kinematic)
    return Inflow(lambda s, time: ramp(time) * flow(s, time), inlet.start, inlet.inward)


def _separable(scene: Scene, inflow: Any, inlet: Any) -> Inflow:
    """Flow through an inlet: its profile times a factor of time."""
    factor = _factor(scene, inflow)

    def velocity(s: Floats, time: float) -> Floats:
        shape = inflow.expression.evaluate(y=s, H=inlet.height)  # may be a constant; nodes need one value each
        return np.asarray(factor(time) * inflow.mean_velocity * np.broadcast_to(shape, s.shape))

    return Inflow(velocity, inlet.start, inlet.inward, kept=True)


def _parted(scene: Scene) -> bool:
    """Whether there are several natural conditions, each with a pressure of its own."""
    return bool(scene.outlets) or any(inlet.pressure is not None for inlet in scene.inlet.values())


def _opening(scene: Scene, boundary: Any) -> dict[str, Any]:
    """What a boundary has of its own as one of several inlets or outlets."""
    name = boundary.opening
    inlet = scene.inlet.get(name)
    found: dict[str, Any] = {} if name is None else {"opening": (name, 1.0 if inlet is None else -1.0)}
    if inlet is not None:
        place = scene.geometry.named_inlets[name]  # type: ignore[union-attr]
        if inlet.pressure is None:
            return found | {"inflow": _separable(scene, inlet, place)}
        if inlet.direction == "normal":
            found["still"] = (-place.inward[1], place.inward[0])
        return found | {"outlet": Outlet("pressure", inlet.pressure, ramp=_factor(scene, inlet))}
    if boundary.role == "outlet" and _parted(scene):
        found["outlet"] = replace(_outlet(scene, scene.outlets.get(name, scene.only_outlet)), name=name or "")
    return found


def _factor(scene: Scene, inflow: Any) -> Callable[[float], float]:
    """Ramp times waveform of an inflow; one in a steady scene."""
    ramp, wave = _ramp(scene, inflow), _waveform(scene, inflow)
    return lambda time: ramp(time) * wave(time)


def _waveform(scene: Scene, inflow: Any) -> Callable[[float], float]:
    """Return the Fourier series or the formula of the time; one in a steady scene."""
    if (waves := _series(inflow)) is not None:
        return waves
    if inflow is None or scene.time is None:
        return lambda time: 1.0
    formula = inflow.waveform_expression
    return lambda time: float(formula.evaluate(t=time))


def _ramp(scene: Scene, inflow: Any = None) -> Callable[[float], float]:
    """Return the factor of time, from 0 to 1, on what drives the flow: of the scene's inflow, or one of several."""
    inflow = inflow or scene.inflow
    length = inflow.ramp if inflow is not None and scene.time is not None else None

    def ramp(time: float) -> float:
        return 1.0 if length is None or time >= length else 0.5 - 0.5 * math.cos(math.pi * time / length)

    return ramp


def _motion(scene: Scene, name: str | None) -> Callable[[Floats, float], Floats] | None:
    """Velocity of a moving wall: a translation and a rotation around a point, times a factor of time."""
    if name is None:
        return None
    wall = scene.walls[name]
    if wall.displacement_samples is not None:
        spline = _spline(wall.displacement_samples)

        def moving(points: Floats, time: float) -> Floats:
            x, y, rate = spline(time, 1)
            turning = 1j * rate * np.exp(1j * spline(time)[2]) * _arm(wall, points)
            return np.column_stack([x + turning.real, y + turning.imag])

        return moving
    if (path := _displacement(scene, name)) is not None and scene.time is not None:
        # Its rate by differences of fourth order: the formula's own derivative is the script's.
        h = _STENCIL * scene.time.step

        def rate(points: Floats, time: float) -> Floats:
            far, near = (path(points, time + n * h) - path(points, time - n * h) for n in (2, 1))
            return (8.0 * near - far) / (12.0 * h)

        return rate
    factor = _wall_factor(scene, name)

    def motion(points: Floats, time: float) -> Floats:
        velocity = complex(wall.velocity_x, wall.velocity_y) + 1j * wall.rotation * _arm(wall, points)
        return factor(time) * np.column_stack([velocity.real, velocity.imag])

    return motion


def _displacement(scene: Scene, name: str | None) -> Callable[[Floats, float], Floats] | None:
    """How far a wall that the mesh follows is from where it was; None of any other."""
    if name is None or not scene.walls[name].displaced:
        return None
    if (samples := scene.walls[name].displacement_samples) is not None:
        wall, spline = scene.walls[name], _spline(samples)

        def moved(points: Floats, time: float) -> Floats:
            x, y, angle = spline(time)
            turned = (np.exp(1j * angle) - 1.0) * _arm(wall, points)
            return np.column_stack([x + turned.real, y + turned.imag])

        return moved
    formulas = scene.walls[name].displacement

    def displacement(points: Floats, time: float) -> Floats:
        return np.column_stack([f.evaluate(x=points[:, 0], y=points[:, 1], t=time) for f in formulas])

    return displacement


def _sampled(scene: Scene, name: str | None) -> float:
    samples = scene.walls[name].displacement_samples if name is not None else None
    return samples.at[-1] if samples is not None else 0.0


def _spline(samples: Motion) -> CubicSpline:
    """Return x, y (m) and angle of a wall at a time in s: at rest at the first sample, no curvature at the last."""
    from scipy.interpolate import CubicSpline  # half a second that runs without such a wall save

    columns = np.column_stack([samples.x, samples.y, samples.angle or np.zeros(len(samples.at))])
    return CubicSpline(samples.at, columns, bc_type=((1, [0.0] * 3), (2, [0.0] * 3)))


def _arm(wall: Any, points: Floats) -> NDArray[np.complex128]:
    """Points (n, 2) m from the centre of a wall, as complex numbers (n,)."""
    return np.asarray(points @ [1.0, 1j] - complex(wall.centre_x, wall.centre_y), dtype=np.complex128)


def _load(scene: Scene, name: str | None) -> Load | None:
    if name is None:
        return None
    load = scene.loads[name]
    wave = load.expression
    return Load(
        (load.traction_x, load.traction_y),
        load.pressure,
        load.following,
        lambda time: float(wave.evaluate(t=time)),
        Support(load.stiffness or 0.0, load.damping or 0.0) if load.springs else None,
    )


def _point_force(acting: Any) -> PointForce:
    wave = acting.expression
    return PointForce((acting.x, acting.y), (acting.force_x, acting.force_y), lambda time: float(wave.evaluate(t=time)))


def _wall_factor(scene: Scene, name: str) -> Callable[[float], float]:
    """Factor of time on the velocity of a moving wall, its own or that of the inflow, with the inflow's ramp."""
    if scene.time is None:
        return lambda time: 1.0
    ramp, own = _ramp(scene), scene.walls[name].expression
    wave = _waveform(scene, scene.inflow) if own is None else lambda time: float(own.evaluate(t=time))
    return lambda time: ramp(time) * wave(time)


def _outlet(scene: Scene, outlet: Any) -> Outlet:
    if outlet.kind not in OUTLETS:
        raise ValueError(f"outlet: the reference checker does not know the kind {outlet.kind!r}")
    return replace(
        OUTLETS[outlet.kind](outlet),
        backflow=outlet.backflow or 0.0,
        hydrostatic=bool(outlet.hydrostatic),
        ramp=_ramp(scene),
    )


def theta_of(scene: Scene) -> Callable[[float, int], float]:
    """Weight of the new state in a step by its length, seconds, and its number, from 1.

    Where the inflow jumps at the start, from rest, the first steps are those of backward Euler. Raises ``ValueError``
    if the scene is steady.
    """
    if (time := scene.time) is None:
        raise ValueError(f"{scene.name}: a time step, but the scene is steady")
    weights: dict[str, Callable[[float], float]] = {
        "backward-euler": lambda k: 1.0,
        "crank-nicolson": lambda k: 0.5,
        "shifted-crank-nicolson": lambda k: min(1.0, 0.5 + time.shift * k),
    }
    if time.scheme not in weights:
        raise ValueError(f"the reference checker does not know the time scheme {time.scheme!r}")
    weight = weights[time.scheme]
    flows = [*([scene.inflow] if scene.inflow else []), *scene.inlet.values()]
    jumps = any(abs(_factor(scene, inflow)(0.0)) > _REST for inflow in flows)
    jumps |= any(abs(_wall_factor(scene, name)(0.0)) > _REST for name in scene.walls)
    jumps |= any(wall.displaced for wall in scene.walls.values())
    jumps |= any(solid.density == 0 for solid in scene.solid.values())
    jumps |= scene.start is not None or time.initial is not None
    return lambda k, number: 1.0 if jumps and number <= _DAMPED_STEPS else weight(k)


def _series(inflow: Any) -> Series | None:
    series = inflow.fourier if inflow is not None else None
    return Series(series.period, series.cosine, series.sine) if series is not None else None


def refuse_other_step(scene: Scene, step: Step, number: int) -> None:
    """Raise ``ValueError`` if a step is none of the scene's: steady, too long, after the end, or another theta.

    ``number`` is that of the step, from 1.
    """
    theta, time = theta_of(scene)(step.k, number), scene.time
    assert time is not None
    wrong = {
        f"k = {step.k!r} s, at most {time.step!r} s": step.k > time.step * (1.0 + _SLIVER + _SAME),
        f"theta = {step.theta!r}, expected {theta!r}": abs(step.theta - theta) > _SAME,
        f"its start is at {step.start!r} s": step.start < -_SAME * step.k,
        f"its end is at {step.time!r} s, the last at {time.end!r} s": step.time > time.end * (1.0 + _SAME),
    }
    if found := [text for text, is_wrong in wrong.items() if is_wrong]:
        raise ValueError(f"{scene.name}: a step that the scene does not have: {'; '.join(found)}")


def _viscosity(fluid: Any) -> viscosity.Viscosity:
    if fluid.law not in VISCOSITIES:
        raise ValueError(f"fluid: the reference checker does not know the viscosity law {fluid.law!r}")
    return VISCOSITIES[fluid.law](fluid)


def material_of(solid: Any, key: str = "solid") -> materials.Material:
    """Return the law of a scene's solid; raises ``ValueError``, with its key, if it has no entry in ``MATERIALS``."""
    if solid.material not in MATERIALS:
        raise ValueError(f"{key}: the reference checker does not know the material {solid.material!r}")
    return MATERIALS[solid.material](solid)


def refuse_other_parameters(scene: Scene, used: Mapping[str, float]) -> None:
    """Raise ``ValueError`` if a run used other values, by dotted key, than the scene holds."""
    expected = scene.parameters()
    for key in used.keys() & expected.keys():
        if not abs(used[key] - expected[key]) <= _SAME * abs(expected[key]):
            raise ValueError(
                f"{scene.name}: the run used {key} = {used[key]!r} but the scene says {expected[key]!r}; "
                "check it with a scene that holds the values of the run"
            )
