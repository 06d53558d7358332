"""Files that others wrote: read whole, if they are ordinary files of a size that makes sense, or refused."""

from __future__ import annotations

import io
import json
import math
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ffsi.files.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

MEGABYTE = 1_000_000
LONGEST_TABLE = 4000 * MEGABYTE
_DIGITS = 18  # of a whole number: what fits into 64 bits


def read_bytes(path: Path, at_most: int) -> bytes:
    """Return the content of an ordinary file of ``at_most`` so many bytes.

    Raises InputError for a larger one, and, without reading from it, for a device, a pipe or a folder; OSError if the
    system does not let it be read.
    """
    if "\0" in str(path):
        raise InputError(f"{path} is no name of a file")
    if path.is_dir():
        raise InputError(f"{path} is a folder, not a file")
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # of a pipe, do not wait for its writer
    with os.fdopen(handle, "rb") as file:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path} is {'a pipe' if stat.S_ISFIFO(status.st_mode) else 'a device'}, not a file")
        if status.st_size > at_most:
            raise InputError(f"{path} is too large: a file of at most {at_most} bytes is accepted")
        return file.read(status.st_size)  # not `at_most`: read() sets aside all that it is asked for


def read_text(path: Path, at_most: int = 100 * MEGABYTE) -> str:
    """Return the content of a text file in UTF-8, with or without a mark in front.

    Raises as `read_bytes`, and InputError for other bytes.
    """
    try:
        return read_bytes(path, at_most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text file in UTF-8 (byte {error.start} is another)") from None


def read_json(path: Path, *, finite: bool = True) -> Any:
    """Return the content of a JSON file, of any type; NaN and Infinity are accepted only if not `finite`.

    Raises as `read_text`, and InputError for what is no JSON, a number that is none, not finite or has more than 18
    digits, a key that occurs twice, and nesting that is too deep.
    """
    text, constant = read_text(path), _no_number if finite else float
    try:
        return json.loads(
            text, parse_constant=constant, parse_float=_finite, parse_int=_whole, object_pairs_hook=_table
        )
    except RecursionError:
        raise InputError(f"{path} is no valid JSON: the nesting is too deep") from None
    except ValueError as error:
        raise InputError(f"{path} is no valid JSON: {error}") from None


def read_frame(path: Path) -> pd.DataFrame:
    """Return the table in a CSV file with a head; raises as `read_text`, and InputError if it is no such table."""
    text = read_text(path, LONGEST_TABLE)
    try:
        return frame_of(text)
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}") from error


def frame_of(text: str, comment: str | None = None) -> pd.DataFrame:
    """Return the table in a CSV text with a head; raises ValueError if it is none, or a row is longer than its head."""
    import pandas as pd

    table = pd.read_csv(io.StringIO(text), skipinitialspace=True, comment=comment)
    if not table.empty and not isinstance(table.index, pd.RangeIndex):  # pandas takes the first columns for an index
        more = len(table.columns) + table.index.nlevels
        raise ValueError(f"its rows have {more} cells, after decimal commas, say, under {len(table.columns)} columns")
    return table


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:20]} is too large")
    return value


def _whole(text: str) -> int:
    if len(text) > _DIGITS + 1:
        raise ValueError(f"the number {text[:20]}... has {len(text)} digits")
    return int(text)


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        raise ValueError("a key occurs twice")
    return table
