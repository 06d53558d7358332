"""Profiles and waveforms by straight lines between samples of a CSV file."""

import json
import math

import numpy as np
import pytest
from test_blood import rigid
from test_loads import block, displacement
from test_walls import channel, state_of

from ffsi.freefem import run_script
from ffsi.run.one_scene import solve
from ffsi.scene import SceneError, load_scene, with_values
from ffsi.scene.expressions import Expression
from ffsi.script.render import render

AT, VALUE = [0.0, 0.25, 0.75, 1.0], [0.0, 1.5, 0.5, 0.0]


def table(path, column: str, at, value) -> str:
    rows = [f"{x},{y}" for x, y in zip(at, value, strict=True)]
    path.write_text("\n".join([f"{column},value", *rows]) + "\n", encoding="utf-8")
    return str(path)


def test_a_polygon_goes_through_its_samples_and_is_constant_beyond():
    x = np.linspace(-1, 2, 301)
    found = Expression.polygon(AT, VALUE, ("y", "H")).evaluate(y=x, H=1.0)
    np.testing.assert_allclose(found, np.interp(x, AT, VALUE), rtol=0, atol=1e-14)


def inlet(folder):
    samples = table(folder / "profile.csv", "y", AT, VALUE)
    return channel(folder, {"walls": ["low", "high"]}, inflow={"flow_rate": 2, "profile_file": samples})


def test_a_profile_of_samples_enters(tmp_path):
    result = solve(inlet(tmp_path), tmp_path / "run")
    assert result.checked
    mesh, state = state_of(result)
    x, y = mesh.p2_coordinates.T
    found = state.v[x == 0, 0]
    exact = np.interp(y[x == 0], AT, VALUE) * 2 / np.trapezoid(VALUE, AT)  # the mesh has nodes at the samples
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-6)
    assert result.quantities["flow_rate_out"] == pytest.approx(2, rel=1e-6)
    assert load_scene(tmp_path / "run/scene.toml") == result.scene
    assert with_values(result.scene, {"inflow.profile": "uniform"}).inflow.profile_samples is None


def test_a_wrong_profile_is_caught(tmp_path, broken_script):
    broken_script("abs(inletS - ", "abs(inletS + ")
    result = solve(inlet(tmp_path), tmp_path / "run")
    assert not result.checked and "dirichlet" in result.reason


def test_a_load_of_samples_is_that_of_the_formula(tmp_path):
    samples = table(tmp_path / "load.csv", "t", [0.0, 0.1], [0.0, 1.0])
    by_file = solve(block(tmp_path, time=True, pressure=-2, waveform_file=samples), tmp_path / "file")
    by_text = solve(block(tmp_path, time=True, pressure=-2, waveform="min(t/0.1, 1)"), tmp_path / "text")
    assert by_file.checked and by_text.checked
    size = np.abs(displacement(by_text)).max()
    assert size > 1e-3
    np.testing.assert_allclose(displacement(by_file), displacement(by_text), rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize(("column", "at", "value", "text"), [
    ("x", [0, 1], [0, 1], r"inflow\.profile_file = .*the columns are x, value; accepted: y, value"),
    ("y", [0], [1], r"profile_file.*1 rows; at least 2 are needed"),
    ("y", [0, 0], [1, 2], r"profile_file.*the values of y must increase; that of row 2 does not"),
    ("y", [0, 1], [1, "a"], r"profile_file.*row 2 holds no two finite numbers"),
    ("y", [0, 500, 1000], [0, 1, 0], r"profile_samples.at: reaches from 0 to 1000 m; accepted: 0 to 1 m, the inlet"),
    ("y", range(101), range(101), r"profile_file.*101 rows; at most 100 are accepted"),
])  # fmt: skip
def test_refused(column, at, value, text, tmp_path):
    samples = table(tmp_path / "profile.csv", column, at, value)
    with pytest.raises(SceneError, match=text):
        channel(tmp_path, {"walls": ["low", "high"]}, inflow={"mean_velocity": 1, "profile_file": samples})


def test_two_are_refused(tmp_path):
    samples = {"at": [0, 1], "value": [0, 1]}
    with pytest.raises(SceneError, match=r"inflow\.profile: profile and profile_samples are given"):
        flow = {"mean_velocity": 1, "profile": "uniform", "profile_samples": samples}
        channel(tmp_path, {"walls": ["low", "high"]}, inflow=flow)
    with pytest.raises(SceneError, match=r"loads\.inside\.waveform: waveform and waveform_samples are given"):
        block(tmp_path, time=True, pressure=1, waveform="t", waveform_samples=samples)
    with pytest.raises(SceneError, match=r"loads\.inside\.waveform_samples: only accepted in a scene with a table"):
        block(tmp_path, time=False, pressure=1, waveform_samples=samples)


INLET = "real inletX = 0, inletY = 0, inwardX = 1, inwardY = 0,"
LAST_OF_MESH = "  ShapeMesh();\n}"


# Not symmetric: the direction along the inlet matters.
RIGID = rigid(inflow={"mean_velocity": 0.12, "profile": "y * (H - y) * (1 + y / H)"})


def turned(text: str, angle: float, dx: float, dy: float) -> str:
    """Return the script with its whole mesh turned about the origin (rad) and shifted (m)."""
    c, s = repr(math.cos(angle)), repr(math.sin(angle))
    assert INLET in text and LAST_OF_MESH in text
    text = text.replace(INLET, f"real inletX = {dx}, inletY = {dy}, inwardX = {c}, inwardY = {s},")
    moved = f"  Th = movemesh(Th, [{dx} + {c}*x - {s}*y, {dy} + {s}*x + {c}*y]);\n"
    return text.replace(LAST_OF_MESH, "  ShapeMesh();\n" + moved + "}")


@pytest.fixture(scope="module")
def forces(installation, tmp_path_factory):
    def forces(text: str) -> dict[str, float]:
        folder = tmp_path_factory.mktemp("run")
        (folder / "case.edp").write_text(text, encoding="utf-8")
        run_script(folder / "case.edp", {"out": folder}, installation=installation, cwd=folder, time_limit=60)
        return json.loads((folder / "point-0001.json").read_text())["quantities"]

    return forces


straight = pytest.fixture(lambda forces: forces(render(RIGID)), scope="module")


@pytest.mark.parametrize(("angle", "shift"), [(math.pi / 2, (0.0, 0.0)), (2.5, (0.3, -0.7))])
def test_a_turned_channel_has_turned_forces(forces, straight, angle, shift):
    after = forces(turned(render(RIGID), angle, *shift))
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    for form in ("", "_surface"):
        expected = rotation @ [straight[f"drag{form}"], straight[f"lift{form}"]]
        np.testing.assert_allclose([after[f"drag{form}"], after[f"lift{form}"]], expected, rtol=1e-7)
    assert after["pressure_drop"] == pytest.approx(straight["pressure_drop"], rel=1e-7)
