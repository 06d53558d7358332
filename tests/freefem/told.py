"""Scripts in time that are told an exact solution: its sources, its prescribed values and its start.

Python writes the mesh and, for every time level t_n, a file with the nodal values of the exact fields and the work of
the sources; the patched script reads the two levels of a step. The templates know nothing of it.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from manufactured import Exact
from structured import structured_mesh

from ffsi.files.arrays import Floats, Ints, RawMesh, RawState, write_arrays
from ffsi.reference.elements import Elements, gauss_rule, line_basis
from ffsi.reference.problem import Manufactured
from ffsi.reference.system import System
from ffsi.scene import Scene
from ffsi.script.render import render

FLUID, SOLID = 1, 2
# Labels as scenes number such boundaries; UPPER: of two outlets, OPEN: of a solid, where nothing is prescribed.
INLET, OUTLET, WALL, UPPER, CLAMPED, OPEN, INTERFACE = 1, 2, 3, 4, 6, 7, 40

LINE = "// " + "-" * 64
# Before the conditions on the boundaries; the files number the P2 nodes in their own way.
LEVELS = (
    LINE
    + """ exact solution
int[int] nodeOf(1); // number of each P2 node of the files
real[int] exact(1), sources(1), sourcesBefore(1); // unknowns and work of the sources at the step's end; at its start
func int ReadNodes() {
  int[int] told(6*Th.nt);
  ifstream file("nodes.bin", binary);
  file.read(told);
  nodeOf.resize(N2);
  for (int i = 0; i < 6*Th.nt; ++i) nodeOf[told[i]] = p2[i];
  exact.resize(nDof); sources.resize(nDof); sourcesBefore.resize(nDof); sources = 0;
  return 0;
}
func int ReadLevel(int number) {
  ifstream file("level-" + number + ".bin", binary);
  real[int] told(N2), here(N2);
  sourcesBefore = sources; exact = 0; sources = 0;
  READ_NODAL
  READ_PRESSURE
  return 0;
}

"""
)
READ_NODAL = "file.read(told); here(nodeOf) = told; {name}({component}From:{component}To) = here;"
READ_PRESSURE = "real[int] pressure(NV); file.read(pressure); exact(pFrom:pVertexTo) = pressure;"
GIVEN = """real[int] told = exact;
  told -= unknowns; told = told.*free; // the free ones stay what they are
  unknowns = exact;
  unknowns -= told;
"""
# Before the main part. The mesh motion is that of the new state. In the condensed system u is theta k v + slaveBase in
# the solid, slaveBase at prescribed nodes, and the solution of the mesh motion with the right-hand side slaveBase.
SOURCES = """func int AddSources() {
  real[int] mean = timeTheta*sources, before = (1-timeTheta)*sourcesBefore, motion = sources;
  mean += before;
  MESH_SOURCES
  for (int i = 0; i < nDof; ++i) if (abs(tested[i]) < 1e-12) mean[i] = 0;
  oldRows += mean;
  return 0;
}

"""
SOLID_SOURCES = """real[int] held = displacementPerVelocity*exact;
  for (int i = uxFrom; i <= uyTo; ++i)
    if (free[i] < 0.5) slaveBase[i] = exact[i] - solidDof[i]*held[vxFrom-uxFrom+i];"""
MESH_SOURCES = """TIES for (int i = uxFrom; i <= uyTo; ++i) {
    if (meshRow[i] + (1-solidDof[i])*(free[i] < 0.5 ? abs(tested[i]) : 0) > 1e-12) mean[i] = sources[i];
    if (meshRow[i] > 0.5) slaveBase[i] = -motion[i];
  }"""


def replaced(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"the templates have changed: {old!r} occurs {text.count(old)} times"
    return text.replace(old, new)


def told(scene: Scene) -> str:
    """Return the scene's script, with mesh, sources, prescribed values and start from the files of `write`."""
    text = render(scene).replace('"geometry.mesh"', '"told.msh"')  # that of a mesh of one's own
    moves, pressures = scene.solid or scene.mesh_motion, scene.fluid or any(law.mixed for law in scene.solid.values())
    units = "real unitTime = unitLength/unitVelocity"  # what is told is in SI, and so has the script to be
    text = replaced(text, units, f"unitLength = 1; unitVelocity = 1; unitPressure = 1;\n{units}")
    text = replaced(text, "BuildMesh(StageLevel(0));\n", 'Th = readmesh("told.msh");\n')
    text = replaced(text, "  CheckMesh();\n", "")
    names = [(name, component) for name in ("exact", "sources") for component in ("ux", "uy", "vx", "vy")]
    skipped = "file.read(told);"
    nodal = "\n  ".join(
        READ_NODAL.format(name=name, component=component) if moves or component[0] == "v" else skipped
        for name, component in names
    )
    levels = LEVELS.replace("READ_NODAL", nodal).replace("READ_PRESSURE", READ_PRESSURE if pressures else "")
    text = replaced(text, f"{LINE} conditions", f"{levels}{LINE} conditions")
    text = replaced(text, "unknowns = unknowns.*free;\n", GIVEN)
    if not scene.inlet:
        text = text.replace("  SetInletVelocities(loadFactor, unknowns);\n", "")
    if scene.mesh_motion and not scene.mesh_motion.law.linear:
        balance = "    real[int] inside = right(extended), moved = extensionGiven*correction;"
        text = replaced(text, balance, f"    right += sources(uxFrom:uyTo);\n{balance}")
    given = SOLID_SOURCES if moves else ""
    if moves and scene.fluid:
        given += "\n  " + MESH_SOURCES.replace("TIES", "AddTied(motion);" if "AddTied" in text else "")
    text = replaced(text, f"{LINE} main\n", f"{SOURCES.replace('MESH_SOURCES', given)}{LINE} main\n")
    text = replaced(text, "  Conditions();\n", "  Conditions(); ReadNodes();\n")
    text = replaced(text, "oldX = X; pastX = X;", "ReadLevel(0); X = exact; oldX = X; pastX = X;")
    step = "  PredictStep();\n  real tolerance"
    return replaced(text, step, f"  ReadLevel(stepNumber+1); AddSources();\n{step}")


def solid_mesh(n: int) -> RawMesh:
    """The unit square, clamped at its left and right sides."""
    grid = np.linspace(0, 1, n + 1)
    return structured_mesh(grid, grid, lambda x, y: SOLID, lambda x, y: CLAMPED if x in (0, 1) else OPEN)


def both_mesh(n: int, half: int = OUTLET) -> RawMesh:
    """Fluid in the unit square, and below it a solid of half the height, clamped at its left and right sides.

    The right side of the fluid has another label in its upper ``half``.
    """

    def label(x: float, y: float) -> int:
        if y in (-0.5, 0.0, 1.0):
            return {-0.5: OPEN, 0.0: INTERFACE, 1.0: WALL}[y]
        return CLAMPED if y < 0 else INLET if x == 0 else half if y > 0.5 else OUTLET

    x, y = np.linspace(0, 1, n + 1), np.linspace(-0.5, 1, 3 * n // 2 + 1)
    return structured_mesh(x, y, lambda x, y: SOLID if y < 0 else FLUID, label)


def elements_of(mesh: RawMesh, region: int) -> Elements:
    chosen = mesh.region == region
    return Elements.build(mesh.vertices, mesh.triangles[chosen], mesh.p2[chosen])


def points_of(mesh: RawMesh, elements: Elements) -> Floats:
    """Quadrature points (7 n, 2) of n triangles."""
    points: Floats = elements.p1 @ mesh.vertices[elements.vertices]
    return points.reshape(-1, 2)


@dataclass(frozen=True)
class Solution:
    """Exact fields of each region, and the weight of div u in the mesh motion.

    ``acting``: what loads and openings add to the momentum, Pa (n, 2), by label, of X, t and the normals (n, 2);
    ``forces``: points of solids and the forces there, N/m, of t.
    """

    exact: Mapping[int, Exact]
    weight: float = 0.0
    acting: Mapping[int, Callable[[Floats, float, Floats], Floats]] = field(default_factory=dict)
    forces: Sequence[tuple[Floats, Callable[[float], Floats]]] = ()

    def with_fluid(self, **changed: object) -> "Solution":
        return replace(self, exact={**self.exact, FLUID: replace(self.exact[FLUID], **changed)})

    def turned(self, turn: Floats) -> "Solution":
        """The same where points, as rows, are multiplied by a rotation."""

        def there(act):
            return lambda x, t, normal: act(x @ turn.T, t, normal @ turn.T) @ turn

        return replace(
            self, exact={region: exact.turned(turn) for region, exact in self.exact.items()},
            acting={label: there(act) for label, act in self.acting.items()},
        )  # fmt: skip

    def velocity(self, region: int, x: Floats, t: float) -> Floats:
        """Velocity (n, 2) at reference points."""
        exact = self.exact[region]
        return exact.v(x, t) if region == FLUID else exact.solid_velocity(x, t)

    def nodal(self, mesh: RawMesh, t: float) -> tuple[Floats, Floats]:
        """Displacement and velocity (n2, 2) at the nodes; on the interface both regions must have the same."""
        u, v = np.full((2, mesh.n_p2, 2), np.nan)
        for region, exact in self.exact.items():
            nodes = np.unique(mesh.p2[mesh.region == region])
            x = mesh.p2_coordinates[nodes]
            for values, here in ((u, exact.u(x, t)), (v, self.velocity(region, x, t))):
                shared = ~np.isnan(values[nodes])
                np.testing.assert_allclose(values[nodes][shared], here[shared], rtol=0, atol=1e-14)
                values[nodes] = here
        return u, v

    def manufactured(self, mesh: RawMesh) -> Manufactured:
        """The same for the checker."""

        def at(x: Floats) -> Ints:
            return np.abs(mesh.p2_coordinates[:, None] - x).sum(axis=2).argmin(axis=0)

        @functools.cache
        def level(t: float) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
            return self.nodal(mesh, t), self.sources(mesh, t)

        def values(t: float) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
            return level(round(t, 12))

        def force(system: System) -> Floats:
            step = system.increment.step
            return step.mean(*(values(t)[1][1] for t in (step.time, step.start)))

        return Manufactured(
            lambda x, t: values(t)[0][0][at(x)], lambda x, t: values(t)[0][1][at(x)], force,
            motion=lambda system: values(system.increment.step.time)[1][0],
        )  # fmt: skip

    def solid_pressure(self, mesh: RawMesh, t: float) -> Floats:
        """Pressure (nv,) of the solid at the vertices: the start of one whose pressure follows from J."""
        exact = self.exact.get(SOLID)
        pressed = exact is not None and exact.solid_pressure is not None
        return exact.solid_pressure(mesh.vertices, t) if pressed else np.zeros(len(mesh.vertices))

    def sources(self, mesh: RawMesh, t: float) -> tuple[Floats, Floats]:
        """Work (n2, 2) of the sources of mesh motion and momentum, with the sign of the residual."""
        motion, momentum = np.zeros((2, mesh.n_p2, 2))
        for region, exact in self.exact.items():
            elements = elements_of(mesh, region)
            x = points_of(mesh, elements)
            if region == FLUID:
                assert np.abs(exact.mass(x, t)).max() < 1e-9, "the continuity has no source"
                add_force(motion, elements, exact.mesh_force(x, t, self.weight))
                add_traction(motion, mesh, region, WALL, of_stress(lambda x, e=exact: e.mesh_stress(x, t, self.weight)))
                add_force(momentum, elements, exact.fluid_force(x, t))
                stresses = dict.fromkeys((INTERFACE, WALL), exact.fluid_stress)
                stresses |= dict.fromkeys((INLET, OUTLET, UPPER), exact.outlet_stress)
            else:
                add_force(momentum, elements, exact.solid_force(x, t))
                stresses = dict.fromkeys((INTERFACE, OPEN), exact.solid_stress)
            for label, stress in stresses.items():
                add_traction(momentum, mesh, region, label, of_stress(lambda x, s=stress: s(x, t)))
        for label, act in self.acting.items():
            region = SOLID if label == OPEN else FLUID
            add_traction(momentum, mesh, region, label, lambda x, normal, act=act: act(x, t, normal))
        for point, force in self.forces:
            add_point_force(momentum, mesh, point, force(t))
        return motion, momentum

    def errors(self, mesh: RawMesh, state: RawState, end: float, between: float) -> dict[str, float]:
        """L2 errors: of u, v and a solid's pressure by J at the end, of implicit pressures at the time before it."""
        found = {}
        for region, exact in self.exact.items():
            elements = elements_of(mesh, region)
            x = points_of(mesh, elements)
            pairs = {
                "u": (elements.basis @ state.u[elements.nodes], exact.u(x, end)),
                "v": (elements.basis @ state.v[elements.nodes], self.velocity(region, x, end)),
            }
            if region == FLUID:
                pairs["p"] = (linear(elements, state.p), exact.p(exact.place(x, between), between))
            elif exact.solid_pressure is not None:
                pairs["p"] = (linear(elements, state.ps[0]), exact.solid_pressure(x, between))
            for name, (values, expected) in pairs.items():
                square = ((values - expected.reshape(values.shape)) ** 2).sum(axis=-1)
                found[region, name] = float(np.sqrt((square * elements.weights).sum()))
        return found


def linear(elements: Elements, values: Floats) -> Floats:
    """Values (n, 7, 1) of a P1 function at the quadrature points."""
    result: Floats = elements.p1 @ values[elements.vertices][..., None]
    return result


def add_force(total: Floats, elements: Elements, force: Floats) -> None:
    """Add the work of a force (7 n, 2) per area."""
    shaped = force.reshape(*elements.weights.shape, 2)
    np.add.at(total, elements.nodes, -np.einsum("tq,qa,tqi->tai", elements.weights, elements.basis, shaped))


def of_stress(stress: Callable[[Floats], Floats]) -> Callable[[Floats, Floats], Floats]:
    return lambda x, normal: np.einsum("nij,nj->ni", stress(x), normal)


def add_traction(
    total: Floats, mesh: RawMesh, region: int, label: int, traction: Callable[[Floats, Floats], Floats]
) -> None:
    """Add the work of a traction on the edges of a label, of X and the normal out of the region, which is convex."""
    inside, nodes = np.unique(mesh.p2[mesh.region == region]), mesh.edge_nodes[mesh.label == label]
    start, end = mesh.p2_coordinates[nodes[:, 0]], mesh.p2_coordinates[nodes[:, 1]]
    length = np.hypot(*(end - start).T)[:, None]
    normal = (end - start)[:, ::-1] * [1.0, -1.0] / length
    outward = start - mesh.p2_coordinates[inside].mean(axis=0)
    normal *= np.sign(np.einsum("nj,nj->n", normal, outward))[:, None]
    parameters, weights = gauss_rule()
    points = start[:, None] + parameters[:, None] * (end - start)[:, None]
    acting = traction(points.reshape(-1, 2), np.repeat(normal, len(parameters), axis=0)).reshape(points.shape)
    np.add.at(total, nodes, -np.einsum("q,qa,nqi,n->nai", weights, line_basis(parameters)[0], acting, length[:, 0]))


def add_point_force(total: Floats, mesh: RawMesh, point: Floats, force: Floats) -> None:
    """Take the work of a force at a point off, by the P2 functions of the first triangle that has it."""
    corners = mesh.vertices[mesh.triangles]
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=-1)
    later = np.linalg.solve(sides, (point - corners[:, 0])[..., None])[..., 0]
    shares = np.column_stack([1 - later.sum(axis=1), later])
    (at, *_) = np.flatnonzero((shares > -1e-12).all(axis=1))
    a, b, c = shares[at]
    values = [a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * b * c, 4 * c * a, 4 * a * b]
    np.add.at(total, mesh.p2[at], np.outer(values, force))


def renamed(mesh: RawMesh, labels: Mapping[int, int]) -> RawMesh:
    """The same mesh with other labels in the place of these."""
    return replace(mesh, label=np.array([labels.get(label, label) for label in mesh.label.tolist()]))


def write(folder: Path, solution: Solution, mesh: RawMesh, times: Floats, labels: Mapping[int, int]) -> None:
    """Write mesh, with the labels of the scene, node numbers and time levels into the folder in which a script runs."""
    rows = [f"{len(mesh.vertices)} {len(mesh.triangles)} {len(mesh.edges)}"]
    rows += [f"{x!r} {y!r} 0" for x, y in mesh.vertices.tolist()]
    rows += [f"{a} {b} {c} {r}" for (a, b, c), r in zip((mesh.triangles + 1).tolist(), mesh.region, strict=True)]
    rows += [
        f"{a} {b} {label}" for (a, b), label in zip((mesh.edges + 1).tolist(), renamed(mesh, labels).label, strict=True)
    ]
    (folder / "told.msh").write_text("\n".join([*rows, ""]))
    write_arrays(folder / "nodes.bin", [mesh.p2.ravel()])
    for number, t in enumerate(times.tolist()):
        fields = [*solution.nodal(mesh, t), *solution.sources(mesh, t)]
        arrays = [field[:, i] for field in fields for i in (0, 1)]
        write_arrays(folder / f"level-{number}.bin", [*arrays, solution.solid_pressure(mesh, t)])
