"""The tables of the weak form: its unknowns, and the arguments and tests of the fluxes at the quadrature points."""

from __future__ import annotations

from typing import Any

from ffsi.scene import Scene

# Arguments of the fluxes: name, unknown, derivative (0 value, 1 d/dx, 2 d/dy).
FLUID_ARGUMENTS = (
    ("VX", "vx", 0), ("VY", "vy", 0),
    ("DXVX", "vx", 1), ("DYVX", "vx", 2), ("DXVY", "vy", 1), ("DYVY", "vy", 2),
    ("DXUX", "ux", 1), ("DYUX", "ux", 2), ("DXUY", "uy", 1), ("DYUY", "uy", 2),
    ("P", "p", 0),
)  # fmt: skip
SOLID_ARGUMENTS = FLUID_ARGUMENTS[6:10]
MOVING_ARGUMENTS = (("UX", "ux", 0), ("UY", "uy", 0))  # velocity of the mesh

# What each fluid flux depends on: the structural zeros of the Jacobian.
_GRAD_V, _GRAD_U = ("DXVX", "DYVX", "DXVY", "DYVY"), ("DXUX", "DYUX", "DXUY", "DYUY")
FLUID_FLUXES: dict[str, tuple[str, ...]] = {
    "BX": ("VX", "VY", "DXVX", "DYVX", *_GRAD_U, "UX", "UY"),
    "BY": ("VX", "VY", "DXVY", "DYVY", *_GRAD_U, "UX", "UY"),
    "PXX": (*_GRAD_V, *_GRAD_U, "P"),
    "PXY": (*_GRAD_V, *_GRAD_U, "P"),
    "PYX": (*_GRAD_V, *_GRAD_U, "P"),
    "PYY": (*_GRAD_V, *_GRAD_U, "P"),
    "DIV": (*_GRAD_V, *_GRAD_U),
}
# The test function of a flux: unknown whose test function it is, derivative.
FLUID_TESTS = {
    "BX": ("vx", 0), "BY": ("vy", 0), "PXX": ("vx", 1), "PXY": ("vx", 2), "PYX": ("vy", 1), "PYY": ("vy", 2),
    "DIV": ("p", 0),
}  # fmt: skip

STRESS = ("PXX", "PXY", "PYX", "PYY")


def components(scene: Scene) -> tuple[str, ...]:
    """Return the unknown fields: u of solids and moving meshes, v of the fluid and of what is unsteady, p."""
    fields: list[str] = []
    if scene.solid or scene.mesh_moves:
        fields += ["ux", "uy"]
    if scene.fluid or scene.time:
        fields += ["vx", "vy"]
    if scene.fluid or any(solid.mixed for solid in scene.solid.values()):
        fields.append("p")
    return tuple(fields)


def momentum(scene: Scene) -> tuple[str, str]:
    """Return the unknowns whose test functions the momentum has."""
    return ("vx", "vy") if scene.fluid or scene.time else ("ux", "uy")


def kinematic(scene: Scene) -> bool:
    """Return whether u moves in time or with v of solids."""
    return scene.mesh_moves or bool(scene.solid and scene.time)


def _fluid_arguments(scene: Scene) -> tuple[tuple[str, str, int], ...]:
    return (*FLUID_ARGUMENTS, *MOVING_ARGUMENTS) if scene.time and scene.mesh_moves else FLUID_ARGUMENTS


def arguments(scene: Scene) -> list[dict[str, Any]]:
    """Return the flux arguments: field, derivative, column in the solids' arguments (-1: none)."""
    table = _fluid_arguments(scene) if scene.fluid else SOLID_ARGUMENTS
    return [
        {
            "name": argument[0],
            "field": _field(argument[1]),
            "derivative": argument[2],
            "solid": SOLID_ARGUMENTS.index(argument) if scene.solid and argument in SOLID_ARGUMENTS else -1,
        }
        for argument in table
    ]


def fluxes(scene: Scene) -> list[dict[str, Any]]:
    """Return the fluxes: field of the test function, its derivative, column in the solids' fluxes (-1: none)."""
    x, y = momentum(scene)
    stress = dict(zip(STRESS, ((x, 1), (x, 2), (y, 1), (y, 2)), strict=True))
    return [
        {
            "name": name,
            "test": _field(unknown),
            "derivative": derivative,
            "solid": STRESS.index(name) if name in STRESS and scene.solid else -1,
        }
        for name, (unknown, derivative) in (FLUID_TESTS if scene.fluid else stress).items()
    ]


def depends(scene: Scene) -> list[list[bool]]:
    """Return whether a fluid flux (row) depends on an argument (column): the structural zeros of the Jacobian."""
    return [[name in names for name, _, _ in _fluid_arguments(scene)] for names in FLUID_FLUXES.values()]


def _field(unknown: str) -> str:
    """Return the script's number of a field."""
    return f"of{unknown.capitalize()}"
