"""The section "A new material" of docs/extend.md, done to a copy of the program and nothing else, and run there."""

import difflib
import json
import re
from dataclasses import dataclass
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from manufactured import assert_derivative
from recipes import ROOT, append, copy_program, differing, enter, insert, join_union, read_places, run_all
from test_materials import FRESH, assert_quadratic

from ffsi.files.arrays import RawState, read_mesh, read_state
from ffsi.reference import materials
from ffsi.scene import SceneError, load_scene

SCENE, LAW, ENTRY = "ffsi/scene/materials.py", "ffsi/reference/materials.py", "ffsi/reference/from_scene.py"
UNION = "Solid = Annotated["
REGISTRY = "MATERIALS: dict["
CONSTANTS = {"c1": 1.0, "c2": 3.0, "c3": 6.0}
BULK = 5.0


@dataclass(frozen=True)
class Pieces:
    """What the page adds: the library's file and its path, the class of the scene, the checker's, its entry."""

    library: str
    path: str
    scene: str
    law: str
    entry: str

    @property
    def class_name(self) -> str:
        return re.search(r"^class (\w+)\(", self.scene, re.MULTILINE).group(1)

    @property
    def material(self) -> str:
        return re.search(r'Literal\["([\w-]+)"\]', self.scene).group(1)


def read_pieces() -> Pieces:
    """Return the code blocks of the section, each from the numbered item that names its file."""
    places = read_places("A new material")
    assert [place.files[0] for place in places[1:]] == [SCENE, LAW] and ENTRY in places[2].files
    (library,), (scene,), (law, entry) = [place.blocks for place in places]
    return Pieces(library, places[0].files[0], scene, law, entry)


PIECES = read_pieces()


def with_material(root: Path, pieces: Pieces) -> Path:
    copy_program(root)
    (root / pieces.path).write_text(pieces.library, encoding="utf-8")
    insert(root / SCENE, UNION, pieces.scene + "\n\n")
    join_union(root / SCENE, UNION, pieces.class_name)
    append(root / LAW, pieces.law)
    enter(root / ENTRY, REGISTRY, pieces.entry)
    return root


def constants(solid: str, **values: float) -> list[str]:
    return [f"solid.{solid}.{name}={value}" for name, value in values.items()]


def state_of(folder: Path) -> RawState:
    return read_state(folder / "point-0001.bin", read_mesh(folder / "mesh.bin"))


def assert_same(first: RawState, second: RawState) -> None:
    for field in ("u", "v", "p", "ps"):
        values, others = getattr(first, field), getattr(second, field)
        assert values.shape == others.shape
        np.testing.assert_allclose(values, others, rtol=0, atol=1e-9 * np.abs(others).max(initial=0.0))


copy = pytest.fixture(lambda tmp_path_factory: with_material(tmp_path_factory.mktemp("copy"), PIECES), scope="module")

FLAP = ["inflow.mean_velocity=0.06", f"solid.flap.bulk_modulus={BULK}"]
YEOH_FLAP = [*FLAP, f"solid.flap.material={PIECES.material}"]


@pytest.fixture(scope="module")
def runs(copy) -> dict[str, Path]:
    flap = ["flap-mooney-rivlin", *FRESH, *YEOH_FLAP]
    settings = {
        "flap": [*flap, *constants("flap", **CONSTANTS)],
        "flap-c1": [*flap, *constants("flap", c1=1, c2=0, c3=0)],
        "aneurysm": ["aneurysm", *FRESH, *walls(PIECES.material, c1=3e4, c2=1e5, c3=1e5), "output.vtu=true"],
        "aneurysm-c1": ["aneurysm", *FRESH, *walls(PIECES.material, c1=3e4, c2=0, c3=0)],
    }
    return run_all(copy, settings)


flap = pytest.fixture(lambda runs: runs["flap"], scope="module")


def test_the_stress_is_the_derivative_of_the_energy():
    names = dict(vars(materials))
    exec(PIECES.law, names)
    law = names[PIECES.class_name](**CONSTANTS, bulk_modulus=BULK)
    gradients = np.random.default_rng(1).normal(size=(20, 2, 2)) * 0.2
    stress = law.first_piola(gradients)
    assert_derivative(stress, law.energy, gradients, 1e-13)
    np.testing.assert_allclose(law.first_piola(np.diag([1e-9, 0.0]))[0, 0], 1e-9 * law.stiffness, rtol=1e-6)


def test_the_new_material_is_solved_and_checked(flap, runs, solved):
    result = json.loads((flap / "result.json").read_text())
    assert (result["status"], result["check_failures"]) == ("converged", [])
    check = {name: value for name, value in result["check"].items() if value is not None}
    assert {"momentum", "continuity", "kinematics", "mesh_motion", "drag_difference"} <= set(check)
    assert max(check.values()) < 1e-8 and f'material = "{PIECES.material}"' in (flap / "scene.toml").read_text()
    history = pd.read_csv(flap / "newton.csv")
    assert (history["factorized"].iloc[:-1] == 1).all()
    assert_quadratic(history)
    mooney = solved("flap-mooney-rivlin", *FRESH, *FLAP, *constants("flap", c10=1, c01=0))
    assert mooney.converged
    assert_same(state_of(runs["flap-c1"]), state_of(mooney.directory))
    tip = json.loads((flap / "result.json").read_text())["quantities"]["tip_ux"]
    assert abs(tip / mooney.quantities["tip_ux"] - 1) > 0.01, "the other constants shall matter"


def walls(material: str, **values: float) -> list[str]:
    numbers = ", ".join(f"{name}={value}" for name, value in values.items())
    solid = f'{{material="{material}", density=1120, bulk_modulus=1e5, {numbers}}}'
    return [f"solid.vessel={solid}", f"solid.dome={solid}"]


def test_in_an_aneurysm_it_has_its_effective_stress(runs, solved):
    """Of the checker's law, across the plane too: without its own constants that of Mooney-Rivlin."""
    own = runs["aneurysm"]
    result = json.loads((own / "result.json").read_text())
    assert (result["status"], result["not_evaluated"], result["check_failures"]) == ("converged", [], [])
    assert np.nanmax(meshio.read(own / "fields.vtu").point_data["effective_stress"]) > 1000
    plain = json.loads((runs["aneurysm-c1"] / "result.json").read_text())["quantities"]
    mooney = solved("aneurysm", *FRESH, *walls("mooney-rivlin", c10=3e4, c01=0)).quantities
    names = [name for name in plain if name.startswith("effective_stress")]
    assert len(names) == 3
    for name in names:
        assert plain[name] == pytest.approx(mooney[name], rel=1e-8)
    assert abs(result["quantities"]["effective_stress_max"] / plain["effective_stress_max"] - 1) > 1e-3


def test_nothing_else_was_touched(copy, flap):
    assert differing(copy) == ({SCENE, LAW, ENTRY}, {PIECES.path})
    for name in (SCENE, LAW, ENTRY):
        before, after = ((root / name).read_text(encoding="utf-8").splitlines() for root in (ROOT, copy))
        removed = [line for line in list(difflib.unified_diff(before, after, n=0))[2:] if line.startswith("-")]
        assert [line[: len(UNION) + 1] for line in removed] == (["-" + UNION] if name == SCENE else [])
    assert not (ROOT / PIECES.path).exists()
    with pytest.raises(SceneError, match=PIECES.material):
        load_scene(flap / "scene.toml")


# The forms with a pressure, by the section's last paragraph -----------------------------------------------------------

VOLUME = """
func int YeohVolume(real[int,int] &a, real[int] &c, real[int] &J, real C1, real C2, real C3, real K) { // J - 1 + p/K
  c = a(:, 4); c *= 1/K; c += J; c -= 1.;
  return 0;
}
"""
SPLIT = """
    def volume_energy(self, change: Array) -> Array:
        return change**2 / 2

    def volume_slope(self, change: Array) -> Array:
        return change

    @property
    def volume_modulus(self) -> float:
        return self.bulk_modulus
"""

# Changes of the pieces: the old text, which stands there once, and the new one.
SCENE_CHANGES = [
    ("(Elastic)", "(WithFormulation)"),
    ("    c1:", '    volume_constants: ClassVar[tuple[str, ...]] = ("bulk_modulus",)\n    c1:'),
    ("bulk_modulus: Modulus = Field(", "bulk_modulus: Modulus | None = Field(None, "),
    ("return self.bulk_modulus", "return (self.bulk_modulus or math.inf)"),
]
LAW_CHANGES = [
    ("(Material)", "(SplitMaterial)"),
    ("def energy", "def base_energy"),
    (" + self.bulk_modulus / 2 * dilatation(gradient) ** 2", ""),
    ("def first_piola", "def base_stress"),
    (" + self.bulk_modulus * dilatation(gradient)[..., None, None] * cofactor(IDENTITY + gradient)", ""),
    ("def stiffness", "def base_stiffness"),
    ("return self.bulk_modulus + ", "return "),
]
ENTRY_CHANGES = [("solid.bulk_modulus", "math.inf if solid.bulk_modulus is None else solid.bulk_modulus")]


def changed(text: str, changes: list[tuple[str, str]]) -> str:
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def mixed_copy(tmp_path_factory) -> Path:
    pieces = Pieces(
        library=PIECES.library + VOLUME, path=PIECES.path, scene=changed(PIECES.scene, SCENE_CHANGES),
        law=changed(PIECES.law, LAW_CHANGES) + SPLIT, entry=changed(PIECES.entry, ENTRY_CHANGES),
    )  # fmt: skip
    return with_material(tmp_path_factory.mktemp("mixed-copy"), pieces)


def membrane(formulation: str, material: str, **values: float) -> list[str]:
    numbers = ", ".join(f"{name}={value}" for name, value in values.items())
    bulk = f", bulk_modulus={BULK}" if formulation == "mixed" else ""
    solid = f'material="{material}", formulation="{formulation}", density=1, {numbers}{bulk}'
    return ["cook", *FRESH, "traction.y=0.05", f"solid.membrane={{{solid}}}"]


FORMULATIONS = ("mixed", "incompressible")


@pytest.fixture(scope="module")
def mixed_runs(mixed_copy) -> dict[str, Path]:
    own = {form: membrane(form, PIECES.material, **CONSTANTS) for form in FORMULATIONS}
    plain = {f"{form}-c1": membrane(form, PIECES.material, c1=1, c2=0, c3=0) for form in FORMULATIONS}
    return run_all(mixed_copy, own | plain)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_the_forms_with_a_pressure(mixed_runs, solved, formulation):
    """They are checked, and without the other constants the same as those of Mooney-Rivlin."""
    mooney = solved(*membrane(formulation, "mooney-rivlin", c10=1, c01=0))
    assert_same(state_of(mixed_runs[f"{formulation}-c1"]), state_of(mooney.directory))
