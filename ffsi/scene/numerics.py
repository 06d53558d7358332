"""Mesh, mesh motion, Newton's method and output."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, StrictBool, model_validator

from ffsi.scene.base import Table
from ffsi.scene.units import Count, Duration, Length, NonNegativeNumber, PositiveNumber, Quantity

LOOSEST = 1e-4
"""Largest tolerance that is accepted: what is left of the equations must not show in a result."""
SIZES = ("growth", "far_size", "body_size", "corner_size")


@dataclass(frozen=True)
class MotionLaw:
    """What is known of a kind of mesh motion: `mesh_motion.divergence_weight` where it is not given, and its form."""

    divergence_weight: float
    linear: bool = True


MOTIONS = {
    "harmonic": MotionLaw(1.0),
    "linear-elastic": MotionLaw(16.0),
    "hyperelastic": MotionLaw(5.0, linear=False),
}


FURTHEST = "hyperelastic"
"""The kind that is taken where the default one, in time a linear one, folds."""


class Mesh(Table):
    """The mesh; in a `Scene` the sizes that are not given have the geometry's defaults."""

    follows: ClassVar[tuple[str, ...]] = SIZES

    level: Annotated[int, Count(0, 6)] = Field(2, description="refinement level 0 to 6 (dimensionless)")
    size_factor: PositiveNumber = Field(1.0, description="factor on every element size, dimensionless")
    growth: PositiveNumber | None = Field(
        None, description="largest increase of the element size per unit length, dimensionless"
    )
    far_size: Length | None = Field(None, description="element size away from the bodies at level 0, m")
    body_size: Length | None = Field(None, description="element size along the bodies at level 0, m")
    corner_size: Length | None = Field(None, description="element size at the bodies' corners at level 0, m")
    root_size: Length | None = Field(
        None, description="flap-channel only: element size at the flap's two root corners at every level, m"
    )


class MeshMotion(Table):
    """How the fluid mesh follows the solid: int alpha P : grad z = 0, with P by kind.

    harmonic: P = grad u + beta div u I; linear-elastic: P = grad u + (grad u)^T + beta div u I; hyperelastic:
    P = F - F^-T + beta ln J F^-T, the stress of a neo-Hookean pseudo-solid, which resists ever more as J = det F falls.

    alpha = (largest area / area)^m (largest distance / distance)^n for each triangle of the fluid, the distance from
    its centroid to the nearest node of the interface.
    """

    follows: ClassVar[tuple[str, ...]] = ("kind", "divergence_weight")

    kind: Literal["harmonic", "linear-elastic", "hyperelastic"] = Field(
        "linear-elastic",
        description='equation of the mesh motion: "harmonic", "linear-elastic" (both linear; the latter if absent and '
        'the scene is in time) or "hyperelastic" (for large displacements; if absent and the scene is steady, or where '
        "the linear one folds)",
    )
    stiffness_exponent: NonNegativeNumber = Field(
        1.0, description="exponent m of the factor (largest area / area)^m of alpha, dimensionless"
    )
    distance_exponent: NonNegativeNumber = Field(
        0.0,
        description="exponent n of the factor (largest distance / distance from the interface)^n of alpha, "
        "dimensionless",
    )
    divergence_weight: NonNegativeNumber = Field(
        MOTIONS["linear-elastic"].divergence_weight,
        description="weight beta of div u (harmonic, 1 if absent, linear-elastic, 16) or of ln J (hyperelastic, 5), "
        "dimensionless",
    )

    @model_validator(mode="after")
    def _weigh(self) -> Self:
        if "divergence_weight" not in self.model_fields_set:
            self.fill(divergence_weight=self.law.divergence_weight)
        return self

    @property
    def law(self) -> MotionLaw:
        """What is known of the kind."""
        return MOTIONS[self.kind]

    def of_scene(self, steady: bool) -> Self:
        """Return the mesh motion with the kind that a steady scene, or one in time, has by default."""
        if "kind" in self.model_fields_set:
            return self
        kind = "hyperelastic" if steady else "linear-elastic"
        return self.filled({"kind": kind, "divergence_weight": MOTIONS[kind].divergence_weight} | self.given())


class Solver(Table):
    """Newton's method and the linear solver.

    `step` and `step_tolerance` matter with a table time only, where a `Scene` fills them in: "condensed" and 3e-5.
    """

    jacobian: Literal["divided-difference"] = Field("divided-difference", description="how the Jacobian is computed")
    tolerance: Annotated[float, Quantity("1", above=0.0, at_most=LOOSEST)] = Field(
        1e-10, description="largest accepted relative residual, dimensionless"
    )
    max_iterations: Annotated[int, Count(1, 1000)] = Field(
        25, description="largest number of Newton iterations (dimensionless)"
    )
    minimum_jacobian: Annotated[float, Quantity("1", at_least=0.0, below=0.5)] = Field(
        1e-3, description="the line search refuses steps with J = det F at or below this, dimensionless"
    )
    start: Literal["coarse", "rest"] = Field(
        "coarse",
        description='first guess: "coarse" (solution of the coarser levels) or "rest"; without '
        "effect in a scene with a table time, which starts from rest",
    )
    reuse_ratio: Annotated[float, Quantity("1", at_least=0.0, below=1.0)] = Field(
        0.1,
        description="factors are kept while the residual falls at least by this factor; 0: new ones in every "
        "iteration, dimensionless",
    )
    linear_solver: Literal["mumps", "umfpack"] = Field(
        "mumps",
        description='sparse LU: "mumps" or "umfpack"; a run that MUMPS cannot factorise starts again with UMFPACK',
    )
    step: Literal["condensed", "newton"] | None = Field(
        None,
        description='with a table time, how a step is solved: "condensed" (by the velocity alone, the default) or '
        '"newton" (all unknowns at once)',
    )
    step_tolerance: Annotated[float, Quantity("1", above=0.0, at_most=LOOSEST)] | None = Field(
        None,
        description="with a table time, largest last correction of a step, relative to V k (displacement), V and P, "
        "the velocity and the pressure that the flow has, and above 1e-6 at most a twentieth of the step's own error; "
        "3e-5 if absent, dimensionless",
    )
    time_limit: Duration | None = Field(None, description="wall-clock time after which the run is stopped, s")


class WallOutput(Table):
    """Wall shear stress, summed over the cycles of the inflow."""

    first_cycle: Annotated[int, Count(1, 10000)] = Field(
        1, description="first cycle that is written; those before it belong to the start (dimensionless)"
    )


class Output(Table):
    """What is written beside the results."""

    vtu: StrictBool = Field(True, description="write fields.vtu for ParaView (true or false)")
    pictures: StrictBool = Field(True, description="write pictures of the fields (true or false)")
    wall: WallOutput | None = Field(
        None,
        description="wall shear stress over each cycle (first_cycle, dimensionless); needs a table time and an inflow "
        "with a period",
    )
