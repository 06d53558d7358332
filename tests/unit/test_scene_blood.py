"""Inflow by flow rate or peak, waveforms, outlets with a pressure, supports of walls."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from ffsi.scene import CASES, Scene, SceneError, boundaries, load_scene, with_values
from ffsi.scene.model import Support
from ffsi.scene.outlet import Outlet
from ffsi.scene.waveforms import Fourier, named_waveforms, read_waveform

TIME = "time={step=0.01, end=1}"


def pulsatile(*settings: str) -> Scene:
    return load_scene("turek-cfd1", [TIME, *settings])


@pytest.mark.parametrize(("settings", "mean"), [
    (["inflow.peak_velocity=0.3"], 0.2), (["inflow.flow_rate=0.082"], 0.2), (["inflow.flow_rate=8.2 cm^2/s"], 0.002),
    (["inflow.peak_velocity=0.3", "inflow.profile=uniform"], 0.3),
    (["inflow.peak_velocity=0.3", "inflow.profile=3 * y / H"], 0.1),
    (["inflow.flow_rate=0.082", "inflow.profile=3 * y / H"], 0.2 / 1.5),
    (["inflow.flow_rate=0.082", "inflow.profile=y^3 / H^3"], 0.8),
    (["inflow.peak_velocity=0.3", TIME, "inflow.waveform=mca", "inflow.profile=womersley"], 0.2),
])  # fmt: skip
def test_the_stored_scene_has_the_mean_velocity(settings, mean):
    scene = load_scene("turek-cfd1", settings)
    assert scene.inflow.mean_velocity == pytest.approx(mean, rel=1e-12)
    assert scene.inflow.peak_velocity is scene.inflow.flow_rate is None and "flow_rate" not in scene.to_toml()
    assert Scene.from_toml(scene.to_toml()) == scene
    # and a new mean velocity replaces it, as it replaces a new one
    assert with_values(scene, {"inflow.mean_velocity": 1}).inflow.mean_velocity == 1


@pytest.mark.parametrize(("inflow", "words"), [
    ({}, ["inflow.mean_velocity: missing", "mean_velocity, peak_velocity, flow_rate"]),
    ({"mean_velocity": 1, "flow_rate": 1}, ["inflow.mean_velocity: mean_velocity and flow_rate are given"]),
    ({"flow_rate": -1}, ["inflow.flow_rate = -1:", ">= 0 in m^2/s", "1 cm^2/s"]),
    ({"flow_rate": "1 m/s"}, ["inflow.flow_rate =", "wrong dimension"]),
    ({"flow_rate": 1, "profile": "y - H"}, ["inflow.flow_rate = 1:", "whose mean is positive"]),
    ({"peak_velocity": 1, "profile": "-y"}, ["inflow.peak_velocity = 1:", "whose largest value is positive"]),
    ({"flow_rate": 1, "profile": "womersly"}, ["inflow.profile =", 'mean "womersley"']),
])  # fmt: skip
def test_a_wrong_velocity_is_refused(inflow, words):
    table = CASES["turek-cfd1"].model_dump(exclude_none=True) | {"inflow": inflow}
    with pytest.raises(SceneError) as error:
        Scene.model_validate(table)
    for word in words:
        assert word in str(error.value)


def test_named_waveforms_their_means_factors_and_periods():
    waves = named_waveforms()
    assert set(waves) == {"sinus", "aneurysm-84bpm", "mca"}
    t = np.linspace(0, 3, 301)
    np.testing.assert_allclose(waves["sinus"](t), 1 + 0.75 * np.sin(2 * np.pi * t), atol=1e-13)
    for wave in waves.values():
        one = np.arange(1000) * (wave.period / 1000)
        assert wave(one).mean() == pytest.approx(1, rel=1e-12)
        np.testing.assert_allclose(wave(one + wave.period), wave(one), rtol=1e-9)
    # extremes of the velocity in the middle of the lumen, m/s, as its source gives them (to 0.3 %)
    values = 0.357143 * waves["aneurysm-84bpm"](np.linspace(0, 60 / 84, 20001))
    assert values.max() == pytest.approx(0.64757, rel=3e-3) and values.min() == pytest.approx(0.15297, rel=3e-3)
    assert waves["mca"].period == 0.951
    scene = pulsatile("inflow.waveform=mca", "inflow.ramp=0.5")
    assert scene.inflow.period == 0.951 and scene.parameters()["inflow.period"] == 0.951
    t, ramp = np.array([0.0, 0.25, 0.7, 1.0]), np.array([0, (1 - math.cos(math.pi / 2)) / 2, 1, 1])
    np.testing.assert_allclose(scene.inflow.factor(t), ramp * named_waveforms()["mca"](t), rtol=1e-13)
    np.testing.assert_allclose(scene.inflow.ramp_factor(t), ramp, rtol=1e-13)
    # another heart rate stretches it
    slow = with_values(scene, {"inflow.period": 1.902})
    np.testing.assert_allclose(slow.inflow.factor(2 * t[2:]), scene.inflow.factor(t[2:]), rtol=1e-12)
    assert Scene.from_toml(slow.to_toml()) == slow
    # another waveform has its own period, or none
    assert with_values(slow, {"inflow.waveform": "sinus"}).inflow.period == 1
    formula = with_values(slow, {"inflow.waveform": "cos(t)"}).inflow
    assert formula.period is formula.fourier is None
    assert with_values(slow, {"time": None, "inflow.ramp": None, "inflow.waveform": None}).inflow.period is None
    assert pulsatile("inflow.waveform=1 + sin(pi*t)", "inflow.period=2").inflow.period == 2


def write_csv(folder: Path, text: str) -> Path:
    path = folder / "flow.csv"
    path.write_text(text, encoding="utf-8")
    return path


def samples(rows: int = 41, period: float = 0.8, start: float = 0.0) -> str:
    t, w = start + np.linspace(0, period, rows), 2 * np.pi / period
    values = 2 + np.sin(w * t) - 0.3 * np.cos(3 * w * t)
    return "t,value\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), values.tolist(), strict=True))


@pytest.mark.parametrize("start", [0.0, 0.3])
def test_a_file_becomes_the_series_of_the_polygon_through_its_samples(tmp_path, start):
    found = read_waveform(write_csv(tmp_path, samples(801, start=start)), 5)
    assert found.period == pytest.approx(0.8)
    np.testing.assert_allclose(found.cosine, [2, 0, 0, -0.3, 0, 0], atol=1e-4)
    np.testing.assert_allclose(found.sine, [0, 1, 0, 0, 0, 0], atol=1e-4)
    coarse = read_waveform(write_csv(tmp_path, "t, value\n0, 1\n1, 3\n3, -1\n4, 1\n"), 60)
    t = np.array([0.0, 0.5, 1.5, 3.7])
    np.testing.assert_allclose(coarse(t), [1, 2, 2, 0.4], atol=0.02)
    assert coarse.cosine[0] == pytest.approx(1, abs=1e-6)  # mean of the triangle wave


def test_files_of_waveforms_with_a_period_and_their_scenes(tmp_path):
    path = write_csv(tmp_path, "t,value\n0,0\n1,1\n2,0\n3,-1\n")
    with pytest.raises(ValueError, match="the last value -1 does not repeat the first one 0"):
        read_waveform(path, 3)
    found = read_waveform(path, 40, 4.0)
    np.testing.assert_allclose(found([0.0, 0.5, 1.5, 3.5]), [0, 0.5, 0.5, -0.5], atol=0.02)
    longer = read_waveform(path, 40, 6.0)  # goes straight back to its first value
    np.testing.assert_allclose(longer([1.5, 3.0, 4.5]), [0.5, -1, -0.5], atol=0.03)
    with pytest.raises(ValueError, match=r"cover 3 s, more than inflow\.period = 2 s"):
        read_waveform(path, 3, 2.0)
    write_csv(tmp_path, samples())
    table = pulsatile("inflow.waveform=mca").to_toml().replace('waveform = "mca"', 'waveform_file = "flow.csv"')
    table = table.replace("period = 0.951\n", "harmonics = 7\n")
    (tmp_path / "own.toml").write_text(table)
    scene = load_scene(tmp_path / "own.toml")
    (tmp_path / "flow.csv").unlink()
    assert scene.inflow.waveform_file is scene.inflow.harmonics is None and len(scene.inflow.series.cosine) == 8
    assert scene.inflow.period == pytest.approx(0.8)
    again = Scene.from_toml(scene.to_toml())
    assert again == scene and isinstance(again.inflow.fourier, Fourier)
    np.testing.assert_allclose(again.inflow.factor([0.1, 0.3]), scene.inflow.factor([0.1, 0.3]), rtol=1e-14)


@pytest.mark.parametrize(("text", "words"), [
    ("t,value\n0,1\n1,2\n2,1\n", "3 rows; at least 4"),
    ("t,v\n0,1\n1,2\n2,1\n3,1\n", "the columns are t, v; accepted: t, value"),
    ("t,value\n0,1\n1,2\n1,1\n3,1\n", "times must increase; that of row 3"),
    ("t,value\n0,1\n1,nan\n2,1\n3,1\n", "row 2 holds no two finite numbers"),
    ("t,value\n0,1\n1,2\n2,inf\n3,1\n", "row 3 holds no two finite numbers"),
    ("t,value\n0,1\n1,2\n2,exit(1)\n3,1\n", "row 3 holds no two finite numbers"),
    ("t,value\n0,1\n1,2,3\n2,1\n3,1\n", "no table"), ("", "no table"),
    ("t,value\n0,0,1\n0,1,2\n0,2,1\n0,3,1\n", "its rows have 3 cells, after decimal commas, say, under 2 columns"),
    ("t,value\n0,1\n1,2\n2,3\n3,4\n", "does not repeat the first one 1"), (None, "cannot be read: No such file"),
])  # fmt: skip
def test_a_wrong_file_is_refused(tmp_path, text, words):
    if text is not None:
        write_csv(tmp_path, text)
    with pytest.raises(SceneError) as error:
        pulsatile(f"inflow.waveform_file={tmp_path / 'flow.csv'}")
    assert str(error.value).startswith("inflow.waveform_file = ") and words in str(error.value)


@pytest.mark.parametrize(("settings", "words"), [
    (["inflow.waveform=mcb"], ["inflow.waveform =", '"mca"', 'mean "mca"']),
    (["inflow.period=1"], ["inflow.period = 1 s: only accepted with a waveform"]),
    (["inflow.waveform=mca", "inflow.harmonics=3"], ["inflow.harmonics = 3: only accepted with waveform_file"]),
    (["inflow.waveform=mca", "inflow.series={cosine=[1], sine=[0]}"], ["waveform and series are given"]),
    (["inflow.series={cosine=[1], sine=[0]}"], ["inflow.period: missing"]),
    (["inflow.series={cosine=[1, 2], sine=[0]}", "inflow.period=1"], ["inflow.series.sine", "as many numbers"]),
    (["inflow.series={cosine=[], sine=[]}", "inflow.period=1"], ["inflow.series.cosine", "1 to 101 numbers"]),
    (["inflow.series={cosine=['a'], sine=[0]}", "inflow.period=1"], ["inflow.series.cosine.0", "not accepted"]),
    (["inflow.profile=womersley"], ["inflow.profile =", "needs a waveform that is a Fourier series"]),
    (["inflow.profile=womersley", "inflow.waveform=sin(t)"], ["needs a waveform that is a Fourier series"]),
])  # fmt: skip
def test_a_wrong_waveform_is_refused(settings, words):
    with pytest.raises(SceneError) as error:
        pulsatile(*settings)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("setting", ["inflow.waveform=mca", "inflow.series={cosine=[1], sine=[0]}"])
def test_a_steady_scene_has_no_waveform(setting):
    with pytest.raises(SceneError, match="only accepted in a scene with a table time"):
        load_scene("turek-cfd1", [setting, "inflow.period=1"])


# Outlet ------------------------------------------------------------------------------------------------------------

WINDKESSEL = ("proximal_resistance", "distal_resistance", "compliance")


@pytest.mark.parametrize(("outlet", "words"), [
    ({"kind": "pressure"}, ["outlet.pressure: missing", "Pa"]),
    ({"kind": "resistance"}, ["outlet.resistance: missing"]),
    ({"kind": "windkessel"}, [f"outlet.{key}: missing" for key in WINDKESSEL]),
    ({"kind": "do-nothing", "pressure": 1}, ['outlet.pressure = 1: not accepted with the kind "do-nothing"']),
    ({"kind": "pressure", "pressure": 1, "resistance": 1}, ["outlet.resistance = 1: not", 'only with "resistance"']),
    ({"kind": "resistance", "resistance": -1}, ["outlet.resistance = -1:", ">= 0 in Pa s/m^2"]),
    ({"kind": "do-nothing", "backflow": 1.01}, ["outlet.backflow = 1.01:", "> 0 and <= 1"]),
    ({"kind": "windkessel", "proximal_resistance": 1, "distal_resistance": 0, "compliance": 0},
     ["outlet.distal_resistance = 0:", "outlet.compliance = 0:", "> 0 in m^2/Pa"]),
])  # fmt: skip
def test_a_wrong_outlet_is_refused(outlet, words):
    with pytest.raises(SceneError) as error:
        load_scene("turek-cfd1", [f"outlet.{key}={json.dumps(value)}" for key, value in outlet.items()])
    for word in words:
        assert word in str(error.value)


def test_outlets_in_units_and_of_another_kind():
    outlet = Outlet(
        kind="windkessel", proximal_resistance="1 kPa s/m^2", distal_resistance=3, compliance="2 mm^2/kPa", backflow=0.3
    )
    assert (outlet.proximal_resistance, outlet.compliance, outlet.has_pressure) == (1000.0, 2e-9, True)
    assert not Outlet(kind="do-nothing", backflow=0.2).has_pressure
    keys = {"proximal_resistance": 1, "distal_resistance": 2, "compliance": 3, "pressure": 4, "backflow": 0.5}
    outlet = {f"outlet.{key}": value for key, value in keys.items()} | {"outlet.kind": "windkessel"}
    scene = with_values(CASES["turek-cfd1"], outlet)
    back = with_values(scene, {"outlet.kind": "resistance", "outlet.resistance": 7})
    assert back.outlet == Outlet(kind="resistance", resistance=7, pressure=4, backflow=0.5)
    assert with_values(back, {"outlet.kind": "do-nothing"}).outlet == Outlet(kind="do-nothing", backflow=0.5)
    assert with_values(CASES["turek-cfd1"], {"outlet.kind": "resistance", "outlet.resistance": 7}).outlet.pressure == 0


@pytest.mark.parametrize("case", ["flap-neo-hookean-roof", "cavity-flexible-floor"])
def test_the_outer_side_is_supported_where_there_is_a_support(case):
    free, supported = load_scene(case), load_scene(case, ["support.stiffness=2 kPa/mm"])
    assert supported.support == Support(stiffness=2e6, damping=0)
    changed = {b.label: (a.role, b.role) for a, b in zip(boundaries(free), boundaries(supported), strict=True)}
    assert {label: roles for label, roles in changed.items() if roles[0] != roles[1]} == {7: ("free", "supported")}


@pytest.mark.parametrize("case", ["flap-svk", "turek-fsi1", "turek-cfd1", "cook"])
def test_a_support_needs_an_outer_side(case):
    with pytest.raises(SceneError, match="support: not accepted: no wall with an outer side"):
        load_scene(case, ["support.stiffness=1"])


def test_a_support_pushes():
    with pytest.raises(SceneError, match=r"support\.damping = -1: out of range; accepted: a number >= 0 in Pa s/m"):
        load_scene("flap-neo-hookean-roof", ["support.damping=-1"])
