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

from netgen.occ import Circle, Glue, OCCGeometry, Rectangle, X
from ngsolve import (
    CF,
    H1,
    BilinearForm,
    Det,
    Grad,
    GridFunction,
    Id,
    InnerProduct,
    Integrate,
    Inv,
    Mesh,
    Trace,
    VectorH1,
    ds,
    dx,
    y,
)

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


def make_mesh(order: int, maxh: float, layers: int) -> Mesh:
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
    mesh = Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=maxh, grading=0.3))
    if layers:
        mesh.RefineHP(layers, factor=GRADING)
    mesh.Curve(order)
    return mesh


def solve(order: int, maxh: float, layers: int) -> dict[str, Any]:
    """Return unknowns, triangles and the four quantities."""
    mesh = make_mesh(order, maxh, layers)
    rigid = "inlet|outlet|wall|cylinder|clamped"
    displacement = VectorH1(mesh, order=order, dirichlet=rigid)
    velocity = VectorH1(mesh, order=order, definedon="fluid", dirichlet="inlet|wall|cylinder|interface")
    space = displacement * velocity * H1(mesh, order=order - 1, definedon="fluid")
    (u, v, p), (z, w, q) = space.TnT()
    fluid, solid = dx("fluid", bonus_intorder=2), dx("beam", bonus_intorder=2)

    def momentum(u: Any, v: Any, p: Any, w: Any) -> Any:
        gradient = Id(2) + Grad(u)
        cofactor = Det(gradient) * Inv(gradient).trans
        rate = Grad(v) * cofactor.trans
        stress = (-p * Id(2) + VISCOSITY / Det(gradient) * (rate + rate.trans)) * cofactor
        return DENSITY * InnerProduct(rate * v, w) + InnerProduct(stress, Grad(w))

    gradient = Id(2) + Grad(u)
    strain = 0.5 * (gradient.trans * gradient - Id(2))
    second_piola = LAME * Trace(strain) * Id(2) + 2 * SHEAR_MODULUS * strain
    along = Grad(v).Trace()  # on the outlet d/dy alone
    form = BilinearForm(space, condense=True)
    form += (momentum(u, v, p, w) + momentum(u, v, p, z)).Compile() * fluid
    form += (InnerProduct(gradient * second_piola, Grad(z))).Compile() * solid
    form += MESH_WEIGHT * InnerProduct(Grad(u), Grad(z)) * fluid
    form += q * Trace(Grad(v) * (Det(gradient) * Inv(gradient))) * fluid
    form += -VISCOSITY * (along[0, 1] * w[1] - along[1, 1] * w[0]) * ds("outlet")

    state = GridFunction(space)
    moved, flow, pressure = state.components
    flow.Set(CF((6 * MEAN_VELOCITY * y * (HEIGHT - y) / HEIGHT**2, 0)), definedon=mesh.Boundaries("inlet"))
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

    part = GridFunction(VectorH1(mesh, order=order, definedon="fluid"))
    force = []
    for direction in ((1, 0), (0, 1)):
        part.Set(CF(direction), definedon=mesh.Boundaries("cylinder|interface"))
        force.append(-Integrate(momentum(moved, flow, pressure, part) * fluid, mesh))
    tip = moved(mesh(*TIP))
    names = ("drag", "lift", "tip_ux", "tip_uy")
    found = dict(zip(names, (*force, *tip), strict=True))
    return {"unknowns": sum(space.FreeDofs()), "triangles": mesh.ne, **found}


if __name__ == "__main__":
    print(json.dumps(solve(int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]))))
