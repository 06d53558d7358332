"""Names and upkeep of a run folder (see docs/formats.md): what is ours, and files that are either whole or absent."""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ffsi.files import machine, reading
from ffsi.files.errors import InputError as InputError
from ffsi.text import cut, listed, nearest

SCRIPT = "case.edp"
SCENE = "scene.toml"
LOG = "freefem.log"
RESULT = "result.json"
CHAIN = "chain.json"
POINTS = "points.txt"
HISTORY = "newton.csv"
MESH = "mesh.bin"
MESH_INPUT = "geometry.mesh"
SWEEP = "sweep.toml"
POINT = "point.json"
STATE = "point.bin"
SENSITIVITIES = "sensitivities.json"
ERRORS = "errors.json"
ADAPTATION = "adaptation.json"
FAILED = "failed.json"
FAILED_STATE = "failed.bin"
# Of a run in time.
TIME_HISTORY = "history.csv"
STEPS = "steps.csv"
STATES = "state-*.bin"
CHECKPOINTS = ("checkpoint-a.bin", "checkpoint-b.bin")
MANIFEST = "manifest.json"
STOP = "stop"
GO_ON, STOP_PERIODIC = "0\n", "1 periodic\n"  # what it holds
WALL = "wall.csv"
WALL_CYCLES = "wall-*.bin"
SERIES = "fields.pvd"
LOGS = "freefem-*.log"
EARLIER = "scene-until-*.toml"  # that of a run which was changed, up to a step
IN_TIME = (EARLIER, TIME_HISTORY, STEPS, STATES, WALL_CYCLES, *CHECKPOINTS, MANIFEST)
# What a run starts from.
INITIAL = ("initial.mesh", "initial-mesh.bin", "initial-state.bin")
DEFINITION = (SCRIPT, SCENE, CHAIN, POINTS, MESH_INPUT, *INITIAL)
# What is read later, beside the files of single points.
BELIEVED = (*DEFINITION, MESH, HISTORY, TIME_HISTORY, STEPS, STATES, WALL_CYCLES, *CHECKPOINTS, STOP, EARLIER)
PICTURES = ("velocity", "pressure", "displacement")

# Bytes: what the system holds, less the longest name of a file in the folder.
_LONGEST_PATH, _LONGEST_NAME = 4000, 255

_OURS = (
    *(*DEFINITION, LOG, RESULT, "result-*.json", HISTORY, MESH, FAILED, FAILED_STATE, *IN_TIME, STOP, SERIES, LOGS),
    *("point-*.json", "point-*.bin", "sensitivities-*.json", "errors-*.json", "adaptation-*.json"),
    *(WALL, "wall-????.csv", "fields*.vtu"),
    *(f"{name}{ending}" for name in PICTURES for ending in ("*.png", ".gif")),
    ".*.part",  # what a kill left
)


def numbered(name: str, point: int) -> str:
    """Return `result-0007.json` for `result.json` and point 7."""
    stem, dot, ending = name.partition(".")
    return f"{stem}-{point:04d}{dot}{ending}"


def point_files(point: int, *, solved: bool) -> tuple[str, ...]:
    """Return the names of the files that the script writes of one point, or of its failure."""
    of_solved = (POINT, STATE, SENSITIVITIES, ERRORS, ADAPTATION)
    return tuple(numbered(name, point) for name in of_solved) if solved else (FAILED, FAILED_STATE)


def is_run_folder(directory: Path) -> bool:
    """Tell whether `directory` holds a run that ffsi has started, or has made a run folder of."""
    return (directory / SCENE).is_file() and any((directory / name).is_file() for name in (SCRIPT, RESULT, CHAIN))


def is_sweep_folder(directory: Path) -> bool:
    """Tell whether `directory` holds a sweep."""
    return (directory / SWEEP).is_file()


def missing(directory: Path) -> str:
    """Return the words for a folder that is not there, with the most similar name beside it."""
    beside = sorted(path.name for path in directory.parent.glob("*/")) if directory.parent.is_dir() else []
    guess = nearest(directory.name, beside)
    return " (it does not exist" + (f'; did you mean "{cut(directory.parent / guess)}"?)' if guess else ")")


def no_run_folder(directory: Path) -> str:
    """Return the words for what is no run folder, with those that it holds, or the most similar name beside it."""
    if not directory.exists():
        return f"{directory} is no run folder of ffsi{missing(directory)}"
    inside = sorted(path for path in directory.glob("*/") if is_run_folder(path) or is_sweep_folder(path))
    return f"{directory} is no run folder of ffsi" + (f"; it holds {listed(inside)}" if inside else "")


def check_usable(directory: Path) -> None:
    """Raise InputError for a folder that a run must not write into; writes nothing.

    That is a file, a sweep, a non-empty folder that is no run folder of ours, one that nobody may write into or with
    too long a name, and one with a file that is a link, through which something else would be overwritten.
    """
    check_writable(directory)
    if not directory.exists():
        return
    if not directory.is_dir():
        raise InputError(f"{directory} is a file; the results need a folder")
    if is_sweep_folder(directory):
        raise InputError(f"{directory} holds a sweep; give another folder for a single run")
    if any(directory.iterdir()) and not is_run_folder(directory):
        raise InputError(
            f"{directory} is not empty and is no run folder of ffsi; nothing was written. Give another folder"
        )
    refuse_links(directory, _OURS)


def refuse_links(directory: Path, patterns: Sequence[str]) -> None:
    """Raise InputError for a folder in which a name that matches one of the patterns is a symbolic link."""
    for path in directory.iterdir():
        if path.is_symlink() and any(path.match(pattern) for pattern in patterns):
            raise InputError(f"{path} is a symbolic link; ffsi writes through none. Remove it, or give another folder")


def check_writable(directory: Path) -> None:
    """Raise InputError for a folder with too long a name, or where nobody may write; writes nothing."""
    whole = directory.absolute()
    if len(os.fsencode(whole)) > _LONGEST_PATH or any(len(os.fsencode(part)) > _LONGEST_NAME for part in whole.parts):
        raise InputError(
            f"{cut(directory)}: the path is too long, at most {_LONGEST_PATH} bytes with {_LONGEST_NAME} in each name"
        )
    there = next(path for path in (whole, *whole.parents) if path.exists())
    if there.is_dir() and not os.access(there, os.W_OK | os.X_OK):
        raise InputError(f"{directory} cannot be written: {there} is read-only for you")
    if not there.is_dir() and there != whole:
        raise InputError(f"{directory} cannot be made: {there} is a file")


def prepare(directory: Path) -> None:
    """Create `directory`, or empty it of an earlier run's files (other files stay); raises as `check_usable`."""
    check_usable(directory)
    make(directory)
    clear(directory)


def make(directory: Path) -> None:
    """Make a folder if need be; raises InputError where the system makes none, as in /proc."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        if machine.ended(error):
            raise
        raise InputError(f"{directory} cannot be made: {error.strerror}") from error


def clear(directory: Path, keep: Sequence[str] = ()) -> None:
    """Remove a run's files but those whose names match one of the patterns `keep`; other files stay."""
    for pattern in _OURS:
        for path in directory.glob(pattern):
            if not any(path.match(kept) for kept in keep):
                path.unlink()


def keep_log(directory: Path) -> None:
    """Give the log of a process that has ended a number: the next process writes a new one."""
    log = directory / LOG
    if log.is_file():
        number = sum(1 for _ in directory.glob(LOGS)) + 1
        log.replace(directory / numbered(LOG, number))


@contextlib.contextmanager
def held(directory: Path, check: Callable[[Path], None] = check_usable) -> Iterator[None]:
    """Make a folder if need be, and keep other calls of ffsi out of it while this one works there.

    The lock is the kernel's and ends with its process, so there are no stale ones. `check` refuses a folder that cannot
    be used, before anything is made. Raises InputError as it does, or if another one is at work there.
    """
    check(directory)
    make(directory)
    handle = os.open(directory, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"another ffsi is at work in {directory}; wait for its end, or give another folder"
            ) from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(handle)


def is_held(directory: Path) -> bool:
    """Tell whether another call of ffsi is at work in a run folder."""
    try:
        with held(directory):
            return False
    except InputError:
        return True


def write_text(path: Path, text: str) -> None:
    """Write `text` so that `path` holds either all of it or what it held before."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` as `write_text` does."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as error:
        error.filename = str(path)  # a write that fails does not name its file
        del error.filename2
        with contextlib.suppress(OSError):
            partial.unlink()  # on a full disk it only takes room
        raise


def to_json(data: Any) -> str:
    """Return strict JSON: numbers that are not finite become null."""
    return json.dumps(_plain(data), indent=2, allow_nan=False) + "\n"


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write `data` as JSON, atomically."""
    write_text(path, to_json(data))


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object. Raises InputError if the file is missing, damaged or holds no object."""
    try:
        data = reading.read_json(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path} holds no JSON object")
    return data


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "item"):  # numpy scalar
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
