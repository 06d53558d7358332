"""Meshes from Gmsh and the README's scene for them, through the command line: steady, in time, in a sweep."""

import itertools
import json
import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pandas as pd
import pytest
import tomli_w

from ffsi.cli.main import main
from ffsi.files.arrays import read_mesh
from ffsi.hemodynamics.result import load_result
from ffsi.scene import boundaries, load_scene

INNER, LUMEN, OUTER = 6.0, 9.0, 9.6  # radii of a bent vessel in mm: rigid inner wall, interface, outside of the wall
START, TURN = math.radians(25), math.radians(70)


@pytest.fixture(scope="module")
def vessel(tmp_path_factory) -> Iterator[Path]:
    """Yield a folder with the mesh of the vessel in three formats of Gmsh, and its scene."""
    folder = tmp_path_factory.mktemp("vessel")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    draw()
    gmsh.model.mesh.generate(2)
    for name, version, binary in (("vessel", 4.1, 0), ("binary41", 4.1, 1), ("ascii22", 2.2, 0), ("binary22", 2.2, 1)):
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(folder / f"{name}.msh"))
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.write(str(folder / "all.msh"))
    gmsh.finalize()
    (folder / "scene.toml").write_text(tomli_w.dumps(scene()))
    yield folder


def draw() -> None:
    """Draw the vessel with the built-in kernel of Gmsh: a lumen and its outer wall, bent by 70 degrees."""
    geo = gmsh.model.geo
    centre = geo.addPoint(0, 0, 0)
    points = {
        (radius, angle): geo.addPoint(radius * math.cos(angle), radius * math.sin(angle), 0, size)
        for radius, size in ((INNER, 0.6), (LUMEN, 0.5), (OUTER, 0.5))
        for angle in (START, START + TURN)
    }
    arcs = {r: geo.addCircleArc(points[r, START], centre, points[r, START + TURN]) for r in (INNER, LUMEN, OUTER)}
    ends = {
        (r, s, angle): geo.addLine(points[r, angle], points[s, angle])
        for r, s in ((INNER, LUMEN), (LUMEN, OUTER))
        for angle in (START, START + TURN)
    }
    for tag, (r, s) in enumerate(((INNER, LUMEN), (LUMEN, OUTER)), start=1):
        loop = [ends[r, s, START], arcs[s], -ends[r, s, START + TURN], -arcs[r]]
        # The second one runs clockwise: Gmsh then turns its triangles too.
        geo.addPlaneSurface([geo.addCurveLoop(loop if tag == 1 else [-curve for curve in reversed(loop)])], tag)
    geo.synchronize()
    curves = {
        "inflow": [ends[INNER, LUMEN, START]],
        "outflow": [ends[INNER, LUMEN, START + TURN]],
        "inner curve": [arcs[INNER]],
        "ends": [ends[LUMEN, OUTER, angle] for angle in (START, START + TURN)],
        "wall": [arcs[OUTER]],  # the same name as a region
    }
    for name, tags in curves.items():
        gmsh.model.addPhysicalGroup(1, tags, name=name)
    for name, tag in (("lumen", 1), ("wall", 2)):
        gmsh.model.addPhysicalGroup(2, [tag], name=name)


def scene(**tables: dict[str, object]) -> dict[str, object]:
    """Return the scene that the README shows, with some tables changed."""
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    section = re.search(r"^## A mesh of your own\n(.*?)^## ", readme, re.DOTALL | re.MULTILINE).group(1)
    (block,) = re.findall(r"^```toml\n(.*?)^```$", section, re.DOTALL | re.MULTILINE)
    return tomllib.loads(block) | tables


def run(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(argument) for argument in arguments])
    return int(stopped.value.code or 0)


def largest_check(folder: Path) -> float:
    data = json.loads((folder / "result.json").read_text())
    assert data["status"] == "converged"
    return max(value for value in data["check"].values() if value is not None)


def test_all_files_of_gmsh_are_the_same_mesh(vessel) -> None:
    plain = load_scene(vessel / "scene.toml").geometry
    assert {b.label for b in boundaries(load_scene(vessel / "scene.toml"))} == {1, 2, 3, 6, 7, 40}
    for name in ("binary41", "ascii22", "binary22", "all"):  # "all" holds curves and points of no group
        assert load_scene(vessel / "scene.toml", [f"geometry.file={vessel / name}.msh"]).geometry == plain, name


def test_steady(vessel, tmp_path) -> None:
    out = tmp_path / "steady"
    assert run("run", vessel / "scene.toml", "--out", out) == 0 and largest_check(out) < 1e-8
    data = json.loads((out / "result.json").read_text())
    assert data["level"] == 0 and data["quantities"]["tip_uy"] > 1e-6
    # The vessel's wall moves outwards by the pressure in it.
    assert data["quantities"]["pressure_drop"] > 0
    # On the inner side of a bend the stress is larger than on the outer one, here that of the elastic wall.
    mean = 6 * 3.5e-3 * 0.05 / 3e-3
    assert 1.1 * mean > data["quantities"]["wss_mean_walls"] > data["quantities"]["wss_mean_wall"] > 0.8 * mean
    assert abs(data["quantities"]["mass_balance"]) < 1e-12
    assert set(pd.read_csv(out / "wall.csv")["part"]) == {"walls", "wall"}
    assert "wall_shear_stress" in meshio.read(out / "fields.vtu").point_data
    assert {"velocity.png", "pressure.png", "displacement.png", "fields.vtu"} <= {path.name for path in out.iterdir()}
    # The folder is all that is needed from here on.
    assert run("check", out) == 0 and load_scene(out / "scene.toml") == load_scene(vessel / "scene.toml")
    assert load_scene(out / "scene.toml").geometry.file == str(out / "geometry.mesh")


def test_levels(vessel, tmp_path) -> None:
    out = tmp_path / "fine"
    assert (
        run("run", vessel / "scene.toml", "--set", "mesh.level=1", "--set", "output.pictures=false", "--out", out) == 0
    )
    assert largest_check(out) < 1e-8
    coarse = len(load_scene(vessel / "scene.toml").geometry._mesh.triangles)
    assert json.loads((out / "result.json").read_text())["triangles"] == 4 * coarse


def test_in_time(vessel, tmp_path) -> None:
    table = scene(
        time={"step": "5 ms", "end": "25 ms", "output_interval": "10 ms"},
        inflow={"mean_velocity": "5 cm/s", "ramp": "20 ms"},
    )
    (vessel / "time.toml").write_text(tomli_w.dumps(table))
    out = tmp_path / "time"
    assert run("run", vessel / "time.toml", "--out", out) == 0 and largest_check(out) < 1e-8
    assert (out / "velocity.png").is_file()
    # As if killed: what defines the run is all in its folder.
    for name in ("result.json", "point-0001.json", "point-0001.bin"):
        (out / name).unlink()
    assert run("run", "--resume", out) == 0 and largest_check(out) < 1e-8


def test_sweep(vessel, tmp_path) -> None:
    out, vary = tmp_path / "sweep", "inflow.mean_velocity=0.02,0.04"
    assert run("sweep", vessel / "scene.toml", "--vary", vary, "--out", out) == 0
    rows = (out / "sweep.csv").read_text().splitlines()
    assert len(rows) == 3 and run("report", out, "-o", tmp_path / "report.html") == 0


def test_the_rendered_script_runs_alone(vessel, tmp_path, run_text, installation) -> None:
    assert run("render", vessel / "scene.toml", "-o", tmp_path / "vessel.edp") == 0
    folder, done = run_text((tmp_path / "vessel.edp").read_text(), mesh=tmp_path / "vessel.mesh")
    assert done.status == "converged" and (folder / "point-0001.bin").is_file()


def test_a_missing_mesh_ends_the_script(vessel, tmp_path, run_text) -> None:
    from ffsi.freefem import FreeFEMError

    assert run("render", vessel / "scene.toml", "-o", tmp_path / "vessel.edp") == 0
    with pytest.raises(FreeFEMError, match=r"cannot read the mesh nowhere\.mesh"):
        run_text((tmp_path / "vessel.edp").read_text(), mesh="nowhere.mesh")


@pytest.mark.parametrize("turn", [0.0, 200.0])
def test_the_mesh_of_a_case_gives_its_result(turn, solved, tmp_path) -> None:
    """The flap's own mesh as a file, also turned by some degrees: the same forces and displacements, turned."""
    settings = ("inflow.mean_velocity=0.03", "mesh_motion.kind=harmonic")
    case = solved("flap-neo-hookean", *settings)
    mesh, angle = read_mesh(case.directory / "mesh.bin"), math.radians(turn)
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    cells = [("triangle", mesh.triangles), ("line", mesh.edges)]
    data = {"medit:ref": [mesh.region, mesh.label]}
    meshio.Mesh(mesh.vertices @ rotation.T, cells, cell_data=data).write(tmp_path / "flap.mesh", file_format="medit")
    tables, tip = tomllib.loads(case.scene.to_toml()), rotation @ case.scene.tip
    tables["geometry"] = {
        "kind": "mesh", "file": "flap.mesh", "regions": {"fluid": 1, "flap": 2},
        "boundaries": {"inlet": 1, "outlet": 2, "walls": 3, "clamped": 6}, "tip": {"x": tip[0], "y": tip[1]},
    }  # fmt: skip
    del tables["mesh"]
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(tables))
    out = tmp_path / "run"
    assert run("run", tmp_path / "scene.toml", "--out", out) == 0 and largest_check(out) < 1e-8
    found, wanted = load_result(out).quantities, case.quantities
    for x, y in (("drag", "lift"), ("drag_surface", "lift_surface"), ("tip_ux", "tip_uy")):
        turned = rotation @ (wanted[x], wanted[y])
        np.testing.assert_allclose((found[x], found[y]), turned, rtol=0, atol=1e-8 * np.hypot(*turned))
    for name in ("min_jacobian_fluid", "min_jacobian_solid", "pressure_drop"):
        assert found[name] == pytest.approx(wanted[name], rel=1e-8), name


def beam(path: Path, curves: dict[str, str], noise: float = 0.0) -> None:
    """Write a beam of 4 x 1 in Gmsh's format 4.1; `curves` gives the numbers of the groups of left, top and right."""
    columns, rows = range(17), range(5)
    number = lambda i, j: 5 * i + j + 1  # noqa: E731
    sides = {
        "left": [(number(0, j), number(0, j + 1)) for j in rows[:-1]],
        "top": [(number(i, 4), number(i + 1, 4)) for i in columns[:-1]],
        "right": [(number(16, j), number(16, j + 1)) for j in rows[:-1]],
    }
    cells = [
        triangle
        for i in columns[:-1]
        for j in rows[:-1]
        for a, b, c, d in [(number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1))]
        for triangle in (((a, b, c), (a, c, d)) if (i + j) % 2 == 0 else ((a, b, d), (b, c, d)))
    ]
    entities = [f"{tag} 0 0 0 4 1 0 {len(curves[side].split())} {curves[side]} 0" for tag, side in enumerate(sides, 1)]
    blocks = [(1, tag, 1, sides[side]) for tag, side in enumerate(sides, 1)] + [(2, 1, 2, cells)]
    total = sum(len(block[-1]) for block in blocks)
    places = np.array([(i / 4, j / 4) for i in columns for j in rows])
    places += noise * np.random.default_rng(3).uniform(-1, 1, places.shape)
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", "4", '1 5 "fixed"', '1 7 "push"']
    lines += ['1 3 "right"', '2 1 "beam"', "$EndPhysicalNames", "$Entities", "0 3 1 0", *entities]
    lines += ["1 0 0 0 4 1 0 1 1 0", "$EndEntities", "$Nodes", "1 85 1 85", "2 1 0 85", *map(str, range(1, 86))]
    lines += [f"{x:.17g} {y:.17g} 0" for x, y in places] + ["$EndNodes", "$Elements", f"4 {total} 1 {total}"]
    count = itertools.count(1)
    for dimension, tag, kind, elements in blocks:
        lines.append(f"{dimension} {tag} {kind} {len(elements)}")
        lines += [f"{next(count)} {' '.join(map(str, nodes))}" for nodes in elements]
    path.write_text("\n".join([*lines, "$EndElements", ""]))


@pytest.mark.parametrize(("curves", "outline", "load", "tip", "shown"), [
    # One way to say it is as good as another: once for each side, reversed, in two groups. The numbers are those
    # of the sides in one group each.
    ({"left": "5", "top": "", "right": "5"}, {"clamped": "fixed"}, "gravity", -0.0129073, "clamped 2 m, free 8 m"),
    ({"left": "5", "top": "", "right": "-5"}, {"clamped": "fixed"}, "gravity", -0.0129073, "clamped 2 m, free 8 m"),
    ({"left": "5", "top": "7", "right": "3 7"}, {"clamped": "fixed", "loaded": "push"}, "traction", -0.220858,
     "clamped 1 m, free 4 m, loaded 5 m"),
    ({"left": "3 5", "top": "-7", "right": "-7 -3"}, {"clamped": "fixed", "loaded": "push"}, "traction", -0.220858,
     "clamped 1 m, free 4 m, loaded 5 m"),
])  # fmt: skip
def test_sides_in_two_groups_and_reversed(curves, outline, load, tip, shown, tmp_path, capsys) -> None:
    beam(tmp_path / "beam.msh", curves)
    solid = {"material": "neo-hookean", "density": 1000, "young_modulus": 1e7, "poisson_ratio": 0.3}
    table = {
        "name": "beam",
        "geometry": {
            "kind": "mesh", "file": "beam.msh", "regions": {"beam": "beam"}, "boundaries": outline,
            "tip": {"x": 2.0, "y": 0.5},
        },
        "solid": {"beam": solid},
        load: {"y": -9.81 if load == "gravity" else -1e4},
        "output": {"pictures": False},
    }  # fmt: skip
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(table))
    assert run("run", tmp_path / "scene.toml", "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"regions: beam 4 m²\nboundaries: {shown}\nbeam converged")
    data = json.loads((tmp_path / "out" / "result.json").read_text())
    assert data["quantities"]["tip_uy"] == pytest.approx(tip, rel=1e-5)
    assert data["regions"] == pytest.approx({"beam": 4.0}, rel=1e-12)
    found = {name: f"{name} {side['length']:g} m" for name, side in data["boundaries"].items()}
    assert ", ".join(found.values()) == shown
    assert all(side["role"] == name for name, side in data["boundaries"].items())


def test_coordinates_straight_from_gmsh(tmp_path) -> None:
    """Noise of 1e-12 of the size in every coordinate, as on Gmsh's lines: the same value, and the check passes."""
    values = []
    for noise in (0.0, 4e-12):
        beam(tmp_path / "beam.msh", {"left": "5", "top": "", "right": ""}, noise)
        solid = {"material": "st-venant-kirchhoff", "density": 1000, "young_modulus": 1e7, "poisson_ratio": 0.3}
        geometry = {"kind": "mesh", "file": "beam.msh", "regions": {"beam": 1}, "boundaries": {"clamped": 5}}
        table = {"name": "beam", "geometry": geometry, "solid": {"beam": solid}, "gravity": {"y": -9.81}}
        (tmp_path / "scene.toml").write_text(tomli_w.dumps(table | {"output": {"pictures": False}}))
        assert run("run", tmp_path / "scene.toml", "--out", tmp_path / "out") == 0
        assert largest_check(tmp_path / "out") < 1e-9
        values.append(json.loads((tmp_path / "out" / "result.json").read_text())["quantities"]["tip_uy"])
    assert values[1] == pytest.approx(values[0], rel=1e-9)
