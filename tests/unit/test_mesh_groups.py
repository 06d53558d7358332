"""Groups that share edges and triangles, or list them reversed: every edge and triangle keeps all its names."""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gmsh
import meshio
import numpy as np
import pytest
import tomli_w
from vessel_meshes import beam_scene, lengths

from ffsi.scene import Scene, SceneError
from ffsi.scene.meshes import reading

# A channel of 3 x 1 below a wall of 3 x 0.25: groups of curves and of surfaces; "-" lists one reversed.
GROUPS = {
    "in": ["-in"], "out": ["-out"], "wall": ["floor"],  # also the name of a region
    "fixed": ["left", "-right"], "right": ["right"], "push": ["top", "-right"], "outer": ["left", "right", "top"],
    "left": ["left"], "top": ["top"], "ends": ["in", "-left", "out", "right"],
}  # fmt: skip
REGIONS = {"lumen": ["lumen"], "wall": ["wall"], "both": ["lumen", "-wall"]}
DEFAULT = {"inlet": "in", "outlet": "out", "walls": "wall", "clamped": "fixed"}


def draw(plane: str = "xy") -> None:
    gmsh.clear()
    geo = gmsh.model.geo
    place = {"xy": lambda x, y: (x, y, 0), "xz": lambda x, y: (x, 0, y), "yz": lambda x, y: (0, x, y)}[plane]
    at = {(x, y): geo.addPoint(*place(x, y), 0.5) for x in (0.0, 3.0) for y in (0.0, 1.0, 1.25)}
    ends = {
        "in": ((0, 1), (0, 0)), "out": ((3, 0), (3, 1)), "floor": ((0, 0), (3, 0)), "left": ((0, 1.25), (0, 1)),
        "right": ((3, 1), (3, 1.25)), "top": ((3, 1.25), (0, 1.25)), "interface": ((0, 1), (3, 1)),
    }  # fmt: skip
    line = {name: geo.addLine(at[a], at[b]) for name, (a, b) in ends.items()}
    loops = {
        "lumen": [line["in"], line["floor"], line["out"], -line["interface"]],
        "wall": [line["left"], line["interface"], line["right"], line["top"]],
    }
    surface = {name: geo.addPlaneSurface([geo.addCurveLoop(loop)]) for name, loop in loops.items()}
    geo.synchronize()
    for dimension, groups, tags in ((1, GROUPS, line), (2, REGIONS, surface)):
        for number, (name, members) in enumerate(groups.items(), start=1):
            signed = [-tags[m[1:]] if m.startswith("-") else tags[m] for m in members]
            gmsh.model.addPhysicalGroup(dimension, signed, number, name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Iterator[Path]:
    """Yield an empty folder while Gmsh is there."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield tmp_path_factory.mktemp("gmsh")
    gmsh.finalize()


def save(path: Path, before: Callable[[], object] = lambda: None, plane: str = "xy", **options: float) -> Path:
    """Mesh the drawing and write it with some of Gmsh's options of the kind "Mesh"."""
    gmsh.option.restoreDefaults()
    gmsh.option.setNumber("General.Terminal", 0)
    draw(plane)
    for name, value in options.items():
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.model.mesh.generate(2)
    before()
    gmsh.write(str(path))
    return path


def scene(file: Path, outline: dict[str, Any] = DEFAULT, **geometry: Any) -> Scene:
    table: dict[str, Any] = {
        "name": "groups",
        "geometry": {"kind": "mesh", "file": str(file), "regions": {"fluid": "lumen", "wall": "wall"},
            "boundaries": outline, **geometry},
        "fluid": {"density": 1, "viscosity": 1},
        "solid": {"wall": {"material": "neo-hookean", "density": 1, "young_modulus": 1e3, "poisson_ratio": 0.3}},
        "inflow": {"mean_velocity": 1}, "outlet": {"kind": "do-nothing"},
    }  # fmt: skip
    if "loaded" in outline:
        table["traction"] = {"y": 1}
    return Scene.from_toml(tomli_w.dumps(table))


def periodic() -> None:
    """Make a copy of the inlet's mesh the outlet's, which adds a section to the file."""
    (inlet, outlet) = (gmsh.model.getEntitiesForPhysicalName(name)[0][1] for name in ("in", "out"))
    gmsh.model.mesh.setPeriodic(1, [outlet], [inlet], [1, 0, 0, 3, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])


def unused_nodes() -> None:
    """Add a point and a node that no triangle uses."""
    point = gmsh.model.addDiscreteEntity(0)
    gmsh.model.mesh.addNodes(0, point, [5000], [7.0, 7.0, 9.0])
    gmsh.model.mesh.addElementsByType(point, 15, [5000], [5000])
    gmsh.model.addPhysicalGroup(0, [point], name="far away")


FILES: list[tuple[dict[str, Any], str]] = [
    *(
        ({"MshFileVersion": version, "Binary": binary, "SaveParametric": parametric}, "msh")
        for version, binary, parametric in itertools.product((4.1, 2.2), (0, 1), (0, 1))
    ),
    ({"SaveAll": 1, "MshFileVersion": 4.1}, "msh"),
    *(
        ({"before": change, "MshFileVersion": version, "Binary": binary}, "msh")
        for change, version, binary in itertools.product((periodic, unused_nodes), (4.1, 2.2), (0, 1))
    ),
    *(
        ({"before": lambda: gmsh.model.mesh.partition(3), "MshFileVersion": version, "Binary": binary,
          "PartitionCreateGhostCells": ghosts}, "msh")
        for version, binary, ghosts in itertools.product((4.1, 2.2), (0, 1), (0, 1))
    ),
    ({}, "msh2"),
    ({}, "msh4"),
]  # fmt: skip


@pytest.mark.parametrize(("options", "ending"), FILES, ids=[str(number) for number in range(len(FILES))])
def test_files_of_gmsh(options, ending, folder) -> None:
    file = save(folder / f"a.{ending}", **options)
    found = scene(file)
    assert lengths(found) == {"inlet": 1, "outlet": 1, "walls": 3, "clamped": 0.5, "free": 3, "wall": 3}
    assert found.exact_areas() == pytest.approx({"fluid": 3.0, "wall": 0.75}, rel=1e-10)


ROLES: list[tuple[dict[str, Any], dict[str, float]]] = [
    ({"clamped": "left", "loaded": "push"}, {"clamped": 0.25, "loaded": 3.25}),
    ({"clamped": "left", "loaded": ["right", "top"]}, {"clamped": 0.25, "loaded": 3.25}),
    ({"clamped": ["right", "fixed"]}, {"clamped": 0.5, "free": 3.0}),
    ({"clamped": "outer"}, {"clamped": 3.5}),
    ({"clamped": "fixed", "free": "top"}, {"clamped": 0.5, "free": 3.0}),
    ({"clamped": "right", "loaded": "left"}, {"clamped": 0.25, "loaded": 0.25, "free": 3.0}),
]


def test_an_edge_has_the_role_that_any_of_its_names_gives(folder) -> None:
    file = save(folder / "roles.msh")
    base = {key: DEFAULT[key] for key in ("inlet", "outlet", "walls")}
    fluid = {"inlet": 1, "outlet": 1, "walls": 3, "wall": 3}
    for outline, expected in ROLES:
        assert lengths(scene(file, base | outline)) == fluid | expected, outline


CONTRADICTIONS = [
    ({"clamped": "fixed", "loaded": "push"}, r'boundaries.loaded = "push": shares edges with boundaries.clamped = '
     r'"fixed", the first at \(3, 1.\d+\) m; accepted: one role for each edge'),
    ({"clamped": "fixed", "free": "outer"}, 'boundaries.free = "outer": shares edges with boundaries.clamped = "fixe'),
    ({"clamped": "outer", "free": "right"}, 'boundaries.free = "right": shares edges with boundaries.clamped = "oute'),
    ({"clamped": "ends"}, r'boundaries.clamped = "ends": at \(0, .*\) m it is a boundary of the fluid'),
]  # fmt: skip


@pytest.mark.parametrize(("outline", "message"), CONTRADICTIONS)
@pytest.mark.parametrize("version", [4.1, 2.2])
def test_contradicting_roles(outline, message, version, folder) -> None:
    with pytest.raises(SceneError, match=message):
        scene(save(folder / "a.msh", MshFileVersion=version), DEFAULT | outline)


@pytest.mark.parametrize("version", [4.1, 2.2])
def test_regions_that_share_triangles(version, folder) -> None:
    file = save(folder / "a.msh", MshFileVersion=version)
    outline = {"inlet": "in", "outlet": "out", "walls": "wall"}
    with pytest.raises(SceneError, match=r'regions.wall = "wall": shares \d+ triangles with regions.fluid = "both", t'):
        scene(file, outline, regions={"fluid": "both", "wall": "wall"})
    twice = scene(file, regions={"fluid": ["lumen", "lumen"], "wall": ["wall", 2]})
    assert twice.exact_areas() == pytest.approx({"fluid": 3.0, "wall": 0.75})


def save_part(path: Path, version: float) -> Path:
    """Write a partitioned mesh as one file for each part; return the first."""
    whole = path.with_name("parts.msh")
    before = lambda: gmsh.model.mesh.partition(2)  # noqa: E731
    save(whole, before=before, PartitionSplitMeshFiles=1, MshFileVersion=version)
    return whole.with_name("parts_1.msh")


REFUSED: list[tuple[Callable[[Path], Path], str]] = [
    (lambda path: save(path, MshFileVersion=1), r"this is version 1 of Gmsh's format; accepted: versions 4.1 and 2.2 "
     r"\(in Gmsh: Mesh.MshFileVersion = 4.1\)"),
    (lambda path: save(path, MshFileVersion=4.0), "this is version 4 of Gmsh's format; accepted: versions 4.1 and 2.2"),
    (lambda path: save(path, ElementOrder=2), r"not accepted \(in Gmsh: Mesh.ElementOrder = 1\); it has 18 "),
    (lambda path: save(path, ElementOrder=2, MshFileVersion=2.2), 'ElementOrder = 1.*; it has .* of the type "line3"'),
    (lambda path: save(path, ElementOrder=3, Binary=1), "Mesh.ElementOrder = 1"),
    (lambda path: save(path, ElementOrder=7), r"in the section \$Elements: elements of the type"),
    (lambda path: save(path, before=gmsh.model.mesh.recombine),
     r"only triangles are accepted; it has \d+ quadrilaterals \(in Gmsh: no Recombine\)"),
    (lambda path: save_part(path, 4.1), r"part of a partitioned mesh \(in Gmsh: Mesh.PartitionSplitMeshFiles = 0\)"),
    (lambda path: save_part(path, 2.2), "the file holds one part of a partitioned mesh"),
    (lambda path: save(path, plane="xz"), r"must lie in a plane z = constant; z goes from 0 to 1.25, y is 0 everywhere "
     r"\(in Gmsh: Rotate \{\{1, 0, 0\}, \{0, 0, 0\}, -Pi/2\} \{ Surface\{:\}; \}\)"),
    (lambda path: save(path, plane="yz", MshFileVersion=2.2), r"x is 0 everywhere \(in Gmsh: Rotate \{\{0, 1, 0\}"),
    (lambda path: save(path, SaveAll=1, MshFileVersion=2.2), r"nothing belongs to it; the mesh names no regions \(in "
     r"Gmsh: physical groups, and Mesh.SaveAll = 0\)"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[row[1][:40] for row in REFUSED])
def test_refused_with_what_to_do(make, message, folder) -> None:
    with pytest.raises(SceneError, match=message):
        scene(make(folder / "b.msh"))


@pytest.mark.parametrize(("axis", "angle"), [((1, 0, 0), -np.pi / 2), ((0, 1, 0), np.pi / 2)])
def test_what_the_message_says_helps(axis, angle, folder) -> None:
    """The rotation of the message lays the mesh into the plane."""

    def turn() -> None:
        cosine, sine, (x, y, _) = np.cos(angle), np.sin(angle), axis
        rows = [(1, 0, 0, 0), (0, cosine, -sine, 0)], [(cosine, 0, sine, 0), (0, 1, 0, 0)]
        last = (0, sine, cosine, 0) if x else (-sine, 0, cosine, 0)
        gmsh.model.mesh.affineTransform(np.ravel([*rows[y], last]))

    found = scene(save(folder / "c.msh", before=turn, plane="xz" if axis[0] else "yz"))
    assert found.exact_areas() == pytest.approx({"fluid": 3.0, "wall": 0.75}, rel=1e-9)


def test_names_that_two_groups_have(folder) -> None:
    """Two groups with one name are one; a name that is another group's number too is refused."""
    text = save(folder / "a.msh").read_text()
    (folder / "b.msh").write_text(text.replace('"right"', '"left"'))
    assert lengths(scene(folder / "b.msh", DEFAULT | {"clamped": "left"}))["clamped"] == 0.5
    (folder / "b.msh").write_text(text.replace('"right"', '"7"'))
    with pytest.raises(SceneError, match=r'clamped = "7": means two: a boundary with this name, .* the name "outer"'):
        scene(folder / "b.msh", DEFAULT | {"clamped": "7"})


@pytest.fixture
def beam(tmp_path) -> dict[str, Any]:
    """Points, triangles and the sides of a beam of 2 x 1: "a" is left, "b" is left and right, "c" the rest."""
    points = np.array([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)], dtype=float)
    triangles = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)])
    return {"points": points, "triangles": triangles, "left": [(3, 0)], "right": [(2, 5)]}


@pytest.mark.parametrize(("form", "data"), [("medit", "medit:ref"), ("vtu", "number"), ("vtk", "number")])
def test_an_edge_written_once_for_each_number(form, data, beam, tmp_path) -> None:
    lines = np.array(beam["left"] + beam["left"] + beam["right"])
    triangles = np.concatenate([beam["triangles"], beam["triangles"][2:, [1, 2, 0]]])
    cells = [("triangle", triangles), ("line", lines)]
    numbers = [np.array([1, 1, 1, 1, 3, 3]), np.array([7, 5, 5])]
    file = tmp_path / {"medit": "beam.mesh"}.get(form, f"beam.{form}")
    meshio.Mesh(beam["points"], cells, cell_data={data: numbers}).write(file, file_format=form)
    for clamped, length in ((7, 1.0), (5, 2.0), ([7, 5], 2.0)):
        found = beam_scene(file, clamped, 1)
        assert lengths(found) == {"clamped": length, "free": 6.0 - length} and found.exact_areas() == {"beam": 2.0}


def test_numbers_of_gmsh_in_another_format(beam, tmp_path) -> None:
    """A converted file keeps the sign of a group that lists its curve reversed."""
    cells = [("triangle", beam["triangles"]), ("line", np.array(beam["left"] + beam["right"]))]
    data = {"gmsh:physical": [np.array([1, 1, -1, -1]), np.array([5, -5])]}
    meshio.Mesh(beam["points"], cells, cell_data=data).write(tmp_path / "beam.vtu")
    assert lengths(beam_scene(tmp_path / "beam.vtu", 5, 1)) == {"clamped": 2.0, "free": 4.0}


def test_names_of_su2_and_families_of_med(beam, tmp_path, monkeypatch) -> None:
    text = "NDIME= 2\nNELEM= 4\n" + "".join(f"5 {a} {b} {c} {i}\n" for i, (a, b, c) in enumerate(beam["triangles"]))
    text += "NPOIN= 6\n" + "".join(f"{x} {y} {i}\n" for i, (x, y) in enumerate(beam["points"])) + "NMARK= 2\n"
    text += "MARKER_TAG= left\nMARKER_ELEMS= 1\n3 3 0\nMARKER_TAG= %s\nMARKER_ELEMS= 2\n3 3 0\n3 2 5\n"
    (tmp_path / "beam.su2").write_text(text % "fixed")
    assert lengths(beam_scene(tmp_path / "beam.su2", "fixed", 0))["clamped"] == 2.0
    assert lengths(beam_scene(tmp_path / "beam.su2", "left", 0))["clamped"] == 1.0
    (tmp_path / "same.su2").write_text(text % 1)  # the number that meshio gives to "left"
    with pytest.raises(SceneError, match='the markers "left" and "1" cannot be told apart'):
        beam_scene(tmp_path / "same.su2", "left", 0)
    # A family of MED is a set of names; what meshio makes of a file is all that h5py is needed for.
    mesh = meshio.Mesh(beam["points"], [("triangle", beam["triangles"]), ("line", beam["left"] + beam["right"])])
    mesh.cell_data["cell_tags"] = [np.full(4, -1), np.array([-2, -3])]
    mesh.cell_tags = {-1: ["beam", "all"], -2: ["fixed", "left"], -3: ["fixed", "right"]}
    (tmp_path / "beam.med").write_bytes(b"x")
    monkeypatch.setattr(reading, "_read", lambda path: mesh)
    for name, length in (("fixed", 2.0), ("left", 1.0), ("right", 1.0)):
        assert lengths(beam_scene(tmp_path / "beam.med", name))["clamped"] == length


ABAQUS = """*NODE
1, 0, 0
2, 1, 0
3, 2, 0
4, 0, 1
5, 1, 1
6, 2, 1
*ELEMENT, TYPE=CPS3{}
1, 1, 2, 5
2, 1, 5, 4
3, 2, 3, 6
4, 2, 6, 5
*ELEMENT, TYPE=T2D2{}
5, 4, 1
6, 3, 6
*ELSET, ELSET=beam, GENERATE
1, 4, 1
*ELSET, ELSET=fixed
5, 6
*ELSET, ELSET=left
5
{}"""


@pytest.mark.parametrize(("parts", "message"), [
    (("", "", ""), None), ((", ELSET=s", ", ELSET=t", ""), None),
    (("", ", ELSET=t", ""), "line 13: elements in a set from the start beside others, which meshio does not keep"),
    (("", "", "*ELSET, ELSET=left\n6\n"), 'line 22: a second set "left"'),
    (("", "", "*ELSET, ELSET=more\nfixed\n"), "line 22: a set that is not a list of elements"),
    (("", "", "*NODE\n7, 9, 9\n"), "line 22: a second list of nodes"),
    (("", "", "*Include, input=other.inp\n"), "line 22: another file is included"),
    (("", "", "*ELEMENT, TYPE=T2D2\n7, 1, 2\n"), "line 22: elements after a set"),
])  # fmt: skip
def test_sets_of_abaqus(parts, message, tmp_path) -> None:
    (tmp_path / "beam.inp").write_text(ABAQUS.format(*parts))
    if message is None:
        assert lengths(beam_scene(tmp_path / "beam.inp", "fixed")) == {"clamped": 2.0, "free": 4.0}
        assert lengths(beam_scene(tmp_path / "beam.inp", "left")) == {"clamped": 1.0, "free": 5.0}
        return
    with pytest.raises(SceneError, match=message):
        beam_scene(tmp_path / "beam.inp", "left")


@pytest.mark.parametrize("version", [4.1, 2.2])
@pytest.mark.parametrize("binary", [0, 1])
def test_no_damage_does_harm(version, binary, folder, tmp_path) -> None:
    """Files that are cut or have other bytes somewhere are refused, or hold a mesh: nothing else comes out."""
    whole = save(folder / "a.msh", MshFileVersion=version, Binary=binary).read_bytes()
    random, refused = np.random.default_rng(1), 0
    for number in range(120):
        data = bytearray(whole)
        for at in random.integers(len(data), size=1 + number % 3):
            data[at] = random.integers(256)
        if number % 3 == 0:
            del data[random.integers(len(data)) :]
        (tmp_path / "a.msh").write_bytes(data)
        try:
            scene(tmp_path / "a.msh")
        except SceneError as error:
            refused += 1
            assert len(str(error)) < 2000
    assert refused > 60
