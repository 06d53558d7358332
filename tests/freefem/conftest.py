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
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, load_scene

# A shell that starts the tests in the background ignores SIGINT, and so would the processes that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

PLAIN = ("output.pictures=false", "output.vtu=false")


def scene_of(case: str, *settings: str) -> Scene:
    """Return a catalogue case with level 0 and no pictures, unless the settings say otherwise."""
    return load_scene(case, ["mesh.level=0", *PLAIN, *settings])


@pytest.fixture(scope="session")
def installation():
    return find_freefem()


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
def run_text(installation, tmp_path) -> Callable[..., Path]:
    """Run the text of a script into a folder of its own; return the folder, and how it ended."""

    def run_text(text: str, **arguments: object):
        script = tmp_path / "case.edp"
        script.write_text(text, encoding="utf-8")
        out = tmp_path / "out"
        out.mkdir()
        return out, run_script(
            script,
            {"out": out, **arguments},
            installation=installation,
            log=tmp_path / "log",
            cwd=tmp_path,
            time_limit=60,
        )

    return run_text
