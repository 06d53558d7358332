"""What is known about a case: published values and closed-form ones (ffsi/data, studies/data)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pandas as pd

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
        reference = self.values.get(quantity, math.nan)
        return (value - reference) / abs(reference)

    def errors(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the relative error of each value (SI) that the source has."""
        return {name: self.error(name, values[name]) for name in self.values if name in values}


@cache
def reference_sets(case: str, variant: str = "") -> list[ReferenceSet]:
    """Return what is known about a variant of a case, published values first; those with an amplitude are left out."""
    published = {} if variant else references(case)
    steady = {name: item.mean for name, item in published.items() if item.amplitude is None and item.mean is not None}
    found = [ReferenceSet("Featflow" if case.startswith("turek") else "DFG", steady)] if steady else []
    table = pd.read_csv(FURTHER, dtype=str, keep_default_na=False)
    own = table[(table["case"] == case) & (table["variant"] == variant)]
    for (source, use), rows in own.groupby(["source", "use"], sort=False):
        values = dict(zip(rows["quantity"], rows["value"].astype(float), strict=True))
        found.append(ReferenceSet(str(source), values, use == "error"))
    return found


def compared(case: str, variant: str = "") -> list[ReferenceSet]:
    """Return the sources that the errors of a case are taken against."""
    return [source for source in reference_sets(case, variant) if source.compared]
