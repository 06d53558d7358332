"""Stand-ins for FreeFEM and for the checker, shared by the tests of run, study and command line."""

from types import SimpleNamespace

import pytest
from run_folders import FakeCheck, FakeFreeFEM

from ffsi import run, study


@pytest.fixture
def freefem(monkeypatch) -> FakeFreeFEM:
    fake = FakeFreeFEM()
    monkeypatch.setattr(run, "run_script", fake.run_script)
    for module in (run, study):
        monkeypatch.setattr(module, "find_freefem", lambda: SimpleNamespace(has_mumps=True))
    monkeypatch.setattr(run, "render", lambda scene, mumps: f"// {scene.name}, MUMPS {mumps}\n")
    return fake


@pytest.fixture
def check(monkeypatch) -> FakeCheck:
    fake = FakeCheck()
    monkeypatch.setattr("ffsi.reference.check_run", fake)
    return fake
