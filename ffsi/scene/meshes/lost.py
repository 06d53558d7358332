"""Names of groups that meshio loses when it reads a file: found again, or the file is refused."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from ffsi.scene.errors import short
from ffsi.scene.meshes.errors import fault

_KEYWORD = re.compile(r"^\*\s*(NODE|ELEMENT|ELSET|INCLUDE)\s*(?:,(.*))?$", re.IGNORECASE)
_ELSET = re.compile(r"\bELSET\s*=\s*([^,]*)", re.IGNORECASE)
_MARKER = re.compile(r"^\s*MARKER_TAG\s*=(.*)$", re.MULTILINE)


def refuse_lost_sets(path: Path) -> None:
    """Refuse a file of Abaqus with sets that meshio would give to other elements, or to fewer.

    Raises:
        MeshError: it includes another file, or has a set of sets, twice the same set, several lists of nodes, elements
            after a set, or elements of which only some are in a set from the start.
    """
    sets: set[str] = set()
    nodes = 0
    listed = False
    owned: set[bool] = set()  # whether elements are in a set from the start
    for number, keyword, options, first in _keywords(path):
        found = _ELSET.search(options)
        name = found[1].strip() if found else None
        what = ""
        if keyword == "NODE":
            nodes += 1
            what = "a second list of nodes" if nodes > 1 else ""
        elif keyword == "INCLUDE":
            what = "another file is included"
        elif name in sets:
            what = f"a second set {short(name)}"
        elif keyword == "ELSET" and not first.strip().split(",")[0].strip().isdigit():
            what = "a set that is not a list of elements"
        elif keyword == "ELSET":
            listed = True
        elif listed:
            what = "elements after a set"
        elif len(owned := owned | {name is not None}) > 1:
            what = "elements in a set from the start beside others"
        if what:
            text = f"line {number}: {what}, which meshio does not keep"
            accepted = "one *NODE, then all *ELEMENT with an ELSET or all without, then *ELSET of numbers, each once"
            raise fault(f"{text}; accepted: {accepted}, or another format (.msh)")
        if name is not None:
            sets.add(name)


def _keywords(path: Path) -> Iterator[tuple[int, str, str, str]]:
    """Yield line, keyword and options of each keyword that matters, and the line after it."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines, start=1):
        if found := _KEYWORD.match(line.strip()):
            following = lines[number] if number < len(lines) else ""
            yield number, found[1].upper(), found[2] or "", following


def marker_names(path: Path) -> dict[int, list[str]]:
    """Return the names of the markers of an SU2 file by the numbers that meshio gives them.

    Raises:
        MeshError: two markers get the same number.
    """
    found: dict[int, list[str]] = {}
    number = 0
    for name in _MARKER.findall(path.read_text(encoding="utf-8", errors="replace")):
        text = name.strip()
        number = int(text) if re.fullmatch(r"[+-]?\d{1,9}", text) else number + 1
        if number in found:
            raise fault(f"the markers {short(found[number][0])} and {short(text)} cannot be told apart; rename one")
        found[number] = [text]
    return found
