"""Verdict on a state that another program returned: residuals, prescribed values and forces."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ffsi.rawfiles import Floats, RawMesh, RawState, read_mesh, read_state
from ffsi.reference.forces import Forces, coefficient_scale, compute_forces
from ffsi.reference.from_scene import problem_from_scene, refuse_other_parameters
from ffsi.reference.problem import Problem
from ffsi.reference.residual import compute_residual
from ffsi.reference.system import Mask, System
from ffsi.scene import Scene

TOLERANCE = 1e-8
# A component below this fraction of the force is a difference of large numbers, compared on the scale of the force.
_SMALL_COMPONENT = 1e-3


@dataclass(frozen=True)
class CheckReport:
    """What the reference checker found; every number is relative and None where the scene has no such quantity.

    ``momentum``, ``continuity``, ``kinematics``, ``mesh_motion``, ``incompressibility`` (volume of mixed solids):
    residuals as docs/discretisation.md scales them.
    ``dirichlet``: largest deviation from a prescribed value. ``drag_difference``, ``lift_difference``,
    ``coefficient_difference``: reported against recomputed forces. ``min_jacobian``: smallest det F.
    ``forces``: the recomputed forces, both forms. ``failures``: one sentence for each number above ``tolerance``.
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

    ``reported_quantities`` may hold ``drag``, ``lift`` (N per metre depth), ``drag_coefficient``, ``lift_coefficient``;
    others are ignored. Raises ``ValueError`` if mesh, state and problem do not fit together.
    """
    system = System.build(problem, mesh)
    residual = compute_residual(system, state)
    forces = compute_forces(system, state, residual)
    dirichlet = _dirichlet(system, state)
    differences = _force_differences(system, forces, reported_quantities)
    numbers = residual.relative | {"dirichlet": dirichlet} | differences
    return CheckReport(
        momentum=numbers.get("momentum"),
        continuity=numbers.get("continuity"),
        kinematics=numbers.get("kinematics"),
        mesh_motion=numbers.get("mesh_motion"),
        incompressibility=numbers.get("incompressibility"),
        dirichlet=dirichlet,
        drag_difference=numbers.get("drag_difference"),
        lift_difference=numbers.get("lift_difference"),
        coefficient_difference=numbers.get("coefficient_difference"),
        min_jacobian=residual.min_jacobian,
        tolerance=tolerance,
        forces=forces,
        failures=_failures(numbers, residual.min_jacobian, forces, tolerance),
    )


def check_run(directory: Path, scene: Scene, point: int = 1, tolerance: float = TOLERANCE) -> CheckReport:
    """Check one point of a run folder against the scene that it was run with.

    The scene must carry the values that the run really used. Raises ``ValueError`` where the parameters in the
    point's JSON say otherwise or a file does not fit, and ``OSError`` if one is missing.
    """
    directory = Path(directory)
    outcome = json.loads((directory / f"point-{point:04d}.json").read_text(encoding="utf-8"))
    refuse_other_parameters(scene, outcome.get("parameters", {}))
    mesh = read_mesh(directory / "mesh.bin")
    state = read_state(directory / f"point-{point:04d}.bin", mesh)
    return check_state(problem_from_scene(scene), mesh, state, outcome.get("quantities", {}), tolerance)


def _dirichlet(system: System, state: RawState) -> float:
    """Largest deviation from the prescribed u, v, p, ps, each relative to its own scale."""
    rows = system.rows
    return max(
        _deviation(state.u, rows.prescribed.u, rows.u_given),
        _deviation(state.v, rows.prescribed.v, rows.v_given),
        _deviation(state.p, rows.prescribed.p, rows.p_given),
        _deviation(state.ps, rows.prescribed.ps, rows.ps_given),
    )


def _deviation(values: Floats, prescribed: Floats, given: Mask) -> float:
    """Largest deviation over the first that is not zero of: the largest prescribed value, the largest value, one."""
    if not given.any():
        return 0.0
    scale = float(np.abs(prescribed[given]).max()) or float(np.abs(values).max()) or 1.0
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


def _failures(numbers: Mapping[str, float], min_jacobian: float, forces: Forces, tolerance: float) -> list[str]:
    """One sentence for each number that is above the tolerance or not a number."""
    words = {
        "momentum": "relative residual of the momentum",
        "continuity": "relative residual of the continuity",
        "kinematics": "largest solid velocity relative to the largest velocity",
        "mesh_motion": "relative residual of the mesh motion",
        "incompressibility": "relative residual of the volume of mixed solids",
        "dirichlet": "largest relative deviation from a prescribed value",
        "drag_difference": "relative difference between reported and recomputed drag",
        "lift_difference": "relative difference between reported and recomputed lift",
        "coefficient_difference": "relative difference between reported and recomputed force coefficients",
    }
    failures = []
    for name, number in numbers.items():
        if not number <= tolerance:
            failures.append(f"{name}: the {words[name]} is {number:.2e}, allowed is {tolerance:.0e}")
    if forces.total is not None and any("_difference" in text for text in failures):
        drag, lift = forces.total.residual
        failures.append(f"recomputed: drag {drag:.12g} N/m, lift {lift:.12g} N/m")
    if not min_jacobian > 0.0:
        failures.append(f"min_jacobian: a triangle is turned inside out, the smallest det F is {min_jacobian:.2e}")
    return failures
