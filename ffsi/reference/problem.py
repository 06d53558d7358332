"""What the checker must know of a scene: plain numbers in SI units, no files and no unit strings."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from ffsi.files.arrays import Floats
from ffsi.reference.conditions import Inflow, Load, Outlet, PointForce, Support
from ffsi.reference.materials import Material, SplitMaterial
from ffsi.reference.mesh_motion import MOTIONS
from ffsi.reference.viscosity import Viscosity

Role = Literal["inlet", "outlet", "no-slip", "interface", "clamped", "free", "loaded", "supported", "slip"]
Formulation = Literal["displacement", "mixed", "incompressible"]
Field = Callable[[Floats, float], Floats]
FLUID_REGION = 1


@dataclass(frozen=True)
class Fluid:
    """A fluid: ``density`` kg/m3 and the law of its dynamic ``viscosity``."""

    density: float
    viscosity: Viscosity


@dataclass(frozen=True)
class Solid:
    """An elastic solid: reference ``density`` kg/m3, its material and the formulation.

    In time its stress S has ``viscosity`` (Pa s) times dE/dt, and ``mass_damping`` (1/s) times its momentum slows it.

    ``mixed`` and ``incompressible`` solids have a pressure of their own as unknown. Raises ``ValueError`` for an
    unknown formulation and for a material that cannot have it.
    """

    density: float
    material: Material
    formulation: Formulation = "displacement"
    viscosity: float = 0.0
    mass_damping: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a formulation that the material cannot have."""
        if self.formulation not in get_args(Formulation):
            raise ValueError(f"formulation {self.formulation!r}, accepted: {get_args(Formulation)}")
        if self.formulation != "displacement" and not isinstance(self.material, SplitMaterial):
            raise ValueError(f"{type(self.material).__name__} has no {self.formulation} form")
        if self.formulation == "displacement" and not math.isfinite(self.material.stiffness):
            raise ValueError(f"{self.material} has no displacement form, its stiffness is infinite")
        material = self.mixed_material
        if self.formulation == "mixed" and material and material.volume_modulus in (0.0, math.inf):
            raise ValueError(f"{self.material} has no mixed form, its volume modulus must be finite and not zero")

    @property
    def mixed_material(self) -> SplitMaterial | None:
        """The material of a solid with a pressure of its own; None of one with displacements only."""
        if self.formulation != "displacement" and isinstance(self.material, SplitMaterial):
            return self.material
        return None


@dataclass(frozen=True)
class MeshMotion:
    """Mesh motion in the fluid: stiffness (A_max/A_K)^m (d_max/d_K)^n, weight beta of the volume, and the equation.

    ``stiffness_exponent`` is m, for the area of a triangle; ``distance_exponent`` n, for its distance from the solids.
    ``divergence_weight`` is beta of the equation ``kind``, one of ``mesh_motion.MOTIONS``.
    """

    stiffness_exponent: float
    divergence_weight: float
    kind: str = "harmonic"
    distance_exponent: float = 0.0


@dataclass(frozen=True)
class Boundary:
    """Edges of one label: their role, the body part they belong to, and the circle (cx, cy, r) they approximate.

    ``motion`` maps points (n, 2) of a no-slip wall that moves and the time to its velocities (n, 2), metres per second,
    ``displacement`` those of a wall that the mesh follows to how far it is, metres; such a wall has common nodes. If
    it is a spline through samples up to the time ``sampled``, seconds, its terms cancel at all times.
    ``load`` is what acts on a loaded boundary besides the problem's traction; ``inflow`` and ``outlet`` are what one of
    several inlets or outlets has in the place of the problem's own, ``opening`` its name and the sign of a flow rate
    out of the fluid; along the unit vector ``still`` nothing flows there. A no-slip wall that is ``curved`` runs along
    the curve of its vertices.
    """

    name: str
    label: int
    role: Role
    part: str | None = None
    circle: tuple[float, float, float] | None = None
    motion: Callable[[Floats, float], Floats] | None = None
    load: Load | None = None
    inflow: Inflow | None = None
    outlet: Outlet | None = None
    opening: tuple[str, float] | None = None
    still: tuple[float, float] | None = None
    displacement: Callable[[Floats, float], Floats] | None = None
    curved: bool = False
    sampled: float = 0.0


@dataclass(frozen=True)
class Manufactured:
    """Values and sources that make chosen smooth fields the exact solution (method of manufactured solutions).

    ``displacement`` (n, 2) metres and ``velocity`` (n, 2) metres per second map reference points (n, 2), metres, and
    the time, 0 in steady systems, to the values wherever u and v are prescribed; a fluid alone has its u prescribed
    everywhere, which is a mesh that moves as told. ``force`` (n2, 2) newtons per metre depth and ``mass`` (nv, 1)
    square metres per second map the system to the work of the sources of momentum and continuity, with the sign of the
    residual, and ``motion`` (n2, 2) to that of the mesh motion. Walls that move keep the values that they state.
    """

    displacement: Field
    velocity: Field
    force: Callable[[Any], Floats]
    mass: Callable[[Any], Floats] | None = None
    motion: Callable[[Any], Floats] | None = None


@dataclass(frozen=True)
class Problem:
    """One fluid-structure problem, steady or in time.

    ``solids`` by region number (2, 3, ...); ``gravity`` m/s2; ``traction`` the dead load on boundaries with the role
    loaded, Pa per reference length; ``support`` what holds boundaries with the role supported;
    ``point_forces`` act on solids;
    ``mean_velocity`` and ``reference_length`` scale the force coefficients; ``mean_pressure``, Pa, is that of a closed
    fluid, whose pressure nothing else gives a level; ``names`` of the solids by region;
    ``points`` by name, where the displacement is reported, reference coordinates in m; ``manufactured`` is for tests.
    With ``chords`` vertices on circles are those of a refined mesh, and may lie on chords.
    Raises ``ValueError`` where the pieces do not fit together.
    """

    name: str
    fluid: Fluid | None
    boundaries: tuple[Boundary, ...]
    solids: Mapping[int, Solid] = field(default_factory=dict)
    gravity: tuple[float, float] = (0.0, 0.0)
    traction: tuple[float, float] = (0.0, 0.0)
    support: Support | None = None
    inflow: Inflow | None = None
    outlet: Outlet | None = None
    mesh_motion: MeshMotion | None = None
    point_forces: tuple[PointForce, ...] = ()
    mean_velocity: float | None = None
    mean_pressure: float | None = None
    reference_length: float | None = None
    names: Mapping[int, str] = field(default_factory=dict)
    points: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    manufactured: Manufactured | None = None
    chords: bool = False

    def __post_init__(self) -> None:
        """Refuse a problem that lacks what its regions and boundaries need."""
        if self.fluid is None and not self.solids:
            raise ValueError(f"{self.name}: neither a fluid nor a solid")
        if self.fluid is not None and self.solids and self.mesh_motion is None:
            raise ValueError(f"{self.name}: fluid and solid together need a mesh motion")
        roles = {boundary.role for boundary in self.boundaries}
        if unknown := roles - set(get_args(Role)):
            raise ValueError(f"{self.name}: unknown boundary role {sorted(unknown)}, accepted: {get_args(Role)}")
        of_sides = {"inlet": "inflow", "outlet": "outlet"}
        for role, condition in (("inlet", self.inflow), ("outlet", self.outlet), ("supported", self.support)):
            own = all(getattr(b, of_sides.get(role, ""), None) for b in self.boundaries if b.role == role)
            if role in roles and condition is None and not own:
                raise ValueError(f"{self.name}: a boundary with the role {role}, but nothing that says what it does")
        if self.mesh_motion is not None and self.mesh_motion.kind not in MOTIONS:
            raise ValueError(f"{self.name}: mesh motion {self.mesh_motion.kind!r}, accepted: {tuple(MOTIONS)}")
        if self.mesh_motion is not None and self.mesh_motion.distance_exponent and "interface" not in roles:
            raise ValueError(f"{self.name}: a mesh motion by the distance from the interface, but no interface")
        if any(self.traction) and "loaded" not in roles:
            raise ValueError(f"{self.name}: a traction but no loaded boundary")
        labels = [boundary.label for boundary in self.boundaries]
        if len(set(labels)) != len(labels):
            raise ValueError(f"{self.name}: two boundaries have the same label, {sorted(labels)}")
        if wrong := [region for region in self.solids if region <= FLUID_REGION]:
            raise ValueError(f"{self.name}: solid in region {wrong[0]}, solids start at {FLUID_REGION + 1}")

    @property
    def mixed_regions(self) -> list[int]:
        """Regions of the solids with a pressure of their own, in the order of their pressures."""
        return sorted(region for region, solid in self.solids.items() if solid.mixed_material is not None)

    def labels(self, role: Role) -> list[int]:
        """Return the boundary labels with a role."""
        return [boundary.label for boundary in self.boundaries if boundary.role == role]

    def parts(self) -> dict[str, list[int]]:
        """Return the labels of each named body part."""
        names = dict.fromkeys(boundary.part for boundary in self.boundaries if boundary.part is not None)
        return {name: [each.label for each in self.boundaries if each.part == name] for name in names}
