"""The live progress line of a run or a sweep, on stderr and only where that is a terminal."""

import math
import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING

from ffsi.freefem.events import Event
from ffsi.text import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, TaskID

__all__ = ["Event", "ProgressDisplay"]


class ProgressDisplay:
    """Shows case, sweep point, Newton iteration, residual, time elapsed and time left.

    In time: the time reached, the steps, and mean, amplitude and frequency of the tip's u_y or the lift so far.

    A context manager that is itself the callback: `with ProgressDisplay() as show: run_script(..., on_event=show)`.
    Calls may come from several threads. `points` is the number of points of the whole sweep when it is split over
    several processes; without it, the `points=` of the events counts.
    """

    def __init__(
        self, case: str = "", points: int | None = None, *, console: "Console | None" = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """Prepare a display; nothing is drawn before `with`, and nothing at all when the console is no terminal."""
        self.case = case
        self.finished = self.failed = 0
        self._before = self._running = 0
        self._of_results = False
        self._whole = points
        self._points = points or 1
        self._detail = ""
        self._signal = ""
        self._reached = self._end = math.nan
        self._first: tuple[float, float] | None = None  # wall clock and time reached at the first step seen
        self._clock = clock
        self._begin = clock()
        self._lock = threading.Lock()
        self._live = _live(console, case) if (console.is_terminal if console else sys.stderr.isatty()) else None

    def __enter__(self) -> "ProgressDisplay":
        """Start to draw."""
        self._begin = self._clock()
        if self._live:
            self._live[0].start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wipe the line."""
        if self._live:
            self._live[0].stop()

    def __call__(self, event: Event) -> None:
        """Take one event; kinds that say nothing about progress are ignored."""
        with self._lock:
            match event.kind:
                case "start":
                    self.case = self.case or event.word("case")
                case "mesh":
                    self._detail = _mesh(event)
                case "newton":
                    self._points = self._whole or max(event.integer("points", 1), 1)
                    self._detail = _newton(event, self._points if self._whole is None else 1)
                case "time":
                    self._take_step(event)
                case "signal":
                    self._signal = _signal(event)
                case "result":
                    self._take_result(event)
                case "point" if not self._of_results:
                    self._points = self._whole or max(event.integer("points", 1), 1)
                    self.finished = min(self.finished + 1, self._points)
                case _:
                    return
            self._draw()

    @property
    def state(self) -> str:
        """What the line says between the bar and the times."""
        count = f"{self.finished}/{self._points} done" if self._points > 1 else ""
        count += f", {self._running} running" if self._running > 1 else ""
        count += f", {self.failed} failed" if self.failed else ""
        signal = "" if count else self._signal  # of several points at a time it would be anybody's
        return " · ".join(part for part in (count, self._detail, signal) if part)

    @property
    def seconds_left(self) -> float | None:
        """Estimated from the finished points, or the time reached; None when there is nothing to estimate from."""
        if self._in_time and self._first is not None and self._reached > self._first[1]:
            speed = (self._reached - self._first[1]) / max(self._clock() - self._first[0], 1e-9)
            return (self._end - self._reached) / speed
        if self._points <= 1 or self.finished == 0:
            return None
        new = self.finished - self._before
        return (self._clock() - self._begin) * (self._points - self.finished) / new if new > 0 else None

    @property
    def _in_time(self) -> bool:
        return self._points <= 1 and math.isfinite(self._end)

    def _take_result(self, event: Event) -> None:
        """Count the points of a study; where this is no terminal, a line for each of them."""
        if not self._of_results:
            self._before = event.integer("done") - 1
        self._of_results = True
        self._points, self.finished = event.integer("points"), event.integer("done")
        self.failed, self._running = event.integer("failed"), event.integer("running")
        if not self._live:
            left = self.seconds_left
            line = (
                f"{self.finished}/{self._points} {event.text}: {event.word('verdict')}, {event.number('seconds'):.1f} s"
            )
            line += f"; {self.failed} failed" if self.failed else ""
            print(printable(line + (f"; about {_duration(left)} left" if left else "")), file=sys.stderr)

    def _take_step(self, event: Event) -> None:
        self._reached, self._end = event.number("time"), event.number("end")
        if self._first is None:
            self._first = self._clock(), self._reached
        self._detail = f"t = {self._reached:.4g} of {self._end:g} s · step {event.integer('step')}"

    def _draw(self) -> None:
        if not self._live:
            return
        left = self.seconds_left
        total: float | None = self._points if self._points > 1 else None
        completed: float = self.finished
        if self._in_time:
            total, completed = self._end, self._reached
        progress, task = self._live
        progress.update(
            task, description=self.case, completed=completed, total=total, state=self.state,
            left="" if left is None else f"about {_duration(left)} left",
        )  # fmt: skip


def _live(console: "Console | None", case: str) -> "tuple[Progress, TaskID]":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    progress = Progress(
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=20),
        TextColumn("{task.fields[state]}"), TimeElapsedColumn(), TextColumn("{task.fields[left]}"),
        console=console or Console(stderr=True), transient=True, redirect_stdout=False,
    )  # fmt: skip
    return progress, progress.add_task(case, total=None, state="", left="")


def _mesh(event: Event) -> str:
    stage = f"mesh {event.integer('stage')}/{event.integer('stages')}" if event.integer("stages") > 1 else "mesh"
    unknowns = event.integer("unknowns")
    return f"{stage}, {unknowns} unknowns" if unknowns else stage


def _newton(event: Event, points: int) -> str:
    parts = [f"point {event.integer('point')}/{points}"] if points > 1 else []
    if event.integer("stages") > 1:
        parts.append(f"mesh {event.integer('stage')}/{event.integer('stages')}")
    load = event.number("load", 1.0)
    if load < 1:
        parts.append(f"load {load:.3g}")
    parts.append(f"Newton {event.integer('iteration')}")
    parts.append(f"residual {event.number('residual'):.1e}")
    return " · ".join(parts)


def _signal(event: Event) -> str:
    name, mean, amplitude = event.word("name"), event.number("mean"), event.number("amplitude")
    return f"{name} {mean:.4g} ± {amplitude:.4g} {event.word('unit')}, {event.number('frequency'):.4g} Hz"


def _duration(seconds: float) -> str:
    whole = round(seconds)
    hours, minutes = whole // 3600, whole // 60 % 60
    return f"{hours}:{minutes:02d}:{whole % 60:02d}" if hours else f"{minutes}:{whole % 60:02d}"
