"""From a scene to the text of its FreeFEM script.

Structure (which unknowns, which fluxes, which boundaries) is decided here and in the templates; numbers stay run-time
parameters of the script with the scene's values as defaults.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ffsi.scene import Boundary, Scene, boundaries
from ffsi.scene.materials import CompressibleElastic

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

# Keys that are no numbers of the mathematics and stay in Python.
PYTHON_ONLY = ("solver.time_limit",)
# Last words of the keys whose values must be above zero: the scene says so too, but the script may be run without it.
POSITIVE = (
    "density",
    "viscosity",
    "length",
    "height",
    "width",
    "radius",
    "thickness",
    "size",
    "young_modulus",
    "lame_mu",
    "growth",
)
LIMITS: dict[str, tuple[float | int | None, float | int | None]] = {
    "mesh.level": (0, 4),
    "mesh.size_factor": (1e-3, 1e3),
    "solver.max_iterations": (1, 1000),
}


@dataclass(frozen=True)
class Parameter:
    """One run-time parameter of a script."""

    key: str
    value: float | int
    index: int

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
    def positive(self) -> bool:
        """Whether the script accepts only values above zero."""
        return self.key.endswith(POSITIVE)

    @property
    def minimum(self) -> float | int | None:
        """Smallest value that the script accepts."""
        return LIMITS.get(self.key, (None, None))[0]

    @property
    def maximum(self) -> float | int | None:
        """Largest value that the script accepts."""
        return LIMITS.get(self.key, (None, None))[1]


def parameters(scene: Scene) -> list[Parameter]:
    """Return the run-time parameters of the scene's script, in the scene's order."""
    numbers = {key: value for key, value in scene.parameters().items() if key not in PYTHON_ONLY}
    return [Parameter(key, value, index) for index, (key, value) in enumerate(numbers.items())]


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
    components = COMPONENTS[scene.physics]
    outline = boundaries(scene)
    curved = [b for b in outline if b.circle and b.role == "no-slip"]
    wet = [b for b in outline if b.role in ("inlet", "outlet", "no-slip", "interface")]
    mumps = mumps and scene.solver.linear_solver == "mumps"
    return {
        "scene": scene,
        "version": package_version(),
        "mumps": mumps,
        "linear_solver": "MUMPS" if mumps else "UMFPACK",
        "parameters": parameters(scene),
        "has_fluid": fluid,
        "fsi": fsi,
        "solids": [_solid(scene, name, number) for number, name in _regions(scene) if number > 1],
        "components": components,
        "arguments": _arguments(scene),
        "fluxes": _fluxes(scene),
        "boundaries": outline,
        "regions": [{"number": number, "name": name} for number, name in _regions(scene)],
        "curved": curved,
        "curved_mesh": [b for b in outline if b.circle or (b.label == 6 and scene.geometry.kind == "channel-cylinder")],
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
        "prefix": prefix,
        "region": region,
        "material": law.material,
        "density": f"{prefix}Density",
    }
    if isinstance(law, CompressibleElastic):
        solid["lame_lambda"], solid["lame_mu"] = _lame_code(prefix, law.elastic_pair)
    return solid


def _lame_code(prefix: str, pair: tuple[str, str]) -> tuple[str, str]:
    """Return the Lame constants as formulas of the script's parameters."""
    young, nu, mu = f"{prefix}YoungModulus", f"{prefix}PoissonRatio", f"{prefix}LameMu"
    if pair == ("young_modulus", "poisson_ratio"):
        return f"{young}*{nu}/((1+{nu})*(1-2*{nu}))", f"{young}/(2*(1+{nu}))"
    if pair == ("lame_mu", "poisson_ratio"):
        return f"2*{mu}*{nu}/(1-2*{nu})", mu
    return f"{prefix}LameLambda", mu


def _arguments(scene: Scene) -> list[dict[str, Any]]:
    """Return the flux arguments: unknown (None if it is given data), derivative, column in the solids' arguments."""
    components = COMPONENTS[scene.physics]
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
    """One block of the Jacobian: the terms that couple a test function with an unknown, by region."""

    test: str
    unknown: str
    terms: dict[int, list[str]]

    @property
    def name(self) -> str:
        return self.test.capitalize() + self.unknown.capitalize()

    @property
    def spaces(self) -> tuple[str, str]:
        return ("Ph" if self.unknown == "p" else "Vh", "Ph" if self.test == "p" else "Vh")

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
    for region, solid in enumerate(scene.solid, start=2):
        for m, (test, order) in enumerate(zip(tests, (1, 2, 1, 2), strict=True)):
            for k, (_, unknown, derivative) in enumerate(SOLID_ARGUMENTS):
                add(test, unknown, region, f"{solid}C[{4 * m + k}]*({_factor('a', derivative)}*{_factor('b', order)})")
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
                "unknown_space": block.spaces[0],
                "test_space": block.spaces[1],
                "pattern": patterns.index(block.pattern),
                "parts": [{"region": region, "terms": terms} for region, terms in block.terms.items()],
            }
            for block in blocks
        ],
    }


def _factor(name: str, derivative: int) -> str:
    return (name, f"dx({name})", f"dy({name})")[derivative]
