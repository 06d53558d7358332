"""The record of a computation in time: checksums of what its script has written, up to each checkpoint and at its end.

The script cannot sum up its own files, so Python does while it watches. What no record covers is not believed when the
run goes on.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ffsi.files import folder, seals
from ffsi.files.checkpoints import Checkpoint, read_checkpoint
from ffsi.files.cycles import cycles_until
from ffsi.files.errors import InputError
from ffsi.files.seals import Seal
from ffsi.files.steps import states_until

logger = logging.getLogger(__name__)

_TABLES = (folder.TIME_HISTORY, folder.HISTORY, folder.STEPS)
_WRITTEN_ONCE = (*folder.DEFINITION, folder.EARLIER, folder.MESH, folder.STATES, folder.WALL_CYCLES)


class Recorder:
    """Keeps the record of a run while its script writes; one that goes on continues what is there."""

    def __init__(self, directory: Path) -> None:
        """Record the run in `directory`."""
        self.directory = directory
        self._data = _read(directory) | {"end": {}}
        self._tables = [_Rows(directory / name) for name in _TABLES]
        self._seen: dict[str, tuple[int, int]] = {}

    def look(self) -> None:
        """Take in checkpoints that are new since the last look, and what belongs to them."""
        new = [name for name in folder.CHECKPOINTS if self._changed(name)]
        entries = [entry for name in new if (entry := self._entry(self.directory / name)) is not None]
        if not entries:
            return
        for entry in sorted(entries, key=lambda entry: int(entry["step"])):
            entry["tables"] = {table.path.name: table.upto(int(entry["step"])) for table in self._tables}
            entry["cycles"] = cycles_until(self.directory, float(entry["time"]))
            self._data["checkpoints"] = [*self._data["checkpoints"][1 - len(folder.CHECKPOINTS) :], entry]
        self._write()

    def close(self) -> None:
        """Seal all files; to be called when the script has ended."""
        self.look()
        points = (*folder.point_files(1, solved=True), *folder.point_files(1, solved=False))
        self._data["end"] = seals.seal_all(self.directory, (*folder.BELIEVED, *points))
        self._write()

    def _write(self) -> None:
        files = self._data["files"]
        try:
            for pattern in _WRITTEN_ONCE:
                for path in self.directory.glob(pattern):
                    if self._changed(path.name) or path.name not in files:
                        files[path.name] = seals.seal(path)
            seals.write(self.directory / folder.MANIFEST, self._data)
        except OSError as error:  # a full disk: the run fails for that, and not for its record
            logger.warning("%s: no record of it: %s", self.directory, error)

    def _changed(self, name: str) -> bool:
        try:
            now = (self.directory / name).stat()
        except OSError:
            return False
        stamp = (now.st_mtime_ns, now.st_size)
        changed = self._seen.get(name) != stamp
        self._seen[name] = stamp
        return changed

    def _entry(self, path: Path) -> dict[str, Any] | None:
        """Return the entry of a checkpoint; None if it is not complete, changes just now, or is known."""
        try:
            before = seals.seal(path)
            found = read_checkpoint(path)
            whole = found is not None and seals.fits(path, before)
        except OSError:
            return None
        if found is None or not whole:
            self._seen.pop(path.name, None)
            return None
        known = any(entry.get("sha256") == before["sha256"] for entry in self._data["checkpoints"])
        return None if known else {"step": found.step, "time": found.time, **before}


class _Rows:
    """The checksum of the rows of a growing table up to a step; every byte is read once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._sum = hashlib.sha256()
        self._bytes, self._rows, self._last = 0, 0, 0.0  # the head among the rows

    def upto(self, step: int) -> Seal:
        """Return the seal of the head and the rows of the steps 1 to `step`."""
        if self.path.is_file():
            with self.path.open("rb") as file:
                file.seek(self._bytes)
                for line in file:
                    number = self._step(line)
                    if not line.endswith(b"\n") or not self._last <= number <= step:
                        break  # ordinary steps, which a run writes at its end, stand behind later ones
                    self._last = number
                    self._sum.update(line)
                    self._bytes += len(line)
                    self._rows += 1
        return {"bytes": self._bytes, "sha256": self._sum.copy().hexdigest(), "grows": True}

    def _step(self, line: bytes) -> float:
        if self._rows == 0 or self.path.name == folder.TIME_HISTORY:  # its row n is step n
            return self._rows
        try:
            return int(line.partition(b",")[0])
        except ValueError:
            return float("inf")


def begin(directory: Path, checkpoint: Checkpoint) -> None:
    """Write the record of a run that goes on from a checkpoint in its folder, which holds tables up to its step."""
    entry = {"step": checkpoint.step, "time": checkpoint.time, **seals.seal(checkpoint.path)}
    entry["tables"] = {name: _Rows(directory / name).upto(checkpoint.step) for name in _TABLES}
    entry["cycles"] = cycles_until(directory, checkpoint.time)
    files = seals.seal_all(directory, _WRITTEN_ONCE)
    seals.write(directory / folder.MANIFEST, {"checkpoints": [entry], "files": files, "end": {}})


def newest_checkpoint(directory: Path) -> Checkpoint | None:
    """Return the latest checkpoint that fits its record, with all that a run believes which goes on from it.

    None if none was recorded. Raises InputError if the record is damaged, or none of its checkpoints fits.
    """
    data = _read(directory)
    if not data["checkpoints"]:
        if any((directory / name).is_file() for name in folder.CHECKPOINTS):
            logger.warning("%s: no record covers its checkpoints, they are not used", directory)
        return None
    wrong: list[str] = []
    for entry in sorted(data["checkpoints"], key=lambda entry: -int(entry["step"])):
        files = [directory / name for name in folder.CHECKPOINTS]
        path = next((path for path in files if seals.fits(path, entry)), None)
        found = _wrong_at(directory, data, entry)
        if path is None:
            found.insert(0, f"the checkpoint of t = {entry['time']:g} s is missing or was changed")
        if path is not None and not found:
            if wrong:
                logger.warning("%s: %s; going on from t = %g s", directory, "; ".join(wrong), entry["time"])
            return Checkpoint(path, int(entry["step"]), float(entry["time"]))
        wrong += found
    raise InputError(f"{directory} cannot go on: {'; '.join(dict.fromkeys(wrong))}. {_advice(directory)}")


def cut_tables(directory: Path, step: int) -> None:
    """Take out of the tables what was not there at the checkpoint of a step, rows that somebody has added among it."""
    entry = next(entry for entry in _read(directory)["checkpoints"] if entry["step"] == step)
    for name, sealed in entry["tables"].items():
        text = (directory / name).read_bytes()[: sealed["bytes"]]
        folder.write_text(directory / name, text.decode("utf-8"))


def has_ended(directory: Path) -> bool:
    """Return whether the script has written its last file, and all its files are those of the record."""
    try:
        end = _read(directory)["end"]
    except InputError:
        return False
    last = (folder.numbered(folder.POINT, 1), folder.FAILED)
    return any(name in end for name in last) and not seals.broken(directory, end)


def _wrong_at(directory: Path, data: Mapping[str, Any], entry: Mapping[str, Any]) -> list[str]:
    """Return what is believed from a checkpoint on and does not fit: tables, definition, mesh, saved states, cycles."""
    found = seals.broken(directory, entry["tables"])
    if found:
        return found
    names = [*states_until(directory, int(entry["step"])), *entry["cycles"]]
    unknown = [f"{name} is in no record" for name in names if name not in data["files"]]
    earlier = [name for name in data["files"] if fnmatchcase(name, folder.EARLIER)]
    needed = {*names, *earlier, *folder.DEFINITION, folder.MESH}
    return unknown + seals.broken(directory, {name: data["files"][name] for name in data["files"] if name in needed})


def _read(directory: Path) -> dict[str, Any]:
    """Return the record, an empty one if there is none; raises InputError if it is damaged."""
    path = directory / folder.MANIFEST
    if not path.is_file():
        return {"checkpoints": [], "files": {}, "end": {}}
    try:
        data = folder.read_json(path)
        wrong = seals.problems(path, data)
    except InputError as error:
        wrong = [str(error)]
    if wrong:
        raise InputError(f"{directory} cannot go on: {'; '.join(wrong)}. {_advice(directory)}")
    return data


def _advice(directory: Path) -> str:
    return f"To start anew: ffsi run {directory / folder.SCENE} --out OTHER_FOLDER"
