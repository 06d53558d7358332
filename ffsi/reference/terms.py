"""The terms of each equation on each triangle, before assembly.

Every function takes local values and returns local integrals, (n, 6, 2) or (n, 3), by the name of the term. All are
analytic in the unknowns, so the solver can differentiate them by a complex step; no tangent is written by hand.
Formulas: docs/theory.md. Tensors have their indices on the last two axes and (triangle, point) before them.
"""

from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.reference.conditions import Support
from ffsi.reference.elements import Elements, gauss_rule, line_basis
from ffsi.reference.materials import (
    IDENTITY,
    Array,
    cofactor,
    determinant,
    dilatation,
    double_dot,
    trace,
    transpose,
)
from ffsi.reference.mesh_motion import MOTIONS
from ffsi.reference.problem import Fluid, MeshMotion, Solid
from ffsi.reference.step import Step
from ffsi.reference.viscosity import Viscosity

Vector = tuple[float, float]
# Of sides, whose nodes are their ends and their middle; three Gauss points are exact to degree 5.
_POINTS, _WEIGHTS = gauss_rule(3)
_VALUES, _SLOPES = line_basis(_POINTS)


def gradient_of(values: Array, gradients: Floats) -> Array:
    """(n, 6, 2) nodal vectors and (n, q, 6, 2) basis gradients to the gradients d(value_i)/dX_j, (n, q, 2, 2)."""
    n, q = gradients.shape[:2]
    flat = gradients.transpose(0, 2, 1, 3).reshape(n, 6, 2 * q)
    return (values.transpose(0, 2, 1) @ flat).reshape(n, 2, q, 2).transpose(0, 2, 1, 3)


def against_gradient(flux: Array, elements: Elements) -> Array:
    """Integrals of flux : grad w for every P2 test function, (n, 7, 2, 2) to (n, 6, 2)."""
    n, q = elements.weights.shape
    weighted = (flux * elements.weights[:, :, None, None]).transpose(0, 1, 3, 2).reshape(n, 2 * q, 2)
    test = elements.gradients.transpose(0, 2, 1, 3).reshape(n, 6, 2 * q)
    return test @ weighted


def against_value(density: Array, elements: Elements) -> Array:
    """Integrals of density . w for every P2 test function, (n, 7, 2) to (n, 6, 2)."""
    return elements.basis.T @ (density * elements.weights[:, :, None])


@dataclass(frozen=True)
class Motion:
    """Displacement ``u``, metres, and velocity ``v``, metres per second, at nodes, of one shape (..., 2)."""

    u: Array
    v: Array


@dataclass(frozen=True)
class Flow:
    """Fluid fields at points (n, q) of the triangles: F's cofactor and determinant, G = (grad v) adj F, v and p."""

    cofactor: Array
    jacobian: Array
    transport: Array
    velocity: Array
    pressure: Array

    @classmethod
    def at_points(cls, elements: Elements, u: Array, v: Array, p: Array) -> "Flow":
        """Evaluate local unknowns u, v (n, 6, 2), p (n, 3) at the quadrature points."""
        return cls.evaluate(elements.gradients, elements.basis @ v, p @ elements.p1.T, u, v)

    @classmethod
    def evaluate(cls, gradients: Floats, velocity: Array, pressure: Array, u: Array, v: Array) -> "Flow":
        """Combine basis gradients (n, q, 6, 2), values (n, q, 2), (n, q) and nodal u, v (n, 6, 2)."""
        deformation = IDENTITY + gradient_of(u, gradients)
        cof = cofactor(deformation)
        transport = gradient_of(v, gradients) @ transpose(cof)
        return cls(cof, determinant(deformation), transport, velocity, pressure)

    @property
    def pressure_flux(self) -> Array:
        """Pressure part of the first Piola-Kirchhoff stress, -p cof F."""
        return -self.pressure[..., None, None] * self.cofactor

    @property
    def doubled_deformation_rate(self) -> Array:
        """Twice the rate of deformation, 2 D = (G + G^T)/J, (n, q, 2, 2) per second."""
        return (self.transport + transpose(self.transport)) / self.jacobian[..., None, None]

    def viscosity(self, law: Viscosity) -> Array:
        """Dynamic viscosity at the shear rate g, g^2 = 2 D:D, (n, q) pascal seconds."""
        rate = self.doubled_deformation_rate
        return law.at(0.5 * double_dot(rate, rate))

    def viscous_flux(self, law: Viscosity) -> Array:
        """Viscous part of the first Piola-Kirchhoff stress, 2 mu D cof F."""
        return self.viscosity(law)[..., None, None] * (self.doubled_deformation_rate @ self.cofactor)


def fluid_momentum(fluid: Fluid, gravity: Vector, elements: Elements, flow: Flow) -> dict[str, Array]:
    """Terms of the fluid's momentum, (n, 6, 2) newtons per metre depth: convection, pressure, viscosity, gravity."""
    convection = fluid.density * np.einsum("tqij,tqj->tqi", flow.transport, flow.velocity)
    weight = -fluid.density * flow.jacobian[..., None] * np.array(gravity)
    return {
        "convection": against_value(convection, elements),
        "pressure": against_gradient(flow.pressure_flux, elements),
        "viscosity": against_gradient(flow.viscous_flux(fluid.viscosity), elements),
        "gravity": against_value(weight, elements),
    }


def step_fluxes(fluid: Fluid, step: Step, new: Flow, old: Flow) -> dict[str, Array]:
    """Stress of a time step by its parts, (n, q, 2, 2) pascals: pressure and viscosity.

    The pressure is the new one only, one value for the step, but the surface that it acts on is the mean of both ends;
    the viscous part is the mean.
    """
    pressure = -new.pressure[..., None, None] * step.mean(new.cofactor, old.cofactor)
    viscosity = step.mean(new.viscous_flux(fluid.viscosity), old.viscous_flux(fluid.viscosity))
    return {"pressure": pressure, "viscosity": viscosity}


def fluid_step(
    fluid: Fluid, gravity: Vector, elements: Elements, step: Step, new: Flow, old: Flow, mesh_velocity: Array
) -> dict[str, Array]:
    """Terms of the fluid's momentum in a time step, (n, 6, 2): those of ``fluid_momentum`` and the inertia.

    ``new`` and ``old`` are the flows at both ends of the step, ``mesh_velocity`` (n, 7, 2) metres per second that of
    the mesh in between. The convection is by the velocity relative to the mesh.
    """
    jacobian = step.mean(new.jacobian, old.jacobian)[..., None]
    convection = step.mean(
        *(np.einsum("tqij,tqj->tqi", flow.transport, flow.velocity - mesh_velocity) for flow in (new, old))
    )
    fluxes = step_fluxes(fluid, step, new, old)
    return {
        "inertia": against_value(fluid.density * jacobian * step.rate(new.velocity, old.velocity), elements),
        "convection": against_value(fluid.density * convection, elements),
        "pressure": against_gradient(fluxes["pressure"], elements),
        "viscosity": against_gradient(fluxes["viscosity"], elements),
        "gravity": against_value(-fluid.density * jacobian * np.array(gravity), elements),
    }


def continuity(elements: Elements, flow: Flow) -> dict[str, Array]:
    """The two parts of the mass balance tr G, (n, 3) square metres per second."""
    weighted = flow.transport * elements.weights[:, :, None, None]
    return {"dv_x/dx": weighted[..., 0, 0] @ elements.p1, "dv_y/dy": weighted[..., 1, 1] @ elements.p1}


def mesh_motion(motion: MeshMotion, alpha: Floats, elements: Elements, u: Array) -> dict[str, Array]:
    """Terms of the mesh motion by the parts of its P_m, (n, 6, 2); ``alpha`` (n,) is the triangles' stiffness."""
    fluxes = MOTIONS[motion.kind](gradient_of(u, elements.gradients), motion.divergence_weight)
    return {name: against_gradient(alpha[:, None, None, None] * flux, elements) for name, flux in fluxes.items()}


def solid_fluxes(solid: Solid, elements: Elements, gradient: Array, p: Array) -> dict[str, Array]:
    """First Piola-Kirchhoff stress of a solid by its parts, (n, q, 2, 2) pascals: stress and, if mixed, pressure.

    ``gradient`` (n, q, 2, 2) is that of the displacement, ``p`` (n, 3) the pressure of a mixed solid, whose stress is
    dW_0/dF only; its own part is -p cof F. Other solids ignore it.
    """
    if (material := solid.mixed_material) is None:
        return {"stress": solid.material.first_piola(gradient)}
    pressure = -(p @ elements.p1.T)[..., None, None] * cofactor(IDENTITY + gradient)
    return {"stress": material.base_stress(gradient), "pressure": pressure}


def solid_momentum(solid: Solid, gravity: Vector, elements: Elements, u: Array, p: Array) -> dict[str, Array]:
    """Terms of a solid's momentum, (n, 6, 2) newtons per metre depth: those of ``solid_fluxes``, and gravity."""
    fluxes = solid_fluxes(solid, elements, gradient_of(u, elements.gradients), p)
    weight = np.broadcast_to(-solid.density * np.array(gravity), (len(u), 7, 2))
    result = {name: against_gradient(flux, elements) for name, flux in fluxes.items()}
    return result | {"gravity": against_value(weight, elements)}


def second_piola(gradient: Array, stress: Array) -> Array:
    """Second Piola-Kirchhoff stress F^-1 P of the displacement gradient and the first one, (..., 2, 2)."""
    deformation = IDENTITY + gradient
    return transpose(cofactor(deformation)) @ stress / determinant(deformation)[..., None, None]


def step_stress(step: Step, gradients: tuple[Array, Array], stresses: tuple[Array, Array]) -> Array:
    """Stress of a time step F_theta (theta S + (1-theta) S_n), from (new, old) grad u and first Piola-Kirchhoff stress.

    The mean of the first Piola-Kirchhoff stresses is not objective: of a body that turns it is not F_theta times the
    stress that turns with it, and it feeds energy into stiff modes.
    """
    second = step.mean(*(second_piola(*end) for end in zip(gradients, stresses, strict=True)))
    return (IDENTITY + step.mean(*gradients)) @ second


def solid_step(
    solid: Solid, gravity: Vector, elements: Elements, step: Step, new: Motion, old: Motion, p: Array, old_p: Array
) -> dict[str, Array]:
    """Terms of a solid's momentum in a time step, (n, 6, 2): those of ``solid_momentum`` and the inertia.

    ``p``, ``old_p`` (n, 3) are the pressures of a mixed solid. An incompressible solid's pressure, a multiplier, has
    one value for the step, the new one, on the mean of both cof F. A compressible one's is a function of J, which
    belongs to the time of its F: it is a part of the stress of each end.
    """
    gradients = gradient_of(new.u, elements.gradients), gradient_of(old.u, elements.gradients)
    multiplier = solid.formulation == "incompressible"
    pressures = (p, p if multiplier else old_p)
    ends = [solid_fluxes(solid, elements, at, q) for at, q in zip(gradients, pressures, strict=True)]
    fluxes = {name: step_stress(step, gradients, (ends[0][name], ends[1][name])) for name in ends[0]}
    if multiplier:
        fluxes["pressure"] = step.mean(ends[0]["pressure"], ends[1]["pressure"])
    if solid.viscosity:
        doubled = [h + np.swapaxes(h, -1, -2) @ (IDENTITY + h) for h in gradients]  # 2 E
        fluxes["viscous"] = (IDENTITY + step.mean(*gradients)) @ (0.5 * solid.viscosity * step.rate(*doubled))
    weight = np.broadcast_to(-solid.density * np.array(gravity), (len(elements), 7, 2))
    acceleration = elements.basis @ (step.rate(new.v, old.v) + solid.mass_damping * step.mean(new.v, old.v))
    return {name: against_gradient(flux, elements) for name, flux in fluxes.items()} | {
        "gravity": against_value(weight, elements),
        "inertia": against_value(solid.density * acceleration, elements),
    }


def incompressibility(solid: Solid, elements: Elements, u: Array, p: Array) -> dict[str, Array]:
    """Terms of a mixed solid's volume equation c(J, p) = 0, (n, 3) square metres: div u in two parts, and the rest.

    ``p`` (n, 3) is its pressure. Other solids have no such terms.
    """
    if (material := solid.mixed_material) is None:
        return {}
    gradient = gradient_of(u, elements.gradients)
    change = dilatation(gradient)
    constraint = change
    if solid.formulation == "mixed":
        constraint = material.volume_slope(change) + p @ elements.p1.T / material.volume_modulus
    parts = {"du_x/dX": gradient[..., 0, 0], "du_y/dY": gradient[..., 1, 1], "rest": constraint - trace(gradient)}
    return {name: (part * elements.weights) @ elements.p1 for name, part in parts.items()}


def traction(load: Vector, length: Floats) -> Array:
    """Work of the dead load (Pa) on edges of ``length`` (n,) metres, with its sign in the momentum; (n, 3, 2)."""
    return np.asarray(-length[:, None, None] * (_WEIGHTS @ _VALUES)[:, None] * np.array(load))


def outlet(viscosity: float, v: Array) -> Array:
    """Do-nothing outlet, -B_out, (n, 3, 2) for the three P2 nodes of each side with nodal velocities (n, 3, 2).

    The side runs with the fluid on its left, so its direction is the outward normal turned by +90 degrees; its length
    cancels between d/ds and ds.
    """
    derivative = _SLOPES @ v
    traction = viscosity * np.stack([-derivative[..., 1], derivative[..., 0]], axis=-1)
    return -(_VALUES * _WEIGHTS[:, None]).T @ traction


def outlet_flow(normal: Floats, v: Array) -> Array:
    """Flow rate through all sides, a scalar in m2/s, with normals (n, 2) times length and nodal v (n, 3, 2)."""
    return np.asarray(np.einsum("q,qa,nai,ni->", _WEIGHTS, _VALUES, v, normal))


def outlet_pressure(normal: Floats, pressure: Array | float) -> Array:
    """Work of a pressure, in pascals, that acts on sides from outside, (n, 3, 2).

    It is one number, or (n, 3) at the three Gauss points of each side.
    """
    acting = np.asarray(pressure) * np.ones((len(normal), 3))
    return np.asarray(np.einsum("aq,nq,ni->nai", (_VALUES * _WEIGHTS[:, None]).T, acting, normal))


def side_pressure(ends: Array, pressure: Array | float) -> Array:
    """Work (n, 3, 2) of the stress -pressure on sides whose P2 nodes, start, end, middle, lie at ``ends`` (n, 3, 2).

    The side runs with the material on its left. dx/ds turned by -90 degrees is cof F N dS/ds.
    """
    along = _SLOPES @ ends
    outward = np.stack([along[..., 1], -along[..., 0]], axis=-1)
    return -pressure * (_VALUES * _WEIGHTS[:, None]).T @ outward


def backflow(momentum: float, normal: Floats, v: Array) -> Array:
    """Traction against what flows back in, (n, 3, 2); ``momentum`` kg/m3 is its factor beta rho.

    The real part decides where that is, also in a complex step.
    """
    points, weights = gauss_rule()
    values, _ = line_basis(points)
    velocity = values @ v
    out = np.einsum("nqi,ni->nq", velocity, normal)
    inward = np.where(out.real < 0.0, out, 0.0) * weights
    return -momentum * values.T @ (inward[..., None] * velocity)


def support(held: Support, length: Floats, u: Array, v: Array) -> Array:
    """Elastic support of edges of ``length`` (n,) metres with nodal u, v (n, 3, 2), (n, 3, 2)."""
    force = _VALUES @ (held.stiffness * u + held.damping * v)
    return _VALUES.T @ (length[:, None, None] * _WEIGHTS[:, None] * force)
