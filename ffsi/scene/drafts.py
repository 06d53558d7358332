"""A first scene of one's own: from a few answers to a TOML file with comments, `ffsi new`."""

from __future__ import annotations

import copy
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ffsi.scene.base import Table
from ffsi.scene.errors import Problem, SceneError, join, names, nearest, number_text, short
from ffsi.scene.files import CASES
from ffsi.scene.geometry.mesh import TAKEN
from ffsi.scene.materials import Elastic, NeoHookean
from ffsi.scene.meshes.reading import MeshFile, read_mesh_file
from ffsi.scene.model import Scene
from ffsi.scene.time import Time
from ffsi.scene.together import OF_FLUID

FIRST, MESH, STEADY, NONE = "flap-channel", "mesh", "steady", "none"
WHAT = ("fsi", "fluid", "solid")
STEPS = 200
"""Time steps of a draft in time; the inflow grows from rest in the first tenth of them."""
_WIDTH = 100
_WATER = {"density": "1000 kg/m^3", "viscosity": "1 mPa s"}
_WALL = {"material": "neo-hookean", "density": "1100 kg/m^3", "young_modulus": "1 MPa", "poisson_ratio": 0.4}
_CHANNEL = {"kind": "channel", "length": "2 m", "height": "0.4 m"}
_FLOW = {"inflow": {"mean_velocity": "1 cm/s"}, "outlet": {"kind": "do-nothing"}}
_GUESSES = {"inlet": r"^in(?!ner|ter)", "outlet": r"^out(?!er)", "clamped": r"clamp|fix|held|(?<!b)end|root"}


@dataclass
class Answers:
    """What a person says of a new scene; None where the draft is to choose.

    Args:
        geometry: a `geometry.kind`.
        what: "fluid" (bodies are rigid), "solid" or "fsi".
        material: of the solids.
        velocity: mean velocity at the inlet, a number in m/s or a text with a unit.
        end: "steady", or the time in s, or with a unit, at which a computation in time ends.
        level: of the mesh.
        mesh: path of a mesh file, only of the geometry "mesh", as what follows.
        unit: its unit of length.
        inlet: name of the inlet there; "none" for a solid alone.
        outlet: name of the outlet, or of several, between commas.
        clamped: name of the boundary where solids are held, "none" without any.
    """

    geometry: str | None = None
    what: str | None = None
    material: str | None = None
    velocity: str | None = None
    end: str | None = None
    level: str | None = None
    mesh: str | None = None
    unit: str | None = None
    inlet: str | None = None
    outlet: str | None = None
    clamped: str | None = None


def kinds() -> dict[str, str]:
    """Return the geometries that a draft can have, each with what it is."""
    docs = {kind: type(scene.geometry).__doc__ or "" for kind, scene in sorted(_bases().items())}
    said = {kind: text.partition("\n")[0].replace("`", "") for kind, text in docs.items()}
    return {**said, "channel": "A channel between two rigid walls.", MESH: "A mesh of your own, from a file."}


def choices(geometry: str) -> list[str]:
    """Return what can be solved on a geometry of a kind, the most likely first. Raises ``SceneError``: no such kind."""
    if geometry == MESH:
        return []  # the file says it
    _known(geometry)
    return [what for what in WHAT if _physics(_table(Answers(geometry, what))) == what]


def velocity(answers: Answers) -> str:
    """Return the mean velocity at the inlet where there is no answer to that."""
    found = _table(answers)["inflow"]["mean_velocity"]
    return found if isinstance(found, str) else f"{number_text(found)} m/s"


def draft(name: str, answers: Answers, folder: Path = Path()) -> str:
    """Return a scene as TOML with comments.

    Args:
        name: of the scene.
        answers: what is not to be chosen here.
        folder: where the file will lie; paths in it count from there.

    Raises:
        SceneError: an answer is not accepted, or the mesh file cannot be read.
    """
    table = {"name": name, **_table(answers)}
    scene = Scene.model_validate(table)
    if answers.what not in (None, scene.physics):
        able = choices(scene.geometry.kind) or [scene.physics]
        raise SceneError([Problem("solve", f"accepted with this domain: {names(able)}", short(answers.what))])
    if answers.geometry == MESH:
        path = Path(table["geometry"]["file"]).absolute()
        inside = path.is_relative_to(folder.absolute())
        table["geometry"]["file"] = str(path.relative_to(folder.absolute()) if inside else path)
    else:
        table["geometry"] = {**scene.geometry.model_dump(exclude_none=True), **_lengths(table["geometry"])}
    ordered = {key: table[key] for key in Scene.model_fields if key in table}
    return "\n".join(_lines(scene, ordered, "")).strip() + "\n"


def groups(path: str) -> tuple[list[str], list[str]]:
    """Return the names of the regions and of the curves of a mesh file. Raises ``SceneError``: it cannot be read."""
    file = _read(path)
    return [group.title for group in file.regions], [group.title for group in file.curves]


def guess(what: str, found: list[str]) -> str:
    """Return the name that sounds like an inlet, outlet or clamped boundary; "none" without one."""
    return next((name for name in found if re.search(_GUESSES[what], name.lower())), NONE)


# The table ------------------------------------------------------------------------------------------------------------


@cache
def _bases() -> dict[str, Scene]:
    """Return a case for each kind of geometry: steady, with fluid and solid, neo-Hookean where there is one."""

    def order(scene: Scene) -> tuple[bool, bool, bool, bool]:
        laws = [getattr(solid, "material", "") for solid in scene.solid.values()]
        return not scene.steady, scene.physics != "fsi", "roof" in scene.solid, "neo-hookean" not in laws

    return {scene.geometry.kind: scene for scene in sorted(CASES.values(), key=order, reverse=True)}


def _physics(table: dict[str, Any]) -> str:
    """Return which equations a table is about; nothing where it is no scene."""
    try:
        return Scene.model_validate({"name": "draft", **table}).physics
    except SceneError:
        return ""


def _table(answers: Answers) -> dict[str, Any]:
    kind = answers.geometry or FIRST
    _known(kind)
    for key in ("mesh", "unit", "inlet", "outlet", "clamped"):
        if kind != MESH and (given := getattr(answers, key)) is not None:
            raise SceneError([Problem(key, 'only the geometry "mesh" has it', short(given))])
    if kind == MESH:
        table = _of_mesh(answers)
    elif kind == "channel":
        table = copy.deepcopy({"geometry": _CHANNEL, "fluid": _WATER, **_FLOW})
    else:
        base = _bases()[kind]
        known = ("geometry", "fluid", "solid", "traction", "support", "inflow", "outlet", "forces")
        table = {key: value for key, value in base.given().items() if key in known}
        table["solid"] = {name: _constants(solid, answers.material) for name, solid in base.solid.items()}
        _choose(table, answers.what or base.physics)
    if answers.material is not None and not table.get("solid"):
        raise SceneError([Problem("material", "there is no solid", short(answers.material))])
    if answers.material is not None and kind == MESH:
        table["solid"] = dict.fromkeys(table["solid"], _constants(NeoHookean.model_validate(_WALL), answers.material))
    if answers.velocity is not None:
        table.setdefault("inflow", {})["mean_velocity"] = _number(answers.velocity)
    if answers.end not in (None, STEADY):
        table["time"] = _steps(_number(answers.end))
        if "inflow" in table:
            table["inflow"]["ramp"] = float(number_text(table["time"]["step"] * STEPS / 10))
    if answers.level is not None or kind != MESH:
        table["mesh"] = {"level": 1 if answers.level is None else _number(answers.level)}
    return table


def _known(kind: str) -> None:
    if kind not in kinds():
        raise SceneError([Problem("geometry", f"accepted: {names(kinds())}", short(kind), nearest(kind, kinds()))])


def _choose(table: dict[str, Any], what: str) -> None:
    """Leave in a table what a fluid, a solid or both need."""
    if what not in WHAT:
        raise SceneError([Problem("solve", f"accepted: {names(WHAT)}", short(what), nearest(what, WHAT))])
    for key in {"fluid": ("solid", "support", "mesh_motion"), "solid": OF_FLUID}.get(what, ()):
        table.pop(key, None)
    if what == "solid" and "traction" not in table:
        table["gravity"] = {"y": "-9.81 m/s^2"}


def _constants(solid: Elastic, material: str | None) -> dict[str, Any]:
    """Return the table of a material that is as stiff at rest as the solid."""
    law = material or getattr(solid, "material", "")
    young, nu = solid.young_poisson
    nu = min(nu, 0.45)
    mu, bulk = young / (2 * (1 + nu)), young / (3 * (1 - 2 * nu))
    pair = {"young_modulus": young, "poisson_ratio": nu}
    if law == "mooney-rivlin":
        pair = {"c10": mu / 4, "c01": mu / 4, "bulk_modulus": bulk}
    return {"material": law, "density": solid.density, **{key: float(f"{value:.6g}") for key, value in pair.items()}}


def _steps(end: Any) -> dict[str, Any]:
    try:
        seconds = Time.model_validate({"step": end, "end": end}).end
    except SceneError as error:
        raise SceneError([problem.below("time") for problem in error.problems if problem.key == "end"]) from None
    return {"step": float(number_text(seconds / STEPS)), "end": end}


def _number(text: str) -> Any:
    """Return a number where a text is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


# A mesh of one's own --------------------------------------------------------------------------------------------------


def _of_mesh(answers: Answers) -> dict[str, Any]:
    if answers.mesh is None:
        raise SceneError([Problem("mesh", 'missing; the geometry "mesh" needs a mesh file')])
    file = _read(answers.mesh)
    curves = [group.title for group in file.curves]
    beside = _beside(file)
    inlet, outlet, clamped = (getattr(answers, key) or guess(key, curves) for key in ("inlet", "outlet", "clamped"))
    outlets = [name.strip() for name in outlet.split(",")]
    for key, name in (("inlet", inlet), *(("outlet", name) for name in outlets), ("clamped", clamped)):
        if name not in (*curves, NONE):
            text = f"no boundary of the mesh; accepted: {names([*curves, NONE])}"
            raise SceneError([Problem(key, text, short(name), nearest(name, curves))])
    if inlet == clamped == NONE:
        text = f"missing, as is clamped, and no boundary sounds like one; accepted: {names(curves)}"
        text = text if curves else "missing: the file gives no boundaries names or numbers (in Gmsh: physical curves)"
        raise SceneError([Problem("inlet", text)])
    wet = {region for regions in beside.get(inlet, ()) for region in regions}
    walls = [
        curve for curve, regions in beside.items()
        if curve not in (inlet, *outlets) and regions and all(len(at) == 1 and set(at) <= wet for at in regions)
    ]  # fmt: skip
    solids = {_plain(group.title): group.title for group in file.regions if group.title not in wet}
    sides = {"inlet": inlet, "outlet": outlet} if wet else {}
    sides |= {"clamped": clamped} if solids else {}
    boundaries: dict[str, Any] = {key: name for key, name in sides.items() if name != NONE}
    boundaries |= {"walls": walls if len(walls) > 1 else walls[0]} if walls else {}
    regions = {"fluid": sorted(wet) if len(wet) > 1 else next(iter(wet))} if wet else {}
    geometry = {"kind": MESH, "file": answers.mesh, "unit": answers.unit or "m", "regions": {**regions, **solids}}
    flow: dict[str, Any] = copy.deepcopy({"fluid": _WATER, **_FLOW}) if wet else {"gravity": {"y": "-9.81 m/s^2"}}
    if outlet == NONE:
        flow.pop("outlet", None)
    if wet and len(outlets) > 1:
        del boundaries["outlet"]
        geometry["outlets"] = {_plain(name): name for name in outlets}
        flow["outlet"] = {_plain(name): dict(_FLOW["outlet"]) for name in outlets}
    found = {"geometry": {**geometry, "boundaries": boundaries}, **flow}
    return {**found, "solid": {name: dict(_WALL) for name in solids}} if solids else found


def _read(path: str) -> MeshFile:
    try:
        return read_mesh_file(Path(path))
    except SceneError as error:
        raise SceneError([replace(problem, key="mesh", value=short(path)) for problem in error.problems]) from None


def _beside(file: MeshFile) -> dict[str, set[tuple[str, ...]]]:
    """Return for each curve the regions on the two sides of its edges, one where there is nothing on the other."""
    of_triangle = {int(cell): group.title for group in file.regions for cell in group.cells}
    sides: dict[tuple[int, int], list[str]] = {}
    for number, triangle in enumerate(np.sort(file.triangles, axis=1).tolist()):
        for edge in ((triangle[0], triangle[1]), (triangle[1], triangle[2]), (triangle[0], triangle[2])):
            sides.setdefault(edge, []).append(of_triangle.get(number, ""))
    lines = np.sort(file.lines, axis=1)
    return {
        group.title: {tuple(sides[a, b]) for a, b in lines[group.cells].tolist() if (a, b) in sides}
        for group in file.curves
    }


def _plain(title: str) -> str:
    """Return a name that a solid may have."""
    name = re.sub(r"[^a-z0-9]", "", title.lower())[:28]
    return f"solid{name}" if not name[:1].isalpha() or name in TAKEN else name


# The text -------------------------------------------------------------------------------------------------------------


def _lengths(geometry: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in geometry.items() if not isinstance(value, Mapping)}


def _lines(model: Any, table: Mapping[str, Any], path: str) -> Iterator[str]:
    """Yield the keys of a table with what they mean, then the tables in it."""
    fields = type(model).model_fields if isinstance(model, Table) else {}
    for name, value in table.items():
        if not isinstance(value, Mapping):
            said = fields[name].description if name in fields and path else ""
            items = [tomli_w.dumps({name: item}).strip() for item in (value if isinstance(value, list) else [value])]
            text = f"{name} = [{', '.join(item.removeprefix(f'{name} = ') for item in items)}]"
            yield from _line(text if isinstance(value, list) else items[0], said)
    for name, value in table.items():
        if isinstance(value, Mapping):
            inner = model[name] if isinstance(model, Mapping) else getattr(model, name)
            key = join(path, name)
            if not (value and all(isinstance(item, Mapping) for item in value.values())):
                heading = f"[{key}]"
                said = (type(inner).__doc__ or "").partition("\n")[0] if isinstance(inner, Table) else ""
                yield ""
                yield from _line(heading, said.replace("`", ""))
            yield from _lines(inner, value, key)


def _line(text: str, comment: str | None) -> Iterator[str]:
    said = " ".join((comment or "").split())
    if not said:
        yield text
    elif len(text) + len(said) < _WIDTH:
        yield f"{text}  # {said}"
    else:
        yield from (f"# {line}" for line in textwrap.wrap(said, _WIDTH))
        yield text
