"""Meshes from Gmsh and the README's scene for them, through the command line: steady, in time, in a sweep."""

import json
import math
import re
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pandas as pd
import pytest
import tomli_w
from own_mesh import scene_on, write_mesh
from PIL import Image
from structured import structured_mesh

from ffsi.cli.main import main
from ffsi.files.arrays import read_mesh, read_state
from ffsi.freefem import FreeFEMError
from ffsi.hemodynamics.result import load_result
from ffsi.result.domain import intended, meshed
from ffsi.result.sketch import sketch
from ffsi.run.meshing import mesh_of
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, boundaries, load_scene
from ffsi.scene.drafts import Answers, draft

INNER, LUMEN, OUTER = 6.0, 9.0, 9.6  # radii of a bent vessel in mm: rigid inner wall, interface, outside of the wall
START, TURN = math.radians(25), math.radians(70)


@pytest.fixture(scope="module")
def vessel(tmp_path_factory) -> Iterator[Path]:
    """Yield a folder with the mesh of the vessel, and its scene."""
    folder = tmp_path_factory.mktemp("vessel")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    draw()
    gmsh.model.mesh.generate(2)
    gmsh.write(str(folder / "vessel.msh"))
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
    """With the rigid inner wall bent onto its arc: one of the two sides of the flow, the other one is elastic."""
    out, settings = tmp_path / "fine", ("mesh.level=1", "output.pictures=false", 'geometry.curved="walls"')
    assert run("run", vessel / "scene.toml", *(f"--set={each}" for each in settings), "--out", out) == 0
    assert largest_check(out) < 1e-8
    mesh = read_mesh(out / "mesh.bin")
    nodes = (read_state(out / "point-0001.bin", mesh).u + mesh.p2_coordinates)[mesh.edge_nodes[mesh.label == 3]]
    assert np.abs(np.hypot(*nodes.reshape(-1, 2).T) / 6e-3 - 1).max() < 1e-5
    coarse = len(load_scene(vessel / "scene.toml").geometry._mesh.triangles)
    assert json.loads((out / "result.json").read_text())["triangles"] == 4 * coarse


def test_ends_of_a_solid_rest_at_inlet_and_outlet(vessel, tmp_path) -> None:
    """Also where nothing clamps them, and where the fluid comes in by plug flow."""
    table = scene(support={"stiffness": "1 MPa/m"}, inflow={"mean_velocity": "5 cm/s", "profile": "uniform"})
    table["geometry"]["boundaries"]["supported"] = table["geometry"]["boundaries"].pop("clamped") and "wall"
    (vessel / "held.toml").write_text(tomli_w.dumps(table))
    assert run("run", vessel / "held.toml", "--out", tmp_path / "out") == 0 and largest_check(tmp_path / "out") < 1e-8
    assert abs(json.loads((tmp_path / "out/result.json").read_text())["quantities"]["mass_balance"]) < 1e-12


def ring(folder: Path, along: int, across: int, curved: list[str] | None, level: int = 0) -> Scene:
    """Return a quarter of a ring with unevenly long edges, through which a pressure drives a fluid without inertia."""
    sides = lambda x, y: 1 + (x == 1) if x in (0, 1) else 3 + (y > 1)  # noqa: E731
    mesh = structured_mesh(np.linspace(0, 1, along + 1), np.linspace(1, 1.5, across + 1), lambda x, y: 1, sides)
    s, r = mesh.vertices.T
    angle = np.pi / 2 * s + 0.05 * np.sin(np.pi * s) - 0.015 * np.sin(2 * np.pi * s)
    mesh.vertices[:] = np.column_stack([r * np.sin(angle), r * np.cos(angle)])
    path = write_mesh(folder / "ring.msh", mesh, {"all": 1}, {"in": 1, "out": 2, "inner": 3, "outer": 4})
    ends = {name: {"pressure": value, "direction": "normal"} for name, value in (("a", 1.0), ("b", 0.0))}
    return scene_on(path, {"walls": ["inner", "outer"]}, {"fluid": "all"}, inlets={"a": "in", "b": "out"},
        parts={"outer": "outer"}, curved=curved, inlet=ends, fluid={"density": 1e-9, "viscosity": 0.1},
        mesh={"level": level})  # fmt: skip


def test_flow_between_arcs(tmp_path) -> None:
    """The flow rate between polygons is off by the second order, between their curves by the fourth one."""
    wide, narrow = 1.5**2, 1.0
    exact = 2 / np.pi / 0.1 * ((wide - narrow) / 8 - wide * narrow * math.log(wide / narrow) ** 2 / 8 / (wide - narrow))

    def error(*sizes: int, curved: bool = True) -> float:
        scene = ring(tmp_path, *sizes[:2], ["walls", "outer"] if curved else None, *sizes[2:])
        result = solve(scene, tmp_path / "out", error=True)
        assert result.checked and result.data["check"]["errors_difference"] < 1e-6
        return abs(result.quantities["flow_through_a"] / exact - 1)

    assert error(6, 4) < 0.1 * error(6, 4, curved=False) and error(12, 8) < error(6, 4) / 14
    assert error(6, 4, 1) < error(6, 4) / 10
    with pytest.raises(FreeFEMError, match=r"at \(.*\) m a triangle beside the curved boundary would be turned"):
        solve(ring(tmp_path, 6, 64, ["walls"]), tmp_path / "out")


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
    (folder / "case.edp").unlink(missing_ok=True)
    for path in (vessel / "scene.toml", vessel / "vessel.msh"):  # as its author wrote it, and left so
        shutil.copy(path, folder)
    assert run("check", folder) == 0 and load_result(folder).checked
    assert (folder / "scene.toml").read_bytes() == (vessel / "scene.toml").read_bytes()


def test_a_missing_mesh_ends_the_script(vessel, tmp_path, run_text) -> None:
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


def test_coordinates_straight_from_gmsh(tmp_path) -> None:
    """Noise of 1e-12 of the size in every coordinate, as on Gmsh's lines: the same value, and the check passes."""
    values, random = [], np.random.default_rng(3)
    solid = {"material": "st-venant-kirchhoff", "density": 1000, "young_modulus": 1e7, "poisson_ratio": 0.3}
    for noise in (0.0, 4e-12):
        mesh = structured_mesh(np.linspace(0, 4, 17), np.linspace(0, 1, 5), lambda x, y: 1, lambda x, y: 1 + (x > 0))
        mesh.vertices[:] += noise * random.uniform(-1, 1, mesh.vertices.shape)
        path = write_mesh(tmp_path / "beam.msh", mesh, {"beam": 1}, {"left": 1, "rest": 2})
        beam = scene_on(path, {"clamped": "left"}, {"beam": "beam"}, solid={"beam": solid}, gravity={"y": -9.81})
        result = solve(beam, tmp_path / "out")
        assert result.checked and largest_check(tmp_path / "out") < 1e-9
        values.append(result.quantities["tip_uy"])
    assert values[1] == pytest.approx(values[0], rel=1e-9)


@pytest.mark.parametrize("case", ["turek-fsi1", "aneurysm-pulsatile", "cook", "cylinder-2d1"])
def test_the_mesh_is_that_of_the_scene(case):
    scene = load_scene(case, ["mesh.level=0"])
    found = mesh_of(scene)
    assert meshed(scene, found.mesh)["regions"] == pytest.approx(intended(scene)["regions"], rel=0.01)
    figure = sketch(scene, found.mesh)
    words = {text.get_text() for text in figure.legends[0].get_texts()}
    assert all(any(side.name in text and side.role in text for text in words) for side in boundaries(scene))
    assert set(scene.exact_areas()) < words


def test_meshes_are_those_of_runs_or_refused(solved):
    scene = Scene.from_toml(draft("mine", Answers("channel-cavity", what="solid", level="0")))
    assert list(meshed(scene, mesh_of(scene).mesh)["regions"]) == ["floor"]
    result = solved("turek-fsi1")
    found = mesh_of(result.scene)
    assert (len(found.mesh.triangles), found.unknowns) == (result.data["triangles"], result.data["unknowns"])
    with pytest.raises(FreeFEMError, match="smaller elements are needed there") as error:
        mesh_of(load_scene("cylinder-2d1", ["mesh.level=0", "mesh.size_factor=30"]))
    assert error.value.kind == "bad-input"


def test_the_command_draws_a_draft(tmp_path, capsys):
    path, picture = tmp_path / "mine.toml", tmp_path / "mine.png"
    path.write_text(draft("mine", Answers("channel", level="0")))
    with pytest.raises(SystemExit) as ended:
        main(["show", str(path), "-o", str(picture)])
    out, err = capsys.readouterr()
    assert ended.value.code == 0 and str(picture) in err
    assert Scene.from_toml(path.read_text()).heading in out and "unknowns" in out
    with Image.open(picture) as image:
        assert min(image.size) > 300 and len(image.getcolors(10**6) or []) > 50
