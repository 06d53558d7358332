"""Text from outside (files, folders, command lines) made fit for a terminal, a log, a report and an error."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

SHOWN = 40
"""Names of a list that are shown; the rest is counted."""
LONGEST = 120
"""Characters of a name that are shown."""
_CANDIDATES = 500  # names that are compared with a refused one: each costs some microseconds


def printable(text: object) -> str:
    """Return one line in which a question mark stands for every character that is no plain print.

    That covers control characters (line ends among them), those that turn the direction of the text, invisible ones
    and bytes of a file's name that are no UTF-8.
    """
    line = str(text)
    return line if line.isprintable() else "".join(c if c.isprintable() else "?" for c in line)


def cut(text: object, limit: int = LONGEST) -> str:
    """Return `printable` text of at most ``limit`` characters; ``...`` stands for what is left out of its middle."""
    line = str(text)
    if len(line) > limit:
        half = (limit - 3) // 2
        line = f"{line[: limit - 3 - half]}...{line[-half:]}"
    return printable(line)


def listed(names: Iterable[object], shown: int = SHOWN) -> str:
    """Return the first names, `cut` and separated by commas, and how many more there are."""
    every = list(names)
    text = ", ".join(cut(name) for name in every[:shown])
    return f"{text} and {len(every) - shown} more" if len(every) > shown else text


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """Return the valid name most similar to ``name``, or None if none is similar; of very many the first are tried."""
    if len(name) > LONGEST:
        return None
    by_lower = {candidate.lower(): candidate for candidate in islice(valid, _CANDIDATES)}
    found = difflib.get_close_matches(name.lower(), list(by_lower), n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None
