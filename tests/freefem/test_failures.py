"""What remains when a run ends badly, and the exit codes of the command line."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from conftest import scene_of

from ffsi.cli.main import main
from ffsi.files.arrays import RawState, read_mesh, read_state, write_state
from ffsi.freefem import FreeFEMError
from ffsi.hemodynamics.result import load_result
from ffsi.run.one_scene import solve
from ffsi.script.render import render

COMMAND = [sys.executable, "-c", "from ffsi.cli.main import main; main()"]
LEVEL_0 = ["--set", "mesh.level=0"]
PLAIN = ["--set", "output.pictures=false", "--set", "output.vtu=false"]
VELOCITIES = [round(0.012 * i, 3) for i in range(1, 9)]

# The keys of result.json that other programs rely on.
CONTRACT = {
    "": [*("case", "status", "reason", "unknowns", "triangles", "level", "quantities", "newton", "timings", "check"),
        *("freefem", "parameters")],
    "quantities": [*("drag", "lift", "drag_coefficient", "lift_coefficient", "tip_ux", "tip_uy", "pressure_drop"),
        "min_jacobian"],
    "newton": ["iterations", "factorizations"],
    "timings": [*("mesh", "operators", "residual", "jacobian", "factorize", "solve", "output", "check", "total"),
        *("one_factorization", "one_solve", "one_residual", "one_jacobian")],
    "check": ["momentum", "continuity", "kinematics", "mesh_motion", "drag_difference", "lift_difference"],
    "freefem": ["version", "solver"],
}  # fmt: skip


@pytest.fixture
def ffsi(tmp_path, monkeypatch, capfd):
    """Call the command line in an empty folder; return the exit code, and what was written to the two streams."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")

    def ffsi(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stopped:
            main([*map(str, arguments)])
        return (int(stopped.value.code or 0), *capfd.readouterr())

    return ffsi


@pytest.fixture(scope="module")
def run_as_json(tmp_path_factory):
    folder, words = tmp_path_factory.mktemp("json"), [*COMMAND, "run", "turek-fsi1", *LEVEL_0, "--json"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    return done, folder / "runs" / "turek-fsi1"


def test_json_is_alone_and_valid(run_as_json):
    done, folder = run_as_json
    assert done.returncode == 0 and done.stdout.startswith("{") and done.stdout.endswith("}\n")

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    data = json.loads(done.stdout, parse_constant=refuse)
    assert data == json.loads((folder / "result.json").read_text())


def test_the_contract_and_the_run_folder(run_as_json):
    data = json.loads(run_as_json[0].stdout)
    for table, names in CONTRACT.items():
        values = data[table] if table else data
        assert [name for name in names if values.get(name) is None] == [], table
    assert (data["case"], data["status"], data["reason"], data["level"]) == ("turek-fsi1", "converged", "", 0)
    timings = data["timings"]
    assert all(value >= 0 for value in timings.values())
    parts = [timings[name] for name in ("mesh", "operators", "residual", "jacobian", "factorize", "solve", "check")]
    assert sum(parts) < timings["total"]
    assert data["parameters"]["inflow.mean_velocity"] == 0.2 and data["freefem"]["solver"] == "MUMPS"
    names = {path.name for path in run_as_json[1].iterdir()}
    assert names == {
        *("case.edp", "scene.toml", "freefem.log", "result.json", "mesh.bin", "newton.csv", "fields.vtu"),
        *("point-0001.bin", "point-0001.json", "velocity.png", "pressure.png", "displacement.png"),
    }
    assert all((run_as_json[1] / name).stat().st_size > 0 for name in names)


def test_0_without_json_is_for_people(ffsi, tmp_path):
    code, out, _ = ffsi("run", "turek-csm2", *LEVEL_0, *PLAIN, "--out", "here")
    assert code == 0
    assert "tip_uy" in out and "check: passed" in out
    assert [path.name for path in tmp_path.iterdir()] == ["here"]


def test_exit_codes_1_to_3(ffsi, run_as_json, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_as_json[1], folder)
    assert ffsi("check", folder)[0] == 0
    mesh = read_mesh(folder / "mesh.bin")
    state = read_state(folder / "point-0001.bin", mesh)
    write_state(folder / "point-0001.bin", RawState(state.u, 1.001 * state.v, state.p))
    code, _, err = ffsi("check", folder)
    assert code == 1 and "momentum" in err
    code, out, err = ffsi("run", "turek-fsi1", "--set", "mesh.levle=0", "--json")
    assert (code, out) == (2, "") and 'did you mean "mesh.level"?' in err
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_3_not_converged(ffsi, tmp_path):
    words = ["run", "turek-fsi1", *LEVEL_0, *PLAIN, "--set", "solver.max_iterations=1", "--json", "--out", "r"]
    code, out, err = ffsi(*words)
    assert code == 3
    data = json.loads(out)
    assert (data["status"], data["failure"], data["state"]) == ("failed", "not-converged", "failed.bin")
    assert "solver.max_iterations" in data["reason"] and data["reason"] in err
    assert load_result(tmp_path / "r").fields is not None


def test_4_without_freefem(ffsi, tmp_path, monkeypatch):
    monkeypatch.setenv("FFSI_FREEFEM", "/nonexistent")
    code, out, err = ffsi("run", "turek-fsi1", *LEVEL_0)
    assert code == 4
    assert [line.split(":")[0] for line in out.splitlines()] == ["regions", "boundaries"]  # what was understood
    assert "FFSI_FREEFEM=/nonexistent is no executable file" in err and "apt-get install" in err
    assert list(tmp_path.iterdir()) == []


def test_4_without_the_plugins(ffsi, tmp_path, monkeypatch):
    monkeypatch.setenv("FF_LOADPATH", str(tmp_path))
    code, _, err = ffsi("run", "turek-fsi1", *LEVEL_0)
    assert code == 4 and "Element_QF.so" in err
    assert list(tmp_path.iterdir()) == []


def test_the_time_limit(tmp_path):
    begin = time.monotonic()
    with pytest.raises(FreeFEMError) as caught:
        solve(scene_of("turek-fsi1", "mesh.level=4", "solver.time_limit=1"), tmp_path / "run")
    assert time.monotonic() - begin < 10 and caught.value.kind == "time-limit"
    result = load_result(tmp_path / "run")
    assert (result.status, result.failure) == ("failed", "crash") and "1 s" in result.reason


def wait_for(path: Path, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 60
    while not path.is_file():
        assert process.poll() is None, "the sweep ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.01)


def freefem_in(folder: Path) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if os.fsencode(folder) in b" ".join(words) and b"FreeFem" in words[0]:
            found.append(int(path.parent.name))
    return found


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT], ids=lambda how: how.name)
def test_a_killed_sweep_keeps_its_points_and_goes_on(ffsi, tmp_path, how):
    out = tmp_path / "sweep"
    vary = f"inflow.mean_velocity={VELOCITIES[0]}:{VELOCITIES[-1]}:{VELOCITIES[0]}"
    words = ["sweep", "flap-svk", *LEVEL_0, *PLAIN, "--vary", vary, "--out", str(out)]
    process = subprocess.Popen([*COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    first = out / "chain-001"
    try:
        wait_for(first / "point-0002.json", process)
        process.send_signal(how)
        assert process.wait(timeout=30) != 0
    finally:
        process.kill()
    deadline = time.monotonic() + 5
    while freefem_in(out) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert freefem_in(out) == []
    kept = {path.name: path.stat().st_mtime_ns for path in first.glob("point-*.json")}
    assert 2 <= len(kept) < len(VELOCITIES)

    code, _, err = ffsi(*words)
    assert code == 0, err
    table = pd.read_csv(out / "sweep.csv")
    assert table["inflow.mean_velocity"].tolist() == VELOCITIES and (table["status"] == "converged").all()
    assert (table["check_maximum"] < 1e-8).all() and (table["tip_ux"].diff().dropna() > 0).all()
    assert {path.name: path.stat().st_mtime_ns for path in first.glob("point-*.json")} == kept
    # The last one may have been cut off while it was written.
    assert (table["folder"] == "chain-001").sum() in (len(kept), len(kept) - 1)
    assert set(table["folder"]) == {"chain-001", "chain-002"}


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 200 kB: the script and the mesh fit, the unknowns do not."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(folder)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no right to mount a small file system")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_is_named(small_disk):
    out = small_disk / "run"
    try:
        result = solve(scene_of("turek-fsi1"), out)
    except FreeFEMError as error:
        assert error.kind == "disk-full" and str(out) in error.message
    except OSError as error:
        assert error.errno == errno.ENOSPC
    else:
        raise AssertionError(f"{result.status}: {result.reason}")


@pytest.mark.parametrize("motion", ["hyperelastic", "harmonic"])
def test_a_tangled_start_is_no_solution(run_text, motion):
    """Where J < 0 a logarithm is no number, and no comparison with it may pass for a small residual."""
    text = render(scene_of("turek-fsi1", f"mesh_motion.kind={motion}"))
    rest = "  SetStep(0); SetDirichlet(X);\n"
    assert text.count(rest) == 1
    tangled = "  { Vh bent = -2*x*(x > 1.2); X(uxFrom:uxTo) = bent[]; }\n"
    folder, done = run_text(text.replace(rest, rest + tangled))
    assert done.status == "failed" and "the fluid mesh folds" in done.reason and "J = -" in done.reason
    assert not (folder / "point-0001.json").exists()
