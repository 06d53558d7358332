"""What the mesh adds to the quantities of a steady state: one Newton step on the mesh with every triangle cut in four.

With Y the state carried to the fine mesh, d its correction there and J a quantity, J(Y) + J'(Y) d less J of the state
itself estimates the discretisation error (docs/numerics.md).
"""

from dataclasses import replace

import numpy as np

from ffsi.files.arrays import Floats, Ints, RawMesh, RawState
from ffsi.reference.elements import p2_basis
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.quantities import Quantity
from ffsi.reference.residual import compute_residual
from ffsi.reference.sensitivities import values_of
from ffsi.reference.solve import Factors, impose, moved
from ffsi.reference.system import System
from ffsi.scene import Scene

_STEP = 1e-3
# Estimates below this part of their quantity are measured on it: they are differences of it.
_SMALL = 1e-6
# Likewise of what is nothing but rounding, as a displacement that is 0 by symmetry.
_OF_NOTHING = 1e-2
# Vertices and middles of the four triangles, numbered as the P2 nodes of the whole one.
_CUT = np.array([(0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)])


def estimates(scene: Scene, mesh: RawMesh, state: RawState) -> dict[str, Quantity]:
    """Return the estimated error of every quantity of a steady state, in SI."""
    problem = problem_from_scene(scene)
    system = System.build(replace(problem, chords=True), fine := refined(mesh))
    start = impose(system, carried(mesh, fine, state))
    correction = Factors.of(system, start).correct(system, start, compute_residual(system, start))
    before, there = values_of(System.build(problem, mesh), state), values_of(system, start)
    ahead, behind = (values_of(system, moved(start, correction, place)) for place in (_STEP, -_STEP))
    slopes = {name: (ahead[name].value - behind[name].value) / (2 * _STEP) for name in before}
    found = {name: there[name].value + slopes[name] - known.value for name, known in before.items()}
    parts = {name: _SMALL if abs(known.value) >= known.scale else _OF_NOTHING for name, known in before.items()}
    return {name: Quantity(error, max(abs(error), parts[name] * before[name].scale)) for name, error in found.items()}


def refined(mesh: RawMesh) -> RawMesh:
    """Cut every triangle into four; its vertices are the P2 nodes of ``mesh``, by their numbers."""
    vertices = np.zeros((mesh.n_p2, 2))
    for local in range(3):
        vertices[mesh.p2[:, local]] = mesh.vertices[mesh.triangles[:, local]]
        ends = [mesh.triangles[:, (local + k) % 3] for k in (1, 2)]
        vertices[mesh.p2[:, 3 + local]] = 0.5 * (mesh.vertices[ends[0]] + mesh.vertices[ends[1]])
    triangles = mesh.p2[:, _CUT].reshape(-1, 3)
    nodes, middle = mesh.vertex_nodes[mesh.edges], _middles(mesh.p2)
    halfway = np.array([middle[frozenset(pair)] for pair in nodes.tolist()], dtype=np.int64)
    edges = np.vstack([np.column_stack([nodes[:, 0], halfway]), np.column_stack([halfway, nodes[:, 1]])])
    sides = np.sort(triangles[:, [(1, 2), (2, 0), (0, 1)]].reshape(-1, 2), axis=1)
    numbers = np.unique(sides, axis=0, return_inverse=True)[1].reshape(-1, 3)
    p2 = np.hstack([triangles, mesh.n_p2 + numbers])
    return RawMesh(vertices, triangles, np.repeat(mesh.region, 4), edges, np.tile(mesh.label, 2), p2)


def _middles(p2: Ints) -> dict[frozenset[int], int]:
    found: dict[frozenset[int], int] = {}
    for local in range(3):
        ends = p2[:, [(local + 1) % 3, (local + 2) % 3]].tolist()
        found.update(zip(map(frozenset, ends), p2[:, 3 + local].tolist(), strict=True))
    return found


def carried(mesh: RawMesh, fine: RawMesh, state: RawState) -> RawState:
    """Return a state of ``mesh`` as that of its refined one: the same functions."""
    corners = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0.5, 0.5), (0.5, 0, 0.5), (0.5, 0.5, 0)])
    places = corners[_CUT]  # (4, 3, 3) barycentric
    middles = np.stack([0.5 * (places[:, (k + 1) % 3] + places[:, (k + 2) % 3]) for k in range(3)], axis=1)
    basis = p2_basis(np.concatenate([places, middles], axis=1).reshape(-1, 3)[:, 1:])  # of the 24 nodes

    def quadratic(values: Floats) -> Floats:
        found = np.zeros((fine.n_p2, 2))
        found[fine.p2.reshape(-1, 24)] = np.einsum("kj,tjc->tkc", basis, values[mesh.p2])
        return found

    def linear(values: Floats) -> Floats:
        found = np.zeros(len(fine.vertices))
        found[mesh.p2] = values[mesh.triangles] @ corners.T
        return found

    return RawState(
        quadratic(state.u), quadratic(state.v), linear(state.p), np.array([linear(each) for each in state.ps])
    )
