"""Kelvin-Voigt viscosity, Rayleigh's mass damping, springs and dampers: the motion of a bar."""

import numpy as np
import pytest
from conftest import scene_of
from own_mesh import checked, scene_on, write_mesh
from structured import structured_mesh

from ffsi.run.one_scene import solve
from ffsi.scene import SceneError, with_values

DENSITY, YOUNG, LENGTH, K = 2.0, 50.0, 2.0, 0.02
WAVE = np.pi / (2 * LENGTH)


def bar(folder, wave=WAVE, loads=None, **damping):
    """[0, 2] x [0, 0.5], held on the left, its long sides lines of symmetry; in time in a longitudinal mode."""
    mesh = structured_mesh(
        np.linspace(0, LENGTH, 13), np.linspace(0, 0.5, 3), lambda x, y: 2,
        lambda x, y: 3 if y in (0.0, 0.5) else 1 if x == 0 else 2,
    )  # fmt: skip
    path = write_mesh(folder / "bar.msh", mesh, {"bar": 2}, {"held": 1, "end": 2, "sides": 3})
    solid = {"material": "linear-elastic", "density": DENSITY, "young_modulus": YOUNG, "poisson_ratio": 0.0, **damping}
    swings = {
        "start": {"displacement_x": f"1e-6*sin({wave!r}*x)"},
        "time": {"step": K, "end": 1.0, "scheme": "crank-nicolson", "output_interval": K},
    }
    sides = {"clamped": "held", "symmetry": "sides", **({"loaded": "end"} if loads else {})}
    tables = {"solid": {"bar": solid}, **(swings if wave else {}), **({"loads": {"end": loads}} if loads else {})}
    return scene_on(path, sides, {"bar": "bar"}, **tables)  # fmt: skip


def oscillator(rate, steps, wave=WAVE):
    """The scheme, after two steps of backward Euler, for q' = p, p' = -w^2 q - rate p from q = 1, p = 0."""
    system, one = np.array([[0.0, 1.0], [-YOUNG / DENSITY * wave**2, -rate]]), np.eye(2)
    state, found = np.array([1.0, 0.0]), []
    for n in range(steps):
        theta = 1.0 if n < 2 else 0.5
        state = np.linalg.solve(one - theta * K * system, (one + (1 - theta) * K * system) @ state)
        found.append(state[0])
    return found


@pytest.mark.parametrize(("damping", "rate"), [
    ({}, 0.0), ({"viscosity": 3.0}, 3.0 / DENSITY * WAVE**2), ({"mass_damping": 1.5}, 1.5),
    ({"viscosity": 3.0, "mass_damping": 1.5}, 1.5 + 3.0 / DENSITY * WAVE**2),
])  # fmt: skip
def test_a_bar_decays_as_an_oscillator(damping, rate, tmp_path):
    result = checked(bar(tmp_path, **damping), tmp_path / "run")
    tip = 1e6 * result.history["tip_ux"].to_numpy()
    np.testing.assert_allclose(tip, oscillator(rate, len(tip)), rtol=0, atol=2e-5)
    history = result.history
    total = history["kinetic"] + history["elastic"] + history["dissipated"] - history["work"]
    assert np.ptp(total[2:]) < 1e-5 * np.abs(history["elastic"]).max()


def test_a_bar_that_has_come_to_rest_is_checked(tmp_path):
    """What is left of its motion is solved to round-off of itself, not of the fastest."""
    scene = with_values(bar(tmp_path, viscosity=20.0), {"time.end": 9.0, "time.output_interval": 1.0})
    result = solve(scene, tmp_path / "run")
    assert result.checked and np.abs(result.history["tip_ux"].iloc[-1]) < 1e-16


def test_a_bar_pulled_against_a_spring(tmp_path):
    result = checked(bar(tmp_path, None, {"traction_x": 3.0, "stiffness": 7.0}), tmp_path / "run")
    assert result.quantities["tip_ux"] == pytest.approx(3.0 / (YOUNG / LENGTH + 7.0), rel=1e-10)
    with pytest.raises(SceneError, match=r"loads\.end\.damping: only accepted in a scene with a table time"):
        bar(tmp_path, None, {"damping": 1.0})


def test_a_damper_takes_the_wave(tmp_path):
    """One with the impedance sqrt(E rho) sends nothing back: after the time of two lengths all is at rest."""
    result = checked(bar(tmp_path, WAVE, {"damping": np.sqrt(YOUNG * DENSITY), "stiffness": 0.0}), tmp_path / "run")
    assert result.history["kinetic"].iloc[-1] < 1e-2 * result.history["kinetic"].max()


@pytest.mark.parametrize("key", ["viscosity", "mass_damping"])
def test_steady_solids_have_none(key):
    with pytest.raises(SceneError, match=rf"solid\.flap\.{key} = 1: only accepted in a scene with a table time"):
        scene_of("flap-svk", f"solid.flap.{key}=1")
