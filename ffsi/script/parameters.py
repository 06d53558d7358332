"""The run-time parameters of a script, and its own units, taken from them whatever laws they belong to."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ffsi.scene import Scene
from ffsi.scene.geometry import ChannelGeometry
from ffsi.scene.units import Quantity

_POWERS = {"m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1), "Pa": (-1, 1, -2), "N": (1, 1, -2), "1": (0, 0, 0)}
_POWER_LAW = "Pa s^m"
_STEPS = 100  # in the unit of time of solids without inertia
_FASTEST = "1e4"  # the Reynolds number of what gravity or a pressure may drive, as a unit
OF_CONSISTENCY = "UnitOfConsistency()"


def _unit_declaration(unit: str) -> str:
    """Return what tells the script the unit of a number such as "kg/m^3" or "Pa s", nothing without dimension."""
    if unit == _POWER_LAW:
        return OF_CONSISTENCY
    total = np.zeros(3, dtype=int)  # powers of length, mass and time
    for place, part in enumerate(unit.split("/")):
        for factor in part.split():
            name, _, power = factor.partition("^")
            total += (-1 if place else 1) * int(power or 1) * np.array(_POWERS[name])
    return "Unit({}, {}, {})".format(*total) if total.any() else ""


@dataclass(frozen=True)
class Parameter:
    """One run-time parameter of a script."""

    key: str
    value: float | int
    index: int
    limits: Quantity

    @property
    def flag(self) -> str:
        """Name on the script's command line."""
        return self.key.replace(".", "_")

    @property
    def variable(self) -> str:
        """Name in the script: the words of the key in camel case (FreeFEM knows no underscores)."""
        first, *rest = self.key.replace(".", "_").split("_")
        return first + "".join(word.capitalize() for word in rest)

    @property
    def integer(self) -> bool:
        """Whether the script accepts integers only."""
        return isinstance(self.value, int)

    @property
    def kind(self) -> int:
        """0: a change needs a new mesh; 1: can change between the points of one process."""
        return 0 if self.key.startswith(("geometry.", "mesh.", "solver.")) else 1

    @property
    def declarations(self) -> str:
        """What the script is told of it: bounds, which it checks as the scene does, and unit."""
        bounds = self.limits.bounds.items()
        calls = [f"{''.join(word.capitalize() for word in name.split('_'))}({bound:.16g})" for name, bound in bounds]
        return "".join(f" {call};" for call in (*calls, _unit_declaration(self.limits.unit)) if call)


def units_of(scene: Scene, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Return formulas in SI for the template of the units: the scene's size, and pressures of all that acts in it."""
    geometry = scene.geometry
    if geometry.kind == "mesh":
        length = repr(math.sqrt(sum(scene.exact_areas().values())))
    else:
        variable = next(p.variable for p in parameters if p.key == f"geometry.{geometry.sized_by}")
        default = type(geometry).model_fields[geometry.sized_by].default
        length = f"{variable}/{default!r}" if isinstance(default, float) else variable
    found: dict[str, Any] = {"unit_of_length": length}
    if scene.fluid is None:
        # Nearly incompressible, a solid with a pressure of its own is as stiff as its shape: its volume's modulus would
        # leave nothing of the momentum.
        volumes = {
            f"solid.{name}.{constant}"
            for name, solid in scene.solid.items()
            if solid.mixed
            for constant in solid.volume_constants
        }
        keys = [p for p in parameters if p.key.startswith("solid.") and p.limits.unit == "Pa" and p.key not in volumes]
        heavy = [p.variable for p in parameters if p.key.startswith("solid.") and p.key.endswith(".density")]
        slow = f"unitOfStiffness*({_STEPS}*timeStep/unitLength)^2" if scene.time else "unitOfStiffness"
        found["unit_of_density"] = heavy[0] if heavy else slow
        return found | {"unit_of_stiffness": _largest([p.variable for p in keys])}
    assert isinstance(geometry, ChannelGeometry)
    height = geometry.reference_length if geometry.kind == "mesh" else geometry.inlet.height
    found["unit_of_size"] = repr(height) if geometry.kind == "mesh" else f"{height / geometry.size!r}*unitLength"
    of_fluid = [p for p in parameters if p.key.startswith("fluid.")]
    viscosities = [p.variable for p in of_fluid if p.limits.unit == "Pa s"]
    found["viscous"] = [
        term
        for p in of_fluid
        if (term := {
            "Pa s": f"{p.variable}*unitVelocity/size",
            **({} if p.key == "fluid.mean_pressure" else {"Pa": p.variable}),
            _POWER_LAW: f"{p.variable}*(unitVelocity/size)^fluidExponent",
        }.get(p.limits.unit))
    ]  # fmt: skip
    found["viscosity"] = _largest(viscosities)
    drives = [
        f"abs({p.variable})"
        for p in parameters
        if p.limits.unit == "Pa" and not p.key.startswith(("fluid.", "solid."))
    ]  # fmt: skip
    drives += [f"abs({p.variable})/size" for p in parameters if p.limits.unit == "N/m"]
    if scene.gravity:
        drives.append("fluidDensity*sqrt(gravityX^2+gravityY^2)*size")
    if drives and viscosities:
        # Where it holds the flow at rest (a hydrostatic outlet) it says nothing of the velocity: sqrt(g L) in water is
        # a Reynolds number of 1e6, whose inertia as a unit leaves nothing of the viscosity, all that rest has.
        slow = f"fluidDensity*({_FASTEST}*{found['viscosity']}/(fluidDensity*size))^2"
        drives = [f"min({' + '.join(drives)}, {slow})"]
    found["drives"] = drives
    rates = [p.variable for p in of_fluid if p.limits.unit == "1/s"]
    found["unit_of_rest"] = f"{found['viscosity']}/(fluidDensity*size)" if viscosities else f"{_largest(rates)}*size"
    return found


def _largest(variables: Sequence[str]) -> str:
    """Return the largest of some variables as a formula, 0 without any."""
    return functools.reduce(lambda text, variable: f"max({text}, {variable})", variables) if variables else "0."
