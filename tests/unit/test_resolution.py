"""Warnings: what a result lacks although its equations are solved is said, with the key to change."""

import math
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pandas as pd
import pytest
from matplotlib.tri import Triangulation
from units_scaling import FACTORS, in_units

from ffsi.cli import show
from ffsi.freefem import FreeFEMError
from ffsi.hemodynamics.result import Result
from ffsi.result import resolution
from ffsi.result.in_time import energy_balance
from ffsi.result.locating import Finder
from ffsi.result.table import row
from ffsi.run.point import Point
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values

IN_TIME = [name for name, scene in CASES.items() if not scene.steady]


def history_of(scene: Scene, frequency: float, *, step: float | None = None, growth: float = 0.0) -> pd.DataFrame:
    """Return a history whose tip and lift swing with a frequency (Hz), the drag with twice of it."""
    assert scene.time is not None
    k = step or scene.time.step
    t = k * np.arange(1, round(scene.time.end / k) + 1)
    wave = np.exp(growth * (t - t[-1])) * np.sin(2 * math.pi * frequency * t)
    table = {"time": t, "step": k}
    if scene.fluid is not None:
        table |= {"drag": 400.0 + 20.0 * np.sin(4 * math.pi * frequency * t), "lift": 150.0 * wave}
    if scene.solid:
        table |= {"tip_ux": -2e-3 + 2e-3 * np.sin(4 * math.pi * frequency * t), "tip_uy": 3e-2 * wave}
    return pd.DataFrame(table)


def warnings(scene: Scene, history: pd.DataFrame | None = None, imbalance: float = 0.0) -> str:
    balance = {"kinetic": 1.0, "elastic": 1.0, "dissipated": 1.0, "work": 3.0, "imbalance": imbalance}
    rows = pd.DataFrame() if history is None else history
    return "\n".join(resolution.of_history(scene, rows, balance))


FREQUENCIES = {"turek-fsi2": 1.9, "turek-fsi3": 5.5, "turek-csm3": 1.1, "turek-cfd3": 4.4, "cylinder-2d2": 3.0}


@pytest.mark.parametrize("name", IN_TIME)
def test_the_catalogue_is_resolved_at_its_own_steps(name: str) -> None:
    scene = CASES[name]
    assert warnings(scene) == "" and warnings(scene, history_of(scene, FREQUENCIES.get(name, 1.4))) == ""
    assert resolution.of_scene(scene) == []


@pytest.mark.parametrize(("name", "overrides", "frequency", "words"), [
    ("turek-csm3", ["time.step=0.08"], 1.1, ["damps the motion: tip_uy", "time.step = 0.021"]),
    ("turek-csm3", ["time.step=0.08", "time.scheme=crank-nicolson"], 1.1, ["the motion: tip_u", "time.step ="]),
    ("turek-csm3", ["time.step=0.01", "time.scheme=backward-euler"], 1.1, ["damps", "shifted-crank-nicolson"]),
    ("turek-fsi3", ["time.step=0.08"], 0.0, ["a vortex street", "(3.1 steps)", "time.step = 0.019"]),
    ("turek-fsi3", ["time.step=0.04", "geometry.beam.thickness=0.01"], 0.0, ["a vortex street"]),
    ("turek-fsi3", ["time.step=0.02"], 5.5, ["damps the motion: tip_uy"]),
    ("turek-fsi3", ["inflow.ramp=0.005"], 0.0, ["1 steps for the inflow's ramp", "inflow.ramp = 0.033"]),
    ("turek-fsi3", ["inflow.ramp=0.02"], 0.0, ["4 steps for the inflow's ramp", "time.step = 0.003"]),
    ("aneurysm-pulsatile", ["time.step=0.0714", "inflow.ramp=none"], 0.0, ["the waveform of the inflow"]),
    ("aneurysm-pulsatile", ["time.step=0.0357", "inflow.ramp=none"], 0.0, ["the waveform of the inflow"]),
    ("turek-fsi3", ["inflow.waveform=1+0.1*sin(400*pi*t)"], 0.0, ["waveform", "do not follow it at all"]),
    ("turek-fsi3", ["inflow.waveform=1+0.1*sin(200*pi*t)"], 0.0, ["waveform", "do not follow it at all"]),
    ("turek-fsi3", ["inflow.waveform=1+0.5*sin(40*pi*t)"], 0.0, ["waveform", "error of about 3"]),
])  # fmt: skip
def test_steps_that_are_too_large(name: str, overrides: list[str], frequency: float, words: list[str]) -> None:
    scene = load_scene(name, overrides)
    said = warnings(scene, history_of(scene, frequency))
    for word in words:
        assert word in said


@pytest.mark.parametrize("overrides", [
    ["inflow.ramp=0.05"], ["inflow.waveform=1+0.5*sin(2*pi*t)"], ["inflow.waveform=abs(sin(pi*t))"],
    ['inflow.waveform="2"'],
])  # fmt: skip
def test_steps_that_are_small_enough(overrides: list[str]) -> None:
    assert warnings(load_scene("turek-fsi3", overrides)) == ""


def test_sawtooths_and_steps_that_were_taken() -> None:
    for step in (0.2, 0.08, 0.03):
        scene = load_scene("turek-csm3", [f"time.step={step}"])
        said = warnings(scene, history_of(scene, 1.1))
        advised = min(float(part.split()[0]) for part in said.split("time.step = ")[1:])
        finer = load_scene("turek-csm3", [f"time.step={advised}"])
        assert warnings(finer, history_of(finer, 1.1)) == ""
    adaptive = load_scene("turek-csm3", ["time.step=0.1", "time.adaptive=true", "time.scheme=crank-nicolson"])
    assert warnings(adaptive, history_of(adaptive, 1.1, step=0.005)) == ""
    said = warnings(adaptive, history_of(adaptive, 1.1))
    assert "time.step = " in said and "time.error" in said
    ramp = load_scene("turek-fsi3", ["inflow.ramp=0.1", "time.step=0.05", "time.adaptive=true"])
    assert "ramp" in warnings(ramp) and warnings(ramp, history_of(ramp, 0.0, step=0.005)) == ""
    scene = load_scene("turek-csm3", ["time.scheme=crank-nicolson"])
    history = history_of(scene, 0.5)
    assert warnings(scene, history) == ""
    zigzag = 1e-2 * (-1.0) ** np.arange(len(history))
    assert "tip_uy changes too much from step to step" in warnings(
        scene, history.assign(tip_uy=history["tip_uy"] + zigzag)
    )
    # Only one that shows: rounding, and a signal that is nothing beside the others, do not count.
    assert warnings(scene, history.assign(tip_uy=history["tip_uy"] + 1e-3 * zigzag)) == ""
    assert warnings(scene, history.assign(tip_ux=1e-3 * zigzag)) == ""


def test_energy_of_rest_and_of_no_history() -> None:
    scene = CASES["turek-fsi3"]
    calm = history_of(scene, 5.5)
    assert warnings(scene, calm, 0.019) == ""
    for imbalance in (0.021, -0.08):
        assert "the energy balance misses" in warnings(scene, calm, imbalance)
    # At rest there is but rounding, which balances nothing.
    rest = {"kinetic": 1e-8, "elastic": 0.0, "dissipated": 0.0, "work": 3e-8, "imbalance": 0.7}
    assert resolution.of_history(scene, calm, rest) == [] and resolution.of_history(scene, calm, {}) == []
    assert "no number" in warnings(scene, calm, math.nan)
    scene = load_scene("turek-fsi3", ["inflow.mean_velocity=0", "inflow.ramp=none", "gravity.y=-9.81"])
    history = history_of(scene, 0.0).assign(drag=0.0, lift=0.0, tip_ux=0.0)
    zigzag = (-1.0) ** np.arange(len(history))
    assert warnings(scene, history.assign(tip_uy=1e-10 * zigzag, lift=1e-6 * zigzag)) == ""
    assert "tip_uy" in warnings(scene, history.assign(tip_uy=1e-6 * zigzag))
    assert "lift" in warnings(scene, history.assign(lift=1e-2 * zigzag))
    assert resolution.of_history(CASES["turek-fsi3"], pd.DataFrame({"time": []}), energy_balance(pd.DataFrame())) == []


@pytest.mark.parametrize("step", [0.005, 0.04])
def test_units_do_not_matter(step: float) -> None:
    scene = load_scene("turek-fsi3", [f"time.step={step}", "inflow.waveform=1+0.2*sin(3*t)"])
    history = history_of(scene, 5.5)
    count = len(warnings(scene, history).splitlines())
    assert (count > 0) == (step > 0.005)
    for length, mass, time in FACTORS:
        units = {"time": time, "step": time, "drag": mass / time**2, "lift": mass / time**2}
        units |= {"tip_ux": length, "tip_uy": length}
        there = warnings(in_units(scene, length, mass, time), history * pd.Series(units))
        assert len(there.splitlines()) == count


def gravity(**values: float) -> dict[str, Any]:
    return {f"gravity.{key}": value for key, value in values.items()}


def test_gravity_along_the_outlet_and_hydrostatic_outlets() -> None:
    scene = with_values(CASES["cylinder-2d1"], gravity(y=-9.81))
    (text,) = resolution.of_scene(scene)
    assert "outlet.hydrostatic = true" in text
    assert "4.02 Pa" in text  # 1 kg/m^3 times 9.81 m/s^2 times 0.41 m
    for answer in (True, False):
        assert resolution.of_scene(with_values(scene, {"outlet.hydrostatic": answer})) == []
    assert resolution.of_scene(with_values(scene, gravity(y=0.0))) == []
    assert resolution.of_scene(with_values(CASES["cylinder-2d1"], gravity(x=-9.81))) == []
    # The aneurysm's outlet is horizontal.
    assert resolution.of_scene(with_values(CASES["aneurysm"], gravity(y=-9.81))) == []
    assert len(resolution.of_scene(with_values(CASES["aneurysm"], gravity(x=9.81)))) == 1
    with pytest.raises(SceneError, match=r"outlet.hydrostatic = true: only accepted in a scene with a table gravity"):
        load_scene("cylinder-2d1", ["outlet.hydrostatic=true"])
    with pytest.raises(SceneError, match=r"outlet.hydrostatic = .* true or false"):
        load_scene("cylinder-2d1", ["outlet.hydrostatic=1", "gravity.y=-1"])
    scene = load_scene("cylinder-2d1", ["outlet.hydrostatic=true", "gravity.y=-1"])
    assert Scene.from_toml(scene.to_toml()) == scene


@pytest.mark.parametrize("kind", ["do-nothing", "zero-traction", "pressure", "resistance", "windkessel"])
def test_every_kind_of_outlet_can_be_hydrostatic(kind: str) -> None:
    keys = {
        "pressure": {"pressure": 1.0},
        "resistance": {"resistance": 1.0},
        "windkessel": {"proximal_resistance": 1.0, "distal_resistance": 1.0, "compliance": 1.0},
    }.get(kind, {})
    values = {f"outlet.{key}": value for key, value in {"kind": kind, "hydrostatic": True, **keys}.items()}
    outlet = with_values(CASES["turek-fsi3"], {**values, **gravity(y=-2.0)}).outlet
    assert outlet is not None and outlet.hydrostatic and outlet.kind == kind


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_outlet_of_a_mesh_of_ones_own(tmp_path: Path, angle: float) -> None:
    turn = np.deg2rad(angle)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) @ rotation
    lines = [[0, 1], [1, 2], [2, 3], [3, 0]]
    cells = [("triangle", [[0, 1, 2], [0, 2, 3]]), ("line", lines)]
    data = {"medit:ref": [np.array([1, 1]), np.array([10, 11, 10, 12])]}
    meshio.Mesh(points, cells, cell_data=data).write(tmp_path / "box.mesh", file_format="medit")
    scene = Scene.model_validate(
        {
            "name": "box",
            "geometry": {"kind": "mesh", "file": str(tmp_path / "box.mesh"), "regions": {"fluid": 1},
                "boundaries": {"inlet": 12, "outlet": 11, "walls": 10}},
            "fluid": {"density": 1000.0, "viscosity": 1.0}, "inflow": {"mean_velocity": 0.0},
            "outlet": {"kind": "do-nothing"}, "gravity": {"y": -9.81},
        }
    )  # fmt: skip
    (text,) = resolution.of_scene(scene)
    assert f"{9810 * np.cos(turn):.3g} Pa" in text
    along = {"gravity.x": -9.81 * np.cos(turn), "gravity.y": -9.81 * np.sin(turn)}
    assert resolution.of_scene(with_values(scene, along)) == []


def test_warnings_go_into_the_result_its_last_lines_and_the_table(tmp_path: Path) -> None:
    scene = load_scene("turek-fsi3", ["time.step=0.08", "gravity.y=-9.81"])
    history = history_of(scene, 1.0).assign(min_jacobian=0.9, iterations=3, factorized=0, seconds=1.0)
    history.to_csv(tmp_path / "history.csv", index=False)
    point = Point(scene, tmp_path, 1, {"time.step": 0.08}, alone=False)
    data = point.collect(FreeFEMError("crash", "killed"))
    hydrostatic, *others = data["warnings"]
    assert "outlet.hydrostatic" in hydrostatic and any("time.step = " in text for text in others)
    result = Result(scene, tmp_path, data)
    assert show.summary(result)[-len(data["warnings"]) :] == [f"warning: {text}" for text in data["warnings"]]
    assert row(result, {"time.step": 0.08}, tmp_path)["warnings"] == "; ".join(data["warnings"])
    calm = Point(CASES["turek-fsi1"], tmp_path / "calm", 1, {}, alone=True).collect(FreeFEMError("crash", "killed"))
    assert calm["warnings"] == []


TURNED = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]])


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_points_are_found_as_by_a_second_program(unit: float) -> None:
    """Triangles of very different sizes; a fifth of the points lie outside."""
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.random((300, 2)), 0.01 * rng.random((300, 2))])
    mesh, at = Triangulation(*points.T), 1.1 * rng.random((2000, 2))
    at[0] = points[mesh.triangles[7]].mean(axis=0)
    found, barycentric = Finder(unit * points[mesh.triangles]).find(unit * at)
    assert found.tolist() == mesh.get_trifinder()(*at.T).tolist()
    inside = found >= 0
    assert found[0] == 7 and 0.6 < inside.mean() < 0.95
    back = np.einsum("ij,ijk->ik", barycentric, points[mesh.triangles[found]])
    assert back[inside] == pytest.approx(at[inside], abs=1e-14)


def test_every_point_finds_a_triangle() -> None:
    corners = np.array([[[0, 0], [3, 0], [0, 1]], [[3, 0], [3, 1], [0, 1]]]) * 1e-7 + 0.1
    at = np.concatenate([corners.reshape(-1, 2), (corners[0] + np.roll(corners[0], 1, axis=0)) / 2])
    assert (Finder(corners).find(at)[0] >= 0).all()
    flat, large = np.array([[0.0, 0.0], [1.0, 1.0], [0.5, 0.5]]), 10 * TURNED - 1
    finder = Finder(np.array([TURNED, flat, large, large]))
    found, barycentric = finder.find(np.array([[0.3, 0.3], [-0.5, -0.5], [20.0, 0.0], [np.nan, 0.0]]))
    assert found.tolist() == [0, 2, -1, -1]  # the one in which it lies deepest; none
    assert barycentric[0] == pytest.approx([0.4, 0.3, 0.3])
    assert Finder(flat[None]).find(np.array([[0.5, 0.5]]))[0].tolist() == [-1]
    assert Finder(np.empty((0, 3, 2))).find(np.zeros((2, 2)))[0].tolist() == [-1, -1]


def test_many_points_are_found_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ffsi.result.locating._AT_A_TIME", 10)
    at = np.random.default_rng(1).random((100, 2))
    assert ((Finder(TURNED[None]).find(at)[0] == 0) == (at.sum(axis=1) <= 1)).all()


def test_a_node_that_is_nowhere_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        Finder(np.array([TURNED, [[np.nan, 0], [1, 0], [0, 1]]]))
