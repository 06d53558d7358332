"""What the machine refuses: a full disk, a limit, too many files; told apart from input that cannot be used."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from ffsi.text import cut

_WORDS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the limit of a file's size is reached (ulimit -f)",
    errno.EIO: "the disk does not work",
    errno.ENOMEM: "the memory ended",
    errno.EAGAIN: "no more processes or threads are allowed (ulimit -u)",
    errno.EMFILE: "too many files are open (ulimit -n)",
    errno.ENFILE: "too many files are open",
    errno.ESTALE: "the network disk is gone",
}


def ended(error: BaseException) -> bool:
    """Tell whether an error is the machine's and not that of the name that was given."""
    return isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno in _WORDS)


def words(error: BaseException) -> str:
    """Return file and reason."""
    if isinstance(error, MemoryError):
        return "the memory ended; give more of it (ulimit -v), a coarser mesh or fewer --jobs"
    if not isinstance(error, OSError):
        return " ".join(str(error).split()) or type(error).__name__
    reason = error.strerror or str(error)
    if error.errno in _WORDS:
        reason = f"{_WORDS[error.errno]} ({reason})"
    return f"{cut(error.filename)}: {reason}" if error.filename else reason


class MachineError(RuntimeError):
    """A computation ended because the machine failed it; what it had written stays."""


@contextlib.contextmanager
def computing(directory: Path) -> Iterator[None]:
    """Raise the system's errors during a computation in `directory` as MachineError: the input was good."""
    try:
        yield
    except OSError as error:
        if directory.exists():
            ending = f"the computation in {cut(directory)} ends here, what it has written there stays"
        else:
            ending = f"the folder {cut(directory)} has gone while the computation was under way"
        raise MachineError(f"{words(error)}; {ending}") from error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Give an error that has none the name of the file: a write that fails tells only the reason."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise
