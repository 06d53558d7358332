"""Where the paper's formulas differ from the standard ones: what it prints and what is computed, for every report.

The texts are fragments of HTML that Markdown accepts too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ffsi.hemodynamics.result import Result
from ffsi.result.quantities import flatten
from ffsi.scene import Scene
from ffsi.scene.materials import Elastic, MooneyRivlin, NeoHookean, StVenantKirchhoff


@dataclass(frozen=True)
class Remark:
    """One difference: what the paper prints, and what is computed here."""

    topic: str
    paper: str
    here: str


FORCES = (
    "F<sub>D</sub> = ∫<sub>S</sub> ( ρ η ∂u<sub>t</sub>/∂n n<sub>y</sub> − p n<sub>x</sub> ) dS, "
    "F<sub>L</sub> = −∫<sub>S</sub> ( ρ η ∂u<sub>t</sub>/∂n n<sub>x</sub> + p n<sub>y</sub> ) dS"
)
STANDARD_FORCES = "F = −∫<sub>S</sub> σ n ds, σ = −p I + μ (∇v + ∇v<sup>T</sup>)"

SHEAR_ONLY = Remark(
    "Viscous stress",
    "symmetric, μ (∇v + ∇v<sup>T</sup>), in (2), but μ ∇v in (15) and (23).",
    "the symmetric one, with the outlet condition −p n + μ ∂v/∂n = 0. For a constant μ both give the same flow, and on "
    "a surface at rest the same force, because ∇v<sup>T</sup> n vanishes there.",
)
MESH_MOTION = Remark(
    "Mesh motion",
    "∂u/∂t = Δu in the fluid (14), in a steady state Δu = 0.",
    "a hyperelastic pseudo-solid, stiffer where triangles are small, because the mesh of Δu = 0 folds at the "
    "flap's tip. It moves the nodes only; the equations of the flow do not depend on it.",
)
RATE_OF_DEFORMATION = Remark(
    "Rate of deformation",
    "D in the viscosity law (30) is called the deformation gradient.",
    "D is the symmetric part of the velocity gradient; the deformation gradient is F. "
    "(The fluid of these cases is Newtonian.)",
)
NEO_HOOKEAN = Remark(
    "Neo-Hookean energy",
    "not written down.",
    "W = μ/2 (I<sub>1</sub> − 3 − 2 ln J) + λ/2 (ln J)², compressible.",
)


MOONEY_RIVLIN = Remark(
    "Mooney-Rivlin energy",
    "W = C<sub>10</sub> (I<sub>1</sub> − 3) + C<sub>01</sub> (I<sub>2</sub> − 3) + K/2 (J − 1)² (13).",
    "W = C<sub>10</sub> (J<sup>−2/3</sup> I<sub>1</sub> − 3) + C<sub>01</sub> (J<sup>−4/3</sup> I<sub>2</sub> − 3) + "
    "K/2 (J − 1)²: with the plain invariants the undeformed flap would be under stress.",
)


def is_paper_case(scene: Scene) -> bool:
    """Tell whether the scene is a flap in a channel, the paper's sections 5.1 to 5.3."""
    return scene.geometry.kind == "flap-channel" and scene.fluid is not None and scene.forces is not None


def remarks(scene: Scene) -> list[Remark]:
    """Return what differs between the paper and the computation of one of its cases; empty for other scenes."""
    if not is_paper_case(scene):
        return []
    flap = scene.solid.get("flap")
    material = [] if flap is None else _material(flap)
    return [forces(scene), coefficients(scene), *material, SHEAR_ONLY, MESH_MOTION, RATE_OF_DEFORMATION]


def forces(scene: Scene) -> Remark:
    """Return the remark about drag and lift: the unit of ρ η, the tangent, and which form is evaluated."""
    assert scene.fluid is not None
    density = scene.fluid.density
    size = "so the number is the same" if density == 1 else "and with it the viscous part would differ by this factor"
    return Remark(
        "Drag and lift",
        f"{FORCES}, with η the dynamic viscosity.",
        f"{STANDARD_FORCES}, n being the unit normal out of the fluid: the force of the fluid on the flap, positive "
        "along +x and +y. With η the dynamic viscosity, ρ η has the unit of viscosity times density; the factor ρ "
        f"belongs to a kinematic viscosity. Here ρ = {density:g} kg/m³, {size}. μ ∂u<sub>t</sub>/∂n is the whole "
        "viscous traction on a wall at rest, and in a steady state the flap is at rest; while it moves the two forms "
        "differ. The sign of the first term depends on the direction of the tangent (t = (n<sub>y</sub>, "
        "−n<sub>x</sub>) with n into the fluid), the traction integral needs no such choice. The number comes from the "
        "equivalent residual form (the momentum equation tested with a function that is 1 on the flap), which "
        "converges at twice the rate; the surface integral is kept beside it as <code>drag_surface</code> and "
        "<code>lift_surface</code>.",
    )


def coefficients(scene: Scene) -> Remark:
    """Return the remark about the length in C_D and C_L."""
    assert scene.forces is not None
    return Remark(
        "Coefficients",
        "C = 2 F / (ρ v<sub>mean</sub>² L), the value of L is not stated.",
        f"the same, with the flap's height L = {scene.forces.reference_length:g} m. C<sub>D</sub> grows without "
        "bound as v<sub>mean</sub> → 0, like in any creeping flow.",
    )


def _material(flap: Elastic) -> list[Remark]:
    if isinstance(flap, MooneyRivlin):
        return [MOONEY_RIVLIN, _volume(flap, "Mooney-Rivlin"), *_bulk_modulus(flap)]
    if isinstance(flap, NeoHookean):
        return [_volume(flap, "neo-Hookean"), NEO_HOOKEAN]
    if isinstance(flap, StVenantKirchhoff):
        return [_volume(flap, "St. Venant-Kirchhoff")]
    return []


def _volume(flap: Elastic, law: str) -> Remark:
    paper = "J = 1 (16) and the stress −J p F<sup>−T</sup> alone (15), beside the elastic constants of Table 1."
    if flap.incompressible:
        return Remark("Volume of the solid", paper, f"J = 1 with a pressure in the solid, added to the {law} stress.")
    ratio = _signed(flap.young_poisson[1], ".2g")
    here = f"the compressible {law} law, Poisson's ratio {ratio}, without the constraint: both cannot hold."
    return Remark("Volume of the solid", paper, here)


def _bulk_modulus(flap: MooneyRivlin) -> list[Remark]:
    if flap.bulk_modulus is None:
        return []
    young, poisson = flap.young_poisson
    here = (
        f"K = {flap.bulk_modulus:g} Pa beside the shear modulus 2 (C<sub>10</sub> + C<sub>01</sub>) = {flap.lame[1]:g} "
        f"Pa: at rest Young's modulus {young:.3g} Pa and Poisson's ratio {_signed(poisson, '.3g')}."
    )
    if poisson < 0:
        here += (
            " A stretched flap then grows wider; that is admissible (above −1), but no rubber does it. 5.6 Pa is the "
            "Young's modulus of Table 1, so K may be a slip of the paper."
        )
    return [Remark("Bulk modulus", "K = 5.6 Pa, C<sub>10</sub> = 75 Pa, C<sub>01</sub> = 100 Pa.", here)]


def force_difference(values: Mapping[str, float]) -> str:
    """Return how far the two forms of the drag are apart, in words; empty if there are not both."""
    if not values.get("drag") or "drag_surface" not in values:
        return ""
    return f"The two forms of the drag are {100 * abs(values['drag_surface'] / values['drag'] - 1):.2f} % apart here."


def solid_remark(result: Result) -> str:
    """Return what limits the St. Venant-Kirchhoff flap, with this point's smallest J; empty for other solids."""
    if not isinstance(result.scene.solid.get("flap"), StVenantKirchhoff):
        return ""
    text = (
        "St. Venant-Kirchhoff loses all resistance in strong compression: at the flap's downstream root corner the "
        "solid collapses (J → 0), and the earlier the finer the root is resolved. The element size there belongs to "
        "the case"
    )
    size = result.scene.mesh.root_size
    text += f" ({size:g} m here)." if size is not None else "."
    smallest = flatten(result.quantities).get("min_jacobian_solid")
    if smallest is None:
        return text
    at = "".join(f" at {key} = {value:g}" for key, value in (result.data.get("varied") or {}).items())
    return f"{text} Smallest J in the solid{at}: {smallest:.3f}."


def _signed(value: float, form: str) -> str:
    return format(value, form).replace("-", "−")
