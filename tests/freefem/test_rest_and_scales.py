"""Scales and tolerances come from what is there: free fall, rest, creeping flow, slow motion, high pressures."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import PLAIN, scene_of
from own_mesh import scene_on, write_mesh
from structured import structured_mesh
from units_scaling import compare, factor_of, first_steps, in_units

import ffsi
from ffsi.files.arrays import read_mesh, read_state
from ffsi.hemodynamics.aneurysm import AneurysmState
from ffsi.hemodynamics.result import Result
from ffsi.reference import check_run
from ffsi.result import painting, views
from ffsi.result.fields import Fields
from ffsi.result.quantities import unit
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, load_scene
from ffsi.script.render import render

COARSE = ["mesh.level=0", "mesh.size_factor=2", *PLAIN]
QUIET = {"pictures": False, "vtu": False}


def run(case: str, *settings: str) -> Result:
    result = solve(load_scene(case, [*COARSE, *settings]))
    assert result.converged, result.reason
    return result


def block(path: Path) -> None:
    """Write a block of 1 m x 0.5 m with 4 x 2 squares cut into triangles, and the names of its sides."""
    sides = {"left": 2, "right": 3, "floor": 4, "roof": 5}
    at = {(0.0, "x"): 2, (1.0, "x"): 3, (0.0, "y"): 4, (0.5, "y"): 5}
    mesh = structured_mesh(
        np.linspace(0, 1, 5), np.linspace(0, 0.5, 3), lambda x, y: 1, lambda x, y: at.get((x, "x")) or at[y, "y"]
    )
    write_mesh(path, mesh, {"block": 1}, sides)


@pytest.mark.parametrize("step", ["condensed", "newton"])
@pytest.mark.parametrize("formulation", ["displacement", "mixed", "incompressible"])
def test_a_free_fall_is_one_half_g_t_squared(tmp_path, step, formulation):
    block(tmp_path / "block.msh")
    scene = Scene.model_validate({
        "name": "fall",
        "geometry": {"kind": "mesh", "file": str(tmp_path / "block.msh"), "regions": {"block": "block"}},
        "solid": {"block": {
            "density": 1000.0, "material": "neo-hookean", "formulation": formulation, "young_modulus": 1e5,
            **({} if formulation == "incompressible" else {"poisson_ratio": 0.3}),
        }},
        "gravity": {"x": 3.0, "y": -9.81},
        "time": {"scheme": "crank-nicolson", "step": 0.05, "end": 0.5},
        "solver": {"step": step},
        "output": QUIET,
    })  # fmt: skip
    result = solve(scene)
    assert result.converged, result.reason
    times = result.history["time"]
    for name, acceleration in (("tip_ux", 3.0), ("tip_uy", -9.81)):
        np.testing.assert_allclose(result.history[name], acceleration * times**2 / 2, rtol=1e-9)
    assert check_run(result.directory, scene).step_error < 10  # of ordinary steps


# Fluid at rest, without inertia, slow ---------------------------------------------------------------------------------

STEPS = ["time.step=0.02", "time.end=0.1", "time.stop=end"]


@pytest.mark.parametrize("how", ["step=condensed", "step=newton", "step_tolerance=1e-12"])
def test_a_fluid_at_rest_carries_the_cylinder(how):
    rest = run("cylinder-2d2", "inflow.mean_velocity=0", "gravity.x=-10", f"solver.{how}", *STEPS)
    assert rest.data["newton"]["iterations"] < 60  # to round-off no step is halved
    assert rest.last_quantities["drag"] == pytest.approx(10 * math.pi * 0.05**2, rel=0.02)
    # Triangles with a bent side carry no linear pressure exactly: a little flow is left beside that of a free fall.
    assert np.abs(rest.fields.velocity).max() < 1e-3 * math.sqrt(2 * 10 * 2.2)


@pytest.mark.parametrize("step", ["condensed", "newton"])
def test_a_fluid_at_rest_between_columns_of_fluid(tmp_path, step):
    block(tmp_path / "block.msh")
    edges = {"outlet": ["left", "right"], "walls": ["floor", "roof"]}
    scene = scene_on(tmp_path / "block.msh", edges, {"fluid": "block"}, fluid={"density": 1e3, "viscosity": 0.1},
        gravity={"x": 0, "y": -9.81}, outlet={"kind": "pressure", "pressure": 100, "hydrostatic": True},
        time={"step": 0.1, "end": 0.5}, solver={"step": step})  # fmt: skip
    result = solve(scene)
    assert result.checked and result.data["newton"]["iterations"] < 60
    np.testing.assert_allclose(result.history["lift"], -9810 / 2, rtol=1e-9)


@pytest.mark.parametrize("viscosity", [1.0, 1e-3])
def test_water_at_rest_in_a_channel_of_metres_is_weighed_by_its_floor(viscosity):
    """The velocity of its fall, sqrt(g L), is a Reynolds number of 3e6: as a unit it made a singular matrix of rest."""
    scene = {
        "name": "basin", "geometry": {"kind": "channel", "length": 3.0, "height": 1.0}, "mesh": {"level": 0},
        "fluid": {"density": 1000.0, "viscosity": viscosity}, "inflow": {"mean_velocity": 0.0},
        "outlet": {"kind": "do-nothing", "hydrostatic": True}, "gravity": {"x": 3.0, "y": -9.81}, "output": QUIET,
    }  # fmt: skip
    rest = solve(Scene.model_validate(scene))
    assert rest.converged, rest.reason
    assert rest.quantities["lift"] == pytest.approx(-1000 * 9.81 * 3.0, rel=1e-9)
    x, y = rest.fields.points.T
    exact = 1000.0 * (3.0 * (x - 3.0) - 9.81 * (y - 1.0))  # from the outlet's upper end
    assert abs(rest.fields.pressure - exact).max() < 1e-10 * abs(exact).max()
    # Rounding of the pressure, 1e-16 of 1e4 Pa, moves it against the viscosity.
    assert np.abs(rest.fields.velocity).max() < 1e-11 / viscosity


@pytest.mark.parametrize("step", ["condensed", "newton"])
@pytest.mark.parametrize("case", ["cylinder-2d2", "turek-csm3", "turek-fsi3"])
def test_nothing_moves_where_nothing_drives(case, step):
    still = ["gravity.y=0"] if case == "turek-csm3" else ["inflow.mean_velocity=0"]
    rest = run(case, *still, f"solver.step={step}", *STEPS)
    for field in ("velocity", "pressure"):
        assert np.nanmax(np.abs(getattr(rest.fields, field)), initial=0.0) < 1e-10
    assert rest.history["iterations"].max() <= 2


def test_zero_inflow_is_rest():
    rest = run("turek-fsi1", "inflow.mean_velocity=0")
    assert abs(rest.quantities["tip_uy"]) < 1e-20 and abs(rest.quantities["drag"]) < 1e-12


@pytest.mark.parametrize("creeping", ["fluid.viscosity=1000", "fluid.density=1e-9"])
def test_creeping_flow_in_time_has_the_drag_of_steady_flow(creeping):
    steady = run("cylinder-2d1", "fluid.viscosity=1000")
    flow = run("cylinder-2d1", creeping, "time={step=0.02, end=0.1}", "inflow.ramp=0.04")
    drag = [r.last_quantities["drag"] / r.scene.fluid.viscosity / r.scene.inflow.mean_velocity for r in (steady, flow)]
    assert drag[1] == pytest.approx(drag[0], rel=1e-5)


def test_a_slow_flap_is_linear():
    tips = [run("flap-neo-hookean", f"inflow.mean_velocity={u}").quantities["tip_ux"] / u for u in (1e-5, 1e-7)]
    assert tips[1] == pytest.approx(tips[0], rel=0.01) and tips[0] != 0


def test_a_sweep_through_zero_halves_no_step(tmp_path):
    scene = load_scene("flap-neo-hookean", COARSE)
    table = ffsi.sweep(scene, {"inflow.mean_velocity": [0.06, 0.0, 0.059]}, tmp_path)
    assert table["status"].tolist() == ["converged"] * 3 and abs(table["tip_ux"][1]) < 1e-12 * table["tip_ux"][0]
    assert table["tip_ux"][2] == pytest.approx(table["tip_ux"][0], rel=0.03)
    logs = [path.read_text() for path in tmp_path.rglob("*.log")]
    assert any("@ffsi newton" in log for log in logs) and not any("halved" in log for log in logs)


@pytest.mark.parametrize("time", [None, {"step": 0.01, "end": 0.05}])
@pytest.mark.parametrize(("outlet", "pressure"), [
    ({"kind": "pressure", "pressure": 13332.0}, 13332.0),
    ({"kind": "windkessel", "proximal_resistance": 1e14, "distal_resistance": 3e14, "compliance": 1e-20}, 8e10),
], ids=["pressure", "windkessel"])  # fmt: skip
def test_a_pressure_of_any_height_behind_the_outlet_changes_no_velocity(outlet, pressure, time):
    def channel(outlet):
        scene = {
            "name": "channel", "geometry": {"kind": "channel", "length": 1e-2, "height": 2e-3}, "mesh": {"level": 0},
            "fluid": {"density": 1060.0, "viscosity": 3.5e-3}, "inflow": {"mean_velocity": 0.1}, "outlet": outlet,
            "output": QUIET,
        }  # fmt: skip
        result = solve(Scene.model_validate(scene | ({"time": time} if time else {})))
        assert result.converged, result.reason
        return result

    plain, high = channel({"kind": "pressure", "pressure": 0.0}), channel(outlet)
    assert np.abs(high.fields.velocity - plain.fields.velocity).max() < 1e-10 * np.abs(plain.fields.velocity).max()
    assert high.last_quantities["outlet_pressure"] == pytest.approx(pressure, rel=1e-6)


@pytest.mark.parametrize("time", [None, {"step": 0.1, "end": 0.3}])
def test_the_pressure_behind_the_outlet_presses_on_the_floor(tmp_path, time):
    block(tmp_path / "block.msh")
    geometry = {"kind": "mesh", "file": str(tmp_path / "block.msh"), "regions": {"fluid": "block"}}
    geometry["boundaries"] = {"inlet": "left", "outlet": "right", "walls": ["floor", "roof"]}
    geometry["parts"] = {"floor": "floor"}
    lifts = []
    for pressure in (0.0, 1e5):
        scene = {
            "name": "floor", "geometry": geometry, "fluid": {"density": 1.0, "viscosity": 0.1},
            "inflow": {"mean_velocity": 1.0}, "outlet": {"kind": "pressure", "pressure": pressure}, "output": QUIET,
        }  # fmt: skip
        result = solve(Scene.model_validate(scene | ({"time": time} if time else {})))
        assert result.converged, result.reason
        lifts.append(result.last_quantities["lift"])
    assert lifts[1] - lifts[0] == pytest.approx(-1e5, rel=1e-9)


# What is no number is not converged -----------------------------------------------------------------------------------

STARTS = {
    "no number": "X[vxFrom+N2/2] = sqrt(-1.);",
    "folded": "for (int i = 0; i < N2; ++i) if (!solidNode[i]) X[uyFrom+i] *= -40; X[uyFrom+N2/2] += 1;",
}


@pytest.mark.parametrize("start", STARTS)
def test_a_bad_start_on_the_finer_mesh_is_refused(run_text, solved, start):
    """As if the transfer from the coarser mesh had gone wrong: the run goes back to rest and comes to the same."""
    settings = ["mesh.level=1", "mesh.size_factor=2", "mesh_motion.kind=linear-elastic"]  # knows no J <= 0
    good = solved("flap-neo-hookean", *settings)
    text = render(load_scene("flap-neo-hookean", [*settings, *PLAIN]))
    head, transfer, rest = text.partition("func int Transfer() {")
    assert transfer
    out, _ = run_text(head + transfer + rest.replace("\n}\n", f"\n  {STARTS[start]}\n}}\n", 1))
    found = json.loads((out / "point-0001.json").read_text())["quantities"]
    assert found["tip_ux"] == pytest.approx(good.quantities["tip_ux"], rel=1e-8)
    fine = pd.read_csv(out / "newton.csv").query("stage == 2 and correction > 0")["correction"]
    from_rest = solved("flap-neo-hookean", *settings, "solver.start=rest").history["correction"]
    np.testing.assert_allclose(fine[:3], from_rest[:3], rtol=1e-6)


@pytest.mark.parametrize("case", ["turek-cfd1", "flap-svk"])
def test_newton_goes_on_until_the_tolerance(case):
    """A tolerance just below one of the residuals on the way asks for one iteration more."""
    residuals = run(case).history["residual"].to_numpy()
    tolerance = float(residuals[residuals > 1e-9][-1]) / 10
    last = run(case, f"solver.tolerance={tolerance!r}").history["residual"].iloc[-1]
    assert last <= tolerance


def test_a_point_further_on_starts_on_the_line_through_the_last_two(tmp_path):
    """A slow flow is linear: the start of the third point is its solution, although its step is four times as long."""
    ffsi.sweep(load_scene("turek-cfd1", COARSE), {"inflow.mean_velocity": [1e-6, 2e-6, 6e-6]}, tmp_path)
    (history,) = tmp_path.rglob("newton.csv")
    first = pd.read_csv(history).groupby("point")["residual"].first()
    assert first[3] < 1e-3 < 0.1 < first[1]


ACROSS = ["gravity.y=-9.81", "gravity.x=3", "outlet.hydrostatic=true"]
KINDS = {
    "do-nothing": [], "zero-traction": [], "pressure": ["outlet.pressure=5"], "resistance": ["outlet.resistance=3"],
    "windkessel": ["outlet.proximal_resistance=1", "outlet.distal_resistance=2", "outlet.compliance=0.1"],
}  # fmt: skip
AREA = math.pi * 0.05**2  # of the cylinder, m^2; the density is 1 kg/m^3


def cylinder(*settings: str) -> Result:
    result = solve(scene_of("cylinder-2d1", *settings))
    assert result.converged, result.reason
    return result


@pytest.mark.parametrize("kind", KINDS)
def test_only_buoyancy_is_added_to_a_flow(kind: str) -> None:
    outlet = [f"outlet.kind={kind}", *KINDS[kind]]
    plain, heavy = cylinder(*outlet), cylinder(*outlet, *ACROSS)
    scale = abs(plain.quantities["drag"])
    assert heavy.quantities["lift"] - plain.quantities["lift"] == pytest.approx(9.81 * AREA, abs=1e-4 * scale)
    assert heavy.quantities["drag"] - plain.quantities["drag"] == pytest.approx(-3 * AREA, abs=1e-4 * scale)
    assert heavy.warnings == plain.warnings == []


UNITS = [(1e-6, 1.0, 1.0), (1e6, 1e-6, 1e6), (1e-6, 1e6, 1e-6), (1e6, 1e6, 1.0), (1.0, 1e-6, 1e-6)]
NAMES = {"wall_shear_stress": "Pa", "effective_stress": "Pa"}


def assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(expected)))


@pytest.mark.parametrize("units", UNITS)
def test_an_aneurysm_in_other_units(solved, units):
    result = solved("aneurysm")
    mesh = read_mesh(result.directory / "mesh.bin")
    state = read_state(result.directory / "point-0001.bin", mesh)
    length, speed, stress = (factor_of(name, *units) for name in ("m", "m/s", "Pa"))
    scaled = replace(mesh, vertices=length * mesh.vertices)
    other = replace(state, u=length * state.u, v=speed * state.v, p=stress * state.p, ps=stress * state.ps)
    fields = Fields.from_raw(scaled, other, (2, 3))
    found = AneurysmState(in_units(result.scene, *units), scaled, other, fields)
    plain = result.aneurysm
    assert list(found.quantities) == list(plain.quantities)
    for name, value in plain.quantities.items():
        expected = pytest.approx(value * factor_of(unit(name), *units), rel=1e-9, abs=1e-12 if unit(name) == "1" else 0)
        assert found.quantities[name] == expected, name
    for name, values in plain.point_data.items():
        assert_close(found.point_data[name], values * factor_of(NAMES[name], *units))
    wall, before = found.wall, plain.wall
    assert wall["part"].tolist() == before["part"].tolist() and wall["line"].tolist() == before["line"].tolist()
    for name, factor in {"arc": length, "x": length, "wss": stress, "pressure": stress}.items():
        assert_close(wall[name].to_numpy(), before[name].to_numpy() * factor)
    at = mesh.vertices[mesh.triangles].mean(axis=1)
    for name, factor in {"ux": length, "vy": speed, "p": stress, "region": 1.0}.items():
        assert_close(fields.sample(length * at)[name], result.fields.sample(at)[name] * factor)
    assert all(len(painting.paint(name, fields)) > 1000 for name in views.available(fields))


MIXTURES = {
    "cook": (1e6, 1e-6, 1e3), "flap-neo-hookean": (1e-6, 1e6, 1e-3), "turek-cfd1": (1e3, 1e-6, 1e6),
    "turek-csm3": (1e-6, 1e-6, 1e6), "turek-fsi3": (1e6, 1e-6, 1e-3),
}  # fmt: skip
LAWS = {"turek-cfd1": ['fluid={law="power-law", density=1000, consistency=1, exponent=0.6}']}


@pytest.mark.parametrize("case", MIXTURES)
def test_other_units_are_the_same_computation(tmp_path, case):
    settings = ["mesh.level=0", "mesh.size_factor=2", *PLAIN, *first_steps(case, 5), *LAWS.get(case, [])]
    assert compare(case, settings, *MIXTURES[case], tmp_path) < 1e-8
