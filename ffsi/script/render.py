"""From a scene to the text of its FreeFEM script.

Structure (which unknowns, which fluxes, which boundaries) is decided here and in the templates; numbers stay run-time
parameters of the script with the scene's values as defaults.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, get_args

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ffsi.scene import Boundary, Scene, boundaries
from ffsi.scene.boundaries import STRUTS
from ffsi.scene.flow import WOMERSLEY
from ffsi.scene.geometry import ChannelGeometry
from ffsi.scene.geometry.mesh import STORED
from ffsi.scene.materials import CompressibleElastic
from ffsi.scene.units import Count, Quantity
from ffsi.script import weakform
from ffsi.script.parameters import Parameter, units_of

# Keys that are no numbers of the mathematics, or decide the structure, and stay in Python.
PYTHON_ONLY = ("solver.time_limit", "geometry.stent.count")


def parameters(scene: Scene) -> list[Parameter]:
    """Return the run-time parameters of the scene's script, in the scene's order."""
    unused = (*PYTHON_ONLY, "mesh.size_factor") if scene.geometry.kind == "mesh" else PYTHON_ONLY
    numbers = {key: value for key, value in scene.parameters().items() if key not in unused}
    return [Parameter(key, value, index, limits(scene, key)) for index, (key, value) in enumerate(numbers.items())]


def limits(scene: Scene, key: str) -> Quantity | Count:
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


def render(scene: Scene, *, mumps: bool = True, mesh_file: str = STORED) -> str:
    """Return the complete FreeFEM script of a scene.

    Args:
        scene: a valid scene.
        mumps: whether FreeFEM's MUMPS plugin is there; without it the script uses UMFPACK.
        mesh_file: where the script looks for the mesh of a scene with the geometry "mesh" unless told by a flag.
    """
    context = {**_context(scene, mumps), "mesh_file": mesh_file}
    text = _environment().get_template("scene.edp.j2").render(context)
    return text.rstrip() + "\n"


def template_folder() -> Path:
    """Return the folder of the templates: beside the package in a checkout, inside it in a wheel."""
    package = Path(__file__).parents[1]
    return package / "templates" if (package / "templates").is_dir() else package.parent / "templates"


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
    numbers = parameters(scene)
    pressed = scene.outlet is not None and scene.outlet.has_pressure
    slots, n_slots = weakform.fluid_slots(scene)
    components = weakform.components(scene)
    outline = boundaries(scene)
    curved = [b for b in outline if b.circle and b.role == "no-slip"]
    wet = [b for b in outline if b.role in ("inlet", "outlet", "no-slip", "interface")]
    solids = [_solid(scene, name, number) for number, name in _regions(scene) if number > 1]
    fourier = scene.inflow.fourier if scene.inflow else None
    mumps = mumps and scene.solver.linear_solver == "mumps"
    return {
        "scene": scene,
        "version": package_version(),
        "mumps": mumps,
        "linear_solver": "MUMPS" if mumps else "UMFPACK",
        "parameters": numbers,
        "unit_varies": any("fluidExponent" in number.unit for number in numbers),
        **units_of(scene, numbers),
        "has_fluid": fluid,
        "fsi": fsi,
        "solids": solids,
        "mixed": [solid for solid in solids if solid["mixed"]],
        "probes": list(scene.probes),
        "components": components,
        "arguments": weakform.arguments(scene),
        "fluxes": weakform.fluxes(scene),
        "boundaries": outline,
        "regions": [{"number": number, "name": name} for number, name in _regions(scene)],
        "curved": curved,
        "curved_mesh": [b for b in outline if b.circle or b.curved],
        "strut_label": STRUTS,
        "wall_labels": _labels(outline, "no-slip", "interface"),
        "inlet": scene.geometry.inlet if fluid and isinstance(scene.geometry, ChannelGeometry) else None,
        "inlet_labels": _labels(outline, "inlet"),
        "through_labels": _labels(outline, "inlet", "outlet"),
        "outlet_labels": _labels(outline, "outlet"),
        "interface_labels": _labels(outline, "interface"),
        "loaded_labels": _labels(outline, "loaded"),
        "supported_labels": _labels(outline, "supported"),
        "given_geometry": bool(curved) and not fsi,
        "fluid_labels": [b.label for b in wet],
        "parts": [b for b in outline if b.part and b in wet],
        "displacement_labels": _labels(outline, "inlet", "outlet", "no-slip", "clamped") if "ux" in components else [],
        "velocity_labels": _labels(outline, "inlet", "no-slip", "clamped") if fluid or scene.time else [],
        "walls": _labels(outline, "no-slip", "clamped"),
        "fourier": fourier,
        "womersley": fourier is not None and scene.inflow is not None and scene.inflow.profile == WOMERSLEY,
        "inflow_waveform": _waveform(scene),
        "inflow_profile": scene.inflow.expression.to_freefem({"y": "inletS"}) if scene.inflow else "",
        "hyperelastic_motion": weakform.hyperelastic_motion(scene),
        "do_nothing": scene.outlet is not None and scene.outlet.kind != "zero-traction",
        "outlet_pressure": pressed,
        # Between rigid walls a constant pressure does no work: the flow is solved without it, what is written has it.
        "pressure_level": pressed and not scene.solid,
        "outlet_load": pressed and bool(scene.solid),
        "outlet_resistance": scene.outlet is not None and scene.outlet.kind in ("resistance", "windkessel"),
        "hydrostatic": scene.outlet is not None and bool(scene.outlet.hydrostatic),
        "windkessel": scene.outlet is not None and scene.outlet.kind == "windkessel" and scene.time is not None,
        "backflow": scene.outlet is not None and scene.outlet.backflow is not None,
        "momentum": weakform.momentum(scene),
        "kinematic": weakform.kinematic(scene),
        "unsteady": scene.time is not None,
        "fluid_slots": slots,
        "n_slots": n_slots,
        "jacobian": weakform.jacobian(scene),
        "condensed": weakform.condensed(scene) if scene.time else None,
    }


def _waveform(scene: Scene) -> str:
    """Return the waveform as FreeFEM text: a formula in t, or the sum of its Fourier series."""
    if scene.inflow is None:
        return "1"
    return "Waveform(at)" if scene.inflow.fourier else scene.inflow.waveform_expression.to_freefem()


def _labels(outline: list[Boundary], *roles: str) -> list[int]:
    return [boundary.label for boundary in outline if boundary.role in roles]


def _regions(scene: Scene) -> list[tuple[int, str]]:
    return [*([(1, "fluid")] if scene.fluid else []), *enumerate(scene.solid, start=2)]


def _solid(scene: Scene, name: str, region: int) -> dict[str, Any]:
    law = scene.solid[name]
    prefix = f"solid{name.capitalize()}"
    own = weakform.identifier(scene, name)
    title = own[0].upper() + own[1:]
    solid = {
        "key": name,
        "name": own,
        "title": title,
        "flux": f"{'Mixed' if law.mixed else 'Theta' if scene.time else 'Flux'}{title}",
        "n_arguments": weakform.VOLUME + 1 if law.mixed else weakform.VOLUME,
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
