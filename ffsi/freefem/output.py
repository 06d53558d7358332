"""The output of a run: into the log as it comes, its `@ffsi` lines as events, the last lines kept for the errors."""

import contextlib
import logging
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from ffsi.freefem.events import Event, parse_event
from ffsi.text import printable

logger = logging.getLogger(__name__)

TAIL = 400
"""Lines kept for the explanation of a failure."""


class Output:
    """Takes the output in pieces. Raises OSError when the log cannot be written."""

    def __init__(self, path: Path | None, on_event: Callable[[Event], None] | None = None) -> None:
        """Write to the file `path` (None: no log) and hand each event to `on_event`."""
        self.path = path
        self.tail: deque[str] = deque(maxlen=TAIL)
        self.warnings: list[str] = []
        self.points: dict[int, str] = {}
        self.failed = ""
        self.bad_input: str | None = None
        self.end_status: str | None = None
        self.last = ""
        self._on_event = on_event
        self._rest = b""
        self._log: BinaryIO | None = None

    def __enter__(self) -> "Output":
        """Open the log, in a new folder if need be."""
        if self.path is not None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._log = self.path.open("wb")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log."""
        if self._log is not None:
            with contextlib.suppress(OSError):  # every write was flushed, so only a failed one fails again
                self._log.close()

    def feed(self, chunk: bytes) -> None:
        """Take the next piece: log it, then handle each complete line."""
        if self._log is not None:
            self._log.write(chunk)
            self._log.flush()
        *lines, self._rest = (self._rest + chunk).split(b"\n")
        for line in lines:
            self._line(line.decode("utf-8", errors="replace").rstrip("\r"))

    def finish(self) -> None:
        """Handle a last line without a newline."""
        if self._rest:
            self._line(self._rest.decode("utf-8", errors="replace"))
            self._rest = b""

    def _line(self, line: str) -> None:
        self.tail.append(line)
        try:
            event = parse_event(printable(line))
        except ValueError as error:
            logger.warning("%s", error)
            return
        if event is None:
            if "umfpack" in line and "status" in line:  # not fatal to FreeFEM: it goes on with what is in the vector
                self._take(Event("warning", text=f"UMFPACK: {line.strip()}"))
            return
        self._take(event)

    def _take(self, event: Event) -> None:
        match event.kind:
            case "warning":
                self.warnings.append(event.text)
            case "failed":
                self.failed = event.text
            case "bad-input":
                self.bad_input = event.text
            case "point":
                self.points[event.integer("point")] = event.word("status")
            case "end":
                self.end_status = event.word("status", "failed")
        if event.kind in ("newton", "point", "mesh", "start"):
            self.last = f"{event.kind} " + " ".join(f"{key}={value}" for key, value in event.fields.items())
        if self._on_event is not None:
            self._on_event(event)
