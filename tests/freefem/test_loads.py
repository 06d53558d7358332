"""Loads on named boundaries of solids: exact answers, both kinds of pressure, in time, and wrong scripts."""

import numpy as np
import pytest
from conftest import scene_of
from own_mesh import checked, scene_on, write_mesh
from structured import structured_mesh

from ffsi.files.arrays import read_mesh, read_state
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, SceneError, load_scene, with_values

INNER, OUTER, MU, PRESSURE = 1.0, 1.5, 2.0, 0.65
RUBBER = {"material": "neo-hookean", "formulation": "incompressible", "density": 3.0, "lame_mu": MU}
SIDES = {"x": 1, "y": 2, "inside": 3, "outside": 4}


def ring(folder, n: int, **tables) -> Scene:
    """A quarter of a thick ring of an incompressible solid between its lines of symmetry."""
    radii, angles = np.linspace(INNER, OUTER, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1)

    def label(r, angle):
        ends = {0.0: 1, np.pi / 2: 2}
        return ends.get(angle) or (3 if r == INNER else 4)

    mesh = structured_mesh(radii, angles, lambda r, angle: 2, label)
    r, angle = mesh.vertices.T
    x, y = r * np.cos(angle), r * np.sin(angle)
    x[np.isclose(angle, np.pi / 2)] = 0
    mesh.vertices[:] = np.column_stack([x, y])
    path = write_mesh(folder / f"ring{n}.msh", mesh, {"rubber": 2}, SIDES)
    sides = {"symmetry": ["x", "y"], "loaded": "inside"}
    return scene_on(path, sides, {"rubber": "rubber"}, **{"solid": {"rubber": RUBBER}, **tables})


def stretched(pressure: float) -> float:
    """Inner radius of the ring under a pressure inside: p = mu (ln(la/lb) + c/2 (1/a^2 - 1/b^2)), in closed form."""

    def missing(a):
        c = a**2 - INNER**2
        b = np.sqrt(OUTER**2 + c)
        return MU * (np.log(a / INNER * OUTER / b) + c / 2 * (1 / a**2 - 1 / b**2)) - pressure

    low, high = INNER, 10 * INNER
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if missing(middle) < 0 else (low, middle)
    return low


def inner_radius(result) -> float:
    mesh = read_mesh(result.directory / "mesh.bin")
    state = read_state(result.directory / "point-0001.bin", mesh)
    (node,) = np.flatnonzero(np.hypot(*(mesh.p2_coordinates - [INNER, 0]).T) < 1e-9)
    assert state.u[node, 1] == 0
    return float(INNER + state.u[node, 0])


def test_a_ring_under_pressure_has_the_radius_of_the_closed_form(tmp_path):
    errors = []
    for n in (3, 6):
        result = checked(ring(tmp_path, n, loads={"inside": {"pressure": PRESSURE}}), tmp_path / str(n))
        errors.append(abs(inner_radius(result) / stretched(PRESSURE) - 1))
    assert stretched(PRESSURE) > 1.4 * INNER
    assert errors[1] < 1e-2 and np.log2(errors[0] / errors[1]) > 1.8  # the polygon's area is of second order


def block(folder, *, time: bool, **load) -> Scene:
    """A block of rubber, held below, with a load on its right side, 1 m high."""
    grid = np.linspace(0, 1, 5)
    sides = {(0.0, "y"): 1, (1.0, "x"): 3}
    mesh = structured_mesh(grid, grid, lambda x, y: 2, lambda x, y: sides.get((y, "y")) or sides.get((x, "x"), 4))
    path = write_mesh(folder / "block.msh", mesh, {"rubber": 2}, SIDES)
    steps = {"time": {"step": 0.02, "end": 0.2}} if time else {}
    law = {"material": "st-venant-kirchhoff", "density": 3.0, "young_modulus": 40.0, "poisson_ratio": 0.3}
    held = {"clamped": "x", "loaded": "inside"}
    return scene_on(path, held, {"rubber": "rubber"}, solid={"rubber": law}, loads={"inside": load}, **steps)


def displacement(result):
    return read_state(result.directory / "point-0001.bin", read_mesh(result.directory / "mesh.bin")).u


@pytest.mark.parametrize("time", [False, True], ids=["steady", "in time"])
def test_a_dead_pressure_is_a_traction_and_one_that_follows_is_not(time, tmp_path):
    wave = {"waveform": "sin(9*t)"} if time else {}
    loads = {
        "dead": {"pressure": -2, "following": False}, "traction": {"traction_x": 2}, "following": {"pressure": -2},
        "both": {"pressure": -3, "traction_y": 2},
    }  # fmt: skip
    found = {}
    for name, load in loads.items():
        result = checked(block(tmp_path, time=time, **load, **wave), tmp_path / name)
        found[name] = displacement(result)
        assert load_scene(tmp_path / name / "scene.toml") == result.scene
    size = np.abs(found["dead"]).max()
    np.testing.assert_allclose(found["dead"], found["traction"], rtol=0, atol=1e-8 * size)
    assert np.abs(found["following"] - found["dead"]).max() > 1e-2 * size


def test_a_load_grows_where_newton_has_too_few_iterations(tmp_path):
    scene = with_values(block(tmp_path, time=False, pressure=-3, traction_y=2), {"solver.max_iterations": 4})
    result = solve(scene, tmp_path / "run")
    assert result.checked and result.history["load"].min() < 1


def test_the_work_of_a_load_is_what_the_solid_has(tmp_path):
    """Of a pressure that follows: with theta = 1/2 and St. Venant-Kirchhoff a step loses nothing."""
    scene = block(tmp_path, time=True, pressure=-2, waveform="sin(9*t)")
    last = solve(with_values(scene, {"time.scheme": "crank-nicolson"}), tmp_path / "run").history.iloc[-1]
    assert last["kinetic"] + last["elastic"] == pytest.approx(last["work"], rel=1e-6)


YOUNG, NU, PULL = 40.0, 0.3, 6.0


@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("material", ["linear-elastic", "st-venant-kirchhoff"])
def test_a_plate_that_is_pulled(material, plane, tmp_path):
    """Uniform stretches of a plate, held at lines of symmetry and pulled at its right side, in closed form."""
    grid = np.linspace(0, 1, 5)
    sides = {(0.0, "x"): 1, (0.0, "y"): 2, (1.0, "x"): 3}
    mesh = structured_mesh(grid, grid, lambda x, y: 2, lambda x, y: sides.get((x, "x")) or sides.get((y, "y"), 4))
    path = write_mesh(tmp_path / "plate.msh", mesh, {"rubber": 2}, SIDES)
    law = {"material": material, "density": 3.0, "young_modulus": YOUNG, "poisson_ratio": NU, "plane": plane}
    load = {"inside": {"traction_x": PULL}}
    scene = scene_on(
        path, {"symmetry": ["x", "y"], "loaded": "inside"}, {"rubber": "rubber"}, solid={"rubber": law}, loads=load
    )
    result = checked(scene, tmp_path / "run")
    young, nu = (YOUNG, NU) if plane == "stress" else (YOUNG / (1 - NU**2), NU / (1 - NU))
    if material == "linear-elastic":
        along, across = PULL / young, -nu * PULL / young
    else:  # F E (F^2 - 1)/2 = P
        stretch = np.roots([1, 0, -1, -2 * PULL / young]).real.max()
        along, across = stretch - 1, np.sqrt(1 - nu * (stretch**2 - 1)) - 1
    x = read_mesh(tmp_path / "run/mesh.bin").p2_coordinates
    np.testing.assert_allclose(displacement(result), x * [along, across], rtol=0, atol=1e-9)


def forced(folder, forces: dict, **tables) -> Scene:
    """The same block with forces at points alone."""
    scene = block(folder, time="time" in tables, pressure=0)
    geometry = {**scene.geometry.model_dump(exclude_none=True), "loads": {}}
    table = {**scene.model_dump(exclude_none=True), "geometry": geometry, "loads": {}, "point_forces": forces}
    return Scene.model_validate({**table, **tables})


def test_a_force_beside_an_edge_of_a_built_in_geometry_is_checked(solved):
    """FreeFEM finds a neighbour of the triangle that has the point (1, 0.41)."""
    push = "point_forces.push={x=1.0, y=0.41, force_y=-1e-3}"
    assert solved("flap-neo-hookean-roof", "inflow.mean_velocity=0.02", push).checked
    with pytest.raises(SceneError, match=r"must lie in a solid; the solids lie in x from 0\.25 to 0\.6 m, y"):
        scene_of("turek-fsi1", push)


OUTSIDE = [
    ({"x": 1.2, "y": 0.5}, r"point_forces\.push = \(1\.2, 0\.5\) m: must lie in a solid; the solids lie in x from 0"),
    ({"x": 0.5, "y": 0.5, "waveform": "t"}, r"point_forces\.push\.waveform: only accepted in a scene with a table"),
    ({"x": 0.5, "y": 0.5, "force_x": "2 Pa"}, r"point_forces\.push\.force_x = .2 Pa"),
]


@pytest.mark.parametrize("name", ["a-b", "a_b", "A", "a b", "1"])
def test_names_that_are_none_in_a_script_are_refused(name, tmp_path):
    with pytest.raises(SceneError, match="accepted as a name: a small letter, then small letters and digits"):
        forced(tmp_path, {name: {"x": 0.5, "y": 0.5}})


@pytest.mark.parametrize(("force", "text"), OUTSIDE)
def test_forces_that_are_refused(force, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        forced(tmp_path, {"push": force})


def test_a_wrong_steady_load_is_caught(tmp_path, broken_script):
    broken_script("m = -1.*m; AddBlock(m, fieldFrom[momentumY], uxFrom, tested);",
        "AddBlock(m, fieldFrom[momentumY], uxFrom, tested);")  # fmt: skip
    result = solve(block(tmp_path, time=False, pressure=-3, traction_y=2), tmp_path / "run")
    assert not result.checked and "momentum" in result.reason


REFUSED = [
    ({"insde": {"pressure": 1}}, "loads.insde: no boundary of a solid that can be loaded"),
    ({"inside": {"pressure": 1, "waveform": "t"}}, "loads.inside.waveform.*only accepted in a scene with a table time"),
    ({"inside": {"pressure": "1 m"}}, "loads.inside.pressure"),
]


@pytest.mark.parametrize(("loads", "text"), REFUSED)
def test_refused(loads, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        ring(tmp_path, 2, loads=loads)
