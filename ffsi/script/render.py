"""From a scene to the text of its FreeFEM script.

Structure (which unknowns, which fluxes, which boundaries) is decided here and in the templates; numbers stay run-time
parameters of the script with the scene's values as defaults.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, cast, get_args

from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined
from jinja2.bccache import Bucket

from ffsi.scene import CASES, Boundary, Scene, boundaries
from ffsi.scene.boundaries import SLIP, SLIP_X, SLIP_Y, STRUTS
from ffsi.scene.flow import WOMERSLEY
from ffsi.scene.geometry import Aneurysm, ChannelGeometry
from ffsi.scene.geometry.mesh import STORED
from ffsi.scene.materials import CompressibleElastic, Elastic, InPlane, Solid
from ffsi.scene.outlet import Outlet
from ffsi.scene.units import Density, Quantity
from ffsi.scene.validation import of_field
from ffsi.script import flux_tables
from ffsi.script.formula import with_formulas
from ffsi.script.openings import has_openings, has_reservoirs, openings
from ffsi.script.parameters import OF_CONSISTENCY, Parameter, units_of
from ffsi.script.quantities import reported
from ffsi.script.walls import held_sides, is_fixed, is_held, moving_walls, named_loads

_MESH_ALONE = """BuildMesh(meshLevel);
CheckMesh();
Discretise();
WriteMesh();
cout << "@ffsi mesh level=" << meshLevel << " triangles=" << Th.nt << " unknowns=" << nDof << endl;
cout << "@ffsi end status=converged" << endl;"""
_DECIDES = re.compile("MACRO|acro |include ")  # lines of a script that `bundle` looks at
# Keys that are no numbers of the mathematics, or decide the structure, and stay in Python.
PYTHON_ONLY = ("solver.time_limit", "geometry.stent.count")
_THETA = {  # of a step of length k
    "backward-euler": "1",
    "crank-nicolson": "0.5",
    "shifted-crank-nicolson": "min(1., 0.5+timeShift*k)",
}


def parameters(scene: Scene) -> list[Parameter]:
    """Return the run-time parameters of the scene's script, in the scene's order."""
    unused = (*PYTHON_ONLY, "mesh.size_factor") if scene.geometry.kind == "mesh" else PYTHON_ONLY
    numbers = {
        key: value for key, value in scene.parameters().items() if key not in unused and not is_fixed(key, value)
    }
    return [Parameter(key, value, index, limits(scene, key)) for index, (key, value) in enumerate(numbers.items())]


def limits(scene: Scene, key: str) -> Quantity:
    """Return what the scene's model says about the values of a number."""
    *path, last = key.split(".")
    if path[0] == "solid" and last == "density":
        return cast(Quantity, get_args(Density)[1])  # 0 is another script
    table: Any = scene
    for name in path:
        table = table[name] if isinstance(table, dict) else getattr(table, name)
    said = of_field(type(table).model_fields[last])[1]
    found = next((item for item in said if isinstance(item, Quantity)), None)
    if found is None:
        raise TypeError(f"{key} has no limits: its type must be one of ffsi.scene.units")
    return found


def is_runtime_parameter(scene: Scene, key: str) -> bool:
    """Return whether the dotted key can vary between the points of one process (same mesh, same script)."""
    return any(parameter.key == key and parameter.kind == 1 for parameter in parameters(scene))


def has_sizes(scene: Scene) -> bool:
    """Tell whether the mesh of a scene follows sizes that are a function of the place."""
    library = library_folder() / f"{scene.geometry.kind}.idp"
    return scene.geometry.kind != "mesh" and "macro isAdapted()" in library.read_text(encoding="utf-8")


def render(scene: Scene, *, mumps: bool = True, mesh_file: str = STORED, bundled: bool = True) -> str:
    """Return the complete FreeFEM script of a scene.

    Args:
        scene: a valid scene.
        mumps: whether FreeFEM's MUMPS plugin is there; without it the script uses UMFPACK.
        mesh_file: where the script looks for the mesh of a scene with the geometry "mesh" unless told by a flag.
        bundled: whether the library's files stand in the script, as far as the scene needs them; else it includes them
            from a folder `lib` beside it.
    """
    context = {**_context(scene, mumps), "mesh_file": mesh_file}
    text = _environment().get_template("case.edp.j2").render(context).rstrip() + "\n"
    return bundle(text) if bundled else text


def render_mesh(scene: Scene, *, mumps: bool = True) -> str:
    """Return the script that makes the mesh of a scene as `render`'s does, writes it as `mesh.bin`, and ends."""
    *lines, main = render(scene, mumps=mumps, bundled=False).splitlines()
    assert main.startswith('include "lib/main')
    return bundle("\n".join([*lines, _MESH_ALONE]))


def write_catalogue(folder: str) -> None:
    """Write the scripts of all cases of the catalogue, which include the library, into a folder."""
    for name, scene in CASES.items():
        Path(folder, f"{name}.edp").write_text(render(scene, bundled=False), encoding="utf-8")


def bundle(text: str) -> str:
    """Return a script with the library's files in the place of their includes, without what its macros leave out."""
    lines: list[str] = []
    defined: set[str] = set()
    kept: list[bool] = []  # of the conditions that the present line is in
    pending = text.splitlines()[::-1]
    while pending:
        line = pending.pop()
        if not _DECIDES.search(line):
            if all(kept):
                lines.append(line)
        elif re.fullmatch(r"(?:(?:IFMACRO\(!?\w+\)|ENDIFMACRO) ?){2,}", line):
            pending += line.split()[::-1]
        elif found := re.fullmatch(r"( *)(IFMACRO\(!?\w+\)) (.*) ENDIFMACRO( //.*)?", line):
            pending += ["ENDIFMACRO", f"{found[1]}{found[3]}{found[4] or ''}", found[2]]
        elif found := re.fullmatch(r"IFMACRO\((!?)(\w+)\)", line):
            kept.append((found[2] in defined) != bool(found[1]))
        elif line == "ENDIFMACRO":
            kept.pop()
        elif all(kept):
            if found := re.fullmatch(r'include "lib/([\w-]+\.idp)"', line):
                pending += (library_folder() / found[1]).read_text(encoding="utf-8").splitlines()[::-1]
                continue
            if found := re.match(r"(?:macro|NewMacro) (\w+)\(", line):
                defined.add(found[1])
            lines.append(line)
    return "\n".join(lines) + "\n"


def library_folder() -> Path:
    """Return the folder of the library that scripts include: `edp/lib` in a checkout, inside the package in a wheel."""
    return _folder("lib", "edp/lib")


def _folder(packaged: str, checked_out: str) -> Path:
    package = Path(__file__).parents[1]
    return package / packaged if (package / packaged).is_dir() else package.parent / checked_out


def package_version() -> str:
    """Return the version of the installed distribution."""
    try:
        return version("freefem-fsi")
    except PackageNotFoundError:
        return "unknown"


class _Compiled(FileSystemBytecodeCache):
    """Compiled templates in a folder of the user's own, by their text; none where that cannot be."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Take what is there."""
        with suppress(OSError):
            super().load_bytecode(bucket)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep what was compiled."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def _compiled() -> _Compiled | None:
    with suppress(OSError, RuntimeError):  # no place, or not the user's own
        return _Compiled()
    return None


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(_folder("templates", "templates")),
        bytecode_cache=_compiled(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # FreeFEM text: what reaches it is a number or printed from a parsed tree
    )


def _context(scene: Scene, mumps: bool) -> dict[str, Any]:
    fluid, fsi = scene.fluid is not None, scene.mesh_moves
    numbers = parameters(scene)
    components = flux_tables.components(scene)
    outline = boundaries(scene)
    curved = [b for b in outline if b.circle or b.curved]
    wet = [b for b in outline if b.role in ("inlet", "outlet", "no-slip", "interface", "slip")]
    parts = [b for b in outline if b.part and b in wet]
    solids = [_solid(name, law, number) for number, (name, law) in enumerate(scene.solid.items(), start=2)]
    regions = [*([(1, "fluid")] if fluid else []), *enumerate(scene.solid, start=2)]
    own = scene.geometry.kind == "mesh"
    probes = [f"geometryProbes{name.capitalize()}" if own else f"{name}Probe" for name in scene.probes]
    varying = any(OF_CONSISTENCY in number.declarations for number in numbers)
    mumps = mumps and scene.solver.linear_solver == "mumps"
    labels = {
        "fixedDisplacement": _labels(outline, "inlet", "outlet", "no-slip", "clamped") if scene.solid or fsi else [],
        "fixedVelocity": _labels(outline, "inlet", "no-slip", "clamped"),
        "restingLabels": [b.label for b in outline if b.role in ("no-slip", "clamped") and not b.moving],
        "movingLabels": [b.label for b in outline if b.moving],
        "slipAcrossX": [b.label for b in outline if b.label == SLIP_X],
        "slipAcrossY": [b.label for b in outline if b.label == SLIP_Y],
        "slipInclined": [b.label for b in outline if b.label == SLIP],
        "circleLabels": [b.label for b in outline if b.circle],
        "bentLabels": [b.label for b in outline if b.circle and b.role == "no-slip"],
        "curvedLabels": [b.label for b in outline if b.curved and b.role == "no-slip"],
        "inletLabels": _labels(outline, "inlet"),
        "outletLabels": _labels(outline, "outlet"),
        "doNothingLabels": _outlets_with(scene, outline, lambda each: each.kind != "zero-traction", pressed=True),
        "hydrostaticLabels": _outlets_with(scene, outline, lambda each: bool(each.hydrostatic)),
        "inletsAlongX": _straight_inlets(scene, outline, 0),
        "inletsAlongY": _straight_inlets(scene, outline, 1),
        "throughLabels": _labels(outline, "inlet", "outlet"),
        "fluidLabels": [b.label for b in wet],
        "interfaceLabels": _labels(outline, "interface"),
        "wallLabels": _labels(outline, "no-slip", "interface"),
        "partLabels": [b.label for b in parts],
        "loadLabels": _labels(outline, "loaded"),
        "heldLabels": [b.label for b in outline if is_held(scene, b)],
        **{f"solid{key.capitalize()}": [s[key] for s in solids] for key in ("region", "mixed", "incompressible")},
    }
    needed = {"fixedDisplacement", "fixedVelocity", "circleLabels"}  # even where they are empty
    needed |= {"solidRegion", "solidMixed", "solidIncompressible"}
    if _labels(outline, "slip"):
        needed |= {"slipAcrossX", "slipAcrossY"}
    if scene.point_forces:
        needed |= {"loadLabels"}
    if labels["curvedLabels"]:
        needed |= {"bentLabels"}
    if fluid:
        needed |= {"restingLabels", "interfaceLabels", "wallLabels"}
    if _straight_inlets(scene, outline, 0) + _straight_inlets(scene, outline, 1):
        needed |= {"inletsAlongX", "inletsAlongY"}
    for name in ("inletLabels", "outletLabels", "throughLabels") if fluid else ():
        labels[name] = labels[name] or [-1]  # on no labels at all FreeFEM integrates over every boundary
    return {
        "scene": scene,
        "mumps": mumps,
        "linear_solver": "MUMPS" if mumps else "UMFPACK",
        "parameters": numbers,
        **units_of(scene, numbers),
        "structure": _structure(scene, parts=bool(parts), varying=varying),
        "has_fluid": fluid,
        "has_mesh_file": own,
        "fsi": fsi,
        "unsteady": scene.time is not None,
        "kinematic": flux_tables.kinematic(scene),
        "solids": solids,
        "mixed": any(solid["mixed"] for solid in solids),
        "probes": list(scene.probes),
        "probes_at": lambda axis: ", ".join(probe + axis for probe in probes),
        "arguments": flux_tables.arguments(scene),
        "fluxes": flux_tables.fluxes(scene),
        "depends": flux_tables.depends(scene),
        "regions": [{"number": number, "name": name} for number, name in regions],
        "boundaries": outline,
        "exact": _exact(scene, numbers),
        "boundary_curved": [b in curved for b in outline],
        "boundary_of_body": [not own and (bool(b.part) or b.role == "interface") for b in outline],
        "labels": [(name, here) for name, here in labels.items() if here or name in needed],
        "parts": parts,
        **moving_walls(scene, outline),
        **named_loads(scene, outline),
        "held": held_sides(scene, outline),
        **openings(scene, outline),
        "outlet_tables": [("", scene.only_outlet)] if scene.only_outlet else list(scene.outlets.items()),
        "start": _start(scene),
        "initial_digest": scene.time.initial_state.digest if scene.time and scene.time.initial_state else "",
        "strut_label": STRUTS,
        "inlet": scene.geometry.inlet if scene.inflow and isinstance(scene.geometry, ChannelGeometry) else None,
        "fourier": scene.inflow and scene.inflow.fourier,
        "inflow_waveform": _waveform(scene),
        "theta_of_step": _THETA[scene.time.scheme] if scene.time else "",
        "viscosity_text": "a constant mu" if scene.fluid and scene.fluid.law == "newtonian" else "mu of the shear rate",
        "better_mesh_motion": _better_mesh_motion(scene),
        "unknowns_text": ", ".join(components),
        "machinery": _machinery(scene),
        "reported": {
            "reported": reported(scene),
            "history": [quantity for quantity in reported(scene) if quantity.history and scene.time],
        },
        "ints": lambda values: f"[{', '.join(str(int(value)) for value in values)}]",
        "reals": lambda values: f"[{', '.join(str(value) for value in values)}]",
        "words": lambda values: "[{}]".format(", ".join(f'"{value}"' for value in values)),
    }


def _exact(scene: Scene, numbers: list[Parameter]) -> list[str]:
    """Return the statements of the exact areas, by region, and lengths, by label; an aneurysm's library has its own."""
    if isinstance(scene.geometry, Aneurysm):
        return []
    length, square = ("/unitLength", "/unitLength^2") if scene.geometry.kind == "mesh" else ("", "")
    if not length:
        scene = with_formulas(scene, {number.key: number.variable for number in numbers})
    areas = enumerate(scene.exact_areas().values(), start=1 if scene.fluid else 2)
    lines = [f"exactArea[{number}] = {area}{square};" for number, area in areas]
    return lines + [f"exactLength[{side.label}] = {side.exact_length}{length};" for side in boundaries(scene)]


def _structure(scene: Scene, *, parts: bool, varying: bool) -> list[str]:
    """Return the names of the macros that the scene's script defines: what it is made of."""
    fluid, solid, time, outlet, geometry = scene.fluid, bool(scene.solid), scene.time, scene.only_outlet, scene.geometry
    outlets = [outlet] if outlet else list(scene.outlets.values())
    pressed_inlets = any(inlet.pressure is not None for inlet in scene.inlet.values())
    pressed = outlet is not None and outlet.has_pressure and not pressed_inlets
    coupled, motion = scene.mesh_moves, scene.mesh_motion
    curves = any(b.curved and b.role == "no-slip" for b in boundaries(scene))
    bends = curves or any(b.circle and b.role == "no-slip" for b in boundaries(scene))
    found = {
        "inTime": time,
        "hasFluid": fluid,
        "hasSolid": solid,
        "isCoupled": coupled,
        "hasDisplacement": coupled or solid,
        "hasVelocity": fluid or time,
        "hasPressure": "p" in flux_tables.components(scene),
        "hasKinematics": flux_tables.kinematic(scene),
        "hasSolidViscosity": any(law.viscosity for law in scene.solid.values()),
        "hasMassDamping": any(law.mass_damping for law in scene.solid.values()),
        "hasMasslessSolid": time and any(law.density == 0 for law in scene.solid.values()),
        "hasMixedSolid": any(law.mixed for law in scene.solid.values()),
        "hasMotionFlux": motion and not motion.law.linear,
        "hasLinearMotion": motion and motion.law.linear,
        "isNewtonian": fluid and fluid.law == "newtonian",
        "hasGravity": scene.gravity,
        "hasSolidWeight": scene.gravity and solid,
        "hasBends": bends,
        "hasCurves": curves,
        "hasSlip": any(b.role == "slip" for b in boundaries(scene)),
        "hasInclinedSlip": any(b.label == SLIP for b in boundaries(scene)),
        "hasMeanPressure": scene.level_is_given,
        "hasMovingWalls": scene.walls,
        "hasDisplacedWalls": any(wall.displaced for wall in scene.walls.values()),
        "hasLoads": scene.loads or scene.traction or scene.point_forces,
        "hasPointForces": scene.point_forces,
        "isHeld": any(is_held(scene, b) for b in boundaries(scene)),
        "hasCubicLaws": not fluid
        and not time
        and all(law.material == "st-venant-kirchhoff" and not law.mixed for law in scene.solid.values()),
        # Whose tangent is symmetric, so that the script can tell a stable equilibrium, and of large rotations.
        "predictsStress": not fluid
        and not time
        and not any(law.mixed or law.material == "linear-elastic" for law in scene.solid.values())
        and not any(load.following for load in scene.loads.values()),
        "hasGivenBends": bends and not coupled,
        "hasParts": parts,
        "hasNamedInlets": scene.inlet,
        "hasInlets": scene.inflow or any(inlet.pressure is None for inlet in scene.inlet.values()),
        "hasOpenings": has_openings(scene),
        "hasReservoirs": has_reservoirs(scene),
        "hasStraightInlets": any(inlet.direction == "normal" for inlet in scene.inlet.values()),
        "hasDoNothing": pressed_inlets or any(each.kind != "zero-traction" for each in outlets),
        "hasOutletPressure": pressed,
        # Between rigid walls a constant pressure does no work: the flow is solved without it, what is written has it.
        "hasPressureLevel": pressed and not solid and not coupled,
        "hasOutletLoad": pressed and (solid or coupled),
        "hasResistance": outlet and pressed and outlet.kind != "pressure",
        "hasReservoir": outlet and pressed and outlet.law.stores and time,
        "hasHydrostatic": any(each.hydrostatic for each in outlets),
        "hasBackflow": any(each.backflow is not None for each in outlets),
        "hasRamp": scene.inflow and scene.inflow.ramp,
        "hasFourier": scene.inflow and scene.inflow.fourier,
        "hasWomersley": _womersley(scene),
        "hasWallStress": scene.output.wall,
        "hasStart": time and (time.initial or scene.start),
        "hasInitial": time and time.initial,
        "hasSmallestStep": time and time.smallest_step,
        "hasOutputInterval": time and time.output_interval,
        "hasCheckpointInterval": time and time.checkpoint_interval,
        "startsCoarse": scene.solver.start == "coarse" and not time,
        "unitVaries": varying,
        "hasMeshFile": geometry.kind == "mesh",
        "hasRootSize": geometry.kind == "flap-channel" and scene.mesh.root_size is not None,
        "hasRoof": getattr(geometry, "roof", None),
        "hasBeam": getattr(geometry, "beam", None),
        "hasStent": getattr(geometry, "stent", None),
    }
    return [name for name, here in found.items() if here]


def _machinery(scene: Scene) -> list[str]:
    """Return the library's files that come after the weak form, in their order."""
    outlet = scene.only_outlet
    outlets = [outlet] if outlet else list(scene.outlets.values())
    special = any(each.has_pressure or each.backflow is not None or each.hydrostatic for each in outlets)
    last = ["continuation", "failure", "sensitivities", "localisation", "errors", "adaptation", "main"]
    if scene.time:
        first = ["womersley"] if _womersley(scene) else []
        wall = ["wall"] if scene.output.wall else []
        start = ["initial"] if scene.time.initial or scene.start else []
        follow = ["following-mesh"] if scene.mesh_motion and not scene.mesh_motion.law.linear else []
        last = [*first, "energy", "start-of-step", *follow, "condensed", *start, "step-forces", *wall]
        last += ["time-steps", "checkpoints", "failure-in-time", "main-in-time"]
    loaded = scene.loads or scene.traction or scene.point_forces
    flow = [*(["loads"] if loaded else []), *(["outlet"] if special else [])]
    flow += ["openings"] if has_openings(scene) else []
    flow += ["constant-rows", "residual", "coefficients", "jacobian", "newton", *(["forces"] if scene.fluid else [])]
    return [*flow, "output", "evidence", *last]


def _womersley(scene: Scene) -> bool:
    return scene.inflow is not None and scene.inflow.profile == WOMERSLEY and scene.inflow.fourier is not None


def _outlets_with(
    scene: Scene, outline: list[Boundary], has: Callable[[Outlet], bool], pressed: bool = False
) -> list[int]:
    """Return the labels of outlets with something, of inlets with a pressure if they have it."""
    tables = {side.label: scene.outlets.get(side.opening or "", scene.only_outlet) for side in outline}
    inlets = [side.label for side in outline if side.opening in scene.inlet]
    return [
        label
        for label in _labels(outline, "outlet")
        if (pressed if label in inlets else (table := tables[label]) is not None and has(table))
    ]


def _straight_inlets(scene: Scene, outline: list[Boundary], axis: int) -> list[int]:
    """Return the labels of inlets with a pressure through which fluid comes along an axis only."""
    normal = {name for name, inlet in scene.inlet.items() if inlet.direction == "normal"}
    places = scene.geometry.named_inlets if isinstance(scene.geometry, ChannelGeometry) else {}
    along = [side for side in outline if side.opening in normal and side.role == "outlet"]
    return [side.label for side in along if abs(places[side.opening or ""].inward[axis]) > 0.5]


def _waveform(scene: Scene) -> str:
    """Return the waveform as FreeFEM text: a formula in t, or the sum of its Fourier series; Womersley's has it."""
    if scene.inlet:
        return "LargestInletFactor(at)"
    if scene.inflow is None or _womersley(scene):
        return "1" if scene.inflow else "0"
    return "Waveform(at)" if scene.inflow.fourier else f"({scene.inflow.waveform_expression.to_freefem()})"


def _better_mesh_motion(scene: Scene) -> str:
    """Return what a user is told where the mesh folds."""
    motion = scene.mesh_motion
    if motion is None or not motion.law.linear:
        return ""
    return "; mesh_motion.kind = hyperelastic goes further"


def _start(scene: Scene) -> dict[str, str]:
    """Return the macros of the velocity and displacement at the start, in the script's units, if there are formulas."""
    if scene.start is None:
        return {}
    units = {"velocity": "unitVelocity", "displacement": "unitLength"}
    place = {"x": "(x*unitLength)", "y": "(y*unitLength)"}
    found = {}
    for what, unit in units.items():
        for axis in "xy":
            text = scene.start.expression(f"{what}_{axis}").to_freefem(place)
            found[f"start{what.capitalize()}{axis.upper()}"] = f"({text})/{unit}"
    return found


def _labels(outline: list[Boundary], *roles: str) -> list[int]:
    return [boundary.label for boundary in outline if boundary.role in roles]


def _solid(name: str, law: Solid, region: int) -> dict[str, Any]:
    prefix = f"solid{name.capitalize()}"
    title = "".join(word.capitalize() for word in law.material.split("-"))
    constants = _constants(prefix, law)
    without = law.volume_constants if law.mixed else ()
    return {
        "key": name,
        "mixed": law.mixed,
        "incompressible": law.incompressible,
        "region": region,
        "material": law.material,
        "law": title,
        "limit": f"{title[0].lower()}{title[1:]}LimitJ",
        "density": f"{prefix}Density" if law.density else "0.",
        "viscosity": f"{prefix}Viscosity" if law.viscosity else "0.",
        "mass_damping": f"{prefix}MassDamping" if law.mass_damping else "0.",
        "constants": list(constants.values()),
        "flux_constants": ["0." if key in without else value for key, value in constants.items()],
    }


def _constants(prefix: str, law: Elastic) -> dict[str, str]:
    """Return the constants of a law by their keys, as formulas of the script's parameters; "0." for one it has not."""
    if isinstance(law, CompressibleElastic):
        young, nu, mu = f"{prefix}YoungModulus", f"{prefix}PoissonRatio", f"{prefix}LameMu"
        given = law.given_constants
        if law.incompressible:
            return {"lame_lambda": "0.", "lame_mu": mu if "lame_mu" in given else f"{young}/3"}
        lame_lambda = f"2*{mu}*{nu}/(1-2*{nu})" if "poisson_ratio" in given else f"{prefix}LameLambda"
        if "young_modulus" in given:
            lame_lambda, mu = f"{young}*{nu}/((1+{nu})*(1-2*{nu}))", f"{young}/(2*(1+{nu}))"
        if isinstance(law, InPlane) and law.plane == "stress":
            lame_lambda = f"2*({lame_lambda})*({mu})/({lame_lambda}+2*({mu}))"
        return {"lame_lambda": lame_lambda, "lame_mu": mu}
    keys = [key for key in type(law).model_fields if key not in {*Elastic.model_fields, "material", "formulation"}]
    return {
        key: "0." if getattr(law, key) is None else prefix + "".join(word.capitalize() for word in key.split("_"))
        for key in keys
    }
