"""Wall shear stress on given fields, viscosity, effective stress, parts of the walls."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_folders import structured_mesh

from ffsi.files.arrays import RawMesh, RawState, write_arrays
from ffsi.files.cycles import WallCycle, read_cycle, read_cycles
from ffsi.files.errors import InputError
from ffsi.hemodynamics.aneurysm import beyond_corners
from ffsi.hemodynamics.cycles import change
from ffsi.hemodynamics.flow import dome_flow, flow_rate, rates
from ffsi.hemodynamics.parts import over_parts, part_of, wall_frame
from ffsi.hemodynamics.state import WallState, reports_walls
from ffsi.hemodynamics.stress import cauchy_stress, effective_stress, largest_beyond, von_mises
from ffsi.hemodynamics.walls import at_nodes, deformed_length, wall_points, wall_shear_stress
from ffsi.reference.from_scene import MATERIALS
from ffsi.reference.materials import IDENTITY
from ffsi.reference.materials import StVenantKirchhoff as StVenantKirchhoffLaw
from ffsi.result.fields import Fields
from ffsi.scene import CASES, Aneurysm, Scene
from ffsi.scene.fluids import Carreau, Casson, Newtonian, PowerLaw
from ffsi.scene.materials import MooneyRivlin, NeoHookean, StVenantKirchhoff

NEWTONIAN = Newtonian(density=1000.0, viscosity=0.02)


def channel(nx: int = 6, ny: int = 3) -> RawMesh:
    """Rectangle [0, 2] x [0, 0.5] of fluid, with labels: 3 below, 4 above, 1 and 2 its ends."""
    mesh, top = structured_mesh(nx, ny, 2.0, 0.5), ny * (nx + 1)
    edges = [(i, i + 1) for i in range(nx)] + [(top + i, top + i + 1) for i in range(nx)]
    edges += [(j * (nx + 1) + x, (j + 1) * (nx + 1) + x) for x in (0, nx) for j in range(ny)]
    label = np.repeat([3, 4, 1, 2], [nx, nx, ny, ny])
    # Edges in no particular order.
    order = np.random.default_rng(1).permutation(len(edges))
    return replace(mesh, region=np.ones_like(mesh.region), edges=np.array(edges)[order], label=label[order])


def state(mesh: RawMesh, velocity: np.ndarray, displacement: np.ndarray | None = None) -> RawState:
    u = np.zeros((mesh.n_p2, 2)) if displacement is None else displacement
    return RawState(u, velocity, np.zeros(len(mesh.vertices)))


def poiseuille(y: np.ndarray) -> np.ndarray:
    return np.column_stack([3.0 * y * (0.5 - y), np.zeros_like(y)])


def test_walls_of_flows_have_their_points_and_spatial_gradients() -> None:
    points = wall_points(channel(), [3, 4])
    assert points.chain.tolist() == [0] * 6 + [1] * 6 or points.chain.tolist() == [1] * 6 + [0] * 6
    below, above = points.label == 3, points.label == 4
    assert points.position[below] == pytest.approx(np.column_stack([(np.arange(6) + 0.5) / 3, np.zeros(6)]))
    assert points.position[above] == pytest.approx(np.column_stack([(5.5 - np.arange(6)) / 3, np.full(6, 0.5)]))
    assert points.arc[below] == pytest.approx((np.arange(6) + 0.5) / 3)
    assert points.normal[below] == pytest.approx(np.tile([0.0, -1.0], (6, 1)))
    assert points.normal[above] == pytest.approx(np.tile([0.0, 1.0], (6, 1)))
    mesh = channel()
    points = wall_points(mesh, [1, 2, 3, 4])
    assert set(points.chain) == {0} and points.arc[-1] + points.length[-1] / 2 == pytest.approx(5.0)
    coordinates = mesh.p2_coordinates
    assert coordinates[points.ends[1:, 0]] == pytest.approx(coordinates[points.ends[:-1, 1]])
    assert coordinates[points.middle] == pytest.approx(points.position)
    points = wall_points(mesh, [3, 4])
    tau = wall_shear_stress(points, state(mesh, poiseuille(mesh.p2_coordinates[:, 1])), NEWTONIAN)
    assert tau == pytest.approx(np.tile([0.02 * 1.5, 0.0], (12, 1)), abs=1e-15)
    # The channel turned, sheared and stretched: the flow is given in the coordinates where it is.
    linear = np.array([[1.2, 0.4], [-0.3, 0.9]])  # x = linear X
    at = mesh.p2_coordinates @ linear.T
    along = linear[:, 0] / np.hypot(*linear[:, 0])  # direction of the walls
    across = np.array([-along[1], along[0]])
    distance = at @ across  # from the lower wall
    height = np.linalg.det(linear) / np.hypot(*linear[:, 0]) * 0.5
    velocity = (distance * (height - distance))[:, None] * along
    deformed = state(mesh, velocity, at - mesh.p2_coordinates)
    assert wall_shear_stress(points, deformed, NEWTONIAN) == pytest.approx(np.tile(0.02 * height * along, (12, 1)))
    assert deformed_length(points, deformed) == pytest.approx(points.length * np.hypot(*linear[:, 0]))
    at, points = mesh.p2_coordinates, wall_points(mesh, [3])
    tau = wall_shear_stress(points, state(mesh, np.column_stack([at[:, 0], -at[:, 1]])), NEWTONIAN)
    assert tau == pytest.approx(np.zeros((6, 2)), abs=1e-15)
    velocity = np.column_stack([100.0 * mesh.p2_coordinates[:, 1], np.zeros(mesh.n_p2)])
    tau = wall_shear_stress(points, state(mesh, velocity), Carreau(density=1035.0))
    assert tau[:, 0] == pytest.approx(100 * 0.004708, rel=1e-3)


def test_other_laws_and_flow_rates() -> None:
    rate = np.array([0.0, 3.0])
    assert NEWTONIAN.apparent_viscosity(rate).tolist() == [0.02, 0.02]
    power = PowerLaw(density=1.0, consistency=0.5, exponent=0.5, regularisation=4.0)
    assert power.apparent_viscosity(rate) == pytest.approx([0.5 * 4**-0.5, 0.5 * 5**-0.5])
    casson = Casson(density=1.0, yield_stress=0.04, viscosity_infinity=0.01, regularisation=4.0)
    assert casson.apparent_viscosity(rate) == pytest.approx([(0.1 + 0.2 / 2) ** 2, (0.1 + 0.2 / 5**0.5) ** 2])
    mesh = channel()
    flow = state(mesh, poiseuille(mesh.p2_coordinates[:, 1]))
    assert flow_rate(mesh, flow, 2) == pytest.approx(3 * 0.5**3 / 6, rel=1e-14)
    assert flow_rate(mesh, flow, 1) == pytest.approx(-3 * 0.5**3 / 6, rel=1e-14)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_rounding_of_a_fluid_at_rest_is_no_imbalance(unit: float) -> None:
    """Velocities of the pressure's rounding, p H/mu times 1e-15; a flow has the imbalance that it has."""
    mesh = replace(channel(), vertices=unit * channel().vertices)
    pressure = np.full(len(mesh.vertices), 13e3)
    noise = 1e-15 * 13e3 * 0.5 * unit / 0.02 * np.random.default_rng(1).normal(size=(mesh.n_p2, 2))
    at_rest = replace(state(mesh, noise), p=pressure)
    assert abs(rates(mesh, at_rest, 0.02)["mass_balance"]) < 1e-5
    assert rates(mesh, state(mesh, 0 * noise), 0.02)["mass_balance"] == 0.0
    leaking = np.column_stack([unit * (2 + mesh.p2_coordinates[:, 0] / unit / 2), 0 * noise[:, 0]])
    assert rates(mesh, replace(state(mesh, leaking), p=pressure), 0.02)["mass_balance"] == pytest.approx(-1 / 3)
    assert np.isnan(rates(mesh, state(mesh, noise * np.nan), 0.02)["mass_balance"])


def test_vertices_states_and_walls_of_a_channel() -> None:
    mesh = channel()
    points = wall_points(mesh, [3])
    nodal = at_nodes(points, np.column_stack([points.arc, np.full(6, 2.0)]), mesh.n_p2)
    on = np.unique([points.middle, *points.ends.T])
    assert np.isnan(np.delete(nodal, on, axis=0)).all()
    at = np.clip(mesh.p2_coordinates[on, 0], points.arc[0], points.arc[-1])  # the outermost vertices have one edge
    assert nodal[on] == pytest.approx(np.column_stack([at, np.full(13, 2.0)]))
    assert at_nodes(points, np.where(points.arc < 0.5, np.inf, 1.0), mesh.n_p2)[on].max() == np.inf  # RRT
    assert {name for name, scene in CASES.items() if reports_walls(scene)} == {
        "aneurysm", "aneurysm-carreau", "aneurysm-pulsatile",
    }  # fmt: skip
    scene = Scene.model_validate({
        "name": "channel", "geometry": {"kind": "channel", "length": 2.0, "height": 0.5},
        "fluid": {"density": 1000.0, "viscosity": 0.02}, "inflow": {"mean_velocity": 0.125},
        "outlet": {"kind": "do-nothing"},
    })  # fmt: skip
    assert reports_walls(scene)
    mesh = replace(mesh, label=np.where(mesh.label == 4, 3, mesh.label))
    raw = state(mesh, poiseuille(mesh.p2_coordinates[:, 1]))
    found = WallState(scene, mesh, raw, Fields.from_raw(mesh, raw))
    assert found.quantities == {
        "flow_rate_in": pytest.approx(0.0625), "flow_rate_out": pytest.approx(0.0625),
        "mass_balance": pytest.approx(0, abs=1e-14),
        **{f"wss_{what}_walls": pytest.approx(0.03) for what in ("mean", "max", "min")},
    }  # fmt: skip
    assert set(found.wall["part"]) == {"walls"} and set(found.wall["line"]) == {"0", "1"}
    assert np.nanmax(np.hypot(*found.point_data["wall_shear_stress"].T)) == pytest.approx(0.03)
    assert len(wall_frame(scene, wall_points(mesh, [20]))) == 0  # no such wall


# Effective stress ---------------------------------------------------------------------------------------------------

LAWS = (
    NeoHookean(material="neo-hookean", density=1.0, young_modulus=10.0, poisson_ratio=0.3),
    StVenantKirchhoff(material="st-venant-kirchhoff", density=1.0, young_modulus=10.0, poisson_ratio=0.3),
    # The same moduli at rest: mu = 2 (C10 + C01), K = lambda + 2/3 mu.
    MooneyRivlin(material="mooney-rivlin", density=1.0, c10=1.0, c01=10 / 5.2 - 1, bulk_modulus=10 / 1.2),
)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.material)
def test_small_strains_are_linear_elasticity_in_plane_strain(law: object) -> None:
    gradient, strain = 1e-7 * np.array([[[0.3, 0.5], [0.1, -0.8]]]), np.zeros((3, 3))
    strain[:2, :2] = (gradient[0] + gradient[0].T) / 2
    mu, lame_lambda = 10 / 2.6, 10 * 0.3 / (1.3 * 0.4)
    expected = 2 * mu * strain + lame_lambda * np.trace(strain) * np.eye(3)
    assert cauchy_stress(law, gradient)[0] == pytest.approx(expected, rel=1e-5, abs=1e-13)  # type: ignore[arg-type]


@pytest.mark.parametrize("law", [LAWS[0], LAWS[2]], ids=lambda law: law.material)
def test_cauchy_stress_is_the_derivative_of_the_energy(law: object) -> None:
    """sigma = dW/dF F^T / J by differences of W, in three dimensions with F33 = 1."""

    def energy(f: np.ndarray) -> float:
        jacobian, right = np.linalg.det(f), f.T @ f
        first = np.trace(right)
        second = (first**2 - np.trace(right @ right)) / 2
        if isinstance(law, NeoHookean):
            lame_lambda, mu = law.lame
            return float(mu / 2 * (first - 3 - 2 * np.log(jacobian)) + lame_lambda / 2 * np.log(jacobian) ** 2)
        assert isinstance(law, MooneyRivlin) and law.bulk_modulus
        shape = law.c10 * (jacobian ** (-2 / 3) * first - 3) + law.c01 * (jacobian ** (-4 / 3) * second - 3)
        return float(shape + law.bulk_modulus / 2 * (jacobian - 1) ** 2)

    gradient, f = np.array([[0.3, 0.5], [-0.2, 0.1]]), np.eye(3)
    f[:2, :2] += gradient
    piola = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3))
            step[i, j] = 1e-6
            piola[i, j] = (energy(f + step) - energy(f - step)) / 2e-6
    expected = piola @ f.T / np.linalg.det(f)
    assert cauchy_stress(law, gradient[None])[0] == pytest.approx(expected, rel=1e-7, abs=1e-7)  # type: ignore[arg-type]


def test_of_an_incompressible_solid_the_pressure_is_its_own() -> None:
    law = NeoHookean(material="neo-hookean", density=1.0, young_modulus=6.0, formulation="incompressible")
    gradient = np.array([[[0.0, 0.5], [0.0, 0.0]]])  # simple shear
    stress = cauchy_stress(law, gradient, np.array([7.0]))[0]
    assert stress == pytest.approx(np.array([[0.5 - 7, 1.0, 0], [1.0, -7, 0], [0, 0, -7]]))
    assert von_mises(stress[None]) == pytest.approx(np.sqrt(0.5**2 + 3 * 1.0**2))


def test_a_law_of_the_plane_alone_has_no_stress_across_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its formula may take no third stretch at all, or take it for none."""

    class Plane(StVenantKirchhoffLaw):
        def energy(self, gradient: np.ndarray) -> np.ndarray:
            return super().energy(gradient[..., :2, :2])

    class TwoByTwo(StVenantKirchhoffLaw):
        def energy(self, gradient: np.ndarray) -> np.ndarray:
            return np.asarray(super().energy(gradient) + 0 * (IDENTITY + gradient)[..., 0, 0])

    gradient = np.zeros((1, 2, 2))
    for law in (Plane, TwoByTwo):
        monkeypatch.setitem(MATERIALS, "st-venant-kirchhoff", lambda solid, law=law: law(*solid.lame))
        with pytest.raises(ValueError, match="one of the plane alone"):
            cauchy_stress(LAWS[1], gradient)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.material)
def test_where_j_is_not_positive_there_is_no_stress(law: object) -> None:
    turned, plain = [[-1.5, 0.0], [0.0, 0.0]], [[0.1, 0.0], [0.0, 0.0]]
    stress = von_mises(cauchy_stress(law, np.array([turned, plain])))  # type: ignore[arg-type]
    assert np.isnan(stress).tolist() == [True, False]


def test_effective_stress_over_parts() -> None:
    mesh = structured_mesh()  # with one solid, region 2
    scene = CASES["flap-neo-hookean"]
    law, at = scene.solid["flap"], mesh.p2_coordinates
    stretched = state(mesh, np.zeros_like(at), np.column_stack([0.1 * at[:, 0], 0 * at[:, 1]]))
    found = effective_stress(scene, mesh, stretched)["flap"]
    inside = np.unique(mesh.p2[mesh.region == 2])
    expected = von_mises(cauchy_stress(law, np.array([[[0.1, 0], [0, 0]]])))[0]
    assert found[inside] == pytest.approx(expected) and np.isnan(np.delete(found, inside)).all()
    geometry = Aneurysm()
    start = np.array(geometry.neck[0])
    place = np.array([[-0.006, 0.0], start + 3e-4, start + 5e-4, [-7.7e-3, 6.5e-3], start])
    label = np.array([13, 14, 14, 15, 20])
    assert part_of(CASES["aneurysm"], label, place).tolist() == ["vessel", "neck", "vessel", "dome", "stent"]
    # The lower wall as an outer wall of an aneurysm that ends in the neck: means of a linear function are exact.
    mesh = channel(nx=7)
    scaled = replace(mesh, vertices=1e-3 * mesh.vertices + np.array(geometry.neck[0]), label=mesh.label + 11)
    points = wall_points(scaled, [14])
    end = geometry.neck_length / 4  # of the neck's zone, within an edge
    found = over_parts(CASES["aneurysm"], points, points.arc, points.length)
    assert set(found) == {"neck", "vessel"}
    first = points.arc[0]  # before the outermost point the curve is constant
    assert found["neck"]["mean"] == pytest.approx((first**2 + (end**2 - first**2) / 2) / end, rel=0.01)
    assert found["vessel"]["mean"] == pytest.approx((end + 2e-3) / 2, rel=0.01)
    assert found["vessel"]["max"] == points.arc[-1] and found["neck"]["min"] == points.arc[0]


def test_the_largest_stress_and_its_zones() -> None:
    """A field that falls quadratically away from x = 0, cut between two nodes; one that is largest inside an edge."""
    mesh = structured_mesh(5, 2, 2.0, 0.5)
    x, end = mesh.p2_coordinates[:, 0], 0.537
    every = np.full(len(mesh.region), True)
    found = largest_beyond(mesh, every, (2 - x) ** 2, lambda at: at[..., 0] - end)
    assert found == pytest.approx((2 - end) ** 2, rel=1e-12)
    # Nodes of the solid are 0.2 apart: nearest to the top are 0.8 and 1.
    assert largest_beyond(mesh, every, 3 - (x - 0.9) ** 2, lambda at: at[..., 0]) == pytest.approx(3, rel=1e-4)
    with_fluid = np.where(x > 1.7, np.nan, x)
    assert largest_beyond(mesh, (x < 1.7)[mesh.p2].all(axis=1), with_fluid, lambda at: at[..., 0]) < 1.7
    # What is no number is no number; within the zone nobody looks.
    assert np.isnan(largest_beyond(mesh, every, with_fluid, lambda at: at[..., 0]))
    assert largest_beyond(mesh, every, with_fluid, lambda at: 1.5 - at[..., 0]) == pytest.approx(1.5)
    with pytest.raises(ValueError, match="no edge lies beyond the zone"):
        largest_beyond(mesh, every, x, lambda at: -1 - at[..., 0])
    geometry = Aneurysm()
    at = np.array([[-0.4e-3, 8e-3], [-8e-3, 0.6e-3], np.add(geometry.corners[3], [0.0, 0.5e-3])])
    assert beyond_corners(geometry, at) == pytest.approx([-0.1e-3, 0.1e-3, 0.0], abs=1e-12)


def test_flow_into_the_dome_does_not_depend_on_how_the_mesh_moves() -> None:
    """The dome is the upper half of a rectangle; velocity (0, x + y) where the nodes are, which move inside only."""
    mesh = channel(16, 8)
    upper = mesh.vertices[mesh.edges].mean(axis=1)[:, 1] > 0.25
    mesh = replace(mesh, label=np.where(upper, 15, 3))
    at = mesh.p2_coordinates
    for size in (0.0, 1.0):
        shift = size * np.sin(np.pi * at[:, 0] / 2) ** 2 * at[:, 1] * (0.5 - at[:, 1])
        moved = state(mesh, np.zeros_like(at), np.column_stack([0 * shift, shift]))
        moved.v[:, 1] = at[:, 0] + at[:, 1] + shift
        flow = dome_flow(mesh, moved, Fields.from_raw(mesh, moved))
        assert flow["dome_area"] == pytest.approx(0.5) and flow["dome_inflow"] == pytest.approx(2.5, rel=2e-3)


def cycle_of(tau: np.ndarray, times: np.ndarray) -> WallCycle:
    """One point whose stress (m, 2) is known at the times (m,): the trapezoidal rule."""
    size = np.hypot(*tau.T)
    integral = np.trapezoid(tau, times, axis=0) if hasattr(np, "trapezoid") else np.trapz(tau, times, axis=0)
    magnitude = float(np.sum((size[1:] + size[:-1]) / 2 * np.diff(times)))
    return WallCycle(
        1, times[0], times[-1], np.array([0]), integral[None], np.array([magnitude]), np.array([size.max()])
    )


def of_sums(integral: list[float], magnitude: list[float]) -> WallCycle:
    """A second of a stress along x."""
    vector = np.column_stack([integral, np.zeros(2)])
    return WallCycle(1, 0.0, 1.0, np.arange(2), vector, np.array(magnitude), np.ones(2))


TIMES = np.linspace(0.0, 0.8, 4001)


def test_indices_of_given_stresses_and_of_files(tmp_path: Path) -> None:
    cycle = cycle_of(np.tile([0.3, -0.4], (len(TIMES), 1)), TIMES)
    assert cycle.tawss == pytest.approx([0.5], rel=1e-14) and cycle.osi.tolist() == [pytest.approx(0.0, abs=1e-14)]
    assert cycle.rrt == pytest.approx([2.0], rel=1e-12) and cycle.peak == pytest.approx([0.5])
    tau = np.column_stack([3.0 * np.sin(2 * np.pi * TIMES / 0.8), np.zeros_like(TIMES)])
    cycle = cycle_of(tau, TIMES)
    assert cycle.tawss == pytest.approx([2 * 3.0 / np.pi], rel=1e-6)
    assert cycle.osi == pytest.approx([0.5], abs=1e-12) and cycle.rrt[0] > 1e9 and cycle.peak == pytest.approx([3.0])
    # a + b sin with b > a: the zeros are at -asin(a/b), TAWSS and OSI follow by hand.
    a, b = 1.0, 2.0
    tau = np.column_stack([np.zeros_like(TIMES), a + b * np.sin(2 * np.pi * TIMES / 0.8)])
    zero = np.arcsin(a / b)
    tawss, cycle = 2 / np.pi * (a * zero + b * np.cos(zero)), cycle_of(tau, TIMES)
    assert cycle.tawss == pytest.approx([tawss], rel=1e-6)
    assert cycle.osi == pytest.approx([0.5 * (1 - a / tawss)], rel=1e-5)
    assert cycle.rrt == pytest.approx([1 / a], rel=1e-6)
    angle = 2 * np.pi * TIMES / 0.8
    cycle = cycle_of(np.column_stack([np.cos(angle), np.sin(angle)]), TIMES)
    assert cycle.tawss == pytest.approx([1.0]) and cycle.osi == pytest.approx([0.5], abs=1e-6)
    # The ratio is above 1 by rounding; nothing ever flows at the second point.
    assert of_sums([1.0 + 1e-15, 0.0], [1.0, 0.0]).osi.tolist() == [0.0, 0.0]
    assert of_sums([0.0, 1.0], [0.0, 2.0]).rrt.tolist() == [np.inf, 1.0]
    assert np.isnan(of_sums([0.1, np.nan], [np.nan, 1.0]).osi).all()
    assert np.isnan(change(np.array([1.0, 1.0]), np.array([np.nan, 1.0]), np.ones(2)))
    assert change(np.array([1.0, 2.0]), np.array([1.0, 4.0]), np.array([1.0, 0.25])) == pytest.approx(
        np.sqrt(0.25 * 4 / (1 + 0.25 * 16))
    )
    cycle = read_cycle(written(tmp_path / "wall-0003.bin", [7, 5]))
    assert (cycle.number, cycle.start, cycle.end) == (3, 1.6, 2.4) and cycle.node.tolist() == [7, 5]
    assert cycle.integral.tolist() == [[10.0, 20.0], [11.0, 21.0]]
    assert (cycle.magnitude.tolist(), cycle.peak.tolist()) == ([30.0, 31.0], [40.0, 41.0])
    assert cycle.tawss == pytest.approx([30 / 0.8, 31 / 0.8])
    written(tmp_path / "wall-0002.bin", [7, 5])
    assert len(read_cycles(tmp_path)) == 2
    path = written(tmp_path / "wall-0003.bin", [7, 5])
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InputError, match="wall-0003"):
        read_cycle(path)
    with pytest.raises(InputError, match="wall-0009"):
        read_cycle(tmp_path / "wall-0009.bin")


def written(path: Path, node: list[int]) -> Path:
    n = len(node)
    values = [10.0 * i + np.arange(n) for i in range(1, 5)]
    write_arrays(path, [np.array([1, 3, n]), np.array([1.6, 2.4]), np.array(node), *values])
    return path


def test_cycles_are_put_into_the_order_of_the_points(tmp_path: Path) -> None:
    points = wall_points(channel(), [3, 4])
    shuffled = points.middle[::-1]
    cycle = read_cycle(written(tmp_path / "wall-0001.bin", shuffled.tolist())).at(points.middle)
    assert cycle.node.tolist() == points.middle.tolist()
    assert cycle.magnitude.tolist() == (30.0 + np.arange(12))[::-1].tolist()
    with pytest.raises(InputError, match="another mesh"):
        read_cycle(written(tmp_path / "wall-0001.bin", [1, 2])).at(points.middle)
