"""The lines that a rendered script writes for Python: `@ffsi KIND key=value ... text=rest of the line`."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field

MARK = "@ffsi"

_INTEGER = re.compile(r"[+-]?\d+\Z")
_REAL = re.compile(r"[+-]?(?:\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|nan|inf)\Z")

Value = int | float | str


@dataclass(frozen=True)
class Event:
    """One progress line.

    `kind` is the word after the mark (`newton`, `mesh`, `point`, `warning`, `failed`, `bad-input`, `end`, ...),
    `fields` its key=value pairs with numbers converted, `text` the free text at the end of the line.
    """

    kind: str
    fields: dict[str, Value] = field(default_factory=dict)
    text: str = ""

    def integer(self, key: str, default: int = 0) -> int:
        """The field as an int; `default` when it is absent or no whole number."""
        value = self.fields.get(key, default)
        return value if isinstance(value, int) else default

    def number(self, key: str, default: float = float("nan")) -> float:
        """The field as a float; `default` when it is absent or no number."""
        value = self.fields.get(key, default)
        return default if isinstance(value, str) else float(value)

    def word(self, key: str, default: str = "") -> str:
        """The field as text; `default` when it is absent."""
        return str(self.fields.get(key, default))


def parse_event(line: str) -> Event | None:
    """Read one line of output.

    Returns None for a line that does not start with `@ffsi`.
    Raises ValueError for a marked line that breaks the format: no kind, or a field without `=`.
    """
    mark, _, rest = line.strip().partition(" ")
    if mark != MARK:
        return None
    head, *text = re.split(r"(?:^|\s)text=", rest, maxsplit=1)
    words = head.split()
    if not words or "=" in words[0]:
        raise ValueError(f"a progress line without a kind: {line!r}")
    fields: dict[str, Value] = {}
    for word in words[1:]:
        key, equals, value = word.partition("=")
        if not key or not equals:
            raise ValueError(f"{word!r} is not key=value in the progress line {line!r}")
        fields[key] = _convert(value)
    return Event(words[0], fields, "".join(text).strip())


def _convert(value: str) -> Value:
    return int(value) if _INTEGER.match(value) else float(value) if _REAL.match(value) else value


OnEvent = Callable[[Event], None]
