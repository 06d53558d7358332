"""What cannot be evaluated is noted, and takes neither the result nor other evaluations with it."""

import json
import math
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from run_folders import FakeCheck, FakeFreeFEM, make_run
from test_cli import call
from time_folders import FakeTimeFreeFEM, scene_in_time

from ffsi.hemodynamics.result import load_result
from ffsi.hemodynamics.state import WallState
from ffsi.result import painting
from ffsi.result.evaluation import Notes, attempt, gather
from ffsi.result.in_time import _quantities, energy_balance
from ffsi.run import one_scene
from ffsi.scene import load_scene

LEVEL = ["--set", "mesh.level=0"]


def fails(text: str = "no such thing") -> Callable[..., None]:
    def failing(*_: object, **__: object) -> None:
        raise RuntimeError(text)

    return failing


def test_a_failing_evaluation_is_noted_once_and_the_others_stay() -> None:
    notes: Notes = []
    found = gather(notes, {"one": lambda: {"a": 1.0}, "two": fails("broken\n  twice"), "three": lambda: {"b": np.inf}})
    assert found == {"a": 1.0, "b": np.inf} and attempt(notes, "two", fails("broken twice")) is None
    assert notes == [{"what": "two", "why": "broken twice"}]
    notes: Notes = []
    field = np.array([1.0, np.nan])  # a gap of a field
    found = gather(notes, {"part": lambda: {"a": np.float64("nan"), "b": 2.0}, "field": lambda: {"c": field}})
    assert found == {"b": 2.0, "c": field} and notes == [{"what": "a", "why": "it is not a number"}]

    def interrupted() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        attempt([], "any", interrupted)


def test_a_run_keeps_what_can_be_evaluated(tmp_path, freefem: FakeFreeFEM, check: FakeCheck, monkeypatch) -> None:
    paint, broken = painting.paint, fails("no ink")
    monkeypatch.setattr(painting, "paint", lambda name, *of: broken() if name == "velocity" else paint(name, *of))
    monkeypatch.setattr("ffsi.result.vtu.write_vtu", fails())
    result = one_scene.solve(load_scene("flap-svk", ["mesh.level=0"]), tmp_path / "run")
    assert (result.status, result.failure, len(check.calls)) == ("converged", "", 1)
    notes = [{"what": "VTU", "why": "no such thing"}, {"what": "picture of the velocity", "why": "no ink"}]
    assert load_result(tmp_path / "run").not_evaluated == result.not_evaluated == notes
    there = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"pressure.png", "displacement.png"} <= there and "velocity.png" not in there


def test_the_walls_keep_what_can_be_evaluated(tmp_path, freefem: FakeFreeFEM, check: FakeCheck, monkeypatch) -> None:
    """Flow rates and stress along the walls of what passes for a vessel here."""
    monkeypatch.setattr("ffsi.hemodynamics.result.reports_walls", lambda scene: True)
    monkeypatch.setattr(WallState, "_stress_by_part", fails("no stress"))
    monkeypatch.setattr("ffsi.hemodynamics.state.at_nodes", fails("no nodes"))
    result = one_scene.solve(load_scene("flap-svk", ["mesh.level=0"]), tmp_path / "run")
    assert result.converged and "mass_balance" in result.quantities and "drag" in result.quantities
    assert [note["what"] for note in result.not_evaluated] == [
        "wall shear stress by part", "field of the wall shear stress",
    ]  # fmt: skip
    assert (tmp_path / "run" / "fields.vtu").is_file() and (tmp_path / "run" / "wall.csv").is_file()


def test_it_is_said_and_ends_with_1(tmp_path, capsys, freefem: FakeFreeFEM, check: FakeCheck, monkeypatch) -> None:
    monkeypatch.setattr(painting, "paint", fails("no ink"))
    code, out, err = call(capsys, "run", "flap-svk", *LEVEL, "--out", str(tmp_path / "run"))
    assert code == 1
    assert "not evaluated: picture of the velocity: no ink" in err and "drag" in out
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert data["status"] == "converged" and data["quantities"]["drag"]


def test_an_animation_that_fails_is_noted(tmp_path, capsys, in_time: FakeTimeFreeFEM, check, monkeypatch) -> None:
    monkeypatch.setattr("ffsi.report.animation.write_animation", fails("no film"))
    (tmp_path / "scene.toml").write_text(scene_in_time().to_toml())
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "run"), "--animate", "velocity"]
    code, _, err = call(capsys, *words)
    assert code == 1 and "not evaluated: velocity.gif: no film" in err
    assert load_result(tmp_path / "run").not_evaluated == [{"what": "velocity.gif", "why": "no film"}]


def test_a_history_that_does_not_go_on_has_no_means() -> None:
    notes: Notes = []
    time = 0.1 * np.arange(1, 40)
    history = pd.DataFrame({"time": time, "step": 0.1, "lift": np.sin(6 * time), "min_jacobian": 0.5})
    assert set(_quantities(history, notes)) == {"lift", "min_jacobian"} and notes == []
    assert _quantities(history[::-1], notes) == {"min_jacobian": 0.5}
    assert notes == [{"what": "mean, amplitude and frequency", "why": "the times do not increase"}]


def test_a_notebook_shows_what_is_missing(tmp_path) -> None:
    folder = make_run(
        tmp_path / "run", checked=False, warnings=["a long step"], not_evaluated=[{"what": "x", "why": "<y>"}]
    )
    shown = load_result(folder)._repr_html_()
    for text in ("converged, not checked", "a long step", "not evaluated: x: &lt;y&gt;", "data:image/png"):
        assert text in shown


def energies(work: float) -> pd.DataFrame:
    rows = {"time": [0.1, 0.2], "kinetic": [1.0, 2.0], "elastic": [0.5, 1.0], "dissipated": [0.1, 0.5]}
    return pd.DataFrame(rows | {"work": [1.6, work]})


def test_energy_has_the_parts_of_the_last_state_and_what_is_left():
    found = energy_balance(energies(4.0))
    assert found == {"kinetic": 2.0, "elastic": 1.0, "dissipated": 0.5, "work": 4.0, "imbalance": pytest.approx(-0.125)}
    assert energy_balance(energies(3.5))["imbalance"] == 0.0
    released = energies(0.0).assign(elastic=[-1.0, -2.6])  # a solid that was bent at the start: nothing is done
    assert energy_balance(released)["imbalance"] == pytest.approx(-0.1 / 2.6)
    assert math.isnan(energy_balance(energies(math.nan))["imbalance"])
    assert energy_balance(energies(4.0).drop(columns="work")) == energy_balance(energies(4.0).iloc[:0]) == {}
