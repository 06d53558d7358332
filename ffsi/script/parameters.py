"""The run-time parameters of a script, and its own units, taken from them whatever laws they belong to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ffsi.scene import Scene
from ffsi.scene.geometry import ChannelGeometry
from ffsi.scene.units import Count, Quantity

_POWERS = {"m": (1, 0, 0), "kg": (0, 1, 0), "s": (0, 0, 1), "Pa": (-1, 1, -2), "1": (0, 0, 0)}
_POWER_LAW = "Pa s^m"
_FASTEST = "1e4"  # the Reynolds number of what gravity or a pressure may drive, as a unit
OF_CONSISTENCY = "UnitOfConsistency()"


def powers(unit: str) -> tuple[int, int, int]:
    """Return the powers of length, mass and time in a unit such as "kg/m^3" or "Pa s"."""
    total = [0, 0, 0]
    for place, part in enumerate(unit.split("/")):
        for factor in part.split():
            name, _, power = factor.partition("^")
            sign = (-1 if place else 1) * int(power or 1)
            total = [old + sign * new for old, new in zip(total, _POWERS[name], strict=True)]
    length, mass, time = total
    return length, mass, time


def declarations(unit: str) -> list[str]:
    """Return what tells the script the unit of a number, nothing without dimension."""
    if unit == _POWER_LAW:
        return [OF_CONSISTENCY]
    found = powers(unit)
    return ["Unit({}, {}, {})".format(*found)] if any(found) else []


@dataclass(frozen=True)
class Parameter:
    """One run-time parameter of a script."""

    key: str
    value: float | int
    index: int
    limits: Quantity | Count

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
        bounds: dict[str, float | None]
        if isinstance(self.limits, Count):
            bounds = {"AtLeast": self.limits.minimum, "AtMost": self.limits.maximum}
        else:
            limits = self.limits
            bounds = {
                "Above": limits.above,
                "AtLeast": limits.at_least,
                "Below": limits.below,
                "AtMost": limits.at_most,
            }
        calls = [f"{name}({bound:.16g})" for name, bound in bounds.items() if bound is not None]
        if isinstance(self.limits, Quantity):
            calls += declarations(self.limits.unit)
        return "".join(f" {call};" for call in calls)


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
        keys = [p for p in parameters if p.key.startswith("solid.") and _unit(p) == "Pa" and p.key not in volumes]
        return found | {"unit_of_stiffness": _largest([p.variable for p in keys])}
    assert isinstance(geometry, ChannelGeometry)
    height = geometry.inlet.height
    found["unit_of_size"] = repr(height) if geometry.kind == "mesh" else f"{height / geometry.size!r}*unitLength"
    of_fluid = [p for p in parameters if p.key.startswith("fluid.")]
    viscosities = [p.variable for p in of_fluid if _unit(p) == "Pa s"]
    found["viscous"] = [
        term
        for p in of_fluid
        if (term := {
            "Pa s": f"{p.variable}*unitVelocity/size",
            "Pa": p.variable,
            _POWER_LAW: f"{p.variable}*(unitVelocity/size)^fluidExponent",
        }.get(_unit(p)))
    ]  # fmt: skip
    found["viscosity"] = _largest(viscosities)
    drives = [
        f"abs({p.variable})"
        for p in parameters
        if _unit(p) == "Pa" and not p.key.startswith(("fluid.", "solid."))
    ]  # fmt: skip
    if scene.gravity:
        drives.append("fluidDensity*sqrt(gravityX^2+gravityY^2)*size")
    if drives and viscosities:
        # Where it holds the flow at rest (a hydrostatic outlet) it says nothing of the velocity: sqrt(g L) in water is
        # a Reynolds number of 1e6, whose inertia as a unit leaves nothing of the viscosity, all that rest has.
        slow = f"fluidDensity*({_FASTEST}*{found['viscosity']}/(fluidDensity*size))^2"
        drives = [f"min({' + '.join(drives)}, {slow})"]
    found["drives"] = drives
    rates = [p.variable for p in of_fluid if _unit(p) == "1/s"]
    if viscosities:
        found["unit_of_rest"] = f"{_largest(viscosities)}/(fluidDensity*size)"
    else:
        found["unit_of_rest"] = f"{_largest(rates)}*size"
    return found


def _unit(parameter: Parameter) -> str:
    return getattr(parameter.limits, "unit", "1")


def _largest(variables: Sequence[str]) -> str:
    """Return the largest of some variables as a formula, 0 without any."""
    text = variables[0] if variables else "0."
    for variable in variables[1:]:
        text = f"max({text}, {variable})"
    return text
