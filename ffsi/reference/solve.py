"""Newton's method on the checker's own residual, for small cases: steady ones from rest, and steps in time.

The Jacobian is assembled from element matrices (27 local unknowns in the fluid, 12 or 15 in a solid) which a complex
step differentiates: it knows nothing of the formulas inside, and has no error of differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawState
from ffsi.reference import momentum, terms
from ffsi.reference.conditions import Load, Outlet, Support
from ffsi.reference.materials import Array
from ffsi.reference.relative import largest, norm, relative
from ffsi.reference.residual import Residual, compute_residual
from ffsi.reference.sizes import unknown_sizes
from ffsi.reference.slip import along
from ffsi.reference.step import Step
from ffsi.reference.system import FluidPart, Mask, Sides, SolidPart, System

if TYPE_CHECKING:  # a check of a solved state needs none of it, and it takes a quarter of a second to load
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import SuperLU

_COMPLEX_STEP = 1e-30
# An order for symmetric patterns, a third of the entries of COLAMD's; a pivot off the diagonal would spoil it.
_ORDER: Any = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 1e-4, "options": {"SymmetricMode": True}}
_SHORTEST_STEP = 2.0**-10

# Elements of one kind with k local unknowns and r local equations: a function of the unknowns (n, k) whose values are
# the residuals (n, r), the global numbers (n, k) of the unknowns and (n, r) of the equations.
_Group = tuple[Callable[[Array], Array], Ints, Ints]


class ConvergenceError(RuntimeError):
    """Newton's method did not reach the tolerance; the text says why and how far it came."""


@dataclass(frozen=True)
class Solution:
    """A converged state and Newton's history, one entry per iteration.

    ``residuals``: the largest relative residual of any equation before each correction and at the end;
    ``corrections``: norm of the correction relative to the unknowns, the largest of u, v, p, ps; ``steps``: its length.
    """

    state: RawState
    residual: Residual
    residuals: list[float]
    corrections: list[float]
    steps: list[float]


def solve(
    system: System, tolerance: float = 1e-10, max_iterations: int = 15, start: RawState | None = None
) -> Solution:
    """Solve the steady system from rest, or from ``start``, with the prescribed values imposed.

    ``tolerance`` bounds the relative residual of every equation. A step is halved until no triangle is turned inside
    out. Raises ``ConvergenceError`` after ``max_iterations`` corrections, for a singular Jacobian, if no step is short
    enough, or if the start has a triangle inside out.
    """
    state = impose(system, start or system.rows.prescribed)
    residual = compute_residual(system, state)
    if not residual.min_jacobian > 0.0:
        raise ConvergenceError(f"{system.problem.name}: the start turns a triangle inside out")
    residuals = [largest(residual.relative.values())]
    corrections: list[float] = []
    steps: list[float] = []
    while not residuals[-1] <= tolerance:
        if len(steps) == max_iterations:
            raise ConvergenceError(f"{system.problem.name}: not converged, relative residuals {residuals}")
        correction = Factors.of(system, state).correct(system, state, residual)
        state, residual, step = damped_step(system, state, correction)
        residuals.append(largest(residual.relative.values()))
        pairs = zip(correction.fields, state.fields, strict=True)
        corrections.append(largest(relative(norm(change), norm(whole)) for change, whole in pairs))
        steps.append(step)
    return Solution(state, residual, residuals, corrections, steps)


def solve_step(
    system: System,
    old: RawState,
    step: Step,
    tolerance: float = 1e-10,
    max_iterations: int = 15,
    start: RawState | None = None,
    reservoir: float = 0.0,
) -> Solution:
    """Solve one time step from the state ``old``; the first guess is ``start``, or else ``old``.

    ``system`` may be the steady one or that of any other step; ``reservoir`` Pa is the pressure behind an outlet that
    stores fluid, at the start. Raises ``ConvergenceError`` as ``solve`` does.
    """
    return solve(system.stepping(old, step, reservoir), tolerance, max_iterations, start or old)


def jacobian(system: System, state: RawState) -> csc_array:
    """Jacobian of ``residual_vector`` by the unknowns in the order u, v, p, ps, (N, N)."""
    from scipy.sparse import coo_array, diags_array

    source, given = _row_sources(system)
    size, unknowns = len(source), flat(state)
    rows, columns, values = [], [], []
    for function, local, equations in _groups(system, state):
        matrices = _differentiate(function, unknowns[local])
        rows.append(np.broadcast_to(equations[:, :, None], matrices.shape).ravel())
        columns.append(np.broadcast_to(local[:, None, :], matrices.shape).ravel())
        values.append(matrices.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    matrix = coo_array(entries, shape=(size + 2 * system.mesh.n_p2, size)).tocsr()
    identity = diags_array(given.astype(float))
    result: csc_array = (diags_array((~given).astype(float)) @ matrix[source] + identity).tocsc()
    sliding = _sliding(system)
    result = (result - sliding @ result + sliding).tocsc() if sliding.nnz else result
    if (closed := _of_level(system)) is not None:
        whole = result.tolil()
        whole[closed[0]] = closed[1]
        result = whole.tocsc()
    return result


def jacobian_along(system: System, state: RawState, direction: RawState) -> Floats:
    """Return ``jacobian`` times a direction, (N,), by elements in extended precision: without what a matrix rounds."""
    source, given = _row_sources(system)
    unknowns, along_it = flat(state), flat(direction).astype(np.longdouble)
    rows = np.zeros(len(source) + 2 * system.mesh.n_p2, dtype=np.longdouble)
    for function, local, equations in _groups(system, state):
        forward = unknowns[local] + 1j * np.longdouble(_COMPLEX_STEP) * along_it[local]
        np.add.at(rows, equations, np.imag(function(forward)) / np.longdouble(_COMPLEX_STEP))
    vector = np.where(given, along_it, rows[source])
    vector += _sliding(system) @ (along_it - vector)
    if (closed := _of_level(system)) is not None:
        vector[closed[0]] = closed[1] @ along_it
    return np.asarray(vector)


def residual_vector(system: System, state: RawState, residual: Residual) -> Floats:
    """Residual of every unknown's row, (N,) with N = 4 n2 + nv + number of mixed solids nv, in the order u, v, p, ps.

    The rows of u hold the mesh motion in the fluid and, in solids, the momentum of the steady system or the kinematics
    of a time step; those of v the momentum in the fluid and, in solids, the steady kinematics v = 0 or the momentum of
    the step; those of p the continuity, those of ps the volume of mixed solids. A prescribed unknown's row is its
    deviation.
    """
    names = ("mesh_motion", "momentum", "continuity", "incompressibility")
    found, nodes = residual.equations, np.arange(system.mesh.n_p2)
    equations = [
        found[name].residual.ravel() if name in found else np.zeros(values.size)
        for name, values in zip(names, state.fields, strict=True)
    ]
    equations.append(np.real(momentum.kinematics(system, nodes, state.u, state.v)).ravel())
    source, given = _row_sources(system)
    # The prescribed v is zero in steady solids: there the kinematics is a deviation like the boundary conditions.
    vector = np.where(given, flat(state) - flat(system.rows.prescribed), np.concatenate(equations)[source])
    sliding = _sliding(system)
    vector = vector - sliding @ vector + sliding @ flat(state)
    if (closed := _of_level(system)) is not None:
        vector[closed[0]] = closed[1] @ flat(state) - closed[2]
    return np.asarray(vector)


def _of_level(system: System) -> tuple[int, Floats, float] | None:
    """Return a row of the continuity that follows from the others, and that of the mean pressure (N,) with its value.

    None where the fluid is not closed.
    """
    if (level := system.problem.mean_pressure) is None or system.fluid is None:
        return None
    n2, elements = system.mesh.n_p2, system.fluid.elements
    weights = np.zeros(4 * n2 + system.rows.p_given.size + system.rows.ps_given.size)
    np.add.at(weights, 4 * n2 + elements.vertices, elements.area[:, None] / (3 * elements.area.sum()))
    return 4 * n2 + int(elements.vertices.min()), weights, level


def _sliding(system: System) -> csc_array:
    """N N^T at the nodes that slide, in the rows of u and v that have no value, zero elsewhere; (N, N)."""
    from scipy.sparse import coo_array

    given = _row_sources(system)[1]
    normals = np.concatenate([system.rows.u_normal, system.rows.v_normal])
    at = np.flatnonzero(normals.any(axis=1) & ~given[: 2 * len(normals) : 2])
    numbers, blocks = 2 * at[:, None] + np.arange(2), normals[at, :, None] * normals[at, None, :]
    rows, columns = (np.broadcast_to(each, blocks.shape).ravel() for each in (numbers[:, :, None], numbers[:, None, :]))
    return coo_array((blocks.ravel(), (rows, columns)), shape=(len(given),) * 2).tocsc()


def impose(system: System, state: RawState) -> RawState:
    """Replace the values of ``state`` where others are prescribed."""
    given = np.split(_row_sources(system)[1], np.cumsum([values.size for values in state.fields])[:-1])
    fields = zip(given, system.rows.prescribed.fields, state.fields, strict=True)
    u, v, *pressures = (np.where(mask.reshape(own.shape), value, own) for mask, value, own in fields)
    return RawState(along(u, system.rows.u_normal), along(v, system.rows.v_normal), *pressures)


def _row_sources(system: System) -> tuple[Ints, Mask]:
    """Return the number of every unknown's equation, and whether it has a value instead; both (N,).

    Equations are numbered like the unknowns: mesh motion, momentum, continuity, volume in the order of u, v, p, ps;
    the kinematics of all nodes follow them. Velocities in steady solids are known: zero.
    """
    rows, n2 = system.rows, system.mesh.n_p2
    size = 4 * n2 + rows.p_given.size + rows.ps_given.size
    source, v_given = np.arange(size), rows.v_given
    if system.increment is None:
        source[: 2 * n2][np.repeat(rows.momentum & ~rows.u_given & ~rows.mesh_motion, 2)] += 2 * n2
        v_given = v_given | rows.kinematics
    else:
        source[: 2 * n2][np.repeat(rows.kinematics, 2)] += size
    given = [np.repeat(rows.u_given, 2), np.repeat(v_given, 2), rows.p_given, rows.ps_given.ravel()]
    return source, np.concatenate(given)


def _groups(system: System, state: RawState) -> Iterator[_Group]:
    if system.fluid is not None:
        yield _fluid_group(system, system.fluid)
        for outlet, sides in system.outlets:
            yield _outlet_group(system, system.fluid, outlet, sides)
            if outlet.presses:
                yield _outlet_pressure_group(system, outlet, sides)
    for solid in system.solids.values():
        yield _solid_group(system, solid, len(state.p))
    for held, edges in momentum.supports(system):
        yield _support_group(system, held, edges)
    yield from (_load_group(system, acting, sides) for acting, sides in system.loaded if acting.follows)
    if system.increment is not None and system.solids:
        yield _kinematics_group(system, state)


def _fluid_group(system: System, fluid: FluidPart) -> _Group:
    """Fluid triangles: 12 rows of mesh motion, 12 of momentum, 3 of continuity by as many u, v, p."""
    elements, n2 = fluid.elements, system.mesh.n_p2
    n = len(elements)

    def function(local: Array) -> Array:
        u, v, p = local[:, :12].reshape(n, 6, 2), local[:, 12:24].reshape(n, 6, 2), local[:, 24:]
        flow = terms.Flow.at_points(elements, u, v, p)
        balance = _total(momentum.fluid_momentum(system, fluid, u, v, flow))
        mass = _total(terms.continuity(elements, flow))
        motion: Array = np.zeros((n, 12))
        if fluid.motion is not None:
            motion = _total(terms.mesh_motion(fluid.motion, fluid.alpha, elements, u)).reshape(n, 12)
        return np.hstack([motion, balance.reshape(n, 12), mass])

    u_numbers = _numbers(elements.nodes)
    numbers = np.hstack([u_numbers, 2 * n2 + u_numbers, 4 * n2 + elements.vertices])
    return function, numbers, numbers


def _outlet_group(system: System, fluid: FluidPart, outlet: Outlet, sides: Sides) -> _Group:
    """Sides at the outlet: 6 rows of momentum by as many v."""
    numbers = 2 * system.mesh.n_p2 + _numbers(sides.nodes)

    def function(local: Array) -> Array:
        found = momentum.outlet(system, fluid.law, outlet, sides, local.reshape(len(local), 3, 2))
        return _total(found).reshape(len(local), 6) if found else np.zeros_like(local)

    return function, numbers, numbers


def _outlet_pressure_group(system: System, outlet: Outlet, sides: Sides) -> _Group:
    """All of the outlet as one element, since its pressure is a function of the flow rate through it."""
    nodes, places = np.unique(sides.nodes, return_inverse=True)
    places = places.reshape(sides.nodes.shape)
    numbers = 2 * system.mesh.n_p2 + _numbers(nodes[None, :])

    def function(local: Array) -> Array:
        v = local.reshape(len(nodes), 2)[places]
        found = np.zeros((len(nodes), 2), dtype=local.dtype)
        np.add.at(found, places, momentum.outlet_pressure(system, outlet, sides, v))
        return found.reshape(1, -1)

    return function, numbers, numbers


def _support_group(system: System, held: Support, edges: Ints) -> _Group:
    """Supported edges (n, 3): 6 rows of momentum, numbered like v, by 6 u and 6 v."""
    n2 = system.mesh.n_p2
    n, numbers = len(edges), _numbers(edges)

    def function(local: Array) -> Array:
        u, v = local[:, :6].reshape(n, 3, 2), local[:, 6:].reshape(n, 3, 2)
        return momentum.support(system, held, edges, u, v).reshape(n, 6)

    return function, np.hstack([numbers, 2 * n2 + numbers]), 2 * n2 + numbers


def _load_group(system: System, acting: Load, sides: Sides) -> _Group:
    """Sides of a solid under a pressure that follows them: 6 rows of momentum, numbered like v, by 6 u."""
    n, numbers = len(sides.nodes), _numbers(sides.nodes)

    def function(local: Array) -> Array:
        return momentum.load(system, acting, sides, local.reshape(n, 3, 2)).reshape(n, 6)

    return function, numbers, 2 * system.mesh.n_p2 + numbers


def _solid_group(system: System, solid: SolidPart, nv: int) -> _Group:
    """Solid triangles: 12 momentum rows, numbered like v, by 12 u and 12 v; if mixed, 3 volume rows by pressures."""
    elements, n2 = solid.elements, system.mesh.n_p2
    n, numbers = len(elements), _numbers(elements.nodes)
    pressures = np.empty((n, 0), dtype=np.int64)
    if solid.pressure is not None:
        pressures = 4 * n2 + (1 + solid.pressure) * nv + elements.vertices

    def function(local: Array) -> Array:
        u, v, p = local[:, :12].reshape(n, 6, 2), local[:, 12:24].reshape(n, 6, 2), local[:, 24:]
        balance = _total(momentum.solid_momentum(system, solid, u, v, p)).reshape(n, 12)
        volume = terms.incompressibility(solid.law, elements, u, p)
        return np.hstack([balance, _total(volume)]) if volume else balance

    return function, np.hstack([numbers, 2 * n2 + numbers, pressures]), np.hstack([2 * n2 + numbers, pressures])


def _kinematics_group(system: System, state: RawState) -> _Group:
    """Nodes in solids: 2 rows of kinematics by 2 u and 2 v."""
    nodes = np.flatnonzero(system.rows.kinematics)
    numbers = _numbers(nodes[:, None])

    def function(local: Array) -> Array:
        return momentum.kinematics(system, nodes, local[:, :2], local[:, 2:])

    return function, np.hstack([numbers, state.u.size + numbers]), flat(state).size + numbers


def _differentiate(function: Callable[[Array], Array], unknowns: Floats) -> Floats:
    """Local Jacobians (n, rows, unknowns), one local unknown after the other on all elements at once."""
    columns = []
    for k in range(unknowns.shape[1]):
        forward = unknowns.astype(complex)
        forward[:, k] += 1j * _COMPLEX_STEP
        columns.append(np.imag(function(forward)) / _COMPLEX_STEP)
    return np.stack(columns, axis=2)


@dataclass(frozen=True)
class Factors:
    """Sparse LU factors of an equilibrated Jacobian: those of its rows and columns times ``rows`` and ``columns``.

    Unknowns are counted in their own sizes before it is equilibrated, since rows add entries of several units.
    """

    rows: Floats
    columns: Floats
    factors: SuperLU

    @classmethod
    def of(cls, system: System, state: RawState) -> Factors:
        """Factorise the Jacobian of a state. Raises ``ConvergenceError`` if it is singular."""
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        sizes = [size or 1.0 for size in unknown_sizes(system, state)]
        columns = np.repeat(sizes, [values.size for values in state.fields])
        matrix = jacobian(system, state) @ diags_array(columns)
        rows = 1.0 / abs(matrix).max(axis=1).toarray()
        matrix = diags_array(rows) @ matrix
        equilibrated = 1.0 / abs(matrix).max(axis=0).toarray()
        matrix, columns = matrix @ diags_array(equilibrated), columns * equilibrated
        try:
            return cls(rows, columns, splu(matrix.tocsc(), **_ORDER))
        except RuntimeError as error:
            raise ConvergenceError(f"{system.problem.name}: the Jacobian is singular ({error})") from error

    def correct(self, system: System, state: RawState, residual: Residual) -> RawState:
        """Return the Newton correction of a state with this residual, prescribed values exact."""
        return self.solution(system, state, residual_vector(system, state, residual))

    def solution(self, system: System, state: RawState, deviation: Floats) -> RawState:
        """Return what takes ``deviation``, in the rows of ``residual_vector``, off the linear residual."""
        solution = -self.columns * self.factors.solve(self.rows * deviation)
        _, given = _row_sources(system)
        solution[given] = -deviation[given]  # without the rounding of the elimination
        parts = np.split(solution, np.cumsum([values.size for values in state.fields])[:-1])
        return RawState(*(part.reshape(own.shape) for part, own in zip(parts, state.fields, strict=True)))


def damped_step(system: System, state: RawState, correction: RawState) -> tuple[RawState, Residual, float]:
    """Go the largest step 1, 1/2, 1/4, ... along the correction that keeps det F positive everywhere.

    Returns the new state, its residual and the step. Raises ``ConvergenceError`` if that step is below 1/1024.
    """
    step = 1.0
    while step >= _SHORTEST_STEP:
        new = moved(state, correction, step)
        residual = compute_residual(system, new)
        if residual.min_jacobian > 0.0:
            return new, residual, step
        step *= 0.5
    raise ConvergenceError(f"{system.problem.name}: every step turns a triangle inside out")


def moved(state: RawState, correction: RawState, step: float = 1.0) -> RawState:
    """Add a part of a correction to a state."""
    return RawState(*(old + step * change for old, change in zip(state.fields, correction.fields, strict=True)))


def _numbers(nodes: Ints) -> Ints:
    """Numbers (n, 2 k) of the two components at nodes (n, k)."""
    return (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1)


def flat(state: RawState) -> Floats:
    """All unknowns in the order u, v, p, ps, (N,)."""
    return np.concatenate([values.ravel() for values in state.fields])


def _total(local: Mapping[str, Array]) -> Array:
    return np.asarray(np.sum(list(local.values()), axis=0))
