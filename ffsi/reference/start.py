"""The state that a run in time starts from: against the scene's formulas, or the result that it is taken from."""

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, RawMesh, RawState
from ffsi.reference.elements import p2_basis
from ffsi.reference.relative import largest, relative
from ffsi.reference.residual import compute_residual
from ffsi.reference.system import System
from ffsi.scene import Scene

_NEAR = 32
# A point is in a triangle with barycentric coordinates down to this.
_INSIDE = -1e-9

Mask = NDArray[np.bool_]


def start_difference(scene: Scene, system: System, state: RawState) -> float | None:
    """Return how far the state at t = 0 is from what the scene says; None of a scene that starts from rest.

    Compared are u of the solids, v, and the pressures of mixed solids, each relative to its largest value, at the nodes
    where nothing is prescribed and that lie in a triangle of their region of the mesh that they come from; the rest is
    the residual of the mesh of the fluid, which follows the solids. ``system`` is the steady one. Infinite if of a
    region too few nodes are found.
    """
    if scene.time is None or (scene.time.initial is None and scene.start is None):
        return None
    rows, points = system.rows, system.mesh.p2_coordinates
    in_solid = np.zeros(len(points), dtype=np.bool_)
    for solid in system.solids.values():
        in_solid[solid.elements.nodes] = True
    free_v = ~rows.v_given & ~rows.v_normal.any(axis=1)
    if system.fluid is None:  # of the steady system v is none
        free_v = ~rows.u_given & ~rows.u_normal.any(axis=1)
    free_u = in_solid & ~rows.u_given & ~rows.u_normal.any(axis=1)
    expected_u, expected_v, found = _expected(scene, system.mesh)
    worst = []
    for values, expected, where in ((state.u, expected_u, free_u), (state.v, expected_v, free_v)):
        chosen = where & found
        if 2 * chosen.sum() < where.sum():
            return np.inf
        off = np.abs(values - expected)[chosen]
        worst.append(relative(largest(off.ravel()), largest(np.abs(expected[found]).ravel())))
    if (initial := scene.time.initial_state) is not None:
        for region, part in system.solids.items():
            if part.pressure is None:
                continue
            vertices = np.unique(part.elements.vertices)
            place = _place(initial.mesh, system.mesh.vertices[vertices], initial.mesh.region == region)
            pressure = (place.linear * initial.state.ps[part.pressure][initial.mesh.triangles[place.triangle]]).sum(
                axis=1
            )
            off = np.abs(state.ps[part.pressure][vertices] - pressure)[place.inside]
            worst.append(relative(largest(off), largest(np.abs(pressure))))
    equations = compute_residual(system, state).equations
    if "mesh_motion" in equations:
        worst.append(equations["mesh_motion"].relative)
    return largest(worst)


def _expected(scene: Scene, mesh: RawMesh) -> tuple[Floats, Floats, Mask]:
    """Return u and v (n, 2) at the nodes of a mesh, and where they are known: nowhere if a region lies elsewhere."""
    assert scene.time is not None
    points = mesh.p2_coordinates
    if (initial := scene.time.initial_state) is None:
        assert scene.start is not None
        x, y = points.T
        u, v = (
            np.column_stack([
                np.broadcast_to(scene.start.expression(f"{what}_{axis}").evaluate(x=x, y=y), x.shape) for axis in "xy"
            ])
            for what in ("displacement", "velocity")
        )  # fmt: skip
        return u, v, np.ones(len(points), dtype=np.bool_)
    u, v, found = np.zeros_like(points), np.zeros_like(points), np.zeros(len(points), dtype=np.bool_)
    for region in np.unique(mesh.region):
        nodes, chosen = np.unique(mesh.p2[mesh.region == region]), initial.mesh.region == region
        place = _place(initial.mesh, points[nodes], chosen) if chosen.any() else None
        if place is None or 2 * place.inside.sum() < len(nodes):
            return u, v, np.zeros_like(found)
        basis, there = p2_basis(place.linear[:, 1:]), initial.mesh.p2[place.triangle]
        for values, field in ((u, initial.state.u), (v, initial.state.v)):
            values[nodes[place.inside]] = np.einsum("na,nai->ni", basis, field[there])[place.inside]
        found[nodes[place.inside]] = True
    return u, v, found


class _Place:
    """Triangles (n,) of points, their barycentric coordinates ``linear`` (n, 3) there, and whether they are inside."""

    def __init__(self, triangle: NDArray[np.int64], linear: Floats) -> None:
        self.triangle, self.linear = triangle, linear
        self.inside: Mask = linear.min(axis=1) >= _INSIDE


def _place(mesh: RawMesh, points: Floats, chosen: Mask) -> _Place:
    """Find points (n, 2) among the triangles that are near; those that are in none have the nearest to being so."""
    from scipy.spatial import KDTree

    numbers = np.flatnonzero(chosen)
    corners = mesh.vertices[mesh.triangles[numbers]]
    near = KDTree(corners.mean(axis=1)).query(points, k=min(_NEAR, len(numbers)))[1].reshape(len(points), -1)
    a, b, c = (corners[near, i] for i in range(3))
    area = _cross(b - a, c - a)
    second, third = _cross(points[:, None] - a, c - a) / area, _cross(b - a, points[:, None] - a) / area
    linear = np.stack([1.0 - second - third, second, third], axis=-1)
    best = linear.min(axis=-1).argmax(axis=1)
    rows = np.arange(len(points))
    return _Place(numbers[near[rows, best]], linear[rows, best])


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
