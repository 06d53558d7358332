"""Reading a run folder, and evaluating its fields."""

import json

import numpy as np
import pytest
from run_folders import exact, make_run

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import load_result, load_results
from ffsi.result.quantities import flatten, unit

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
