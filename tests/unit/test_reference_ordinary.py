"""Ordinary time steps, which were solved to their tolerance: what they lack is measured, not their residuals."""

import dataclasses
import math

import numpy as np
import pytest
from test_reference_check import failing
from test_reference_step import history_row, quantities_of, write_history
from test_reference_step_runs import rewrite, run, solved_run  # noqa: F401

from ffsi.files.arrays import RawState, write_state
from ffsi.reference import terms
from ffsi.reference.check import check_run
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.ordinary import ALLOWED, Corrector, weighted
from ffsi.reference.solve import moved, solve_step
from ffsi.reference.step import Step
from ffsi.reference.system import System

TOLERANCE = 1e-6


@pytest.fixture
def ordinary(run, solved_run):  # noqa: F811
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


def test_last_step_must_be_solved_to_round_off(run):  # noqa: F811
    directory, scene, entries = run
    rewrite(directory, [entries[0], entries[1] | {"tolerance": TOLERANCE}])
    with pytest.raises(ValueError, match=r"steps\.csv: the last step, 4, was not solved to round-off"):
        check_run(directory, scene)
