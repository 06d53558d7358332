"""From a scene to a Result, with a stand-in for the FreeFEM process."""

import json
import threading

import pytest

from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMError, FreeFEMNotFound
from ffsi.hemodynamics.result import load_result, load_results
from ffsi.run import chain, one_scene
from ffsi.scene import SceneError, load_scene

CONTRACT = (
    *("case", "status", "reason", "unknowns", "triangles", "level", "quantities", "newton"),
    *("timings", "check", "freefem", "parameters"),
)

scene = pytest.fixture(lambda: load_scene("flap-svk", ["mesh.level=0"]))


def velocities(*values):
    return [{"inflow.mean_velocity": value} for value in values]


def test_solve_leaves_a_complete_folder(tmp_path, freefem, check, scene):
    result = one_scene.solve(scene, tmp_path / "run")
    assert result.converged
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert data == result.data and tuple(data)[: len(CONTRACT)] == CONTRACT and data["check"]["momentum"] == 1e-11
    assert {"check", "pictures", "output", "total", "mesh"} <= set(data["timings"])
    assert data["timings"]["output"] >= 0.05
    assert {path.name for path in (tmp_path / "run").iterdir()} == {
        *("case.edp", "scene.toml", "freefem.log", "mesh.bin", "newton.csv", "point-0001.bin", "point-0001.json"),
        *("result.json", "fields.vtu", "velocity.png", "pressure.png", "displacement.png"),
    }
    assert load_result(tmp_path / "run").quantities == result.quantities


def test_without_a_folder_the_files_live_as_long_as_the_result(freefem, check, scene):
    result = one_scene.solve(scene)
    directory = result.directory
    assert (directory / "result.json").is_file() and result.at(1.0, 0.2)["region"] == 1
    del result
    assert not directory.exists()


def test_a_failed_check_fails_loudly_and_keeps_the_solution(tmp_path, freefem, check, scene):
    check.wrong = 0.12
    result = one_scene.solve(scene, tmp_path / "run")
    assert (result.status, result.failure, result.solved) == ("failed", "check", True)
    assert result.reason == "the reference check disagrees: momentum: the relative residual of the momentum is 1.00e-03"
    assert (tmp_path / "run" / "velocity.png").is_file()
    assert one_scene.solve(scene, tmp_path / "run", check=False).converged


def test_a_check_that_cannot_be_done_is_a_failure(tmp_path, freefem, monkeypatch, scene):
    def refuse(*_, **__):
        raise ValueError("parameters differ")

    monkeypatch.setattr("ffsi.reference.check_run", refuse)
    result = one_scene.solve(scene, tmp_path / "run")
    assert (result.failure, result.reason) == ("check", "the reference check could not be done: parameters differ")


def test_not_converged_keeps_the_last_state_and_is_not_checked(tmp_path, freefem, check, scene):
    freefem.fail = 0.12
    result = one_scene.solve(scene, tmp_path / "run")
    assert (result.status, result.failure, result.reason) == ("failed", "not-converged", "J too small")
    assert check.calls == [] and (tmp_path / "run" / "fields.vtu").is_file()
    assert "last converged state" in result.title
    full = load_scene("flap-svk", [])
    assert result.at(0.61, 0.11)["uy"] == pytest.approx(0.5 * -0.05 * 0.11**2) and full.name == result.scene.name


def test_a_crash_is_raised_and_recorded(tmp_path, freefem, check, scene):
    freefem.die = 0.12
    with pytest.raises(FreeFEMError, match="SIGSEGV"):
        one_scene.solve(scene, tmp_path / "run")
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert (data["status"], data["failure"]) == ("failed", "crash") and "SIGSEGV" in data["reason"]


def test_nothing_is_written_without_freefem_or_into_a_foreign_folder(tmp_path, freefem, monkeypatch, scene):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("x")
    with pytest.raises(InputError, match="not empty"):
        one_scene.solve(scene, tmp_path / "mine")

    def missing():
        raise FreeFEMNotFound("missing-binary", "no FreeFem++")

    monkeypatch.setattr(one_scene, "find_freefem", missing)
    with pytest.raises(FreeFEMNotFound):
        one_scene.solve(scene, tmp_path / "new")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["mine", "notes.txt"]


def test_a_chain_checks_every_point_with_its_own_values(tmp_path, freefem, check, scene):
    seen = []
    results = chain.run_chain(scene, velocities(0.01, 0.02, 0.03), tmp_path / "chain", on_result=seen.append)
    assert [result.quantities["drag"] for result in results] == [0.02, 0.04, 0.06]
    assert check.calls == [(0.01, 1), (0.02, 2), (0.03, 3)] and [result.point for result in seen] == [1, 2, 3]
    assert (tmp_path / "chain" / "points.txt").read_text() == "1\ninflow_mean_velocity\n3\n0.01\n0.02\n0.03\n"
    assert (tmp_path / "chain" / "velocity-0003.png").is_file()
    assert not (tmp_path / "chain" / "velocity-0002.png").exists() and load_result(tmp_path / "chain").point == 3
    assert load_result(tmp_path / "chain", 2).scene.inflow.mean_velocity == 0.02
    assert len(load_results(tmp_path / "chain")) == 3
    assert results[1].data["timings"]["total"] == pytest.approx(0.4, abs=0.2)


def test_points_are_checked_while_freefem_goes_on(tmp_path, freefem, check, scene):
    first, in_time = threading.Event(), []

    def wait_for_the_first_result(event):
        if event.integer("point") == 1:
            in_time.append(first.wait(10))

    results = chain.run_chain(
        scene, velocities(0.01, 0.02), tmp_path / "chain", on_event=wait_for_the_first_result,
        on_result=lambda result: first.set(),
    )  # fmt: skip
    assert in_time == [True] and len(results) == 2


def test_a_chain_that_dies_keeps_its_complete_points(tmp_path, freefem, check, scene):
    freefem.die = 0.03
    results = chain.run_chain(scene, velocities(0.01, 0.02, 0.03, 0.04), tmp_path / "chain")
    assert [result.failure for result in results] == ["", "", "crash", "crash"] and "SIGSEGV" in results[2].reason
    assert load_result(tmp_path / "chain").point == 2


def test_points_after_a_failed_one_are_not_reached(tmp_path, freefem, check, scene):
    freefem.fail = 0.02
    results = chain.run_chain(scene, velocities(0.01, 0.02, 0.03), tmp_path / "chain")
    assert [result.failure for result in results] == ["", "not-converged", "not-reached"]
    assert results[2].reason == "not reached: point 2 of the chain failed (J too small)"


def test_a_failure_is_sealed_by_its_own_point_alone(tmp_path, freefem, check, scene):
    """The point before it may be finished while the script is still writing what failed."""
    check.wait_for, freefem.fail = tmp_path / "chain" / "failed.json", 0.02
    results = chain.run_chain(scene, velocities(0.01, 0.02), tmp_path / "chain")
    assert ["failed.json" in result.data["files"] for result in results] == [False, True]


def test_a_wrong_point_in_a_chain_is_found(tmp_path, freefem, check, scene):
    check.wrong = 0.02
    results = chain.run_chain(scene, velocities(0.01, 0.02, 0.03), tmp_path / "chain", draw="none")
    assert [result.failure for result in results] == ["", "check", ""]
    assert not list((tmp_path / "chain").glob("*.png"))


@pytest.mark.parametrize(("points", "error", "message"), [
    ([], InputError, "at least one point"),
    ([{"fluid.viscosity": 1e-3}, {"fluid.density": 1.0}], InputError, "same keys"),
    ([{"mesh.level": 0}, {"mesh.level": 1}], InputError, "mesh.level cannot change within one chain"),
    ([{"inflow.mean_velocitty": 0.1}], SceneError, "inflow.mean_velocity"),
    ([{"fluid.density": -1.0}], SceneError, "fluid.density"),
])  # fmt: skip
def test_bad_chains_write_nothing(tmp_path, freefem, scene, points, error, message):
    with pytest.raises(error, match=message):
        chain.run_chain(scene, points, tmp_path / "chain")
    assert list(tmp_path.iterdir()) == []
