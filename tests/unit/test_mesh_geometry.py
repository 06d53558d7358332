"""A mesh of the user's own: formats, regions and labels, what the run folder gets, and the script."""

import itertools
import re
from pathlib import Path

import meshio
import numpy as np
import pytest
import tomli_w
from vessel_meshes import CURVES, INNER, LUMEN, OUTER, TURN, scene_table, vessel, write_scene

from ffsi.cli.main import main
from ffsi.result.study_definition import define
from ffsi.scene import MeshGeometry, Scene, SceneError, boundaries, load_scene, stored
from ffsi.scene.geometry.mesh import STORED, TAKEN
from ffsi.scene.meshes.topology import Topology, refuse_overlaps
from ffsi.script.render import parameters, render

NUMBERS = {
    "regions": {"fluid": 1, "wall": 2},
    "boundaries": {"inlet": 11, "outlet": 12, "walls": 13, "clamped": 14, "free": 15},
}

scene = pytest.fixture(lambda tmp_path: load_scene(write_scene(tmp_path)))


def of_table(folder: Path, **geometry: object) -> Scene:
    (folder / "other.toml").write_text(tomli_w.dumps(scene_table(**geometry)))
    return load_scene(folder / "other.toml")


def polygon(radius: float, pieces: int) -> float:
    """Length of a polygon in the vessel's bend, m."""
    return 1e-3 * 2 * radius * pieces * np.sin(TURN / pieces / 2)


def area(inner: float, outer: float, pieces: int) -> float:
    return 1e-6 * pieces * np.sin(TURN / pieces) * (outer**2 - inner**2) / 2


def test_roles_lengths_areas_inlet_and_tip(scene) -> None:
    found = {b.label: (b.role, b.part, pytest.approx(b.exact_length, rel=1e-12)) for b in boundaries(scene)}
    assert found == {
        1: ("inlet", None, 1e-3 * (LUMEN - INNER)), 2: ("outlet", None, 1e-3 * (LUMEN - INNER)),
        3: ("no-slip", None, polygon(INNER, 6)), 6: ("clamped", None, 2e-3 * (OUTER - LUMEN)),
        7: ("free", None, polygon(OUTER, 6)), 40: ("interface", "wall", polygon(LUMEN, 6)),
    }  # fmt: skip
    assert scene.exact_areas() == pytest.approx({"fluid": area(INNER, LUMEN, 6), "wall": area(LUMEN, OUTER, 6)})
    assert scene.physics == "fsi" and scene.mesh.level == 0 and scene.forces.reference_length == pytest.approx(3e-3)
    inlet = scene.geometry.inlet
    inward, along = np.array((-np.sin(0.3), np.cos(0.3))), np.array((-np.cos(0.3), -np.sin(0.3)))
    np.testing.assert_allclose(inlet.inward, inward, atol=1e-12)
    np.testing.assert_allclose(along, (-inward[1], inward[0]), atol=1e-15)
    np.testing.assert_allclose(inlet.start, 1e-3 * LUMEN * -along, atol=1e-14)
    assert inlet.height == pytest.approx(3e-3)
    middle = 0.3 + TURN / 2
    assert np.hypot(*scene.tip) == pytest.approx(1e-3 * OUTER) and np.arctan2(*scene.tip[::-1]) == pytest.approx(middle)
    assert Scene.from_toml(scene.to_toml()).tip == scene.tip


def test_tip_and_probes_of_the_scene(tmp_path) -> None:
    write_scene(tmp_path)
    x, y = 13.5 * np.cos(0.6), 13.5 * np.sin(0.6)
    point = {"x": f"{x:.6f} mm", "y": f"{y:.6f} mm"}
    scene = of_table(tmp_path, tip=point, probes={"middle": point})
    assert scene.tip == scene.probes["middle"] == pytest.approx((1e-3 * x, 1e-3 * y), abs=1e-8)
    script = render(scene)
    assert 'probeName = ["middle"]' in script
    assert "probeX = [geometryProbesMiddleX], probeY = [geometryProbesMiddleY]" in script
    assert {"geometry_tip_x", "geometry_probes_middle_y"} < {parameter.flag for parameter in parameters(scene)}


FORMATS = [
    ("gmsh22", "vessel.msh", "gmsh:physical", {}), ("medit", "vessel.mesh", "medit:ref", NUMBERS),
    ("vtu", "vessel.vtu", "group", NUMBERS), ("vtk", "vessel.vtk", "group", NUMBERS),
    ("vtu", "vessel.vtu", "gmsh:physical", NUMBERS),
]  # fmt: skip


@pytest.mark.parametrize(("form", "name", "data", "names"), FORMATS, ids=[f"{row[0]}-{row[2]}" for row in FORMATS])
def test_formats(form, name, data, names, scene, tmp_path) -> None:
    vessel().write(tmp_path / name, form, data)
    assert of_table(tmp_path, file=name, **names).geometry == scene.geometry


def test_what_freefem_saves(tmp_path) -> None:
    """Its .mesh says single precision and has a section that meshio does not know, its .msh is its own format."""
    drawing = vessel()
    vessel().write(tmp_path / "vessel.mesh", "medit", "medit:ref")
    text = (tmp_path / "vessel.mesh").read_text().replace("MeshVersionFormatted 2", "MeshVersionFormatted 1")
    (tmp_path / "saved.mesh").write_text(text.replace("End", "SubDomainFromGeom\n2\n2 2 1 0\n2 9 1 1\n\nEnd"))
    rows = [drawing.points, drawing.triangles + 1, drawing.lines + 1]
    lines = [f"{len(rows[0])} {len(rows[1])} {len(rows[2])}"]
    for values, tags in zip(rows, ([0] * len(rows[0]), drawing.region, drawing.curve), strict=True):
        lines += [f"{' '.join(map(repr, line.tolist()))} {tag}" for line, tag in zip(values, tags, strict=True)]
    (tmp_path / "saved.msh").write_text("\n".join(lines) + "\n")
    found = [of_table(tmp_path, file=name, **NUMBERS) for name in ("vessel.mesh", "saved.mesh", "saved.msh")]
    assert found[0].geometry == found[1].geometry == found[2].geometry
    (tmp_path / "cut.msh").write_text("\n".join(lines[:30]) + "\n")
    with pytest.raises(SceneError, match="29 lines follow"):
        of_table(tmp_path, file="cut.msh", **NUMBERS)


def test_named_sets(tmp_path) -> None:
    """Formats without numbers have sets of elements (Abaqus)."""
    drawing = vessel()
    lines = ["*NODE", *(f"{i}, {x}, {y}, 0." for i, (x, y) in enumerate(drawing.points, start=1))]
    number = itertools.count(1)
    for kind, elements, tags, names in (
        ("CPS3", drawing.triangles, drawing.region, {1: "lumen", 2: "wall"}),
        ("T2D2", drawing.lines, drawing.curve, {tag: name for name, tag in CURVES.items()}),
    ):
        for tag, name in names.items():
            lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
            lines += [f"{next(number)}, {', '.join(map(str, nodes + 1))}" for nodes in elements[tags == tag]]
    (tmp_path / "vessel.inp").write_text("\n".join(lines) + "\n")
    scene = of_table(tmp_path, file="vessel.inp")
    vessel().write(tmp_path / "vessel.msh")
    assert boundaries(scene) == boundaries(of_table(tmp_path))
    assert scene.exact_areas() == pytest.approx(of_table(tmp_path).exact_areas())


def test_numbers_units_and_names_of_a_mesh(scene, tmp_path) -> None:
    assert of_table(tmp_path, **NUMBERS).geometry == scene.geometry
    text = {key: {name: str(number) for name, number in table.items()} for key, table in NUMBERS.items()}
    assert of_table(tmp_path, **text).geometry == scene.geometry
    drawing = vessel()
    drawing.points = drawing.points / 10
    drawing.write(tmp_path / "vessel.msh")
    assert of_table(tmp_path, unit="cm").exact_areas() == pytest.approx(scene.exact_areas())
    assert of_table(tmp_path, unit=None).exact_areas()["wall"] == pytest.approx(1e4 * scene.exact_areas()["wall"])


def test_equal_names_of_a_region_and_a_boundary(scene, tmp_path) -> None:
    drawing = vessel()
    drawing.names = {
        "wall" if name == "inner" else name: value for name, value in drawing.names.items() if name != "wall"
    }
    drawing.write(tmp_path / "vessel.msh")
    text = (tmp_path / "vessel.msh").read_bytes().replace(b"$PhysicalNames\n7\n", b'$PhysicalNames\n8\n2 2 "wall"\n')
    (tmp_path / "vessel.msh").write_bytes(text)
    table = {**scene_table()["geometry"]["boundaries"], "walls": "wall"}
    assert of_table(tmp_path, boundaries=table).geometry == scene.geometry


def test_order_of_nodes_unused_nodes_and_a_third_column_do_not_matter(scene, tmp_path) -> None:
    drawing = vessel()
    drawing.triangles = drawing.triangles[:, ::-1].copy()
    drawing.triangles[:12] = drawing.triangles[:12, ::-1]  # another surface of the same regions
    drawing.triangles += 1
    drawing.lines = drawing.lines[:, ::-1] + 1
    points = np.column_stack([drawing.points, np.full(len(drawing.points), 2.0)])
    drawing.points = np.vstack([[99.0, 99.0, 99.0], points])
    drawing.write(tmp_path / "vessel.msh")
    other = of_table(tmp_path)
    assert boundaries(other) == boundaries(scene) and other.exact_areas() == pytest.approx(scene.exact_areas())


def test_another_mesh_is_another_scene(scene, tmp_path) -> None:
    assert load_scene(tmp_path / "scene.toml") == scene
    drawing = vessel()
    drawing.points[7] += 0.01
    drawing.write(tmp_path / "vessel.msh")
    assert load_scene(tmp_path / "scene.toml") != scene


def written(scene: Scene, run: Path) -> Path:
    run.mkdir()
    (run / "scene.toml").write_text(stored(scene, run).to_toml())
    return run / "scene.toml"


@pytest.mark.parametrize("parts", [{}, {"stent": "inner"}])
def test_the_run_folder_holds_all(parts, tmp_path, monkeypatch) -> None:
    write_scene(tmp_path)
    scene = of_table(tmp_path, parts=parts, curved=list(parts) or ["walls"])
    assert [b.name for b in boundaries(scene) if b.curved] == [*(parts or ["walls"])] and scene != of_table(tmp_path)
    path = written(scene, run := tmp_path / "run")
    for each in tmp_path.glob("*.*"):
        each.unlink()
    monkeypatch.chdir(run.parent)
    again = load_scene(path)
    assert again == scene and again.geometry.file == str(run / STORED)
    assert stored(again, run).to_toml() == path.read_text() and render(again) == render(scene)
    for array in ("vertices", "triangles", "region", "edges", "label"):
        np.testing.assert_array_equal(getattr(again.geometry._mesh, array), getattr(scene.geometry._mesh, array))


def test_parts(tmp_path) -> None:
    write_scene(tmp_path)
    scene = of_table(tmp_path, parts={"core": "inner"})
    found = {b.label: (b.name, b.role, b.part) for b in boundaries(scene)}
    assert found[40] == ("core", "no-slip", "core") and found[5] == ("interface", "interface", None) and 3 not in found
    both = of_table(tmp_path, parts={"core": "inner", "skin": "interface"})
    assert [(b.label, b.part) for b in boundaries(both) if b.part] == [(40, "core"), (41, "skin")]


KINKED = r"turns by (\d\d) degrees: neither a smooth curve nor a corner; .* in geometry.parts"


@pytest.mark.parametrize(
    ("curved", "shift", "text"),
    [("waals", 0.0, r'no such wall; accepted: rigid ones by their names, "walls".*did you mean "walls"'),
     (["walls", "wall"], 0.0, "no such wall"), ("wall", 0.0, "no such wall"), ("walls", 0.2, KINKED),
     ("walls", -0.9, KINKED), ("walls", 1.2j, r"where it turns, an edge is 5\.. times as long as the next one"),
     ("walls", None, "is straight"), (3, 0.0, "no such wall"), ([], 0.0, "accepted: the name of a wall")],
)  # fmt: skip
def test_no_curve(curved, shift, text, tmp_path) -> None:
    drawing = vessel()
    if shift is None:
        drawing.points[::5] = np.linspace(drawing.points[0], drawing.points[30], 7)  # the inner wall
    else:
        drawing.points[15:16] = (drawing.points[15:16] @ [[1], [1j]] * np.exp(shift / 10)).view(float)  # in its middle
    write_scene(tmp_path, drawing=drawing)
    with pytest.raises(SceneError, match=text):
        of_table(tmp_path, curved=curved)


ALONE = {  # region, its boundaries, physics, labels and roles
    "fluid": ("lumen", {"inlet": 11, "outlet": 12, "walls": ["inner", "interface"]},
        [(1, "inlet"), (2, "outlet"), (40, "no-slip")]),
    "solid": ("wall", {"clamped": "ends", "loaded": "outside"}, [(6, "clamped"), (7, "free"), (12, "loaded")]),
}  # fmt: skip


@pytest.mark.parametrize("physics", ALONE)
def test_rigid_vessel_and_wall_under_a_load(physics, tmp_path) -> None:
    region, outline, found = ALONE[physics]
    drawing = vessel()
    keep = drawing.region == drawing.names[region][0]
    drawing.triangles, drawing.region = drawing.triangles[keep], drawing.region[keep]
    keep = np.isin(drawing.lines, drawing.triangles).all(axis=1)
    drawing.lines, drawing.curve = drawing.lines[keep], drawing.curve[keep]
    table = scene_table(regions={"fluid" if physics == "fluid" else "wall": region}, boundaries=outline)
    for key in ("solid",) if physics == "fluid" else ("fluid", "inflow", "outlet"):
        del table[key]
    scene = load_scene(write_scene(tmp_path, table | ({"traction": {"x": 5}} if physics == "solid" else {}), drawing))
    assert scene.physics == physics and [(b.label, b.role) for b in boundaries(scene)] == found


def test_a_support_holds_the_wall(tmp_path) -> None:
    outline = {"inlet": "in", "outlet": "out", "walls": "inner", "supported": "outside"}
    scene = load_scene(write_scene(tmp_path, scene_table(boundaries=outline) | {"support": {"stiffness": "1 MPa/m"}}))
    assert [(b.label, b.role) for b in boundaries(scene) if b.label in (7, 16)] == [(7, "free"), (16, "supported")]
    assert load_scene(written(scene, tmp_path / "run")) == scene


def test_levels(scene, tmp_path) -> None:
    assert load_scene(tmp_path / "scene.toml", ["mesh.level=2"]).mesh.level == 2
    flags = {parameter.flag for parameter in parameters(scene)}
    assert ("mesh_size_factor" in flags, "mesh_level" in flags) == (False, True)


def spiral(gap: float, along: int, across: int = 3) -> Topology:
    """Return a band of width 1/2 that winds around twice and leaves a gap to itself."""
    angle, over = np.repeat(np.linspace(0, 13, along + 1), across + 1), np.tile(np.arange(across + 1), along + 1)
    radius = 1 + (0.5 + gap) * angle / (2 * np.pi) + 0.5 * over / across
    start = (np.arange(along)[:, None] * (across + 1) + np.arange(across)).ravel()
    corners = start[:, None] + np.array([[0, 1, across + 2], [0, across + 2, across + 1]])[:, None]
    return Topology(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), corners.reshape(-1, 3), "mm")


@pytest.mark.parametrize(("gap", "along", "across"), [(0.1, 100, 3), (1e-3, 2000, 3), (0.1, 60, 400), (0.1, 9000, 1)])
def test_no_overlap(gap, along, across) -> None:
    """Narrow gaps between curved sides, and triangles a hundred times as long as high."""
    refuse_overlaps(spiral(gap, along, across), ["band"] * (2 * along * across))


@pytest.mark.parametrize(("gap", "along"), [(-1e-3, 2000), (-0.2, 100), (-0.5, 100)])
def test_overlap(gap, along) -> None:
    with pytest.raises(SceneError, match=r"two triangles overlap at \(.*\) mm"):
        refuse_overlaps(spiral(gap, along), ["band"] * (6 * along))


def words(script: str) -> set[str]:
    """Return all identifiers of a script, and the names of the quantities that it writes for pp, rr, qq and zz."""
    code = re.sub(r"//.*", "", script.replace('"\\""', ""))
    formulas = re.findall(r'JsonReal\(file, ([^,]*"\w+"[^,]*),', code)
    variables = [
        {"ending": ending, "name": name, "probeName": ["qq"], "i": 0}
        for ending in ("", "_pp", "_rr")
        for name in ("zz", "fluid")
    ]
    quantities = {eval(formula, {}, values) for formula in formulas for values in variables}
    return quantities | set(re.findall(r"[A-Za-z][A-Za-z0-9]*", re.sub(r'"[^"]*"', "", code)))


def names_in(found: set[str], mark: str) -> set[str]:
    """Return the names that would make one of the other words if they stood where the name `mark` stands."""
    others = [word for word in found if mark not in word.lower()]
    names = set()
    for word in found:
        pattern = word.replace(mark, "([a-z][a-z0-9]*)").replace(mark.capitalize(), "([A-Z][a-z0-9]*)")
        matches = (re.fullmatch(pattern, other) for other in others if pattern != word)
        names |= {match.group(1).lower() for match in matches if match}
    return names


@pytest.mark.parametrize("timed", [False, True])
def test_no_name_of_a_solid_makes_an_identifier_twice(timed, tmp_path) -> None:
    """What a solid called "zz" adds to the script shows which names would collide with the rest of it."""
    write_scene(tmp_path)
    table = scene_table(
        regions={"fluid": "lumen", "zz": "wall"},
        parts={"pp": "inner", "rr": "interface"},
        curved="pp",
        probes={"qq": {"x": "12 mm", "y": "6 mm"}},
    )
    (solid,) = table["solid"].values()
    table["solid"] = {"zz": {**solid, "formulation": "mixed"}}
    if timed:
        table["time"] = {"step": 0.1, "end": 1}
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(table))
    found = words(render(load_scene(tmp_path / "scene.toml")))
    taken = names_in(found, "zz") | names_in(found, "qq") | names_in(found, "pp") - {"rr"}
    assert {"fluid", "tip", "surface"} <= taken
    assert taken <= set(TAKEN), sorted(taken - set(TAKEN))


def test_scripts_and_sweeps_know_their_mesh(scene, tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "flow.edp")])
    assert not stopped.value.code and 'string meshFile = "flow.mesh";' in (tmp_path / "flow.edp").read_text()
    assert len(meshio.read(tmp_path / "flow.mesh").points) == len(vessel().points)
    with pytest.raises(SystemExit) as stopped:
        main(["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / 'a"b.edp')])
    assert stopped.value.code == 2 and "needs a name of letters" in capsys.readouterr().err
    assert not (tmp_path / 'a"b.edp').exists()
    for name in ("vessel.msh", "scene.toml", "own.edp"):  # nothing of the user's is replaced
        (tmp_path / "own.mesh").write_text("mine")
        before = {path: path.read_bytes() for path in tmp_path.iterdir()}
        with pytest.raises(SystemExit) as stopped:
            main(["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / name)])
        assert stopped.value.code == 2 and " is there, and no " in capsys.readouterr().err
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    with pytest.raises(SystemExit) as stopped:
        main(["render", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "flow.edp")])  # ours is
    assert not stopped.value.code
    vary = {"design": "product", "vary": {"inflow.mean_velocity": [0.01, 0.02]}}
    assert define(scene, vary)["mesh"] == scene.geometry.digest and "mesh" not in define(load_scene("flap-svk"), vary)


def test_from_python(tmp_path, monkeypatch) -> None:
    write_scene(tmp_path)
    monkeypatch.chdir(tmp_path)
    geometry = MeshGeometry(**scene_table()["geometry"])
    assert geometry == load_scene(tmp_path / "scene.toml").geometry
    with pytest.raises(SceneError, match=r'regions\.fluid = "x": no such region'):
        MeshGeometry(**scene_table(regions={"fluid": "x"})["geometry"])
