"""Meshes from Gmsh and the README's scene for them, through the command line: steady, in time, in a sweep."""

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

from ffsi.cli import main
from ffsi.rawfiles import read_mesh
from ffsi.result import load_result
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
    assert run("run", vessel / "scene.toml", "--out", out) == 0
    assert largest_check(out) < 1e-8
    data = json.loads((out / "result.json").read_text())
    assert data["level"] == 0
    assert data["quantities"]["tip_uy"] > 1e-6
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
    assert run("check", out) == 0
    assert load_scene(out / "scene.toml") == load_scene(vessel / "scene.toml")
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
    assert run("run", vessel / "time.toml", "--out", out) == 0
    assert largest_check(out) < 1e-8
    assert (out / "velocity.png").is_file()
    # As if killed: what defines the run is all in its folder.
    for name in ("result.json", "point-0001.json", "point-0001.bin"):
        (out / name).unlink()
    assert run("run", "--resume", out) == 0
    assert largest_check(out) < 1e-8


def test_sweep(vessel, tmp_path) -> None:
    out = tmp_path / "sweep"
    vary = "inflow.mean_velocity=0.02,0.04"
    assert run("sweep", vessel / "scene.toml", "--vary", vary, "--out", out) == 0
    rows = (out / "sweep.csv").read_text().splitlines()
    assert len(rows) == 3
    assert run("report", out, "-o", tmp_path / "report.html") == 0


def test_the_rendered_script_runs_alone(vessel, tmp_path, run_text, installation) -> None:
    assert run("render", vessel / "scene.toml", "-o", tmp_path / "vessel.edp") == 0
    folder, done = run_text((tmp_path / "vessel.edp").read_text(), mesh=tmp_path / "vessel.mesh")
    assert done.status == "converged"
    assert (folder / "point-0001.bin").is_file()


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
    mesh = read_mesh(case.directory / "mesh.bin")
    angle = math.radians(turn)
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    cells = [("triangle", mesh.triangles), ("line", mesh.edges)]
    data = {"medit:ref": [mesh.region, mesh.label]}
    meshio.Mesh(mesh.vertices @ rotation.T, cells, cell_data=data).write(tmp_path / "flap.mesh", file_format="medit")
    tables = tomllib.loads(case.scene.to_toml())
    tip = rotation @ case.scene.tip
    tables["geometry"] = {
        "kind": "mesh",
        "file": "flap.mesh",
        "regions": {"fluid": 1, "flap": 2},
        "boundaries": {"inlet": 1, "outlet": 2, "walls": 3, "clamped": 6},
        "tip": {"x": tip[0], "y": tip[1]},
    }
    del tables["mesh"]
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(tables))
    out = tmp_path / "run"
    assert run("run", tmp_path / "scene.toml", "--out", out) == 0
    assert largest_check(out) < 1e-8
    found, wanted = load_result(out).quantities, case.quantities
    for x, y in (("drag", "lift"), ("drag_surface", "lift_surface"), ("tip_ux", "tip_uy")):
        turned = rotation @ (wanted[x], wanted[y])
        np.testing.assert_allclose((found[x], found[y]), turned, rtol=0, atol=1e-8 * np.hypot(*turned))
    for name in ("min_jacobian_fluid", "min_jacobian_solid", "pressure_drop"):
        assert found[name] == pytest.approx(wanted[name], rel=1e-8), name
