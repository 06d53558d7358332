"""Meshes that cannot be used: each has a message of its own, exit code 2, and nothing is written."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
import tomli_w
from vessel_meshes import CURVES, WALL_REGION, Drawing, scene_table, vessel

from ffsi.cli.main import main
from ffsi.scene import SceneError, load_scene

WIDTH = 5  # points across the vessel of the tests: three triangles pairs of lumen, one of wall
INTERFACE = 3  # the interface's place among them
ISLAND = [(11, 5), (11.2, 5), (11, 5.2)]  # within the lumen


def double_interface(drawing: Drawing) -> None:
    shared = np.arange(INTERFACE, len(drawing.points), WIDTH)
    twin = dict(zip(shared, len(drawing.points) + np.arange(len(shared)), strict=True))
    for cells, chosen in (
        (drawing.triangles, drawing.region == WALL_REGION),
        (drawing.lines, drawing.curve == CURVES["ends"]),
    ):
        cells[chosen] = np.vectorize(lambda node: twin.get(node, node))(cells[chosen])
    drawing.points = np.vstack([drawing.points, drawing.points[shared]])


def hang_a_node(drawing: Drawing) -> None:
    """Split the wall's triangle at an edge of the interface, and leave the lumen's as it is."""
    a, b = WIDTH + INTERFACE, 2 * WIDTH + INTERFACE
    wall = (drawing.region == WALL_REGION) & (np.isin(drawing.triangles, (a, b)).sum(axis=1) == 2)
    (c,) = set(drawing.triangles[wall][0]) - {a, b}
    new = len(drawing.points)
    drawing.points = np.vstack([drawing.points, (drawing.points[a] + drawing.points[b]) / 2])
    drawing.triangles = np.vstack([drawing.triangles[~wall], [(a, new, c), (new, b, c)]])
    drawing.region = np.concatenate([drawing.region[~wall], [WALL_REGION] * 2])


def invert_a_triangle(drawing: Drawing) -> None:
    """Pull a node of the lumen across the opposite side of a triangle."""
    drawing.points[WIDTH + 1] = drawing.points[3 * WIDTH + 2]


def turn_a_triangle(drawing: Drawing) -> None:
    drawing.triangles[9] = drawing.triangles[9][::-1]


def turn_all_but_one(drawing: Drawing) -> None:
    drawing.triangles = drawing.triangles[:, ::-1].copy()
    turn_a_triangle(drawing)


def add(points: Any, region: int, held: bool = False) -> Callable[[Drawing], None]:
    """Add a triangle with nodes of its own, clamped on its first side."""

    def change(drawing: Drawing) -> None:
        first = len(drawing.points)
        drawing.points = np.vstack([drawing.points, points])
        drawing.triangles = np.vstack([drawing.triangles, first + np.arange(3)])
        drawing.region = np.concatenate([drawing.region, [region]])
        if held:
            drawing.lines = np.vstack([drawing.lines, [(first, first + 1)]])
            drawing.curve = np.concatenate([drawing.curve, [CURVES["ends"]]])

    return change


def double_the_wall(drawing: Drawing) -> None:
    """Lay a second wall, moved by a twentieth of its thickness, over the first one and the lumen."""
    wall = drawing.region == WALL_REGION
    used, corners = np.unique(drawing.triangles[wall], return_inverse=True)
    drawing.triangles = np.vstack([drawing.triangles, corners.reshape(-1, 3) + len(drawing.points)])
    drawing.region = np.concatenate([drawing.region, drawing.region[wall]])
    drawing.points = np.vstack([drawing.points, drawing.points[used] + np.array([0.05, 0.02])])


def cover_a_node(drawing: Drawing) -> None:
    """Add a triangle of wall that starts at a node of the inlet and lies in the lumen."""
    angle, new = 0.3 + np.array([0.05, 0.08]), len(drawing.points)
    drawing.points = np.vstack([drawing.points, 11.2 * np.column_stack([np.cos(angle), np.sin(angle)])])
    drawing.triangles = np.vstack([drawing.triangles, [(1, new, new + 1)]])
    drawing.region = np.concatenate([drawing.region, [WALL_REGION]])


def let_go(drawing: Drawing) -> None:
    """Part the wall in two, and hold one half only."""
    wall = np.flatnonzero(drawing.region == WALL_REGION)
    drawing.triangles = np.delete(drawing.triangles, wall[6:8], axis=0)
    drawing.region = np.delete(drawing.region, wall[6:8])
    a, b = 3 * WIDTH + INTERFACE, 4 * WIDTH + INTERFACE
    drawing.curve[(np.sort(drawing.lines, axis=1) == (a, b)).all(axis=1)] = CURVES["inner"]
    end = np.isin(drawing.lines, np.arange(6 * WIDTH, 7 * WIDTH)).all(axis=1) & (drawing.curve == CURVES["ends"])
    drawing.curve[end] = CURVES["outside"]
    drawing.lines, drawing.curve = (
        array[drawing.curve != CURVES["outside"]] for array in (drawing.lines, drawing.curve)
    )


def name_nothing(drawing: Drawing) -> None:
    drawing.names |= {"inflow": (31, 1), "plaque": (32, 2)}


def flatten_a_triangle(drawing: Drawing) -> None:
    """Put a node of the lumen onto the opposite side of a triangle."""
    drawing.points[WIDTH + 1] = (drawing.points[1] + drawing.points[WIDTH + 2]) / 2


def part_the_fluid(drawing: Drawing) -> None:
    centre = drawing.points[drawing.triangles].mean(axis=1)
    angle = np.arctan2(centre[:, 1], centre[:, 0])
    drawing.region[(angle > 0.7) & (angle < 0.9)] = WALL_REGION
    middle = drawing.points[drawing.lines].mean(axis=1)
    inner = (drawing.curve == CURVES["inner"]) & (np.abs(np.arctan2(middle[:, 1], middle[:, 0]) - 0.8) < 0.1)
    drawing.curve[inner] = CURVES["outside"]


def bend_the_inlet(drawing: Drawing) -> None:
    drawing.points[1] += (0.05, -0.05)


def call_it(name: str, other: str) -> Callable[[Drawing], None]:
    def change(drawing: Drawing) -> None:
        drawing.curve[drawing.curve == CURVES[name]] = CURVES[other]

    return change


def lift_a_node(drawing: Drawing) -> None:
    drawing.points = np.column_stack([drawing.points, np.zeros(len(drawing.points))])
    drawing.points[7, 2] = 0.2


def double_a_triangle(drawing: Drawing) -> None:
    drawing.triangles = np.vstack([drawing.triangles, drawing.triangles[:1]])
    drawing.region = np.concatenate([drawing.region, [WALL_REGION]])


def third_region(drawing: Drawing) -> None:
    drawing.region[:2] = 3
    drawing.names["plaque"] = (3, 2)


def nowhere(drawing: Drawing) -> None:
    drawing.region[:2] = 0


def line_across(drawing: Drawing) -> None:
    drawing.lines[0] = (0, 2)


def line_elsewhere(drawing: Drawing) -> None:
    """A line of no boundary of the scene, which is no triangle's side: nobody needs it."""
    drawing.lines = np.vstack([drawing.lines, [(0, 2)]])
    drawing.curve = np.concatenate([drawing.curve, [99]])
    call_it("inner", "outside")(drawing)


def not_a_number(drawing: Drawing) -> None:
    drawing.points[4, 0] = np.nan


def boundaries(**changes: Any) -> dict[str, Any]:
    return {"boundaries": {**scene_table()["geometry"]["boundaries"], **changes}}


def regions(**changes: Any) -> dict[str, Any]:
    return {"regions": {**scene_table()["geometry"]["regions"], **changes}}


BROKEN: list[tuple[Callable[[Drawing], None] | None, dict[str, Any], str]] = [
    # the mesh itself
    (double_interface, {}, 'geometry.file = "vessel.msh": the regions "lumen", "wall" do not share the nodes of their '
     r"common boundary: 7 places with two nodes, the first at \(.*\) mm"),
    (hang_a_node, {}, r"geometry.file .*: 1 hanging node, the first at \(.*\) mm, on the triangle side between"),
    (invert_a_triangle, {}, r"geometry.file .*: inverted triangle with the corners \(.*\) mm, .*: it overlaps"),
    (turn_a_triangle, {}, r"geometry.file .*: 1 inverted triangle, the first with the corners \(.*\) mm: it runs "
     "clockwise, its neighbours counter-clockwise"),
    (turn_all_but_one, {}, r"geometry.file .*: 1 inverted triangle, the first .*: it runs counter-clockwise, its"),
    (double_the_wall, {}, r'geometry.file .*: two triangles overlap at \(.*\) mm, one of "wall" with the corners '
     r'\(.*\) mm and one of "wall" with the corners \(.*\) mm; accepted: regions that cover each place once'),
    (add(ISLAND, WALL_REGION), {}, r'two triangles overlap at \(11.05, 5.1\) mm, one of "wall" .* one of "lumen" with'),
    (add([(0, 0), (99, 0), (0, 99)], WALL_REGION), {}, r'overlap .* and one of "wall" with the corners \(0, 0\)'),
    (cover_a_node, {}, r'two triangles overlap at \(10.4\d+, 3.5\d+\) mm, one of "wall" .* and one of "lumen" with'),
    (add([(20, 5), (21, 5), (20, 6)], WALL_REGION, held=True), {}, r"geometry.regions.wall: its piece at \(20.3333, "
     r"5.33333\) mm is not connected to the fluid; accepted with a fluid: solids that share edges with it"),
    (flatten_a_triangle, {}, r"geometry.file .*: 1 triangle without area, the first with the corners \("),
    (double_a_triangle, {}, r'geometry.regions.wall = "wall": shares 1 triangle with regions.fluid = "lumen", the '
     r"first at \(.*\) mm"),
    (lift_a_node, {}, "geometry.file .*: the mesh must lie in a plane z = constant; z goes from 0 to 0.2"),
    (not_a_number, {}, "geometry.file .*: the coordinates of node 5 are not finite"),
    (part_the_fluid, {}, r"geometry.regions.fluid: the fluid falls into 2 pieces .* the triangle \(.*, another one \("),
    (third_region, {}, 'geometry.regions: the mesh has the region "plaque", which is used nowhere; accepted: each'),
    (nowhere, {}, r"geometry.regions: 2 triangles of the mesh belong to no region, the first at \(.*\) mm;"),
    (line_across, {}, 'geometry.boundaries.inlet: of "in", 1 line of 3 are no sides of triangles'),
    # roles
    (bend_the_inlet, {}, r"geometry.boundaries.inlet: must be straight; at \(.*\) mm it is .* mm away from the line"),
    (call_it("inner", "outside"), {"boundaries": {"inlet": "in", "outlet": "out", "clamped": "ends"}},
     r'geometry.boundaries: 6 boundary edges of the fluid without a role, the first at \(.*\) mm \(in the mesh: '
     r'"outside"\); accepted: each of them in inlet, outlet, walls, slip or symmetry'),
    (line_elsewhere, boundaries(walls=None), 'geometry.boundaries: 6 boundary edges .*"outside"'),
    (None, boundaries(walls=None), r'6 boundary edges of the fluid without a role, .*\(in the mesh: "inner"\)'),
    (None, boundaries(inlet=["in", "out"], outlet="inner", walls=None), "inlet: must be one connected .* 2 pieces"),
    (None, boundaries(walls=["inner", "outside"]), r'boundaries.walls = "outside": at \(.*\) mm it is a boundary of a '
     "solid; accepted: outer boundaries of the fluid"),
    (None, boundaries(walls=["inner", "interface"]), r'boundaries.walls = "interface": at \(.*\) mm it lies between '
     "fluid and solid; such an interface is found without being named"),
    (None, boundaries(clamped=["ends", "inner"]), 'boundaries.clamped = "inner": .* it is a boundary of the fluid'),
    (None, boundaries(outlet=["out", "in"]), r'boundaries.outlet = "in": shares edges with boundaries.inlet'),
    (None, boundaries(clamped=None), 'boundaries.clamped: nothing holds the solid "wall" at .* mm; accepted in a '
     "steady scene: on each solid, or one that it adjoins, clamped boundaries, supported ones"),
    (let_go, {}, r'boundaries.clamped: nothing holds the solid "wall" at \([0-9.]*, 1[0-9.]*\) mm; accepted'),
    # names
    (None, boundaries(inlet="inn"), r'boundaries.inlet = "inn": no such boundary; the mesh has "in", "out", "inner", '
     r'"ends", "outside", "interface" \(did you mean "in"'),
    (name_nothing, boundaries(inlet="inflow"), 'boundaries.inlet = "inflow": the file names this boundary, but nothing '
     'belongs to it; the mesh has "in", "out"'),
    (name_nothing, regions(wall="plaque"), 'regions.wall = "plaque": the file names this region, but nothing'),
    (None, boundaries(outlet=77), 'boundaries.outlet = "77": no such boundary; the mesh has'),
    (None, boundaries(outlet=None),
     r'geometry.boundaries: 3 boundary edges of the fluid without a role, .*\(in the mesh: "out"\)'),
    (None, boundaries(inlett="in"), r'boundaries.inlett = "in": unknown key.*did you mean "geometry.boundaries.inlet"'),
    (None, boundaries(inlet=[]), "boundaries.inlet = a list of 0: accepted: a name or a number of the mesh, or a list"),
    (None, boundaries(inlet=1.5), "boundaries.inlet = 1.5: accepted: a name or a number of the mesh"),
    (None, regions(fluid="lumn"), r'regions.fluid = "lumn": no such region; the mesh has "lumen", "wall" .did you mean '
     '"lumen"'),
    (None, regions(fluid="wall"), 'geometry.regions.wall = "wall": is already regions.fluid'),
    (None, regions(Wall="wall"), "geometry.regions.Wall: accepted as a name: a small letter"),
    (None, regions(tip="wall"), "geometry.regions.tip: this name is taken"),
    (None, {"regions": {"fluid": ["lumen", "wall"]}, "boundaries": {"inlet": "in", "outlet": "out",
     "walls": ["inner", "outside", "ends"]}}, 'solid.wall: unknown solid; the geometry "mesh" holds no solid'),
    (None, {"regions": {"fluid": "lumen", "vein": "wall"}}, 'solid.wall: unknown solid; .* "mesh" holds "vein"'),
    (None, {"regions": {}}, 'geometry.regions: missing; name or number in the mesh of the region "fluid"'),
    (None, {"regions": None}, 'geometry.regions: missing; name or number in the mesh of the region "fluid" and'),
    (None, {"regions": "lumen"}, 'geometry.regions = "lumen": must be a table'),
    (None, {"parts": {"stent": "inner", "valve": "inner"}}, "geometry.parts.valve: must be either one of the walls"),
    (None, {"parts": {"stent": "outside"}}, r"geometry.parts.stent: must be .*; not so at \(.*\) mm"),
    (None, {"parts": {"stent": "iner"}}, 'geometry.parts.stent = "iner": no such boundary.*did you mean "inner"'),
    # files, units, points
    (None, {"file": "vesel.msh"}, r'geometry.file = "vesel.msh": no such file in .*did you mean "vessel.msh"'),
    (None, {"file": None}, "geometry.file: missing; mesh file that meshio reads"),
    (None, {"file": 3}, "geometry.file = 3: accepted: text in quotes"),
    (None, {"unit": "kg"}, 'geometry.unit = "kg": "kg" has the wrong dimension; accepted: a unit of length'),
    (None, {"unit": "mn"}, 'geometry.unit = "mn": .*; accepted: a unit of length'),
    (None, {"unit": "furlog"}, 'geometry.unit = "furlog": "furlog" is not a known unit'),
    (None, {"tip": {"x": 0.0, "y": "1 mm"}}, r"geometry.tip = \(0, 0.001\) m: must lie in a solid; the solids lie in x "
     "from .* m, y from"),
    (None, {"tip": {"x": 0.0}}, "geometry.tip.y: missing; y, m"),
    (None, {"probes": {"top": {"x": 0.0, "y": 0.0}}}, r"geometry.probes.top = \(0, 0\) m: must lie in a solid"),
    (None, {"probes": {"tip": {"x": 0.0, "y": 0.0}}}, "geometry.probes.tip: this name is taken"),
]  # fmt: skip


def refused(capsys: pytest.CaptureFixture[str], folder: Path, table: dict[str, Any]) -> str:
    """Return what the command line says about the scene: exit code 2, nothing written, nothing but the message."""
    scene = folder / "scene.toml"
    scene.write_text(tomli_w.dumps(table))
    before = sorted(folder.rglob("*"))
    with pytest.raises(SystemExit) as stopped:
        main(["run", str(scene), "--out", str(folder / "out")])
    out, error = capsys.readouterr()
    assert stopped.value.code == 2 and out == ""
    assert sorted(folder.rglob("*")) == before
    for jargon in ("pydantic", "Value error", "Traceback", "meshio._"):
        assert jargon not in error
    return error


def drop(table: dict[str, Any]) -> dict[str, Any]:
    return {key: drop(v) if isinstance(v, dict) else v for key, v in table.items() if v is not None}


@pytest.mark.parametrize(("change", "geometry", "message"), BROKEN, ids=[row[2][:60] for row in BROKEN])
def test_refused(change, geometry, message, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    drawing = vessel()
    if change is not None:
        change(drawing)
    drawing.write(tmp_path / "vessel.msh")
    error = refused(capsys, tmp_path, drop(scene_table(**geometry)))
    assert re.search(message, error.strip()), error
    assert len(error.strip().splitlines()) == 1


def test_all_messages_differ() -> None:
    assert len({row[2] for row in BROKEN}) == len(BROKEN)


@pytest.mark.parametrize(("cells", "message"), [
    ([("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2]])], "it has 1 quadrilateral (in Gmsh: no Recombine)"),
    ([("triangle6", [[0, 1, 2, 3, 4, 5]])], "elements of higher order are not accepted (in Gmsh: Mesh.ElementOrder"),
    ([("tetra", [[0, 1, 2, 3]])], 'only plane triangles are accepted; it has 1 element of the type "tetra"'),
    ([("line", [[0, 1]])], "the file holds no triangle"),
])  # fmt: skip
def test_other_elements(cells, message, tmp_path, capsys) -> None:
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 2, 0)], dtype=float)
    meshio.Mesh(points, cells).write(tmp_path / "other.vtu")
    assert message in refused(capsys, tmp_path, scene_table("other.vtu"))


GMSH = (
    b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n5 0 1 0\n$EndNodes\n"
    b"$Elements\n1\n1 2 2 1 1 %s\n$EndElements\n"
)


@pytest.mark.parametrize(("name", "content", "message"), [
    ("a.msh", b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0",
     "damaged: the section $Nodes, which " "begins at line 4, has no end: the file is cut"),
    ("a.msh", b"\x00\x01\x02", "meshio cannot read it"),
    ("a.msh", b"", "the file is empty"),
    ("a.msh", b"\n", "the file holds no elements"),
    ("a.msh", GMSH % b"1 2 99999",
     "a triangle has the node 99999, which the file does not hold (number 1 of " "its triangles)"),
    ("a.msh", GMSH % b"1 2 4", "a triangle has the node 4, which the file does not hold"),
    ("a.inp", b"*NODE\n1,0,0\n*ELEMENT, TYPE=CPS3\n1,1,2,77\n", "a triangle or a line has the node 2, which"),
    ("a.vtu", b"<VTKFile", "meshio cannot read it"),
    ("a.doc", b"some text", "meshio cannot read it"),
])  # fmt: skip
def test_unreadable(name, content, message, tmp_path, capsys) -> None:
    (tmp_path / name).write_bytes(content)
    error = refused(capsys, tmp_path, scene_table(name))
    assert f'geometry.file = "{name}": {message}' in error


@pytest.mark.parametrize("name", ["meshes", "", "a\0b", "x" * 5000])
def test_no_file(name, tmp_path, capsys) -> None:
    (tmp_path / "meshes").mkdir()
    error = refused(capsys, tmp_path, scene_table(name))
    expected = {"a\0b": "no such file in"}.get(name, "this is a folder; accepted: a file that meshio reads")
    assert ("cannot be read: File name too long" if len(name) > 255 else expected) in error


def test_several_arrays_of_numbers(tmp_path, capsys) -> None:
    drawing = vessel()
    mesh = meshio.Mesh(drawing.points, [("triangle", drawing.triangles), ("line", drawing.lines)])
    mesh.cell_data = {name: [drawing.region, drawing.curve] for name in ("colour", "group")}
    mesh.write(tmp_path / "vessel.vtu")
    error = refused(capsys, tmp_path, scene_table("vessel.vtu"))
    assert 'several cell data hold whole numbers: "colour", "group"; accepted: one of them' in error


@pytest.mark.parametrize(("key", "value", "message"), [
    ("mesh", {"body_size": 0.1}, 'mesh.body_size = 0.1: not accepted with the geometry "mesh"'),
    ("mesh", {"size_factor": 2}, 'mesh.size_factor = 2: not accepted with the geometry "mesh"'),
    ("mesh", {"root_size": 0.1}, "mesh.root_size = 0.1 m: only accepted with"),
    ("solid", None, 'solid.wall: missing; the region "wall" of the mesh needs a material'),
    ("fluid", None, 'fluid: missing; the mesh has a region "fluid"'),
    ("support", {"stiffness": 1}, "support: not accepted: no wall with an outer side"),
    ("traction", {"x": 1}, 'traction: not accepted: the geometry "mesh" has no loaded boundary'),
])  # fmt: skip
def test_tables_that_do_not_fit(key, value, message, tmp_path, capsys) -> None:
    vessel().write(tmp_path / "vessel.msh")
    assert message in refused(capsys, tmp_path, drop(scene_table() | {key: value}))


def test_supports_and_fluids_without_a_place(tmp_path, capsys) -> None:
    vessel().write(tmp_path / "vessel.msh")
    held = boundaries(clamped=None, supported="outside")
    error = refused(capsys, tmp_path, drop(scene_table(**held)))
    assert "support: missing; elastic support of the outer sides" in error
    error = refused(
        capsys, tmp_path, drop(scene_table(**held) | {"support": {"damping": 1}})
    )  # stiffness 0 holds nothing
    assert 'nothing holds the solid "wall"' in error
    drawing = vessel()
    drawing.triangles, drawing.region = drawing.triangles[drawing.region == WALL_REGION], drawing.region[:12] * 0 + 2
    drawing.lines, drawing.curve = drawing.lines[drawing.curve >= 14], drawing.curve[drawing.curve >= 14]
    drawing.write(tmp_path / "vessel.msh")
    only_wall = {"regions": {"wall": "wall"}, "boundaries": {"clamped": "ends"}}
    assert 'fluid: not accepted: geometry.regions has no "fluid"' in refused(capsys, tmp_path, scene_table(**only_wall))
    wet = {"regions": {"wall": "wall"}}
    error = refused(capsys, tmp_path, scene_table(**wet))
    assert 'geometry.boundaries.inlet: only accepted where geometry.regions has a "fluid"' in error


def test_problems_come_back_as_a_scene_error(tmp_path) -> None:
    vessel().write(tmp_path / "vessel.msh")
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(scene_table(**boundaries(inlet="inn", outlet="oot"))))
    with pytest.raises(SceneError) as caught:
        load_scene(tmp_path / "scene.toml")
    assert [(problem.key, problem.nearest) for problem in caught.value.problems] == [
        ("geometry.boundaries.inlet", "in"), ("geometry.boundaries.outlet", "out"),
    ]  # fmt: skip
