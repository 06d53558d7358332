"""The recipe "A new viscosity law" of docs/extend.md, done to a copy of the program and nothing else, and run."""

from pathlib import Path

import pytest
from recipes import append, copy_program, differing, enter, ffsi, insert, join_union, read_places, result_of, run_all
from test_materials import FRESH

from ffsi.scene import SceneError, load_scene

SCENE, LAW, ENTRY = "ffsi/scene/fluids.py", "ffsi/reference/viscosity.py", "ffsi/reference/from_scene.py"
UNION = "Fluid = Annotated["
REGISTRY = "VISCOSITIES: dict["
CASE = "turek-fsi1"

PLACES = read_places("A new viscosity law")
PATH = PLACES[0].files[0]


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    root = copy_program(tmp_path_factory.mktemp("copy"))
    assert [place.files[0] for place in PLACES[1:]] == [SCENE, LAW] and ENTRY in PLACES[2].files
    (library,), (scene,), (law, entry) = [place.blocks for place in PLACES]
    (root / PATH).write_text(library, encoding="utf-8")
    insert(root / SCENE, UNION, scene + "\n\n")
    join_union(root / SCENE, UNION, "Sisko")
    append(root / LAW, law)
    enter(root / ENTRY, REGISTRY, entry)
    return root


def sisko(consistency: float, exponent: float, infinity: float) -> str:
    constants = f"consistency={consistency}, exponent={exponent}, viscosity_infinity={infinity}"
    return f'fluid={{law="sisko", density=1000, {constants}}}'


@pytest.fixture(scope="module")
def runs(copy) -> dict[str, Path]:
    law, steps = sisko(1.0, 0.6, 0.5), ["time.step=0.01", "time.end=0.03", "inflow.ramp=0.1"]
    settings = {"sisko": [law], "time": [law, *steps], "newtonian": [sisko(0.4, 1.0, 0.6)]}
    return run_all(copy, {out: [CASE, *FRESH, *each] for out, each in settings.items()})


def test_the_new_law_is_solved_checked_and_all_that_was_touched(runs, solved, copy):
    result_of(runs["sisko"])
    assert 'law = "sisko"' in (runs["sisko"] / "scene.toml").read_text()
    with pytest.raises(SceneError, match="sisko"):
        load_scene(runs["sisko"] / "scene.toml")
    result_of(runs["time"])
    found, plain = result_of(runs["newtonian"])["quantities"], solved(CASE).quantities
    # But for the outlet's condition, far behind the body, both have the same viscosity everywhere.
    for name in ("drag", "drag_surface", "tip_uy"):
        assert found[name] == pytest.approx(plain[name], rel=1e-3)
    assert found["pressure_drop"] == pytest.approx(plain["pressure_drop"], rel=1e-3)
    done = ffsi(copy, ["run", CASE, "--set", "fluid.law=sisko", "--out", str(copy / "bad")])
    assert done.returncode == 2 and "fluid.consistency: missing; consistency c, Pa s^m" in done.stderr
    assert not (copy / "bad").exists() and differing(copy) == ({SCENE, LAW, ENTRY}, {PATH})
