"""One point of a run folder on its way from FreeFEM's files to a result file: collected, checked, drawn, sealed."""

from __future__ import annotations

import errno
import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from ffsi.files import folder, machine, seals
from ffsi.files.errors import InputError
from ffsi.files.json_types import read_table
from ffsi.freefem import FreeFEMError
from ffsi.hemodynamics.result import Result
from ffsi.result import in_time, resolution, vtu
from ffsi.result.evaluation import Notes, attempt, gather
from ffsi.result.quantities import CHECKED, flatten
from ffsi.run.verdict import verdict
from ffsi.scene import Scene
from ffsi.scene.lookup import Scalar

logger = logging.getLogger(__name__)

_drawing = threading.Lock()  # matplotlib's text cache is shared between threads


@dataclass(frozen=True)
class Point:
    """One point of a run folder on its way from FreeFEM's files to a result file."""

    scene: Scene
    directory: Path
    number: int
    varied: Mapping[str, Scalar]
    alone: bool = False
    followed: bool = False
    """Whether the script goes on with another point."""

    @property
    def complete(self) -> bool:
        """Whether the script has written its last file of this point, or of a failure at it."""
        return self._solved() is not None or self._failed() is not None

    def collect(self, died: FreeFEMError | None) -> dict[str, Any]:
        """Read what FreeFEM wrote about this point, into the shape of `result.json`."""
        state: str | None = None
        solved, failed = self._solved(), self._failed()
        if solved is not None:
            raw, failure, reason = solved, "", ""
            state = folder.numbered(folder.STATE, self.number)
        elif failed is not None:
            raw, failure, reason = failed, "not-converged", str(failed.get("reason") or "not converged")
            state = folder.FAILED_STATE if (self.directory / folder.FAILED_STATE).is_file() else None
        else:
            raw, (failure, reason) = {}, self._why_missing(died)
        parameters = dict((solved or {}).get("parameters") or self.scene.parameters())
        data = {
            "case": self.scene.name,
            "status": "failed" if failure else "converged",
            "reason": reason,
            "unknowns": raw.get("unknowns"),
            "triangles": raw.get("triangles"),
            "level": raw.get("level", self.scene.mesh.level),
            "quantities": dict(raw.get("quantities") or {}),
            "newton": dict(raw.get("newton") or {}),
            "timings": dict(raw.get("timings") or {}),
            "check": {},
            "freefem": dict(raw.get("freefem") or {}),
            "parameters": parameters,
            "checked": False,
            "point": self.number,
            "state": state,
            "failure": failure,
            "check_failures": [],
            "not_evaluated": [],
            "warnings": resolution.of_scene(self.scene),
        }
        if not self.alone:
            data["varied"] = dict(self.varied)
        result, notes = Result(self.scene, self.directory, data), data["not_evaluated"]
        if state is not None and not failure:
            walls = attempt(notes, "walls", lambda: result.walls)
            data["quantities"] |= gather(notes, walls.evaluations) if walls is not None else {}
        if not failure and (slopes := self._read(folder.numbered(folder.SENSITIVITIES, self.number))):
            data["sensitivities"] = with_logarithms(slopes, data["quantities"], parameters)
        if not failure and (errors := self._read(folder.numbered(folder.ERRORS, self.number))):
            data["errors"] = errors["errors"]
            data["warnings"] = [*data["warnings"], *errors["warnings"]]
        if not failure and (adaptation := self._read(folder.numbered(folder.ADAPTATION, self.number))):
            data["adaptation"] = {name: adaptation[name] for name in ("tolerance", "unknowns", "rounds")}
            data["warnings"] = [*data["warnings"], *adaptation["warnings"]]
            for name, found in adaptation["rounds"][-1]["quantities"].items():
                if "bar" in found:
                    data["errors"][name] |= {"bar": found["bar"], "method": "localised on the meshes made for it"}
        data |= attempt(notes, "regions and boundaries", lambda: result.domain) or {}
        if self.scene.time is not None:
            attempt(notes, "motion", lambda: in_time.complete(data, self.scene, self.directory))
            if self.scene.output.wall and (cycles := attempt(notes, "cycles", lambda: result.cycles)):
                data["cycles"] = cycles
                data["quantities"] |= {key: value for key, value in cycles[-1].items() if "_" in key}
        if data["failure"]:
            set_aside(data, raw)
        return data

    def judged(self, died: FreeFEMError | None, check: bool) -> dict[str, Any]:
        """Collect the point and, if asked for, check it."""
        data = self.collect(died)
        if check:
            self.check(data)
        return data

    def check(self, data: dict[str, Any]) -> None:
        """Run the independent checker on a solved point; a mismatch makes it a failed one."""
        if data["failure"] not in ("", in_time.STOPPED):
            return
        begin, failure = time.perf_counter(), "check"
        try:
            report = verdict(self.directory, self.scene, self.number)
        except Exception as error:  # files or parameters that do not belong to this scene, or whatever stops it
            logger.debug("%s: the check stopped", self.directory, exc_info=True)
            failures, reason = [machine.words(error)], "the reference check could not be done"
            failure = "crash" if machine.ended(error) else "check"
        else:
            data["check"] = {name: getattr(report, name) for name in CHECKED}
            failures, reason = list(report.failures), "the reference check disagrees"
            for name in ("sensitivities", "errors"):
                if data.get(name) and self.scene.steady and data["check"][f"{name}_difference"] is None:
                    why = "the mesh is too large for the checker's own"
                    data["warnings"].append(f"{name} were not computed a second time: {why}")
        data["timings"]["check"] = seconds(time.perf_counter() - begin)
        if failures:
            data["check_failures"] = failures
            data["status"], data["failure"] = "failed", failure
            data["reason"] = f"{reason}: {'; '.join(failures)}"
            set_aside(data, {})
            logger.error("%s: %s", self.directory, data["reason"])
        data["checked"] = not failures

    def draw(self, data: dict[str, Any]) -> None:
        """Write the VTU files and the pictures that the scene asks for; what cannot be done is noted."""
        result, notes = Result(self.scene, self.directory, data), data["not_evaluated"]
        begin = time.perf_counter()
        if self.scene.output.vtu:
            attempt(notes, "VTU", lambda: self._write_vtu(result, notes))
        if data["state"] is None:
            return
        attempt(notes, folder.WALL, lambda: self._write_wall(result))
        written = time.perf_counter()
        data["timings"]["output"] = seconds(data["timings"].get("output", 0.0) + written - begin)
        if self.scene.output.pictures:
            attempt(notes, "pictures", lambda: self._write_pictures(result, notes))
        data["timings"]["pictures"] = seconds(time.perf_counter() - written)

    def _write_vtu(self, result: Result, notes: Notes) -> None:
        """Write the saved steps, or the last state, with those fields along the walls that can be evaluated."""
        if result.saved_steps:
            steps = (
                (step.step, step.time, result.fields_of(step), gather(notes, result.point_data(step.new)))
                for step in result.saved_steps
            )
            vtu.write_series(self.directory, steps)
        if (state := result.state_file) and (not result.saved_steps or result.failure == "not-converged"):
            vtu.write_vtu(self.file("fields.vtu"), result.fields, gather(notes, result.point_data(state)))

    def _write_wall(self, result: Result) -> None:
        if (wall := result.wall) is not None:
            folder.write_text(self.file(folder.WALL), wall.to_csv(index=False))

    def _write_pictures(self, result: Result, notes: Notes) -> None:
        from ffsi.result import painting, views

        for name in views.available(result.fields):
            png = attempt(notes, f"picture of the {name}", partial(painting.paint, name, result.fields, result.title))
            if png is not None:
                folder.write_bytes(self.file(f"{name}.png"), png)

    def animate(self, data: dict[str, Any], field: str) -> None:
        """Write the moving picture of a field, where two steps or more were saved; what cannot be done is noted."""
        from ffsi.report.animation import write_animation

        result, name = Result(self.scene, self.directory, data), f"{field}.gif"
        with _drawing:
            if len(result.saved_steps) > 1:
                attempt(data["not_evaluated"], name, lambda: write_animation(result, field, self.file(name)))

    def save(self, data: dict[str, Any]) -> dict[str, Any]:
        """Write the result file, which seals all files that are read later; return its content."""
        if not self.alone:
            data["timings"]["total"] = self._chainseconds(data["timings"])
        # Of a point that is solved not the failure: that is a later point's, and may be half written now.
        names = (*folder.BELIEVED, folder.MANIFEST, *folder.point_files(self.number, solved=self._solved() is not None))
        files = seals.seal_all(self.directory, names)
        if folder.HISTORY in files and self.followed:  # the script goes on writing there
            files[folder.HISTORY]["grows"] = True
        data = data | {"files": files}
        try:
            return seals.write(self.file(folder.RESULT), data)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            for name in (*(f"{field}.png" for field in folder.PICTURES), "fields.vtu"):  # can be made again
                self.file(name).unlink(missing_ok=True)
            note = {"what": "pictures and VTU", "why": machine.words(error), "cause": "machine"}
            return seals.write(self.file(folder.RESULT), {**data, "not_evaluated": [*data["not_evaluated"], note]})

    def _chainseconds(self, timings: Mapping[str, float]) -> float:
        """Return what this point took: the script's clock since the point before it, and the check."""
        before = folder.numbered(folder.POINT, self.number - 1)
        start = ((self._read(before) or {}).get("timings") or {}).get("script") or 0.0
        own = max(0.0, timings.get("script", start) - start)
        return seconds(own + timings.get("check", 0.0))

    def file(self, name: str) -> Path:
        """Return the path of one of this point's own files."""
        return self.directory / (name if self.alone else folder.numbered(name, self.number))

    def _solved(self) -> dict[str, Any] | None:
        return self._read(folder.numbered(folder.POINT, self.number))

    def _failed(self) -> dict[str, Any] | None:
        data = self._read(folder.FAILED)
        return data if data and int(data.get("point", 1)) == self.number else None

    def _read(self, name: str) -> dict[str, Any] | None:
        """Read a file of the script; None if it is missing, half written, or was cut off (a kill, a full disk)."""
        path = self.directory / name
        if not path.is_file():
            return None
        try:
            return read_table(path)
        except (InputError, OSError) as error:
            logger.warning("%s", error)
            return None

    def _why_missing(self, died: FreeFEMError | None) -> tuple[str, str]:
        before = self._read(folder.FAILED)
        if before:
            return (
                "not-reached",
                f"not reached: point {before.get('point')} of the chain failed ({before.get('reason')})",
            )
        return (
            "crash",
            f"FreeFEM died ({died.kind}): {died.message}"
            if died is not None
            else f"FreeFEM did not write point {self.number}",
        )


def set_aside(data: dict[str, Any], raw: Mapping[str, Any]) -> None:
    """Move the quantities of a point that failed to `reached`: they are those of another state, or not verified.

    Args:
        data: the content of `result.json`.
        raw: what the script has written about the last state that it solved.
    """
    if "reached" in data:
        return
    in_time, parameters = data.get("time"), raw.get("parameters") or {}
    found: dict[str, Any] = {} if raw.get("load") is None or in_time else {"load": raw["load"]}
    found |= {key: parameters[key] for key in data.get("varied", {}) if key in parameters}
    if in_time:
        found |= {"time": in_time["reached"]} | flatten(in_time["last"])
    data["reached"] = found | flatten(data["quantities"])
    data["quantities"] = {}
    for name in ("sensitivities", "errors", "adaptation"):
        data.pop(name, None)


def with_logarithms(
    slopes: Mapping[str, Any], quantities: Mapping[str, Any], parameters: Mapping[str, Any]
) -> dict[str, dict[str, dict[str, float | None]]]:
    """Return derivatives by key and quantity, as a script writes them, by quantity and key, beside p/J dJ/dp.

    That is None where J is 0.
    """
    found: dict[str, dict[str, dict[str, float | None]]] = {}
    for key, of in slopes.items():
        for name, slope in of.items():
            value = quantities[name]
            log = slope * parameters[key] / value if value else None
            found.setdefault(name, {})[key] = {"derivative": slope, "logarithmic": log}
    return found


def seconds(value: float) -> float:
    """Return a duration in s as result files have it."""
    return round(value, 6)


def finish_point(
    scene: Scene, directory: Path, point: int, varied: Mapping[str, Scalar], *, check: bool = True
) -> Result | None:
    """Check a complete point of a chain whose process (or Python) died before that was done, and write its result file.

    Returns:
        The Result, or None if FreeFEM had not finished the point.
    """
    todo = Point(scene, directory, point, varied)
    if not todo.complete:
        return None
    return Result(scene, directory, todo.save(todo.judged(None, check)))
