"""Outlets with a pressure, backflow, Womersley's profile, supported walls: against exact solutions and limits."""

import numpy as np
import pandas as pd
import pytest
from conftest import scene_of
from scipy.integrate import solve_ivp

import ffsi
from ffsi.freefem import Event
from ffsi.hemodynamics.result import Result
from ffsi.run.one_scene import solve
from ffsi.scene import CASES, Scene

RAMPED = {"mean_velocity": 0.1, "waveform": "mca", "ramp": 0.2}
WINDKESSEL = {
    "kind": "windkessel", "proximal_resistance": 60.0, "distal_resistance": 40.0, "compliance": 0.02, "pressure": 2.0,
}  # fmt: skip


def rigid(**tables: object) -> Scene:
    """Return the flow around a rigid flap on the coarsest mesh with some tables replaced."""
    table = CASES["flap-svk"].model_dump(exclude_none=True)
    table = {key: table[key] for key in table if key not in ("solid", "mesh_motion")}
    table |= {"mesh": {"level": 0}, "output": {"vtu": False, "pictures": False}}
    return Scene.model_validate(table | tables)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Solve a scene once; nobody may change its folder."""
    known: dict[str, Result] = {}

    def run(scene: Scene) -> Result:
        key = scene.to_toml()
        if key not in known:
            known[key] = solve(scene, tmp_path_factory.mktemp("run") / "run")
            assert known[key].converged, known[key].reason
        return known[key]

    return run


@pytest.mark.parametrize(("outlet", "pressure"), [
    ({"kind": "pressure", "pressure": 3.0}, 3.0), ({"kind": "pressure", "pressure": -1e4}, -1e4),
    ({"kind": "resistance", "resistance": 100.0}, 100 * 0.048),
    ({"kind": "resistance", "resistance": 100.0, "pressure": 2}, 2 + 100 * 0.048), (WINDKESSEL, 2 + 100 * 0.048),
])  # fmt: skip
def test_a_pressure_behind_the_outlet_shifts_the_whole_pressure(run, outlet, pressure):
    free, shifted = run(rigid()), run(rigid(outlet=outlet))
    assert shifted.quantities["flow_rate_out"] == pytest.approx(0.12 * 0.4, rel=1e-12)
    assert shifted.quantities["outlet_pressure"] == pytest.approx(pressure, rel=1e-12)
    difference = shifted.fields.pressure - free.fields.pressure
    np.testing.assert_allclose(difference, pressure, rtol=1e-9)
    np.testing.assert_allclose(shifted.fields.velocity, free.fields.velocity, atol=1e-9 * max(1, abs(pressure)))
    drop = free.quantities["pressure_drop"]
    assert shifted.quantities["pressure_drop"] == pytest.approx(drop, abs=1e-8 * max(1, abs(pressure)))


def test_the_resistance_changes_between_the_points_of_one_process(tmp_path):
    scene = rigid(outlet={"kind": "resistance", "resistance": 10.0})
    table = ffsi.sweep(scene, {"outlet.resistance": [10.0, 1000.0, 0.0]}, tmp_path / "sweep")
    np.testing.assert_allclose(table["outlet_pressure"], 0.048 * np.array([10, 1000, 0]), atol=1e-12)
    assert table["folder"].nunique() == 1


def exact(scene: Scene, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return flow rate and pressure of a Windkessel alone behind the scene's inflow."""
    height, inflow, outlet = 0.4, scene.inflow, scene.outlet

    def rate(t):
        return height * inflow.mean_velocity * inflow.factor(t)

    def slope(t, p):
        return (rate(t) - (p - outlet.pressure * inflow.ramp_factor(t)) / outlet.distal_resistance) / outlet.compliance

    start = outlet.pressure if inflow.ramp is None else 0.0
    found = solve_ivp(slope, (0, times[-1]), [start], t_eval=times, rtol=1e-10, atol=1e-12)
    return rate(times), outlet.proximal_resistance * rate(times) + found.y[0]


def test_a_windkessel_follows_its_equation_from_the_pressure_behind_it(run):
    errors = []
    for step in (0.02, 0.01):
        time = {"step": step, "end": 0.8, "output_interval": 0.4}
        scene = rigid(inflow=RAMPED, time=time, outlet=WINDKESSEL)
        result = run(scene)
        history = result.history
        rate, pressure = exact(scene, history["time"].to_numpy())
        np.testing.assert_allclose(history["flow_rate_out"], rate, atol=1e-9)
        errors.append(np.abs(history["outlet_pressure"] - pressure).max())
        free = run(rigid(inflow=RAMPED, time=time))
        for saved, other in zip(result.saved_steps, free.saved_steps, strict=True):
            # rows of the history at the step's end and start
            (_, before), (_, now) = history.iloc[saved.step - 2 : saved.step].iterrows()
            states = [row["outlet_pressure"] - 60 * row["flow_rate_out"] for row in (before, now)]
            assert saved.windkessel == pytest.approx(states, rel=1e-9)
            # the step sees the weighted pressure, all of it a constant
            difference = result.fields_of(saved).pressure - free.fields_of(other).pressure
            behind = saved.theta * now["outlet_pressure"] + (1 - saved.theta) * before["outlet_pressure"]
            np.testing.assert_allclose(difference, behind, rtol=1e-8)
    assert errors[0] < 5e-4 * 6.5
    assert errors[0] / errors[1] == pytest.approx(4, abs=0.4)  # second order
    inflow = {"mean_velocity": 0.1}
    scene = rigid(inflow=inflow, time={"step": 0.01, "end": 0.3}, outlet=WINDKESSEL | {"compliance": 0.002})
    history = run(scene).history
    _, pressure = exact(scene, history["time"].to_numpy())
    np.testing.assert_allclose(history["outlet_pressure"], pressure, rtol=0.02)
    assert history["outlet_pressure"].iloc[-1] == pytest.approx(2 + 100 * 0.04, rel=0.03)


def test_a_run_with_a_windkessel_resumes_to_the_same(tmp_path, run):
    time = {"step": 0.01, "end": 0.3, "output_interval": 0.13, "checkpoint_interval": 0.1}
    scene = rigid(inflow=RAMPED, time=time, outlet=WINDKESSEL)

    class Cut(Exception):
        pass

    def cut(event: Event) -> None:
        if event.kind == "time" and event.integer("step") == 24:
            raise Cut

    with pytest.raises(Cut):
        solve(scene, tmp_path / "run", on_event=cut)
    resumed = ffsi.resume(tmp_path / "run")
    assert resumed.converged, resumed.reason
    whole = run(scene)
    for name in ("history.csv", "steps.csv"):
        one, other = (pd.read_csv(folder / name) for folder in (whole.directory, resumed.directory))
        one, other = (table.select_dtypes("number").drop(columns="seconds", errors="ignore") for table in (one, other))
        np.testing.assert_allclose(other, one, rtol=1e-10, atol=1e-14)
    assert "windkessel_new" in pd.read_csv(resumed.directory / "steps.csv")


def test_a_high_pressure_does_not_hinder_the_steps(run):
    """What is written is solved to rounding, that of the pressure: 1e4 Pa here, with a dynamic pressure of 0.003 Pa."""
    time = {"step": 0.05, "end": 0.4, "output_interval": 0.1}
    inflow = {"mean_velocity": 0.05, "ramp": 0.3}
    low = run(rigid(inflow=inflow, time=time))
    high = run(rigid(inflow=inflow, time=time, outlet={"kind": "pressure", "pressure": 1e4}))
    assert high.history["step"].min() > 0.02
    np.testing.assert_allclose(high.fields.velocity, low.fields.velocity, atol=1e-7)


def reversed_flow(**outlet: object) -> Scene:
    """Return a flow that comes in through the outlet, at a Reynolds number of 400."""
    inflow = {"mean_velocity": 1.0, "waveform": "-1", "ramp": 0.5}
    time = {"step": 0.025, "end": 0.65}
    return rigid(inflow=inflow, time=time, outlet={"kind": "do-nothing"} | outlet)


def test_against_backflow_the_reversed_flow_stays_bounded(run):
    """Without the traction it grows without bound a little later (the step fails at 0.67 s)."""
    speeds = [np.abs(run(scene).fields.velocity).max() for scene in (reversed_flow(), reversed_flow(backflow=0.5))]
    assert speeds[0] > 6 and speeds[1] < 3.5


@pytest.mark.parametrize("kind", ["do-nothing", "zero-traction"])
def test_the_traction_against_backflow_in_a_channel(run, kind):
    """sigma n = -beta rho |v.n| v at the outlet: a flow inwards has the pressure -beta rho v^2 there."""
    tables = {
        "name": "reversed", "geometry": {"kind": "channel", "length": 3.0, "height": 1.0}, "mesh": {"level": 1},
        "fluid": {"density": 2.0, "viscosity": 1.0},
        "inflow": {"mean_velocity": 1.0, "profile": "-1.5 * 4 * y * (H - y) / H^2"},
        "output": {"vtu": False, "pictures": False},
    }  # fmt: skip
    none = run(Scene.model_validate(tables | {"outlet": {"kind": kind}}))
    some = run(Scene.model_validate(tables | {"outlet": {"kind": kind, "backflow": 0.4}}))
    # far from the outlet both are Poiseuille's flow: the difference of the pressures is a constant, near to the
    # mean of -beta rho v^2 over the section weighted with the velocity, -0.4 * 2 * int v^3 / int v
    at = [(0.5, 0.5)]
    difference = some.fields.sample(at)["p"][0] - none.fields.sample(at)["p"][0]
    y = np.linspace(0, 1, 2001)
    v = 6 * y * (1 - y)
    assert difference == pytest.approx(-0.4 * 2 * np.trapezoid(v**3, y), rel=0.1)


def test_an_outflow_knows_nothing_of_it(run):
    free, with_traction = run(rigid()), run(rigid(outlet={"kind": "do-nothing", "backflow": 1.0}))
    np.testing.assert_allclose(with_traction.fields.velocity, free.fields.velocity, atol=1e-12)


def womersley(y: np.ndarray, t: float, viscosity: float, flow: complex, period: float) -> tuple[np.ndarray, float]:
    """Return velocity and pressure gradient G e^(iwt) of an oscillating flow between plates at y = -1/2 and 1/2.

    v = Re G/(i w) [1 - cosh(b y)/cosh(b h)] e^(iwt) for the density 1, the flow rate is Re flow e^(iwt).
    """
    w = 2 * np.pi / period
    b, h = np.sqrt(1j * w / viscosity), 0.5
    rate = 1 / (1j * w) * (2 * h - 2 * np.sinh(b * h) / (b * np.cosh(b * h)))  # of G = 1
    gradient = flow / rate
    velocity = gradient / (1j * w) * (1 - np.cosh(b * y) / np.cosh(b * h)) * np.exp(1j * w * t)
    return velocity.real, (gradient * np.exp(1j * w * t)).real


def test_an_oscillating_channel_flow_is_womersleys(run):
    """Over the third cycle, within 0.5 %; the Womersley number of the half height is 3."""
    viscosity = 0.1745
    scene = Scene.model_validate(
        {
            "name": "womersley", "geometry": {"kind": "channel", "length": 2.0, "height": 1.0}, "mesh": {"level": 0},
            "fluid": {"density": 1.0, "viscosity": viscosity},
            "inflow": {"flow_rate": 1.0, "profile": "womersley", "waveform": "sinus"}, "outlet": {"kind": "do-nothing"},
            "time": {"step": 0.0125, "end": 3.0, "output_interval": 0.125}, "output": {"vtu": False, "pictures": False},
        }
    )  # fmt: skip
    result, y = run(scene), np.linspace(-0.5, 0.5, 41)
    steps = [step for step in result.saved_steps if step.time > 2]
    assert len(steps) == 8
    for step in steps:
        mean = 1.5 * (1 - 4 * y**2)
        swing, _ = womersley(y, step.time, viscosity, -0.75j, 1.0)
        for x in (0.0, 1.0, 2.0):
            computed = result.fields_of(step).sample(np.column_stack([np.full_like(y, x), y + 0.5]))
            assert np.abs(computed["vx"] - mean - swing).max() < 0.005 * 1.5
        middle = step.time - (1 - step.theta) * step.k  # where the pressure of a step belongs
        _, gradient = womersley(y, middle, viscosity, -0.75j, 1.0)
        pressure = result.fields_of(step).sample([(0.0, 0.5), (2.0, 0.5)])["p"]
        assert pressure[0] - pressure[1] == pytest.approx(2 * (12 * viscosity + gradient), abs=0.005 * 11.7)


# Support -----------------------------------------------------------------------------------------------------------

ROOF = "flap-neo-hookean-roof"
OUTSIDE = [(1.25, 0.42)]


def test_a_stiff_support_holds_the_roof(run):
    """Its displacement is the pressure on it over the stiffness; the stiffer, the nearer to a rigid roof."""
    settings = (ROOF, "mesh.size_factor=2", "inflow.mean_velocity=0.002")
    results = [run(scene_of(*settings, f"support.stiffness={k}")) for k in (100, 1000)]
    moved = [result.fields.sample(OUTSIDE)["uy"][0] for result in results]
    assert moved[0] / moved[1] == pytest.approx(10, rel=1e-3)
    rigid_roof = run(scene_of("flap-neo-hookean", "inflow.mean_velocity=0.002"))
    pressure = rigid_roof.fields.sample([(1.25, 0.4)])["p"][0]
    assert moved[1] == pytest.approx(pressure / 1000, rel=0.03)


IN_TIME = [
    *("time={step=0.02, end=0.1}", "mesh_motion.kind=harmonic", "inflow.mean_velocity=0.1", "inflow.ramp=0.1"),
    *("outlet.kind=windkessel", "outlet.proximal_resistance=3", "outlet.distal_resistance=5"),
    *("outlet.compliance=0.01", "outlet.backflow=0.5", "mesh.size_factor=2"),
]


def test_both_solvers_of_a_step_find_the_same_with_a_support(run):
    settings = [*IN_TIME, "time.end=0.04", "support.stiffness=2000", "support.damping=2"]
    condensed, newton = (run(scene_of(ROOF, *settings, f"solver.step={kind}")) for kind in ("condensed", "newton"))
    assert newton.history["iterations"].max() <= 4  # quadratic: the Jacobian has every term
    assert condensed.history["iterations"].mean() < 12  # its matrix knows the support
    columns = ["drag", "tip_ux", "tip_uy", "flow_rate_out", "outlet_pressure"]
    np.testing.assert_allclose(condensed.history[columns], newton.history[columns], rtol=1e-5)


def test_a_damped_support_slows_the_roof(run):
    free, damped = (run(scene_of(ROOF, *IN_TIME, "support.stiffness=0", f"support.damping={c}")) for c in (0, 2000))
    roof = [abs(result.fields.sample(OUTSIDE)["uy"][0]) for result in (free, damped)]
    assert roof[1] < 0.05 * roof[0]
