"""Walls without friction, lines of symmetry, walls that move: exact flows, halves of whole domains, wrong scripts."""

import numpy as np
import pytest
from conftest import scene_of
from own_mesh import checked, scene_on, write_mesh
from recipes import copy_program, refused
from scipy.interpolate import CubicSpline
from structured import structured_mesh

from ffsi.files.arrays import read_mesh, read_state
from ffsi.files.errors import InputError
from ffsi.run.one_scene import solve
from ffsi.run.sensitivities import sensitivities
from ffsi.scene import Scene, SceneError, load_scene
from ffsi.script.render import render

WATER = {"density": 2.0, "viscosity": 0.1}
NAMES = {"in": 1, "out": 2, "low": 3, "high": 4, "ends": 6, "outside": 7}
RUBBER = {"material": "neo-hookean", "density": 3.0, "young_modulus": 40.0, "poisson_ratio": 0.3}


def channel(folder, boundaries, **tables) -> Scene:
    """A channel [0, 2] x [0, 1], its low side and its high one by name."""
    x, y = np.linspace(0, 2, 9), np.linspace(0, 1, 5)

    def label(x, y):
        return {0.0: 3, 1.0: 4}.get(y) or (1 if x == 0 else 2)

    path = write_mesh(folder / "channel.msh", structured_mesh(x, y, lambda x, y: 1, label), {"fluid": 1}, NAMES)
    precise = {"step_tolerance": 1e-12} if "time" in tables else {}
    flow = {
        "solver": precise, "fluid": WATER, "outlet": {"kind": "do-nothing"},
        "inflow": {"mean_velocity": 1.5, "profile": "uniform"},
    }  # fmt: skip
    return scene_on(path, {"inlet": "in", "outlet": "out", **boundaries}, {"fluid": "fluid"}, **{**flow, **tables})


def state_of(result):
    mesh = read_mesh(result.directory / "mesh.bin")
    return mesh, read_state(result.directory / "point-0001.bin", mesh)


@pytest.mark.parametrize("time", [None, {"step": 0.1, "end": 0.3}], ids=["steady", "in time"])
def test_a_uniform_flow_slips_through(time, tmp_path):
    inflow = {"mean_velocity": 1.5, "profile": "uniform"} | ({"ramp": 0.2} if time else {})
    scene = channel(tmp_path, {"slip": ["low", "high"]}, inflow=inflow, **({"time": time} if time else {}))
    result = checked(scene, tmp_path / "run")
    _, state = state_of(result)
    np.testing.assert_allclose(state.v, np.broadcast_to([1.5, 0.0], state.v.shape), rtol=0, atol=1e-9)
    np.testing.assert_allclose(state.p, 0.0, atol=1e-8)
    assert load_scene(tmp_path / "run/scene.toml") == scene


@pytest.mark.parametrize("profile", ["uniform", "4*y^3"])
def test_a_flow_between_walls_at_rest_loses_nothing_at_its_ends(profile, tmp_path):
    """Half of an edge at each end carried nothing, a twelfth of the uniform flow here."""
    inflow = {"mean_velocity": 1.5, "profile": profile}
    result = checked(channel(tmp_path, {"walls": ["low", "high"]}, inflow=inflow), tmp_path / "run")
    mesh, state = state_of(result)
    for label in (1, 2):
        edges = mesh.edge_nodes[np.abs(mesh.p2_coordinates[mesh.edge_nodes[:, 2], 0] - 2 * (label - 1)) < 1e-12]
        length = np.abs(np.diff(mesh.p2_coordinates[edges[:, :2], 1]))[:, 0]
        assert length @ (state.v[edges, 0] @ [1, 1, 4]) / 6 == pytest.approx(1.5, rel=1e-9)


def test_half_a_channel_is_half_of_its_flow(tmp_path):
    half = channel(tmp_path, {"walls": "low", "symmetry": "high"}, inflow={"mean_velocity": 1, "profile": "y*(2*H-y)"})
    mesh, state = state_of(solve(half, tmp_path / "run"))
    y = mesh.p2_coordinates[:, 1]
    np.testing.assert_allclose(state.v[:, 0], y * (2 - y), rtol=0, atol=1e-9)


@pytest.mark.parametrize("waveform", [None, "1", "cos(t)"])
def test_walls_carry_the_fluid_along(waveform, tmp_path):
    """Plane Couette flow between a wall at rest and one that moves; in time with a light fluid that soon is settled."""
    time = {} if waveform is None else {"time": {"step": 0.1, "end": 2}, "fluid": {"density": 1e-3, "viscosity": 0.1}}
    lid = {"velocity_x": 3.0} | ({"waveform": waveform} if waveform else {})
    inflow = {"mean_velocity": 3, "profile": "y/H"} | ({"waveform": waveform} if waveform else {})
    scene = channel(tmp_path, {"walls": ["low", "high"]}, walls={"high": lid}, inflow=inflow, **time)
    assert scene.geometry.boundaries.walls == ("low",)
    result = checked(scene, tmp_path / "run")
    mesh, state = state_of(result)
    factor = np.cos(2) if waveform == "cos(t)" else 1.0
    error = 3e-2 if waveform == "cos(t)" else 1e-7  # that of Couette flow without inertia
    np.testing.assert_allclose(state.v[:, 0], 3 * factor * mesh.p2_coordinates[:, 1], rtol=0, atol=error)


ANGLE = 0.3
TURN = np.array([[np.cos(ANGLE), np.sin(ANGLE)], [-np.sin(ANGLE), np.cos(ANGLE)]])


def turned(mesh):
    return type(mesh)(mesh.vertices @ TURN, mesh.triangles, mesh.region, mesh.edges, mesh.label, mesh.p2)


def flap(folder, half: bool, turn: bool = False, **tables) -> Scene:
    """An elastic block behind a rigid one in a channel; or the lower half of all, cut at the line of symmetry."""
    x, y = np.linspace(0, 3, 13), np.linspace(0, 1, 9)
    y = y[y < 0.51] if half else y

    def region(x, y):
        return 1 if not 0.25 < y < 0.75 or not 0.75 < x < 1.75 else 2 if x > 1 else 0

    def label(x, y):
        if y in (0.0, 1.0):
            return 3
        if half and y == 0.5:
            return 4
        if x == 1.0 and 0.25 < y < 0.75:
            return 6
        return {0.0: 1, 3.0: 2}.get(x, 3 if x < 1 else 5)

    mesh = structured_mesh(x, y, region, label)
    path = write_mesh(folder / f"flap{half}{turn}.msh", turned(mesh) if turn else mesh, {"water": 1, "block": 2}, NAMES)
    sides = {"inlet": "in", "outlet": "out", "walls": "low", "clamped": "ends"}
    sides |= {"symmetry": "high"} if half else {}
    profile = {"profile": "6*y*(1-y)"}
    return scene_on(
        path, sides, {"fluid": "water", "block": "block"},
        **{"fluid": WATER, "solid": {"block": RUBBER}, "outlet": {"kind": "do-nothing"},
            "inflow": {"mean_velocity": 1.0, **profile}, **tables},
    )  # fmt: skip


@pytest.mark.parametrize("time", [None, {"step": 0.02, "end": 0.1}], ids=["steady", "in time"])
def test_half_of_a_symmetric_scene_is_half_of_it(time, tmp_path):
    tables = {"time": time} if time else {}
    whole, half = (solve(flap(tmp_path, which, **tables), tmp_path / str(which)) for which in (False, True))
    assert whole.checked and half.checked
    (mesh, state), (part, of_part) = state_of(whole), state_of(half)
    same = [np.flatnonzero((np.abs(mesh.p2_coordinates - x) < 1e-12).all(axis=1))[0] for x in part.p2_coordinates]
    for field in ("u", "v"):
        values, found = getattr(state, field)[same], getattr(of_part, field)
        assert np.abs(values).max() > 1e-3
        np.testing.assert_allclose(found, values, rtol=0, atol=1e-7 * np.abs(values).max())
    moved = np.abs(of_part.u[(part.p2_coordinates[:, 1] == 0.5) & (part.p2_coordinates[:, 0] > 1.8), 0])
    assert moved.max() > 1e-4  # the mesh slides along the line
    assert whole.quantities["drag"] == pytest.approx(2 * half.quantities["drag"], rel=1e-7) if not time else True


@pytest.mark.parametrize(
    "time", [(), ("time.step=0.02", "time.end=0.06", "inflow.ramp=0.1")], ids=["steady", "in time"]
)
def test_a_cylinder_that_turns_lifts(solved, time):
    centre = ("walls.cylinder.centre_x=0.2", "walls.cylinder.centre_y=0.2")
    runs = [solved("cylinder-2d1", *centre, f"walls.cylinder.rotation={speed}", *time) for speed in (2, -2)]
    assert all(run.checked for run in runs)
    lifts = [run.history["lift"].iloc[-1] if time else run.quantities["lift"] for run in runs]
    assert lifts[0] * lifts[1] < 0


def test_what_a_turn_does_to_the_lift(solved):
    """The sensitivity by the rotation, the only number of a cylinder's wall that can change alone."""
    wall = ["walls.cylinder.centre_x=0.2", "walls.cylinder.centre_y=0.2"]
    scene = scene_of("cylinder-2d1", *wall, "walls.cylinder.rotation=2")
    found = sensitivities(scene, of=["lift"], to=["walls.cylinder.rotation"]).loc["walls.cylinder.rotation", "lift"]
    low, high = (solved("cylinder-2d1", *wall, f"walls.cylinder.rotation={w}").quantities["lift"] for w in (1.99, 2.01))
    assert found == pytest.approx((high - low) / 0.02, rel=1e-3)
    with pytest.raises(InputError, match=r"walls\.cylinder\.centre_x"):
        sensitivities(scene, of=["lift"], to=["walls.cylinder.centre_x"])


REFUSED = [
    ({"walls": ["low", "high"]}, {"high": {"velocity_y": 1}}, "walls.high: at .* it would move through itself"),
    ({"walls": ["low", "high"]}, {"hihg": {"velocity_x": 1}},
     'walls.hihg: no wall that can move; accepted: "low", "high"'),
    ({"walls": ["low", "high"]}, {"high": {"waveform": "t"}}, "walls.high.waveform.*only accepted in a scene with"),
    ({"walls": "low", "slip": "nothing"}, {}, "no such boundary"),
]  # fmt: skip


@pytest.mark.parametrize(("sides", "walls", "text"), REFUSED)
def test_refused(sides, walls, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        channel(tmp_path, sides, walls=walls)


MOTIONS = {"steady": {}, "in time": {"time": {"step": 0.02, "end": 0.1}}}
MOTIONS["hyperelastic, in time"] = {**MOTIONS["in time"], "mesh_motion": {"kind": "hyperelastic"}}


@pytest.mark.parametrize("tables", MOTIONS.values(), ids=MOTIONS)
def test_a_turned_scene_with_a_line_of_symmetry_is_turned(tables, tmp_path):
    straight, inclined = (solve(flap(tmp_path, True, turn, **tables), tmp_path / str(turn)) for turn in (False, True))
    assert straight.checked and inclined.checked, inclined.reason
    (mesh, state), (other, of_turned) = state_of(straight), state_of(inclined)
    np.testing.assert_allclose(mesh.p2_coordinates @ TURN, other.p2_coordinates, atol=1e-12)
    for field in ("u", "v"):
        values = getattr(state, field) @ TURN
        assert np.abs(values).max() > 1e-3
        np.testing.assert_allclose(getattr(of_turned, field), values, rtol=0, atol=1e-6 * np.abs(values).max())
    forces = [[result.data["quantities"][key] for key in ("drag", "lift")] for result in (straight, inclined)]
    if "time" not in tables:
        np.testing.assert_allclose(forces[1], np.array(forces[0]) @ TURN, rtol=1e-7)
        assert load_scene(tmp_path / "True/scene.toml") == flap(tmp_path, True, True)


WRONG_TIES = {
    "friction": ("rows[tiedTo[tied[i]]] += tieFactor", "rows[tiedTo[tied[i]]] += 0*tieFactor"),
    "a force": ("stepTractionX(from:to) += slide", "stepTractionX(from:to) -= slide"),
}


@pytest.mark.parametrize("name", WRONG_TIES)
def test_a_wrong_inclined_line_is_caught(name, tmp_path, broken_script):
    broken_script(*WRONG_TIES[name])
    assert not solve(flap(tmp_path, True, True), tmp_path / "run").checked


BENT = [
    (lambda x, y: (x, y + 0.05 * x * x), "it bends behind a single edge; accepted: straight pieces of several edges"),
    (lambda x, y: (x, y + 1e-6 * x * x), "in coordinates of at least 9 digits"),
]


@pytest.mark.parametrize(("bend", "text"), BENT)
def test_a_bent_slip_wall_is_refused(bend, text, tmp_path):
    mesh = structured_mesh(
        np.linspace(0, 2, 5), np.linspace(0, 1, 3), lambda x, y: 1, lambda x, y: 1 + (y in (0, 1)) * 2 + (x == 2)
    )
    bent = type(mesh)(
        np.column_stack(bend(*mesh.vertices.T)), mesh.triangles, mesh.region, mesh.edges, mesh.label, mesh.p2
    )
    path = write_mesh(tmp_path / "bent.msh", bent, {"fluid": 1}, {"in": 1, "out": 2, "sides": 3})
    with pytest.raises(SceneError, match=text):
        scene_on(
            path, {"inlet": "in", "outlet": "out", "slip": "sides"}, {"fluid": "fluid"}, fluid=WATER,
            outlet={"kind": "do-nothing"}, inflow={"mean_velocity": 1},
        )  # fmt: skip


def test_a_solid_on_one_inclined_line_is_not_held(tmp_path):
    mesh = structured_mesh(np.linspace(0, 1, 4), np.linspace(0, 1, 4), lambda x, y: 1, lambda x, y: 1 if y == 0 else 2)
    path = write_mesh(tmp_path / "solid.msh", turned(mesh), {"block": 1}, {"line": 1, "rest": 2})
    block = {"boundaries": {"symmetry": "line", "loaded": "rest"}, "regions": {"block": "block"}}
    for tables in ({"traction": {"x": 1}}, {"loads": {"rest": {"stiffness": 0, "pressure": 1}}}):
        with pytest.raises(SceneError, match="nothing holds the solid"):
            scene_on(path, **block, solid={"block": RUBBER}, **tables)
    assert scene_on(path, **block, solid={"block": RUBBER}, loads={"rest": {"stiffness": 1, "pressure": 1}})


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
    time = {"step": 0.05, "end": 1.55}  # it nearly rests then, and what is left of its speed is checked
    result = checked(cylinder(tmp_path, mesh_motion={"kind": kind}, time=time), tmp_path / "run")
    mesh, state = state_of(result)
    (place, speed), (before, old_speed) = linear(1.55), linear(1.5)
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


# A wrong script does not pass.
TURNS = [f"walls.cylinder.{key}" for key in ("rotation=2", "centre_x=0.2", "centre_y=0.2")]
HEAVES = ["walls.cylinder.displacement_y=0.01*(1 - cos(4*t))", "time.step=0.02", "time.end=0.06", "inflow.ramp=0.1"]
WRONG = [
    (TURNS, "edp/lib/moving-walls.idp", "wallFactor = 1;", "wallFactor = 1.001;"),
    (HEAVES, "ffsi/scene/expressions.py", '"cos": "-sin(u)"', '"cos": "sin(u)"'),
]


@pytest.mark.parametrize(("settings", "path", "old", "new"), WRONG)
def test_a_wrong_movement_of_a_wall_is_caught(settings, path, old, new, tmp_path):
    assert "prescribed" in refused(copy_program(tmp_path / "copy"), path, old, new, "cylinder-2d1", *settings)


REFUSED_MOTION = [
    ({"displacement_x": "t", "velocity_y": 1}, "velocity_y = 1: not accepted beside a displacement"),
    ({"displacement_x": "1 + t"}, "displacement_x = .1 \\+ t.: it is not 0 at t = 0 but 1 m"),
    ({"displacement_x": "sqrt(t)"}, "displacement_x = .sqrt\\(t\\).: it or its rate is not defined everywhere"),
    ({"displacement_x": "abs(t)"}, 'the function "abs" has no derivative everywhere; accepted: a smooth formula'),
    ({"displacement_x": "z*t"}, 'unknown name "z"; accepted: "x", "y", "t"'),
    ("t,x\n0,0\n1,1\n", r"displacement_file.*the columns are t, x; accepted: t, x, y"),
    ("t,x,y\n0,0,0\n0.5,1,1\n", r"displacement_samples\.at: ends at t = 0\.5 s; accepted: at time\.end or later"),
    (
        "t,x,y,angle\n0,0,0,1\n1,0,0,1\n",
        r"displacement_samples\.angle = 1: accepted: as many numbers as at, 2, the first 0",
    ),
    ("t,x,y\n0,0,0.1\n1,1,1\n", r"displacement_samples\.y = 0\.1: accepted: as many numbers as at, 2, the first 0"),
    ("t,x,y\n0.1,0,0\n1,1,1\n", r"displacement_samples\.at = 0\.1: accepted: increasing numbers from 0 on"),
    ("t,x,y\n0,0,0\n0.3,0,0.1\n0.300001,0,0.2\n0.5,0,0.1\n1,0,0\n", r"samples\.y: too rough for their distances"),
]


def moved_by_file(folder, rows: str, **tables) -> Scene:
    (folder / "motion.csv").write_text(rows)
    return cylinder(folder, walls={"piston": {"displacement_file": str(folder / "motion.csv")}}, **tables)


def test_a_piston_moves_as_a_file_says(tmp_path):
    at = np.linspace(0, 0.6, 41)
    x = 0.3 * np.sin(np.pi * at / 0.6) ** 12  # from rest, and comes back, where the terms of the spline cancel
    rows = "".join(f"{a},{b},0\n" for a, b in zip(at.tolist(), x.tolist(), strict=True))
    scene = moved_by_file(tmp_path, "t, x, y\n" + rows)
    result = checked(scene, tmp_path / "run")
    spline = CubicSpline(at, x, bc_type=((1, 0.0), (2, 0.0)))
    flow = result.history["flow_through_out"] - result.history["flow_through_open"]
    np.testing.assert_allclose(flow, spline(result.history["time"], 1), rtol=0, atol=1e-9)
    assert load_scene(tmp_path / "run/scene.toml") == scene


def test_a_cylinder_pitches_as_a_file_says(tmp_path):
    at = np.linspace(0, 0.1, 6)
    rows = [f"{t},{1e-3 * f},{-1e-2 * f},{0.3 * f}" for t, f in zip(at, np.sin(5 * np.pi * at) ** 2, strict=True)]
    (tmp_path / "pitch.csv").write_text("\n".join(["t,x,y,angle", *rows]))
    wall = [f'walls.cylinder.displacement_file="{tmp_path}/pitch.csv"', "walls.cylinder.centre_x=0.15"]
    scene = scene_of("cylinder-2d1", *wall, "walls.cylinder.centre_y=0.2", "time.step=0.02", "time.end=0.1")
    result = checked(scene, tmp_path / "run")
    assert load_scene(tmp_path / "run/scene.toml") == scene
    mesh, state = state_of(result)
    rim = np.unique(mesh.edge_nodes[mesh.label == 4])
    ray, after = mesh.p2_coordinates[rim] @ [1, 1j] - 0.2 - 0.2j, (mesh.p2_coordinates + state.u)[rim] @ [1, 1j]
    before = 0.05 + 0.05 * ray / np.abs(ray)  # on the circle, from the centre of the rotation
    np.testing.assert_allclose(after, 0.151 + 0.19j + np.exp(0.3j) * before, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("motion", "text"), REFUSED_MOTION)
def test_refused_motion(motion, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        moved_by_file(tmp_path, motion) if isinstance(motion, str) else cylinder(tmp_path, walls={"piston": motion})


def test_refused_where_nothing_moves(tmp_path):
    with pytest.raises(SceneError, match=r"walls\.piston\.displacement_x.*only accepted in a scene with a table time"):
        cylinder(tmp_path, time=None)
    with pytest.raises(SceneError, match='the wall "walls" of this geometry can have no displacement'):
        scene_of("turek-fsi2", "walls.walls.displacement_x=t")


def test_a_later_end_keeps_the_units_in_which_checkpoints_are():
    motion = ["walls.cylinder.displacement_x=0.005*t^2", "inflow.mean_velocity=0", "time.step=0.05"]
    one, two = (scene_of("cylinder-2d1", *motion, "time.end=0.1") for end in (1, 2))
    assert render(one) == render(two).replace('"time.end", 2.0', '"time.end", 1.0')
