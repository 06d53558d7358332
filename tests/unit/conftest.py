"""Stand-ins for FreeFEM and for the checker, shared by the tests of run, study and command line."""

import math
import signal
from types import SimpleNamespace
from typing import Any

import pytest
from run_folders import FakeCheck, FakeFreeFEM, given_state, structured_mesh
from time_folders import FakeTimeFreeFEM

from ffsi.freefem import FreeFEMNotFound
from ffsi.report import runs
from ffsi.report.blocks import Picture
from ffsi.result.fields import Fields
from ffsi.run import chain, execute, longer, meshing, one_scene, sweep, watch
from studies import harness
from studies.bench import unsteady as bench_unsteady

# A shell that starts the tests in the background ignores SIGINT, and so would the processes that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def put_in_place(monkeypatch, fake: Any) -> Any:
    """Let a stand-in be what starts scripts, which are none, wherever a FreeFEM is looked for."""
    monkeypatch.setattr(execute, "run_script", fake.run_script)
    for module in (one_scene, longer, chain, sweep, harness, bench_unsteady):
        monkeypatch.setattr(module, "find_freefem", lambda: SimpleNamespace(has_mumps=True))
    for module in (execute, longer, harness, bench_unsteady):
        monkeypatch.setattr(module, "render", lambda scene, mumps: f"// {scene.name}, MUMPS {mumps}\n")
    return fake


@pytest.fixture
def freefem(monkeypatch) -> FakeFreeFEM:
    return put_in_place(monkeypatch, FakeFreeFEM())


@pytest.fixture
def in_time(monkeypatch) -> FakeTimeFreeFEM:
    monkeypatch.setattr(watch, "LOOK_EVERY", 0.0)
    monkeypatch.setattr(watch, "SHARE", math.inf)
    return put_in_place(monkeypatch, FakeTimeFreeFEM())


@pytest.fixture
def unwatched(in_time, monkeypatch) -> None:
    """No looks at the progress of the stand-in: they cost more than all the rest."""
    monkeypatch.setattr(watch, "LOOK_EVERY", math.inf)


@pytest.fixture
def no_freefem(monkeypatch) -> None:
    def missing() -> None:
        raise FreeFEMNotFound("missing-binary", "no FreeFem++ on this machine")

    for module in (one_scene, meshing):
        monkeypatch.setattr(module, "find_freefem", missing)


@pytest.fixture
def check(monkeypatch) -> FakeCheck:
    fake = FakeCheck()
    monkeypatch.setattr("ffsi.reference.check_run", fake)
    return fake


@pytest.fixture
def fields() -> Fields:
    mesh = structured_mesh()
    return Fields.from_raw(mesh, given_state(mesh))


@pytest.fixture
def quick(monkeypatch) -> None:
    """Draw, but make no files of a report's pictures: that takes most of the time."""
    monkeypatch.setattr(runs, "FRAME_DPI", 30)
    monkeypatch.setattr(Picture, "of", classmethod(lambda cls, figure, caption, maximum: cls(b"png", caption)))


@pytest.fixture
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")
