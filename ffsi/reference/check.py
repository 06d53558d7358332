"""Verdict on a state or a time step that another program returned: residuals, prescribed values and forces."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ffsi.hemodynamics import walls
from ffsi.rawfiles import Floats, RawMesh, RawState, read_mesh, read_state
from ffsi.reference.forces import Forces, coefficient_scale, compute_forces
from ffsi.reference.from_scene import problem_from_scene, refuse_other_parameters, refuse_other_step, theta_of
from ffsi.reference.outlet import OutletHistory, at_outlet
from ffsi.reference.problem import Problem
from ffsi.reference.residual import compute_residual
from ffsi.reference.step import Step
from ffsi.reference.system import Mask, System
from ffsi.reference.wall import Passage, WallCycle, WallShear, wall_shear
from ffsi.scene import Scene

TOLERANCE = 1e-8
STEPS = "steps.json"
HISTORY = "history.csv"
CYCLES = "wall-*.bin"
# A component below this fraction of the force is a difference of large numbers, compared on the scale of the force.
_SMALL_COMPONENT = 1e-3
# Prescribed values up to this part of the field have too few right digits to be compared on their own scale.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class CheckReport:
    """What the reference checker found; every number is relative and None where the scene has no such quantity.

    ``momentum``, ``continuity``, ``kinematics``, ``mesh_motion``, ``incompressibility`` (volume of mixed solids):
    residuals as docs/discretisation.md scales them.
    ``dirichlet``: largest deviation from a prescribed value. ``drag_difference``, ``lift_difference``,
    ``coefficient_difference``: reported against recomputed forces. ``outlet_difference``: likewise the flow rate out,
    the pressure at the outlet and that of the reservoir behind it; ``wall_difference``: the shear stress on the walls,
    and its sums over cycles. ``min_jacobian``: smallest det F.
    ``forces``: the recomputed forces, both forms. ``failures``: one sentence for each number above ``tolerance``.
    Of several time steps every number is the worst, and the forces are those of the last one.
    """

    momentum: float | None
    continuity: float | None
    kinematics: float | None
    mesh_motion: float | None
    incompressibility: float | None
    dirichlet: float
    drag_difference: float | None
    lift_difference: float | None
    coefficient_difference: float | None
    outlet_difference: float | None
    wall_difference: float | None
    min_jacobian: float
    tolerance: float
    forces: Forces
    failures: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """True if nothing failed."""
        return not self.failures


def check_state(
    problem: Problem,
    mesh: RawMesh,
    state: RawState,
    reported_quantities: Mapping[str, float],
    tolerance: float = TOLERANCE,
) -> CheckReport:
    """Check that ``state`` solves ``problem`` on ``mesh`` and that the reported forces are its forces.

    ``reported_quantities`` may hold ``drag``, ``lift`` (N per metre depth), ``drag_coefficient``, ``lift_coefficient``,
    ``flow_rate_out`` (m2/s), ``outlet_pressure`` (Pa); others are ignored, one that is missing differs. Raises
    ``ValueError`` if mesh, state and problem do not fit together.
    """
    return _report([_examine(System.build(problem, mesh), state, reported_quantities)], tolerance)


def check_step(
    problem: Problem,
    mesh: RawMesh,
    old: RawState,
    new: RawState,
    step: Step,
    reported_quantities: Mapping[str, float],
    tolerance: float = TOLERANCE,
    reservoir: float = 0.0,
) -> CheckReport:
    """Check that the time step from ``old`` to ``new`` solves ``problem``, and the forces reported at its end.

    ``reservoir`` Pa is the pressure of a Windkessel at the start; ``reported_quantities`` then holds ``windkessel_old``
    and ``windkessel_new``, that at both ends.
    The pressure of ``old`` enters where a ``mixed`` solid has it. A program that solves its steps to a looser accuracy
    than ``tolerance`` needs a larger one. Other arguments and errors are those of ``check_state``.
    """
    system = System.build(problem, mesh).stepping(old, step, reservoir)
    return _report([_examine(system, new, reported_quantities)], tolerance)


def check_run(directory: Path, scene: Scene, point: int = 1, tolerance: float = TOLERANCE) -> CheckReport:
    """Check one point of a run folder, or all its checked time steps, against the scene that it was run with.

    The scene must carry the values that the run really used. A scene in time has ``steps.json`` beside its only point:
    a list of ``{"step", "time", "k", "theta", "old", "new", "quantities"}`` where old and new name files in the format
    of a point's state; with a Windkessel each entry has ``windkessel_old``, ``windkessel_new``, too. Where the outlet
    has a pressure, ``history.csv`` holds it and the flow rate out for every step; ``wall-*.bin`` are sums over cycles.
    The wall shear stress of a state is what ``ffsi.hemodynamics`` makes of it. Raises ``ValueError`` where the
    parameters in the point's JSON, or a step, are none of the scene's, no step is listed or a file does not fit, and
    ``OSError`` if one is missing.
    """
    directory = Path(directory)
    outcome = json.loads((directory / f"point-{point:04d}.json").read_text(encoding="utf-8"))
    refuse_other_parameters(scene, outcome.get("parameters", {}))
    mesh = read_mesh(directory / "mesh.bin")
    if scene.time is not None:
        return _report(_examine_steps(directory, scene, mesh), tolerance)
    state = read_state(directory / f"point-{point:04d}.bin", mesh)
    system = System.build(problem_from_scene(scene), mesh)
    found = _examine(system, state, outcome.get("quantities", {}))
    if (shear := wall_shear(system, state)) is not None:
        found.numbers["wall_difference"] = _wall_difference(scene, mesh, state, shear)
    return _report([found], tolerance)


@dataclass(frozen=True)
class _Findings:
    """Numbers of one state by name, its smallest det F, its forces, and words that say which step it belongs to."""

    numbers: dict[str, float]
    min_jacobian: float
    forces: Forces
    place: str


def _examine(system: System, state: RawState, reported: Mapping[str, float], place: str = "") -> _Findings:
    residual = compute_residual(system, state)
    forces = compute_forces(system, state, residual)
    numbers = residual.relative | {"dirichlet": _dirichlet(system, state)}
    if (outlet := at_outlet(system, state)) is not None:
        numbers["outlet_difference"] = outlet.difference(reported)
    return _Findings(numbers | _force_differences(system, forces, reported), residual.min_jacobian, forces, place)


def _examine_steps(directory: Path, scene: Scene, mesh: RawMesh) -> list[_Findings]:
    """Examine every step that the run folder lists."""
    entries = json.loads((directory / STEPS).read_text(encoding="utf-8"))
    if not entries:
        raise ValueError(f"{directory / STEPS}: no step is listed")
    system = System.build(problem_from_scene(scene), mesh)
    outlet = system.problem.outlet
    history = None
    if outlet is not None and outlet.presses:
        history = OutletHistory.read(directory / HISTORY, outlet, theta_of(scene))
    cycles = [WallCycle.read(path) for path in sorted(directory.glob(CYCLES))]
    found, passages = [], []
    for entry in entries:
        step, old, new = _read_entry(directory, entry)
        refuse_other_step(scene, step, entry["step"])
        reported, reservoir = dict(entry.get("quantities", {})), 0.0
        if history is not None:
            reported |= history.reported(entry["step"])
            reservoir = history.reservoirs[entry["step"] - 1]
            reported |= {name: entry[name] for name in ("windkessel_old", "windkessel_new") if name in entry}
        before, after = read_state(old, mesh), read_state(new, mesh)
        place = f" in step {entry['step']} at {step.time:g} s"
        found.append(_examine(system.stepping(before, step, reservoir), after, reported, place))
        if (shear := wall_shear(system, after)) is not None:
            found[-1].numbers["wall_difference"] = _wall_difference(scene, mesh, after, shear)
        if cycles and shear is not None and (start := wall_shear(system, before)) is not None:
            passages.append(Passage(step.start, step.time, start, shear))
    for cycle in cycles:
        found[-1].numbers["wall_difference"] = max(cycle.difference(passages), found[-1].numbers["wall_difference"])
    return found


def _wall_difference(scene: Scene, mesh: RawMesh, state: RawState, own: WallShear) -> float:
    """Difference between the checker's shear stress on the walls and that which is shown to people."""
    points = walls.wall_points(mesh, walls.wall_labels(scene))
    if scene.fluid is None:
        return math.inf
    return own.difference(points.middle, walls.wall_shear_stress(points, state, scene.fluid))


def _read_entry(directory: Path, entry: Mapping[str, Any]) -> tuple[Step, Path, Path]:
    """Return the step of an entry of ``steps.json`` and the files of both its ends."""
    if missing := {"step", "time", "k", "theta", "old", "new"} - entry.keys():
        raise ValueError(f"{directory / STEPS}: an entry without {', '.join(sorted(missing))}")
    step = Step(float(entry["k"]), float(entry["theta"]), float(entry["time"]))
    return step, directory / entry["old"], directory / entry["new"]


def _report(found: Sequence[_Findings], tolerance: float) -> CheckReport:
    """Gather what was found in one state, or in several: then the worst of each number counts."""
    names = list(dict.fromkeys(name for each in found for name in each.numbers))
    worst = {name: _worst(found, name) for name in names}
    numbers = {name: each.numbers[name] for name, each in worst.items()}
    return CheckReport(
        momentum=numbers.get("momentum"),
        continuity=numbers.get("continuity"),
        kinematics=numbers.get("kinematics"),
        mesh_motion=numbers.get("mesh_motion"),
        incompressibility=numbers.get("incompressibility"),
        dirichlet=numbers["dirichlet"],
        drag_difference=numbers.get("drag_difference"),
        lift_difference=numbers.get("lift_difference"),
        coefficient_difference=numbers.get("coefficient_difference"),
        outlet_difference=numbers.get("outlet_difference"),
        wall_difference=numbers.get("wall_difference"),
        min_jacobian=min(each.min_jacobian for each in found),
        tolerance=tolerance,
        forces=found[-1].forces,
        failures=_failures(worst, min(found, key=lambda each: each.min_jacobian), tolerance),
    )


def _worst(found: Sequence[_Findings], name: str) -> _Findings:
    """Return where a number is largest or no number."""

    def badness(each: _Findings) -> float:
        number = each.numbers.get(name, -math.inf)
        return math.inf if math.isnan(number) else number

    return max(found, key=badness)


def _dirichlet(system: System, state: RawState) -> float:
    """Largest deviation from the prescribed u, v, p, ps, each relative to its own scale."""
    rows, increment = system.rows, system.increment
    old = increment.old if increment is not None else state
    return max(
        _deviation(state.u, rows.prescribed.u, rows.u_given, old.u),
        _deviation(state.v, rows.prescribed.v, rows.v_given, old.v),
        _deviation(state.p, rows.prescribed.p, rows.p_given, old.p),
        _deviation(state.ps, rows.prescribed.ps, rows.ps_given, old.ps),
    )


def _deviation(values: Floats, prescribed: Floats, given: Mask, old: Floats) -> float:
    """Largest deviation over the largest prescribed value.

    Where these values are rounding beside those of the field, now or before the step, as those of an inflow that passes
    through zero, it is over the largest value of the field; over one, where that is zero, too.
    """
    if not given.any():
        return 0.0
    scale, size, before = (float(np.abs(field).max(initial=0.0)) for field in (prescribed[given], values, old))
    if scale <= _ROUNDING * max(size, before):
        scale = max(size, before) or 1.0
    return float(np.abs(values - prescribed)[given].max()) / scale


def _force_differences(system: System, forces: Forces, reported: Mapping[str, float]) -> dict[str, float]:
    """Relative differences between reported and recomputed forces; a force that is not reported differs infinitely."""
    if forces.total is None:
        return {}
    differences: dict[str, float] = {}
    drag_lift = [float(component) for component in forces.total.residual]
    size = math.hypot(*drag_lift)
    unit = coefficient_scale(system)
    coefficients = []
    for name, value in zip(("drag", "lift"), drag_lift, strict=True):
        scale = (abs(value) if abs(value) > _SMALL_COMPONENT * size else size) or 1.0
        differences[f"{name}_difference"] = abs(float(reported.get(name, math.inf)) - value) / scale
        if unit is not None and f"{name}_coefficient" in reported:
            coefficients.append(abs(reported[f"{name}_coefficient"] * unit - value) / scale)
    if coefficients:
        differences["coefficient_difference"] = float(np.max(coefficients))  # unlike max(), it passes a NaN on
    return differences


def _failures(worst: Mapping[str, _Findings], inverted: _Findings, tolerance: float) -> list[str]:
    """One sentence for each number, by name, that is above the tolerance or not a number where it is worst."""
    words = {
        "momentum": "relative residual of the momentum",
        "continuity": "relative residual of the continuity",
        "kinematics": "largest solid velocity, less that of its displacement, relative to the largest velocity",
        "mesh_motion": "relative residual of the mesh motion",
        "incompressibility": "relative residual of the volume of mixed solids",
        "dirichlet": "largest relative deviation from a prescribed value",
        "drag_difference": "relative difference between reported and recomputed drag",
        "lift_difference": "relative difference between reported and recomputed lift",
        "coefficient_difference": "relative difference between reported and recomputed force coefficients",
        "outlet_difference": "relative difference between reported and recomputed flow rate or pressure at the outlet",
        "wall_difference": "relative difference between reported and recomputed shear stress on the walls",
    }
    failures = []
    forces: dict[str, Forces] = {}
    for name, found in worst.items():
        if not (number := found.numbers[name]) <= tolerance:
            failures.append(f"{name}: the {words[name]} is {number:.2e}{found.place}, allowed is {tolerance:.0e}")
            if name in ("drag_difference", "lift_difference", "coefficient_difference"):
                forces[found.place] = found.forces
    for place, force in forces.items():
        if force.total is not None:
            drag, lift = force.total.residual
            failures.append(f"recomputed: drag {drag:.12g} N/m, lift {lift:.12g} N/m{place}")
    if not (smallest := inverted.min_jacobian) > 0.0:
        text = f"a triangle is turned inside out{inverted.place}, the smallest det F is {smallest:.2e}"
        failures.append(f"min_jacobian: {text}")
    return failures
