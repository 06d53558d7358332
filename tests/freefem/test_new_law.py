"""The recipe "A new viscosity law" of docs/extend.md, done to a copy of the program and nothing else, and run."""

import json
import re
import shutil
import textwrap
from dataclasses import dataclass
from pathlib import Path

import pytest
from test_new_material import ROOT, differing, ffsi, insert, run

from ffsi.scene import SceneError, load_scene

SCENE, LAW, ENTRY = "ffsi/scene/fluids.py", "ffsi/reference/viscosity.py", "ffsi/reference/from_scene.py"
UNION = "Fluid = Annotated["
REGISTRY = "VISCOSITIES: dict["
CASE = "turek-fsi1"


@dataclass(frozen=True)
class Pieces:
    """What the page adds: the library's file and its path, the class of the scene, the checker's, its entry."""

    library: str
    path: str
    scene: str
    law: str
    entry: str


def read_pieces() -> Pieces:
    """Return the code blocks of the section, each from the numbered item that names its file."""
    page = (ROOT / "docs/extend.md").read_text(encoding="utf-8")
    section = re.search(r"^## A new viscosity law\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE).group(1)
    items = re.split(r"^\d\. ", section, flags=re.MULTILINE)[1:]
    names = [re.findall(r"`([\w/.-]+/[\w.-]+)`", item.split("```")[0]) for item in items]
    assert [found[0] for found in names[1:]] == [SCENE, LAW]
    assert ENTRY in names[2]
    blocks = [re.findall(r"^ *```\w*\n(.*?)^ *```$", item, re.DOTALL | re.MULTILINE) for item in items]
    (library,), (scene,), (law, entry) = [[textwrap.dedent(block) for block in found] for found in blocks]
    return Pieces(library, names[0][0], scene, law, entry)


PIECES = read_pieces()


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    """Copy the program to a folder and add the law at the named places."""
    root = tmp_path_factory.mktemp("copy")
    for name in ("ffsi", "templates", "edp"):
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    (root / PIECES.path).write_text(PIECES.library, encoding="utf-8")
    insert(root / SCENE, UNION, PIECES.scene + "\n\n")
    scene = (root / SCENE).read_text(encoding="utf-8")
    assert scene.count(UNION) == 1
    (root / SCENE).write_text(scene.replace(UNION, f"{UNION}Sisko | "), encoding="utf-8")
    with (root / LAW).open("a", encoding="utf-8") as file:
        file.write("\n\n" + PIECES.law)
    insert(root / ENTRY, "}", textwrap.indent(PIECES.entry, "    "), after=REGISTRY)
    return root


def sisko(consistency: float, exponent: float, infinity: float) -> str:
    constants = f"consistency={consistency}, exponent={exponent}, viscosity_infinity={infinity}"
    return f'fluid={{law="sisko", density=1000, {constants}}}'


def result_of(folder: Path) -> dict:
    return json.loads((folder / "result.json").read_text())


def test_the_new_law_is_solved_and_checked(copy):
    folder = run(copy, CASE, "sisko", sisko(1.0, 0.6, 0.5))
    result = result_of(folder)
    assert (result["status"], result["check_failures"]) == ("converged", [])
    assert 'law = "sisko"' in (folder / "scene.toml").read_text()
    with pytest.raises(SceneError, match="sisko"):
        load_scene(folder / "scene.toml")


def test_in_time(copy):
    steps = ["time.step=0.01", "time.end=0.03", "inflow.ramp=0.1"]
    result = result_of(run(copy, CASE, "time", sisko(1.0, 0.6, 0.5), *steps))
    assert (result["status"], result["check_failures"]) == ("converged", [])


def test_with_exponent_one_it_is_newtonian(copy, solved):
    found = result_of(run(copy, CASE, "newtonian", sisko(0.4, 1.0, 0.6)))["quantities"]
    plain = solved(CASE).quantities
    # But for the outlet's condition, far behind the body, both have the same viscosity everywhere.
    for name in ("drag", "drag_surface", "tip_uy"):
        assert found[name] == pytest.approx(plain[name], rel=1e-3)
    assert found["pressure_drop"] == pytest.approx(plain["pressure_drop"], rel=1e-3)


def test_its_constants_are_checked(copy):
    done = ffsi(copy, "run", CASE, "--set", "fluid.law=sisko", "--out", str(copy / "bad"))
    assert done.returncode == 2
    assert "fluid.consistency: missing; consistency c, Pa s^m" in done.stderr
    assert not (copy / "bad").exists()


def test_nothing_else_was_touched(copy):
    assert differing(copy) == ({SCENE, LAW, ENTRY}, {PIECES.path})
