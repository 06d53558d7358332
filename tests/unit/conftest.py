"""Stand-ins for FreeFEM and for the checker, shared by the tests of run, study and command line."""

import math
import signal
from types import SimpleNamespace

import pytest
from run_folders import FakeCheck, FakeFreeFEM
from time_folders import FakeTimeFreeFEM

from ffsi import run, study, unsteady
from ffsi.bench import unsteady as bench_unsteady
from ffsi.verification import periodic_runs

# A shell that starts the tests in the background ignores SIGINT, and so would the processes that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def freefem(monkeypatch) -> FakeFreeFEM:
    fake = FakeFreeFEM()
    monkeypatch.setattr(run, "run_script", fake.run_script)
    for module in (run, study):
        monkeypatch.setattr(module, "find_freefem", lambda: SimpleNamespace(has_mumps=True))
    monkeypatch.setattr(run, "render", lambda scene, mumps: f"// {scene.name}, MUMPS {mumps}\n")
    return fake


@pytest.fixture
def in_time(monkeypatch) -> FakeTimeFreeFEM:
    fake = FakeTimeFreeFEM()
    monkeypatch.setattr(run, "run_script", fake.run_script)
    for module in (run, study, periodic_runs, bench_unsteady):
        monkeypatch.setattr(module, "find_freefem", lambda: SimpleNamespace(has_mumps=True))
    for module in (run, periodic_runs, bench_unsteady):
        monkeypatch.setattr(module, "render", lambda scene, mumps: f"// {scene.name}, MUMPS {mumps}\n")
    monkeypatch.setattr(unsteady, "LOOK_EVERY", 0.0)
    monkeypatch.setattr(unsteady, "SHARE", math.inf)
    return fake


@pytest.fixture
def check(monkeypatch) -> FakeCheck:
    fake = FakeCheck()
    monkeypatch.setattr("ffsi.reference.check_run", fake)
    return fake
