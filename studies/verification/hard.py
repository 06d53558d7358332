"""`verify --hard`: scenes outside of the catalogue, each solved rightly or refused with the right cause."""

from __future__ import annotations

import contextlib
import fnmatch
import hashlib
import json
import math
import re
import shutil
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ffsi.cli.vary import flat
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMNotFound, find_freefem
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import load_result
from ffsi.report.study import Study as Sweep
from ffsi.result.quantities import flatten
from ffsi.run.sweep import sweep
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values
from ffsi.script.render import render
from studies.harness import Study, history_of, run_one, side_by_side
from studies.tables import Column, TextTable, columns, table

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
        off = f"{100 * self.within:.3g} %" if self.within else f"{self.off:.3g}"
        parts = [f"{self.value:.6g} ± {off}"] if self.value is not None else []
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
            values |= {key: flat(values.get(key, {})) for key in ("set", "vary")}
            expect = tuple(Expectation(**item) for item in values.pop("expect", []))
            entries[f"{group}-{name}"] = Entry(id=f"{group}-{name}", expect=expect, **values)
    for entry in entries.values():
        if missing := [item.per for item in entry.expect if item.per and item.per not in entries]:
            raise ValueError(f"{entry.id} compares with {missing[0]}, which is not there")
    return titles, entries


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


RUNS = Path("runs/hard")
# Runs: each in a folder of its own, several at a time, and none twice -------------------------------------------------

INVALID, ERROR = "refused", "error"
"""Failures beside those of a Result: a scene that is not accepted; a fault of the program."""
KILLED = "FreeFEM died (killed)"
"""From outside: it is to run again."""


@dataclass(frozen=True)
class Outcome:
    """What became of an entry, as its file `ID.json` has it."""

    entry: Entry  # what was run
    directory: Path  # the run folder, or that of the sweep
    failure: str  # as of a Result, or `INVALID` or `ERROR`; of a sweep that of its first failed point
    reason: str = ""  # of it, in words
    warnings: Sequence[str] = ()  # what the program said beside the result
    # Numbers (SI) of the run, or of each point of the sweep: none of one that was not solved.
    rows: Sequence[Mapping[str, float | None]] = ()
    seconds: float = 0.0  # of wall-clock time
    freefem: Mapping[str, str] | None = None  # version and solver

    def value(self, name: str, row: int | None = None) -> float:
        """Return a number (SI) of a row, by default of the last solved one; NaN where there is none."""
        solved = [point for point in self.rows if point]
        if name == "points":
            return float(len(solved))
        try:
            found = (solved[-1] if row is None else self.rows[row]).get(name)
        except IndexError:
            found = None
        return math.nan if found is None else float(found)

    @cached_property
    def history(self) -> pd.DataFrame:
        """One row per step; no rows where there were none."""
        return history_of(self.directory)


def run_all(entries: Sequence[Entry], runs: Path, jobs: int = 1) -> dict[str, Outcome]:
    """Run entries, `jobs` at a time, or read what the present scene, script and limit have left; return all by id."""
    find_freefem()
    runs.mkdir(parents=True, exist_ok=True)
    return side_by_side({entry.id: partial(run, entry, runs) for entry in entries}, jobs, "verify --hard")


def run(entry: Entry, runs: Path, on_event: OnEvent | None = None) -> Outcome:
    """Run an entry, or read what an earlier call has found."""
    file, directory = runs / f"{entry.id}.json", runs / entry.id
    begin = time.perf_counter()
    try:
        scene = entry.scene()
        digest = _digest(entry, scene)
        known = folder.read_json(file) if file.is_file() else {}
        if known.get("digest") == digest and "outcome" in known:
            return Outcome(entry, directory, **known["outcome"])
        if known.get("digest") != digest and directory.exists():
            shutil.rmtree(directory)
        folder.write_json(file, {"digest": digest})  # a run in time that is killed goes on
        found = _found(entry, scene, directory, on_event)
    except FreeFEMNotFound:
        raise
    except (SceneError, InputError) as error:
        return Outcome(entry, directory, INVALID, str(error))
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = f"{type(error).__name__}: {error} ({Path(where.filename).name}, line {where.lineno})"
        return Outcome(entry, directory, ERROR, reason)
    found["seconds"] = round(time.perf_counter() - begin, 2)
    if KILLED not in found["reason"]:
        folder.write_json(file, {"digest": digest, "outcome": found})
    return Outcome(entry, directory, **found)


def _digest(entry: Entry, scene: Scene) -> str:
    """Return what says whether an entry must run again: its own values and files, and the script of today."""
    found = hashlib.sha256(repr((entry.case, dict(entry.set), dict(entry.vary), entry.limit)).encode())
    found.update(render(scene, mumps=find_freefem().has_mumps).encode())
    for path in [] if entry.case in CASES else sorted((DATA / entry.case).parent.iterdir()):
        found.update(path.read_bytes())
    return found.hexdigest()


def _found(entry: Entry, scene: Scene, directory: Path, on_event: OnEvent | None) -> dict[str, Any]:
    """Run an entry, a scene or a sweep; return what became of it by the attributes of an `Outcome`."""
    if not entry.vary:
        points = [run_one(entry.id, scene, directory, on_event).data]
        rows = [_numbers(points[0])]
    else:
        table, swept = sweep(scene, entry.vary, directory, on_event=on_event), Sweep(directory)
        points = [swept.result(row).data for row in range(len(table))]
        rows = [{} if data["failure"] else {**data["varied"], **_numbers(data)} for data in points]
    data = next((data for data in points if data["failure"]), points[0])
    unchecked = not data["failure"] and not data.get("checked", data.get("check"))
    return {
        "failure": ERROR if unchecked else data["failure"],
        "reason": "nobody checked it" if unchecked else data.get("reason") or "",
        "warnings": list(dict.fromkeys(text for data in points for text in data.get("warnings", []))),
        "rows": rows,
        "freefem": data.get("freefem", {}),
    }


def _numbers(data: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of a run: its quantities, in time those of the last state too, and what it took."""
    quantities, in_time = data.get("quantities") or {}, data.get("time") or {}
    energy, smallest = in_time.get("energy") or {}, quantities.get("min_jacobian")
    found = {**flatten(quantities), **flatten(in_time.get("last") or {})}
    found |= {} if smallest is None else {"min_jacobian": float(smallest)}
    found |= {"imbalance": abs(energy["imbalance"])} if "imbalance" in energy else {}
    found |= {key: float(value) for key, value in (data.get("newton") or {}).items()}
    return {key: value for key, value in found.items() if math.isfinite(value)}


# Verdicts: what an outcome is worth beside what is expected -----------------------------------------------------------

SOLVED, REFUSED, FAILED = "solved", "refused rightly", "failed"
WRONG, CAUSE, NO_CLAIM = "wrong", "cause wrong or missing", "no claim"
VERDICTS = (SOLVED, REFUSED, FAILED, WRONG, CAUSE, NO_CLAIM)
GOOD = (SOLVED, REFUSED, NO_CLAIM)
COSTS = ("iterations", "factorizations", "imbalance", "points")
"""Numbers that make a result not wrong, but failed."""


class Verdict(NamedTuple):
    """A verdict, one of `VERDICTS`, and what came out beside what is expected, or the reason of the failure."""

    word: str
    shown: Sequence[str]


def judge(own: Outcome, outcomes: Mapping[str, Outcome]) -> Verdict:
    """Return the verdict on an outcome; `outcomes` holds those that it is compared with."""
    entry, said, failed = own.entry, "; ".join([own.reason, *own.warnings]), [own.reason or own.failure]
    if own.failure == ERROR:
        return Verdict(FAILED, failed)
    if entry.unlike and re.search(entry.unlike, said):
        return Verdict(CAUSE, [said])
    words, shown = _compared(own, outcomes)
    if own.failure and not (entry.vary and WRONG in words):
        words, shown = [_of_failure(own)], failed
    elif entry.outcome == "fails":
        words = [WRONG]
    elif entry.warns and not any(re.search(entry.warns, text) for text in own.warnings):
        words, shown = [CAUSE], [f"no warning of {entry.warns!r}", *shown]
    elif entry.outcome == "open":
        words = [NO_CLAIM]
    return Verdict(next((word for word in (WRONG, FAILED, CAUSE, NO_CLAIM, REFUSED) if word in words), SOLVED), shown)


def _of_failure(own: Outcome) -> str:
    entry = own.entry
    if entry.outcome in ("solves", "open"):
        return FAILED if entry.outcome == "solves" else NO_CLAIM
    said = [own.reason.partition("; last progress")[0], *own.warnings]
    if any(re.search(entry.reason, text) for text in said):
        return REFUSED
    return FAILED if own.failure == "crash" else CAUSE


def _compared(own: Outcome, outcomes: Mapping[str, Outcome]) -> tuple[list[str], list[str]]:
    """Return a verdict and a text for each expectation."""
    words, shown = [], []
    for item in own.entry.expect:
        other = outcomes.get(item.per)
        if item.per and (other is None or other.failure):
            words.append(NO_CLAIM)
            shown.append(f"{item.of}: nothing to compare with, {item.per} is not solved")
            continue
        x = measure(item, own, other)
        missing = bool(own.failure) and math.isnan(x)  # a point that is not solved has no wrong number
        words.append(SOLVED if item.holds(x) else FAILED if missing or numbers_of(item.of)[1] in COSTS else WRONG)
        beside = f" / {f'{item.times:g} ' if item.times != 1 else ''}{item.per}" if item.per else ""
        shown.append(f"{item.of}{beside} = {x:.6g} ({item.text})")
    return words, shown


def measure(item: Expectation, own: Outcome, other: Outcome | None) -> float:
    """Return the number x of an expectation; NaN where there is none.

    `path NAME`: largest difference of two histories over the largest value of that of `other`, to which it is brought
    linearly at the times of the own one.
    """
    form, name, *_ = numbers_of(item.of)
    if form == "path":
        if other is None or any(name not in each.history or each.history.empty for each in (own, other)):
            return math.nan
        values = item.times * other.history[name].to_numpy(dtype=np.float64)
        beside = np.interp(own.history["time"], other.history["time"], values)
        return float(np.abs(own.history[name] - beside).max() / np.abs(values).max())
    x = _number(item.of, own)
    y = 1.0 if other is None else item.times * _number(item.per_of or item.of, other)
    return x / y if y else math.nan


def _number(of: str, outcome: Outcome) -> float:
    form, name, time, row, point = numbers_of(of)
    if point is not None:
        with contextlib.suppress(InputError, ValueError, KeyError):
            return load_result(outcome.directory).at(*point)[name]
        return math.nan
    if form == "rise":
        values = [outcome.value(name, i) for i, point in enumerate(outcome.rows) if point]
        return float(np.diff(values).min()) if len(values) > 1 else math.nan
    if time is None and form != "max":
        return abs(outcome.value(name, row)) if form == "size" else outcome.value(name, row)
    history = outcome.history
    if name not in history or history.empty:
        return math.nan
    if form == "max":
        return float(np.abs(history[name].to_numpy(dtype=np.float64)).max())
    return float(np.interp(time or 0.0, history["time"], history[name]))


# What is written ------------------------------------------------------------------------------------------------------


def main(*, jobs: int = 1, out: Path | None = None, runs: Path = RUNS, only: str | None = None) -> list[str]:
    """Run the hard cases (`only` such as `h-*,k-creep`), and write all down; what is wrong is the failure `check`."""
    study = Study("verify --hard" + (f" --only '{only}'" if only else ""), out, name="hard")
    titles, entries = load()
    outcomes = run_all(select(entries, only), runs, jobs)
    verdicts = {name: judge(outcome, outcomes) for name, outcome in outcomes.items()}
    frame = pd.DataFrame([_row(outcome, verdicts[name]) for name, outcome in outcomes.items()])
    bad = frame[~frame["verdict"].isin(GOOD)].to_dict("records")
    groups = frame["id"].str.partition("-")[0]
    rows = []
    for title, own in [*((title, frame[groups == key]) for key, title in titles.items()), ("all", frame)]:
        found = Counter(own["verdict"])
        rows += [[title, str(len(own)), *(str(found[word] or "") for word in VERDICTS)]] if len(own) else []
    counted, wrong = TextTable(["group", "cases", *VERDICTS], rows), table(bad, WRONG_COLUMNS, left=3)
    tables = {
        title: table(frame[groups == group].to_dict("records"), CASE_COLUMNS, left=4)
        for group, title in titles.items()
        if (groups == group).any()
    }
    study.finish(
        [{"freefem": outcome.freefem} for outcome in outcomes.values()], [counted, *([wrong] if bad else [])],
        {"hard.csv": lambda: frame}, None, counted=counted, wrong=wrong, groups=tables,
    )  # fmt: skip
    known = frame["failure"].isin(("not-converged", "not-reached", "stopped", "crash"))
    failures = frame["failure"].where((frame["verdict"] == FAILED) & known, "check")
    return failures.where(~frame["verdict"].isin(GOOD), "").tolist()


def _shown(row: Mapping[str, Any]) -> str:
    text = str(row["shown"]).replace("|", "\\|").replace("\n", " ")
    return text if len(text) < 300 else f"{text[:297]}..."


WRONG_COLUMNS = (*columns("not as expected = id | verdict"), Column("what came out", _shown))
CASE_COLUMNS = (
    *columns("case = id | what | verdict"),
    Column("came out (expected), or the reason", _shown),
    *columns("iterations :.0f | min J = min_jacobian :.3f"),
    Column("s", lambda row: row["seconds"] or None, "{:.1f}"),
)


def _row(outcome: Outcome, verdict: Verdict) -> dict[str, Any]:
    entry = outcome.entry
    return {
        "id": entry.id, "what": entry.what, "case": entry.case, "set": json.dumps(dict(entry.set)),
        "vary": json.dumps(dict(entry.vary)) if entry.vary else "", "expected": entry.outcome, "why": entry.why,
        "note": entry.note, "verdict": verdict.word, "shown": "; ".join(verdict.shown), "failure": outcome.failure,
        "reason": outcome.reason, "warnings": "; ".join(outcome.warnings), "iterations": outcome.value("iterations"),
        "min_jacobian": outcome.value("min_jacobian"), "seconds": outcome.seconds,
    }  # fmt: skip
