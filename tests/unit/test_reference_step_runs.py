"""Run folders with checked time steps, also with a Windkessel, whose reservoir follows from the flow rates."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from test_reference_check import copy, failing, largest, scene_mesh, write_run
from test_reference_step import history_row, quantities_of, rest, write_history

from ffsi.files.arrays import RawState, write_state
from ffsi.reference import terms
from ffsi.reference.check import check_run
from ffsi.reference.from_scene import problem_from_scene, refuse_other_step
from ffsi.reference.ordinary import ALLOWED, Corrector, weighted
from ffsi.reference.solve import moved, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System
from ffsi.scene import CASES, with_values

CHANGES = {
    "inflow.mean_velocity": 0.05, "solid.flap.lame_lambda": 800.0, "solid.flap.lame_mu": 200.0,
    "mesh_motion.kind": "harmonic", "time.step": 0.05, "time.end": 0.18, "inflow.ramp": 0.12,
}  # fmt: skip


@pytest.fixture(scope="module")
def solved_run():
    """Scene in time, its mesh, states by the number of the step, entries of two checked steps, and the history."""
    scene = with_values(CASES["flap-svk"], CHANGES)
    mesh = scene_mesh(scene)
    system = System.build(problem_from_scene(scene), mesh)
    states, time, entries, rows = [rest(system)], 0.0, [], []
    for number, k in enumerate((0.05, 0.05, 0.05, 0.03), start=1):
        time += k
        step, old = Step(k, 0.5 + k, time), states[-1]
        states.append(solve_step(system, old, step, tolerance=1e-11).state)
        rows.append(history_row(step, system.stepping(old, step), states[-1], rows[-1] if rows else ()))
        if number in (2, 4):
            entry = {"step": number, "time": time, "k": k, "theta": step.theta}
            entry |= {"old": f"state-{number - 1:06d}.bin", "new": f"state-{number:06d}.bin"}
            quantities = quantities_of(system.stepping(old, step), states[-1])
            entries.append(entry | {"quantities": {name: quantities[name] for name in ("drag", "lift")}})
    return scene, mesh, states, entries, rows, quantities


@pytest.fixture
def run(tmp_path, solved_run):
    scene, mesh, states, entries, rows, last = solved_run
    for number, state in enumerate(states[1:], start=1):
        write_state(tmp_path / f"state-{number:06d}.bin", state)
    values = {key: value for key, value in CHANGES.items() if not isinstance(value, str)}
    write_run(tmp_path, mesh, states[-1], {"parameters": values, "quantities": last})
    write_history(tmp_path, rows)
    rewrite(tmp_path, entries)
    return tmp_path, scene, [entry | {"quantities": dict(entry["quantities"])} for entry in entries]


def rewrite(directory, entries):
    rows = [{"tolerance": 0.0, **entry, **entry.get("quantities", {})} for entry in entries]
    columns = dict.fromkeys(["drag", "lift", *(name for row in rows for name in row if name != "quantities")])
    pd.DataFrame(rows, columns=list(columns)).to_csv(directory / "steps.csv", index=False)


def test_run_folders_are_checked_by_their_worst_step(run):
    directory, scene, entries = run
    report = check_run(directory, scene)
    assert report.failures == [] and report.kinematics is not None
    assert report.forces.total.residual[0] == entries[1]["quantities"]["drag"]
    drag = entries[0]["quantities"]["drag"]
    entries[0]["quantities"]["drag"] *= 1.0 + 1e-6
    entries[1]["quantities"]["drag"] *= 1.0 + 1e-7
    rewrite(directory, entries)
    report = check_run(directory, scene)
    assert report.drag_difference == pytest.approx(1e-6, rel=1e-3) and failing(report) == {"drag_difference"}
    first, second = report.failures
    assert " in step 2 at 0.1 s, allowed is 1e-08" in first
    assert second.startswith(f"recomputed: drag {drag:.12g} N/m") and second.endswith(" in step 2 at 0.1 s")
    del entries[1]["quantities"]["drag"]
    rewrite(directory, entries)
    assert " is inf in step 4 at 0.18 s" in check_run(directory, scene).failures[0]


def test_any_place_of_equal_jacobians_may_be_reported(tmp_path, solved_run):
    scene = with_values(solved_run[0], {"inflow.mean_velocity": 0.0, "time.end": 0.05})
    mesh = solved_run[1]
    system = System.build(problem_from_scene(scene), mesh)
    state, step = rest(system), Step(0.05, 0.55, 0.05)  # J = 1 everywhere
    stepping = system.stepping(state, step)
    quantities = quantities_of(stepping, state)
    x, y = system.solids[2].elements.p1[2] @ mesh.vertices[system.solids[2].elements.vertices[3]]
    assert quantities["min_jacobian_flap_x"] != x
    for name in ("old.bin", "new.bin"):
        write_state(tmp_path / name, state)
    quantities |= {"min_jacobian_flap_x": float(x), "min_jacobian_flap_y": float(y)}
    write_run(tmp_path, mesh, state, {"quantities": quantities})
    write_history(tmp_path, [history_row(step, stepping, state)])
    entry = {"step": 1, "time": 0.05, "k": 0.05, "theta": 0.55, "old": "old.bin", "new": "new.bin"}
    rewrite(tmp_path, [entry | {"quantities": {"drag": 0.0, "lift": 0.0}}])
    assert check_run(tmp_path, scene).failures == []


def test_numbers_that_are_none_and_exchanged_files_are_seen(run):
    directory, scene, entries = run
    entries[1]["quantities"]["lift"] = math.nan
    rewrite(directory, entries)
    report = check_run(directory, scene)
    assert failing(report) == {"lift_difference"} and "is inf in step 4 at 0.18 s" in report.failures[0]
    directory, scene, entries = run
    entries[0]["old"], entries[1]["old"] = entries[1]["old"], entries[0]["old"]
    rewrite(directory, entries)
    assert {"momentum", "kinematics"} <= failing(check_run(directory, scene))


def test_inverted_triangle_in_one_step_fails(run, solved_run):
    directory, scene, entries = run
    _, mesh, states, *_ = solved_run
    for entry in entries:
        changed = copy(states[entry["step"]])
        changed.u[largest(mesh.p2_coordinates, System.build(problem_from_scene(scene), mesh).rows.mesh_motion)[0]] += (
            1.0
        )
        write_state(directory / entry["new"], changed)
        if entry is entries[-1]:
            write_state(directory / "point-0001.bin", changed)
        report = check_run(directory, scene)
        assert report.min_jacobian < 0.0
        (text,) = (text for text in report.failures if text.startswith("min_jacobian: "))
        assert f" in step {entry['step']} at " in text
        write_state(directory / entry["new"], states[entry["step"]])


@pytest.mark.parametrize(("changes", "message"), [
    (dict(k=0.051, theta=0.551), r"k = 0\.051 s, at most 0\.05 s"), (dict(theta=0.5), r"theta = 0\.5, expected 0\.55"),
    (dict(theta=1.0), r"theta = 1\.0, expected 0\.55"), (dict(time=0.04), r"its start is at -0\.01\d* s"),
    (dict(time=0.19), r"its end is at 0\.19 s, the last at 0\.18 s"), (dict(k=0.0), "no time step: k = 0.0 s"),
], ids=str)  # fmt: skip
def test_step_that_the_scene_does_not_have_is_refused(run, changes, message):
    directory, scene, entries = run
    rewrite(directory, [entries[0] | changes])
    with pytest.raises(ValueError, match=message):
        check_run(directory, scene)


def test_missing_steps_states_and_other_parameters_are_refused(run):
    directory, scene, _ = run
    other = with_values(scene, {"inflow.ramp": 0.13})
    with pytest.raises(ValueError, match=r"the run used inflow\.ramp = 0\.12 but the scene says 0\.13"):
        check_run(directory, other)
    directory, scene, entries = run
    rewrite(directory, [])
    with pytest.raises(ValueError, match=r"steps\.csv: no step is listed"):
        check_run(directory, scene)
    rewrite(directory, [{key: value for key, value in entries[0].items() if key not in ("k", "old")}])
    with pytest.raises(ValueError, match=r"steps\.csv is damaged: 'k'"):
        check_run(directory, scene)
    (directory / "steps.csv").unlink()
    with pytest.raises(ValueError, match=r"steps\.csv is missing or empty"):
        check_run(directory, scene)
    rewrite(directory, entries)
    (directory / entries[1]["old"]).unlink()
    with pytest.raises(FileNotFoundError, match=r"state-000003\.bin"):
        check_run(directory, scene)


@pytest.mark.parametrize(
    ("scheme", "theta"), [("backward-euler", 1.0), ("crank-nicolson", 0.5), ("shifted-crank-nicolson", 0.54)]
)
def test_theta_of_the_schemes(scheme, theta):
    changes = {"mesh_motion.kind": "harmonic", "time.step": 0.02, "time.end": 1.0, "time.shift": 2.0}
    scene = with_values(CASES["flap-svk"], changes | {"time.scheme": scheme})
    refuse_other_step(scene, Step(0.02, theta, 0.5), 25)
    with pytest.raises(ValueError, match=r"theta = .*, expected"):
        refuse_other_step(scene, Step(0.02, theta - 1e-6, 0.5), 25)


@pytest.mark.parametrize(("changes", "thetas"), [
    ({}, (1.0, 1.0, 0.52)), ({"inflow.ramp": 0.1}, (0.52, 0.52, 0.52)),
    ({"inflow.waveform": "sin(t)"}, (0.52, 0.52, 0.52)), ({"inflow.waveform": "cos(t)"}, (1.0, 1.0, 0.52)),
    ({"inflow.waveform": "1e-13 * cos(t)"}, (0.52, 0.52, 0.52)), ({"inflow.waveform": "mca"}, (1.0, 1.0, 0.52)),
    ({"inflow.mean_velocity": 0.0}, (1.0, 1.0, 0.52)),
], ids=str)  # fmt: skip
def test_first_steps_damp_a_jump_of_the_inflow(changes, thetas):
    in_time = {"mesh_motion.kind": "harmonic", "time.step": 0.02, "time.end": 1.0}
    scene = with_values(CASES["flap-svk"], in_time | changes)
    for number, theta in enumerate(thetas, start=1):
        refuse_other_step(scene, Step(0.02, theta, 0.02 * number), number)
        with pytest.raises(ValueError, match=r"theta = .*, expected"):
            refuse_other_step(scene, Step(0.02, 1.52 - theta, 0.02 * number), number)


def test_steps_that_are_none():
    changes = {"mesh_motion.kind": "harmonic", "time.scheme": "crank-nicolson", "time.step": 0.02, "time.end": 1.0}
    scene = with_values(CASES["flap-svk"], changes)
    refuse_other_step(scene, Step(0.02 * 1.0009, 0.5, 0.5), 25)
    with pytest.raises(ValueError, match=r"k = .*, at most 0.02 s"):
        refuse_other_step(scene, Step(0.02 * 1.0011, 0.5, 0.5), 25)
    with pytest.raises(ValueError, match="flap-svk: a time step, but the scene is steady"):
        refuse_other_step(CASES["flap-svk"], Step(0.1, 0.5, 0.5), 5)


WINDKESSEL = {
    "inflow.mean_velocity": 0.05, "solid.flap.lame_lambda": 800.0, "solid.flap.lame_mu": 200.0,
    "mesh_motion.kind": "harmonic", "time.step": 0.05, "time.end": 0.13, "outlet.kind": "windkessel",
    "outlet.pressure": 0.02, "outlet.proximal_resistance": 0.3, "outlet.distal_resistance": 1.1,
    "outlet.compliance": 0.04, "outlet.backflow": 0.5,
}  # fmt: skip


@pytest.fixture(scope="module")
def windkessel():
    """Scene without a ramp, its mesh, states, rows of the history and the entry of the last step."""
    scene = with_values(CASES["flap-svk"], WINDKESSEL)
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
def written(tmp_path, windkessel):
    """Function that writes the written folder with some changes and returns the checker's report."""
    scene, mesh, states, last, history, entry = windkessel

    def write(entry_changes=(), history_changes=(), row=0):
        write_state(tmp_path / "old.bin", states[-2])
        write_state(tmp_path / "new.bin", states[-1])
        write_run(tmp_path, mesh, states[-1], {"quantities": last})
        rewrite(tmp_path, [entry | dict(entry_changes)])
        rows = [dict(line) for line in history]
        rows[row] |= dict(history_changes)
        write_history(tmp_path, rows)
        return check_run(tmp_path, scene)

    return write


def test_a_run_with_a_windkessel_passes_and_other_reservoirs_are_seen(written, windkessel):
    report = written()
    assert report.failures == [] and report.outlet_difference < 1e-12
    entry, history = windkessel[-1], windkessel[-2]
    for name in ("windkessel_old", "windkessel_new"):
        assert failing(written({name: entry[name] * (1 + 1e-6)})) == {"outlet_difference"}
        assert failing(written({name: math.nan})) == {"outlet_difference"}
    # An earlier flow rate, and with it all reservoirs after it.
    changed = {"flow_rate_out": history[0]["flow_rate_out"] * 1.001}
    assert {"momentum", "outlet_difference"} <= failing(written(history_changes=changed))
    changed = {"outlet_pressure": history[2]["outlet_pressure"] * (1 + 1e-6)}
    assert failing(written(history_changes=changed, row=2)) == {"outlet_difference"}
    with pytest.raises(ValueError, match=r"history\.csv: no step 4, the last is 3"):
        written({"step": 4})
    with pytest.raises(ValueError, match=r"history\.csv: row 1: flow_rate_out = '' is no finite number"):
        written(history_changes={"flow_rate_out": ""})


TOLERANCE = 1e-6


@pytest.fixture
def ordinary(run, solved_run):
    """Function that makes some state the end of the ordinary step 2, reports what is true of it, and checks."""
    directory, scene, entries = run
    _, mesh, states, _, rows, _ = solved_run
    system = System.build(problem_from_scene(scene), mesh)

    def check(state, scene=scene, **changes):
        stepping = system.stepping(states[1], Step(0.05, 0.55, 0.1))
        write_state(directory / "state-000002.bin", state)
        told = [dict(row) for row in rows]
        told[1] = history_row(stepping.increment.step, stepping, state, rows[0])
        write_history(directory, told)
        quantities = quantities_of(stepping, state)
        forces = {name: quantities[name] for name in ("drag", "lift")}
        rewrite(directory, [entries[0] | {"tolerance": TOLERANCE, "quantities": forces} | changes, entries[1]])
        return check_run(directory, scene)

    return check, system.stepping(states[1], Step(0.05, 0.55, 0.1)), states[2]


def wrong_by(system, state, size, gravity=(0.0, 1e-3)):
    """The state on the way to that under other loads, off by the weighted ``size``; what is linear holds there."""
    other = dataclasses.replace(system, problem=dataclasses.replace(system.problem, gravity=gravity))
    step = system.increment
    away = moved(solve_step(other, step.old, step.step, tolerance=1e-9, start=state).state, state, -1.0)
    return moved(state, away, size / weighted(system, state, away))


def test_error_of_an_ordinary_step_is_found(ordinary):
    check, system, state = ordinary
    assert check(state).step_error == 0.0
    for size in (1e-7, 1e-6, 1e-5, 1e-3):
        wrong = wrong_by(system, state, size)
        assert Corrector().missing(system, wrong) == pytest.approx(size, rel=0.05)
    report = check(wrong_by(system, state, 3 * TOLERANCE))
    assert report.failures == [] and report.step_error == pytest.approx(3.0, rel=0.05)
    # Beside the step's own tolerance its residuals say nothing; those of the step to round-off do.
    assert report.momentum < 1e-8
    assert "momentum" in failing(check(wrong_by(system, state, 3 * TOLERANCE), tolerance=0.0))


def test_step_that_ends_too_early_or_with_a_wrong_sign_fails(ordinary, monkeypatch):
    check, system, state = ordinary
    report = check(wrong_by(system, state, 1e3 * TOLERANCE))
    assert failing(report) == {"step_error"} and f" in step 2 at 0.1 s, allowed is {ALLOWED:.0e}" in report.failures[0]
    assert failing(check(wrong_by(system, state, 1.1 * ALLOWED * TOLERANCE))) == {"step_error"}
    right = terms.fluid_step

    def wrong_sign(*arguments):
        found = right(*arguments)
        return found | {"convection": -found["convection"]}

    monkeypatch.setattr(terms, "fluid_step", wrong_sign)
    other = solve_step(system, system.increment.old, system.increment.step, tolerance=1e-9).state
    monkeypatch.undo()
    assert failing(check(other)) == {"step_error"}


def test_lies_about_a_step_are_seen_and_factors_kept(ordinary):
    check, system, state = ordinary
    wrong = RawState(state.u, state.v.copy(), state.p)
    wrong.v[np.flatnonzero(system.rows.v_given)[3]] += 1e-3
    assert "dirichlet" in failing(check(wrong))
    assert "drag_difference" in failing(check(state, quantities={"drag": 1.0, "lift": 1.0}))
    _, system, state = ordinary
    far = RawState(state.u.copy(), state.v, state.p)
    far.u[np.flatnonzero(system.rows.mesh_motion)[:40:3]] += 10.0
    assert not Corrector().missing(system, far) <= 1e-2
    undefined = RawState(state.u, np.where(state.v == state.v.max(), np.nan, state.v), state.p)
    assert not Corrector().missing(system, undefined) <= 1e-2
    corrector = Corrector()
    assert corrector.missing(system, wrong_by(system, state, 1e-4)) == pytest.approx(1e-4, rel=0.05)
    kept = corrector._factors
    assert corrector.missing(system, wrong_by(system, state, 1e-5, (2e-3, 0.0))) == pytest.approx(1e-5, rel=0.05)
    assert corrector._factors is kept
    # Those of another step leave much of the error: new ones are made.
    short = system.stepping(system.increment.old, Step(1e-4, 0.5, 0.0501))
    near = solve_step(short, system.increment.old, short.increment.step, tolerance=1e-10).state
    assert corrector.missing(short, wrong_by(short, near, 1e-5)) == pytest.approx(1e-5, rel=0.05)
    assert corrector._factors is not kept


@pytest.mark.parametrize("tolerance", [6e-5, -1e-6, math.nan, "loose", None])
def test_tolerance_that_the_scene_does_not_have_is_refused(ordinary, tolerance):
    check, _, state = ordinary
    with pytest.raises(ValueError, match=r"steps\.csv|step 2 was solved to 6e-05, solver\.step_tolerance is 3e-05"):
        check(state, tolerance=tolerance)


def test_last_step_must_be_solved_to_round_off(run):
    directory, scene, entries = run
    rewrite(directory, [entries[0], entries[1] | {"tolerance": TOLERANCE}])
    with pytest.raises(ValueError, match=r"steps\.csv: the last step, 4, was not solved to round-off"):
        check_run(directory, scene)
