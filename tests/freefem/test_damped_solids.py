"""Kelvin-Voigt viscosity and Rayleigh's mass damping: the decay of a bar, wrong scripts."""

import numpy as np
import pytest
from conftest import scene_of
from own_mesh import scene_on, write_mesh
from recipes import copy_program, refused
from structured import structured_mesh

from ffsi.run.one_scene import solve
from ffsi.scene import SceneError

DENSITY, YOUNG, LENGTH, K = 2.0, 50.0, 2.0, 0.02
WAVE = np.pi / (2 * LENGTH)


def bar(folder, end=1.0, **damping):
    """[0, 2] x [0, 0.5], held on the left, its long sides lines of symmetry, in its first longitudinal mode."""
    mesh = structured_mesh(
        np.linspace(0, LENGTH, 13), np.linspace(0, 0.5, 3), lambda x, y: 2,
        lambda x, y: 3 if y in (0.0, 0.5) else 1 if x == 0 else 2,
    )  # fmt: skip
    path = write_mesh(folder / "bar.msh", mesh, {"bar": 2}, {"held": 1, "end": 2, "sides": 3})
    solid = {"material": "linear-elastic", "density": DENSITY, "young_modulus": YOUNG, "poisson_ratio": 0.0, **damping}
    return scene_on(
        path, {"clamped": "held", "symmetry": "sides"}, {"bar": "bar"}, solid={"bar": solid},
        start={"displacement_x": f"1e-6*sin({WAVE!r}*x)"},
        time={"step": K, "end": end, "scheme": "crank-nicolson", "output_interval": K},
    )  # fmt: skip


def oscillator(rate, steps):
    """The scheme, after two steps of backward Euler, for q' = p, p' = -w^2 q - rate p from q = 1, p = 0."""
    system, one = np.array([[0.0, 1.0], [-YOUNG / DENSITY * WAVE**2, -rate]]), np.eye(2)
    state, found = np.array([1.0, 0.0]), []
    for n in range(steps):
        theta = 1.0 if n < 2 else 0.5
        state = np.linalg.solve(one - theta * K * system, (one + (1 - theta) * K * system) @ state)
        found.append(state[0])
    return found


@pytest.mark.parametrize(
    ("damping", "rate"),
    [
        ({}, 0.0),
        ({"viscosity": 3.0}, 3.0 / DENSITY * WAVE**2),
        ({"mass_damping": 1.5}, 1.5),
        ({"viscosity": 3.0, "mass_damping": 1.5}, 1.5 + 3.0 / DENSITY * WAVE**2),
    ],
)
def test_a_bar_decays_as_an_oscillator(damping, rate, tmp_path):
    result = solve(bar(tmp_path, **damping), tmp_path / "run")
    assert result.checked
    tip = 1e6 * result.history["tip_ux"].to_numpy()
    np.testing.assert_allclose(tip, oscillator(rate, len(tip)), rtol=0, atol=2e-5)
    history = result.history
    total = history["kinetic"] + history["elastic"] + history["dissipated"] - history["work"]
    assert np.ptp(total[2:]) < 1e-5 * np.abs(history["elastic"]).max()


WRONG = [
    ("edp/lib/solid-step.idp", "*SolidViscosity(s)/timeK", "*SolidViscosity(s)/(1.001*timeK)"),
    ("edp/lib/solid-step.idp", "mean(:, r+i).*change(:, r+j)", "mean(:, r+j).*change(:, r+i)"),
    ("edp/lib/start-of-step.idp", "AddProduct(massDamping, 1-timeTheta", "AddProduct(massDamping, timeTheta"),
]
DAMPED = ["solid.beam.viscosity=200", "solid.beam.mass_damping=3", "time.end=0.02", "time.stop=none", "mesh.level=0"]


def test_a_damped_beam_that_turns_is_checked(solved):
    assert solved("turek-csm3", *DAMPED).checked


@pytest.mark.parametrize(("path", "old", "new"), WRONG)
def test_a_wrong_damping_is_caught(path, old, new, tmp_path):
    assert "momentum" in refused(copy_program(tmp_path / "copy"), path, old, new, "turek-csm3", *DAMPED)


@pytest.mark.parametrize("key", ["viscosity", "mass_damping"])
def test_steady_solids_have_none(key):
    with pytest.raises(SceneError, match=rf"solid\.flap\.{key} = 1: only accepted in a scene with a table time"):
        scene_of("flap-svk", f"solid.flap.{key}=1")
