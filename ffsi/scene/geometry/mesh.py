"""A reference domain from a file: any mesh of plane triangles that meshio reads."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Set
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, PlainSerializer, PrivateAttr, ValidationInfo, field_validator, model_validator

from ffsi.files.arrays import Floats
from ffsi.scene.base import Table, refuse
from ffsi.scene.boundaries import INLETS, LOADS, MOVING, OUTLET, OUTLETS, PARTS, Boundary, Inlet
from ffsi.scene.errors import Problem, SceneError, join, names, number_text, short
from ffsi.scene.geometry.base import ChannelGeometry, Physics
from ffsi.scene.units import Checked, Coordinate, to_si

if TYPE_CHECKING:
    from ffsi.scene.meshes.building import DomainMesh
    from ffsi.scene.meshes.curves import Naming

STORED = "geometry.mesh"
"""Name of the mesh in a run folder, where FreeFEM and Python read it."""

NAME = re.compile(r"[a-z][a-z0-9]{0,29}")
NAMES = "accepted as a name: a small letter, then small letters and digits, at most 30 in all"
# Names that would make two quantities of the results, or two names of the script, the same (a test looks for more).
TAKEN = ("fluid", "tip", "surface", "coefficient")


class _GroupNames(Checked):
    """Names or numbers of groups in the mesh file, one or a list."""

    accepted = "a name or a number of the mesh, or a list of them"

    def __call__(self, value: Any) -> tuple[str, ...]:
        """Return the names as a tuple, numbers as text."""
        items = tuple(value) if isinstance(value, list | tuple) else (value,)
        if not items or any(isinstance(item, bool) or not isinstance(item, str | int) for item in items):
            raise self.refused()
        return tuple(str(item) for item in items)

    @property
    def json_schema(self) -> dict[str, Any]:
        """JSON schema."""
        one = {"type": ["string", "integer"]}
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}


class _WallNames(_GroupNames):
    """Names that walls have in the scene, one or a list."""

    accepted = "the name of a wall, or a list of them"


# A single name is written without a list.
_PLAIN = PlainSerializer(lambda names: names[0] if len(names) == 1 else names)
GroupNames = Annotated[tuple[str, ...], _GroupNames(), _PLAIN]
WallNames = Annotated[tuple[str, ...], _WallNames(), _PLAIN]


class MeshBoundaries(Table):
    """Names or numbers of boundaries in the file, by what they are; interfaces are found without being named."""

    inlet: GroupNames | None = Field(None, description="the straight boundary where the fluid enters")
    outlet: GroupNames | None = Field(None, description="boundaries where the fluid leaves")
    walls: GroupNames | None = Field(None, description="rigid walls of the fluid (no slip)")
    clamped: GroupNames | None = Field(None, description="boundaries of the solids that are held")
    free: GroupNames | None = Field(None, description="free boundaries of the solids; those without a name are free")
    supported: GroupNames | None = Field(None, description="outer sides of walls with the table support")
    loaded: GroupNames | None = Field(None, description="boundaries of the solids with the table traction")
    slip: GroupNames | None = Field(
        None, description="walls of the fluid without friction, straight pieces: v.n = 0, the mesh slides"
    )
    symmetry: GroupNames | None = Field(
        None, description="lines of symmetry of fluid and solids, straight pieces: v.n = 0, u.n = 0, no traction along"
    )


class Point(Table):
    """A point of the reference domain."""

    x: Coordinate = Field(description="x, m")
    y: Coordinate = Field(description="y, m")


class MeshGeometry(ChannelGeometry):
    """A mesh from a file; the solids have the names that its table `regions` gives them.

    What is read from the file is read once, when the scene is made.
    """

    default_sizes: ClassVar[dict[str, float] | None] = None
    follows: ClassVar[tuple[str, ...]] = ("tip",)

    kind: Literal["mesh"] = Field(description="name of the geometry")
    file: str = Field(description="mesh file that meshio reads, relative to the scene's file")
    unit: str = Field("m", description='unit of length of its coordinates, such as "mm"')
    regions: dict[str, GroupNames] = Field(
        description='name or number in the mesh of the region "fluid" and of each solid'
    )
    boundaries: MeshBoundaries = Field(
        default_factory=MeshBoundaries, description="names or numbers in the mesh of the boundaries"
    )
    parts: dict[str, GroupNames] = Field(
        default_factory=dict,
        description="bodies on which the force is reported, by name: walls or interfaces; without any the wet side of "
        "each solid, or else the walls",
    )
    moving: dict[str, GroupNames] = Field(
        default_factory=dict,
        description="walls that move along themselves, by name: the scene's table `walls` says how; a name in "
        "`boundaries.walls` that has a table there is moved here",
    )
    loads: dict[str, GroupNames] = Field(
        default_factory=dict,
        description="boundaries of the solids with a load, by name: the scene's table `loads` says which; a name in "
        "`boundaries.loaded` that has a table there is moved here",
    )
    inlets: dict[str, GroupNames] = Field(
        default_factory=dict,
        description="several inlets by name: the scene's tables `inlet.NAME` say what happens there; a name in "
        "`boundaries.inlet` that has such a table is moved here",
    )
    outlets: dict[str, GroupNames] = Field(
        default_factory=dict,
        description="several outlets by name, with the tables `outlet.NAME`; a name in `boundaries.outlet` that has "
        "such a table is moved here",
    )
    curved: WallNames | None = Field(
        None,
        description="rigid walls whose vertices lie on curves, which their edges are bent onto: names of `parts`, "
        '`moving`, or "walls", which are the other ones; corners must turn by more than 75 degrees',
    )
    tip: Point | None = Field(
        None,
        description="point of tip_ux and tip_uy, m; without it the vertex of the solids farthest from what is held",
    )
    probes: dict[str, Point] = Field(
        default_factory=dict, description="further points by name, where NAME_ux and NAME_uy are taken, m"
    )
    _mesh: DomainMesh = PrivateAttr()

    @field_validator("file")
    @classmethod
    def _absolute(cls, file: str) -> str:
        return str(Path(file).absolute())

    @field_validator("unit")
    @classmethod
    def _length(cls, unit: str) -> str:
        try:
            to_si(f"1 {unit}", "m")
        except ValueError as error:
            refuse([Problem("", f'{error}; accepted: a unit of length such as "mm"', short(unit))])
        return unit

    @field_validator("regions", "parts", "probes", "moving", "loads", "inlets", "outlets")
    @classmethod
    def _plain_names(cls, table: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        problems = []
        for name in table:
            if not NAME.fullmatch(name):
                problems.append(Problem(name, NAMES))
            elif name in TAKEN and (name, info.field_name) != ("fluid", "regions"):
                problems.append(Problem(name, "this name is taken, another one is needed"))
        refuse(problems)
        return table

    @model_validator(mode="after")
    def _read(self) -> Self:
        if not self.regions:
            refuse([Problem("regions", f"missing; {type(self).model_fields['regions'].description}")])
        refuse(list(self._missing()))
        try:
            self._mesh = _meshes().domain_mesh(Path(self.file), self.unit, to_si(f"1 {self.unit}", "m"), self._naming)
        except SceneError as error:  # what is wrong with the mesh itself has its file as the value
            name = short(Path(self.file).name)
            refuse([replace(problem, value=name) if problem.key == "file" else problem for problem in error.problems])
        refuse(list(self._point_problems()))
        if self.tip is None and self.solid_names:
            x, y = self._mesh.far_point
            self.fill(tip=Point(x=x, y=y))
        return self

    def _missing(self) -> Iterator[Problem]:
        for key in ("inlet", "outlet"):
            left, several = getattr(self.boundaries, key) or (), getattr(self, f"{key}s")
            given = bool(left)
            if several and given:
                text = f"each needs a table {key}.NAME of the scene, as {names(several)}; without one: {names(left)}"
                yield Problem(f"boundaries.{key}", text)
            if several and "fluid" not in self.regions:
                yield Problem(f"{key}s", 'only accepted where geometry.regions has a "fluid"')
        of_openings = (("inlets", OUTLETS - INLETS), ("outlets", OUTLETS - INLETS))
        for key, most in (("moving", PARTS - MOVING), ("loads", MOVING - LOADS), *of_openings):
            if len(getattr(self, key)) > most:
                yield Problem(key, f"accepted: at most {most}", str(len(getattr(self, key))))
        for key in ("inlet", "outlet", "walls", "slip"):
            if "fluid" not in self.regions and getattr(self.boundaries, key) is not None:
                yield Problem(f"boundaries.{key}", 'only accepted where geometry.regions has a "fluid"')
        if not self.solid_names:
            for key in ("tip", "probes"):
                if getattr(self, key):
                    yield Problem(key, "only accepted where geometry.regions has a solid")

    def _point_problems(self) -> Iterator[Problem]:
        named = {"tip": self.tip} if self.tip else {}
        for key, point in {**named, **{join("probes", name): point for name, point in self.probes.items()}}.items():
            yield from self.outside_solids(key, point.x, point.y)

    def outside_solids(self, key: str, x: float, y: float) -> Iterator[Problem]:
        """Yield the problem of a point, m, that lies in no solid."""
        if not self._mesh.in_solid((x, y)):
            text = f"must lie in a solid; the solids lie in {self._mesh.solids_reach}"
            yield Problem(key, text, f"({number_text(x)}, {number_text(y)}) m")

    @property
    def _naming(self) -> Naming:
        from ffsi.scene.meshes.curves import Naming

        boundaries = {key: getattr(self.boundaries, key) for key in MeshBoundaries.model_fields}
        return Naming(
            tuple(self.regions.items()),
            tuple((key, wanted) for key, wanted in boundaries.items() if wanted is not None),
            tuple(self.parts.items()),
            tuple(self.moving.items()),
            tuple(self.loads.items()),
            tuple(self.inlets.items()),
            tuple(self.outlets.items()),
            self.curved or (),
        )

    def __eq__(self, other: object) -> bool:
        """Compare what is computed on: the same mesh under the same names, wherever its file lies."""
        if not isinstance(other, MeshGeometry):
            return NotImplemented
        return self._essence == other._essence

    @property
    def _essence(self) -> tuple[object, ...]:
        return (self.digest, self.solid_names, self._mesh.boundaries, self.tip, self.probes)

    def __hash__(self) -> int:
        """Hash what `__eq__` compares."""
        return hash(self.digest)

    @property
    def digest(self) -> str:
        """A text that tells one mesh, with its regions and labels, from another."""
        return self._mesh.digest

    def write(self, path: Path) -> None:
        """Write the mesh as the script reads it, in the format of Medit (.mesh)."""
        _meshes().write_medit(self._mesh, path)

    def store(self, directory: Path) -> Self:
        """Write the mesh into a run folder; return the geometry that reads it there, with a path from there."""
        self.write(directory / STORED)
        naming = _meshes().stored_naming(self._mesh, self._naming)
        boundaries = MeshBoundaries(**dict(naming.boundaries))
        changes = {"regions": dict(naming.regions), "boundaries": boundaries, "parts": dict(naming.parts)}
        changes |= {key: dict(getattr(naming, key)) for key in ("moving", "loads", "inlets", "outlets")}
        return self.model_copy(update={"file": STORED, "unit": "m", **changes})

    @property
    def solid_names(self) -> tuple[str, ...]:
        """The regions that are not the fluid."""
        return tuple(name for name in self.regions if name != "fluid")

    @property
    def inlet(self) -> Inlet:
        """Where the fluid enters; the widest of several inlets."""
        return max(self._mesh.inlets.values(), key=lambda inlet: inlet.height)

    @property
    def reference_length(self) -> float:
        """Length of the widest inlet, m, or without any of the domain's longer side."""
        return self.inlet.height if self._mesh.inlets else float(np.ptp(self._mesh.vertices, axis=0).max())

    @property
    def named_inlets(self) -> dict[str, Inlet]:
        """Each of several inlets; the name of the only one is empty."""
        return self._mesh.inlets

    @property
    def outlet_points(self) -> list[tuple[float, float]]:
        """The vertices of the only outlet."""
        mesh = self._mesh
        found = mesh.vertices[np.unique(mesh.edges[mesh.label == OUTLET])]
        return [(x, y) for x, y in found.tolist()]

    @property
    def bluff(self) -> bool:
        """Whether bodies are named."""
        return bool(self.parts)

    @property
    def tip_point(self) -> tuple[float, float] | None:
        """The given tip, or the vertex of the solids that is farthest from what is held, m."""
        return None if self.tip is None else (self.tip.x, self.tip.y)

    @property
    def probe_points(self) -> dict[str, tuple[float, float]]:
        """The given probes, m."""
        return {name: (point.x, point.y) for name, point in self.probes.items()}

    def scene_problems(self, solids: Collection[str], has_fluid: bool) -> list[Problem]:
        """Return the regions without a table of the scene, and a fluid without a region."""
        found = [
            Problem(f"solid.{name}", f"missing; the region {names([name])} of the mesh needs a material")
            for name in self.solid_names
            if name not in solids
        ]
        wet = "fluid" in self.regions
        if wet and not has_fluid:
            found.append(Problem("fluid", 'missing; the mesh has a region "fluid"'))
        if has_fluid and not wet:
            found.append(Problem("fluid", 'not accepted: geometry.regions has no "fluid"'))
        return found

    def steady_problems(self, springs: Set[str]) -> list[Problem]:
        """Return the solids that nothing holds, or a piece of which."""
        accepted = (
            "accepted in a steady scene: on each solid, or one that it adjoins, clamped boundaries, supported ones "
        )
        accepted += "(support.stiffness above 0) or loads with a stiffness"
        return [
            Problem("geometry.boundaries.clamped", f'nothing holds the solid "{name}" at {where}; {accepted}')
            for name, where in {name: at for name, at, loads in self._mesh.loose if not loads & springs}.items()
        ]

    @property
    def areas(self) -> dict[str, float]:
        """Areas in m^2 of the regions."""
        return self._mesh.areas

    def outline(self, physics: Physics) -> list[Boundary]:
        """Return the boundaries of the mesh."""
        return list(self._mesh.boundaries)

    def ends_of(self, label: int) -> Floats:
        """Return both ends (n, 2, 2), m, of the edges with a label."""
        return np.asarray(self._mesh.vertices[self._mesh.edges[self._mesh.label == label]])


def _meshes() -> ModuleType:
    """Return what reads meshes: only scenes that have one wait for scipy."""
    from ffsi.scene.meshes import building

    return building
