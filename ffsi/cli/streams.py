"""Standard output and error that may be closed, full, or read no longer: a computation must not end of that."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast


class Guarded:
    """A stream whose failures are kept for the end of the command; after the first one nothing is written any more."""

    def __init__(self, stream: TextIO | None) -> None:
        """Guard `stream`; None stands for one that was closed when the program began."""
        self._stream: Any = stream if stream is not None else io.StringIO()
        self.failure = OSError(errno.EBADF, "closed") if stream is None else None
        if isinstance(stream, io.TextIOWrapper):  # a terminal that cannot show the letter must not end the command
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        """Write, or keep the failure."""
        self._try(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush, or keep the failure."""
        self._try(self._stream.flush)

    def isatty(self) -> bool:
        """Return whether it is a terminal; what is closed or cannot say is none."""
        try:
            return bool(self._stream.isatty())
        except (AttributeError, ValueError):
            return False

    def __getattr__(self, name: str) -> Any:
        """Everything else is that of the stream: its encoding, its file."""
        return getattr(self._stream, name)

    @property
    def lost(self) -> str:
        """Why something that was written is lost; empty if nothing is, or a reader such as `head` had enough."""
        reader_left = isinstance(self.failure, BrokenPipeError)
        return "" if self.failure is None or reader_left else self.failure.strerror or str(self.failure)

    def _try(self, action: Any) -> None:
        if self.failure is None:
            try:
                action()
            except (OSError, ValueError) as error:  # a closed Python stream raises ValueError
                self.failure = error if isinstance(error, OSError) else OSError(errno.EBADF, "closed")


@contextlib.contextmanager
def guarded() -> Iterator[Guarded]:
    """Guard standard output and error; yield the guard of standard output.

    A closed descriptor is opened on nothing first: the next file to be opened would take its number, and what some
    library prints would go into that file.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    before = sys.stdout, sys.stderr
    out, err = Guarded(sys.stdout), Guarded(sys.stderr)
    sys.stdout, sys.stderr = cast(TextIO, out), cast(TextIO, err)
    try:
        yield out
    finally:
        out.flush()
        err.flush()
        # The guard of a stream that failed stays: Python flushes both once more when it ends.
        if out.failure is None:
            sys.stdout = before[0]
        if err.failure is None:
            sys.stderr = before[1]
