"""Run one script with FreeFEM: start it, stream its output, enforce the time limit, explain its end."""

import contextlib
import errno
import logging
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from ffsi.freefem.child import Child
from ffsi.freefem.errors import Ending, FreeFEMError, explain
from ffsi.freefem.events import Event
from ffsi.freefem.installation import Installation, find_freefem
from ffsi.freefem.output import Output

logger = logging.getLogger(__name__)

Argument = str | int | float | os.PathLike[str]

FULL_DISK = 256 * 1024
"""Bytes: a run folder with less free space than this is taken as full, for FreeFEM does not report failed writes."""

LONGEST_PATH = 900
"""Bytes of a path (or another argument); FreeFEM 4.11 puts names together in 1024."""

_running: set[Child] = set()
_running_lock = threading.Lock()


@dataclass(frozen=True)
class Completed:
    """A run that reached its end marker.

    `status` is `converged` or `failed`; `reason` the text of the last `@ffsi failed` line, `warnings` the texts of all
    warnings, `points` the status of each finished point of a sweep by its number. `seconds` is wall time,
    `peak_memory` in bytes (0: unknown).
    """

    status: str
    exit_code: int
    seconds: float
    reason: str
    warnings: tuple[str, ...]
    points: dict[int, str]
    peak_memory: int
    log: Path | None


def run_script(
    script: str | os.PathLike[str],
    arguments: Mapping[str, Argument] | None = None,
    *,
    installation: Installation | None = None,
    log: str | os.PathLike[str] | None = None,
    cwd: str | os.PathLike[str] | None = None,
    on_event: Callable[[Event], None] | None = None,
    time_limit: float | None = None,
) -> Completed:
    """Run `script` with `-NAME VALUE` for each of `arguments` and wait for its end.

    Output goes line by line into the file `log`; its `@ffsi` lines are handed to `on_event` as Event objects, in this
    thread. `time_limit` is in seconds of wall time. `cwd` is the folder to run in, the present one without it; the
    script and the arguments that are paths below it are handed over relative to it, for FreeFEM holds no path of more
    than 1000 characters and writes beyond its memory. Whatever ends this function early (an exception of `on_event`,
    Ctrl-C, SIGTERM) kills the process and its children too.

    Raises FreeFEMError (with the kind of failure) when the script did not write its end marker or when its disk is
    full, FreeFEMNotFound without a FreeFEM, FileNotFoundError without the script or the folder `cwd`, and ValueError
    for an argument that cannot be passed on.
    """
    script = Path(script).absolute()
    folder = Path.cwd() if cwd is None else Path(cwd)
    if not script.is_file():
        raise FileNotFoundError(errno.ENOENT, "no such script", str(script))
    if not folder.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder to run in", str(folder))
    given = dict(arguments or {})
    flags = command_line({name: _seen_from(folder, value) for name, value in given.items()})
    used = installation or find_freefem()
    log_path = None if log is None else Path(log)
    with Output(log_path, on_event) as output, _disk_full_as_error(log_path):
        command = [str(used.binary), "-nw", "-ns", "-v", "0", str(_seen_from(folder, script)), *flags]
        if long := [word for word in command if len(os.fsencode(word)) > LONGEST_PATH]:
            raise ValueError(f"{long[0]} is longer than the {LONGEST_PATH} bytes that FreeFEM holds")
        child = _watch(command, used.environment(), folder, output, time_limit)
        output.finish()
    folders = [folder / str(given.get("out", ".")), *([log_path.parent] if log_path else [])]
    return _conclude(child, output, script, folders)


def _seen_from(folder: Path, value: Argument) -> Argument:
    """Return an absolute path below a folder relative to it, anything else as it is."""
    if not isinstance(value, (str, os.PathLike)) or not Path(value).is_absolute():
        return value
    absolute = folder.absolute()
    return str(Path(value).relative_to(absolute)) if Path(value).is_relative_to(absolute) else str(value)


def command_line(arguments: Mapping[str, Argument]) -> list[str]:
    """The flags `-NAME VALUE ...`; floats keep all their digits.

    Raises ValueError for an empty or blank name, an empty value, and a number that is not finite.
    """
    flags: list[str] = []
    for name, value in arguments.items():
        if not name or name.startswith("-") or any(character.isspace() for character in name):
            raise ValueError(f"{name!r} is no name of a script parameter")
        if isinstance(value, bool):
            text = str(int(value))
        elif isinstance(value, float):
            if not math.isfinite(value):
                raise ValueError(f"{name} = {value} is not finite")
            text = repr(float(value))
        else:
            text = str(value)
        if not text:
            raise ValueError(f"{name} has an empty value")
        flags += [f"-{name}", text]
    return flags


def stop_all() -> int:
    """Kill every FreeFEM that this Python process is running, from any thread; returns how many.

    The `run_script` calls concerned raise FreeFEMError, kind `killed`. For programs that run cases in threads and
    have to end early: a Ctrl-C only reaches the main thread.
    """
    with _running_lock:
        children = list(_running)
    for child in children:
        child.kill()
    return len(children)


def _watch(
    command: list[str], environment: dict[str, str], folder: Path, output: Output, time_limit: float | None
) -> Child:
    """Run the command to its end; the child returned has been reaped and its process group is gone."""
    deadline = math.inf if time_limit is None else time.monotonic() + time_limit
    with _sigterm_as_exit():
        child = _start(command, environment, folder)
        try:
            with _running_lock:
                _running.add(child)
            logger.debug("started process %d: %s", child.pid, " ".join(command))
            for chunk in child.read(deadline):
                output.feed(chunk)
        except TimeoutError:
            where = f"; last progress: {output.last}" if output.last else ""
            message = f"stopped after the time limit of {time_limit:g} s{where}"
            raise FreeFEMError("time-limit", message, log=output.path) from None
        finally:
            child.close()
            with _running_lock:
                _running.discard(child)
    return child


def _start(command: list[str], environment: dict[str, str], folder: Path) -> Child:
    try:
        return Child(command, environment, folder)
    except OSError as error:
        if error.errno not in (errno.ENOENT, errno.EACCES, errno.ENOEXEC):
            raise
        raise FreeFEMError("missing-binary", f"{command[0]} cannot be started: {error.strerror}") from error


def _conclude(child: Child, output: Output, script: Path, folders: list[Path]) -> Completed:
    full = next((folder for folder in folders if is_full(folder)), None)
    if full is not None:
        message = f"the disk of {full} is full; what the script wrote there may be cut off"
        raise FreeFEMError("disk-full", message, log=output.path)
    ending = Ending(
        child.exit_code, output.tail, output.bad_input, output.failed, child.memory_evidence, child.limit_evidence
    )
    marker = output.end_status
    if marker is None or (ending.signal == 0 and child.exit_code not in (0, 3)):
        raise explain(ending, script, output.path)
    warnings = list(output.warnings)
    if ending.signal:
        warnings.append(f"FreeFEM crashed while it shut down, after its end marker (signal {ending.signal})")
    status = "converged" if marker == "converged" and child.exit_code != 3 else "failed"
    return Completed(
        status, child.exit_code, child.seconds, output.failed, tuple(warnings), output.points,
        child.peak_memory, output.path,
    )  # fmt: skip


def is_full(folder: Path) -> bool:
    """Whether the disk that holds `folder` has no space left for this user."""
    try:
        disk = os.statvfs(folder)
    except OSError:
        return False
    blocks = disk.f_bfree if os.geteuid() == 0 else disk.f_bavail
    return disk.f_blocks > 0 and blocks * disk.f_frsize < FULL_DISK


@contextlib.contextmanager
def _disk_full_as_error(log: Path | None) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise FreeFEMError("disk-full", f"the log cannot be written: {error.strerror}", log=log) from error


@contextlib.contextmanager
def _sigterm_as_exit() -> Iterator[None]:
    """Let SIGTERM unwind the stack, so that `finally` kills the child; only where nobody else handles it."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
