"""Flow of blood: exact flows in plane, bent and oscillating channels, and what `verify --blood` makes of runs."""

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad
from time_folders import scene_in_time

from ffsi.scene import load_scene
from ffsi.scene.fluids import Carreau, Casson, Newtonian, PowerLaw
from studies.harness import run_all
from studies.tables import Column
from studies.verification import blood, exact_flows

NEWTONIAN = Newtonian(density=1035.0, viscosity=3.5e-3)
CARREAU = Carreau(density=1035.0)
FLUIDS = [
    NEWTONIAN,
    CARREAU,
    PowerLaw(density=1035.0, consistency=0.0147, exponent=0.7755),
    PowerLaw(density=1035.0, consistency=0.001, exponent=1.4),  # thickens
    Casson(density=1035.0, yield_stress=0.005, viscosity_infinity=0.0035),
]
NAMES = ["newtonian", "carreau", "power-law", "thickening", "casson"]
README = "before\n<!-- blood:begin -->\nold\n<!-- blood:end -->\nafter\n"


@pytest.mark.parametrize("fluid", FLUIDS, ids=NAMES)
def test_shear_rate_is_the_inverse_of_the_stress(fluid):
    rates = np.array([-1000.0, -0.3, -1e-4, 0.0, 0.02, 5.0, 300.0])
    np.testing.assert_allclose(exact_flows.shear_rate(fluid, exact_flows.stress(fluid, rates)), rates, rtol=1e-12)


@pytest.mark.parametrize(("gradient", "mean", "largest"), [
    (10.0, 6.3527417e-5, 9.4270969e-5), (100.0, 0.0032008878, 0.0043290559), (1000.0, 0.07601542, 0.1102402),
])  # fmt: skip
def test_plane_flow_of_carreau_blood(gradient, mean, largest):
    """Values of an integration along y."""
    assert exact_flows.plane_flow(CARREAU, gradient, 1e-3) == pytest.approx((mean, largest), rel=5e-8)


@pytest.mark.parametrize("fluid", FLUIDS, ids=NAMES)
def test_plane_flow_by_integration_along_y(fluid):
    def rate(y):
        return float(exact_flows.shear_rate(fluid, np.array([80.0 * y]))[0])

    mean, largest = exact_flows.plane_flow(fluid, 80.0, 1e-3)
    core = [0.005 / 80.0]  # Casson's plug ends there
    assert largest == pytest.approx(quad(rate, 0, 1e-3, points=core, epsabs=0, epsrel=1e-11, limit=500)[0], rel=1e-9)
    flux, _ = quad(lambda y: y * rate(y), 0, 1e-3, points=core, epsabs=0, epsrel=1e-11, limit=500)
    assert mean == pytest.approx(flux / 1e-3, rel=1e-9)


def test_bent_newtonian_flow_is_the_closed_form():
    """v = k (r ln r + c r + d/r), k = (dp/dtheta) / (2 mu)."""
    inner, outer, rate = 6e-3, 8e-3, 6.67e-5
    c, d = np.linalg.solve([[inner, 1 / inner], [outer, 1 / outer]], [-inner * np.log(inner), -outer * np.log(outer)])
    k = rate / quad(lambda r: r * np.log(r) + c * r + d / r, inner, outer)[0]
    flow = exact_flows.bent_flow(NEWTONIAN, inner, outer, rate)
    assert flow.gradient == pytest.approx(-2 * 3.5e-3 * k, rel=1e-9)
    exact = [abs(3.5e-3 * k * (1 - 2 * d / r**2)) for r in (inner, outer)]  # mu (dv/dr - v/r)
    assert [flow.inner, flow.outer] == pytest.approx(exact, rel=1e-9)
    r = flow.radius
    np.testing.assert_allclose(flow.velocity, k * (r * np.log(r) + c * r + d / r), atol=5e-6 * flow.velocity.max())


@pytest.mark.parametrize("fluid", FLUIDS, ids=NAMES)
def test_a_hardly_bent_channel_is_a_plane_one(fluid):
    mean, largest = exact_flows.plane_flow(fluid, 100.0, 1e-3)
    flow = exact_flows.bent_flow(fluid, 1e3 - 1e-3, 1e3 + 1e-3, 2e-3 * mean)
    assert flow.gradient / 1e3 == pytest.approx(100.0, rel=1e-6)
    assert [flow.inner, flow.outer] == pytest.approx([0.1, 0.1], rel=2e-6)
    assert flow.velocity.max() == pytest.approx(largest, rel=1e-5)


def test_bent_and_oscillating_flows_keep_the_momentum():
    """r^2 tau of the velocities is P r^2/2 + C, a line in r^2, and the flow rate is the given one."""
    flow = exact_flows.bent_flow(CARREAU, 6e-3, 8e-3, 6.67e-5)
    r, v = flow.radius, flow.velocity
    assert np.trapezoid(v, r) == pytest.approx(6.67e-5, rel=1e-5)
    middle = (r[1:] + r[:-1]) / 2
    moment = middle**2 * exact_flows.stress(CARREAU, middle * np.diff(v / r) / np.diff(r))
    slope, constant = np.polyfit(middle**2, moment, 1)
    assert -2 * slope == pytest.approx(flow.gradient, rel=1e-4)
    assert np.abs(slope * middle**2 + constant - moment).max() < 1e-3 * np.abs(moment).max()
    assert flow.inner > 1.1 * flow.outer
    # To first order, in a plane channel: 54/35 rho U^2 h'/h less of -dp/dx, 6/35 rho U^2 h' less of tau.
    radius, h, mean, slope = 1e2, 2e-3, 0.03, 0.01  # slope: dh/dx
    walls = radius - h / 2, radius + h / 2
    flow = exact_flows.bent_flow(NEWTONIAN, *walls, mean * h, slope / h * radius)
    without, inertia = exact_flows.bent_flow(NEWTONIAN, *walls, mean * h), 1035.0 * mean**2 * slope
    assert (without.gradient - flow.gradient) / radius == pytest.approx(54 / 35 * inertia / h, rel=1e-5)
    assert without.inner - flow.inner == pytest.approx(6 / 35 * inertia, rel=1e-4)
    assert without.outer - flow.outer == pytest.approx(6 / 35 * inertia, rel=1e-4)
    with pytest.raises(ValueError, match="between the radii"):
        exact_flows.bent_flow(NEWTONIAN, 8e-3, 6e-3, 1e-5)
    with pytest.raises(ValueError, match="no flow of -1"):
        exact_flows.bent_flow(NEWTONIAN, 6e-3, 8e-3, -1.0)
    y, t, step = np.linspace(0, exact_flows.HEIGHT, 401), 0.37, 1e-5
    (before, _), (velocity, gradient), (after, _) = (
        exact_flows.oscillating_flow(y, t + shift) for shift in (-step, 0, step)
    )
    assert np.abs(velocity[[0, -1]]).max() < 1e-14
    assert np.trapezoid(velocity, y) == pytest.approx(
        exact_flows.RATE * (1 + exact_flows.SWING * math.sin(2 * math.pi * t / exact_flows.PERIOD)), rel=1e-4
    )
    bent = np.gradient(np.gradient(velocity, y), y)[2:-2]
    missed = exact_flows.DENSITY * (after - before)[2:-2] / (2 * step) - gradient - exact_flows.VISCOSITY * bent
    assert np.abs(missed).max() < 1e-3 * abs(gradient)


def test_lumen_of_walls_that_have_moved():
    """The outer wall has moved by 0.2 mm/rad, and a pressure that is the angle is found at the deformed place."""
    angle = np.radians(np.linspace(90, 180, 91))
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    rest = np.concatenate([6e-3 * ray, 8e-3 * ray])
    moved = np.concatenate([np.zeros_like(ray), 2e-4 * angle[:, None] * ray])
    numbers, shift = np.arange(182), np.array([1e-4, -2e-4])

    def sample(points):
        x, y = (points + shift).T
        return {"ux": np.full(len(x), shift[0]), "uy": np.full(len(x), shift[1]), "p": np.arctan2(y, x)}

    state = SimpleNamespace(
        wall=pd.DataFrame({"line": ["inner"] * 91 + ["dome"] * 91}),
        points=SimpleNamespace(ends=np.column_stack([numbers, numbers])),
        mesh=SimpleNamespace(p2_coordinates=rest),
        state=SimpleNamespace(u=moved),
        fields=SimpleNamespace(sample=sample),
    )
    lumen = exact_flows.Lumen(state, NEWTONIAN, 6e-5)  # type: ignore[arg-type]
    assert lumen.radii(2.0) == pytest.approx((6e-3, 8.4e-3), rel=1e-9)
    assert lumen.widening(2.0) == pytest.approx(2e-4 / 2.4e-3, rel=1e-3)
    assert lumen.pressure(2.0) == pytest.approx(2.0, rel=1e-12)
    assert lumen.flow(2.0, True).gradient < lumen.flow(2.0, False).gradient


def test_tables_worst_values_and_changes_by_level():
    assert exact_flows.worst(np.array([1.1, 9.5]), np.array([1.0, 10.0])) == exact_flows.Measured(1.1, 1.0)
    assert math.isnan(exact_flows.worst(np.array([]), 1.0).error)
    table = blood.BloodTable("steady", "text", ("walls",), (Column("drop", "drop", "{:g}"),), finest=True)
    rows = [
        blood.Row("steady", "a-1", ("a",), 1, {"drop": exact_flows.Measured(1.0)}),
        blood.Row("steady", "a-2", ("a",), 2, {"drop": exact_flows.Measured(2.0)}),
        blood.Row("steady", "b-2", ("b",), 2, {"other": exact_flows.Measured(3.0)}),
        blood.Row("steady", "c-2", ("c",), 2, failure="crash"),
        blood.Row("plane", "d", ("d",), 2, {"drop": exact_flows.Measured(4.0)}),
    ]  # fmt: skip
    assert table.of(rows).body == [["a", "1"], ["a", "2"], ["c", "–"]]
    assert table.of(rows, short=True).body == [["a", "2"], ["c", "–"]]
    numbers = {"gradient": exact_flows.Measured(101.0, 100.0), "mean": exact_flows.Measured(0.1)}
    frame = blood.to_frame(
        [blood.Row("plane", "p", ("p", "100"), 0, numbers), blood.Row("plane", "q", ("q", "1"), 0, {}, "crash")]
    )
    first, second, third = frame.to_dict("records")
    assert (first["quantity"], first["error"], first["bound"]) == ("gradient", pytest.approx(0.01), 1e-4)
    assert math.isnan(second["reference"]) and math.isnan(second["bound"])
    assert (third["case"], third["failure"]) == ("q", "crash")

    def row(level, wss, failure=""):
        measured = {"wss_mean_dome": exact_flows.Measured(wss)}
        return blood.Row("steady", f"x-level-{level}", ("x", str(level)), level, measured, failure)

    (changes,) = blood.level_changes([row(1, 0.8), row(2, 1.0), row(3, 1.02)])
    assert (changes.group, changes.case, changes.labels, changes.level) == ("levels", "x", ("x",), 3)
    assert {name: number.value for name, number in changes.numbers.items()} == {
        "wss_mean_dome_2": pytest.approx(0.2), "wss_mean_dome_3": pytest.approx(0.02 / 1.02),
    }  # fmt: skip
    levels = next(table for table in blood.TABLES if table.group == "levels")
    (cells,) = levels.of([changes]).body
    assert [cell for cell in cells if "!" in cell] == ["+1.961 % !"]
    (gap,) = blood.level_changes([row(1, 0.8), row(2, 1.0, "crash"), row(3, 1.02)])
    assert gap.numbers == {}


def test_steady_runs_are_done_once_and_one_that_died_starts_again(tmp_path, freefem, check, capsys):
    scenes = {"one": load_scene("flap-svk", ["mesh.level=0", "output.pictures=false", "output.vtu=false"])}
    velocity = scenes["one"].inflow.mean_velocity
    freefem.die = velocity
    assert run_all(scenes, tmp_path)[0].failure == "crash"
    freefem.die = None
    (first,), (second,) = run_all(scenes, tmp_path), run_all(scenes, tmp_path)
    assert freefem.solved == [velocity]
    assert first.seconds == second.seconds == first.data["timings"]["script"]
    assert "one: finished before" in capsys.readouterr().err


def stand(name: str = "stand", end: float = 2.0) -> blood.BloodCase:
    """A case in time of which is measured how far it came."""
    return blood.BloodCase(
        *("pulsatile", name, ("elastic, Newtonian", "2"), 2),
        lambda: scene_in_time(f"time.end={end}"),
        lambda result: {"tawss_mean_dome": exact_flows.Measured(result.data["time"]["reached"])},
    )


def test_everything_is_written_and_a_second_call_goes_on(tmp_path, in_time, check, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    given = {"out": tmp_path / "results", "runs": tmp_path / "runs", "cases": [stand()], "readme": readme}
    assert blood.main(**given) == [""]
    frame = pd.read_csv(tmp_path / "results/blood.csv").set_index("quantity")
    assert frame.loc["tawss_mean_dome", "value"] == pytest.approx(2.0)
    assert (frame.loc["seconds", "bound"], frame.loc["check", "bound"]) == (900, 1e-8)
    text = readme.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    assert "| TAWSS mean Pa | min Pa (≥ 0) |" in text
    assert "Written by `python -m studies verify --blood` (FreeFEM 4.9 with MUMPS, one thread;" in text
    assert "[blood.md](results/blood.md)" in text
    assert "| elastic, Newtonian | 2 |" in (tmp_path / "results/blood.md").read_text()
    assert "TAWSS mean Pa" in capsys.readouterr().out and blood.main(**given) == [""]
    assert in_time.first_steps == [1] and readme.read_text() == text
