"""The scene: everything that defines one computation."""

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, Self

import numpy as np
import tomli_w
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from ffsi.scene import together
from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, SceneError, join, names, nearest, short
from ffsi.scene.flow import WOMERSLEY, Forces, Inflow, Inlet, with_mean_velocity
from ffsi.scene.fluids import Fluid, PowerLaw
from ffsi.scene.geometry import ChannelGeometry, FlapChannel, Geometry, GeometryBase, MeshGeometry, Physics
from ffsi.scene.listing import rows
from ffsi.scene.loads import Load, PointForce, load_problems, point_force_problems
from ffsi.scene.materials import Solid
from ffsi.scene.numerics import SIZES, Mesh, MeshMotion, Output, Solver
from ffsi.scene.openings import closed_problems, inflow_problems, opening_problems, with_mean_velocities
from ffsi.scene.outlet import Outlet, Outlets
from ffsi.scene.start import Start, start_problems
from ffsi.scene.time import Time
from ffsi.scene.toml import parse_toml
from ffsi.scene.units import Acceleration, FoundationDamping, FoundationStiffness, Stress
from ffsi.scene.walls import Wall, named, wall_problems

MAX_DESCRIPTION = 200
# Tables by name, the key of geometry.boundaries where their boundaries stand, and that where they get their own label.
_NAMED = (
    ("walls", "walls", "moving"),
    ("loads", "loaded", "loads"),
    ("inlet", "inlet", "inlets"),
    ("outlet", "outlet", "outlets"),
)
STEP_DEFAULTS: dict[str, str | float] = {"step": "condensed", "step_tolerance": 3e-5}
_NAME = re.compile(r"[a-z][a-z0-9-]{0,63}")


class Gravity(Table):
    """Acceleration by gravity, on fluid and solids."""

    x: Acceleration = Field(0.0, description="x component, m/s^2")
    y: Acceleration = Field(0.0, description="y component, m/s^2")


class Traction(Table):
    """Dead traction on the loaded boundary: it keeps its direction, and counts per reference length."""

    x: Stress = Field(0.0, description="x component, Pa")
    y: Stress = Field(0.0, description="y component, Pa")


class Support(Table):
    """Elastic support of the outer sides of walls by their surroundings: the traction is -(stiffness u + damping v)."""

    stiffness: FoundationStiffness = Field(0.0, description="stiffness per reference length of the wall, Pa/m")
    damping: FoundationDamping = Field(0.0, description="damping per reference length of the wall, Pa s/m")


class Scene(Table):
    """One computation: a fluid, a solid or both in a reference domain, steady or, with the table time, in time.

    What is left out is filled in where it can be: element sizes, the reference length of the forces, the mesh
    motion and, in time, how a step is solved. So `to_toml` writes everything that the computation uses.

    Raises:
        SceneError: a key or value is not valid, or the tables do not fit together.
    """

    model_config = ConfigDict(json_schema_extra=lambda schema: schema.update(together.rules()))
    follows: ClassVar[tuple[str, ...]] = ("mesh_motion", "forces")

    name: str = Field(
        description="name: a small letter, then small letters, digits and dashes, at most 64 in all",
        json_schema_extra={"pattern": f"^{_NAME.pattern}$"},
    )
    description: str = Field(
        "",
        description=f"one line of plain text, at most {MAX_DESCRIPTION} characters",
        json_schema_extra={"maxLength": MAX_DESCRIPTION, "pattern": r"^[^\x00-\x1f\x7f]*$"},
    )
    geometry: Geometry = Field(description='reference domain, chosen by its "kind"; lengths in m')
    mesh: Mesh = Field(default_factory=Mesh, description="element sizes in m")
    fluid: Fluid | None = Field(None, description="the fluid; a scene without it is a pure solid")
    solid: dict[str, Solid] = Field(
        default_factory=dict, description="solids by name; without any, the bodies are rigid"
    )
    mesh_motion: MeshMotion | None = Field(
        None, description="motion of the fluid mesh, only where solids or walls displace it"
    )
    gravity: Gravity | None = Field(None, description="acceleration by gravity in m/s^2; none if absent")
    traction: Traction | None = Field(
        None, description="dead traction on the loaded boundary, per reference length, in Pa; needed where there is one"
    )
    loads: dict[str, Load] = Field(
        default_factory=dict, description="loads on boundaries of solids, by name, besides those of `traction`"
    )
    point_forces: dict[str, PointForce] = Field(
        default_factory=dict, description="forces at points of solids in a mesh from a file, by name"
    )
    support: Support | None = Field(
        None, description="elastic support of the outer sides of walls, stiffness in Pa/m, damping in Pa s/m"
    )
    inflow: Inflow | None = Field(None, description="velocity at the inlet in m/s; this or `inlet` with a fluid")
    inlet: dict[str, Inlet] = Field(
        default_factory=dict, description="inlets by name, where there are several or one has a pressure"
    )
    outlet: Outlets | None = Field(
        None, description="condition at the outlet, or at several by name, needed with a fluid"
    )
    walls: dict[str, Wall] = Field(
        default_factory=dict, description="walls of the fluid that move, by name; the others rest"
    )
    forces: Forces | None = Field(None, description="scale of the force coefficients, reference length in m")
    time: Time | None = Field(None, description="steps in time, in s; a scene without it is steady")
    start: Start | None = Field(
        None, description="velocity and displacement at the start of a scene in time, m/s and m; rest if absent"
    )
    solver: Solver = Field(default_factory=Solver, description="Newton's method and the linear solver")
    output: Output = Field(default_factory=Output, description="what is written beside the results")

    # Validation ---------------------------------------------------------------------------------------------------

    @model_validator(mode="before")
    @classmethod
    def _name_boundaries(cls, table: Any) -> Any:
        if not isinstance(table, Mapping):
            return table
        for of_scene, role, key in _NAMED:
            table = named(table, of_scene, role, key)
        return table

    @field_validator("name")
    @classmethod
    def _plain_name(cls, name: str) -> str:
        if not _NAME.fullmatch(name):
            text = "accepted: a small letter, then small letters, digits and dashes, at most 64 in all"
            refuse([Problem("", text, short(name))])
        return name

    @field_validator("description")
    @classmethod
    def _plain_text(cls, description: str) -> str:
        if len(description) > MAX_DESCRIPTION or not description.isprintable():
            text = f"accepted: one line of printable text, at most {MAX_DESCRIPTION} characters"
            refuse([Problem("", text, short(description))])
        return description

    @field_validator("solid", mode="before")
    @classmethod
    def _names_of_geometry(cls, solid: Any, info: ValidationInfo) -> Any:
        geometry = info.data.get("geometry")
        if isinstance(solid, Mapping) and isinstance(geometry, GeometryBase):
            refuse([_unknown_solid(str(name), geometry) for name in solid if name not in geometry.solid_names])
        return solid

    @field_validator("solid")
    @classmethod
    def _in_order_of_regions(cls, solid: dict[str, Solid], info: ValidationInfo) -> dict[str, Solid]:
        geometry = info.data.get("geometry")
        order = geometry.solid_names if isinstance(geometry, GeometryBase) else solid
        return {name: solid[name] for name in order if name in solid}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if isinstance(self.geometry, MeshGeometry):  # a fluid without a region has no inlet either
            refuse(self.geometry.scene_problems(self.solid, self.fluid is not None))
        outline = self.geometry.outline(self.physics)
        problems = [
            load_problems(self.loads, self.geometry, outline, self.time, self.support is not None),
            point_force_problems(self.point_forces, self.geometry, self.solid, self.time),
            self._physics_problems(),
            self._load_problems(),
            self._mesh_problems(),
            self._inflow_problems(),
            opening_problems(self.inlet, self.outlets, self.geometry, self.time, self.gravity is not None),
            self._time_problems(),
            self._wall_problems(),
            wall_problems(self.walls, self.geometry, outline, self.time.end if self.time else None),
        ]
        refuse([problem for group in problems for problem in group])
        if self.fluid and self.level_is_given and self.fluid.mean_pressure is None:
            self.fill(fluid=self.fluid.model_copy(update={"mean_pressure": 0.0}))
        if self.inflow and isinstance(self.geometry, ChannelGeometry) and self.inflow.mean_velocity is None:
            self.fill(inflow=with_mean_velocity(self.inflow, self.geometry.inlet.height))
        if isinstance(self.geometry, ChannelGeometry) and self.inlet:
            self.fill(inlet=with_mean_velocities(self.inlet, self.geometry))
        missing = self._missing_of_mesh()
        if missing:
            self.fill(mesh=self.mesh.filled(missing))
        if isinstance(self.geometry, ChannelGeometry) and self.fluid and self.forces is None:
            self.fill(forces=Forces(reference_length=self.geometry.reference_length))
        if self.mesh_moves:
            self.fill(mesh_motion=(self.mesh_motion or MeshMotion()).of_scene(self.steady))
        if self.time:
            missing_step = {key: value for key, value in STEP_DEFAULTS.items() if getattr(self.solver, key) is None}
            if missing_step:
                self.fill(solver=self.solver.model_copy(update=missing_step))
        return self

    def _missing_of_mesh(self) -> dict[str, float]:
        default = self.geometry.sizes
        if default is None:  # the mesh is that of a file, level 0
            return {} if "level" in self.mesh.model_fields_set else {"level": 0}
        return {key: default[key] for key in SIZES if getattr(self.mesh, key) is None}

    def _physics_problems(self) -> Iterator[Problem]:
        if not isinstance(self.geometry, ChannelGeometry):
            yield from self._no_fluid_problems()
            return
        if self.fluid is None and not self.solid:
            yield Problem("fluid", "missing; a scene needs a fluid, a solid or both")
            return
        yield from self.geometry.scene_problems(self.solid, self.fluid is not None)
        roles = {"inflow" if side.role == "inlet" else side.role for side in self.geometry.outline(self.physics)}
        for key in ("inflow", "outlet"):
            if self.fluid and key not in roles and getattr(self, key):
                text = f"not accepted: geometry.boundaries has no {'inlet' if key == 'inflow' else key}"
                yield Problem(key, text)
            if self.fluid and key in roles and getattr(self, key) is None and not (key == "inflow" and self.inlet):
                yield Problem(key, f"missing; {type(self).model_fields[key].description}")
        if self.only_outlet is not None and self.only_outlet.hydrostatic and self.gravity is None:
            yield Problem("outlet.hydrostatic", "only accepted in a scene with a table gravity", "true")
        if self.closed:
            yield from closed_problems(self.solid, self.inflow, self.inlet, self.walls, self.geometry, self.time)
        if self.fluid and self.fluid.mean_pressure is not None and not self.level_is_given:
            text = "only accepted in a closed fluid (no outlet, no pressure at an inlet), steady or between rigid walls"
            yield Problem("fluid.mean_pressure", text, f"{short(self.fluid.mean_pressure)} Pa")
        if self.inflow is not None and self.inlet:
            yield Problem("inflow", "not accepted beside tables inlet.NAME, which say what flows in")
        for key in ("inflow", "inlet", "outlet", "forces"):
            if self.fluid is None and getattr(self, key):
                yield Problem(key, "only accepted in a scene with a fluid")
        if self.mesh_motion is not None and not self.mesh_moves:
            yield Problem("mesh_motion", "only accepted in a scene with a fluid and a solid or a wall's displacement")
        if self.mesh_motion is not None and not self.solid and self.mesh_motion.distance_exponent:
            text = "not accepted in a scene without a solid"
            yield Problem("mesh_motion.distance_exponent", text, short(self.mesh_motion.distance_exponent))

    def _no_fluid_problems(self) -> Iterator[Problem]:
        kind, solids = self.geometry.kind, self.geometry.solid_names
        if not self.solid:
            yield Problem("solid", f'missing; the geometry "{kind}" holds {names(solids)}')
        for key in ("fluid", "mesh_motion", "inflow", "inlet", "outlet", "forces"):
            if getattr(self, key):
                yield Problem(key, f'not accepted: the geometry "{kind}" holds no fluid')

    def _load_problems(self) -> Iterator[Problem]:
        outline = self.geometry.outline(self.physics)
        loaded = any(boundary.role == "loaded" and not boundary.load for boundary in outline)
        if loaded and self.traction is None:
            yield Problem("traction", f"missing; {type(self).model_fields['traction'].description}")
        if self.traction is not None and not loaded:
            yield Problem("traction", f'not accepted: the geometry "{self.geometry.kind}" has no loaded boundary')

        outer = any(boundary.outer for boundary in self.geometry.outline(self.physics))
        if self.support is not None and not outer:
            text = f'not accepted: no wall with an outer side in the geometry "{self.geometry.kind}" of this scene'
            yield Problem("support", text)
        if self.support is None and isinstance(self.geometry, MeshGeometry) and self.geometry.boundaries.supported:
            yield Problem("support", f"missing; {type(self).model_fields['support'].description}")

    def _mesh_problems(self) -> Iterator[Problem]:
        if self.geometry.sizes is None:
            given = [key for key in SIZES if getattr(self.mesh, key) is not None]
            for key in [*given, *(["size_factor"] if self.mesh.size_factor != 1 else [])]:
                text = f'not accepted with the geometry "{self.geometry.kind}": its file has the sizes; accepted: level'
                yield Problem(f"mesh.{key}", text, short(getattr(self.mesh, key)))
        if self.mesh.root_size is not None and not isinstance(self.geometry, FlapChannel):
            text = f'only accepted with the geometry "flap-channel", this one is "{self.geometry.kind}"'
            yield Problem("mesh.root_size", text, f"{short(self.mesh.root_size)} m")

    def _inflow_problems(self) -> Iterator[Problem]:
        if self.inflow is None or not isinstance(self.geometry, ChannelGeometry) or not self.geometry.named_inlets:
            return
        height = self.geometry.inlet.height
        if self.inflow.profile == WOMERSLEY and isinstance(self.fluid, PowerLaw):
            text = f'not accepted with fluid.law = "{self.fluid.law}", which has no viscosity at large shear rates'
            yield Problem("inflow.profile", text, short(self.inflow.profile))
        yield from inflow_problems(self.inflow, height, self.time, "inflow")

    def _time_problems(self) -> Iterator[Problem]:
        if self.time is None:
            springs = {name for name, load in self.loads.items() if load.stiffness}
            if self.support is not None and self.support.stiffness:
                springs.add("")
            yield from self.geometry.steady_problems(springs)
            if self.start is not None:
                yield Problem("start", "only accepted in a scene with a table time (time.step and time.end)")
            for name, solid in self.solid.items():
                for key in ("viscosity", "mass_damping"):
                    if getattr(solid, key) is not None:
                        text = "only accepted in a scene with a table time (time.step and time.end)"
                        yield Problem(f"solid.{name}.{key}", text, short(getattr(solid, key)))
            return
        for name, solid in self.solid.items():
            if solid.density == 0 and self.time.scheme == "crank-nicolson":
                text = (
                    'not accepted with time.scheme = "crank-nicolson", which damps nothing where there is no inertia; '
                )
                yield Problem(f"solid.{name}.density", text + "accepted: above 0, or another scheme", "0")
        mixed = sum(solid.mixed for solid in self.solid.values())
        outlets = [self.only_outlet] if self.only_outlet else self.outlets.values()
        stores = any(outlet.law.stores for outlet in outlets)
        initial = self.time.initial_state
        yield from start_problems(self.start, initial, self.exact_areas(), mixed, bool(self.solid), stores)

    def _wall_problems(self) -> Iterator[Problem]:
        if self.output.wall is None:
            return
        if self.time is None:
            yield Problem("output.wall", "only accepted in a scene with a table time (time.step and time.end)")
        elif self.inflow is None or self.inflow.period is None:
            yield Problem("inflow.period", "missing; output.wall needs the length of a cycle, s")
        else:
            # The first cycle is always accepted: a short trial of a pulsatile scene ends before it.
            last = max(1, int(self.time.end / self.inflow.period * (1 + 1e-9)))
            if self.output.wall.first_cycle > last:
                times = f"time.end = {short(self.time.end)} s, inflow.period = {short(self.inflow.period)} s"
                text = f"accepted: at most {last}, the last whole cycle ({times})"
                yield Problem("output.wall.first_cycle", text, short(self.output.wall.first_cycle))

    # What follows from the values ---------------------------------------------------------------------------------

    @property
    def physics(self) -> Physics:
        """Which equations are solved: "fluid" (bodies rigid), "solid" or "fsi"."""
        if self.fluid is None:
            return "solid"
        return "fsi" if self.solid else "fluid"

    @property
    def mesh_moves(self) -> bool:
        """Whether the fluid's mesh follows solids or walls."""
        return self.fluid is not None and (bool(self.solid) or any(wall.displaced for wall in self.walls.values()))

    @property
    def steady(self) -> bool:
        """Whether the scene has no table time."""
        return self.time is None

    @property
    def closed(self) -> bool:
        """Whether the scene has a fluid that no boundary with a natural condition lets out or in."""
        pressed = any(inlet.pressure is not None for inlet in self.inlet.values())
        return self.fluid is not None and self.outlet is None and not pressed

    @property
    def level_is_given(self) -> bool:
        """Whether the level of the pressure is `fluid.mean_pressure`: in time solids around a closed fluid give it."""
        return self.closed and (self.steady or not self.solid)

    @property
    def only_outlet(self) -> Outlet | None:
        """The outlet of a scene that does not give several by name."""
        return self.outlet if isinstance(self.outlet, Outlet) else None

    @property
    def outlets(self) -> dict[str, Outlet]:
        """The outlets of a scene that gives them by name."""
        return self.outlet if isinstance(self.outlet, dict) else {}

    @property
    def mean_velocity(self) -> float | None:
        """Mean velocity of the inflow, or the largest of several inlets, m/s; None without a fluid."""
        if self.inflow is not None:
            return self.inflow.mean_velocity
        return max((abs(each.mean_velocity or 0.0) for each in self.inlet.values()), default=None)

    @property
    def tip(self) -> tuple[float, float] | None:
        """Reference point (x, y) in m of tip_ux and tip_uy; None if nothing moves."""
        return self.geometry.tip_point if self.solid else None

    @property
    def probes(self) -> dict[str, tuple[float, float]]:
        """Further reference points (x, y) in m by name, where NAME_ux and NAME_uy are taken; none if nothing moves."""
        return self.geometry.probe_points if self.solid else {}

    def settled(self) -> Self:
        """Return the scene with the formulations of its solids as if they were given.

        They decide about the equations, and would follow other values: what is differentiated keeps them.
        """
        solids = {
            name: type(solid).model_validate(solid.model_dump(exclude_none=True)) for name, solid in self.solid.items()
        }
        return self.model_copy(update={"solid": solids})

    @property
    def formulations(self) -> list[str]:
        """The formulations of its solids, in their order, which decide about the script."""
        return [getattr(solid, "formulation", "displacement") for solid in self.solid.values()]

    def exact_areas(self) -> dict[str, float]:
        """Return the area in m^2 of every region, in the regions' order."""
        areas = self.geometry.areas
        return {name: area for name, area in areas.items() if (self.fluid if name == "fluid" else name in self.solid)}

    def inflow_profile(self) -> Callable[[ArrayLike], NDArray[np.float64]]:
        """Return the function s (m, 0 to H, from the inlet's start) -> velocity (m/s) into the fluid at the inlet.

        In time it is to be multiplied by `inflow.factor(t)`; of the profile "womersley" it is that of the mean flow.

        Raises:
            SceneError: the scene has no fluid.
        """
        if self.inflow is None or not isinstance(self.geometry, ChannelGeometry):
            raise SceneError([Problem("inflow", "a scene without a fluid has none")])
        mean, expression, height = self.inflow.mean_velocity, self.inflow.expression, self.geometry.inlet.height
        assert mean is not None
        return lambda s: mean * expression.evaluate(y=s, H=height)

    def parameters(self) -> dict[str, int | float]:
        """Return every number of the scene by its dotted key, in SI, in the scene's order."""
        leaves = _leaves(self.model_dump())
        return {key: value for key, value in leaves if isinstance(value, int | float) and not isinstance(value, bool)}

    def words(self) -> dict[str, str]:
        """Return every word and formula of the scene by its dotted key, but not its name and description."""
        table = self.model_dump(exclude={"name", "description"})
        return {key: value for key, value in _leaves(table) if isinstance(value, str)}

    # For people ---------------------------------------------------------------------------------------------------

    @property
    def heading(self) -> str:
        """Name, what is solved, and the description."""
        what = {"fluid": "a fluid", "solid": "a solid", "fsi": "fluid and solid"}[self.physics]
        heading = f"Scene {self.name}: {what}, {'steady' if self.steady else 'in time'}"
        return heading + (f". {self.description}" if self.description else "")

    def in_words(self) -> dict[str, str]:
        """Return the values of each table of the scene with their units, by its name."""
        return dict(rows(self))

    def __repr__(self) -> str:
        """Return every table that the scene has, with the units of its values."""
        tables = self.in_words()
        width = max(map(len, tables))
        return "\n".join([self.heading, *(f"  {name:<{width}}  {values}" for name, values in tables.items())])

    __str__ = __repr__

    def _repr_html_(self) -> str:
        from html import escape

        left = 'style="text-align:left"'
        rows = (
            f"<tr><th {left}>{escape(name)}</th><td {left}>{escape(values)}</td></tr>"
            for name, values in self.in_words().items()
        )
        return f"<p><b>{escape(self.heading)}</b></p><table>{''.join(rows)}</table>"

    # TOML ---------------------------------------------------------------------------------------------------------

    @classmethod
    def from_toml(cls, text: str) -> Self:
        """Read a scene.

        Raises:
            SceneError: the text is no TOML or no valid scene.
        """
        return cls.model_validate(parse_toml(text))

    def to_toml(self) -> str:
        """Return the whole scene, defaults included; `from_toml` reads an equal one."""
        table = self.model_dump(exclude_none=True)
        return tomli_w.dumps({key: value for key, value in table.items() if value != {}})


def _unknown_solid(name: str, geometry: GeometryBase) -> Problem:
    """Return the problem of a name in the table "solid" that the geometry does not hold."""
    valid, kind = geometry.solid_names, geometry.kind
    if name in geometry.solids:
        return Problem(name, f'the geometry "{kind}" holds no {name} unless geometry.{name} is given')
    guess = nearest(name, [*valid, *geometry.solids])
    holds = names(valid) or "no solid"
    if geometry.solids and not valid:
        holds += f" unless {' or '.join(f'geometry.{other}' for other in geometry.solids)} is given"
    return Problem(name, f'unknown solid; the geometry "{kind}" holds {holds}', None, guess and f"solid.{guess}")


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every value of nested tables with its dotted key."""
    for name, value in table.items():
        key = join(prefix, name)
        if isinstance(value, Mapping):
            yield from _leaves(value, key)
        else:
            yield key, value
