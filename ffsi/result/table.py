"""The table of a sweep, `sweep.csv`: one row per point."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.result import sweep_definition
from ffsi.result.evaluation import words
from ffsi.result.quantities import check_maximum, flatten
from ffsi.result.result import PlainResult

Values = dict[str, float]

TABLE = "sweep.csv"

MAXIMUM_POINTS = 100_000


def check_count(vary: Mapping[str, Sequence[float]]) -> None:
    """Count the points of a sweep before one of them is made.

    Raises:
        InputError: more than MAXIMUM_POINTS.
    """
    count = math.prod(len(values) for values in vary.values())
    if count > MAXIMUM_POINTS:
        sizes = " x ".join(str(len(values)) for values in vary.values())
        raise InputError(f"the sweep has {sizes} = {words_of_count(count)} points, more than {MAXIMUM_POINTS}")


def points(vary: Mapping[str, Sequence[float]]) -> list[Values]:
    """Return the cartesian product of `vary`, the last key changing fastest."""
    return [dict(zip(vary, values, strict=True)) for values in itertools.product(*vary.values())]


def row(result: PlainResult, values: Values, directory: Path) -> dict[str, Any]:
    """Return the table's row of one point."""
    worst = check_maximum(result.data)
    return {
        **values,
        "status": result.status,
        "checked": result.checked,
        "reason": result.reason,
        "failure": result.failure,
        "warnings": "; ".join(result.warnings),
        **flatten(result.quantities),
        **{f"reached_{name}": value for name, value in result.reached.items()},
        "check_maximum": None if math.isnan(worst) else worst,
        **({"not_evaluated": "; ".join(map(words, result.not_evaluated))} if result.not_evaluated else {}),
        "seconds": result.data.get("timings", {}).get("total"),
        "folder": os.path.relpath(result.directory, directory),
        "point": result.point,
    }


def frame(
    directory: Path, keys: Sequence[str], order: Sequence[Values], known: Mapping[tuple[float, ...], PlainResult]
) -> pd.DataFrame:
    """Return the table: the results that are known by their values, in the order of the sweep."""
    rows = [row(known[at], each, directory) for each in order if (at := tuple(each.values())) in known]
    first = [*keys, "status", "checked", "reason", "failure", "warnings"]
    last = ["check_maximum", "seconds", "folder", "point"]
    middle = dict.fromkeys(key for item in rows for key in item if key not in (*first, *last))
    ordered = sorted(middle, key=lambda name: name.startswith("reached_"))
    return pd.DataFrame(rows, columns=[*first, *ordered, *last])


def problems(directory: Path) -> list[str]:
    """Return what in a sweep's own files, `sweep.toml` and `sweep.csv`, does not fit the results in its chains.

    Raises:
        InputError: a result cannot be read.
    """
    results = PlainResult.load_all(directory, believe=True)
    again = "; the same call of ffsi sweep mends it"
    try:
        vary = sweep_definition.read(directory)["vary"]
        known = {tuple(result.data["varied"][key] for key in vary): result for result in results}
        text = frame(directory, list(vary), points(vary), known).to_csv(index=False).encode("utf-8")
        path = directory / TABLE
        if not path.is_file():
            return [f"{path} is missing{again}"]
        return [] if path.read_bytes() == text else [f"{path} is not the table of the results in its chains{again}"]
    except InputError as error:
        return [str(error)]
    except (KeyError, TypeError, AttributeError) as error:
        return [f"{directory}: its results are not those of its {folder.SWEEP} ({error})"]


def words_of_count(count: int) -> str:
    """Return a number of points that may have hundreds of digits."""
    return str(count) if count < 10**9 else f"about 1e{len(str(count)) - 1}"
