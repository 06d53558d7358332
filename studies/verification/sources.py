"""What is known about a case: published values and closed-form ones (ffsi/data, studies/data)."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ffsi.result.published import references
from ffsi.result.quantities import WORDS

# Quantities that have references, and their column in the tables.
NAMES = ("tip_ux", "tip_uy", "drag", "lift", "drag_coefficient", "lift_coefficient", "pressure_difference")
COLUMNS = {name: WORDS[name] for name in NAMES}
FURTHER = Path(__file__).parents[1] / "data" / "further_values.csv"


@dataclass(frozen=True)
class ReferenceSet:
    """Values of one source for one case: `values` by quantity (SI); those not `compared` are only listed."""

    source: str
    values: Mapping[str, float]
    compared: bool = True

    def error(self, quantity: str, value: float) -> float:
        """Return (value - reference) / |reference|; NaN if the source has no such quantity."""
        reference = self.values.get(quantity)
        return float("nan") if reference is None else (value - reference) / abs(reference)


def reference_sets(case: str, variant: str = "") -> list[ReferenceSet]:
    """Return what is known about a steady case, the published benchmark values first; empty if there is nothing.

    Periodic values (those with an amplitude) are left out.

    Args:
        case: name of the catalogue's case.
        variant: name of the variant; empty for the case as it stands in the catalogue.
    """
    published = {} if variant else references(case)
    steady = {name: item.mean for name, item in published.items() if item.amplitude is None and item.mean is not None}
    first = [ReferenceSet("Featflow" if case.startswith("turek") else "DFG", steady)] if steady else []
    return [*first, *_further().get((case, variant), [])]


@cache
def _further() -> dict[tuple[str, str], list[ReferenceSet]]:
    found: dict[tuple[str, str], dict[tuple[str, bool], dict[str, float]]] = {}
    text = FURTHER.read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        sources = found.setdefault((row["case"], row["variant"]), {})
        sources.setdefault((row["source"], row["use"] == "error"), {})[row["quantity"]] = float(row["value"])
    return {
        key: [ReferenceSet(source, values, compared) for (source, compared), values in sources.items()]
        for key, sources in found.items()
    }
