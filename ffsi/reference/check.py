"""Verdict on a state or a time step that another program returned: residuals, prescribed values and forces."""

import math
from bisect import bisect_left
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import Floats, Ints, RawMesh, RawState, read_mesh, read_state
from ffsi.files.cycles import read_cycles
from ffsi.files.json_types import read_table
from ffsi.files.steps import WINDKESSEL, read_steps
from ffsi.reference.conditions import Outlet
from ffsi.reference.estimates import estimates
from ffsi.reference.forces import Forces, compute_forces
from ffsi.reference.from_scene import problem_from_scene, refuse_other_parameters, refuse_other_step, theta_of
from ffsi.reference.history import History, reservoirs
from ffsi.reference.ordinary import ALLOWED, LARGEST, Corrector
from ffsi.reference.quantities import Difference, Quantity, at_outlet, compare, energies, recompute
from ffsi.reference.relative import largest, relative
from ffsi.reference.residual import compute_residual
from ffsi.reference.sensitivities import derivatives, flattened
from ffsi.reference.sizes import reference_pressure, travelled
from ffsi.reference.slip import across
from ffsi.reference.start import start_difference
from ffsi.reference.step import Step
from ffsi.reference.system import Mask, System
from ffsi.reference.wall import Passage, cycle_difference, wall_shear
from ffsi.scene import Scene, scenes_before

TOLERANCE = 1e-8
Shown = Callable[[Scene, RawMesh, RawState], tuple[Ints, Floats]]
"""What is shown to people of the stress on the walls: nodes in the middle of their edges, and (n, 2) Pa there."""
START = "start_difference"
QUANTITIES, STEP_ERROR = "quantities_difference", "step_error"
SLOPES, ERRORS = "sensitivities_difference", "errors_difference"
# Derivatives of a slender solid lose to its conditioning what their quantities do not.
ALLOWED_OF_SLOPES = 1e-6
# Likewise estimates of errors, which are smaller; and the most P2 nodes of a mesh on which they are computed again.
ALLOWED_OF_ERRORS = 1e-5
LARGEST_OF_ERRORS = 3000
_SAME = 1e-9
# Residuals of an ordinary step that say nothing: large, where a solid is stiff. The others are linear, and exact.
_INEXACT = {"momentum", "continuity", "incompressibility"}
AT_OUTLET = ("flow_rate_out", "outlet_pressure")
# What a history must have of what is known of a state.
IN_HISTORY = {"drag", "lift", "tip_ux", "tip_uy", "min_jacobian", "kinetic", "elastic", "dissipated"}
_FORCES = {"drag", "lift", "drag_coefficient", "lift_coefficient"}
# What each number of a report is.
_WORDS = {
    "momentum": "relative residual of the momentum",
    "continuity": "relative residual of the continuity",
    "kinematics": "largest solid velocity, less that of its displacement, relative to the largest velocity",
    "mesh_motion": "relative residual of the mesh motion",
    "incompressibility": "relative residual of the volume of mixed solids",
    ERRORS: "largest relative difference between an estimated and a re-estimated error",
    "dirichlet": "largest relative deviation from a prescribed value",
    "drag_difference": "relative difference between reported and recomputed drag",
    "lift_difference": "relative difference between reported and recomputed lift",
    "coefficient_difference": "relative difference between reported and recomputed force coefficients",
    "outlet_difference": "relative difference between reported and recomputed flow rate or pressure at the outlet",
    "wall_difference": "relative difference between reported and recomputed shear stress on the walls",
    SLOPES: "largest relative difference between a reported and a recomputed sensitivity",
    STEP_ERROR: "error of an ordinary step, relative to its tolerance,",
    START: "relative difference between the state at t = 0 and what the scene says of it",
    QUANTITIES: "largest relative difference between a reported and a recomputed quantity",
}
# Below this part of the field a prescribed value is as wrong as rounding makes the field.
_ROUNDING = 1e-5


@dataclass(frozen=True)
class CheckReport:
    """What the reference checker found; every number is relative and None where the scene has no such quantity.

    ``momentum``, ``continuity``, ``kinematics``, ``mesh_motion``, ``incompressibility`` (volume of mixed solids):
    residuals as docs/theory.md scales them; the others in the words of a failure (``_WORDS``). ``outlet_difference``
    has the pressure of the reservoir behind the outlet, too, ``wall_difference`` the sums over cycles,
    ``start_difference`` is that of the state at the start, with its mesh; ``step_error`` may be at most
    ``ordinary.ALLOWED``, ``sensitivities_difference`` ``ALLOWED_OF_SLOPES``, ``errors_difference``
    ``ALLOWED_OF_ERRORS``.
    ``min_jacobian``: smallest det F. ``forces``: the recomputed ones, both forms.
    ``failures``: one sentence for each number above ``tolerance``.
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
    start_difference: float | None
    quantities_difference: float | None
    sensitivities_difference: float | None
    errors_difference: float | None
    step_error: float | None
    min_jacobian: float
    tolerance: float
    forces: Forces
    failures: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """True if nothing failed."""
        return not self.failures


def check_state(
    system: System, state: RawState, reported: Mapping[str, Any], tolerance: float = TOLERANCE
) -> CheckReport:
    """Check that ``state`` solves ``system``, steady or of a time step, and that what is reported is what it has.

    ``reported`` quantities must hold ``drag`` and ``lift`` (N per metre depth) of a body, ``flow_rate_out`` (m2/s) and
    ``outlet_pressure`` (Pa) of an outlet with a pressure, and ``windkessel_old`` and ``windkessel_new`` (Pa) of a step
    with a Windkessel; they may hold every other one that ``reference.quantities`` recomputes, and one that it does not
    know differs. A program that solves to a looser accuracy than ``tolerance`` needs a larger one. Raises
    ``ValueError`` if the state does not fit the system.
    """
    return _report([_examine(system, state, reported)], tolerance)


def check_run(
    directory: Path, scene: Scene, point: int = 1, tolerance: float = TOLERANCE, shown: Shown | None = None
) -> CheckReport:
    """Check one point of a run folder, or all its checked time steps, against the scene that it was run with.

    The scene must carry the values that the run really used. A scene in time has ``steps.csv`` beside its only point,
    which lists the steps to be checked with the files of both their states; an ordinary step, which was not solved to
    round-off, has its ``tolerance``. ``history.csv`` has a row for every step, where the outlet has a pressure with it
    and the flow rate out; ``wall-*.bin`` are sums over cycles. Every quantity of the point's JSON, and in time of the
    rows of the checked steps, is recomputed, and the wall shear stress of a state compared with that which is ``shown``
    to people. Raises ``ValueError`` where the parameters in the point's JSON, or a step, are none of the scene's, no
    step is listed, the history has a gap, the point's state is not that of the last step or a file does not fit, and
    ``OSError`` if one is missing.
    """
    directory = Path(directory)
    outcome = read_table(directory / folder.numbered(folder.POINT, point))
    refuse_other_parameters(scene, outcome.get("parameters", {}))
    mesh = read_mesh(directory / folder.MESH)
    if scene.time is not None:
        return _report(_examine_steps(directory, scene, mesh, outcome.get("quantities", {}), shown), tolerance)
    state = read_state(directory / folder.numbered(folder.STATE, point), mesh)
    system = System.build(problem_from_scene(scene), mesh)
    found = _examine(system, state, outcome.get("quantities", {}), whole=True)
    if (shear := wall_shear(system, state)) is not None and shown is not None:
        found.numbers["wall_difference"] = shear.difference(*shown(scene, mesh, state))
    slopes = directory / folder.numbered(folder.SENSITIVITIES, point)
    if slopes.is_file() and 4 * mesh.n_p2 <= LARGEST:
        reported = read_table(slopes)
        worst = compare(derivatives(scene, mesh, state, reported), flattened(reported))
        found.numbers[SLOPES], found.words[SLOPES] = worst.difference, worst.words
    bars = directory / folder.numbered(folder.ERRORS, point)
    if bars.is_file() and mesh.n_p2 <= LARGEST_OF_ERRORS and (estimated := read_table(bars)["errors"]):
        worst = compare(estimates(scene, mesh, state), {name: item["estimate"] for name, item in estimated.items()})
        if narrow := next(
            (name for name, item in estimated.items() if not item["bar"] >= 2 * abs(item["estimate"])), ""
        ):
            worst = Difference(math.inf, f"the bar of {narrow} is less than twice its estimate")
        found.numbers[ERRORS], found.words[ERRORS] = worst.difference, worst.words
    return _report([found], tolerance)


@dataclass(frozen=True)
class _Findings:
    """Numbers of one state by name, its smallest det F, its forces, and words that say which step it belongs to.

    ``quantities`` are those that were recomputed, ``words`` say more of a number.
    """

    numbers: dict[str, float]
    min_jacobian: float
    forces: Forces
    place: str
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)

    def compare(self, reported: Mapping[str, Any], known: Mapping[str, Quantity], needed: Collection[str]) -> None:
        """Take in more of what is reported, and of what must be."""
        worst = compare(known, reported, needed)
        if not worst.difference <= self.numbers.get(QUANTITIES, -math.inf):
            self.numbers[QUANTITIES], self.words[QUANTITIES] = worst.difference, worst.words


def _examine(
    system: System,
    state: RawState,
    reported: Mapping[str, Any],
    place: str = "",
    whole: bool = False,
    later: Mapping[str, Any] | None = None,
) -> _Findings:
    """Examine a state; if its quantities are the ``whole`` of what is reported, none may be missing.

    What is to be compared ``later`` says which of several equal places is meant.
    """
    residual = compute_residual(system, state)
    forces = compute_forces(system, state, residual)
    numbers = residual.relative | {"dirichlet": _dirichlet(system, state)}
    known, outlet = recompute(system, state, forces, {**reported, **(later or {})}), at_outlet(system, state)
    if outlet:
        numbers["outlet_difference"] = compare(outlet, _only(reported, outlet), outlet).difference
    numbers |= _force_differences(known, reported)
    found = _Findings(numbers, residual.min_jacobian, forces, place, known | outlet)
    elsewhere = (_FORCES & known.keys()) | outlet.keys()
    others = {name: value for name, value in reported.items() if name not in elsewhere}
    found.compare(others, known, known.keys() - elsewhere if whole else ())
    return found


def _only(reported: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in reported.items() if name in names}


def _examine_steps(
    directory: Path, scene: Scene, mesh: RawMesh, last: Mapping[str, Any], shown: Shown | None
) -> list[_Findings]:
    """Examine every step that the run folder lists; ``last`` are the quantities reported of the last one."""
    entries = read_steps(directory)
    if not entries:
        raise ValueError(f"{directory / folder.STEPS}: no step is listed")
    scenes = [*scenes_before(directory), (entries[-1].step, scene)]  # of a run that was changed, each up to a step
    systems = [System.build(problem_from_scene(each), mesh) for _, each in scenes]
    thetas, outlets = [theta_of(each) for _, each in scenes], [_with_reservoir(each) for each in systems]
    history = History.read(directory / folder.TIME_HISTORY)
    numbers = range(1, max(len(history), entries[-1].step) + 1)
    of_step = [min(bisect_left(scenes, n, key=itemgetter(0)), len(scenes) - 1) for n in numbers]
    weights = [thetas[i](k, n) for n, i, k in zip(numbers, of_step, history.columns["step"], strict=False)]
    stored = {name: reservoirs([outlets[i][name] for i in of_step], history, weights) for name in outlets[0]}
    outlet = systems[0].problem.outlet
    cycles = read_cycles(directory)
    found, passages, corrector = [], [], Corrector()
    for entry in entries:
        step, number = Step(entry.k, entry.theta, entry.time), entry.step
        system, (_, scene) = systems[of_step[number - 1]], scenes[of_step[number - 1]]
        refuse_other_step(scene, step, number)
        history.refuse_other(number, step)
        row, before = history.quantities(number), read_state(directory / entry.old, mesh)
        after = read_state(directory / entry.new, mesh)
        stepping = system.stepping(before, step, {name: values[number - 1] for name, values in stored.items()})
        place, later = f" in step {number} at {step.time:g} s", last if entry is entries[-1] else None
        reported = entry.quantities | {name: row[name] for name in AT_OUTLET if name in row}
        reported |= dict(zip(WINDKESSEL, entry.windkessel or (), strict=False))
        found.append(_examine(stepping, after, reported, place, later=later))
        if number == 1 and (off := start_difference(scene, system, before)) is not None:
            found[-1].numbers[START] = off
        accepted = scene.solver.step_tolerance or 0.0
        if not 0.0 <= entry.tolerance <= accepted * (1.0 + _SAME):
            text = f"step {number} was solved to {entry.tolerance!r}, solver.step_tolerance is {accepted!r}"
            raise ValueError(f"{directory / folder.STEPS}: {text}")
        if entry.tolerance > 0.0:
            for name in _INEXACT & found[-1].numbers.keys():
                del found[-1].numbers[name]
            if 4 * mesh.n_p2 <= LARGEST:
                found[-1].numbers[STEP_ERROR] = corrector.missing(stepping, after) / entry.tolerance
        quantities = {**found[-1].quantities, **energies(stepping, after, history.before(number))}
        if outlet is not None and outlet.presses:  # which is compared as that
            row = {name: value for name, value in row.items() if name not in AT_OUTLET}
        found[-1].compare(row, quantities, quantities.keys() & IN_HISTORY)
        if (shear := wall_shear(system, after)) is not None and shown is not None:
            found[-1].numbers["wall_difference"] = shear.difference(*shown(scene, mesh, after))
        if cycles and shear is not None and (start := wall_shear(system, before)) is not None:
            passages.append(Passage(step.start, step.time, start, shear))
    if entry.tolerance > 0.0:
        raise ValueError(f"{directory / folder.STEPS}: the last step, {number}, was not solved to round-off")
    if (scene.start or (scene.time is not None and scene.time.initial)) and entries[0].step != 1:
        raise ValueError(f"{directory / folder.STEPS}: the first step, whose start the scene states, is not listed")
    if number != len(history):
        raise ValueError(f"{history.path}: {len(history)} rows, but the last step is {number}")
    point = directory / folder.numbered(folder.STATE, 1)
    if not all(map(np.array_equal, after.fields, read_state(point, mesh).fields)):
        raise ValueError(f"{point}: not the state at the end of the last step, {entry.new}")
    found[-1].compare(last, found[-1].quantities, found[-1].quantities.keys() - set(WINDKESSEL))
    for cycle in cycles:
        difference = largest([cycle_difference(cycle, passages), found[-1].numbers.get("wall_difference", 0.0)])
        found[-1].numbers["wall_difference"] = difference
    return found


def _with_reservoir(system: System) -> dict[str, Outlet]:
    """Return the outlets whose pressure comes from the history, by name, which an only one does not have."""
    found = {own.name: own for each in system.problem.boundaries if (own := each.outlet) is not None and own.stores}
    only = system.problem.outlet
    return found | ({"": only} if only is not None and only.presses else {})


def _report(found: Sequence[_Findings], tolerance: float) -> CheckReport:
    """Gather what was found in one state, or in several: then the worst of each number counts."""
    names = list(dict.fromkeys(name for each in found for name in each.numbers))
    worst = {name: max(found, key=lambda each: _badness(each.numbers.get(name, -math.inf))) for name in names}
    inverted = found[int(np.argmin([each.min_jacobian for each in found]))]
    numbers: dict[str, Any] = {name: worst[name].numbers[name] if name in worst else None for name in _WORDS}
    failures = _failures(worst, inverted, tolerance)
    return CheckReport(
        **numbers,
        min_jacobian=inverted.min_jacobian,
        tolerance=tolerance,
        forces=found[-1].forces,
        failures=failures,
    )


def _badness(number: float) -> float:
    return math.inf if math.isnan(number) else number


def _dirichlet(system: System, state: RawState) -> float:
    """Largest deviation from the prescribed u, v, p, ps, each relative to its own scale."""
    rows, old = system.rows, system.increment.old if system.increment is not None else state
    so_far = (*travelled(system, terms=True), 0.0, 0.0)
    fields = zip(state.fields, rows.prescribed.fields, rows.given, old.fields, so_far, strict=True)
    sliding = ((state.u, rows.u_normal), (state.v, rows.v_normal))
    off = [relative(*(largest(np.abs(part).ravel()) for part in (across(*each), each[0]))) for each in sliding]
    if (level := system.problem.mean_pressure) is not None and system.fluid is not None:
        size = largest([abs(level), *np.abs(state.p)])
        off.append(relative(abs(reference_pressure(system.fluid, state) - level), size))
    return largest([*(_deviation(*each) for each in fields), *off])


def _deviation(values: Floats, prescribed: Floats, given: Mask, old: Floats, so_far: float = 0.0) -> float:
    """Largest deviation over the largest prescribed value, now or ``so_far``.

    Where that is rounding beside the field, now or before the step, as that of an inflow that passes through zero, it
    is over so much of the field.
    """
    if not given.any():
        return 0.0
    scale = largest(np.abs(prescribed[given]).ravel())
    field = _ROUNDING * largest(np.abs([values, old]).ravel())
    return relative(largest(np.abs(values - prescribed)[given].ravel()), max(scale, field, so_far))


def _force_differences(known: Mapping[str, Quantity], reported: Mapping[str, Any]) -> dict[str, float]:
    """Relative differences between reported and recomputed forces; a force that is not reported differs infinitely."""
    found = {f"{name}_difference": compare(known, _only(reported, {name}), {name}) for name in ("drag", "lift")}
    coefficients = _only(reported, {"drag_coefficient", "lift_coefficient"})
    if coefficients:
        found["coefficient_difference"] = compare(known, coefficients)
    return {name: each.difference for name, each in found.items()} if "drag" in known else {}


def _failures(worst: Mapping[str, _Findings], inverted: _Findings, tolerance: float) -> list[str]:
    """One sentence for each number, by name, that is above the tolerance or not a number where it is worst."""
    failures = []
    forces: dict[str, Forces] = {}
    for name, found in worst.items():
        allowed = {STEP_ERROR: ALLOWED, SLOPES: ALLOWED_OF_SLOPES, ERRORS: ALLOWED_OF_ERRORS}.get(name, tolerance)
        if not (number := found.numbers[name]) <= allowed:
            more = f" ({found.words[name]})" if name in found.words else ""
            failures.append(f"{name}: the {_WORDS[name]} is {number:.2e}{found.place}{more}, allowed is {allowed:.0e}")
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
