"""The table of a sweep, `sweep.csv`: one row per point."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.result import study_definition
from ffsi.result.evaluation import words
from ffsi.result.quantities import check_maximum, flatten, unit
from ffsi.result.result import PlainResult
from ffsi.result.study_definition import Values, points_of
from ffsi.scene.lookup import unit_of

if TYPE_CHECKING:
    import pandas as pd

TABLE, UNITS = "sweep.csv", "sweep.units.csv"


def place(values: Values, keys: Sequence[str]) -> tuple[Any, ...]:
    """Return what tells a point of a sweep from the others."""
    return tuple(values.get(key) for key in keys)


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
        **extremes(result.data),
        **{f"{name}_error": error["bar"] for name, error in (result.data.get("errors") or {}).items()},
        **{
            f"{name}_by_{key}": slopes[key]["derivative"]
            for name, slopes in (result.data.get("sensitivities") or {}).items()
            for key in values
            if key in slopes
        },
        **{f"reached_{name}": value for name, value in result.reached.items()},
        "check_maximum": None if math.isnan(worst) else worst,
        **({"not_evaluated": "; ".join(map(words, result.not_evaluated))} if result.not_evaluated else {}),
        "seconds": result.data.get("timings", {}).get("total"),
        "folder": os.path.relpath(result.directory, directory),
        "point": result.point,
    }


def extremes(data: Mapping[str, Any]) -> dict[str, float]:
    """Return `drag_last`, `drag_min`, `drag_max` and so on of a run in time that was not failed; else nothing."""
    if data.get("failure") or not isinstance(time := data.get("time"), Mapping):
        return {}
    parts = {"last": time.get("last"), "min": time.get("smallest"), "max": time.get("largest")}
    return {
        f"{name}_{part}": float(values[name])
        for name in parts["max"] or {}
        for part, values in parts.items()
        if isinstance(values, Mapping) and name in values
    }


def units(table: pd.DataFrame, keys: Sequence[str]) -> dict[str, str]:
    """Return the SI unit of every column of numbers, `1` without dimension."""
    import pandas as pd

    own = {"check_maximum": "1", "seconds": "s", **{key: unit_of(key) or "1" for key in keys}}
    names = [name for name in table.columns if pd.api.types.is_numeric_dtype(table[name]) and name != "point"]
    names = [name for name in names if table[name].dtype != bool]
    return {name: own.get(name) or own.get(name.removeprefix("reached_")) or unit(name) for name in names}


def frame(
    directory: Path, keys: Sequence[str], order: Sequence[Values], known: Mapping[tuple[Any, ...], PlainResult]
) -> pd.DataFrame:
    """Return the table: the results that are known by their values, in the order of the sweep.

    Its `attrs["units"]` are the units of its columns.
    """
    import pandas as pd

    rows = [row(known[at], each, directory) for each in order if (at := place(each, keys)) in known]
    first = [*keys, "status", "checked", "reason", "failure", "warnings"]
    last = ["check_maximum", "seconds", "folder", "point"]
    middle = dict.fromkeys(key for item in rows for key in item if key not in (*first, *last))
    ordered = sorted(middle, key=lambda name: name.startswith("reached_"))
    table = pd.DataFrame(rows, columns=[*first, *ordered, *last])
    table.attrs["units"] = units(table, keys)
    return table


def problems(directory: Path) -> list[str]:
    """Return what in a sweep's own files, `sweep.toml` and `sweep.csv`, does not fit the results in its chains.

    Raises:
        InputError: a result cannot be read.
    """
    results = PlainResult.load_all(directory, believe=True)
    again = "; the same call of ffsi sweep mends it"
    try:
        definition = study_definition.read(directory)
        keys = list(definition["vary"])
        known = {place(result.data["varied"], keys): result for result in results}
        text = frame(directory, keys, points_of(definition), known).to_csv(index=False).encode("utf-8")
        path = directory / TABLE
        if not path.is_file():
            return [f"{path} is missing{again}"]
        return [] if path.read_bytes() == text else [f"{path} is not the table of the results in its chains{again}"]
    except InputError as error:
        return [str(error)]
    except (KeyError, TypeError, AttributeError) as error:
        return [f"{directory}: its results are not those of its {folder.SWEEP} ({error})"]
