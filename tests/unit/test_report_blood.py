"""What the report shows of blood flow: curves, tables of parts and cycles, the words among the parameters."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from run_folders import make_run
from test_hemodynamics import channel, poiseuille, state

from ffsi.files.arrays import write_arrays, write_mesh, write_state
from ffsi.hemodynamics.result import Result, load_result
from ffsi.hemodynamics.walls import wall_points
from ffsi.report import blocks, blood, walls, write_report
from ffsi.scene import CASES, Scene

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


def report(tmp_path: Path, run: Path) -> str:
    write_report([run], tmp_path / "report.html")
    return (tmp_path / "report.html").read_text()


def pictures(result: Result) -> list[tuple[Figure, str]]:
    return [each for make in blood.PICTURES.values() for each in make(result)]


def rows(text: str, heading: str) -> list[list[str]]:
    table = re.search(rf"<h3>{re.escape(heading)}</h3>.*?</table>", text, re.DOTALL)
    assert table is not None, heading
    lines = re.findall(r"<tr>.*?</tr>", table.group(), re.DOTALL)
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", line) for line in lines]


def test_steady(tmp_path: Path) -> None:
    text = report(tmp_path, vessel(tmp_path / "run"))
    assert text.count("data:image/png;base64,") == 5  # domain, velocity, pressure, vorticity, walls
    assert "Wall shear stress and pressure along the walls, one curve per connected line" in text
    assert rows(text, "Parts of the walls") == [
        ["part", "WSS mean (Pa)", "WSS max (Pa)", "WSS min (Pa)"], ["walls", "0.03", "0.03", "0.03"],
    ]  # fmt: skip
    names = [line[0] for line in rows(text, "Quantities")]
    assert "mass_balance" in names and not any(name.startswith("wss_") for name in names)
    assert "Cycles" not in text


def test_every_line_of_the_walls_has_a_curve(tmp_path: Path) -> None:
    text = report(tmp_path, vessel(tmp_path / "run", cycles=2))
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
    ((figure, _),) = pictures(load_result(vessel(tmp_path / "other")))
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
    assert (pictures(result), blood.part_table(result), blood.cycle_table(result)) == ([], None, None)


def test_words_among_the_parameters(tmp_path: Path) -> None:
    text = report(tmp_path, vessel(tmp_path / "run", cycles=1))
    cells = re.findall(r"<tr><td>(\S+)</td><td[^>]*>([^<]*)</td>.*?</tr>", text)
    found = dict(cells)
    assert found["fluid.law"] == "carreau" and found["outlet.kind"] == "do-nothing"
    assert found["inflow.profile"] == "parabolic" and found["inflow.waveform"] == "1 + sin(4 * pi * t)"
    keys = [key for key, _ in cells if key.startswith(("geometry.", "fluid.", "inflow."))]
    assert keys[:4] == ["geometry.kind", "geometry.length", "geometry.height", "fluid.law"]
    assert CASES["aneurysm"].words()["solid.dome.material"] == "neo-hookean"
    assert not {"name", "description"} & set(CASES["aneurysm"].words())
