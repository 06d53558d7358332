"""What `--vary`, `--points` and a study's file say: the keys of a sweep and their values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from ffsi.files.errors import InputError
from ffsi.files.reading import LONGEST_TABLE, MEGABYTE, read_text
from ffsi.run.design import MAXIMUM_POINTS, words_of_count
from ffsi.text import cut, nearest

MAXIMUM_DIGITS = 40
LONGEST_TEXT = 1000

_EXPONENTS = (-300, 300)
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:s?nan|inf\w*))\s*(.*?)\s*", re.IGNORECASE)
_FORMS = "KEY=START:STOP:STEP or KEY=A,B,C, for samples KEY=LOW:HIGH"
STUDY_KEYS = ("scene", "set", "vary", "points", "design", "samples", "seed")


def parse_vary(text: str, *, sampled: bool = False) -> tuple[str, list[Any]]:
    """Read `key=start:stop:step` (stop included) or `key=a,b,c`, of samples also `key=low:high`; units may follow.

    Returns:
        The key and its values: numbers, numbers with a unit as texts, other texts, truth values. A range is counted in
        decimal, so 0.012:0.12:0.012 is exactly 0.012, 0.024, ..., 0.12.

    Raises:
        InputError: the text has another form, a number is not finite, or a range is empty.
    """
    key, equals, values = text.partition("=")
    key = key.strip()
    if not equals or not key or not values.strip():
        raise InputError(f"--vary takes {_FORMS}, not {text!r}")
    if values.count(",") >= MAXIMUM_POINTS:
        raise InputError(f"--vary {cut(key)}: more than {MAXIMUM_POINTS} values")
    if ":" in values and _NUMBER.fullmatch(values.partition(":")[0]):
        return key, _range(key, values, sampled)
    items = [_item(key, item) for item in values.split(",")]
    with_unit = [item for item in items if isinstance(item, str) and _NUMBER.fullmatch(item)]
    if with_unit and any(isinstance(item, float | int) and not isinstance(item, bool) and item for item in items):
        raise InputError(f"--vary {cut(key)}: {cut(values, 60)!r}: give each value its unit, such as 2 cm/s, 3 cm/s")
    return key, items


def parse_all(texts: Iterable[str], *, sampled: bool = False) -> dict[str, list[Any]]:
    """Read several `--vary` texts, in their order.

    Raises:
        InputError: as `parse_vary`; also if a key comes twice.
    """
    varied: dict[str, list[Any]] = {}
    for text in texts:
        key, values = parse_vary(text, sampled=sampled)
        if key in varied:
            raise InputError(f"--vary {key} is given twice; list its values in one: {key}=A,B,C")
        varied[key] = values
    return varied


def read_points(path: Path) -> Any:
    """Read a CSV file whose first line has keys and whose other lines are points; empty cells leave a key as it is.

    Raises:
        InputError: it cannot be read, or has no points.
    """
    import io

    import pandas as pd

    try:
        text = read_text(path, LONGEST_TABLE)
        _check_cells(text)
        table = pd.read_csv(io.StringIO(text), dtype=str, skipinitialspace=True, index_col=False, keep_default_na=False)
    except ValueError as error:
        raise InputError(f"{path} is no table of points: {error}") from error
    if table.empty:
        raise InputError(f"{path} holds no points: a first line with keys and a line for each point are needed")
    return table.map(lambda cell: _item(str(path), cell) if isinstance(cell, str) and cell.strip() else None)


def _check_cells(text: str) -> None:
    """Refuse what pandas would take for something else: a key that comes twice, more cells than keys."""
    import csv
    import io

    lines = csv.reader(io.StringIO(text), skipinitialspace=True)
    try:
        keys = [cell.strip() for cell in next((cells for cells in lines if cells), [])]
        if "" in keys:
            raise ValueError("its first line has a cell without a key")
        if twice := next((key for i, key in enumerate(keys) if key in keys[:i]), None):
            raise ValueError(f"the key {cut(twice)} comes twice")
        for cells in lines:
            if any(cell.strip() for cell in cells[len(keys) :]):  # after a decimal comma, say
                raise ValueError(f"line {lines.line_num} has {len(cells)} cells under {len(keys)} keys")
    except csv.Error as error:
        raise ValueError(f"line {lines.line_num}: {error}") from error


def read_study(path: Path) -> dict[str, Any] | None:
    """Read a study's TOML file: `scene`, a table `set`, a table `vary` or `points`, `design`, `samples`, `seed`.

    Returns:
        What it says; `points` is the path of a CSV file, seen from here. None if the file is no study.

    Raises:
        InputError: it has other keys or types.
    """
    from ffsi.scene.toml import parse_toml

    table = parse_toml(read_text(path, MEGABYTE), path.name)
    if not {"vary", "points", "scene"} & set(table):
        return None
    for key, value in table.items():
        if key not in STUDY_KEYS:
            hint = f' (did you mean "{guess}"?)' if (guess := nearest(key, STUDY_KEYS)) else ""
            raise InputError(f"{path}: {cut(key)}: accepted keys of a study: {', '.join(STUDY_KEYS)}{hint}")
        expected = {"set": Mapping, "vary": Mapping, "samples": int, "seed": int}.get(key, str)
        if not isinstance(value, expected) or isinstance(value, bool):
            raise InputError(f"{path}: {key} = {cut(repr(value), 60)}: accepted: {_TYPES[expected]}")
    if "scene" not in table:
        raise InputError(f"{path}: scene is missing: the name of a case, or the path of a scene's file")
    if len({"vary", "points"} & set(table)) != 1:
        raise InputError(f"{path}: give either vary or points{', not both' if 'vary' in table else ''}")
    if "vary" in table:
        sampled = "samples" in table
        table["vary"] = {
            key: parse_vary(f"{key}={values}", sampled=sampled)[1] if isinstance(values, str) else values
            for key, values in flat(table["vary"]).items()
        }
    table["set"] = {key: None if value == "none" else value for key, value in flat(table.get("set", {})).items()}
    for key in ("scene", "points"):
        if key in table and (path.parent / table[key]).is_file():
            table[key] = str(path.parent / table[key])
    return table


_TYPES = {Mapping: "a table of keys and values", int: "a whole number", str: "a text"}


def flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables as one with dotted keys."""
    every: dict[str, Any] = {}
    for key, value in table.items():
        found = flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
        if twice := every.keys() & found:
            raise InputError(f"{min(twice)} comes twice")
        every |= found
    return every


def _range(key: str, text: str, sampled: bool) -> list[Any]:
    parts = [_number(key, part) for part in text.split(":")]
    units = {unit for _, unit in parts if unit}
    if len(units) > 1 or (units and not parts[-1][1]):
        raise InputError(f"--vary {key}: {cut(text, 60)!r}: give one unit, at the end, such as 1:3:0.5 kPa")
    unit = units.pop() if units else ""
    numbers = [number for number, _ in parts]
    if len(numbers) == 3:
        start, stop, step = numbers
        if step == 0 or (stop - start) / step < 0:
            raise InputError(f"--vary {key}: the step {step} does not lead from {start} to {stop}")
        count = int((stop - start) / step) + 1  # at most 10^600: quickly computed
        if count > MAXIMUM_POINTS:
            many = f"{words_of_count(count)} values, more than {MAXIMUM_POINTS}"
            raise InputError(f"--vary {key}: {cut(text, 60)!r} has {many}")
        numbers = [start + i * step for i in range(count)]
    elif len(numbers) != 2 or not sampled:
        raise InputError(f"--vary {key}: a range is START:STOP:STEP, of samples LOW:HIGH, not {cut(text, 60)!r}")
    return [f"{number} {unit}" if unit else _value(number) for number in numbers]


def _item(key: str, text: str) -> Any:
    text = text.strip()
    if not text:
        raise InputError(f"--vary {cut(key)}: a value is empty")
    if text in ("true", "false", "True", "False"):  # pandas writes the latter
        return text in ("true", "True")
    if len(text) > LONGEST_TEXT:
        raise InputError(f"--vary {cut(key)}: {cut(text, 60)!r} has more than {LONGEST_TEXT} characters")
    if not _NUMBER.fullmatch(text) or _NUMBER.fullmatch(text)[2]:  # type: ignore[index]
        return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'" else text
    return _value(_number(key, text)[0])


def _number(key: str, text: str) -> tuple[Decimal, str]:
    shown = f"--vary {cut(key)}: {cut(text.strip(), 60)!r}"
    found = _NUMBER.fullmatch(text)
    if found is None:
        raise InputError(f"{shown} is no number")
    digits, unit = found.groups()
    if len(digits) > MAXIMUM_DIGITS:
        raise InputError(f"{shown} has more than {MAXIMUM_DIGITS} characters")
    try:
        number = Decimal(digits)
    except InvalidOperation:
        raise InputError(f"{shown} is no number") from None
    if not number.is_finite():
        raise InputError(f"{shown} is not finite")
    if number and not _EXPONENTS[0] <= number.adjusted() <= _EXPONENTS[1]:
        raise InputError(f"{shown} is not between 1e{_EXPONENTS[0]} and 1e{_EXPONENTS[1]}")
    return number if number else Decimal(0), unit  # 0e999999999


def _value(number: Decimal) -> float:
    """Return an int for a number written as one (mesh levels are integers), else the nearest float."""
    whole = number == number.to_integral_value() and "." not in str(number) and "E" not in str(number)
    return int(number) if whole else float(number)
