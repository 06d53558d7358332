"""A computation in time while it runs: what it swings like, whether it is periodic, and the record of its files."""

from __future__ import annotations

import logging
import math
import time
from bisect import bisect_right
from collections.abc import Callable, Sequence
from pathlib import Path

from ffsi.files import folder
from ffsi.files.manifest import Recorder
from ffsi.freefem import Event, FreeFEMError
from ffsi.result import oscillation
from ffsi.result.in_time import changes, loads_since, settled
from ffsi.result.quantities import unit
from ffsi.scene import Scene

logger = logging.getLogger(__name__)

LOOK_EVERY = 2.0
"""Seconds of wall time, at least, between two looks at the history."""
SHARE = 0.05
"""Largest part of the wall time that looking may cost."""


class Watch:
    """Follows a running computation: reports its mean, amplitude and frequency, and ends it when it is periodic.

    A listener that passes every event on and adds, every few seconds, `signal` events with `name`, `unit`, `mean`,
    `amplitude` (both in that unit) and `frequency` (Hz) of the last full period of `oscillation.reference_column`.
    Meanwhile it keeps the record (`files.manifest`); `record.close` is to be called when the script has ended.
    """

    def __init__(
        self, scene: Scene, directory: Path, on_event: Callable[[Event], None] | None = None, *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """Watch the run of `scene` in `directory`."""
        self.scene, self.directory, self.on_event, self.clock = scene, directory, on_event, clock
        self.stopped = False
        self.record = Recorder(directory)
        self._since = loads_since(changes(directory, scene))
        self._tail = _Tail(directory / folder.TIME_HISTORY)
        self._next = clock() + LOOK_EVERY

    def __call__(self, event: Event) -> None:
        """Take one event of the script."""
        if self.on_event is not None:
            self.on_event(event)
        if event.kind == "time":
            self.record.look()
        if event.kind == "time" and self.clock() >= self._next:
            begin = self.clock()
            self.look()
            now = self.clock()
            self._next = now + max(LOOK_EVERY, (now - begin) / SHARE)

    def look(self) -> None:
        """Read what is new in the history, report the last period, and ask the script to end if it is periodic."""
        name, times, values = self._tail.read()
        first = bisect_right(times, self._since)  # signals before are those of other loads
        times, values = times[first:], values[first:]
        try:
            found = oscillation.mean_amplitude_frequency(times, values)
            periodic = not self.stopped and self._stops and bool(settled(self.scene, times, values, self._since))
        except ValueError as error:  # the computation is about to fail
            logger.debug("%s: %s", self.directory, error)
            return
        if self.on_event is not None and math.isfinite(found.frequency):
            self.on_event(Event("signal", {"name": name, "unit": unit(name), **found.as_dict()}))
        if periodic:
            folder.write_text(self.directory / folder.STOP, folder.STOP_PERIODIC)
            self.stopped = True

    @property
    def _stops(self) -> bool:
        return self.scene.time is not None and self.scene.time.stop == "periodic"


class _Tail:
    """The times and the signals of a history that grows; every line is read once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.times: list[float] = []
        self._signals: dict[str, list[float]] = {}
        self._columns: dict[str, int] = {}
        self._offset = 0

    def read(self) -> tuple[str, Sequence[float], Sequence[float]]:
        """Return the name of the signal that counts, the times (s) and its values up to now; without one no times.

        Raises:
            FreeFEMError: kind `disk-full`: a row is damaged.
        """
        import pandas as pd

        if self.path.is_file():
            with self.path.open("rb") as file:
                file.seek(self._offset)
                whole = file.read().rpartition(b"\n")
            self._offset += len(whole[0]) + len(whole[1])
            for line in whole[0].decode("utf-8", errors="replace").splitlines():
                try:
                    self._take(line.split(","))
                except (ValueError, IndexError, KeyError):
                    text = f"row {len(self.times) + 1} of {self.path.name} is damaged"
                    raise FreeFEMError(
                        "disk-full", f"{text}: the disk was full for a while, or does not work"
                    ) from None
        name = oscillation.reference_column(pd.DataFrame(self._signals))
        return (name, self.times, self._signals[name]) if name else ("", [], [])

    def _take(self, cells: list[str]) -> None:
        if not self._columns:
            self._columns = {name: column for column, name in enumerate(cells)}
            self._signals = {name: [] for name in oscillation.REFERENCES if name in self._columns}
        else:
            if len(cells) != len(self._columns):
                raise ValueError
            self.times.append(float(cells[0]))
            for name, values in self._signals.items():
                values.append(float(cells[self._columns[name]]))
