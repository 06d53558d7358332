"""Error bars of a run in time, from two runs beside it: on the next coarser mesh, and with twice the step."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.history import read_history
from ffsi.freefem import stop_all
from ffsi.hemodynamics.result import Result
from ffsi.result.quantities import flatten
from ffsi.result.table import extremes
from ffsi.scene import Scene, with_values

COARSER, TWICE = "coarser-mesh", "twice-the-step"
"""The run folders beside, in that of the run."""

_SAFETY = 3.0
_METHOD = "Richardson's difference to the next coarser mesh and to twice the step, times 3"
_LAST = 4
"""Ends of the longer steps, the last ones, of which that with the largest difference counts for the last value: at any
single one the difference may just pass through zero."""


def scenes_beside(scene: Scene) -> dict[str, Scene]:
    """Return by their folders' names the scenes that tell what mesh and step add to the quantities of one in time.

    Raises:
        InputError: there is no coarser mesh, or the steps are adaptive.
        SceneError: twice the step does not fit into the scene.
    """
    assert scene.time is not None
    if scene.time.adaptive:
        raise InputError("time.adaptive = true; accepted in time: false, error bars need a second step")
    if scene.mesh.level == 0:
        raise InputError("mesh.level = 0; accepted in time: 1 or more, error bars need a coarser mesh")
    step = 2 * scene.time.step
    longer = {
        f"time.{key}": step
        for key in ("output_interval", "checkpoint_interval")
        if (value := getattr(scene.time, key)) is not None and value < step
    }
    return {
        COARSER: with_values(scene, {"mesh.level": scene.mesh.level - 1}),
        TWICE: with_values(scene, {"time.step": step, **longer}),
    }


@contextlib.contextmanager
def running(
    directory: Path, scenes: Mapping[str, Scene], run: Callable[[Scene, str], Result], resume: bool
) -> Iterator[dict[str, Future[Result]]]:
    """Run scenes beside the run in a folder, by the names of theirs; without `resume` those of an earlier run go."""
    for name in (COARSER, TWICE):
        if not resume and folder.is_run_folder(directory / name):
            shutil.rmtree(directory / name)
    with ThreadPoolExecutor(max_workers=2, thread_name_prefix="ffsi-beside") as pool:
        try:
            yield {name: pool.submit(run, scene, name) for name, scene in scenes.items()}
        except BaseException:  # Ctrl-C reaches this thread only
            stop_all()
            raise


def complete(data: dict[str, Any], scene: Scene, directory: Path, beside: Mapping[str, Future[Result]]) -> None:
    """Put error bars of mean, amplitude, frequency, extrema and last values into the content of `result.json`.

    Roache's grid convergence index for two grids (ASME V&V 20): with f the value, g that of the run beside, r the ratio
    of their sizes h = 1/sqrt(triangles) or steps and p = 2 (of a backward Euler step 1), (f - g)/(r^p - 1) estimates
    the error; the bar is three times the sum of both sizes, of a last value of the largest within `_LAST` steps of the
    run with twice the step. Where a run beside was not solved there is a warning.
    """
    assert scene.time is not None
    others, expected = {}, scenes_beside(scene)
    for name, future in beside.items():
        try:
            result, why = future.result(), ""
            why = result.reason
            if not why and result.scene != expected[name]:  # only one of both was started again with other values
                why = "it was started again with other values, or the run itself; state them"
        except Exception as error:  # whatever ended it; the run itself is whole
            why = str(error)
        if why:
            data["warnings"].append(f"no error bars: {name}: {why}")
        else:
            others[name] = result
    if len(others) < len(beside) or data["failure"]:
        return
    ratio = data["triangles"] / others[COARSER].data["triangles"]
    over = {COARSER: ratio - 1.0, TWICE: 1.0 if scene.time.scheme == "backward-euler" else 3.0}
    known = {name: _values(other.data) for name, other in others.items()}
    tables = {name: other.history for name, other in others.items()}
    own = read_history(directory)
    instants = own["time"].iloc[-1] - 2 * scene.time.step * np.arange(_LAST)

    def largest(name: str, column: str) -> float:
        values, theirs = (np.interp(instants, table["time"], table[column]) for table in (own, tables[name]))
        return float(np.abs(values - theirs).max() / over[name])

    data["errors"] = {}
    for quantity, value in _values(data).items():
        if quantity.startswith("min_jacobian") or not all(quantity in values for values in known.values()):
            continue
        parts = {name: (value - known[name][quantity]) / over[name] for name in others}
        sizes = {name: abs(part) for name, part in parts.items()}
        if quantity.endswith("_last"):
            column = quantity.removesuffix("_last")
            sizes = {name: max(size, largest(name, column)) for name, size in sizes.items()}
        data["errors"][quantity] = {
            "estimate": sum(parts.values()), "bar": _SAFETY * sum(sizes.values()),
            "mesh": parts[COARSER], "step": parts[TWICE], "method": _METHOD,
        }  # fmt: skip


def _values(data: Mapping[str, Any]) -> dict[str, float]:
    return {**flatten(data["quantities"]), **extremes(data)}
