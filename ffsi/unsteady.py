"""Computations in time: when the motion is periodic, what the run comes to, and how a killed one goes on."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi import folder, metrics, resolution, seals
from ffsi.evaluation import Notes, attempt
from ffsi.folder import InputError
from ffsi.freefem import Event, FreeFEMError
from ffsi.metrics import Oscillation, Periodicity
from ffsi.reading import MEGABYTE, read_text
from ffsi.record import Recorder, begin, cut_tables, has_ended, newest_checkpoint
from ffsi.result import unit
from ffsi.scene import Scene, load_scene
from ffsi.timesteps import Checkpoint, cut_back, flaw, keep_checkpoint, read_history

logger = logging.getLogger(__name__)

PERIODS = 2 * metrics.BLOCK + 2
"""Periods, at least, between the end of the inflow's ramp and a stop."""
LOOK_EVERY = 2.0
"""Seconds of wall time, at least, between two looks at the history."""
SHARE = 0.05
"""Largest part of the wall time that looking may cost."""
STOPPED = "stopped"
"""`failure` of a run that was asked to end before its end."""
RESUMABLE = ("crash", STOPPED)
_GO_ON, _STOP_PERIODIC = "0\n", "1 periodic\n"


# While it runs ----------------------------------------------------------------------------------------------------


class Watch:
    """Follows a running computation: reports its mean, amplitude and frequency, and ends it when it is periodic.

    A listener that passes every event on and adds, every few seconds, `signal` events with `name`, `unit`, `mean`,
    `amplitude` (both in that unit) and `frequency` (Hz) of the last full period of `metrics.reference_column`.
    Meanwhile it keeps the record (`ffsi.record`); `record.close` is to be called when the script has ended.
    """

    def __init__(
        self, scene: Scene, directory: Path, on_event: Callable[[Event], None] | None = None, *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        """Watch the run of `scene` in `directory`."""
        self.scene, self.directory, self.on_event, self.clock = scene, directory, on_event, clock
        self.stopped = False
        self.record = Recorder(directory)
        self._tail = _Tail(directory / folder.TIME_HISTORY)
        self._next = clock() + LOOK_EVERY

    def __call__(self, event: Event) -> None:
        """Take one event of the script."""
        if self.on_event is not None:
            self.on_event(event)
        if event.kind == "time":
            self.record.look()
        if event.kind == "time" and self.clock() >= self._next:
            begin = self.clock()
            self.look()
            now = self.clock()
            self._next = now + max(LOOK_EVERY, (now - begin) / SHARE)

    def look(self) -> None:
        """Read what is new in the history, report the last period, and ask the script to end if it is periodic."""
        name, times, values = self._tail.read()
        try:
            found = metrics.mean_amplitude_frequency(times, values)
            periodic = not self.stopped and self._stops and bool(settled(self.scene, times, values))
        except ValueError as error:  # the computation is about to fail
            logger.debug("%s: %s", self.directory, error)
            return
        if self.on_event is not None and math.isfinite(found.frequency):
            self.on_event(Event("signal", {"name": name, "unit": unit(name), **found.as_dict()}))
        if periodic:
            folder.write_text(self.directory / folder.STOP, _STOP_PERIODIC)
            self.stopped = True

    @property
    def _stops(self) -> bool:
        return self.scene.time is not None and self.scene.time.stop == "periodic"


class _Tail:
    """The times and the signals of a history that grows; every line is read once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.times: list[float] = []
        self._signals: dict[str, list[float]] = {}
        self._columns: dict[str, int] = {}
        self._offset = 0

    def read(self) -> tuple[str, Sequence[float], Sequence[float]]:
        """Return the name of the signal that counts, the times (s) and its values up to now; without one no times.

        Raises:
            FreeFEMError: kind `disk-full`: a row is damaged.
        """
        if self.path.is_file():
            with self.path.open("rb") as file:
                file.seek(self._offset)
                whole = file.read().rpartition(b"\n")
            self._offset += len(whole[0]) + len(whole[1])
            for line in whole[0].decode("utf-8", errors="replace").splitlines():
                try:
                    self._take(line.split(","))
                except (ValueError, IndexError, KeyError):
                    text = f"row {len(self.times) + 1} of {self.path.name} is damaged"
                    raise FreeFEMError(
                        "disk-full", f"{text}: the disk was full for a while, or does not work"
                    ) from None
        name = metrics.reference_column(pd.DataFrame(self._signals))
        return (name, self.times, self._signals[name]) if name else ("", [], [])

    def _take(self, cells: list[str]) -> None:
        if not self._columns:
            self._columns = {name: column for column, name in enumerate(cells)}
            self._signals = {name: [] for name in metrics.REFERENCES if name in self._columns}
        else:
            if len(cells) != len(self._columns):
                raise ValueError
            self.times.append(float(cells[0]))
            for name, values in self._signals.items():
                values.append(float(cells[self._columns[name]]))


def settled(scene: Scene, times: Sequence[float], values: Sequence[float]) -> Periodicity:
    """Return whether a signal is periodic, long enough after the ramp of the inflow.

    Args:
        scene: what is computed.
        times: s.
        values: of the signal.

    Raises:
        ValueError: a time or value is not finite.
    """
    found = metrics.periodic(times, values)
    if not found:
        return found
    ramp = (scene.inflow.ramp if scene.inflow else None) or 0.0
    last = metrics.mean_amplitude_frequency(times, values)
    after = (float(times[-1]) - ramp) / (last.end - last.start)
    if after >= PERIODS:
        return found
    text = f"only {max(after, 0.0):.1f} periods since the inflow is constant, {PERIODS} needed"
    return Periodicity(False, found.amplitude_change, found.mean_change, text)


# When it has ended ------------------------------------------------------------------------------------------------


def complete(data: dict[str, Any], scene: Scene, directory: Path) -> None:
    """Put what the whole computation comes to into the content of `result.json`.

    The quantities become mean, amplitude and frequency over the last period; those of the last state move to
    `time.last`. A run that was asked to stop before its end gets the failure `stopped`, and one whose history is no
    sequence of steps the failure `check`. `warnings` say where the steps are too large.
    """
    assert scene.time is not None
    last = data["quantities"]
    try:
        history = read_history(directory)
        wrong = flaw(history) if len(history) else ""
    except InputError as error:  # unless it died before the first step
        history, wrong = pd.DataFrame({"time": []}), str(error)
    history = with_coefficients(scene, history) if not wrong else history[:0]
    reached = float(history["time"].iloc[-1]) if len(history) else 0.0
    data["quantities"] = _quantities(history, data.setdefault("not_evaluated", []))
    data["newton"] = _counts(directory, history)
    data["time"] = {
        "reached": reached, "end": scene.time.end, "steps": len(history), **_periodicity(scene, directory, history),
        "last": last, "energy": energy_balance(history),
    }  # fmt: skip
    ended = reached >= scene.time.end * (1.0 - 1e-9)
    if wrong and not data["failure"]:
        data["status"], data["failure"] = "failed", "check"
        data["reason"] = f"{folder.TIME_HISTORY} cannot be believed: {wrong}"
    if not data["failure"] and not ended and not _was_asked_to_stop(directory):
        data["status"], data["failure"] = "failed", "check"
        data["reason"] = (
            f"{folder.TIME_HISTORY} ends at t = {reached:g} s although nothing has stopped the computation before "
            f"{scene.time.end:g} s: rows are missing, the disk was full for a while or does not work"
        )
    if not data["failure"] and not ended and not (data["time"]["periodic"] and scene.time.stop == "periodic"):
        data["status"], data["failure"] = "failed", STOPPED
        data["reason"] = f"stopped at t = {reached:g} s of {scene.time.end:g} s"
    data.setdefault("warnings", []).extend(resolution.of_history(scene, history, data["time"]["energy"]))


def _was_asked_to_stop(directory: Path) -> bool:
    """Tell whether anybody wanted a run to end before its end; without the file that says so, take it that way."""
    stop = directory / folder.STOP
    return not stop.is_file() or read_text(stop, MEGABYTE).strip() != _GO_ON.strip()


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
    counts as work (docs/formats.md). `imbalance` is (kinetic + elastic + dissipated - work) / largest |work|,
    dimensionless: the error of the steps in time, and of a flow's mesh.
    """
    parts = ("kinetic", "elastic", "dissipated", "work")
    if history.empty or not set(parts) <= set(history):
        return {}
    last = {name: float(history[name].iloc[-1]) for name in parts}
    scale = float(history["work"].abs().max(skipna=False))
    left = last["kinetic"] + last["elastic"] + last["dissipated"] - last["work"]
    return {**last, "imbalance": left / scale if scale != 0 else 0.0}


def last_period(history: pd.DataFrame) -> Oscillation | None:
    """Return the last full period of the reference signal (`start` and `end` in s); None without one."""
    name = metrics.reference_column(history)
    if name is None or history.empty:
        return None
    try:
        found = metrics.mean_amplitude_frequency(history["time"], history[name])
    except ValueError:
        return None
    return found if math.isfinite(found.start) else None


def _quantities(history: pd.DataFrame, notes: Notes) -> dict[str, Any]:
    if history.empty:
        return {}
    found: dict[str, Any] = {}
    motion = attempt(notes, "mean, amplitude and frequency", lambda: metrics.quantities_of_history(history))
    for name, parts in (motion or {}).items():
        found[name] = {part: value if math.isfinite(value) else None for part, value in parts.items()}
    if "min_jacobian" in history:
        found["min_jacobian"] = float(history["min_jacobian"].min(skipna=False))
    return found


def _counts(directory: Path, history: pd.DataFrame) -> dict[str, int]:
    """Return iterations of all steps, and factorisations, those of refused steps among them."""
    if history.empty:
        return {}
    newton = directory / folder.HISTORY
    try:
        fresh = int(pd.read_csv(newton)["factorized"].sum())
    except (OSError, KeyError, ValueError):
        fresh = int(history["factorized"].sum())
    return {"iterations": int(history["iterations"].sum()), "factorizations": fresh}


def _periodicity(scene: Scene, directory: Path, history: pd.DataFrame) -> dict[str, Any]:
    """Return `periodic` and why it is not, in words."""
    name = metrics.reference_column(history)
    if name is None or history.empty:
        return {"periodic": False, "why_not": "no signal to judge by"}
    try:
        found = settled(scene, history["time"].to_list(), history[name].to_list())
    except ValueError as error:
        return {"periodic": False, "why_not": str(error)}
    # What was found periodic while it ran stays so, although the script went on for some steps.
    stop = directory / folder.STOP
    if found or (stop.is_file() and stop.read_text(encoding="utf-8") == _STOP_PERIODIC):
        return {"periodic": True, "why_not": ""}
    return {"periodic": False, "why_not": f"{name}: {found.reason}"}


# Going on ---------------------------------------------------------------------------------------------------------


def check_resumable(directory: Path) -> Scene:
    """Return the scene of a run that can go on; writes nothing.

    Raises:
        InputError: no run folder, a sweep or a part of one, a steady run, or a finished one.
        SceneError: its `scene.toml` cannot be read.
    """
    if folder.is_sweep_folder(directory) or (directory / folder.CHAIN).is_file():
        raise InputError(f"{directory} belongs to a sweep; the same call of ffsi sweep goes on with it")
    if not folder.is_run_folder(directory):
        missing = "" if directory.exists() else folder.missing(directory)
        raise InputError(f"{directory} is no run folder of ffsi{missing}; there is nothing to resume")
    scene = load_scene(str(directory / folder.SCENE), [])
    _refuse_finished(scene, directory, directory / folder.RESULT)
    return scene


def _refuse_finished(scene: Scene, directory: Path, result: Path) -> None:
    if scene.time is None:
        raise InputError(f"{directory} holds a steady run; only runs in time can be resumed")
    if not result.is_file():
        return
    try:
        data = folder.read_json(result)
        wrong = seals.problems(result, data)
    except InputError as error:
        wrong = [str(error)]
    if wrong:  # the record tells what of the run can be believed
        logger.warning("%s: %s; its result is made again", directory, "; ".join(wrong))
    elif data.get("failure", "") not in RESUMABLE:
        ending = "converged" if not data.get("failure") else f"failed: {data.get('reason')}"
        raise InputError(f"the run in {directory} is finished ({ending}); there is nothing to resume")


def prepare_resume(scene: Scene, directory: Path, result: Path, script: str) -> Mapping[str, str] | None:
    """Bring a folder into the state in which its script can go on.

    Everything after the newest checkpoint that its record covers is removed; without one, everything.

    Args:
        scene: what to solve; that of the folder.
        directory: the run folder.
        result: the result file of a run that has ended, if it is there.
        script: the text of the scene's script; nothing else is run.

    Returns:
        The script's arguments; None if the script had ended and only its files have to be read.

    Raises:
        InputError: the run is finished, steady or one of another scene or script, or it was changed.
    """
    if load_scene(str(directory / folder.SCENE), []) != scene:
        raise InputError(
            f"{directory} holds a run of another scene; give another folder, or the scene in {folder.SCENE}"
        )
    _refuse_finished(scene, directory, result)
    _refuse_other_script(directory, script)
    if has_ended(directory) and not _ends_early(result):
        logger.info("%s: the computation is complete, only its evaluation is done again", directory)
        return None
    checkpoint = newest_checkpoint(directory)
    folder.keep_log(directory)
    if checkpoint is None:
        logger.info("%s: no checkpoint is complete, starting over from t = 0 s", directory)
        folder.clear(directory, keep=(*folder.DEFINITION, folder.LOGS))
        return {}
    folder.clear(directory, keep=(*folder.DEFINITION, folder.LOGS, *folder.IN_TIME, folder.HISTORY, folder.MESH))
    cut_tables(directory, checkpoint.step)
    cut_back(directory, checkpoint.step)
    folder.write_text(directory / folder.STOP, _GO_ON)
    kept = keep_checkpoint(checkpoint)
    begin(directory, Checkpoint(kept, checkpoint.step, checkpoint.time))
    logger.info("%s: going on from t = %g s", directory, checkpoint.time)
    return {"resume": str(kept.absolute())}


def _refuse_other_script(directory: Path, script: str) -> None:
    """Refuse to run a script that this program would not write for the scene: it can do anything."""
    path = directory / folder.SCRIPT
    if path.is_file() and path.read_bytes() == script.encode("utf-8"):
        return
    raise InputError(
        f"{path} is not the script of {folder.SCENE}: it was changed, or another version of ffsi (or a FreeFEM with "
        f"other solvers) has written it. Nothing was run; to start anew: ffsi run {directory / folder.SCENE} "
        "--out OTHER_FOLDER"
    )


def _ends_early(result: Path) -> bool:
    """Return whether a result says that the run was asked to stop, or died."""
    try:
        return result.is_file() and folder.read_json(result).get("failure") in RESUMABLE
    except InputError:
        return False
