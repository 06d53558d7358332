"""The section "A new mesh motion" of docs/extend.md, done to a copy of the program and nothing else, and run there."""

from pathlib import Path

import numpy as np
import pytest
from manufactured import assert_derivative
from recipes import copy_program, differing, enter, insert, read_places, refused, replace, result_of, run, run_all

from ffsi.reference import materials, mesh_motion

SCENE, LAW = "ffsi/scene/numerics.py", "ffsi/reference/mesh_motion.py"
KINDS = '    kind: Literal["harmonic", '
SLOW = "inflow.mean_velocity=0.06"
NEW = "mesh_motion.kind=distortion"
MOVED = {"flap-svk": [SLOW], "turek-fsi1": []}
PLACES = read_places("A new mesh motion")
LIBRARY = PLACES[0].files[0]


def with_motion(root: Path, library: str, path: str, entry: str, law: str, law_entry: str) -> Path:
    copy_program(root)
    (root / path).write_text(library, encoding="utf-8")
    replace(root / SCENE, KINDS, f"{KINDS}{entry.split(':')[0]}, ")
    enter(root / SCENE, "MOTIONS = {", entry)
    insert(root / LAW, "# By the kind", law + "\n\n")
    enter(root / LAW, "MOTIONS: dict[", law_entry)
    return root


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    assert [place.files for place in PLACES[1:]] == [[SCENE], [LAW]]
    (library,), (entry,), (law, law_entry) = [place.blocks for place in PLACES]
    root = with_motion(tmp_path_factory.mktemp("copy"), library, LIBRARY, entry, law, law_entry)
    replace(root / LAW, "IDENTITY, Array,", "IDENTITY, Array, cofactor, determinant, double_dot,")
    return root


def test_the_flux_is_the_derivative_of_the_energy():
    names = dict(vars(materials))
    exec(PLACES[2].blocks[0], names)
    gradients = np.random.default_rng(1).normal(size=(20, 2, 2)) * 0.2
    flux = sum(names["distortion"](gradients, 0.7).values())

    def energy(gradient):
        deformation = np.eye(2) + gradient
        jacobian = deformation[:, 0, 0] * deformation[:, 1, 1] - deformation[:, 0, 1] * deformation[:, 1, 0]
        return (deformation**2).sum(axis=(1, 2)) / (2 * jacobian) + 0.35 * np.log(jacobian) ** 2

    assert_derivative(flux, energy, gradients, 1e-13)


@pytest.fixture(scope="module")
def runs(copy) -> dict[str, Path]:
    return run_all(copy, {case: [case, NEW, *settings] for case, settings in MOVED.items()})


@pytest.mark.parametrize(("case", "settings"), MOVED.items())
def test_it_moves_the_mesh_and_not_the_solid(runs, solved, case, settings):
    folder = runs[case]
    result = result_of(folder)
    assert result["check"]["mesh_motion"] < 1e-8
    assert 'kind = "distortion"' in (folder / "scene.toml").read_text()
    usual = solved(case, *settings).quantities
    assert result["quantities"]["tip_uy"] == pytest.approx(usual["tip_uy"], rel=0.02)
    assert abs(result["quantities"]["min_jacobian_fluid"] / usual["min_jacobian_fluid"] - 1) > 1e-3


def test_a_wrong_sign_is_caught_and_nothing_else_was_touched(copy):
    told = refused(copy, LIBRARY, "motionFactor -= 0.5", "motionFactor += 0.5", "flap-svk", NEW, SLOW)
    assert "mesh_motion: the relative residual of the mesh motion" in told
    assert differing(copy) == ({SCENE, LAW}, {LIBRARY})
    assert not (Path(mesh_motion.__file__).parents[2] / LIBRARY).exists()


# A linear one, by the section's last paragraph: as the other for small motions ----------------------------------------

MACROS = """
macro meshMotionXX() alpha*((1+beta)*dx(a)*dx(b) + dy(a)*dy(b)) //
macro meshMotionYY() alpha*(dx(a)*dx(b) + (1+beta)*dy(a)*dy(b)) //
macro meshMotionXY() alpha*((beta-1)*dy(a)*dx(b) + dx(a)*dy(b)) //
macro meshMotionYX() alpha*((beta-1)*dx(a)*dy(b) + dy(a)*dx(b)) //
"""
CONFORMAL = """
def conformal(gradient: Array, beta: float) -> dict[str, Array]:
    return linear_elastic(gradient, beta - 1.0)
"""


def test_a_linear_motion_goes_in_time(tmp_path):
    texts = MACROS, "edp/lib/conformal-motion.idp", '"conformal": MotionLaw(2.0),\n', CONFORMAL
    root = with_motion(tmp_path, *texts, '"conformal": conformal,\n')
    steps = ["time.step=0.01", "time.end=0.02", "inflow.ramp=0.1", "mesh_motion.kind=conformal"]
    assert result_of(run(root, "turek-fsi3", "fsi3", *steps))["check"]["mesh_motion"] < 1e-8
