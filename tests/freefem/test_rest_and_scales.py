"""Scales and tolerances come from what is there: free fall, rest, creeping flow, slow motion, high pressures."""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import PLAIN

import ffsi
from ffsi.hemodynamics.result import Result
from ffsi.reference import check_run
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
    number = {(i, j): 3 * i + j + 1 for i in range(5) for j in range(3)}
    nodes = [f"{n} {i / 4} {j / 4} 0" for (i, j), n in number.items()]
    cells = []
    for i in range(4):
        for j in range(2):
            a, b, c, d = (number[at] for at in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
            cells += [f"2 2 1 1 {a} {b} {c}", f"2 2 1 1 {a} {c} {d}"]
    sides = {"left": [(0, j) for j in range(3)], "right": [(4, j) for j in range(3)]}
    sides |= {"floor": [(i, 0) for i in range(5)], "roof": [(i, 2) for i in range(5)]}
    for tag, side in enumerate(sides.values(), 2):
        cells += [f"1 2 {tag} {tag} {number[start]} {number[end]}" for start, end in itertools.pairwise(side)]
    rows = [f"{n} {cell}" for n, cell in enumerate(cells, 1)]
    names = ['2 1 "block"', *(f'1 {tag} "{name}"' for tag, name in enumerate(sides, 2))]
    parts = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames"]
    parts += ["$Nodes", str(len(nodes)), *nodes, "$EndNodes", "$Elements", str(len(rows)), *rows, "$EndElements", ""]
    path.write_text("\n".join(parts))


@pytest.mark.parametrize("step", ["condensed", "newton"])
@pytest.mark.parametrize("formulation", ["displacement", "mixed", "incompressible"])
def test_a_free_fall_is_one_half_g_t_squared(tmp_path, step, formulation):
    block(tmp_path / "block.msh")
    scene = Scene.model_validate({
        "name": "fall",
        "geometry": {"kind": "mesh", "file": str(tmp_path / "block.msh"), "regions": {"block": "block"}},
        "solid": {
            "block": {
                "density": 1000.0,
                "material": "neo-hookean",
                "formulation": formulation,
                "young_modulus": 1e5,
                **({} if formulation == "incompressible" else {"poisson_ratio": 0.3}),
            }
        },
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


@pytest.mark.parametrize("step", ["condensed", "newton"])
def test_a_fluid_at_rest_carries_the_cylinder(step):
    rest = run("cylinder-2d2", "inflow.mean_velocity=0", "gravity.x=-10", f"solver.step={step}", *STEPS)
    assert rest.last_quantities["drag"] == pytest.approx(10 * math.pi * 0.05**2, rel=0.02)
    # Triangles with a bent side carry no linear pressure exactly: a little flow is left beside that of a free fall.
    assert np.abs(rest.fields.velocity).max() < 1e-3 * math.sqrt(2 * 10 * 2.2)


def test_water_at_rest_in_a_channel_of_metres_is_weighed_by_its_floor():
    """The velocity of its fall, sqrt(g L), is a Reynolds number of 3e6: as a unit it made a singular matrix of rest."""
    scene = {
        "name": "basin", "geometry": {"kind": "channel", "length": 3.0, "height": 1.0}, "mesh": {"level": 0},
        "fluid": {"density": 1000.0, "viscosity": 1e-3}, "inflow": {"mean_velocity": 0.0},
        "outlet": {"kind": "do-nothing", "hydrostatic": True}, "gravity": {"y": -9.81}, "output": QUIET,
    }  # fmt: skip
    result = solve(Scene.model_validate(scene))
    assert result.converged, result.reason
    assert result.quantities["lift"] == pytest.approx(-1000 * 9.81 * 3.0, rel=1e-9)
    # Rounding of the pressure, 1e-16 of 1e4 Pa, moves it against a viscosity of 1e-3 Pa s.
    assert np.abs(result.fields.velocity).max() < 1e-8


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
