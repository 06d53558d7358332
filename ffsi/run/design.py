"""The points of a study: from what a user varies to values in SI that the scene accepts, all checked beforehand."""

from __future__ import annotations

import itertools
import math
import numbers
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np
import pandas as pd
from pydantic_core import PydanticCustomError

from ffsi.files.arguments import Design, count_of
from ffsi.files.errors import InputError
from ffsi.result.study_definition import Values, points_of
from ffsi.scene import Scene, SceneError, with_values
from ffsi.scene.errors import Problem, short
from ffsi.scene.lookup import Scalar, plain, rules
from ffsi.text import cut, nearest

Columns = dict[str, list[Scalar | None]]

MAXIMUM_POINTS = 100_000
_ALL_CHECKED = 5_000
"""Points that are checked one by one before the first runs; of more, their corners are."""
_NO_LIST = (str, bytes, bytearray, memoryview, Mapping, set, frozenset)
_RANGE = "accepted: a range (low, high) of numbers in SI or texts with a unit, low < high"


def columns_of(
    scene: Scene, vary: Any, design: str = "product", samples: int | None = None, seed: int | None = None
) -> tuple[dict[str, Any], list[Values]]:
    """Return what a study varies, as its definition has it, and its points, each once, in SI.

    Args:
        scene: where all other values come from.
        vary: values by dotted key; or the points: a DataFrame, or a list of mappings. A point may leave keys out.
        design: `product` or `zip` of the values, or samples of ranges (low, high): `latin-hypercube` or `sobol`.
        samples: points of a sample.
        seed: of a sample; None is 0, so that the same call means the same points.

    Raises:
        InputError: `vary`, `design`, `samples` or `seed` is not accepted.
        SceneError: keys and values that the scene does not accept: all of them, each with its first point.
    """
    if design not in get_args(Design):
        known = ", ".join(f'"{name}"' for name in get_args(Design))
        hint = f' (did you mean "{guess}"?)' if (guess := nearest(str(design), get_args(Design))) else ""
        raise InputError(f"design = {design!r}: accepted: {known}{hint}")
    sampled = design in ("latin-hypercube", "sobol")
    if not sampled and (samples is not None or seed is not None):
        raise InputError('samples and seed belong to the designs "latin-hypercube" and "sobol"')
    if isinstance(vary, Mapping):
        table = {key: _values(key, values) for key, values in _named(vary.items()).items()}
    elif sampled or design == "zip":
        raise InputError(f'vary: with design = "{design}" accepted: a mapping of keys, not {type(vary).__name__}')
    else:
        table, design = _listed(vary), "zip"
    if not table or not all(table.values()):
        raise InputError("a sweep needs at least one varied key with at least one value")
    if scene.time is None and (late := next((key for key in table if key.startswith("time.")), None)):
        raise InputError(f"vary {cut(late)}: the scene is steady; give it a table time first (--set, with_values)")
    if sampled:
        table = _sample(table, design, count_of(samples, "samples"), _seed(seed))
    elif design == "zip" and len({len(values) for values in table.values()}) > 1:
        counts = ", ".join(f"{key} {len(values)}" for key, values in table.items())
        raise InputError(f'vary: the design "zip" needs as many values of every key, given: {counts}')
    if design == "product":
        for key, values in table.items():
            if None in values:
                raise InputError(f"vary {key}: a value is missing (None or NaN)")
        _check_count([len(values) for values in table.values()])
    else:
        if empty := next((key for key, values in table.items() if all(value is None for value in values)), None):
            raise InputError(f"vary {cut(empty)}: no point has a value of it")
        _check_count([len(next(iter(table.values())))])
    canonical = {key: [_canonical(value, rules(key)) for value in values] for key, values in table.items()}
    if design == "product":
        canonical = {key: [value for value, _ in _once(values)] for key, values in canonical.items()}
        definition: dict[str, Any] = {"design": "product", "vary": canonical}
    else:
        once = _once(zip(*canonical.values(), strict=True))
        canonical = {key: [row[i] for row, _ in once] for i, key in enumerate(canonical)}
        definition = {
            "design": "points",
            "vary": {k: ["" if v is None else v for v in c] for k, c in canonical.items()},
        }
    points = points_of(definition)
    numbers = range(1, len(points) + 1) if design == "product" else [place for _, place in once]
    if not all(points):
        raise InputError(f"point {numbers[points.index({})]} of the study sets no key")
    _check(scene, points, numbers)
    return definition, points


def _key(key: object) -> str:
    if not isinstance(key, str) or not key.strip():
        raise InputError(f"vary: accepted: dotted keys such as 'mesh.level', not {key!r}")
    return key.strip()


def _named(items: Iterable[tuple[object, Any]]) -> dict[str, Any]:
    """Return what stands under keys, of which none may come twice."""
    found: dict[str, Any] = {}
    for key, values in items:
        if (name := _key(key)) in found:
            raise InputError(f"vary: {cut(name)} comes twice")
        found[name] = values
    return found


def _once(values: Iterable[Any]) -> list[tuple[Any, int]]:
    """Return each value once, with its first place, from 1; a truth value is no number."""
    found: dict[Any, tuple[Any, int]] = {}
    for place, value in enumerate(values, start=1):
        parts = value if isinstance(value, tuple) else (value,)
        found.setdefault(tuple((isinstance(part, bool), part) for part in parts), (value, place))
    return list(found.values())


def _values(key: str, values: Any) -> list[Scalar | None]:
    """Return the values of one key as Python's own numbers, texts and truth values; None where one is missing."""
    # (The order of a set is another one in the next process.)
    several = isinstance(values, Iterable) and not isinstance(values, _NO_LIST)
    if not several or getattr(values, "ndim", 1) != 1:
        accepted = "accepted: a list of numbers, texts with a unit, names or truth values, such as [0.02, '4 cm/s']"
        raise InputError(f"vary {key} = {cut(repr(values), 60)}: {accepted}")
    if getattr(values, "__len__", lambda: 0)() > MAXIMUM_POINTS:
        raise InputError(f"vary {key}: more than {MAXIMUM_POINTS} values")
    return [_value(key, value) for value in itertools.islice(values, MAXIMUM_POINTS + 1)]


def _value(key: str, value: Any) -> Any:
    try:
        value = None if value is np.ma.masked else plain(value)
    except (ValueError, OverflowError):  # of a signalling NaN
        raise InputError(f"vary {key} = {cut(repr(value), 60)}: accepted: a finite number") from None
    if value is None or value is pd.NA or value is pd.NaT or (isinstance(value, float) and math.isnan(value)):
        return None
    if isinstance(value, str | bool | numbers.Real) or np.ndim(getattr(value, "magnitude", ())) == 0:
        return value
    raise InputError(f"vary {key} = {cut(repr(value), 60)}: accepted: a number, a text or a truth value")


def _listed(points: Any) -> dict[str, list[Any]]:
    """Return points that are given as rows, column by column."""
    if isinstance(points, pd.DataFrame):
        return {key: _values(key, values) for key, values in _named(points.items()).items()}
    if not isinstance(points, Sequence) or isinstance(points, str) or not all(isinstance(p, Mapping) for p in points):
        accepted = "accepted: keys and their values, such as {'mesh.level': [0, 1]}, a DataFrame or a list of mappings"
        raise InputError(f"vary: {accepted}, not {cut(repr(points), 60)}")
    rows = [_named(point.items()) for point in points]
    keys = dict.fromkeys(key for row in rows for key in row)
    return {key: [_value(key, row.get(key)) for row in rows] for key in keys}


def _check_count(counts: Sequence[int]) -> None:
    if (count := math.prod(counts)) > MAXIMUM_POINTS:
        sizes = f"{' x '.join(map(str, counts))} = " if len(counts) > 1 else ""
        raise InputError(f"the sweep has {sizes}{words_of_count(count)} points, more than {MAXIMUM_POINTS}")


def words_of_count(count: int) -> str:
    """Return a number of points that may have hundreds of digits."""
    return str(count) if count < 10**9 else f"about 1e{len(str(count)) - 1}"


def _canonical(value: Any, accepted: Sequence[Any]) -> Any:
    """Return a value as the scene has it: in SI, as its type; as it is what is not accepted, which is told later."""
    for rule in accepted:
        try:
            return rule(value) if value is not None else None
        except PydanticCustomError:
            continue
    try:
        return float(value) if isinstance(value, numbers.Real) and not isinstance(value, int) else value
    except OverflowError:  # of a fraction
        return math.inf


def _seed(seed: Any) -> int:
    if seed is None:
        return 0
    if isinstance(seed, numbers.Integral) and not isinstance(seed, bool) and int(seed) >= 0:
        return int(seed)
    raise InputError(f"seed = {seed!r}: accepted: a whole number from 0 on")


def _sample(table: Mapping[str, Sequence[Any]], design: str, samples: int, seed: int) -> dict[str, list[Any]]:
    from scipy.stats import qmc

    _check_count([samples])
    ranges = {}
    for key, values in table.items():
        found = [_canonical(value, rules(key)) for value in values]
        if len(found) != 2 or not all(isinstance(v, float) for v in found) or not found[0] < found[1]:
            shown = ", ".join(short(value) for value in values[:3]) + (", ..." if len(values) > 3 else "")
            raise InputError(f'vary {key} = ({shown}): with design = "{design}" {_RANGE}')
        ranges[key] = found
    engine = (qmc.LatinHypercube if design == "latin-hypercube" else qmc.Sobol)(len(ranges), seed=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the balance of Sobol's sequence needs a power of 2
        scaled = qmc.scale(engine.random(samples), *zip(*ranges.values(), strict=True))
    return {key: column.tolist() for key, column in zip(ranges, scaled.T, strict=True)}


def _check(scene: Scene, points: Sequence[Values], numbers: Sequence[int]) -> None:
    """Raise all that the scene does not accept; each problem once, with its first point.

    More than 5000 points take a while to check: of those the corners of the box of their numbers are, for each choice
    of texts, and only if one is refused all points. (Single values have passed their own bounds before; what a scene
    asks of several values together is monotonous in each of them.) A point is checked again before it runs.
    """
    if len(points) > _ALL_CHECKED and not _problems(scene, _corners(points), itertools.count(1)):
        return
    if found := _problems(scene, points, numbers):
        raise SceneError(list(found.values()))


def _problems(
    scene: Scene, points: Iterable[Values], numbers: Iterable[int]
) -> dict[tuple[str, str | None, str], Problem]:
    found: dict[tuple[str, str | None, str], Problem] = {}
    for number, values in zip(numbers, points, strict=False):
        try:
            with_values(scene, values)
        except SceneError as error:
            for problem in error.problems:
                text = f"{problem.message} (point {number})"
                at = (problem.key, problem.value, problem.message)
                found.setdefault(at, Problem(problem.key, text, problem.value, problem.nearest))
    return found


def _corners(points: Sequence[Values]) -> list[Values]:
    boxes: dict[tuple[Any, ...], dict[str, tuple[float, float]]] = {}
    for values in points:
        texts = tuple((key, value if isinstance(value, str | bool) else None) for key, value in values.items())
        box = boxes.setdefault(texts, {})
        for key, value in values.items():
            if not isinstance(value, str | bool):
                low, high = box.get(key, (value, value))
                box[key] = min(low, value), max(high, value)
    if any(len(box) > 10 for box in boxes.values()) or len(boxes) > _ALL_CHECKED:
        return list(points)
    return [
        {key: text if text is not None else dict(zip(box, corner, strict=True))[key] for key, text in texts}
        for texts, box in boxes.items()
        for corner in itertools.product(*box.values())
    ]
