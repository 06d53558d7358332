"""Pieces of a study on other machines: what goes there and what comes back travels through the executor."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from pathlib import Path
from typing import Any

import tomli_w

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.run.pieces import run_piece
from ffsi.run.plan import Piece
from ffsi.scene import Scene, load_scene, stored
from ffsi.script.render import package_version

_LOST: tuple[type[BaseException], ...] = (BrokenExecutor, CancelledError)
"""What an executor raises for a piece whose worker has died, when it has no other worker."""


def lost(error: BaseException) -> bool:
    """Tell whether an error means that a worker died, or several one after the other at the same piece (of Dask)."""
    return isinstance(error, _LOST) or type(error).__name__ == "KilledWorker"


def executor_of(executor: Any, dask: Any) -> Executor | None:
    """Return where pieces run; None for this machine.

    Raises:
        InputError: both are given, or one that is none.
    """
    if executor is not None and dask is not None:
        raise InputError("give either executor or dask, not both")
    if dask is not None:
        return _of_dask(dask)
    usable = not isinstance(executor, type) and all(hasattr(executor, name) for name in ("submit", "shutdown"))
    if executor is not None and not usable:
        raise InputError(f"executor = {executor!r}: accepted: a concurrent.futures.Executor")
    found: Executor | None = executor
    return found


def _of_dask(given: Any) -> Executor:
    try:
        from distributed import Client as Scheduler
    except ImportError as error:
        raise InputError("--dask needs the package distributed: pip install distributed") from error
    Client: Any = Scheduler  # it has no types
    if not isinstance(given, str | Client):
        raise InputError(f"dask = {given!r}: accepted: a distributed.Client or the address of a scheduler")
    try:
        client = given if isinstance(given, Client) else Client(given, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"no dask scheduler at {given}: {error}") from error
    pool: Executor = client.get_executor(pure=False)
    return pool


def workers_of(pool: Executor) -> int:
    """Return how many pieces an executor runs at a time, as far as it says so."""
    if (client := getattr(pool, "_client", None)) is not None:
        return max(1, int(sum(client.nthreads().values())))
    return int(getattr(pool, "_max_workers", None) or os.cpu_count() or 1)


def task(scene: Scene, piece: Piece, check: bool, draw: bool, leads: int, asked: Sequence[str]) -> dict[str, Any]:
    """Return what a worker needs to solve a piece, as plain data."""
    with tempfile.TemporaryDirectory(prefix="ffsi-task-") as name:
        text = tomli_w.dumps(stored(scene, Path(name)).given())  # what follows from other values follows there, too
        files = {path.name: path.read_bytes() for path in Path(name).iterdir()}
    return {
        "version": package_version(), "scene": text, "files": files, "piece": [dict(p) for p in piece], "check": check,
        "draw": draw, "leads": leads, "asked": list(asked),
    }  # fmt: skip


def work(task: Mapping[str, Any]) -> list[dict[str, bytes]]:
    """Solve a piece in a temporary folder; return the files of its chains.

    Raises:
        InputError: the worker has another version of ffsi.
        FreeFEMNotFound: it has no FreeFEM.
    """
    if task["version"] != package_version():
        raise InputError(f"a worker has ffsi {package_version()}, the study needs {task['version']}")
    with tempfile.TemporaryDirectory(prefix="ffsi-piece-") as name:
        source = Path(name, "source")
        source.mkdir()
        for file, data in task["files"].items():
            (source / file).write_bytes(data)
        folder.write_text(source / folder.SCENE, task["scene"])
        chains: list[Path] = []

        def new_folder() -> Path:
            chains.append(Path(name, f"chain-{len(chains) + 1:03d}"))
            chains[-1].mkdir()
            return chains[-1]

        scene = load_scene(source / folder.SCENE)
        asked = {name: task[name] for name in ("check", "draw", "leads", "asked")}
        run_piece(scene, task["piece"], new_folder, **asked)
        return [{path.name: path.read_bytes() for path in chain.iterdir() if path.is_file()} for chain in chains]
