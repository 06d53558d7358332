"""Wall shear stress: the traction of the fluid along its walls, at the middles of their edges, on the deformed mesh."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawMesh, RawState
from ffsi.result.fields import FLUID
from ffsi.result.gradients import node_gradients
from ffsi.scene import Scene, boundaries
from ffsi.scene.fluids import IncompressibleFluid


@dataclass(frozen=True)
class WallPoints:
    """The middles of the edges at which the fluid meets a wall, in the order of the walls, the fluid to the left.

    The gradient of a quadratic function is linear in its triangle: its value there is its mean over the edge.
    `label` (n,) is that of the edge, `chain` (n,) the number of its connected line, from 0, `ends` (n, 2) and `middle`
    (n,) its P2 nodes; `nodes` (n, 6) those of the fluid's triangle, as in `RawMesh.p2`, and `gradient` (n, 6, 2) the
    derivatives of its shape functions, 1/m. All in the reference mesh: `normal` (n, 2), a unit vector out of the fluid,
    `position` (n, 2) and `length` (n,), m, and `arc` (n,), the distance along the chain from its start, m.
    """

    label: Ints
    chain: Ints
    ends: Ints
    middle: Ints
    nodes: Ints
    gradient: Floats
    normal: Floats
    position: Floats
    length: Floats
    arc: Floats


def wall_labels(scene: Scene) -> list[int]:
    """Return the labels of the boundaries at which the fluid meets a wall, elastic or rigid."""
    return [boundary.label for boundary in boundaries(scene) if boundary.role in ("no-slip", "interface")]


def wall_points(mesh: RawMesh, labels: Collection[int]) -> WallPoints:
    """Return the points of the walls with some labels, those of wet boundaries."""
    fluid = np.flatnonzero(mesh.region == FLUID)
    sides = mesh.sides[fluid].ravel()
    order = np.argsort(sides)
    wanted = np.flatnonzero(np.isin(mesh.label, list(labels)))
    keys = mesh.edge_keys[wanted]
    place = order[np.minimum(np.searchsorted(sides, keys, sorter=order), len(order) - 1)]
    wet = sides[place] == keys
    wanted, place = wanted[wet], place[wet]
    triangle, side = fluid[place // 3], place % 3
    corners = mesh.vertices[mesh.triangles[triangle]]  # (n, 3, 2)
    start = mesh.triangles[triangle, (side + 1) % 3]
    end = mesh.triangles[triangle, (side + 2) % 3]
    # In a triangle that is numbered clockwise, the other way round.
    edge = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    swap = edge[0][:, 0] * edge[1][:, 1] - edge[0][:, 1] * edge[1][:, 0] < 0
    start, end = np.where(swap, end, start), np.where(swap, start, end)
    sequence, chain = _chains(start, end)
    start, end, triangle, side, label = (
        values[sequence] for values in (start, end, triangle, side, mesh.label[wanted])
    )
    tangent = mesh.vertices[end] - mesh.vertices[start]
    length = np.hypot(*tangent.T)
    arc = np.cumsum(length) - length / 2
    first = np.diff(chain, prepend=-1) > 0
    arc -= (arc - length / 2)[first][chain]
    return WallPoints(
        label=label.astype(np.int64),
        chain=chain,
        ends=np.column_stack([mesh.vertex_nodes[start], mesh.vertex_nodes[end]]),
        middle=mesh.p2[triangle, 3 + side].astype(np.int64),
        nodes=mesh.p2[triangle].astype(np.int64),
        gradient=node_gradients(mesh.vertices[mesh.triangles[triangle]])[0][np.arange(len(side)), 3 + side],
        normal=np.column_stack([tangent[:, 1], -tangent[:, 0]]) / length[:, None],
        position=(mesh.vertices[start] + mesh.vertices[end]) / 2,
        length=length,
        arc=arc,
    )


def _chains(start: Ints, end: Ints) -> tuple[Ints, Ints]:
    """Return the order in which edges follow each other, and the number of the connected line of each."""
    following = dict(zip(start.tolist(), range(len(start)), strict=True))
    heads = np.flatnonzero(~np.isin(start, end)).tolist()
    found: dict[int, int] = {}  # the chain of each edge, in the order of the walls
    rest, number = set(range(len(start))), 0
    while rest:
        edge: int | None = heads.pop(0) if heads else min(rest)
        while edge is not None and edge in rest:
            rest.remove(edge)
            found[edge] = number
            edge = following.get(int(end[edge]))
        number += 1
    return np.array([*found], dtype=np.int64), np.array([*found.values()], dtype=np.int64)


def wall_shear_stress(points: WallPoints, state: RawState, fluid: IncompressibleFluid) -> Floats:
    """Return the shear stress of the fluid on its walls, (n, 2) Pa, a vector along the deformed wall.

    tau = t - (t.n) n with t = mu (grad v + grad v^T) n, spatial gradients, n the unit normal of the deformed wall into
    the fluid, mu at the shear rate of the wall: the force that the flow exerts on it.
    """
    deformation = np.einsum("nai,naj->nij", state.u[points.nodes], points.gradient) + np.eye(2)
    jacobian = deformation[:, 0, 0] * deformation[:, 1, 1] - deformation[:, 0, 1] * deformation[:, 1, 0]
    adjugate = np.empty_like(deformation)
    adjugate[:, 0, 0], adjugate[:, 1, 1] = deformation[:, 1, 1], deformation[:, 0, 0]
    adjugate[:, 0, 1], adjugate[:, 1, 0] = -deformation[:, 0, 1], -deformation[:, 1, 0]
    velocity = np.einsum("nai,naj->nij", state.v[points.nodes], points.gradient)
    spatial = velocity @ adjugate / jacobian[:, None, None]
    twice_rate = spatial + spatial.transpose(0, 2, 1)
    shear_rate = np.sqrt(0.5 * np.einsum("nij,nij->n", twice_rate, twice_rate))
    normal = -np.einsum("nji,nj->ni", adjugate, points.normal)  # -cof F N, into the fluid
    normal /= np.hypot(*normal.T)[:, None]
    traction = fluid.apparent_viscosity(shear_rate)[:, None] * np.einsum("nij,nj->ni", twice_rate, normal)
    return np.asarray(traction - np.einsum("ni,ni->n", traction, normal)[:, None] * normal)


def at_nodes(points: WallPoints, values: Floats, n_p2: int) -> Floats:
    """Return values (n, ...) at the points at all P2 nodes, (n2, ...): at a vertex the mean of its two edges.

    Off the walls they are NaN.
    """
    total, count = np.zeros((n_p2, *values.shape[1:])), np.zeros(n_p2)
    for nodes in (points.middle, *points.ends.T):
        np.add.at(total, nodes, values)
        np.add.at(count, nodes, 1.0)
    shape = (-1, *[1] * (values.ndim - 1))
    with np.errstate(invalid="ignore"):
        return np.asarray(total / count.reshape(shape))


def deformed_length(points: WallPoints, state: RawState) -> Floats:
    """Return the lengths (n,) of the deformed edges, m: the size of cof F N at the edge's middle times its length."""
    deformation = np.einsum("nai,naj->nij", state.u[points.nodes], points.gradient) + np.eye(2)
    tangent = np.column_stack([-points.normal[:, 1], points.normal[:, 0]])
    return np.asarray(np.hypot(*np.einsum("nij,nj->ni", deformation, tangent).T) * points.length)


def shown_stress(scene: Scene, mesh: RawMesh, state: RawState) -> tuple[Ints, Floats]:
    """Return, for the checker, the nodes in the middle of the walls' edges and the stress there, (n, 2) Pa."""
    points = wall_points(mesh, wall_labels(scene))
    assert scene.fluid is not None
    return points.middle, wall_shear_stress(points, state, scene.fluid)
