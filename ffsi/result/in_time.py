"""What a computation in time comes to: whether its motion is periodic, its last period, its energy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.history import flaw, read_history
from ffsi.files.reading import MEGABYTE, read_text
from ffsi.result import oscillation, resolution
from ffsi.result.evaluation import Notes, attempt
from ffsi.result.oscillation import Oscillation, Periodicity
from ffsi.scene import Scene, scenes_before

if TYPE_CHECKING:
    import pandas as pd

PERIODS = 2 * oscillation.BLOCK + 2
"""Periods, at least, between the end of the inflow's ramp and a stop."""

STOPPED = "stopped"
"""`failure` of a run that was asked to end before its end."""

RESUMABLE = ("crash", STOPPED)


def settled(scene: Scene, times: Sequence[float], values: Sequence[float], since: float = 0.0) -> Periodicity:
    """Return whether a signal, values at times in s, is periodic, long enough after the ramp of the inflow.

    ``since`` is when the loads became those of the scene, s; values of before are not to be among the signal's.

    Raises:
        ValueError: a time or value is not finite.
    """
    found = oscillation.periodic(times, values)
    if not found:
        return found
    ramp = max((scene.inflow.ramp if scene.inflow else None) or 0.0, since)
    last = oscillation.mean_amplitude_frequency(times, values)
    after = (float(times[-1]) - ramp) / (last.end - last.start)
    if after >= PERIODS:
        return found
    text = f"only {max(after, 0.0):.1f} periods since the inflow is constant, {PERIODS} needed"
    return Periodicity(False, found.amplitude_change, found.mean_change, text)


def complete(data: dict[str, Any], scene: Scene, directory: Path) -> None:
    """Put what the whole computation comes to into the content of `result.json`.

    The quantities become mean, amplitude and frequency over the last period; those of the last state move to
    `time.last`. A run that was asked to stop before its end gets the failure `stopped`, and one whose history is no
    sequence of steps the failure `check`. `warnings` say where the steps are too large.
    """
    import pandas as pd

    assert scene.time is not None
    last = data["quantities"]
    try:
        history = read_history(directory)
        wrong = flaw(history) if len(history) else ""
    except InputError as error:  # unless it died before the first step
        history, wrong = pd.DataFrame({"time": []}), str(error)
    history = with_coefficients(scene, history) if not wrong else history[:0]
    changed = changes(directory, scene) if not wrong else []
    since = loads_since(changed)
    present = history[history["time"] > since]
    reached = float(history["time"].iloc[-1]) if len(history) else 0.0
    data["quantities"] = _quantities(present, data.setdefault("not_evaluated", []))
    data["newton"] = _counts(directory, history)
    data["time"] = {
        "reached": reached, "end": scene.time.end, "steps": len(history),
        **_periodicity(scene, directory, present, since), "last": last,
        **_extremes(history, data["quantities"]), "energy": energy_balance(history),
        **({"changed": changed} if changed else {}),
    }  # fmt: skip
    ended, failure, reason = reached >= scene.time.end * (1.0 - 1e-9), "", ""
    if data["failure"]:
        pass  # that is known already
    elif wrong:
        failure, reason = "check", f"{folder.TIME_HISTORY} cannot be believed: {wrong}"
    elif not ended and not _was_asked_to_stop(directory):
        failure, reason = (
            "check",
            (
                f"{folder.TIME_HISTORY} ends at t = {reached:g} s although nothing has stopped the computation before "
                f"{scene.time.end:g} s: rows are missing, the disk was full for a while or does not work"
            ),
        )
    elif not ended and not (data["time"]["periodic"] and scene.time.stop == "periodic"):
        failure, reason = STOPPED, f"stopped at t = {reached:g} s of {scene.time.end:g} s"
    if failure:
        data |= {"status": "failed", "failure": failure, "reason": reason}
    data.setdefault("warnings", []).extend(resolution.of_history(scene, present, data["time"]["energy"]))


def differing(before: Any, after: Any, key: str = "") -> dict[str, Any]:
    """Return what nested tables hold by dotted key where others hold something else, a table where they have none."""
    if not isinstance(before, Mapping) or not isinstance(after, Mapping):
        return {} if before == after else {key.removeprefix("."): after}
    found = [differing(before.get(name), after.get(name), f"{key}.{name}") for name in {**after, **before}]
    return {name: value for each in found for name, value in each.items()}


def changes(directory: Path, scene: Scene) -> list[dict[str, Any]]:
    """Return when the run in a folder was given other values: the last `step` before, its `time` in s, `settings`."""
    scenes = [(step, each.model_dump()) for step, each in (*scenes_before(directory), (0, scene))]
    return [
        {"step": step, "time": float(read_history(directory)["time"][step - 1]), "settings": differing(one, other)}
        for (step, one), (_, other) in itertools.pairwise(scenes)
    ]


def loads_since(changed: Sequence[Mapping[str, Any]]) -> float:
    """Return since when, in s, what acts in a run with these changes is what its scene says; 0 if always."""
    numerical = ("time.", "output.", "solver.")
    return max((e["time"] for e in changed if not all(k.startswith(numerical) for k in e["settings"])), default=0.0)


def _extremes(history: pd.DataFrame, quantities: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Return the smallest and the largest value over all steps of every quantity."""
    names = [name for name in quantities if name in history]
    return {
        "smallest": {name: float(history[name].min(skipna=False)) for name in names},
        "largest": {name: float(history[name].max(skipna=False)) for name in names},
    }


def _was_asked_to_stop(directory: Path) -> bool:
    """Tell whether anybody wanted a run to end before its end; without the file that says so, take it that way."""
    stop = directory / folder.STOP
    return not stop.is_file() or read_text(stop, MEGABYTE).strip() != folder.GO_ON.strip()


def with_coefficients(scene: Scene, history: pd.DataFrame) -> pd.DataFrame:
    """Return the history with two more columns, `drag_coefficient` and `lift_coefficient` (dimensionless)."""
    if scene.fluid is None or scene.inflow is None or scene.forces is None or "drag" not in history:
        return history
    assert scene.inflow.mean_velocity is not None
    unit = 0.5 * scene.fluid.density * scene.inflow.mean_velocity**2 * scene.forces.reference_length
    if not unit > 0:
        return history
    return history.assign(drag_coefficient=history["drag"] / unit, lift_coefficient=history["lift"] / unit)


def energy_balance(history: pd.DataFrame) -> dict[str, float]:
    """Return where the energy went, J per metre depth; empty without the columns.

    Kinetic is that of the last state; elastic, dissipated and work are sums over all steps, what was there at the start
    counts as work (docs/formats.md). `imbalance` is (kinetic + elastic + dissipated - work) / largest |work|, or
    |elastic| where a solid starts bent, dimensionless: the error of the steps in time, and of a flow's mesh.
    """
    if history.empty or not set(oscillation.ENERGIES) <= set(history):
        return {}
    last = {name: float(history[name].iloc[-1]) for name in oscillation.ENERGIES}
    scale = float(history[["work", "elastic"]].abs().to_numpy().max())
    left = last["kinetic"] + last["elastic"] + last["dissipated"] - last["work"]
    return {**last, "imbalance": left / scale if scale != 0 else 0.0}


def last_period(history: pd.DataFrame) -> Oscillation | None:
    """Return the last full period of the reference signal (`start` and `end` in s); None without one."""
    name = oscillation.reference_column(history)
    if name is None or history.empty:
        return None
    try:
        found = oscillation.mean_amplitude_frequency(history["time"], history[name])
    except ValueError:
        return None
    return found if math.isfinite(found.start) else None


def _quantities(history: pd.DataFrame, notes: Notes) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if history.empty:
        return found
    motion = attempt(notes, "mean, amplitude and frequency", lambda: oscillation.oscillations(history))
    for name, of in (motion or {}).items():
        found[name] = {part: value if math.isfinite(value) else None for part, value in of.as_dict().items()}
    if "min_jacobian" in history:
        found["min_jacobian"] = float(history["min_jacobian"].min(skipna=False))
    return found


def _counts(directory: Path, history: pd.DataFrame) -> dict[str, int]:
    """Return iterations of all steps, and factorisations, those of refused steps among them."""
    import pandas as pd

    if history.empty:
        return {}
    newton = directory / folder.HISTORY
    try:
        fresh = int(pd.read_csv(newton)["factorized"].sum())
    except (OSError, KeyError, ValueError):
        fresh = int(history["factorized"].sum())
    return {"iterations": int(history["iterations"].sum()), "factorizations": fresh}


def _periodicity(scene: Scene, directory: Path, history: pd.DataFrame, since: float) -> dict[str, Any]:
    """Return `periodic` and why it is not, in words."""
    name = oscillation.reference_column(history)
    if name is None or history.empty:
        return {"periodic": False, "why_not": "no signal to judge by"}
    try:
        found = settled(scene, history["time"].to_list(), history[name].to_list(), since)
    except ValueError as error:
        return {"periodic": False, "why_not": str(error)}
    # What was found periodic while it ran stays so, although the script went on for some steps.
    stop = directory / folder.STOP
    if found or (stop.is_file() and stop.read_text(encoding="utf-8") == folder.STOP_PERIODIC):
        return {"periodic": True, "why_not": ""}
    return {"periodic": False, "why_not": f"{name}: {found.reason}"}
