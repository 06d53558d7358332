"""Checksums: what is read later is what was written (docs/formats.md, `digest` and `files`)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ffsi.files import folder

Seal = dict[str, Any]
_END = '\n  "digest": "{}"\n}}\n'
_GROWS = "grows"


def seal(path: Path, *, grows: bool = False) -> Seal:
    """Return size and SHA-256 of a file; of one that grows, of what it holds now. OSError if it cannot be read."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        found = {"bytes": file.tell(), "sha256": digest}
    return found | {_GROWS: True} if grows else found


def seal_all(directory: Path, patterns: Iterable[str]) -> dict[str, Seal]:
    """Return the seals of the files that match one of the patterns, by name."""
    names = {path.name for pattern in patterns for path in directory.glob(pattern) if path.is_file()}
    return {name: seal(directory / name) for name in sorted(names)}


def fits(path: Path, wanted: Mapping[str, Any]) -> bool:
    """Return whether a file holds what was sealed, and, unless it grows, nothing else."""
    try:
        size, digest = int(wanted["bytes"]), str(wanted["sha256"])
        if not path.is_file() or not 0 <= size <= path.stat().st_size:  # nor is a pipe waited for
            return False
        with path.open("rb") as file:
            begin = hashlib.sha256(file.read(size)).hexdigest()
            return begin == digest and (bool(wanted.get(_GROWS)) or not file.read(1))
    except (OSError, KeyError, TypeError, ValueError):
        return False


def broken(directory: Path, files: Any) -> list[str]:
    """Return a sentence for every file of a folder that is not what was sealed, `files`: seals by name."""
    if not isinstance(files, Mapping):
        return ["its list of checksums is damaged"]
    found = []
    for name, wanted in files.items():
        if not isinstance(wanted, Mapping) or Path(name).name != name or not fits(directory / name, wanted):
            there = "was changed after it was written" if (directory / name).is_file() else "is missing"
            found.append(f"{name} {there}")
    return found


def write(path: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """Write JSON whose last key `digest` is the SHA-256 of the text without its digits; return it as read again."""
    plain = {key: value for key, value in data.items() if key != "digest"}
    body = folder.to_json(plain).removesuffix("\n}\n") + ","
    text = body + _END.format(_digest(body + _END.format("")))
    folder.write_text(path, text)
    found: dict[str, Any] = json.loads(text)
    return found


def problems(path: Path, data: Mapping[str, Any]) -> list[str]:
    """Return why a JSON file of `write` that holds `data`, or one of the `files` that it seals, cannot be believed."""
    if "digest" not in data:
        return [f"{path.name} carries no checksum: an older version of ffsi has written it, or it was altered"]
    text = path.read_bytes().decode("utf-8", errors="replace")
    digest = str(data["digest"])
    end = _END.format(digest)
    if not text.endswith(end) or _digest(text.removesuffix(end) + _END.format("")) != digest:
        return [f"{path.name} was changed after it was written: its checksum does not fit"]
    return broken(path.parent, data.get("files", {}))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
