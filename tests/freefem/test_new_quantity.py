"""The section "A new quantity of interest" of docs/extend.md, done to a copy of the program, and run there."""

import textwrap
from pathlib import Path

import pandas as pd
import pytest
from recipes import copy_program, differing, ffsi, insert, read_places, refused, result_of, run

from ffsi.files.arrays import read_mesh, read_state
from ffsi.scene import boundaries, load_scene

SLOW = "inflow.mean_velocity=0.06"
PLACES = read_places("A new quantity of interest")
REGISTRY, CHECKER = (place.files[0] for place in PLACES)


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    (entry,), (recomputed,) = [place.blocks for place in PLACES]
    root = copy_program(tmp_path_factory.mktemp("copy"))
    insert(root / REGISTRY, ")", textwrap.indent(entry.rstrip() + ",\n", "    "), after="QUANTITIES = (")
    insert(root / CHECKER, "    for boundary in", textwrap.indent(recomputed, "    "), after="def _pressures(")
    return root


def test_it_is_reported_checked_and_a_wrong_sign_caught(copy):
    folder = run(copy, "flap-svk", "flap", SLOW)
    found = result_of(folder)["quantities"]["interface_pressure"]
    mesh = read_mesh(folder / "mesh.bin")
    state = read_state(folder / "point-0001.bin", mesh)
    (label,) = [side.label for side in boundaries(load_scene("flap-svk")) if side.role == "interface"]
    wet = mesh.edges[mesh.label == label]
    assert state.p[wet].min() < found < state.p[wet].max()
    assert ffsi(copy, ["check", str(folder)]).returncode == 0
    assert "interface_pressure" not in result_of(run(copy, "turek-cfd1", "rigid"))["quantities"]
    folder = run(copy, "turek-fsi3", "time", "time.step=0.01", "time.end=0.03", "inflow.ramp=0.1")
    result = result_of(folder)
    assert set(result["quantities"]["interface_pressure"]) == {"mean", "amplitude", "frequency"}
    column = pd.read_csv(folder / "history.csv")["interface_pressure"]
    assert len(column) == 3 and column.iloc[-1] == result["time"]["last"]["interface_pressure"]
    assert differing(copy) == ({REGISTRY, CHECKER}, set())
    told = refused(copy, REGISTRY, '"unitPressure*int1d(Th', '"-unitPressure*int1d(Th', "flap-svk", SLOW)
    assert "interface_pressure is reported as" in told
