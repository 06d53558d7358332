"""The committed scripts, run by FreeFEM alone: the same numbers as through Python, and clear refusals."""

import functools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from conftest import scene_of

import ffsi
from ffsi.cli.main import main
from ffsi.files.arrays import read_mesh, read_state
from ffsi.reference import check_run
from ffsi.scene import CASES, with_values
from ffsi.script.render import is_runtime_parameter, render

STEADY = {name: scene for name, scene in CASES.items() if scene.time is None}

EDP = Path(__file__).parents[2] / "edp"


@pytest.fixture(scope="session")
def freefem(installation):
    def freefem(script: str | Path, *arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
        path = EDP / f"{script}.edp" if isinstance(script, str) else script
        command = [installation.binary, "-nw", "-ns", "-v", "0", path, *map(str, arguments)]
        return subprocess.run(
            command, env=installation.environment(), cwd=cwd, capture_output=True, text=True, timeout=60, check=False
        )

    return freefem


def events(output: str, kind: str) -> list[str]:
    start = f"@ffsi {kind} "
    return [line.removeprefix(start) for line in output.splitlines() if line.startswith(start)]


@pytest.mark.parametrize("case", STEADY)
def test_the_same_numbers_as_through_python(freefem, solved, tmp_path, case):
    done = freefem(case, "-mesh_level", 0, "-out", tmp_path, cwd=tmp_path)
    assert (done.returncode, events(done.stdout, "end")) == (0, ["status=converged"])
    through, point = solved(case), json.loads((tmp_path / "point-0001.json").read_text())
    assert point["case"] == case and point["parameters"] == through.parameters
    written = {name: through.quantities[name] for name in point["quantities"]}  # Python adds some
    assert point["quantities"] == pytest.approx(written, rel=1e-10, abs=0)
    mesh, other = (read_mesh(folder / "mesh.bin") for folder in (tmp_path, through.directory))
    assert (mesh.vertices == other.vertices).all()
    state, same = (read_state(folder / "point-0001.bin", mesh) for folder in (tmp_path, through.directory))
    for field in "uvp":
        scale = np.abs(getattr(same, field)).max()
        assert np.abs(getattr(state, field) - getattr(same, field)).max() <= 1e-12 * scale
    report = check_run(tmp_path, through.scene)
    assert report.passed, report.failures


def test_a_folder_of_a_script_is_checked_and_loaded(freefem, tmp_path):
    points = tmp_path / "points.txt"
    points.write_text("1 inflow_mean_velocity 2\n0.02\n0.04\n")
    runs = {
        "one": ("turek-fsi1", "-fluid_viscosity", 0.9),
        "several": ("flap-neo-hookean", "-points", points),
        "in-time": ("turek-csm3", "-time_end", 0.02),
    }
    for name, (case, *arguments) in runs.items():
        (tmp_path / name).mkdir()
        assert freefem(case, "-mesh_level", 0, *arguments, "-out", tmp_path / name, cwd=tmp_path).returncode == 0
        assert main_code("check", tmp_path / name) == 0
    one = ffsi.load_result(tmp_path / "one")
    assert (one.checked, one.scene.fluid.viscosity) == (True, 0.9)
    slow, fast = (ffsi.load_result(tmp_path / "several", point) for point in (1, 2))
    assert 0 < slow.quantities["drag"] < fast.quantities["drag"] and fast.scene.inflow.mean_velocity == 0.04
    assert ffsi.load_result(tmp_path / "in-time").data["time"]["steps"] == 4
    assert main_code("report", tmp_path / "one", "-o", tmp_path / "report.html") == 0
    again = freefem("turek-fsi1", "-mesh_level", 0, "-fluid_viscosity", 1.1, "-out", tmp_path / "one", cwd=tmp_path)
    assert (again.returncode, main_code("check", tmp_path / "one")) == (0, 0)
    assert ffsi.load_result(tmp_path / "one").scene.fluid.viscosity == 1.1
    (tmp_path / "one" / "failed.json").write_text('{"point": 1}')
    assert main_code("check", tmp_path / "one") == 2  # two runs of the script in one folder, the later one failed


def test_sensitivities_and_errors_of_a_script_are_checked_and_wrong_ones_caught(freefem, tmp_path, capsys):
    right, wrong = (tmp_path / name for name in ("right", "wrong"))
    right.mkdir()
    coarse = ("-mesh_level", 0, "-mesh_size_factor", 2)
    done = freefem("turek-cfd1", *coarse, "-sensitivities", 1, "-error", 1, "-out", right, cwd=tmp_path)
    assert done.returncode == 0
    shutil.copytree(right, wrong)
    places = {"sensitivities": ("fluid.viscosity", "drag"), "errors": ("errors", "lift", "estimate")}
    for kind, (*outer, last) in places.items():
        found = json.loads((wrong / f"{kind}-0001.json").read_text())
        functools.reduce(lambda table, key: table[key], outer, found)[last] *= 1.0001
        (wrong / f"{kind}-0001.json").write_text(json.dumps(found))
    assert (main_code("check", right), main_code("check", wrong)) == (0, 1)
    told = capsys.readouterr().err
    assert all(f"{kind}_difference" in told for kind in places)
    data = ffsi.load_result(right).data
    assert {"drag", "lift"} <= data["errors"].keys() & data["sensitivities"].keys()


def test_a_folder_of_another_script_is_refused(freefem, tmp_path, capsys):
    scene = scene_of("flap-svk", "inflow.mean_velocity=0.02")
    other = with_values(scene, {"solid.flap.material": "neo-hookean"})
    blood = with_values(scene, {"fluid.law": "carreau"})
    own = scene.model_copy(update={"name": "my-own"})
    for name, script, code in (("own", own, 2), ("blood", blood, 2), ("other", other, 1)):
        (tmp_path / name).mkdir()
        (tmp_path / f"{name}.edp").write_text(render(script))
        freefem(tmp_path / f"{name}.edp", "-out", tmp_path / name, cwd=tmp_path)
        assert main_code("check", tmp_path / name) == code
    told = capsys.readouterr().err
    assert "written by the script of my-own" in told
    assert "written by another script than that of flap-svk (fluid.exponent" in told
    assert not (tmp_path / "own" / "scene.toml").exists()
    (tmp_path / "own" / "scene.toml").write_text(scene.to_toml())
    assert main_code("check", tmp_path / "own") == 0


def main_code(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code or 0


def test_the_textbook_s_form_gives_the_same(freefem, solved, tmp_path):
    done = freefem("plain-fsi1", cwd=tmp_path)
    words = next(line for line in done.stdout.splitlines() if line.startswith("drag ")).split()
    fast = solved("turek-fsi1").quantities
    for name, value in zip(words[::2], words[1::2], strict=True):
        assert float(value) == pytest.approx(fast[name], rel=1e-8), name


@pytest.mark.parametrize("case", ["turek-fsi1", "turek-cfd1", "turek-csm1"])
def test_a_picture_for_paraview(freefem, tmp_path, case):
    done = freefem(case, "-mesh_level", 0, "-vtu", 1, "-plot", 1, cwd=tmp_path)
    assert done.returncode == 0
    mesh = read_mesh(tmp_path / "mesh.bin")
    state, picture = read_state(tmp_path / "point-0001.bin", mesh), meshio.read(tmp_path / "point-0001.vtu")
    assert [block.type for block in picture.cells] == ["triangle6"]
    assert (picture.cell_data["region"][0] == mesh.region).all()
    for name, values, least in (("displacement", state.u, 0.0), ("velocity", state.v, 1e-9)):
        found = picture.point_data[name][:, :2]
        np.testing.assert_allclose(found, values, atol=1e-9 * max(np.abs(values).max(), least))
    found, expected = picture.point_data["pressure"][mesh.p2[:, :3]], state.p[mesh.triangles]
    np.testing.assert_allclose(found, expected, atol=1e-9 * max(np.abs(state.p).max(), 1e-9))


def test_a_picture_is_asked_for_by_0_or_1_and_several_points(freefem, tmp_path):
    done = freefem("turek-csm1", "-vtu", "yes", cwd=tmp_path)
    assert (done.returncode, events(done.stdout, "bad-input")) == (2, ["text=-vtu needs 0 or 1, got 'yes'"])
    (tmp_path / "points.txt").write_text("2\ngravity_y solid_beam_density\n3\n-1 1000\n-2 1000\n-2 500\n")
    done = freefem("turek-csm2", "-mesh_level", 0, "-points", "points.txt", cwd=tmp_path)
    assert done.returncode == 0 and len(events(done.stdout, "point")) == 3
    tips = [json.loads((tmp_path / f"point-000{i}.json").read_text())["quantities"]["tip_uy"] for i in (1, 2, 3)]
    assert tips[0] == pytest.approx(tips[2], rel=1e-6)  # half the gravity, half the density
    assert tips[1] < 1.5 * tips[0] < 0
    scene = scene_of("turek-csm2", "solid.beam.density=500")
    assert check_run(tmp_path, scene, point=3).passed
    history = pd.read_csv(tmp_path / "newton.csv")
    assert history["point"].unique().tolist() == [1, 2, 3] and list(history)[:3] == ["point", "load", "stage"]


def test_files_of_a_direct_run(freefem, tmp_path):
    out = tmp_path / "out put"
    out.mkdir()
    done = freefem("turek-csm2", "-mesh_level", 1, "-out", out, cwd=tmp_path)
    assert done.returncode == 0
    assert {path.name for path in out.iterdir()} == {"mesh.bin", "newton.csv", "point-0001.bin", "point-0001.json"}
    assert [path.name for path in tmp_path.iterdir()] == ["out put"]
    assert json.loads((out / "point-0001.json").read_text())["level"] == 1
    assert check_run(out, scene_of("turek-csm2", "mesh.level=1")).passed


def test_numbers_given_as_flags(freefem, tmp_path):
    words = ["-mesh_level", 0, "-gravity_y", "-1e0", "-solid_beam_lame_mu", "+4.E6", "-solver_tolerance", ".0000000001"]
    done = freefem("turek-csm2", *words, cwd=tmp_path)
    assert done.returncode == 0
    scene = scene_of("turek-csm2", "gravity.y=-1", "solid.beam.lame_mu=4e6")
    assert check_run(tmp_path, scene).passed
    with pytest.raises(ValueError, match="the run used"):
        check_run(tmp_path, scene_of("turek-csm2"))


@pytest.mark.parametrize(
    "case, settings", [("turek-fsi1", ["gravity.y=-0.1"]), ("turek-csm2", []), ("turek-cfd1", ["gravity.y=-0.1"])]
)
def test_every_parameter_of_a_point_counts(freefem, tmp_path, case, settings):
    """One point after the other changes one parameter more: nothing that depends on it may be left as it was."""
    scene = scene_of(case, *settings)
    values = {key: value for key, value in scene.parameters().items() if is_runtime_parameter(scene, key)}
    points = [dict(values)]
    for key, value in values.items():
        points.append(points[-1] | {key: 0.9 * value})
    lines = [str(len(values)), *(key.replace(".", "_") for key in values), str(len(points))]
    lines += [" ".join(map(repr, point.values())) for point in points]
    (tmp_path / "points.txt").write_text("\n".join(lines) + "\n")
    script = tmp_path / "case.edp"
    script.write_text(render(scene))
    done = freefem(script, "-mesh_level", 0, "-points", "points.txt", cwd=tmp_path)
    assert done.returncode == 0
    for number, (changed, point) in enumerate(zip(["nothing", *values], points, strict=True), start=1):
        report = check_run(tmp_path, with_values(scene, point), point=number)
        assert report.passed, (changed, report.failures)


REFUSED = {
    "unknown flag": (["-colour", "1"], "unknown flag -colour"),
    "misspelt flag": (["-mesh_levle", "1"], "unknown flag -mesh_levle"),
    "flag of another case": (["-solid_flap_lame_mu", "1"], "unknown flag -solid_flap_lame_mu"),
    "key that stays in Python": (["-solver_time_limit", "1"], "unknown flag -solver_time_limit"),
    "no dash": (["mesh_level", "1"], "unknown flag mesh_level"),
    "two dashes": (["--mesh_level", "1"], "unknown flag --mesh_level"),
    "a dash alone": (["-", "1"], "unknown flag -"),
    "no value": (["-mesh_level"], "-mesh_level needs a number"),
    "no value before a flag": (["-mesh_level", "-fluid_density", "1"], "-mesh_level needs a number, got '-fluid_de"),
    "no folder": (["-out"], "-out needs a folder"),
    "no file": (["-points"], "-points needs a file"),
    "text": (["-mesh_level", "two"], "-mesh_level needs a number, got 'two'"),
    "number with a unit": (["-fluid_density", "1000kg"], "-fluid_density needs a number, got '1000kg'"),
    "two dots": (["-fluid_density", "1.0.0"], "-fluid_density needs a number"),
    "empty exponent": (["-fluid_density", "1e"], "-fluid_density needs a number"),
    "not a number": (["-fluid_density", "nan"], "-fluid_density needs a number"),
    "infinity": (["-fluid_density", "inf"], "-fluid_density needs a number"),
    "hexadecimal": (["-fluid_density", "0x10"], "-fluid_density needs a number"),
    "fraction for an integer": (["-mesh_level", "1.5"], "-mesh_level needs an integer, got '1.5'"),
    "exponent for an integer": (["-solver_max_iterations", "1e1"], "-solver_max_iterations needs an integer"),
    "level too high": (["-mesh_level", "7"], "-mesh_level must be at most 6"),
    "level too low": (["-mesh_level", "-1"], "-mesh_level must be at least 0"),
    "huge level": (["-mesh_level", "99999999999"], "-mesh_level must be"),
    "no iterations": (["-solver_max_iterations", "0"], "-solver_max_iterations must be at least 1"),
    "no points file": (["-points", "nothing.txt"], "cannot read the points file nothing.txt"),
    "no output folder": (["-mesh_level", "0", "-out", "nothing/there"], "cannot write into the folder nothing/there"),
}  # fmt: skip


@pytest.mark.parametrize("arguments, message", REFUSED.values(), ids=REFUSED)
def test_refused_with_exit_code_2(freefem, tmp_path, arguments, message):
    done = freefem("turek-fsi1", *arguments, cwd=tmp_path)
    texts = events(done.stdout, "bad-input")
    assert (done.returncode, len(texts)) == (2, 1) and texts[0].startswith("text=" + message)
    assert events(done.stdout, "end") == [] and list(tmp_path.iterdir()) == []


POINTS = {
    "unknown parameter": ("1\ninflow_mean_velocty\n1\n0.2\n", "unknown parameter inflow_mean_velocty"),
    "mesh parameter": ("1\nmesh_level\n1\n1\n", "mesh_level changes the mesh"),
    "geometry": ("1\ngeometry_height\n1\n0.4\n", "geometry_height changes the mesh"),
    "no names": ("0\n1\n", "cannot read the points file"),
    "no text at all": ("", "cannot read the points file"),
    "another kind of file": ("velocity,drag\n0.1,2\n", "cannot read the points file"),
    "no values": ("1\ninflow_mean_velocity\n", "too few values"),
    "too few values": ("1\ninflow_mean_velocity\n3\n0.1 0.2\n", "too few values"),
    "text for a value": ("1\ninflow_mean_velocity\n1\nfast\n", "too few values, or no numbers"),
    "no points": ("1\ninflow_mean_velocity\n0\n", "no points"),
}


@pytest.mark.parametrize("content, message", POINTS.values(), ids=POINTS)
def test_points_files_that_are_refused(freefem, tmp_path, content, message):
    (tmp_path / "points.txt").write_text(content)
    done = freefem("turek-fsi1", "-mesh_level", 0, "-points", "points.txt", cwd=tmp_path)
    texts = events(done.stdout, "bad-input")
    assert (done.returncode, len(texts)) == (2, 1) and texts[0].startswith("text=" + message)
    assert [path.name for path in tmp_path.iterdir()] == ["points.txt"]


def test_not_converged_is_exit_code_3(freefem, tmp_path):
    done = freefem("turek-fsi1", "-mesh_level", 0, "-solver_max_iterations", 1, cwd=tmp_path)
    assert (done.returncode, events(done.stdout, "end")) == (3, ["status=failed"])
    assert events(done.stdout, "failed")[0].startswith("point=1 text=")
    assert json.loads((tmp_path / "failed.json").read_text())["status"] == "failed"
    assert not list(tmp_path.glob("point-*"))


@pytest.mark.parametrize("text", ['"; exec("touch pwned"); //', "ends with \\", "'*/ exit(1); /*", "Ω ≠ ω"])
def test_a_description_never_runs(freefem, tmp_path, text):
    scene = STEADY["turek-csm2"]
    scene = type(scene).model_validate(scene.model_dump(exclude_none=True) | {"description": text})
    script = tmp_path / "case.edp"
    script.write_text(render(scene), encoding="utf-8")
    done = freefem(script, "-mesh_level", 0, cwd=tmp_path)
    assert (done.returncode, events(done.stdout, "end")) == (0, ["status=converged"])
    assert not (tmp_path / "pwned").exists()


def test_a_run_loads_only_what_it_uses(tmp_path):
    """Names, not seconds: these take more than a second together."""
    code = "import atexit, sys; from ffsi.cli.main import main; atexit.register(lambda: print(*sys.modules)); main()"
    heavy = {"scipy", "pandas", "pint", "meshio", "distributed", "xarray", "matplotlib", "shapely", "rich.progress"}
    heavy |= {"ffsi.report", "ffsi.run.sweep", "ffsi.scene.meshes.reading", "ffsi.freefem.doctor"}
    heavy |= {"PIL.PngImagePlugin", "IPython", "numpy.ma", "rich.console"}
    for drawn in (True, False):
        pictures = f"output.pictures={str(drawn).lower()}"
        plain = ["--set", pictures, "--set", "mesh.level=0", *([] if drawn else ["--json"])]
        command = [sys.executable, "-c", code, "run", "turek-fsi1", *plain, "--out", str(tmp_path / "run")]
        found = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1].split()
        assert {"ffsi.reference.check", "ffsi.result.vtu"} <= set(found)
        assert drawn == ("PIL" in found) == ("ffsi.result.painting" in found)
        assert heavy & set(found) == set()
