"""Pictures, curves and the HTML report."""

import base64
import io
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from PIL import Image
from run_folders import exact, make_run, report_text
from test_hemodynamics import channel, poiseuille, state

from ffsi.files.arrays import write_arrays, write_mesh, write_state
from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result, load_result
from ffsi.hemodynamics.walls import wall_points
from ffsi.report import blocks, blood, curves, formulas, history, walls, write_report
from ffsi.result import gradients, painting, pictures, views
from ffsi.result.fields import Fields
from ffsi.result.words import tally
from ffsi.run import one_scene, sweep
from ffsi.scene import CASES, Scene, load_scene

KEY = "inflow.mean_velocity"


def pixels(figure) -> np.ndarray:
    png = figure if isinstance(figure, bytes) else pictures.to_png(figure, dpi=60)
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def colours(image: np.ndarray) -> int:
    return len(np.unique(image.reshape(-1, 3), axis=0))


@pytest.mark.parametrize("name", ["velocity", "pressure", "displacement"])
def test_pictures_show_something(fields, name):
    """What a run leaves is what matplotlib draws, but for letters and the edges of lines."""
    for scale, tall in ((1, 1), (-1e-6, 4)):
        shaped = {key: getattr(fields, key) * np.array([1, tall]) for key in ("points", "displacement", "velocity")}
        shown = replace(fields, **shaped, pressure=scale * fields.pressure)
        drawn = Image.open(io.BytesIO(pictures.to_png(pictures.draw(name, shown, "title")))).convert("RGB")
        painted = pixels(painting.paint(name, shown, "title"))
        assert painted.shape == (drawn.height, drawn.width, 3) and (painted.min(axis=2) < 200).mean() > 0.05
        smooth = [np.asarray(Image.fromarray(each).reduce(4), dtype=int) for each in (painted, np.asarray(drawn))]
        difference = abs(smooth[0] - smooth[1])
        assert difference.mean() < 4 and (difference.max(axis=2) > 40).mean() < 0.03


def test_pictures_lie_flat_on_the_deformed_mesh(fields):
    """A flow that is linear on the deformed mesh has one vorticity everywhere, whatever the mesh's motion."""
    x, y = fields.deformed.T
    turning = replace(fields, velocity=np.column_stack([3 * y - 1, 7 * x + y]))
    found, fluid = gradients.vorticity(turning), np.unique(fields.cells[fields.region == 1])
    np.testing.assert_allclose(found[fluid], 4.0, rtol=1e-10)
    assert np.isnan(np.delete(found, fluid)).all() and colours(pixels(pictures.vorticity(fields))) > 100
    stress = np.full(len(x), np.nan)
    stress[np.unique(fields.cells[fields.region == 2])] = 1.0
    _, bar = pictures.nodal(fields, stress, "effective stress (Pa)").axes
    assert bar.get_xlabel() + bar.get_ylabel() == "effective stress (Pa)"
    with pytest.raises(ValueError, match="no value of the stress"):
        pictures.nodal(fields, np.full(len(x), np.nan), "stress")
    solid = np.round(255 * np.array(to_rgb(views.SOLID_COLOURS[0])))
    image = pixels(pictures.velocity(fields))
    assert (np.abs(image - solid).max(axis=2) <= 2).mean() > 0.005
    still = Fields(**{**vars(fields), "displacement": np.zeros_like(fields.displacement)})
    assert not np.array_equal(pixels(pictures.velocity(still)), pixels(pictures.velocity(fields)))
    figure = pictures.velocity(fields)
    pictures.to_png(figure)  # lays it out
    width, height = figure.get_size_inches()
    assert width > 2 * height
    axes = figure.axes[0]
    box = axes.get_window_extent()
    assert box.width / box.height == pytest.approx(np.ptp(axes.get_xlim()) / np.ptp(axes.get_ylim()), rel=1e-6)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_pictures_are_the_same_in_other_units(fields, unit):
    """But for the numbers at their axes; a thousandth of the pixels is rounding."""
    scaled = replace(
        fields, points=unit * fields.points, displacement=unit * fields.displacement, velocity=unit * fields.velocity,
        pressure=unit * fields.pressure,
    )  # fmt: skip
    for name in views.available(fields):
        plain, other = pictures.draw(name, fields), pictures.draw(name, scaled)
        for figure in (plain, other):
            for axes in figure.axes:
                axes.set_axis_off()
        difference = pixels(plain).astype(int) - pixels(other).astype(int)
        assert (abs(difference) > 60).any(axis=-1).mean() < 1e-3


@pytest.mark.parametrize("name", ["velocity", "pressure", "displacement"])
def test_a_value_that_is_no_number_is_not_drawn(fields, name):
    values = getattr(fields, name).copy()
    values[fields.cells[fields.region == (2 if name == "displacement" else 1)][0, 0]] = np.nan
    with pytest.raises(ValueError, match="holds a value that is not finite"):
        painting.paint(name, replace(fields, **{name: values}))


def test_a_folded_mesh_is_drawn(fields):
    """Matplotlib's own finder of triangles refuses it."""
    shift = 0.1 * np.random.default_rng(1).normal(size=fields.displacement.shape)
    folded = replace(fields, displacement=fields.displacement + shift)
    for name in views.available(fields):
        assert pixels(pictures.draw(name, folded)).std() > 10 < pixels(painting.paint(name, folded)).std()
    assert any(isinstance(artist, Quiver) for artist in pictures.draw("velocity", folded).axes[0].collections)


@pytest.mark.parametrize("value", [1e-9, 1e9, 0.0])
def test_a_constant_pressure_has_levels_of_its_size(value):
    levels, _ = views.pressure_levels(np.array([value, value * (1 + 1e-15)]))
    assert levels[0] <= value <= levels[-1] and levels[-1] - levels[0] <= 2 * (value or 1.0)


def test_available_pictures_their_levels_and_numbers(fields):
    fluid = Fields(**{**vars(fields), "region": np.ones_like(fields.region)})
    solid = Fields(**{**vars(fields), "region": np.full_like(fields.region, 2)})
    assert views.available(fields) == ["velocity", "pressure", "displacement"]
    assert views.available(fluid) == ["velocity", "pressure"] and views.available(solid) == ["displacement"]
    for other in (fluid, solid):
        for name in views.available(other):
            assert colours(pixels(painting.paint(name, other))) > 100
    with pytest.raises(ValueError, match="no picture 'pressure' of these fields; there is displacement"):
        pictures.draw("pressure", solid)
    zero = {name: np.zeros_like(getattr(fields, name)) for name in ("displacement", "velocity", "pressure")}
    for name in views.available(fields):
        assert colours(pixels(painting.paint(name, Fields(**{**vars(fields), **zero})))) > 10
    levels, palette = views.pressure_levels(np.linspace(-1.0, 1.0, 1001))
    assert palette == "RdBu_r" and levels[0] == -levels[-1]
    levels, palette = views.pressure_levels(np.append(np.linspace(0.0, 1.0, 1000), 1e6))
    assert palette != "RdBu_r" and levels[-1] < 2.0
    for step in (0.0025, 0.005, 0.01, 0.02):
        ticks = views.every_other(np.arange(-12, 14) * step)
        distance = ticks[1] - ticks[0]
        assert 3 <= len(ticks) <= 9
        assert np.isclose(distance / 10 ** np.floor(np.log10(distance) + 1e-9), [1, 2, 2.5, 5]).any()
        assert np.abs(ticks).min() == 0


def test_arrows_and_the_shape_before_the_deformation(fields):
    figure = pictures.velocity(fields)
    (arrows,) = [item for item in figure.axes[0].collections if hasattr(item, "U")]
    assert 20 < len(arrows.U) <= views.ARROWS
    x, y = arrows.X, arrows.Y  # on the deformed mesh; the solid stands on x = 0.5 to 0.75
    assert not ((x > 0.52) & (x < 0.73) & (y < 0.15)).any()
    still = Fields(**{**vars(fields), "displacement": np.zeros_like(fields.displacement)})
    (arrows,) = [item for item in pictures.velocity(still).axes[0].collections if hasattr(item, "U")]
    flow = exact(np.asarray(arrows.X), np.asarray(arrows.Y))
    cosine = (arrows.U * flow["vx"] + arrows.V * flow["vy"]) / np.hypot(arrows.U, arrows.V)
    np.testing.assert_allclose(cosine, np.hypot(flow["vx"], flow["vy"]), rtol=0.02)
    loops = views.loops(views.outer_edges(fields, fields.region == 2))
    assert len(loops) == 1 and loops[0][0] == loops[0][-1]
    corners = fields.points[loops[0]]
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[0.5, 0.0], [0.75, 0.2]])
    assert np.abs(np.diff(corners, axis=0)).sum() == pytest.approx(0.9)


@pytest.mark.parametrize("maximum", [150_000, 40_000])
def test_small_pictures_keep_their_limit_and_look_the_same(fields, maximum):
    figure = pictures.velocity(fields)
    data = pictures.to_small_png(figure, maximum=maximum)
    assert len(data) <= maximum < len(pictures.to_png(figure))
    small = Image.open(io.BytesIO(data)).convert("RGB")
    there = np.asarray(Image.open(io.BytesIO(pictures.to_png(figure))).convert("RGB").resize(small.size), dtype=int)
    assert np.abs(np.asarray(small, dtype=int) - there).mean() < 4


def test_curves_stay_white_and_mark_what_failed():
    figure = curves.sweep_curves(table(min_jacobian=[0.9, 0.8, np.nan]), [KEY])
    image = np.asarray(Image.open(io.BytesIO(pictures.to_small_png(figure, maximum=60_000))).convert("RGB"))
    assert tuple(image[1, 1]) == (255, 255, 255)
    figure = curves.sweep_curves(table(min_jacobian=[0.9, 0.8, np.nan], min_jacobian_solid=[0.9, 0.8, np.nan]), [KEY])
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in shown] == ["Drag", "Lift", "Smallest J = det F"]
    np.testing.assert_allclose(shown[0].lines[0].get_xydata(), [[0.01, 1.0], [0.02, 2.0]])
    assert "not converged" in [text.get_text() for text in shown[0].get_legend().get_texts()]
    assert shown[0].get_xlabel() == "mean inflow velocity (m/s)" and colours(pixels(figure)) > 50
    both = pd.concat([table(**{"mesh.level": [0] * 3}), table(**{"mesh.level": [1] * 3})])
    figure = curves.sweep_curves(both, ["mesh.level", KEY])
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["0", "1", "not converged"]
    assert legend.get_title().get_text() == "mesh level"
    figure = curves.sweep_curves(table(roof_ux=[0.0, 0.1, np.nan], roof_uy=[0.1, 0.2, np.nan]), [KEY])
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    roof = figure.axes[titles.index("Displacement of the roof's middle")]
    assert [text.get_text() for text in roof.get_legend().get_texts()] == ["$u_x$", "$u_y$", "not converged"]


def table(**columns) -> pd.DataFrame:
    points = {KEY: [0.01, 0.02, 0.03], "status": ["converged", "converged", "failed"]}
    return pd.DataFrame(points | {"drag": [1.0, 2.0, np.nan], "lift": [0.1, 0.2, np.nan]} | columns)


def test_plot_takes_any_column_of_values():
    values = {"solid.flap.material": ["svk", "$", None], "output.vtu": [True, False, None], "mesh.level": [0.0, 1, 2]}
    drags = {"drag_mean": [1.0, 2, np.nan], "drag_min": [0.5, 1, np.nan], "drag_max": [2.0, 3, np.nan], "drag": np.nan}
    points = table(**values, **drags)
    for x, by in zip((*values, KEY), (KEY, *values), strict=True):
        figure = curves.plot(points, x, "drag", by)
        assert figure.axes[0].get_ylabel() == "drag, mean (N/m)" and colours(pixels(figure)) > 20
    axes = curves.plot(points, "solid.flap.material", "drag_mean", units={"drag_mean": "kN/m"}).axes[0]
    assert axes.get_ylabel() == "drag, mean (kN/m)"
    assert [text.get_text() for text in axes.get_xticklabels()] == ["svk", r"\$", "unset"]
    assert [line.get_xdata().tolist() for line in axes.lines] == [[0, 1], [2]]  # the cross of the failed point is last


@pytest.mark.parametrize(
    ("y", "said"), [("drga", 'mean "drag"'), ("status", "holds no numbers"), ("x", "there is inflow")]
)
def test_plot_refuses_what_it_cannot_draw(y, said):
    with pytest.raises(InputError, match=said):
        curves.plot(table(), KEY, y)


def test_scales_heat_maps_and_main_effects():
    many = pd.concat([table(**{"fluid.viscosity": 10.0**i}) for i in range(curves.MOST + 1)], ignore_index=True)
    figure = curves.plot(many, KEY, "drag", "fluid.viscosity")
    axes, bar = figure.axes
    assert bar.get_ylabel() == "dynamic viscosity (Pa s)" and bar.get_yscale() == "log"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["not converged"]
    assert len({line.get_color() for line in axes.lines if len(line.get_xdata()) == 2}) == curves.MOST + 1
    short = table(**{KEY: [0.01, 0.05, 0.06], "drag": [3.0, 4.0, np.nan]})[[KEY, "status", "drag"]]
    figure = curves.compare_sweeps({"long": table(), "short": short}, KEY, curves.PANELS)
    drag, lift = figure.axes
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["Drag", "Lift"]
    assert drag.get_xlim() == lift.get_xlim()
    np.testing.assert_allclose(drag.lines[0].get_ydata(), [1.0, 2.0])
    assert [line.get_linestyle() for line in drag.lines if len(line.get_xdata()) == 2] == ["-", "--"]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["long", "short", "not converged"]
    assert curves.compare_sweeps({"one": table(status=["failed"] * 3)}, KEY, curves.PANELS) is None
    both = pd.concat([table(**{"mesh.level": i, "drag": [i, 10 * i, np.nan]}) for i in (1, 2)], ignore_index=True)
    figure = curves.heat_maps(both, ["mesh.level", KEY])
    axes = figure.axes[0]
    np.testing.assert_array_equal(axes.images[0].get_array().filled(-1), [[1, 10, -1], [2, 20, -1]])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("mean inflow velocity (m/s)", "mesh level")
    assert sorted(text.get_text() for text in axes.texts) == ["1", "10", "2", "20"]
    assert axes.lines[0].get_xydata().tolist() == [[2, 0], [2, 1]]
    assert curves.heat_maps(both[1:], ["mesh.level", KEY]) is None
    figure = curves.main_effects(both[1:], ["mesh.level", KEY])
    assert figure.axes[0].get_ylabel() == "drag (N/m)"
    np.testing.assert_allclose(figure.axes[0].lines[1].get_xydata(), [[1, 10], [2, 11]])
    assert curves.main_effects(table(), [KEY]) is None


def test_failed_points_tiny_values_and_nothing_to_draw():
    both = table(status=["converged", "failed", "failed"], failure=["", "not-converged", "not-reached"])
    axes = curves.sweep_curves(both, [KEY]).axes[0]
    (marks,) = [line for line in axes.lines if line.get_marker() == "x"]
    assert marks.get_xdata().tolist() == [0.02]
    figure = curves.sweep_curves(table(lift=[1e-6, -9e-6, np.nan]), [KEY])
    pictures.to_png(figure, dpi=40)
    assert figure.axes[1].yaxis.get_offset_text().get_text() != ""
    assert figure.axes[0].yaxis.get_offset_text().get_text() == ""
    assert curves.sweep_curves(table()[:1], [KEY]) is None
    assert curves.sweep_curves(table(status=["failed"] * 3), [KEY]) is None
    empty = pd.DataFrame({"residual": [], "stage": [], "unknowns": [], "factorized": []})
    assert history.newton_history(empty) is None


def test_newton_history_is_logarithmic(tmp_path):
    figure = history.newton_history(load_result(make_run(tmp_path / "run")).history)
    assert figure.axes[0].get_yscale() == "log" and colours(pixels(figure)) > 50


def test_report_of_a_run(tmp_path):
    html = report_text(tmp_path, make_run(tmp_path / "run"))
    assert html.count("data:image/png;base64,") == 7  # domain, five fields, Newton's history
    assert len(html) < 1_000_000 and not re.findall(r"(?:src|href)=\"(?!data:|#)", html)
    for text in ("solved and checked", "<td>momentum</td>", "1.0e-11", "inflow.mean_velocity", "<td>drag</td>",
                 "Reynolds number", "<td>m/s</td>", "ffsi run flap-svk "):  # fmt: skip
        assert text in html
    assert "Formulas: the paper and the standard form" in html and "ρ η ∂u<sub>t</sub>/∂n" in html
    assert "(0.01 m here)" in html


ESTIMATED = {"drag": {"value": 14.3, "estimate": -0.02, "bar": 0.06}, "lift": {"value": 0.77}}
MESHES = [{"unknowns": 400 * n, "triangles": 50 * n, "quantities": ESTIMATED} for n in (1, 2)]
TO_1_PERCENT = {"tolerance": 0.01, "unknowns": 0, "rounds": MESHES}


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"errors": {"drag": {}}}, "ffsi run turek-fsi1 --set mesh.level=0 --error --out run"),
        ({"adaptation": TO_1_PERCENT, "errors": {"drag": {}}}, "--adapt drag,lift --tolerance 0.01 --out run"),
        ({"adaptation": TO_1_PERCENT | {"tolerance": 0, "unknowns": 9000}}, "--adapt drag,lift --unknowns 9000 --out"),
        ({"sensitivities": {"drag": {}}}, "ffsi sensitivities turek-fsi1 --set mesh.level=0 --out run"),
    ],
)
def test_the_command_of_a_run_says_what_it_was_asked_for(data, said, tmp_path, quick, no_pictures):
    html = report_text(tmp_path, make_run(tmp_path / "run", case="turek-fsi1", **data))
    assert said in html and ("14.3 ± 0.06 (-0.02)" in html and "Sizes of the estimated errors" in html) == (
        "adaptation" in data
    )


def test_remarks_follow_material_and_density():
    topics = {
        name: {remark.topic: remark.here for remark in formulas.remarks(load_scene(name, []))}
        for name in ("flap-svk", "flap-neo-hookean", "flap-mooney-rivlin", "turek-fsi1", "turek-csm1")
    }
    assert topics["turek-fsi1"] == topics["turek-csm1"] == {}
    assert "compressible St. Venant-Kirchhoff law, Poisson's ratio 0.4" in topics["flap-svk"]["Volume of the solid"]
    assert "Neo-Hookean energy" in topics["flap-neo-hookean"] and "Neo-Hookean energy" not in topics["flap-svk"]
    assert "Young's modulus 48.1 Pa and Poisson's ratio −0.931" in topics["flap-mooney-rivlin"]["Bulk modulus"]
    stiff = formulas.remarks(load_scene("flap-mooney-rivlin", ["solid.flap.bulk_modulus=1.75e4"]))
    (bulk,) = [remark.here for remark in stiff if remark.topic == "Bulk modulus"]
    assert "Poisson's ratio 0.49" in bulk and "slip" not in bulk
    assert "so the number is the same" in formulas.remarks(load_scene("flap-svk", []))[0].here
    assert "would differ by this factor" in formulas.remarks(load_scene("flap-svk", ["fluid.density=2"]))[0].here


def test_formulas_belong_to_the_flap_only(tmp_path, quick, no_pictures):
    html = report_text(tmp_path, make_run(tmp_path / "run", case="turek-fsi1"))
    assert "Formulas" not in html and "14.29426" in html


def test_text_is_escaped_everywhere(tmp_path, quick):
    evil = "<script>alert('x')</script>"
    path = make_run(
        tmp_path / "run", case_name=evil, status="failed", failure="check", reason=evil,
        parameters={evil: 1.0}, quantities={evil: 2.0}, freefem={"version": evil, "solver": evil},
    )  # fmt: skip
    html = report_text(tmp_path, path, title=evil)
    assert "<script>alert" not in html and html.count("&lt;script&gt;") >= 6
    write_report([path], tmp_path / "report.md", title=evil)
    assert not re.search(r"(?<!\\)<script", (tmp_path / "report.md").read_text())


def test_report_of_a_sweep(tmp_path, quick, freefem, check):
    freefem.fail = 0.03
    scene = load_scene("flap-svk", ["mesh.level=0", "output.pictures=false"])
    sweep.sweep(scene, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "sweep")
    html = report_text(tmp_path, tmp_path / "sweep")
    settings = "--set mesh.level=0 --set output.pictures=false"
    assert f"ffsi sweep flap-svk {settings} --vary {KEY}=0.01,0.02,0.03 --out sweep" in html
    assert "flap-svk, sweep over mean inflow velocity" in html
    assert "2 of 3 points solved and checked; 1 not converged" in html and "J too small" in html
    assert "inflow.mean_velocity = 0.02" in html
    assert html.count("data:image/png;base64,") == 10  # curves, two points in the gallery, domain, five fields, Newton
    table = re.search(r'download="sweep.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)"', html)
    assert base64.b64decode(table.group(1)).decode() == (tmp_path / "sweep" / "sweep.csv").read_text()


@pytest.fixture
def no_pictures(monkeypatch):
    """They take longer than all the rest of a report."""
    monkeypatch.setattr(pictures, "draw", lambda *_, **__: None)
    monkeypatch.setattr(pictures, "to_png", lambda *_, **__: b"")


def test_only_what_was_checked_is_called_so(tmp_path, quick, freefem, check, no_pictures):
    """In the heading, in the table and in the colour of a sweep and of a run."""
    scene = load_scene("flap-svk", ["mesh.level=0"])
    sweep.sweep(scene, {KEY: [0.01, 0.02]}, tmp_path / "all")
    sweep.sweep(scene, {KEY: [0.01, 0.02]}, tmp_path / "none", check=False)
    check.wrong = 0.02
    sweep.sweep(scene, {KEY: [0.01, 0.02, 0.03]}, tmp_path / "one")
    (tmp_path / "one" / "chain-001" / "result-0003.json").unlink()
    (tmp_path / "one" / "sweep.csv").unlink()
    for name, words, good in (
        ("all", "all 2 points solved and checked", True),
        ("none", "0 of 2 points solved and checked; 2 solved, not checked", False),
        ("one", "1 of 3 points solved and checked; 1 failed the check; 1 not computed", False),
    ):
        html = report_text(tmp_path, tmp_path / name)
        assert f'<span class="status {"good" if good else "bad"}">{words}</span>' in html
    one_scene.solve(scene, tmp_path / "run", check=False)
    assert '<span class="status bad">solved, not checked</span>' in report_text(tmp_path, tmp_path / "run")


@pytest.mark.parametrize(("failures", "checked", "words"), [
    (["", "", ""], [True, True, True], "all 3 points solved and checked"),
    (["", None, ""], [True, False, True], "2 of 3 points solved and checked; 1 solved, not checked"),
    (["crash", "check", "stopped"], [False] * 3,
     "0 of 3 points solved and checked; 1 FreeFEM died; 1 failed the check; 1 stopped before its end"),
])  # fmt: skip
def test_a_tally_takes_the_table_s_word(failures, checked, words):
    status = ["failed" if failure else "converged" for failure in failures]
    table = pd.DataFrame({"status": status, "failure": failures, "checked": checked, "check_maximum": 1e-12})
    assert tally(table) == (words, "all" in words) and tally(table, 5)[0].endswith("; 2 not computed")


def test_warnings_and_what_could_not_be_evaluated_stand_in_the_report(tmp_path, quick, monkeypatch):
    notes = [{"what": "effective stress", "why": "no <law>"}]
    folder = make_run(tmp_path / "run", warnings=["time.step is long"], not_evaluated=notes)
    pictures = Result.picture
    monkeypatch.setattr(Result, "picture", lambda self, name: pictures(self, name if name == "pressure" else "none"))
    html = report_text(tmp_path, folder)
    first = html.index('<section id="first"'), html.index('<section id="s1"')
    for text in ("time.step is long", "not evaluated: effective stress: no &lt;law&gt;",
                 "not evaluated: picture of the velocity: no picture"):  # fmt: skip
        assert first[0] < html.index(text) < first[1]
    assert html.count("data:image/png;base64,") == 5  # all but those two
    assert 'class="status bad">solved and checked' in html


def test_warnings_of_a_sweep_are_counted(tmp_path, quick, freefem, check, monkeypatch):
    monkeypatch.setattr(painting, "paint", lambda *_, **__: 1 / 0)
    scene = load_scene("flap-svk", ["mesh.level=0"])
    table = sweep.sweep(scene, {KEY: [0.01, 0.02]}, tmp_path / "sweep")
    assert table["status"].tolist() == ["converged"] * 2
    assert table["not_evaluated"].str.count("division by zero").tolist()[1] == 3  # the point that is drawn
    monkeypatch.undo()
    html = report_text(tmp_path, tmp_path / "sweep")
    assert "not evaluated: picture of the pressure: division by zero (1 of 2 points)" in html
    assert '<span class="status bad">all 2 points solved and checked</span>' in html


def test_report_needs_results(tmp_path):
    with pytest.raises(InputError, match="at least one"):
        write_report([], tmp_path / "report.html")
    with pytest.raises(InputError, match="is no run folder"):
        write_report([tmp_path], tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "study").mkdir()
    (tmp_path / "study/sweep.toml").touch()
    with pytest.raises(InputError, match=r"is no run folder of ffsi; it holds .*study$"):
        write_report([tmp_path], tmp_path / "report.html")


PERIOD = 0.5


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody looks at the pictures of these reports."""
    monkeypatch.setattr(blocks, "DPI", 20)


def vessel(directory: Path, cycles: int = 0) -> Path:
    """Write the run folder of a channel with Carreau blood whose stress is 0.03 Pa; in time in cycles of it."""
    directory.mkdir()
    table: dict[str, Any] = {
        "name": "vessel", "geometry": {"kind": "channel", "length": 2.0, "height": 0.5},
        "fluid": {"law": "carreau", "density": 1000.0, "viscosity_zero": 0.02, "viscosity_infinity": 0.02},
        "inflow": {"mean_velocity": 0.125}, "outlet": {"kind": "do-nothing"},
    }  # fmt: skip
    if cycles:
        table["inflow"] |= {"waveform": "1 + sin(4 * pi * t)", "period": PERIOD}
        table |= {"time": {"step": 0.1, "end": 1.0}, "output": {"wall": {}}}
    scene, mesh = Scene.model_validate(table), channel()
    mesh = type(mesh)(**{**vars(mesh), "label": np.where(mesh.label == 4, 3, mesh.label)})
    write_mesh(directory / "mesh.bin", mesh)
    write_state(directory / "point-0001.bin", state(mesh, poiseuille(mesh.p2_coordinates[:, 1])))
    (directory / "case.edp").write_text("// nothing\n")
    (directory / "scene.toml").write_text(scene.to_toml())
    data = {
        "case": "vessel", "status": "converged", "unknowns": 900, "triangles": 36, "state": "point-0001.bin",
        "parameters": scene.parameters(), "quantities": {}, "check": {}, "timings": {},
    }  # fmt: skip
    node = wall_points(mesh, [3]).middle
    for number in range(1, cycles + 1):
        x, zero, size, peak = (np.full(len(node), PERIOD * value) for value in (0.01 * number, 0.0, 0.03, 0.1))
        head, times = np.array([1, number, len(node)]), PERIOD * np.array([number - 1, number])
        write_arrays(directory / f"wall-{number:04d}.bin", [head, times, node, x, zero, size, peak])
    result = Result(scene, directory, data)
    assert result.walls is not None
    if cycles:
        last = result.walls.quantities
        data |= {"cycles": result.cycles, "time": {"reached": 1.0, "end": 1.0, "steps": 10, "last": last}}
        data["quantities"] = {name: value for name, value in result.cycles[-1].items() if "_" in name}
    else:
        data["quantities"] = result.walls.quantities
    (directory / "result.json").write_text(json.dumps(data))
    return directory


def drawn(result: Result) -> list[tuple[Figure, str]]:
    return [each for make in blood.PICTURES.values() for each in make(result)]


def rows(text: str, heading: str) -> list[list[str]]:
    table = re.search(rf"<h3>{re.escape(heading)}</h3>.*?</table>", text, re.DOTALL)
    assert table is not None, heading
    lines = re.findall(r"<tr>.*?</tr>", table.group(), re.DOTALL)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", line) for line in lines]


def test_steady(tmp_path: Path) -> None:
    text = report_text(tmp_path, vessel(tmp_path / "run"))
    assert text.count("data:image/png;base64,") == 5  # domain, velocity, pressure, vorticity, walls
    assert "Wall shear stress and pressure along the walls, one curve per connected line" in text
    assert rows(text, "Parts of the walls") == [
        ["part", "WSS mean (Pa)", "WSS max (Pa)", "WSS min (Pa)"], ["walls", "0.03", "0.03", "0.03"],
    ]  # fmt: skip
    names = [line[0] for line in rows(text, "Quantities")]
    assert "mass_balance" in names and not any(name.startswith("wss_") for name in names)
    assert "Cycles" not in text


def test_every_line_of_the_walls_has_a_curve(tmp_path: Path) -> None:
    text = report_text(tmp_path, vessel(tmp_path / "run", cycles=2))
    assert "relative residence time of cycle 2 along the walls" in text
    head, first, second = rows(text, "Cycles")
    assert head == [
        "cycle", "start (s)", "end (s)", "TAWSS mean, walls (Pa)", "OSI mean, walls", "TAWSS change", "OSI change",
    ]  # fmt: skip
    assert first == ["1", "0", "0.5", "0.03", "0.3333", "", ""]
    assert second == ["2", "0.5", "1", "0.03", "0.1667", "0.0e+00", "1.7e-01"]
    (head, line) = rows(text, "Parts of the walls, cycle 2")
    assert dict(zip(head, line, strict=True)) == {
        "part": "walls", **{f"TAWSS {what} (Pa)": "0.03" for what in ("mean", "max", "min")},
        **{f"OSI {what}": "0.1667" for what in ("mean", "max", "min")},
        **{f"RRT {what} (1/Pa)": "50" for what in ("mean", "max", "min")}, "WSS peak (Pa)": "0.05",
    }  # fmt: skip
    assert ["flow_rate_in", "0.0625", "m²/s"] in rows(text, "Flow at t = 1 s")
    ((figure, _),) = drawn(load_result(vessel(tmp_path / "other")))
    stress, pressure = figure.axes
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["0: walls", "1: walls"]
    assert [line.get_ydata() for line in stress.lines] == [pytest.approx(0.03)] * 2
    assert pressure.get_xlabel() == "distance along each wall in its direction, the fluid to the left (mm)"


def test_rounding_is_no_curve_and_the_flow_into_the_dome() -> None:
    arc = np.linspace(0, 1, 11)
    for size in (3.0, -3.0):
        table = pd.DataFrame({"arc": arc, "part": "walls", "wss": size + 1e-9 * arc})
        figure = walls.along_walls({"": table}, [("wss", "WSS (Pa)")])
        low, high = figure.axes[0].get_ylim()
        assert (low, high) == pytest.approx((size - 0.3, size + 0.3))
    last = {"flow_rate_in": 1e-4, "dome_inflow": 2e-6, "turnover_time": 0.5, "effective_stress_max_dome": 7.0, "x": 1.0}
    result: Any = SimpleNamespace(last_quantities=last, data={"time": {"reached": 2.0}})
    found = blood.flow_table(result)
    assert found is not None
    assert found.body == [
        ["flow_rate_in", "0.0001", "m²/s"], ["dome_inflow", "2e-06", "m²/s"], ["turnover_time", "0.5", "s"],
        ["effective_stress_max_dome", "7", "Pa"],
    ]  # fmt: skip
    assert blood.flow_table(SimpleNamespace(last_quantities=last, data={})) is None  # type: ignore[arg-type]


def test_other_scenes_have_nothing_of_it(tmp_path: Path) -> None:
    result = load_result(make_run(tmp_path / "run"))
    assert (drawn(result), blood.part_table(result), blood.cycle_table(result)) == ([], None, None)


def test_words_among_the_parameters(tmp_path: Path) -> None:
    text = report_text(tmp_path, vessel(tmp_path / "run", cycles=1))
    cells = re.findall(r"<tr><td>(\S+)</td><td[^>]*>([^<]*)</td>.*?</tr>", text)
    found = dict(cells)
    assert found["fluid.law"] == "carreau" and found["outlet.kind"] == "do-nothing"
    assert found["inflow.profile"] == "parabolic" and found["inflow.waveform"] == "1 + sin(4 * pi * t)"
    keys = [key for key, _ in cells if key.startswith(("geometry.", "fluid.", "inflow."))]
    assert keys[:4] == ["geometry.kind", "geometry.length", "geometry.height", "fluid.law"]
    assert CASES["aneurysm"].words()["solid.dome.material"] == "neo-hookean"
    assert not {"name", "description"} & set(CASES["aneurysm"].words())
