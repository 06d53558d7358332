"""One child process in a process group of its own: read its output, kill it with its children, measure its memory."""

import contextlib
import math
import os
import resource
import select
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

TICK = 0.2
"""Seconds between two looks at the process while it is silent."""
SAMPLE = 0.05
"""Seconds, at least, between two readings of its memory; the first comes long after exec."""


class Child:
    """A started process whose stdout and stderr come through one pipe.

    After `close` it is reaped: `exit_code` (minus the signal's number if one ended it), `seconds` and `peak_memory`
    (bytes, 0 when unknown) are final.
    """

    def __init__(self, command: list[str], environment: dict[str, str], folder: Path) -> None:
        """Start `command` in `folder`; raises OSError when it cannot be started."""
        self._kills_before = oom_kills()
        self._start = time.monotonic()
        self._process = subprocess.Popen(
            [*_die_with_parent(), *command], env=environment, cwd=folder, process_group=0,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self.pid = self._process.pid
        self.exit_code = 0
        self.seconds = 0.0
        self.peak_memory = 0
        self.cpu_seconds = 0.0
        self._reaped = False
        self._lock = threading.Lock()

    def read(self, deadline: float = math.inf) -> Iterator[bytes]:
        """The output in pieces, until the process has ended; raises TimeoutError when `deadline` (monotonic) passes."""
        assert self._process.stdout is not None
        pipe = self._process.stdout.fileno()
        poll = select.poll()
        poll.register(pipe, select.POLLIN | select.POLLHUP)
        sampled = self._start
        at_end = False
        while not at_end:
            ended = self._has_ended()
            now = time.monotonic()
            if now >= deadline and not ended:
                raise TimeoutError
            if now - sampled >= SAMPLE:
                self._sample_memory()
                sampled = now
            wait = 0.0 if ended else min(TICK, max(deadline - now, 0.0))
            # Asked for data after the end was seen: what is in the pipe then is all there will be.
            if poll.poll(1000 * wait):
                chunk = os.read(pipe, 1 << 16)
                if chunk:
                    yield chunk
                at_end = not chunk
            else:
                at_end = ended
        self._wait(deadline)

    def kill(self) -> None:
        """Kill the process and everything in its group; harmless when they have ended."""
        with self._lock:
            if not self._reaped:  # once reaped, the number may belong to another group
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.killpg(self.pid, signal.SIGKILL)

    def close(self) -> None:
        """Kill what is left, reap the process and close the pipe."""
        if self._reaped:
            return
        self.kill()
        os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOWAIT)
        with self._lock:
            _, status, usage = os.wait4(self.pid, 0)
            self._reaped = True
        self.seconds = time.monotonic() - self._start
        self.cpu_seconds = usage.ru_utime + usage.ru_stime
        self.exit_code = self._process.returncode = os.waitstatus_to_exitcode(status)
        # Between fork and exec the child shares the memory of this process, and the kernel counts it as the child's:
        # only a larger number is its own. Otherwise the samples have to do.
        if usage.ru_maxrss > resource.getrusage(resource.RUSAGE_SELF).ru_maxrss:
            self.peak_memory = 1024 * usage.ru_maxrss
        if self._process.stdout is not None:
            self._process.stdout.close()

    @property
    def memory_evidence(self) -> str:
        """Why a SIGKILL looks like the work of the kernel's out-of-memory killer; "" when it does not."""
        if oom_kills() > self._kills_before:
            return "the kernel counted an out-of-memory kill during the run"
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if self.peak_memory > 0.8 * total:
            return f"it used {self.peak_memory / 2**30:.1f} of {total / 2**30:.1f} GiB"
        return ""

    @property
    def limit_evidence(self) -> dict[str, str]:
        """Limits of the shell that may have ended the process, with their values: `cpu` only if it was reached."""
        found = {}
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        if hard != resource.RLIM_INFINITY and self.cpu_seconds > hard - 1:
            found["cpu"] = f"{hard} s (ulimit -t)"
        space = resource.getrlimit(resource.RLIMIT_AS)[0]
        if space != resource.RLIM_INFINITY:
            found["memory"] = f"{space / 2**30:.2f} GiB (ulimit -v)"
        return found

    def _has_ended(self) -> bool:
        """Whether the process is over; it stays unreaped, which keeps its group's number from being used again."""
        return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None

    def _wait(self, deadline: float) -> None:
        """Wait for a process that has closed its output."""
        pause = 0.001
        while not self._has_ended():
            if time.monotonic() >= deadline:
                raise TimeoutError
            time.sleep(pause)
            pause = min(2 * pause, TICK)

    def _sample_memory(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
                if line.startswith("VmHWM:"):
                    self.peak_memory = max(self.peak_memory, 1024 * int(line.split()[1]))


def _die_with_parent() -> list[str]:
    """A prefix that makes Linux kill the process when the thread that started it dies, even by SIGKILL."""
    setpriv = shutil.which("setpriv")
    return [setpriv, "--pdeathsig", "KILL", "--"] if setpriv else []


def oom_kills() -> int:
    """How many processes the kernel has killed for lack of memory since it started; 0 when it does not tell."""
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/vmstat").read_text().splitlines():
            if line.startswith("oom_kill "):
                return int(line.split()[1])
    return 0
