"""Turek-Hron FSI1 with NGSolve, what `make bench-peers` measures: monolithic ALE, high order, graded to the corners.

Run by the Python of an environment that has NGSolve, so nothing of ours is imported:

    python ngsolve_fsi1.py ORDER MAXH LAYERS

prints one line of JSON: unknowns, drag, lift (N/m), tip_ux, tip_uy (m). The equations are those of
docs/theory.md with its do-nothing outlet: u and v of that order, p one below, triangles of at most MAXH (m) with LAYERS
geometric layers around the beam's four corners, edges curved along the cylinder. The velocity lives in the fluid only.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import ngsolve as ng
from netgen.occ import Circle, Glue, OCCGeometry, Rectangle, X

HEIGHT, LENGTH, RADIUS = 0.41, 2.5, 0.05  # channel and cylinder, m
DENSITY, VISCOSITY, MEAN_VELOCITY = 1000.0, 1.0, 0.2  # kg/m^3, Pa s, m/s
SHEAR_MODULUS, POISSON = 5e5, 0.4  # of the beam, Pa
LAME = 2 * SHEAR_MODULUS * POISSON / (1 - 2 * POISSON)
TIP, TIP_SIZE = (0.6, 0.2), 0.25  # the mesh on beam and cylinder is finer by this factor
GRADING = 0.2  # from one layer around a corner to the next
# Weight of the mesh motion, Pa. Its rows are those of u; the momentum tested with the same functions stands in them,
# too, which is zero inside of the fluid. On the interface the traction is off by so much of the mesh's stress: with
# 1e-6 Pa all values agree to five digits, but with many layers around the corners they drown in round-off.
MESH_WEIGHT = 1e-3


def make_mesh(order: int, maxh: float, layers: int) -> ng.Mesh:
    """Return the mesh of channel and beam."""
    cylinder = Circle((0.2, 0.2), RADIUS).Face()
    beam = Rectangle(0.4, 0.02).Face().Move((0.2, 0.19, 0)) - cylinder
    fluid = Rectangle(LENGTH, HEIGHT).Face() - cylinder - beam
    beam.faces.name, fluid.faces.name = "beam", "fluid"
    fluid.edges.name, beam.edges.name = "wall", "interface"
    fluid.edges.Min(X).name, fluid.edges.Max(X).name = "inlet", "outlet"
    shape = Glue([fluid, beam])
    for edge in shape.edges:
        centre = edge.center
        if abs(centre.y - 0.2) < 0.06 and centre.x < 0.61 and edge.name not in ("inlet", "outlet"):
            on_cylinder = (centre.x - 0.2) ** 2 + (centre.y - 0.2) ** 2 < 1.01 * RADIUS**2
            inside = on_cylinder and centre.x > 0.24
            edge.name = "clamped" if inside else "cylinder" if on_cylinder else "interface"
            edge.maxh = TIP_SIZE * maxh
    for vertex in shape.vertices:
        if abs(vertex.p.y - 0.2) < 0.011 and 0.2 < vertex.p.x < 0.61:
            vertex.hpref = 1
    mesh = ng.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=maxh, grading=0.3))
    if layers:
        mesh.RefineHP(layers, factor=GRADING)
    mesh.Curve(order)
    return mesh


def solve(order: int, maxh: float, layers: int) -> dict[str, Any]:
    """Return unknowns, triangles and the four quantities."""
    mesh = make_mesh(order, maxh, layers)
    rigid = "inlet|outlet|wall|cylinder|clamped"
    displacement = ng.VectorH1(mesh, order=order, dirichlet=rigid)
    velocity = ng.VectorH1(mesh, order=order, definedon="fluid", dirichlet="inlet|wall|cylinder|interface")
    space = displacement * velocity * ng.H1(mesh, order=order - 1, definedon="fluid")
    (u, v, p), (z, w, q) = space.TnT()
    fluid, solid = ng.dx("fluid", bonus_intorder=2), ng.dx("beam", bonus_intorder=2)

    def momentum(u: Any, v: Any, p: Any, w: Any) -> Any:
        gradient = ng.Id(2) + ng.Grad(u)
        cofactor = ng.Det(gradient) * ng.Inv(gradient).trans
        rate = ng.Grad(v) * cofactor.trans
        stress = (-p * ng.Id(2) + VISCOSITY / ng.Det(gradient) * (rate + rate.trans)) * cofactor
        return DENSITY * ng.InnerProduct(rate * v, w) + ng.InnerProduct(stress, ng.Grad(w))

    gradient = ng.Id(2) + ng.Grad(u)
    strain = 0.5 * (gradient.trans * gradient - ng.Id(2))
    second_piola = LAME * ng.Trace(strain) * ng.Id(2) + 2 * SHEAR_MODULUS * strain
    along = ng.Grad(v).Trace()  # on the outlet d/dy alone
    form = ng.BilinearForm(space, condense=True)
    form += (momentum(u, v, p, w) + momentum(u, v, p, z)).Compile() * fluid
    form += (ng.InnerProduct(gradient * second_piola, ng.Grad(z))).Compile() * solid
    form += MESH_WEIGHT * ng.InnerProduct(ng.Grad(u), ng.Grad(z)) * fluid
    form += q * ng.Trace(ng.Grad(v) * (ng.Det(gradient) * ng.Inv(gradient))) * fluid
    form += -VISCOSITY * (along[0, 1] * w[1] - along[1, 1] * w[0]) * ng.ds("outlet")

    state = ng.GridFunction(space)
    moved, flow, pressure = state.components
    flow.Set(ng.CF((6 * MEAN_VELOCITY * ng.y * (HEIGHT - ng.y) / HEIGHT**2, 0)), definedon=mesh.Boundaries("inlet"))
    residual, step = state.vec.CreateVector(), state.vec.CreateVector()
    for _ in range(20):
        form.Apply(state.vec, residual)
        form.AssembleLinearization(state.vec)
        inverted = form.mat.Inverse(space.FreeDofs(True), inverse="umfpack")
        residual.data += form.harmonic_extension_trans * residual
        step.data = inverted * residual
        step.data += form.harmonic_extension * step
        step.data += form.inner_solve * residual
        state.vec.data -= step
        if step.Norm() <= 1e-6 * state.vec.Norm():
            break
    else:
        raise SystemExit("Newton's method did not converge")

    part = ng.GridFunction(ng.VectorH1(mesh, order=order, definedon="fluid"))
    force = []
    for direction in ((1, 0), (0, 1)):
        part.Set(ng.CF(direction), definedon=mesh.Boundaries("cylinder|interface"))
        force.append(-ng.Integrate(momentum(moved, flow, pressure, part) * fluid, mesh))
    tip = moved(mesh(*TIP))
    names = ("drag", "lift", "tip_ux", "tip_uy")
    found = dict(zip(names, (*force, *tip), strict=True))
    return {"unknowns": sum(space.FreeDofs()), "triangles": mesh.ne, **found}


if __name__ == "__main__":
    print(json.dumps(solve(int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]))))
