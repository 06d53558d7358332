"""What the user gave and cannot be used."""

from __future__ import annotations

from ffsi.text import cut

_LONGEST_MESSAGE = 6000  # characters


class InputError(ValueError):
    """Something the user gave cannot be used (a file, a folder, a range of values, ...): exit code 2 of the command."""

    def __init__(self, message: str) -> None:
        """Keep the message as one printable line: it may hold names from files."""
        super().__init__(cut(message, _LONGEST_MESSAGE))
