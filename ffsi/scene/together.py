"""Which tables and keys of a scene go together, as rules of its JSON schema; `Scene` itself says it in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

from ffsi.scene.flow import WAVEFORMS, WOMERSLEY
from ffsi.scene.geometry import ChannelGeometry, Geometry, GeometryBase, MeshGeometry
from ffsi.scene.json_schema import Rule, absent, at, equals, every, given, some, when
from ffsi.scene.numerics import SIZES
from ffsi.scene.validation import literals
from ffsi.scene.waveforms import named_waveforms

OF_FLUID = ("fluid", "mesh_motion", "inflow", "inlet", "outlet", "forces")
"""Tables that need a fluid."""
SOLIDS: Rule = at("solid", {"minProperties": 1})
_OUTER = {"flap-channel": given("geometry.roof"), "aneurysm": SOLIDS}  # sides for a support; of others by their outline
_NOWHERE: Rule = {"not": {}}


def rules() -> Rule:
    """Return what a scene obeys beyond its tables, as far as a JSON schema can say it."""
    periodic = some(
        *map(given, ("inflow.period", "inflow.waveform_file")), equals("inflow.waveform", *named_waveforms())
    )
    fourier = some(given("inflow.series"), given("inflow.waveform_file"), periodic)
    steady = absent("output.wall", "inflow.ramp", *(f"inflow.{key}" for key in WAVEFORMS))
    return every(
        [
            some(given("fluid"), SOLIDS),
            *(when(given(table), given("fluid")) for table in OF_FLUID),
            when(given("mesh_motion"), SOLIDS),
            when(at("point_forces", {"minProperties": 1}), every([SOLIDS, equals("geometry.kind", "mesh")])),
            when(equals("outlet.hydrostatic", True), given("gravity")),
            when(at("walls", {"minProperties": 1}), given("fluid")),
            when(given("mesh.root_size"), equals("geometry.kind", "flap-channel")),
            when(given("time"), {}, steady),
            when(given("output.wall"), periodic),
            when(equals("inflow.profile", WOMERSLEY), every([fourier, {"not": equals("fluid.law", "power-law")}])),
            *(rule for geometry in get_args(get_args(Geometry)[0]) for rule in _of_geometry(geometry)),
        ]
    )


def _of_geometry(geometry: type[GeometryBase]) -> Iterator[Rule]:
    (kind,) = literals(geometry.model_fields["kind"].annotation)
    here = equals("geometry.kind", kind)
    if issubclass(geometry, MeshGeometry):
        yield when(here, _of_mesh())
        return
    if issubclass(geometry, ChannelGeometry):
        inlet = some(given("inflow"), at("inlet", {"minProperties": 1}))
        yield when(every([here, given("fluid")]), every([given("outlet"), inlet]))
    # Any lengths do: what is asked are names and roles.
    lengths: dict[str, Any] = {name: 1.0 for name, field in geometry.model_fields.items() if field.is_required()}
    example = geometry.model_construct(**lengths)
    solids = dict.fromkeys(geometry.solids, True)
    optional = sorted(geometry.model_fields.keys() & solids)
    names = {"properties": {"solid": {"properties": solids, "additionalProperties": False}}}
    loaded = any(boundary.role == "loaded" for boundary in example.outline("solid"))
    outer = _OUTER.get(kind) or (SOLIDS if any(side.outer for side in example.outline("fsi")) else _NOWHERE)
    yield when(
        here,
        every(
            [
                names,
                given("traction") if loaded else absent("traction"),
                when(given("support"), outer),
                {} if issubclass(geometry, ChannelGeometry) else every([SOLIDS, absent(*OF_FLUID)]),
                given("fluid") if kind == "aneurysm" else {},
                *(when(given(f"solid.{name}"), given(f"geometry.{name}")) for name in optional),
            ]
        ),
    )
    if kind == "aneurysm":
        yield when(every([here, SOLIDS]), given(*(f"solid.{name}" for name in solids)))
    if kind == "flap-channel":
        yield when(given("geometry.roof"), given("fluid", *(f"solid.{name}" for name in solids)))


def _of_mesh() -> Rule:
    """Return the rules of a mesh from a file: it has the sizes, and a fluid where a region is one."""
    bare = absent(*(f"mesh.{key}" for key in SIZES))
    of_fluid = [f"geometry.boundaries.{key}" for key in ("inlet", "outlet", "walls", "slip")]
    outlets = some(given("geometry.boundaries.outlet"), at("geometry.outlets", {"minProperties": 1}))
    loads = some(given("traction"), at("loads", {"minProperties": 1}))
    return every(
        [
            bare,
            when(given("mesh.size_factor"), equals("mesh.size_factor", 1)),
            when(given("geometry.regions.fluid"), given("fluid"), absent("fluid", *of_fluid)),
            when(given("inflow"), given("geometry.boundaries.inlet")),
            when(given("outlet"), outlets),
            when(given("geometry.boundaries.supported"), given("support"), absent("support")),
            when(given("geometry.boundaries.loaded"), loads, absent("traction")),
        ]
    )
