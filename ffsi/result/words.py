"""What became of a run or a sweep, in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


# What became of a point, by its `failure`.
OUTCOMES = {
    "check": "failed the check",
    "crash": "FreeFEM died",
    "not-reached": "not reached",
    "not-converged": "not converged",
    "stopped": "stopped before its end",
}


def time_line(data: Mapping[str, Any]) -> str:
    """Return how far a computation in time came, and whether it is periodic or how much its last cycles differ."""
    in_time = data["time"]
    why_not = f" ({in_time['why_not']})" if in_time.get("why_not") else ""
    ending = "periodic" if in_time["periodic"] else f"not periodic{why_not}"
    last = (data.get("cycles") or [{}])[-1]
    if last.get("tawss_change") is not None:
        differ = f"TAWSS of cycle {last['number']} differs by {last['tawss_change']:.1e} from the cycle before"
        ending = f"periodic, {differ}" if in_time["periodic"] else differ
    balance = in_time.get("energy") or {}
    energy = f", energy balance within {abs(balance['imbalance']):.1e}" if balance else ""
    for each in in_time.get("changed", []):
        values = ", ".join(f"{key} = {value}" for key, value in each["settings"].items())
        energy += f"; from t = {each['time']:g} s on {values}"
    return f"t = {in_time['reached']:g} of {in_time['end']:g} s, {in_time['steps']} steps, {ending}{energy}"


def tally(table: pd.DataFrame, planned: int = 0) -> tuple[str, bool]:
    """Return how many points of `sweep.csv` are solved and checked, and what of the others; and whether all are.

    `planned` is the number of the sweep's points, if it is known.
    """
    checked = table["checked"].eq(True) if "checked" in table else table["check_maximum"].notna()
    found: dict[str, int] = {}
    for status, failure, passed in zip(table["status"], table["failure"], checked, strict=True):
        solved = "" if passed else "solved, not checked"
        words = solved if status == "converged" else OUTCOMES.get(failure, "not converged")
        found[words] = found.get(words, 0) + 1
    good, count = found.pop("", 0), max(planned, len(table))
    if good == count:
        return f"all {count} points solved and checked", True
    if count > len(table):
        found["not computed"] = count - len(table)
    others = [f"{number} {words}" for words, number in found.items()]
    return "; ".join([f"{good} of {count} points solved and checked", *others]), False
