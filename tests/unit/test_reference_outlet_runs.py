"""Run folders in time with a Windkessel: its reservoir follows from the flow rates of the history."""

import json
import math

import pytest
from test_reference_check import failing, scene_mesh
from test_reference_step import history_row, quantities_of, rest, write_history
from test_reference_step_runs import rewrite

from ffsi.files.arrays import write_mesh, write_state
from ffsi.reference.check import check_run
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.solve import solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.scene import CASES, with_values

CHANGES = {
    "inflow.mean_velocity": 0.05, "solid.flap.lame_lambda": 800.0, "solid.flap.lame_mu": 200.0,
    "mesh_motion.kind": "harmonic", "time.step": 0.05, "time.end": 0.13, "outlet.kind": "windkessel",
    "outlet.pressure": 0.02, "outlet.proximal_resistance": 0.3, "outlet.distal_resistance": 1.1,
    "outlet.compliance": 0.04, "outlet.backflow": 0.5,
}  # fmt: skip


@pytest.fixture(scope="module")
def solved():
    """Scene without a ramp, its mesh, states, rows of the history and the entry of the last step."""
    scene = with_values(CASES["flap-svk"], CHANGES)
    mesh = scene_mesh(scene)
    system = System.build(problem_from_scene(scene), mesh)
    states, history, time, reservoir = [rest(system)], [], 0.0, 0.02
    for k, theta in ((0.05, 1.0), (0.05, 1.0), (0.03, 0.53)):  # without a ramp the inflow jumps
        time += k
        step, start = Step(k, theta, time), reservoir
        states.append(solve_step(system, states[-1], step, tolerance=1e-11, reservoir=start).state)
        stepping = system.stepping(states[-2], step, start)
        quantities = quantities_of(stepping, states[-1])
        reservoir = quantities["windkessel_new"]
        history.append(history_row(step, stepping, states[-1], history[-1] if history else ()))
    entry = {"step": 3, "time": time, "k": k, "theta": step.theta, "old": "old.bin", "new": "new.bin"}
    forces = {name: quantities[name] for name in ("drag", "lift")}
    return (
        scene, mesh, states, {name: value for name, value in quantities.items() if "windkessel" not in name}, history,
        entry | {"quantities": forces, "windkessel_old": start, "windkessel_new": reservoir},
    )  # fmt: skip


@pytest.fixture
def run(tmp_path, solved):
    """Function that writes the run folder with some changes and returns the checker's report."""
    scene, mesh, states, last, history, entry = solved

    def write(entry_changes=(), history_changes=(), row=0):
        write_mesh(tmp_path / "mesh.bin", mesh)
        write_state(tmp_path / "old.bin", states[-2])
        write_state(tmp_path / "new.bin", states[-1])
        write_state(tmp_path / "point-0001.bin", states[-1])
        (tmp_path / "point-0001.json").write_text(json.dumps({"quantities": last}))
        rewrite(tmp_path, [entry | dict(entry_changes)])
        rows = [dict(line) for line in history]
        rows[row] |= dict(history_changes)
        write_history(tmp_path, rows)
        return check_run(tmp_path, scene)

    return write


def test_a_run_with_a_windkessel_passes_and_other_reservoirs_are_seen(run, solved):
    report = run()
    assert report.failures == [] and report.outlet_difference < 1e-12
    entry, history = solved[-1], solved[-2]
    for name in ("windkessel_old", "windkessel_new"):
        assert failing(run({name: entry[name] * (1 + 1e-6)})) == {"outlet_difference"}
        assert failing(run({name: math.nan})) == {"outlet_difference"}
    # An earlier flow rate, and with it all reservoirs after it.
    changed = {"flow_rate_out": history[0]["flow_rate_out"] * 1.001}
    assert {"momentum", "outlet_difference"} <= failing(run(history_changes=changed))
    changed = {"outlet_pressure": history[2]["outlet_pressure"] * (1 + 1e-6)}
    assert failing(run(history_changes=changed, row=2)) == {"outlet_difference"}
    with pytest.raises(ValueError, match=r"history\.csv: no step 4, the last is 3"):
        run({"step": 4})
    with pytest.raises(ValueError, match=r"history\.csv: row 1: flow_rate_out = '' is no finite number"):
        run(history_changes={"flow_rate_out": ""})
