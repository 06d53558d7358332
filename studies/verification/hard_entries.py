"""The hard cases as data (studies/data/hard): a scene or a sweep each, and what is expected of it."""

from __future__ import annotations

import fnmatch
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from ffsi.files.errors import InputError
from ffsi.scene import CASES, Scene, load_scene, with_values

DATA = Path(__file__).parents[1] / "data" / "hard"
PLAIN = {"mesh.level": 0, "output.pictures": False, "output.vtu": False}
OUTCOMES = ("solves", "fails", "either", "open")
_OF = re.compile(
    r"(?:(max|path|rise|size) )?([a-z][a-z0-9_.]*?)(?:@([0-9.e+-]+)|#(-?\d+)|\(([0-9.e+-]+), ?([0-9.e+-]+)\))?"
)


@dataclass(frozen=True)
class Expectation:
    """A number x and where it must lie."""

    # What x is (SI): a quantity of the result (in time of the last state), `iterations`, `imbalance` (of the
    # energy, its size), `points` (solved ones of a sweep), or FORM of those in the data's README.
    of: str
    # Another entry, whose number x is divided by; `times` multiplies that number, `per_of` says of what it is.
    per: str = ""
    per_of: str = ""
    times: float = 1.0
    # What x is, 1 with `per` if neither it nor a bound is given; up to the part `within` of it, or `off` by so
    # much.
    value: float | None = None
    within: float = 0.0
    off: float = 0.0
    above: float | None = None  # lower bound
    below: float | None = None  # upper bound

    def __post_init__(self) -> None:
        """Refuse what cannot be evaluated, or holds of every number."""
        if not all(_OF.fullmatch(text) for text in (self.of, self.per_of) if text):
            raise ValueError(f"of = {self.of!r}, per_of = {self.per_of!r}: not of a known form")
        free = self.value is None and self.above is None and self.below is None
        if free and self.per:
            object.__setattr__(self, "value", 1.0)
        if (self.value is not None) != (self.within + self.off > 0) or (free and not self.per):
            raise ValueError(f"{self.of}: needs above, below, or a value with one of within and off")

    def holds(self, x: float) -> bool:
        """Return whether x lies where it must; NaN never does."""
        near = self.value is None or abs(x - self.value) <= max(self.within * abs(self.value), self.off)
        return near and (self.above is None or x > self.above) and (self.below is None or x < self.below)

    @property
    def text(self) -> str:
        """Where x must lie, in words."""
        parts = []
        if self.value is not None:
            parts.append(f"{self.value:.6g} ± {f'{100 * self.within:.3g} %' if self.within else f'{self.off:.3g}'}")
        parts += [f"> {self.above:.4g}"] if self.above is not None else []
        parts += [f"< {self.below:.4g}"] if self.below is not None else []
        return ", ".join(parts)


@dataclass(frozen=True)
class Entry:
    """A hard case."""

    id: str  # its name; what stands before the first `-` is its group
    what: str  # in words
    case: str  # of the catalogue, or a scene file below `DATA`
    why: str = ""  # where the expectation is from
    set: Mapping[str, Any] = field(default_factory=dict)  # values by dotted key
    # Values of a sweep by dotted key; empty: a single run.
    vary: Mapping[str, Sequence[float]] = field(default_factory=dict)
    outcome: str = "solves"  # `solves`, `fails` (and must name the cause), `either`, or `open` (nothing is claimed)
    reason: str = ""  # pattern of the cause; `unlike`: what must not be said
    unlike: str = ""
    warns: str = ""  # pattern of what must be said of a solved one
    expect: tuple[Expectation, ...] = ()  # of a solved one, of a sweep also if it ended early
    note: str = ""  # where it departs from what was asked for, and why
    quick: bool = False  # part of the short selection
    limit: float = 120.0  # s of wall-clock time

    def __post_init__(self) -> None:
        """Refuse what contradicts itself."""
        if self.outcome not in OUTCOMES or (self.outcome in ("fails", "either")) != bool(self.reason):
            raise ValueError(f"{self.id}: outcome {self.outcome!r} with the reason {self.reason!r}")
        for pattern in (self.reason, self.unlike, self.warns):
            re.compile(pattern)

    @property
    def group(self) -> str:
        """Name of its group."""
        return self.id.partition("-")[0]

    @property
    def files(self) -> list[Path]:
        """Scene, mesh and other files that it is made of; none for a case of the catalogue."""
        return [] if self.case in CASES else sorted((DATA / self.case).parent.iterdir())

    def scene(self) -> Scene:
        """Return what is solved; SceneError: it is refused."""
        scene = CASES[self.case] if self.case in CASES else load_scene(DATA / self.case)
        return with_values(scene, {**PLAIN, **self.set, "solver.time_limit": self.limit})


def numbers_of(of: str) -> tuple[str, str, float | None, int | None, tuple[float, float] | None]:
    """Return form (`max`, `path`, `rise`, `size` or empty), name, time (s), row of a sweep and point (m) of an `of`."""
    found = _OF.fullmatch(of)
    assert found is not None
    form, name, time, row, x, y = found.groups()
    point = (float(x), float(y)) if x else None
    return form or "", name, float(time) if time else None, int(row) if row else None, point


@cache
def load() -> tuple[dict[str, str], dict[str, Entry]]:
    """Return the titles of the groups by name, and all entries by id."""
    titles, entries = {}, {}
    for path in sorted(DATA.glob("*.toml")):
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        group = path.stem.partition("-")[0]
        titles[group] = table["title"]
        for name, own in table["scene"].items():
            values = {**table.get("default", {}), **own}
            values |= {key: _flat(values.get(key, {})) for key in ("set", "vary")}
            expect = tuple(Expectation(**item) for item in values.pop("expect", []))
            entries[f"{group}-{name}"] = Entry(id=f"{group}-{name}", expect=expect, **values)
    for entry in entries.values():
        if missing := [item.per for item in entry.expect if item.per and item.per not in entries]:
            raise ValueError(f"{entry.id} compares with {missing[0]}, which is not there")
    return titles, entries


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in table.items():
        found |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def select(entries: Mapping[str, Entry], only: str | None = None) -> list[Entry]:
    """Return the entries that match one of the patterns, separated by commas, and those that they compare with."""
    patterns = [pattern.strip() for pattern in (only or "*").split(",")]
    if unused := [pattern for pattern in patterns if not fnmatch.filter(entries, pattern)]:
        raise InputError(f"--only: no hard case matches {unused[0]!r}; names look like {', '.join([*entries][:3])}")
    found: set[str] = set()
    todo = {name for pattern in patterns for name in fnmatch.filter(entries, pattern)}
    while todo:  # those that they compare with, directly or not
        found |= todo
        todo = {item.per for name in todo for item in entries[name].expect if item.per} - found
    return [entry for name, entry in entries.items() if name in found]
