"""Functions by straight lines between samples, such as those of a CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, short
from ffsi.scene.expressions import Expression
from ffsi.scene.json_schema import at, every
from ffsi.scene.units import Number
from ffsi.scene.waveforms import read_samples

FEWEST, MOST = 2, 100


class Samples(Table):
    """A function by straight lines between samples; beyond them it keeps the value of the nearest one."""

    model_config = ConfigDict(
        json_schema_extra=every(at(key, {"minItems": FEWEST, "maxItems": MOST}) for key in ("at", "value"))
    )

    at: tuple[Number, ...] = Field(description="numbers of s or m where the samples are, increasing, dimensionless")
    value: tuple[Number, ...] = Field(description="their values, dimensionless")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not FEWEST <= len(self.at) <= MOST:
            refuse([Problem("at", f"accepted: {FEWEST} to {MOST} numbers", short(self.at))])
        if len(self.value) != len(self.at):
            refuse([Problem("value", f"accepted: as many numbers as at, {len(self.at)}", short(self.value))])
        if (np.diff(self.at) <= 0).any():
            refuse([Problem("at", "accepted: increasing numbers", short(self.at))])
        return self

    def expression(self, *variables: str) -> Expression:
        """Return it as a formula in the first of some variables."""
        return Expression.polygon(self.at, self.value, variables)


def samples_of(name: str, key: str, column: str) -> dict[str, Any]:
    """Return what the samples of a file, with the columns ``column`` and value, put in the place of its name."""
    try:
        where, values = read_samples(Path(name), [column, "value"], FEWEST)
        if len(where) > MOST:
            raise ValueError(f"{len(where)} rows; at most {MOST} are accepted")
    except ValueError as error:
        refuse([Problem(f"{key}_file", str(error), short(name))])
    found = Samples(at=tuple(where.tolist()), value=tuple(values.tolist()))
    return {f"{key}_file": None, f"{key}_samples": found}
