"""Reading a run folder, and evaluating its fields."""

import json
import re
import threading
from dataclasses import replace

import meshio
import numpy as np
import pytest
from run_folders import exact, given_state, make_run, structured_mesh

from ffsi.files import folder, seals
from ffsi.files.arrays import write_state
from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMNotFound
from ffsi.hemodynamics.result import load_result, load_results
from ffsi.result.fields import Fields
from ffsi.result.quantities import flatten, unit
from ffsi.result.vtu import write_vtu
from ffsi.run import chain, one_scene
from ffsi.scene import CASES, SceneError, load_scene, with_values

result = pytest.fixture(lambda tmp_path: load_result(make_run(tmp_path / "run")))


def test_a_result_reads_scene_history_and_fields(result):
    assert (result.status, result.converged, result.reason, result.point) == ("converged", True, "", 1)
    assert result.quantities["drag"] == 0.24 and result.parameters["inflow.mean_velocity"] == 0.12
    assert result.scene.name == "flap-svk" and result.scene.mesh.level == 0
    assert result.history["residual"].tolist() == [1.0, 2e-1, 1e-6, 1e-12]
    points = np.random.default_rng(7).uniform([0, 0], [2.5, 0.4], (400, 2))
    table, expected = result.sample(points), exact(*points.T)
    for name in ("ux", "uy", "vx", "vy"):
        np.testing.assert_allclose(table[name], expected[name], rtol=0, atol=1e-14, err_msg=name)
    fluid = table["region"] == 1
    assert 0 < (~fluid).sum() < 100
    np.testing.assert_allclose(table["p"][fluid], expected["p"][fluid], rtol=0, atol=1e-13)
    assert table["p"][~fluid].isna().all()


@pytest.mark.parametrize("point", [(0, 0), (2.5, 0.4), (0, 0.17), (1.1, 0), (1.3, 0.4), (2.5, 0.05), (1 / 3, 0.4)])
def test_points_on_the_boundary_are_inside(result, point):
    expected = exact(*point)
    assert result.at(*point)["vy"] == pytest.approx(expected["vy"], abs=1e-13)


@pytest.mark.parametrize("point", [(0.5, 0.1), (0.75, 0.03), (0.6, 0.2)])
def test_on_the_interface_the_fluid_answers(result, point):
    found = result.at(*point)
    assert found["region"] == 1 and found["p"] == pytest.approx(exact(*point)["p"], abs=1e-13)


def test_points_in_solids_outside_and_in_the_order_of_vtk(result):
    found = result.at(0.61, 0.11)
    assert found["region"] == 2 and np.isnan(found["p"])
    with pytest.raises(ValueError, match=r"\(2.6, 0.1\) is outside of the reference mesh of flap-svk"):
        result.at(2.6, 0.1)
    table = result.sample([[2.6, 0.1], [1.0, 0.1]])
    assert table["vx"].isna().tolist() == [True, False]
    with pytest.raises(ValueError, match="shape"):
        result.sample([1.0, 2.0, 3.0])
    mesh = result.mesh
    assert [block.type for block in mesh.cells] == ["triangle6"]
    cells, points = mesh.cells[0].data, mesh.points
    for middle, (a, b) in enumerate([(0, 1), (1, 2), (2, 0)], start=3):
        np.testing.assert_allclose(
            points[cells[:, middle]], (points[cells[:, a]] + points[cells[:, b]]) / 2, atol=1e-15
        )
    assert mesh.point_data["displacement"].shape == (len(points), 3)
    np.testing.assert_allclose(mesh.point_data["velocity"][:, 0], exact(points[:, 0], points[:, 1])["vx"], atol=1e-14)
    assert sorted(np.unique(mesh.cell_data["region"][0])) == [1, 2]


def test_html_shows_numbers_and_a_picture_and_escapes_text(tmp_path):
    broken = load_result(make_run(tmp_path / "run", status="failed", reason="J < 0 & <b>folded</b>"))
    html = broken._repr_html_()
    assert "J &lt; 0 &amp; &lt;b&gt;folded&lt;/b&gt;" in html and "<td>0.24</td><td>N/m</td>" in html
    assert "data:image/png;base64,iVBORw0KGgo" in html


def test_a_run_without_a_saved_state_says_why_there_are_no_fields(tmp_path):
    result = load_result(make_run(tmp_path / "run", state=None, status="failed", reason="died early", failure="crash"))
    assert result.state_file is None
    with pytest.raises(InputError, match=r"no fields of point 1: died early"):
        _ = result.fields
    assert "img" not in result._repr_html_()


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda path: (path / "scene.toml").unlink(), "is no run folder"),
    (lambda path: (path / "result.json").unlink(), "cannot read .*result.json"),
    (lambda path: (path / "result.json").write_text("{"), "no valid JSON"),
    (lambda path: (path / "result.json").write_text("[1]"), "holds no JSON object"),
    (lambda path: (path / "result.json").write_text('{"case": "x"}'), "lacks status"),
])  # fmt: skip
def test_damaged_folders_are_refused(tmp_path, spoil, message):
    path = make_run(tmp_path / "run")
    spoil(path)
    with pytest.raises(InputError, match=message):
        load_result(path)


def test_missing_folders_units_and_strict_json(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        load_result(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"result-0002\.json"):
        load_result(make_run(tmp_path / "run"), point=2)
    assert [item.point for item in load_results(make_run(tmp_path / "other"))] == [1]
    values = {"drag": {"mean": 1, "amplitude": 2.0, "frequency": None}, "lift": 3, "word": "x"}
    assert flatten(values) == {"drag_mean": 1.0, "drag_amplitude": 2.0, "lift": 3.0}
    units = {"drag": "N/m", "drag_mean": "N/m", "lift_amplitude": "N/m", "lift_frequency": "Hz", "tip_uy": "m"}
    assert {name: unit(name) for name in units} == units
    assert unit("drag_coefficient") == unit("drag_coefficient_amplitude") == unit("min_jacobian_fluid") == "1"
    assert unit("drag_cylinder") == unit("lift_surface") == unit("drag_flap_mean") == "N/m"
    assert unit("min_jacobian_fluid_x") == "m"


def test_json_is_strict_and_written_whole(tmp_path):
    path = tmp_path / "a.json"
    folder.write_json(path, {"a": float("nan"), "b": np.float64(2), "c": [np.int64(3), float("inf")]})
    assert json.loads(path.read_text()) == {"a": None, "b": 2.0, "c": [3, None]}
    with pytest.raises(TypeError):
        folder.write_json(path, {"a": object()})
    assert json.loads(path.read_text())["b"] == 2.0 and [item.name for item in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(("name", "prepare", "message"), [
    ("file", lambda path: path.write_text("x"), "is a file"),
    ("other", lambda path: (path.mkdir(), (path / "thesis.tex").write_text("x")), "no run folder of ffsi"),
    ("sweep", lambda path: (path.mkdir(), (path / "sweep.toml").write_text("")), "holds a sweep"),
])  # fmt: skip
def test_foreign_folders_are_not_touched(tmp_path, name, prepare, message):
    path = tmp_path / name
    prepare(path)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError, match=message):
        folder.prepare(path)
    assert sorted(tmp_path.rglob("*")) == before


def test_an_earlier_run_is_cleared_but_other_files_stay(tmp_path):
    path = make_run(tmp_path / "run")
    (path / "notes.txt").write_text("mine")
    folder.prepare(path)
    assert [item.name for item in path.iterdir()] == ["notes.txt"]


def test_round_trip_keeps_every_bit(tmp_path, fields):
    write_vtu(tmp_path / "fields.vtu", fields)
    back = meshio.read(tmp_path / "fields.vtu")
    assert [block.type for block in back.cells] == ["triangle6"]
    np.testing.assert_array_equal(back.points[:, :2], fields.points)
    np.testing.assert_array_equal(back.cells[0].data, fields.cells)
    np.testing.assert_array_equal(back.cell_data["region"][0], fields.region)
    for name in ("displacement", "velocity"):
        np.testing.assert_array_equal(back.point_data[name][:, :2], getattr(fields, name), err_msg=name)
    np.testing.assert_array_equal(back.point_data["pressure"], fields.pressure)
    assert [item.name for item in tmp_path.iterdir()] == ["fields.vtu"]


@pytest.fixture
def mixed() -> Fields:
    """The block of region 2 is mixed, with a pressure that is linear on it and zero at other vertices."""
    mesh, pressure = structured_mesh(5, 2), np.zeros((1, 18))
    inside = np.unique(mesh.triangles[mesh.region == 2])
    pressure[0, inside] = 1.0 + mesh.vertices[inside] @ [2.0, 3.0]
    return Fields.from_raw(mesh, replace(given_state(mesh), ps=pressure), [2])


def test_pressures_of_mixed_solids_are_kept_where_they_are(mixed, tmp_path, fields):
    inside = np.isin(np.arange(len(mixed.points)), mixed.cells[mixed.region == 2])
    np.testing.assert_allclose(mixed.solid_pressure[inside], 1.0 + mixed.points[inside] @ [2.0, 3.0], rtol=1e-14)
    assert (mixed.solid_pressure[~inside] == 0.0).all() and inside.any() and not inside.all()
    write_vtu(tmp_path / "mixed.vtu", mixed)
    found = meshio.read(tmp_path / "mixed.vtu").point_data["solid_pressure"]
    np.testing.assert_array_equal(found, mixed.solid_pressure)
    write_vtu(tmp_path / "fields.vtu", fields)
    assert "solid_pressure" not in meshio.read(tmp_path / "fields.vtu").point_data


def test_pressures_belong_to_their_solids(tmp_path):
    run = make_run(tmp_path / "run", "flap-neo-hookean")
    scene, mesh = with_values(CASES["flap-neo-hookean"], {"solid.flap.formulation": "mixed"}), structured_mesh()
    (run / "scene.toml").write_text(scene.to_toml())
    write_state(run / "point-0001.bin", replace(given_state(mesh), ps=np.ones((1, len(mesh.vertices)))))
    data = json.loads((run / "result.json").read_text())
    seals.write(run / "result.json", data | {"files": seals.seal_all(run, ("point-*.bin", "scene.toml"))})
    fields = load_result(run).fields
    np.testing.assert_array_equal(np.flatnonzero(fields.solid_pressure), np.unique(mesh.p2[mesh.region == 2]))
    mesh = structured_mesh(5, 2)
    with pytest.raises(ValueError, match="pressures of 0 mixed solids, the scene has 1"):
        Fields.from_raw(mesh, given_state(mesh), [2])


def test_file_is_compressed_binary_with_vectors_that_paraview_can_warp_by(tmp_path, fields):
    write_vtu(tmp_path / "fields.vtu", fields)
    head = (tmp_path / "fields.vtu").read_bytes().decode("latin-1")
    assert 'compressor="vtkZLibDataCompressor"' in head and 'format="ascii"' not in head
    for name in ("displacement", "velocity"):
        array = next(tag for tag in re.findall("<DataArray[^>]*>", head) if f'Name="{name}"' in tag)
        assert 'NumberOfComponents="3"' in array


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


@pytest.mark.parametrize("error", [ValueError, RuntimeError])
def test_a_check_that_cannot_be_done_is_a_failure(tmp_path, freefem, monkeypatch, scene, error):
    def refuse(*_, **__):
        raise error("parameters differ")

    monkeypatch.setattr("ffsi.reference.check_run", refuse)
    result = one_scene.solve(scene, tmp_path / "run")
    assert (result.failure, result.solved) == ("check", True)
    assert result.reason == "the reference check could not be done: parameters differ"


def test_not_converged_keeps_the_last_state_and_is_not_checked(tmp_path, freefem, check, scene):
    freefem.fail = 0.12
    result = one_scene.solve(scene, tmp_path / "run")
    assert (result.status, result.failure, result.reason) == ("failed", "not-converged", "J too small")
    assert check.calls == [] and (tmp_path / "run" / "fields.vtu").is_file()
    assert "last converged state" in result.title
    full = load_scene("flap-svk", [])
    assert result.at(0.61, 0.11)["uy"] == pytest.approx(0.5 * -0.05 * 0.11**2) and full.name == result.scene.name


def test_nothing_is_written_without_freefem(tmp_path, no_freefem, scene):
    with pytest.raises(FreeFEMNotFound):
        one_scene.solve(scene, tmp_path / "new")
    assert list(tmp_path.iterdir()) == []


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
