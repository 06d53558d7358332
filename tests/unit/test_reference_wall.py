"""Shear stress on the walls: exact flows, what people are shown, and the sums over cycles."""

import itertools
import math
import struct

import numpy as np
import pytest
from test_reference_cases import cantilever_problem, channel_mesh, channel_problem, flap_mesh, flap_problem, state_of
from test_reference_check import CHANGES, failing, scene_mesh, solved, write_run
from test_reference_residual import ROTATION, deformed_state

from ffsi.files.cycles import WallCycle, read_cycle
from ffsi.hemodynamics import walls
from ffsi.reference.check import check_run
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.problem import Fluid
from ffsi.reference.system import System
from ffsi.reference.viscosity import Carreau, Newtonian
from ffsi.reference.wall import Passage, WallShear, cycle_difference, wall_shear
from ffsi.scene import CASES, with_values

LAWS = [Newtonian(0.05), Carreau(0.056, 0.00345, 10.976, -0.3216)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_shear_flow_on_a_deformed_mesh(law):
    # v = (a y, 0) in a turned and stretched channel: on the floor the stress is mu a along the flow, on the roof
    # against it.
    slope, mesh = 7.0, channel_mesh()
    state = deformed_state(
        mesh, velocity=lambda x: np.column_stack([slope * x[:, 1], 0 * x[:, 1]]), pressure=lambda x: x[:, 0]
    )
    shear = wall_shear(System.build(channel_problem(fluid=Fluid(1.0, law)), mesh), state)
    assert set(shear.nodes) == set(mesh.edge_nodes[np.isin(mesh.label, (3, 4)), 2])
    expected = slope * float(law.at(np.array(slope**2)))
    side = np.where(mesh.p2_coordinates[shear.nodes, 1] == 0.0, 1.0, -1.0)
    along = ROTATION @ np.array([1.0, 0.0])
    np.testing.assert_allclose(shear.stress, expected * side[:, None] * along, rtol=0, atol=1e-12 * expected)
    np.testing.assert_allclose(shear.size, expected, rtol=1e-12)


def test_walls_are_wet_and_shown_alike_for_every_law():
    # v = (0, c y): a normal stress only.
    mesh = channel_mesh()
    state = state_of(mesh, v=lambda x: np.column_stack([0 * x[:, 1], 3.0 * x[:, 1]]))
    shear = wall_shear(System.build(channel_problem(), mesh), state)
    np.testing.assert_allclose(shear.stress, 0.0, atol=1e-14)
    # A plug flow: what rounding leaves of its stress is not compared with itself.
    plug = wall_shear(System.build(channel_problem(), mesh), state_of(mesh, v=lambda x: np.ones_like(x)))
    assert plug.difference(plug.nodes, plug.stress + 1e-16) < 1e-8 < plug.difference(plug.nodes, plug.stress + 1e-12)
    mesh = channel_mesh(region=2)
    assert wall_shear(System.build(cantilever_problem(), mesh), state_of(mesh)) is None
    rng = np.random.default_rng(1)
    for law in ("newtonian", "carreau"):
        scene = with_values(CASES["flap-svk"], CHANGES | {"fluid.law": law})
        mesh = scene_mesh(scene)
        state = state_of(
            mesh, u=lambda x: 1e-3 * rng.normal(size=x.shape), v=lambda x: rng.normal(size=x.shape),
        )  # fmt: skip
        own = wall_shear(System.build(problem_from_scene(scene), mesh), state)
        points = walls.wall_points(mesh, walls.wall_labels(scene))
        shown = walls.wall_shear_stress(points, state, scene.fluid)
        assert own.difference(points.middle, shown) < 1e-13
        assert own.difference(points.middle, shown * (1 + 1e-6)) == pytest.approx(1e-6, rel=0.5)
        assert own.difference(points.middle[1:], shown[1:]) == math.inf
        assert own.difference(points.middle + 1, shown) == math.inf


def test_run_whose_shear_stress_is_wrong_fails(tmp_path, monkeypatch):
    scene = with_values(CASES["flap-svk"], CHANGES)
    _, mesh, state, quantities = solved(problem_from_scene(scene), scene_mesh(scene))
    write_run(tmp_path, mesh, state, {"quantities": quantities})
    report = check_run(tmp_path, scene, shown=walls.shown_stress)
    assert report.failures == [] and report.wall_difference < 1e-12
    right = walls.wall_shear_stress
    monkeypatch.setattr(walls, "wall_shear_stress", lambda *arguments: 1.001 * right(*arguments))
    assert failing(check_run(tmp_path, scene, shown=walls.shown_stress)) == {"wall_difference"}


# Cycles ---------------------------------------------------------------------------------------------------------------

NODES = np.array([7, 3, 12])
DIRECTIONS = np.array([[1.0, 0.0], [0.6, 0.8], [0.0, -2.0]])


def shear_at(time):
    """Linear in the time; it turns at the time 1."""
    return WallShear(NODES, (time - 1.0) * DIRECTIONS)


def passages(*times):
    return [Passage(a, b, shear_at(a), shear_at(b)) for a, b in itertools.pairwise(times)]


def cycle(start, end, integral, magnitude, peak):
    size = np.hypot(*DIRECTIONS.T)
    return WallCycle(4, start, end, NODES, integral * DIRECTIONS, magnitude * size, peak * size)


def test_sums_of_a_cycle_count_parts_of_steps():
    # From 0.5 to 2 the integral of t - 1 is 3/8, that of its size 5/8, exactly as steps end at the turn.
    found, steps = cycle(0.5, 2.0, 0.375, 0.625, 1.0), passages(0.0, 0.4, 1.0, 1.7, 2.0)
    assert cycle_difference(found, steps) < 1e-14
    shuffled = WallCycle(
        4, 0.5, 2.0, NODES[[2, 0, 1]], found.integral[[2, 0, 1]], found.magnitude[[2, 0, 1]], found.peak[[2, 0, 1]]
    )
    assert cycle_difference(shuffled, steps) < 1e-14
    right = {"integral": 0.375, "magnitude": 0.625, "peak": 1.0}
    for wrong in ({"integral": 0.376}, {"magnitude": 0.626}, {"peak": 1.001}, {"peak": 0.6}, {"integral": math.nan}):
        assert not cycle_difference(cycle(0.5, 2.0, *(right | wrong).values()), steps) < 1e-4
    # The step from 1 to 2 is cut at 1.5.
    assert cycle_difference(cycle(1.0, 1.5, 0.125, 0.125, 0.5), passages(1.0, 2.0)) < 1e-14
    assert cycle_difference(cycle(1.0, 1.5, 0.125, 0.126, 0.5), passages(1.0, 2.0)) > 1e-3
    steps = passages(0.5, 0.6, 1.8)
    assert cycle_difference(cycle(0.5, 2.0, 99.0, 99.0, 0.8), steps) < 1e-14
    assert cycle_difference(cycle(0.5, 2.0, 99.0, 99.0, 0.7), steps) == pytest.approx(0.1 / 0.8, rel=1e-12)
    assert cycle_difference(cycle(5.0, 6.0, 99.0, 99.0, 0.0), steps) == 0.0
    other = WallCycle(4, 0.5, 2.0, NODES + 1, *(np.zeros((3, 2)), np.zeros(3), np.ones(3)))
    assert cycle_difference(other, steps) == math.inf


def written(path, *arrays):
    with path.open("wb") as file:
        for array in arrays:
            values = np.asarray(array)
            file.write(struct.pack("<q", values.size) + values.tobytes())
    return path


def test_files_of_cycles_and_elastic_walls(tmp_path):
    found = cycle(0.5, 2.0, 0.375, 0.625, 1.0)
    arrays = [[1, 4, 3], [0.5, 2.0], NODES, *found.integral.T.copy(), found.magnitude, found.peak]
    path = written(tmp_path / "wall-0004.bin", *arrays)
    assert cycle_difference(read_cycle(path), passages(0.5, 1.0, 2.0)) < 1e-14
    for wrong in ([[2, 4, 3], *arrays[1:]], [[1, 4, 2], *arrays[1:]], [*arrays[:-1], found.peak[:-1]]):
        with pytest.raises(ValueError, match=r"wall-0004\.bin: no sums of the wall shear stress"):
            read_cycle(written(path, *wrong))
    mesh = flap_mesh(4)
    state = state_of(mesh, v=lambda x: x[:, ::-1])
    shear = wall_shear(System.build(flap_problem(), mesh), state)
    assert set(shear.nodes) == set(mesh.edge_nodes[np.isin(mesh.label, (3, 5)), 2])
