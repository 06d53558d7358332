"""Run folders with checked time steps."""

import json
import math

import pandas as pd
import pytest
from test_reference_check import copy, failing, largest, scene_mesh
from test_reference_step import history_row, quantities_of, rest, write_history

from ffsi.files.arrays import write_mesh, write_state
from ffsi.reference.check import check_run
from ffsi.reference.from_scene import problem_from_scene, refuse_other_step
from ffsi.reference.solve import solve_step
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
    write_mesh(tmp_path / "mesh.bin", mesh)
    for number, state in enumerate(states[1:], start=1):
        write_state(tmp_path / f"state-{number:06d}.bin", state)
    values = {key: value for key, value in CHANGES.items() if not isinstance(value, str)}
    write_state(tmp_path / "point-0001.bin", states[-1])
    (tmp_path / "point-0001.json").write_text(json.dumps({"parameters": values, "quantities": last}))
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
    write_mesh(tmp_path / "mesh.bin", mesh)
    for name in ("old.bin", "new.bin", "point-0001.bin"):
        write_state(tmp_path / name, state)
    quantities |= {"min_jacobian_flap_x": float(x), "min_jacobian_flap_y": float(y)}
    (tmp_path / "point-0001.json").write_text(json.dumps({"quantities": quantities}))
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
    (dict(k=0.051, theta=0.551), r"k = 0\.051 s, at most 0\.05 s"),
    (dict(theta=0.5), r"theta = 0\.5, expected 0\.55"),
    (dict(theta=1.0), r"theta = 1\.0, expected 0\.55"),
    (dict(time=0.04), r"its start is at -0\.01\d* s"),
    (dict(time=0.19), r"its end is at 0\.19 s, the last at 0\.18 s"),
    (dict(k=0.0), "no time step: k = 0.0 s"),
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
    ({}, (1.0, 1.0, 0.52)),
    ({"inflow.ramp": 0.1}, (0.52, 0.52, 0.52)),
    ({"inflow.waveform": "sin(t)"}, (0.52, 0.52, 0.52)),
    ({"inflow.waveform": "cos(t)"}, (1.0, 1.0, 0.52)),
    ({"inflow.waveform": "1e-13 * cos(t)"}, (0.52, 0.52, 0.52)),
    ({"inflow.waveform": "mca"}, (1.0, 1.0, 0.52)),
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
