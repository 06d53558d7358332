"""What an outcome of a hard case is worth beside what is expected."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from studies.verification.hard_entries import Expectation, numbers_of
from studies.verification.hard_runs import ERROR, Outcome

SOLVED, REFUSED, FAILED = "solved", "refused rightly", "failed"
WRONG, CAUSE, NO_CLAIM = "wrong", "cause wrong or missing", "no claim"
VERDICTS = (SOLVED, REFUSED, FAILED, WRONG, CAUSE, NO_CLAIM)
GOOD = (SOLVED, REFUSED, NO_CLAIM)
COSTS = ("iterations", "factorizations", "imbalance", "points")
"""Numbers that make a result not wrong, but failed."""


@dataclass(frozen=True)
class Verdict:
    """A verdict, and what it rests on.

    Attributes:
        word: one of `VERDICTS`.
        shown: what came out beside what is expected, one text per expectation; or the reason of the failure.
    """

    word: str
    shown: Sequence[str]


def judge(own: Outcome, outcomes: Mapping[str, Outcome]) -> Verdict:
    """Return the verdict on an outcome; `outcomes` holds those that it is compared with."""
    entry = own.entry
    said = "; ".join([own.reason, *own.warnings])
    failed = [own.reason or own.failure]
    if own.failure == ERROR:
        return Verdict(FAILED, failed)
    if entry.unlike and re.search(entry.unlike, said):
        return Verdict(CAUSE, [said])
    words, shown = _compared(own, outcomes)
    if own.failure and not (entry.vary and WRONG in words):
        shown = failed
        words = [_of_failure(own)]
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
        beside = f"{f'{item.times:g} ' if item.times != 1 else ''}{item.per}" if item.per else ""
        shown.append(f"{item.of}{f' / {beside}' if beside else ''} = {x:.6g} ({item.text})")
    return words, shown


def measure(item: Expectation, own: Outcome, other: Outcome | None) -> float:
    """Return the number x of an expectation; NaN where there is none.

    `path NAME`: largest difference of two histories over the largest value of that of `other`, to which it is brought
    linearly at the times of the own one.
    """
    form, name, *_ = numbers_of(item.of)
    if form == "path":
        return math.nan if other is None else _path(name, own, other, item.times)
    x = _number(item.of, own)
    y = 1.0 if other is None else item.times * _number(item.per_of or item.of, other)
    return x / y if y else math.nan


def _number(of: str, outcome: Outcome) -> float:
    form, name, time, row, point = numbers_of(of)
    if point is not None:
        return outcome.at(name, point)
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


def _path(name: str, own: Outcome, other: Outcome, times: float) -> float:
    if any(name not in outcome.history or outcome.history.empty for outcome in (own, other)):
        return math.nan
    values = times * other.history[name].to_numpy(dtype=np.float64)
    beside = np.interp(own.history["time"], other.history["time"], values)
    return float(np.abs(own.history[name] - beside).max() / np.abs(values).max())
