"""Structure of the weak form: unknowns, arguments and fluxes at the quadrature points, blocks of the Jacobian."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ffsi.scene import Scene
from ffsi.scene.materials import Elastic

Term = tuple[str, str, int, str]  # test function, unknown, region, text of the term

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
PRESSURE = "Pressure"  # end of the name of a mixed solid's pressure
VOLUME = 4  # number of a mixed solid's pressure among its arguments, and of its equation of the volume among its fluxes


def identifier(scene: Scene, solid: str) -> str:
    """Return what the script's names of a solid begin with; those that a user chose must not be names of its own."""
    return f"{solid}Body" if scene.geometry.free_names else solid


def components(scene: Scene) -> tuple[str, ...]:
    """Return the unknown fields: u of solids and moving meshes, v of the fluid and of what is unsteady, p."""
    fields: list[str] = []
    if scene.solid:
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
    """Return whether u and v of the solids are tied by an equation."""
    return bool(scene.solid) and (scene.fluid is not None or scene.time is not None)


def hyperelastic_motion(scene: Scene) -> bool:
    """Return whether the mesh moves as a hyperelastic pseudo-solid."""
    return scene.mesh_motion is not None and scene.mesh_motion.kind == "hyperelastic"


def _fluid_arguments(scene: Scene) -> tuple[tuple[str, str, int], ...]:
    return (*FLUID_ARGUMENTS, *MOVING_ARGUMENTS) if scene.time and scene.solid else FLUID_ARGUMENTS


def arguments(scene: Scene) -> list[dict[str, Any]]:
    """Return the flux arguments: unknown (None if it is given data), derivative, column in the solids' arguments."""
    unknowns = components(scene)
    table = _fluid_arguments(scene) if scene.fluid else SOLID_ARGUMENTS
    return [
        {
            "name": argument[0],
            "component": argument[1] if argument[1] in unknowns else None,
            "derivative": argument[2],
            "solid": SOLID_ARGUMENTS.index(argument) if scene.solid and argument in SOLID_ARGUMENTS else None,
        }
        for argument in table
    ]


def fluxes(scene: Scene) -> list[dict[str, Any]]:
    """Return the fluxes: test function, its derivative, and the columns in the fluid's and the solids' fluxes."""
    if not scene.fluid:
        x, y = momentum(scene)
        tests = ((x, 1), (x, 2), (y, 1), (y, 2))
        return [
            {"name": name, "test": unknown, "derivative": derivative, "fluid": None, "solid": column}
            for column, (name, (unknown, derivative)) in enumerate(zip(STRESS, tests, strict=True))
        ]
    return [
        {
            "name": name,
            "test": unknown,
            "derivative": derivative,
            "fluid": name,
            "solid": STRESS.index(name) if name in STRESS and scene.solid else None,
        }
        for name, (unknown, derivative) in FLUID_TESTS.items()
    ]


@dataclass
class _Block:
    """One block of the Jacobian: the terms that couple a test function with an unknown, by region.

    The pressure of a mixed solid is the unknown ``NAMEPressure``, which is also the script's map from its vertices.
    """

    test: str
    unknown: str
    terms: dict[int, list[str]]

    @property
    def name(self) -> str:
        return "".join(word[0].upper() + word[1:] for word in (self.test, self.unknown))

    @property
    def spaces(self) -> tuple[str, str]:
        return (_space(self.unknown), _space(self.test))

    @property
    def pattern(self) -> str:
        unknown, test = ("P1" if space == "Ph" else "P2" for space in self.spaces)
        return f"{test} x {unknown} on regions {', '.join(map(str, self.terms))}"


def fluid_slots(scene: Scene) -> tuple[list[list[int]], int]:
    """Return the number of d flux / d argument (-1: none) by flux and argument, and how many there are."""
    unknowns, table, used = components(scene), _fluid_arguments(scene), 0
    slots: list[list[int]] = []
    for depends in FLUID_FLUXES.values() if scene.fluid else ():
        row = []
        for name, unknown, _ in table:
            active = name in depends and unknown in unknowns
            row.append(used if active else -1)
            used += active
        slots.append(row)
    return slots, used


def jacobian(scene: Scene) -> dict[str, Any]:
    """Return the blocks of the whole Jacobian."""
    terms = [*_fluid_terms(scene), *_motion_terms(scene)]
    for region, (name, law) in enumerate(scene.solid.items(), start=2):
        terms += _solid_terms(scene, region, identifier(scene, name), law)
    constants = {"count": "nConstant", "row": "constantRow", "column": "constantColumn", "value": "constantValue"}
    system = _system(terms, _backflow_terms(scene))
    return {
        **system,
        "name": "jacobian",
        "title": "Jacobian",
        "constants": constants,
        "row_map": "rowAt",
        "offset": "",
        "many": False,
        "matrix": "jacobianMatrix",
    }


def condensed(scene: Scene) -> dict[str, Any]:
    """Return the blocks of a time step's system in v and p alone.

    In the solids du = theta k dv; in the fluid the derivatives by the mesh are left out.
    """
    kept = ("vx", "vy", "p")
    terms = [term for term in _fluid_terms(scene) if term[1] in kept]
    to_velocity = {"ux": "vx", "uy": "vy"}
    for region, (name, law) in enumerate(scene.solid.items(), start=2):
        for test, unknown, _, text in _solid_terms(scene, region, identifier(scene, name), law):
            factor = "displacementPerVelocity*" if unknown in to_velocity else ""
            terms.append((test, to_velocity.get(unknown, unknown), region, factor + text))
    names = {name: f"condensedConstant{name.capitalize()}" for name in ("row", "column", "value")}
    constants = {"count": "nCondensedConstant", **names}
    system = _system(terms, _backflow_terms(scene))
    return {
        **system,
        "name": "condensed",
        "title": "Condensed Jacobian in v and p",
        "constants": constants,
        "row_map": "",
        "offset": "vxFrom",
        "many": True,
        "matrix": "condensedMatrices[factor]",
    }


def _fluid_terms(scene: Scene) -> Iterator[Term]:
    slots, _ = fluid_slots(scene)
    for row, flux in zip(slots, FLUID_FLUXES, strict=False):
        test, order = FLUID_TESTS[flux]
        for slot, (_, unknown, derivative) in zip(row, _fluid_arguments(scene), strict=True):
            if slot >= 0:
                yield test, unknown, 1, f"c[{slot}]*({_factor('a', derivative)}*{_factor('b', order)})"


def _motion_terms(scene: Scene) -> Iterator[Term]:
    if not hyperelastic_motion(scene):
        return
    for m, (test, order) in enumerate((("ux", 1), ("ux", 2), ("uy", 1), ("uy", 2))):
        for k, (_, unknown, derivative) in enumerate(SOLID_ARGUMENTS):
            yield test, unknown, 1, f"motionC[{4 * m + k}]*({_factor('a', derivative)}*{_factor('b', order)})"


def _solid_terms(scene: Scene, region: int, name: str, law: Elastic) -> Iterator[Term]:
    x, y = momentum(scene)
    rows = [(x, 1), (x, 2), (y, 1), (y, 2)]
    columns = [(unknown, derivative) for _, unknown, derivative in SOLID_ARGUMENTS]
    if law.mixed:
        pressure = (f"{name}{PRESSURE}", 0)
        rows, columns = [*rows, pressure], [*columns, pressure]
    for m, (test, order) in enumerate(rows):
        for k, (unknown, derivative) in enumerate(columns):
            if law.incompressible and m == k == VOLUME:
                continue  # J = 1 knows no pressure
            factor = f"{name}C[{len(columns) * m + k}]"
            yield test, unknown, region, f"{factor}*({_factor('a', derivative)}*{_factor('b', order)})"


def _backflow_terms(scene: Scene) -> dict[tuple[str, str], str]:
    """Return the derivatives of the traction against backflow at the outlet, by test function and unknown."""
    if scene.outlet is None or scene.outlet.backflow is None:
        return {}
    factor = f"-{'timeTheta*' if scene.time else ''}outletBackflow*fluidDensity"
    found = {}
    for test, flow in (("vx", "outflowVX"), ("vy", "outflowVY")):
        for unknown, normal in (("vx", "N.x"), ("vy", "N.y")):
            own = "min(outflowNormal, 0.)*a*b + " if test == unknown else ""
            found[test, unknown] = f"{factor}*({own}(outflowNormal < 0.)*{normal}*{flow}*a*b)"
    return found


def _system(terms: list[Term], edge_terms: dict[tuple[str, str], str]) -> dict[str, Any]:
    """Return the blocks that terms make, and their patterns; terms on the outlet's edges are within the latter."""
    found: dict[tuple[str, str], _Block] = {}
    for test, unknown, region, text in terms:
        block = found.setdefault((test, unknown), _Block(test, unknown, {}))
        block.terms.setdefault(region, []).append(text)
    blocks = list(found.values())
    first: dict[str, int] = {}  # number of the first block of each pattern
    for number, block in enumerate(blocks):
        first.setdefault(block.pattern, number)
    patterns = list(first)
    return {
        "patterns": [{"name": name, "first": number} for name, number in first.items()],
        "blocks": [
            {
                "name": block.name,
                "test": block.test,
                "unknown": block.unknown,
                "test_map": block.test if block.test.endswith(PRESSURE) else "",
                "unknown_map": block.unknown if block.unknown.endswith(PRESSURE) else "",
                "unknown_space": block.spaces[0],
                "test_space": block.spaces[1],
                "pattern": patterns.index(block.pattern),
                "edge": edge_terms.get((block.test, block.unknown), ""),
                "parts": [{"region": region, "terms": texts} for region, texts in block.terms.items()],
            }
            for block in blocks
        ],
    }


def _space(unknown: str) -> str:
    return "Ph" if unknown == "p" or unknown.endswith(PRESSURE) else "Vh"


def _factor(name: str, derivative: int) -> str:
    return (name, f"dx({name})", f"dy({name})")[derivative]
