"""What `--vary` says: the keys of a sweep and their values."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal, InvalidOperation

from ffsi.files.errors import InputError
from ffsi.result.table import MAXIMUM_POINTS, check_count, words_of_count
from ffsi.text import cut

MAXIMUM_DIGITS = 40

_EXPONENTS = (-300, 300)


def parse_vary(text: str) -> tuple[str, list[float]]:
    """Read `key=start:stop:step` (stop included) or `key=a,b,c`.

    Returns:
        The key and its values; a range is counted in decimal, so 0.012:0.12:0.012 is exactly 0.012, 0.024, ..., 0.12.

    Raises:
        InputError: the text has another form, a value is no finite number or occurs twice, or a range is empty.
    """
    key, equals, values = text.partition("=")
    key = key.strip()
    if not equals or not key or not values.strip():
        raise InputError(f"--vary takes KEY=START:STOP:STEP or KEY=A,B,C, not {text!r}")
    if values.count(",") >= MAXIMUM_POINTS:
        raise InputError(f"--vary {cut(key)}: more than {MAXIMUM_POINTS} values")
    numbers = _range(key, values) if ":" in values else [_number(key, item) for item in values.split(",")]
    if len(set(numbers)) < len(numbers):
        raise InputError(f"--vary {key}: a value occurs twice in {values!r}")
    return key, [_value(number) for number in numbers]


def parse_all(texts: Iterable[str]) -> dict[str, list[float]]:
    """Read several `--vary` texts, in their order.

    Raises:
        InputError: as `parse_vary`; also if a key comes twice.
    """
    varied: dict[str, list[float]] = {}
    for text in texts:
        key, values = parse_vary(text)
        if key in varied:
            raise InputError(f"--vary {key} is given twice; list its values in one: {key}=A,B,C")
        varied[key] = values
    check_count(varied)
    return varied


def _range(key: str, text: str) -> list[Decimal]:
    parts = text.split(":")
    if len(parts) != 3:
        raise InputError(f"--vary {key}: a range is START:STOP:STEP, not {text!r}")
    start, stop, step = (_number(key, part) for part in parts)
    if step == 0 or (stop - start) / step < 0:
        raise InputError(f"--vary {key}: the step {step} does not lead from {start} to {stop}")
    count = int((stop - start) / step) + 1  # at most 10^600: quickly computed
    if count > MAXIMUM_POINTS:
        raise InputError(f"--vary {key}: {text!r} has {words_of_count(count)} values, more than {MAXIMUM_POINTS}")
    return [start + i * step for i in range(count)]


def _number(key: str, text: str) -> Decimal:
    text = text.strip()
    shown = f"--vary {key}: {cut(text, 60)!r}"
    if len(text) > MAXIMUM_DIGITS:
        raise InputError(f"{shown} has more than {MAXIMUM_DIGITS} characters")
    try:
        number = Decimal(text)
    except InvalidOperation:
        raise InputError(f"{shown} is no number (units are not accepted here, values are in SI)") from None
    if not number.is_finite():
        raise InputError(f"{shown} is not finite")
    if number and not _EXPONENTS[0] <= number.adjusted() <= _EXPONENTS[1]:
        raise InputError(f"{shown} is not between 1e{_EXPONENTS[0]} and 1e{_EXPONENTS[1]}")
    return number if number else Decimal(0)  # 0e999999999


def _value(number: Decimal) -> float:
    """Return an int for a number written as one (mesh levels are integers), else the nearest float."""
    return (
        int(number)
        if number == number.to_integral_value() and "." not in str(number) and "E" not in str(number)
        else float(number)
    )
