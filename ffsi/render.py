"""From a scene to the text of its FreeFEM script.

Structure (which unknowns, which fluxes, which boundaries) is decided here and in the templates; numbers stay run-time
parameters of the script with the scene's values as defaults.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, get_args

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ffsi.scene import Boundary, Scene, boundaries
from ffsi.scene.materials import CompressibleElastic
from ffsi.scene.units import Count, Quantity

# Arguments of the fluxes: name, unknown, derivative (0 value, 1 d/dx, 2 d/dy).
FLUID_ARGUMENTS = (
    ("VX", "vx", 0), ("VY", "vy", 0),
    ("DXVX", "vx", 1), ("DYVX", "vx", 2), ("DXVY", "vy", 1), ("DYVY", "vy", 2),
    ("DXUX", "ux", 1), ("DYUX", "ux", 2), ("DXUY", "uy", 1), ("DYUY", "uy", 2),
    ("P", "p", 0),
)  # fmt: skip
SOLID_ARGUMENTS = FLUID_ARGUMENTS[6:10]

# What each fluid flux depends on: the structural zeros of the Jacobian.
_GRAD_V, _GRAD_U = ("DXVX", "DYVX", "DXVY", "DYVY"), ("DXUX", "DYUX", "DXUY", "DYUY")
FLUID_FLUXES: dict[str, tuple[str, ...]] = {
    "BX": ("VX", "VY", "DXVX", "DYVX", *_GRAD_U),
    "BY": ("VX", "VY", "DXVY", "DYVY", *_GRAD_U),
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
COMPONENTS = {"fluid": ("vx", "vy", "p"), "solid": ("ux", "uy"), "fsi": ("ux", "uy", "vx", "vy", "p")}
PRESSURE = "Pressure"  # end of the name of a mixed solid's pressure
VOLUME = 4  # number of a mixed solid's pressure among its arguments, and of its equation of the volume among its fluxes

# Keys that are no numbers of the mathematics and stay in Python.
PYTHON_ONLY = ("solver.time_limit",)


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
    def conditions(self) -> list[tuple[str, str]]:
        """What the script checks, as the scene does: a condition that a wrong value fulfils, and the words for it."""
        if isinstance(self.limits, Count):
            bounds: list[tuple[str, float | None, str]] = [
                ("<", self.limits.minimum, "at least"),
                (">", self.limits.maximum, "at most"),
            ]
        else:
            bounds = [
                ("<=", self.limits.above, "greater than"),
                ("<", self.limits.at_least, "at least"),
                (">=", self.limits.below, "less than"),
            ]
        return [
            (f"{self.variable} {sign} {bound:.16g}", f"{words} {bound:g}")
            for sign, bound, words in bounds
            if bound is not None
        ]


def parameters(scene: Scene) -> list[Parameter]:
    """Return the run-time parameters of the scene's script, in the scene's order."""
    numbers = {key: value for key, value in scene.parameters().items() if key not in PYTHON_ONLY}
    return [Parameter(key, value, index, _limits(scene, key)) for index, (key, value) in enumerate(numbers.items())]


def _limits(scene: Scene, key: str) -> Quantity | Count:
    """Return what the scene's model says about the values of a number."""
    *path, last = key.split(".")
    table: Any = scene
    for name in path:
        table = table[name] if isinstance(table, dict) else getattr(table, name)
    field = type(table).model_fields[last]
    pending = [*field.metadata, field.annotation]
    while pending:
        item = pending.pop()
        if isinstance(item, Quantity | Count):
            return item
        pending += [*getattr(item, "__metadata__", ()), *get_args(item)]
    raise TypeError(f"{key} has no limits: its type must be one of ffsi.scene.units")


def parameter_flags(scene: Scene) -> dict[str, float | int]:
    """Return flag name -> value of every run-time parameter, SI units."""
    return {parameter.flag: parameter.value for parameter in parameters(scene)}


def is_runtime_parameter(scene: Scene, key: str) -> bool:
    """Return whether the dotted key can vary between the points of one process (same mesh, same script)."""
    return any(parameter.key == key and parameter.kind == 1 for parameter in parameters(scene))


def render(scene: Scene, *, mumps: bool = True) -> str:
    """Return the complete FreeFEM script of a scene.

    Args:
        scene: a valid scene.
        mumps: whether FreeFEM's MUMPS plugin is there; without it the script uses UMFPACK.
    """
    text = _environment().get_template("scene.edp.j2").render(_context(scene, mumps))
    return text.rstrip() + "\n"


def template_folder() -> Path:
    """Return the folder of the templates: beside the package in a checkout, inside it in a wheel."""
    inside = Path(__file__).parent / "templates"
    return inside if inside.is_dir() else Path(__file__).parent.parent / "templates"


def package_version() -> str:
    """Return the version of the installed distribution."""
    try:
        return version("freefem-fsi")
    except PackageNotFoundError:
        return "unknown"


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(template_folder()),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # FreeFEM text: what reaches it is a number or printed from a parsed tree
    )


def _context(scene: Scene, mumps: bool) -> dict[str, Any]:
    fluid, fsi = scene.fluid is not None, scene.physics == "fsi"
    components = _components(scene)
    outline = boundaries(scene)
    curved = [b for b in outline if b.circle and b.role == "no-slip"]
    wet = [b for b in outline if b.role in ("inlet", "outlet", "no-slip", "interface")]
    solids = [_solid(scene, name, number) for number, name in _regions(scene) if number > 1]
    mumps = mumps and scene.solver.linear_solver == "mumps"
    return {
        "scene": scene,
        "version": package_version(),
        "mumps": mumps,
        "linear_solver": "MUMPS" if mumps else "UMFPACK",
        "parameters": parameters(scene),
        "has_fluid": fluid,
        "fsi": fsi,
        "solids": solids,
        "mixed": [solid for solid in solids if solid["mixed"]],
        "probes": list(scene.probes),
        "components": components,
        "arguments": _arguments(scene),
        "fluxes": _fluxes(scene),
        "boundaries": outline,
        "regions": [{"number": number, "name": name} for number, name in _regions(scene)],
        "curved": curved,
        "curved_mesh": [b for b in outline if b.circle],
        "interface_labels": _labels(outline, "interface"),
        "loaded_labels": _labels(outline, "loaded"),
        "given_geometry": bool(curved) and not fsi,
        "fluid_labels": [b.label for b in wet],
        "parts": [b for b in outline if b.part and b in wet],
        "displacement_labels": _labels(outline, "inlet", "outlet", "no-slip", "clamped") if "ux" in components else [],
        "velocity_labels": _labels(outline, "inlet", "no-slip", "clamped") if fluid else [],
        "walls": _labels(outline, "no-slip", "clamped"),
        "inflow_profile": scene.inflow.expression.to_freefem() if scene.inflow else "",
        "hyperelastic_motion": _hyperelastic(scene),
        "do_nothing": scene.outlet is not None and scene.outlet.kind == "do-nothing",
        "momentum": ("vx", "vy") if fluid else ("ux", "uy"),
        **_jacobian(scene),
    }


def _components(scene: Scene) -> tuple[str, ...]:
    """Return the unknown fields; a solid alone has a pressure if it is mixed."""
    fields = COMPONENTS[scene.physics]
    return (*fields, "p") if "p" not in fields and any(solid.mixed for solid in scene.solid.values()) else fields


def _hyperelastic(scene: Scene) -> bool:
    return scene.mesh_motion is not None and scene.mesh_motion.kind == "hyperelastic"


def _labels(outline: list[Boundary], *roles: str) -> list[int]:
    return [boundary.label for boundary in outline if boundary.role in roles]


def _regions(scene: Scene) -> list[tuple[int, str]]:
    return [*([(1, "fluid")] if scene.fluid else []), *enumerate(scene.solid, start=2)]


def _solid(scene: Scene, name: str, region: int) -> dict[str, Any]:
    law = scene.solid[name]
    prefix = f"solid{name.capitalize()}"
    solid = {
        "name": name,
        "title": name.capitalize(),
        "flux": f"{'Mixed' if law.mixed else 'Flux'}{name.capitalize()}",
        "n_arguments": VOLUME + 1 if law.mixed else VOLUME,
        "mixed": law.mixed,
        "incompressible": law.incompressible,
        "prefix": prefix,
        "region": region,
        "material": law.material,
        "density": f"{prefix}Density",
    }
    if isinstance(law, CompressibleElastic):
        solid["lame_lambda"], solid["lame_mu"] = _lame_code(prefix, law)
    return solid


def _lame_code(prefix: str, law: CompressibleElastic) -> tuple[str, str]:
    """Return the Lame constants as formulas of the script's parameters; without lambda where J = 1."""
    young, nu, mu = f"{prefix}YoungModulus", f"{prefix}PoissonRatio", f"{prefix}LameMu"
    given = law.given_constants
    if law.incompressible:
        return "", mu if "lame_mu" in given else f"{young}/3"
    if "young_modulus" in given:
        return f"{young}*{nu}/((1+{nu})*(1-2*{nu}))", f"{young}/(2*(1+{nu}))"
    if "poisson_ratio" in given:
        return f"2*{mu}*{nu}/(1-2*{nu})", mu
    return f"{prefix}LameLambda", mu


def _arguments(scene: Scene) -> list[dict[str, Any]]:
    """Return the flux arguments: unknown (None if it is given data), derivative, column in the solids' arguments."""
    components = COMPONENTS[scene.physics]  # the pressures of mixed solids are apart
    table = FLUID_ARGUMENTS if scene.fluid else SOLID_ARGUMENTS
    return [
        {
            "name": argument[0],
            "component": argument[1] if argument[1] in components else None,
            "derivative": argument[2],
            "solid": SOLID_ARGUMENTS.index(argument) if scene.solid and argument in SOLID_ARGUMENTS else None,
        }
        for argument in table
    ]


def _fluxes(scene: Scene) -> list[dict[str, Any]]:
    """Return the fluxes: test function, its derivative, and the columns in the fluid's and the solids' fluxes."""
    if not scene.fluid:
        tests = (("ux", 1), ("ux", 2), ("uy", 1), ("uy", 2))
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


def _jacobian(scene: Scene) -> dict[str, Any]:
    """Return the blocks of the Jacobian, their patterns and the slots of the fluid's coefficients."""
    components = COMPONENTS[scene.physics]
    found: dict[tuple[str, str], _Block] = {}

    def add(test: str, unknown: str, region: int, term: str) -> None:
        block = found.setdefault((test, unknown), _Block(test, unknown, {}))
        block.terms.setdefault(region, []).append(term)

    slots: list[list[int]] = []
    used = 0
    if scene.fluid:
        for flux, depends in FLUID_FLUXES.items():
            test, order = FLUID_TESTS[flux]
            row = []
            for name, unknown, derivative in FLUID_ARGUMENTS:
                active = name in depends and unknown in components
                row.append(used if active else -1)
                if active:
                    add(test, unknown, 1, f"c[{used}]*({_factor('a', derivative)}*{_factor('b', order)})")
                    used += 1
            slots.append(row)
    if _hyperelastic(scene):
        for m, (test, order) in enumerate((("ux", 1), ("ux", 2), ("uy", 1), ("uy", 2))):
            for k, (_, unknown, derivative) in enumerate(SOLID_ARGUMENTS):
                add(test, unknown, 1, f"motionC[{4 * m + k}]*({_factor('a', derivative)}*{_factor('b', order)})")
    tests = ("vx", "vx", "vy", "vy") if scene.fluid else ("ux", "ux", "uy", "uy")
    for region, (solid, law) in enumerate(scene.solid.items(), start=2):
        rows = list(zip(tests, (1, 2, 1, 2), strict=True))
        columns = [(unknown, derivative) for _, unknown, derivative in SOLID_ARGUMENTS]
        if law.mixed:
            pressure = (f"{solid}{PRESSURE}", 0)
            rows, columns = [*rows, pressure], [*columns, pressure]
        for m, (test, order) in enumerate(rows):
            for k, (unknown, derivative) in enumerate(columns):
                if law.incompressible and m == k == VOLUME:
                    continue  # J = 1 knows no pressure
                factor = f"{solid}C[{len(columns) * m + k}]"
                add(test, unknown, region, f"{factor}*({_factor('a', derivative)}*{_factor('b', order)})")
    blocks = list(found.values())
    first: dict[str, int] = {}  # number of the first block of each pattern
    for number, block in enumerate(blocks):
        first.setdefault(block.pattern, number)
    patterns = list(first)
    return {
        "fluid_slots": slots,
        "n_slots": used,
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
                "parts": [{"region": region, "terms": terms} for region, terms in block.terms.items()],
            }
            for block in blocks
        ],
    }


def _space(unknown: str) -> str:
    return "Ph" if unknown == "p" or unknown.endswith(PRESSURE) else "Vh"


def _factor(name: str, derivative: int) -> str:
    return (name, f"dx({name})", f"dy({name})")[derivative]
