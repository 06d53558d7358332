"""Scripts in time that are told an exact solution: its sources, its prescribed values and its start.

Python writes the mesh and, for every time level t_n, a file with the nodal values of the exact fields and the work of
the sources; the patched script reads the two levels of a step. The templates know nothing of it.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from manufactured import Exact
from structured import structured_mesh

from ffsi.files.arrays import Floats, RawMesh, RawState, write_arrays
from ffsi.reference.elements import Elements, gauss_rule, line_basis
from ffsi.scene import Scene
from ffsi.script.render import render

FLUID, SOLID = 1, 2
INLET, OUTLET, WALL, INTERFACE, CLAMPED = 1, 2, 3, 5, 6
OPEN = 8  # a label that no scene knows: nothing is prescribed there

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
DIRICHLET = """func int SetDirichlet(real[int] &unknowns) {
  real[int] told = exact;
  told -= unknowns; told = told.*free; // the free ones stay what they are
  unknowns = exact;
  unknowns -= told;
  return 0;
}
"""
# Before the main part. The mesh motion is that of the new state. In the condensed system u is theta k v + slaveBase in
# the solid, slaveBase at prescribed nodes, and the solution of the mesh motion with the right-hand side slaveBase.
SOURCES = """func int AddSources() {
  real[int] mean = timeTheta*sources, before = (1-timeTheta)*sourcesBefore, held = displacementPerVelocity*exact;
  mean += before;
  for (int i = uxFrom; i <= uyTo; ++i) if (free[i] < 0.5) slaveBase[i] = exact[i] - solidDof[i]*held[vxFrom-uxFrom+i];
  MESH_SOURCES
  mean = mean.*free;
  oldRows += mean;
  return 0;
}

"""
MESH_SOURCES = """for (int i = uxFrom; i <= uyTo; ++i) if (meshRow[i] > 0.5) {
    mean[i] = sources[i]; slaveBase[i] = -sources[i];
  }"""
HOLD = """  for (int i = 0; i < N2; ++i) if (solidNode[i]) {
    free[uxFrom+i] = 0; free[uyFrom+i] = 0; free[vxFrom+i] = 0; free[vyFrom+i] = 0;
  }
"""


def replaced(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, f"the templates have changed: {old!r} occurs {text.count(old)} times"
    return text.replace(old, new)


def told(scene: Scene, *, hold: bool = False) -> str:
    """Return the scene's script, with mesh, sources, prescribed values and start from the files of `write`.

    With ``hold`` all of the solid is prescribed: what is left is a fluid on a mesh that moves as told.
    """
    text = render(scene)
    pressures = scene.fluid or any(law.mixed for law in scene.solid.values())
    units = "real unitTime = unitLength/unitVelocity"  # what is told is in SI, and so has the script to be
    text = replaced(text, units, f"unitLength = 1; unitVelocity = 1; unitPressure = 1;\n{units}")
    text = replaced(text, "BuildMesh(StageLevel(0));\n", 'Th = readmesh("told.msh");\n')
    text = replaced(text, "  CheckMesh();\n", "")
    names = [(name, component) for name in ("exact", "sources") for component in ("ux", "uy", "vx", "vy")]
    nodal = "\n  ".join(READ_NODAL.format(name=name, component=component) for name, component in names)
    levels = LEVELS.replace("READ_NODAL", nodal).replace("READ_PRESSURE", READ_PRESSURE if pressures else "")
    text = replaced(text, f"{LINE} conditions", f"{levels}{LINE} conditions")
    text = re.sub(r"func int SetDirichlet\(.*?^}\n", DIRICHLET, text, count=1, flags=re.DOTALL | re.MULTILINE)
    if scene.mesh_motion and not scene.mesh_motion.law.linear:
        balance = "    real[int] inside = right(extended), moved = extensionGiven*correction;"
        text = replaced(text, balance, f"    right += sources(uxFrom:uyTo);\n{balance}")
    sources = SOURCES.replace("MESH_SOURCES", MESH_SOURCES if scene.fluid else "")
    text = replaced(text, f"{LINE} main\n", f"{sources}{LINE} main\n")
    text = replaced(text, "  Conditions();\n", "  Conditions(); ReadNodes();\n" + (HOLD if hold else ""))
    text = replaced(text, "oldX = X; pastX = X;", "ReadLevel(0); X = exact; oldX = X; pastX = X;")
    step = "  PredictStep();\n  real tolerance"
    return replaced(text, step, f"  ReadLevel(stepNumber+1); AddSources();\n{step}")


def solid_mesh(n: int) -> RawMesh:
    """The unit square, clamped at its left and right sides."""
    grid = np.linspace(0, 1, n + 1)
    return structured_mesh(grid, grid, lambda x, y: SOLID, lambda x, y: CLAMPED if x in (0, 1) else OPEN)


def both_mesh(n: int) -> RawMesh:
    """Fluid in the unit square, and below it a solid of half the height, clamped at its left and right sides."""

    def label(x: float, y: float) -> int:
        if y in (-0.5, 0.0, 1.0):
            return {-0.5: OPEN, 0.0: INTERFACE, 1.0: WALL}[y]
        return CLAMPED if y < 0 else INLET if x == 0 else OUTLET

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
    """Exact fields of each region, and the weight of div u in the mesh motion."""

    exact: Mapping[int, Exact]
    weight: float = 0.0

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

    def solid_pressure(self, mesh: RawMesh, t: float) -> Floats:
        """Pressure (nv,) of the solid at the vertices: the start of one whose pressure follows from J."""
        exact = self.exact[SOLID]
        return np.zeros(len(mesh.vertices)) if exact.solid_pressure is None else exact.solid_pressure(mesh.vertices, t)

    def sources(self, mesh: RawMesh, t: float) -> tuple[Floats, Floats]:
        """Work (n2, 2) of the sources of mesh motion and momentum, with the sign of the residual."""
        motion, momentum = np.zeros((2, mesh.n_p2, 2))
        for region, exact in self.exact.items():
            elements = elements_of(mesh, region)
            x = points_of(mesh, elements)
            if region == FLUID:
                assert np.abs(exact.mass(x, t)).max() < 1e-9, "the continuity has no source"
                add_force(motion, elements, exact.mesh_force(x, t, self.weight))
                add_force(momentum, elements, exact.fluid_force(x, t))
                add_traction(momentum, mesh, region, INTERFACE, lambda x, e=exact: e.fluid_stress(x, t))
                add_traction(momentum, mesh, region, OUTLET, lambda x, e=exact: e.outlet_stress(x, t))
            else:
                add_force(momentum, elements, exact.solid_force(x, t))
                add_traction(momentum, mesh, region, INTERFACE, lambda x, e=exact: e.solid_stress(x, t))
                add_traction(momentum, mesh, region, OPEN, lambda x, e=exact: e.solid_stress(x, t))
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
            for field, (values, expected) in pairs.items():
                square = ((values - expected.reshape(values.shape)) ** 2).sum(axis=-1)
                found[region, field] = float(np.sqrt((square * elements.weights).sum()))
        return found


def linear(elements: Elements, values: Floats) -> Floats:
    """Values (n, 7, 1) of a P1 function at the quadrature points."""
    result: Floats = elements.p1 @ values[elements.vertices][..., None]
    return result


def add_force(total: Floats, elements: Elements, force: Floats) -> None:
    """Add the work of a force (7 n, 2) per area."""
    shaped = force.reshape(*elements.weights.shape, 2)
    np.add.at(total, elements.nodes, -np.einsum("tq,qa,tqi->tai", elements.weights, elements.basis, shaped))


def add_traction(total: Floats, mesh: RawMesh, region: int, label: int, stress: Callable[[Floats], Floats]) -> None:
    """Add the work of P N on the edges of a label, N the normal that leaves the region, which is convex."""
    inside, nodes = np.unique(mesh.p2[mesh.region == region]), mesh.edge_nodes[mesh.label == label]
    start, end = mesh.p2_coordinates[nodes[:, 0]], mesh.p2_coordinates[nodes[:, 1]]
    normal = (end - start)[:, ::-1] * [1.0, -1.0]
    outward = start - mesh.p2_coordinates[inside].mean(axis=0)
    normal *= np.sign(np.einsum("nj,nj->n", normal, outward))[:, None]
    parameters, weights = gauss_rule()
    points = start[:, None] + parameters[:, None] * (end - start)[:, None]
    tensor = stress(points.reshape(-1, 2)).reshape(*points.shape, 2)
    work = np.einsum("q,qa,nqij,nj->nai", weights, line_basis(parameters)[0], tensor, normal)
    np.add.at(total, nodes, -work)


def write(folder: Path, solution: Solution, mesh: RawMesh, times: Floats) -> None:
    """Write mesh, node numbers and time levels into the folder in which the script runs."""
    rows = [f"{len(mesh.vertices)} {len(mesh.triangles)} {len(mesh.edges)}"]
    rows += [f"{x!r} {y!r} 0" for x, y in mesh.vertices.tolist()]
    rows += [f"{a} {b} {c} {r}" for (a, b, c), r in zip((mesh.triangles + 1).tolist(), mesh.region, strict=True)]
    rows += [f"{a} {b} {label}" for (a, b), label in zip((mesh.edges + 1).tolist(), mesh.label, strict=True)]
    (folder / "told.msh").write_text("\n".join([*rows, ""]))
    write_arrays(folder / "nodes.bin", [mesh.p2.ravel()])
    for number, t in enumerate(times.tolist()):
        fields = [*solution.nodal(mesh, t), *solution.sources(mesh, t)]
        arrays = [field[:, i] for field in fields for i in (0, 1)]
        write_arrays(folder / f"level-{number}.bin", [*arrays, solution.solid_pressure(mesh, t)])
