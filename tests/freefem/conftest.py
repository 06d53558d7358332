"""Runs that several tests share: every scene is solved once per session, by whichever of its processes needs it."""

import fcntl
import functools
import hashlib
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from ffsi.freefem import find_freefem, run_script
from ffsi.hemodynamics.result import Result, load_result
from ffsi.run import execute
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, load_scene
from ffsi.script.render import render

# A shell that starts the tests in the background ignores SIGINT, and so would the processes that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Parts of tests' names, as `pytest -v` prints them: variations of what a shorter test covers. `make verify` runs them.
LONG = (
    "test_aneurysm.py::test_a_cycle_is_the_trapezoidal_sum_over_its_states[newtonian]",
    "test_aneurysm.py::test_the_sums_survive_a_kill", "test_blood.py::test_a_damped_support_slows_the_roof",
    "test_blood.py::test_against_backflow_the_reversed_flow_stays_bounded",
    "test_blood.py::test_an_oscillating_channel_flow_is_womersleys",
    "test_blood.py::test_both_solvers_of_a_step_find_the_same_with_a_support",
    "test_channel.py::test_a_pulsating_flow_is_periodic_by_the_drag",
    "test_direct.py::test_a_folder_of_another_script_is_refused",
    *(f"test_direct.py::test_the_same_numbers_as_through_python[{case}" for case in ("flap", "aneurysm-", "cantilever",
        "turek-c")),
    *(f"test_failures.py::test_a_killed_sweep_keeps_its_points_and_goes_on[{name}]" for name in ("SIGINT", "SIGTERM")),
    "test_errors.py::test_bars_cover_the_difference_to_a_finer_mesh[cook",
    "test_errors.py::test_the_chain_goes_on_from_the_coarse_mesh", "test_new_geometry.py::test_mistakes_are_caught",
    "test_new_outlet.py::test_a_steady_flow_has_its_resistance_alone",
    "test_new_outlet.py::test_a_wrong_sign_is_caught[signs1]", "test_new_outlet.py::test_it_goes_in_time[cylinder-2d2]",
    "test_newton.py::test_steps_with_a_too_small_jacobian_are_refused", "test_remote.py",
    "test_rest_and_scales.py::test_a_pressure_of_any_height_behind_the_outlet_changes_no_velocity[windkessel-time1]",
    *(f"test_sensitivities.py::test_they_are_those_of_differences_of_solutions[{case}" for case in ("aneurysm",
        "flap", "turek-c", "cantilever", "cavity")),
    "test_step_solvers.py::test_an_inflow_that_passes_through_zero_is_checked_and_its_next_period_predicted[sin(pi",
    "test_step_solvers.py::test_both_solvers_give_the_same_history[mixed]",
    "test_step_solvers.py::test_a_finished_run_goes_on_to_a_later_end[without one]",
    "test_step_solvers.py::test_a_far_too_large_step_becomes_a_smaller_one",
    "test_step_solvers.py::test_a_far_too_strong_load_fails_with_the_last_good_state[inflow]",
    "test_step_solvers.py::test_steps_follow_the_accepted_error_and_hit_the_outputs",
    "test_step_solvers.py::test_the_energy_of_a_flow_around_a_beam",
    "test_sweep.py::test_a_collapsed_solid_is_named_with_its_place",
    "test_sweep.py::test_points_that_failed_are_not_tried_again",
    "test_sweep.py::test_what_was_solved_before_the_collapse_is_kept",
    *(f"test_unsteady.py::test_a_script_killed_at_any_moment_comes_to_the_same_when_it_goes_on[{i}]" for i in range(1,
        5)),
    "test_unsteady.py::test_killed_twice",
    *(f"test_viscosity_laws.py::test_in_time_with_an_elastic_body[{law}]" for law in ("casson", "power-law")),
)  # fmt: skip


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if any(part in item.nodeid for part in LONG):
            item.add_marker(pytest.mark.long)


PLAIN = ("output.pictures=false", "output.vtu=false")


def scene_of(case: str, *settings: str) -> Scene:
    """Return a catalogue case with level 0 and no pictures, unless the settings say otherwise."""
    return load_scene(case, ["mesh.level=0", *PLAIN, *settings])


installation = pytest.fixture(lambda: find_freefem(), scope="session")


@pytest.fixture(scope="session")
def solved(tmp_path_factory) -> Callable[..., Result]:
    """Solve a case through Python, or return the result of the same call before; nobody may change its folder."""
    base = tmp_path_factory.getbasetemp()
    shared = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "solved"
    shared.mkdir(exist_ok=True)

    @functools.cache
    def solved(case: str, *settings: str) -> Result:
        run = shared / hashlib.sha256(repr((case, settings)).encode()).hexdigest()[:16]
        with run.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return load_result(run) if (run / "result.json").is_file() else solve(scene_of(case, *settings), run)

    return solved


@pytest.fixture
def broken_script(monkeypatch) -> Callable[[str, str], None]:
    """Let every run of a test have a text in its script replaced, which must be there."""

    def break_it(right: str, wrong: str) -> None:
        def broken(*arguments, **options):
            text = render(*arguments, **options)
            assert right in text, "the templates have changed: adapt this mutation"
            return text.replace(right, wrong)

        monkeypatch.setattr(execute, "render", broken)

    return break_it


@pytest.fixture
def run_text(installation, tmp_path) -> Callable[..., Path]:
    """Run the text of a script into a folder of its own; return the folder, and how it ended."""

    def run_text(text: str, **arguments: object):
        script = tmp_path / "case.edp"
        script.write_text(text, encoding="utf-8")
        out = tmp_path / "out"
        out.mkdir()
        return out, run_script(
            script, {"out": out, **arguments}, installation=installation, log=tmp_path / "log", cwd=tmp_path,
            time_limit=60,
        )  # fmt: skip

    return run_text
