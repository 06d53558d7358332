"""Walls with a displacement: a piston, a cylinder that heaves, wrong scripts, what is refused."""

import numpy as np
import pytest
from conftest import scene_of
from own_mesh import scene_on, write_mesh
from recipes import copy_program, refused
from structured import structured_mesh

from ffsi.files.arrays import read_mesh, read_state
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, SceneError
from ffsi.script.render import render

PISTON = "0.4*(1 - cos(2*t))"
TIME = {"step": 0.05, "end": 0.6}


def cylinder(folder, **tables) -> Scene:
    """[0, 2] x [0, 1] without friction: a piston on the left, half of the right end an outlet, half an inlet."""

    def label(x, y):
        return {0.0: 3, 1.0: 3}.get(y) or (1 if x == 0 else 2 if y < 0.5 else 4)

    mesh = structured_mesh(np.linspace(0, 2, 9), np.linspace(0, 1, 5), lambda x, y: 1, label)
    path = write_mesh(folder / "cylinder.msh", mesh, {"fluid": 1}, {"piston": 1, "out": 2, "sides": 3, "open": 4})
    sides = {"walls": "piston", "slip": "sides", "outlet": "out", "inlet": "open"}
    flow = {
        "fluid": {"density": 2.0, "viscosity": 0.1}, "outlet": {"out": {"kind": "do-nothing"}},
        "inlet": {"open": {"pressure": 0}},
        "walls": {"piston": {"displacement_x": PISTON}}, "time": TIME, "solver": {"step_tolerance": 1e-12},
    }  # fmt: skip
    return scene_on(path, sides, {"fluid": "fluid"}, **{**flow, **tables})


def linear(time):
    return 0.4 * (1 - np.cos(2 * time)), 0.8 * np.sin(2 * time)


@pytest.mark.parametrize("kind", ["linear-elastic", "hyperelastic"])
def test_a_piston_drives_a_plug(kind, tmp_path):
    result = solve(cylinder(tmp_path, mesh_motion={"kind": kind}), tmp_path / "run")
    assert result.checked
    mesh = read_mesh(result.directory / "mesh.bin")
    state = read_state(result.directory / "point-0001.bin", mesh)
    (place, speed), (before, old_speed) = linear(0.6), linear(0.55)
    np.testing.assert_allclose(state.v, np.broadcast_to([speed, 0.0], state.v.shape), rtol=0, atol=1e-9)
    x = mesh.p2_coordinates[:, 0]
    np.testing.assert_allclose(state.u, np.column_stack([place * (1 - x / 2), 0 * x]), rtol=0, atol=1e-9)
    theta = 0.5 + 0.05
    middle = theta * place + (1 - theta) * before
    at = middle + mesh.vertices[:, 0] * (1 - middle / 2)
    np.testing.assert_allclose(state.p, 2.0 * (speed - old_speed) / 0.05 * (2 - at), rtol=0, atol=1e-8)
    history = result.history
    flow = history["flow_through_out"] - history["flow_through_open"]
    np.testing.assert_allclose(flow, linear(history["time"])[1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["linear-elastic", "hyperelastic"])
def test_a_cylinder_that_heaves_is_checked(kind, solved):
    """Between the walls of a channel, bent edges and all; at rest in between the lift is that of its acceleration."""
    up = ["walls.cylinder.displacement_y=0.03*sin(4*t)^2", "walls.cylinder.displacement_x=(x-0.2)*sin(t)^2"]
    time = ["time.step=0.02", "time.end=0.1", "inflow.ramp=0.1", f"mesh_motion.kind={kind}"]
    result = solved("cylinder-2d1", *up, *time)
    assert result.checked


WRONG = [
    ("templates/case.edp.j2", "return {{ formula }};", "return 1.001*({{ formula }});"),
    ("edp/lib/moving-walls.idp", "c*N2+wallNodes", "(1-c)*N2+wallNodes"),
    ("ffsi/scene/expressions.py", '"cos": "-sin(u)"', '"cos": "sin(u)"'),
]
CYLINDER = ["walls.cylinder.displacement_y=0.01*(1 - cos(4*t))", "time.step=0.02", "time.end=0.06", "inflow.ramp=0.1"]


@pytest.mark.parametrize(("path", "old", "new"), WRONG)
def test_a_wrong_movement_is_caught(path, old, new, tmp_path):
    assert "prescribed" in refused(copy_program(tmp_path / "copy"), path, old, new, "cylinder-2d1", *CYLINDER)


REFUSED = [
    ({"displacement_x": "t", "velocity_y": 1}, "velocity_y = 1: not accepted beside a displacement"),
    ({"displacement_x": "1 + t"}, "displacement_x = .1 \\+ t.: it is not 0 at t = 0 but 1 m"),
    ({"displacement_x": "sqrt(t)"}, "displacement_x = .sqrt\\(t\\).: it or its rate is not defined everywhere"),
    ({"displacement_x": "abs(t)"}, 'the function "abs" has no derivative everywhere; accepted: a smooth formula'),
    ({"displacement_x": "z*t"}, 'unknown name "z"; accepted: "x", "y", "t"'),
]


@pytest.mark.parametrize(("wall", "text"), REFUSED)
def test_refused(wall, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        cylinder(tmp_path, walls={"piston": wall})


def test_refused_where_nothing_moves(tmp_path):
    with pytest.raises(SceneError, match=r"walls\.piston\.displacement_x.*only accepted in a scene with a table time"):
        cylinder(tmp_path, time=None)
    with pytest.raises(SceneError, match='the wall "walls" of this geometry can have no displacement'):
        scene_of("turek-fsi2", "walls.walls.displacement_x=t")


def test_a_later_end_keeps_the_units_in_which_checkpoints_are():
    motion = ["walls.cylinder.displacement_x=0.005*t^2", "inflow.mean_velocity=0", "time.step=0.05"]
    one, two = (scene_of("cylinder-2d1", *motion, f"time.end={end}") for end in (1, 2))
    assert render(one) == render(two).replace('"time.end", 2.0', '"time.end", 1.0')
