"""The section "A new kind of outlet" of docs/extend.md, done to a copy of the program, and run there."""

import textwrap
from pathlib import Path

import pandas as pd
import pytest
from recipes import append, copy_program, differing, enter, ffsi, insert, read_places, refused, replace, result_of, run

SCENE, LAW, ENTRY = "ffsi/scene/outlet.py", "ffsi/reference/conditions.py", "ffsi/reference/from_scene.py"
PLACES = read_places("A new kind of outlet")
LIBRARY = PLACES[0].files[0]
RESISTANCE, INERTANCE = 200.0, 30.0
OUTLET = f'outlet={{kind="inertance", resistance={RESISTANCE}, inertance={INERTANCE}, pressure=40}}'
BEGIN = ["time.step=0.01", "time.end=0.03", "inflow.ramp=0.1", OUTLET]


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    assert [place.files[0] for place in PLACES[1:]] == [SCENE, LAW, ENTRY]
    (library,), (field, entry), (law,), (law_entry,) = [place.blocks for place in PLACES]
    root = copy_program(tmp_path_factory.mktemp("copy"))
    (root / LIBRARY).write_text(library, encoding="utf-8")
    replace(root / SCENE, '    kind: Literal["do-nothing", ', '    kind: Literal["inertance", "do-nothing", ')
    insert(root / SCENE, "    backflow: ", textwrap.indent(field, "    "))
    enter(root / SCENE, "OUTLETS = {", entry)
    append(root / LAW, law)
    replace(root / ENTRY, "conditions import Inflow,", "conditions import Inertance, Inflow,")
    enter(root / ENTRY, "OUTLETS: dict[", law_entry)
    return root


@pytest.mark.parametrize("case", ["turek-fsi3", "cylinder-2d2"])  # behind an elastic body, and a rigid one
def test_it_goes_in_time(copy, case):
    folder = run(copy, case, case, *BEGIN)
    assert result_of(folder)["check"]["outlet_difference"] < 1e-8
    history = pd.read_csv(folder / "history.csv")
    last, before = history.iloc[-1], history.iloc[-2]
    given = last["outlet_pressure"] - RESISTANCE * last["flow_rate_out"]
    driven = INERTANCE * (last["flow_rate_out"] - before["flow_rate_out"]) / last["step"]
    assert abs(driven) > 1
    assert 0 < given - driven < 40  # the ramp of the pressure


def test_a_steady_flow_has_its_resistance_alone(copy, solved):
    plain = solved("turek-fsi1", "outlet={kind='resistance', resistance=200, pressure=40}").quantities
    found = result_of(run(copy, "turek-fsi1", "steady", OUTLET))["quantities"]
    assert {name: found[name] for name in plain} == pytest.approx(plain, rel=1e-9)


@pytest.mark.parametrize(
    "signs",
    [("Resistance-outletInertance", "Resistance+outletInertance"), ("+ outletInertance*", "- outletInertance*")],
)
def test_a_wrong_sign_is_caught(copy, signs):
    told = refused(copy, LIBRARY, *signs, "turek-fsi3", *BEGIN)
    assert "outlet_difference: the relative difference" in told or "momentum: the relative residual" in told


def test_its_constants_are_checked_and_nothing_else_was_touched(copy):
    done = ffsi(copy, ["run", "turek-fsi1", "--set", "outlet.kind=inertance", "--out", str(copy / "bad")])
    assert done.returncode == 2 and "outlet.inertance: missing; inertance L" in done.stderr
    assert differing(copy) == ({SCENE, LAW, ENTRY}, {LIBRARY})
