"""Gmsh's MSH format, versions 2 and 4.1, ASCII and binary: every element with all of its physical groups.

An element can lie in several groups, and a group can list a curve or surface with a negative tag, reversed: it is in
the group all the same. Version 4.1 names the groups of each entity, version 2 writes an element once for each group.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, Ints
from ffsi.scene.errors import fault, short

SAVE = "in Gmsh: Mesh.MshFileVersion = 4.1"
# Types of elements: number in the format, name, nodes.
_TYPES = {
    **{1: ("line", 2), 2: ("triangle", 3), 3: ("quad", 4), 4: ("tetra", 4), 5: ("hexahedron", 8), 6: ("wedge", 6)},
    **{7: ("pyramid", 5), 8: ("line3", 3), 9: ("triangle6", 6), 10: ("quad9", 9), 15: ("vertex", 1), 16: ("quad8", 8)},
    **{20: ("triangle9", 9), 21: ("triangle10", 10), 23: ("triangle15", 15), 26: ("line4", 4), 27: ("line5", 5)},
}
_DIMENSION = {"line": 1, "triangle": 2}
_BEGIN = re.compile(rb"\s*(?:\$(\w+)[ \t]*(?:\r?\n|\r|$)|(\S[^\r\n]*)|$)")
_NAME = re.compile(rb'^[ \t]*(\d{1,9})[ \t]+(-?\d{1,9})[ \t]+"(.{0,1000}?)"[ \t\r]*$', re.MULTILINE | re.DOTALL)
_NO_NUMBER = re.compile(rb"[^\s0-9eE+.-]|\S{41}")


_Block = tuple[str, Ints, dict[int, Ints]]  # elements of one type: their nodes, and which lie in which group
_INT, _SIZE, _REAL = "i4", "i8", "f8"  # kinds of numbers


@dataclass
class Msh:
    """What a file holds: points (n, 3), and by type of element ("line", "triangle", ...) numbers of the points of each.

    A group has a dimension (1 or 2), a number, perhaps a name, and numbers of its lines or triangles.
    """

    names: dict[tuple[int, int], str] = field(default_factory=dict)
    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    elements: dict[str, Ints] = field(default_factory=dict)
    groups: dict[tuple[int, int], Ints] = field(default_factory=dict)


def is_msh(start: bytes) -> bool:
    """Tell by its first bytes whether a file is one of Gmsh's, of any version."""
    return re.match(rb"\s*\$(MeshFormat|NOD|Comments|PhysicalNames|Nodes)\b", start) is not None


def read_msh(path: Path) -> Msh:
    """Read a file.

    Raises:
        SceneError: it has another version, or is damaged; with the line (in binary files: the byte) where it shows.
    """
    return _File(path.read_bytes()).read()


class _Section:
    """The numbers of one section, read one after the other."""

    def __init__(self, file: _File, name: str, start: int, end: int) -> None:
        self.file, self.name, self.start, self.end = file, name, start, end
        self.words = None if file.order else file.data[start:end].split()
        self.at = 0 if self.words is not None else start
        if self.words is not None and (bad := _NO_NUMBER.search(file.data, start, end)):
            raise self.fault(f"{_text(file.data[bad.start() : bad.start() + 50].split()[0])} is no number", bad.start())

    def take(self, count: int, kind: str) -> NDArray[Any]:
        """Return the next numbers of a kind, as int64 or float64."""
        return self._take(count, kind).astype(np.float64 if kind == _REAL else np.int64)

    def nodes(self, count: int) -> tuple[Ints, Floats]:
        """Return the numbers (count,) and places (count, 3) of the next nodes in a file of version 2."""
        if self.words is None:
            dtype = np.dtype([("number", "i4"), ("place", "f8", 3)])
            found = self._take(count, dtype)
            return found["number"].astype(np.int64), found["place"].astype(np.float64)
        rows = self.take(4 * count, _REAL).reshape(count, 4)
        if (fraction := rows[:, 0] != np.floor(rows[:, 0])).any():
            self.at -= 4 * (count - int(np.argmax(fraction))) - 1
            raise self.error("a node's number must be whole")
        return rows[:, 0].astype(np.int64), rows[:, 1:]

    def count(self) -> int:
        """Return how many things follow: a number like others, but on a line of text in binary files of version 2."""
        if self.words is not None or self.file.version > 4:
            return self._sensible(int(self.take(1, _SIZE)[0]))
        found = re.compile(rb"\s*(\d{1,18})[ \t]*\r?\n").match(self.file.data, self.at, self.end)
        if found is None:
            raise self.fault("the number of what follows is missing", self.at)
        self.at = found.end()
        return self._sensible(int(found[1]))

    @property
    def left(self) -> int:
        """How many numbers follow, if each has 4 bytes."""
        return len(self.words) - self.at if self.words is not None else (self.end - self.at) // 4

    def finish(self) -> None:
        """Refuse what follows."""
        if self.at < len(self.words) if self.words is not None else self.file.data[self.at : self.end].strip():
            raise self.fault("there is more than it announces", self._offset())

    def fault(self, text: str, offset: int) -> Exception:
        """Return the error of what stands at an offset of the file."""
        return fault(f"damaged at {self.file.place(offset)}, in the section ${self.name}: {text}")

    def error(self, text: str) -> Exception:
        """Return the error of what was just read."""
        self.at -= min(self.at, 1)
        return self.fault(text, self._offset())

    def _sensible(self, count: int) -> int:
        if not 0 <= count <= self.left:
            raise self.error(f"{short(count)} things are announced, and only {self.left} numbers follow")
        return count

    def _take(self, count: int, kind: npt.DTypeLike) -> NDArray[Any]:
        if self.words is None:
            dtype = np.dtype(kind).newbyteorder("<" if self.file.order == "<" else ">")
            if count * dtype.itemsize > self.end - self.at:
                raise self.fault("it ends too early", self.end)
            found = np.frombuffer(self.file.data, dtype, count, self.at)
            self.at += count * dtype.itemsize
            return found
        words = self.words[self.at : self.at + count]
        if len(words) < count:
            raise self.fault("it ends too early", self.end)
        try:
            values = _numbers(words, kind)
        except (ValueError, OverflowError):
            bad = next(k for k, word in enumerate(words) if not _is_number(word, kind))
            self.at += bad
            what = "number" if kind == _REAL else "whole number"
            raise self.fault(f"{_text(words[bad])} is no {what}", self._offset()) from None
        self.at += count
        return values

    def _offset(self) -> int:
        if self.words is None:
            return self.at
        found = re.finditer(rb"\S+", self.file.data[self.start : self.end])
        return self.start + next((word.start() for k, word in enumerate(found) if k == self.at), self.end - self.start)


class _File:
    """One file on its way into `Msh`."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.order = ""  # of the bytes in a binary file: "<" or ">"
        self.version = 0.0
        self.found = Msh()
        self.physical: dict[tuple[int, int], Sequence[int]] = {}  # groups by dimension and tag of an entity
        self.tags = np.zeros(0, dtype=np.int64)
        self.absent: set[int] = set()  # pieces of partitioned surfaces without triangles (4.1)
        self.partitions: set[int] = set()  # of triangles (2)

    def place(self, offset: int) -> str:
        if self.order:
            return f"byte {offset}"
        return f"line {self.data.count(bytes([10]), 0, offset) + 1}"

    def read(self) -> Msh:
        readers = {
            "MeshFormat": self._format,
            "PhysicalNames": self._names,
            "Entities": self._entities,
            "PartitionedEntities": self._entities,
            "Nodes": self._nodes,
            "ParametricNodes": self._nodes,
            "Elements": self._elements,
        }
        seen: set[str] = set()
        for name, start, end in self._sections():
            if name not in readers:
                continue
            if not self.version and name != "MeshFormat":
                raise fault(f"damaged at {self.place(start)}: the section ${name} comes before $MeshFormat")
            kind = name.removeprefix("Parametric")
            if kind in seen:
                raise fault(f"damaged at {self.place(start)}: a second section ${name}")
            seen.add(kind)
            readers[name](name, start, end)
        for name in ("MeshFormat", "Nodes", "Elements"):
            if name not in seen:
                raise fault("the file holds no elements" if name == "Elements" else f"the file has no section ${name}")
        if self.absent or len(self.partitions) == 1:
            raise fault("the file holds one part of a partitioned mesh (in Gmsh: Mesh.PartitionSplitMeshFiles = 0)")
        self._number_nodes()
        return self.found

    def _sections(self) -> Iterator[tuple[str, int, int]]:
        """Yield name, start and end of the sections."""
        at = 0
        while at < len(self.data):
            begin = _BEGIN.match(self.data, at)
            assert begin is not None  # the pattern matches anything
            if begin[2] is not None:
                where = self.place(begin.start(2))
                raise fault(f"damaged at {where}: a section such as $Nodes should begin here, not {_text(begin[2])}")
            if begin[1] is None:
                return
            name = begin[1].decode()
            if name in ("NOD", "ELM"):
                raise fault(f"this is version 1 of Gmsh's format; accepted: versions 4.1 and 2.2 ({SAVE})")
            end = re.compile(rb"\$End%b[ \t]*(\r?\n|\r|$)" % name.encode()).search(self.data, begin.end())
            if end is None:
                where = self.place(begin.start(1))
                raise fault(f"damaged: the section ${name}, which begins at {where}, has no end: the file is cut")
            yield name, begin.end(), end.start()
            at = end.end()

    def _format(self, name: str, start: int, end: int) -> None:
        header = re.compile(rb"\s*(\d+(?:\.\d+)?)\s+([01])\s+(\d+)[ \t]*\r?\n?").match(self.data, start, end)
        if header is None:
            raise fault(f"damaged at {self.place(start)}: no version, type and size as in 4.1 0 8")
        self.version = float(header[1])
        if not (2 <= self.version < 3 or self.version == 4.1):
            text = f"this is version {header[1].decode()} of Gmsh's format"
            raise fault(f"{text}; accepted: versions 4.1 and 2.2 ({SAVE})")
        if header[2] == b"1":
            one = self.data[header.end() : header.end() + 4]
            if one not in (b"\1\0\0\0", b"\0\0\0\1") or header[3] != b"8":
                text = f"numbers of {header[3].decode()} bytes instead of 8"
                text = "the number 1 that shows the order of the bytes is missing" if header[3] == b"8" else text
                raise fault(f"damaged at byte {header.end()}, in the section $MeshFormat: {text}")
            self.order = "<" if one[0] else ">"

    def _names(self, name: str, start: int, end: int) -> None:
        """Read the names; they can hold anything but a quotation mark at the end of a line."""
        found = re.compile(rb"\s*(\d{1,9})\s").match(self.data, start, end)
        names = _NAME.findall(self.data[found.end() : end]) if found else []
        if found is None or len(names) != int(found[1]):
            text = f"it announces {int(found[1])} names, and {len(names)} follow" if found else "no number of names"
            raise fault(f"damaged at {self.place(start)}, in the section $PhysicalNames: {text}")
        for dimension, number, word in names:
            self.found.names[int(dimension), abs(int(number))] = word.decode("utf-8", "replace")

    def _entities(self, name: str, start: int, end: int) -> None:
        """Read the groups of the entities, or of those that a partition was cut into: elements name these."""
        if self.version < 4:
            return
        section, partitioned = _Section(self, name, start, end), name == "PartitionedEntities"
        if partitioned:
            section.count()
            section.take(2 * section.count(), _INT)
        for dimension, count in enumerate([section.count() for _ in range(4)]):
            for _ in range(count):
                tag = int(section.take(1, _INT)[0])
                if partitioned:
                    section.take(2, _INT)
                    section.take(section.count(), _INT)
                section.take(6 if dimension else 3, _REAL)
                groups = section.take(section.count(), _INT)
                if dimension:
                    section.take(section.count(), _INT)
                self.physical[dimension, tag] = np.unique(np.abs(groups)).tolist()
                if partitioned and dimension == 2 and groups.size:
                    self.absent.add(tag)
        section.finish()

    # Nodes -----------------------------------------------------------------------------------------------------------

    def _nodes(self, name: str, start: int, end: int) -> None:
        section = _Section(self, name, start, end)
        read = self._nodes_41 if self.version > 4 else self._nodes_2
        blocks = list(read(section, name.startswith("Parametric")))
        section.finish()
        self.tags = np.concatenate([np.zeros(0, dtype=np.int64), *(tags for tags, _ in blocks)])
        self.found.points = np.concatenate([np.zeros((0, 3)), *(points for _, points in blocks)])
        known, counts = np.unique(self.tags, return_counts=True)
        if (counts > 1).any():
            raise fault(f"the file has two nodes with the number {known[np.argmax(counts > 1)]}")

    def _nodes_41(self, section: _Section, parametric: bool) -> Iterator[tuple[Ints, Floats]]:
        blocks, total = section.count(), section.count()
        section.take(2, _SIZE)
        found = 0
        for _ in range(blocks):
            dimension, _, extra = section.take(3, _INT).tolist()
            count = section.count()
            tags = section.take(count, _SIZE)
            width = 3 + (dimension if extra else 0)
            if not 3 <= width <= 6:
                raise section.error(f"{dimension} is no dimension")
            yield tags, section.take(count * width, _REAL).reshape(count, width)[:, :3]
            found += count
        if found != total:
            raise section.error(f"it announces {total} nodes, and {found} follow")

    def _nodes_2(self, section: _Section, parametric: bool) -> Iterator[tuple[Ints, Floats]]:
        count = section.count()
        if not parametric:
            yield section.nodes(count)
            return
        for _ in range(count):
            yield section.nodes(1)
            dimension, _ = section.take(2, _INT).tolist()
            section.take(dimension if dimension in (1, 2) else 0, _REAL)

    # Elements --------------------------------------------------------------------------------------------------------

    def _elements(self, name: str, start: int, end: int) -> None:
        section = _Section(self, name, start, end)
        read = self._elements_41 if self.version > 4 else self._elements_2
        nodes: dict[str, list[Ints]] = {}
        groups: dict[tuple[int, int], list[Ints]] = {}
        total: dict[str, int] = {}
        for kind, block, members in read(section):
            nodes.setdefault(kind, []).append(block)
            first = total.get(kind, 0)
            total[kind] = first + len(block)
            for number, cells in members.items() if kind in _DIMENSION else ():
                groups.setdefault((_DIMENSION[kind], number), []).append(first + cells)
        section.finish()
        self.found.elements = {kind: np.concatenate(blocks) for kind, blocks in nodes.items()}
        self.found.groups = {key: np.unique(np.concatenate(cells)) for key, cells in sorted(groups.items())}

    def _elements_41(self, section: _Section) -> Iterator[_Block]:
        blocks, total = section.count(), section.count()
        section.take(2, _SIZE)
        found = 0
        for _ in range(blocks):
            dimension, entity, code = section.take(3, _INT).tolist()
            kind, width = self._type(section, code)
            count = section.count()
            self.absent -= {entity} if dimension == 2 and count else set()
            rows = section.take(count * (width + 1), _SIZE).reshape(count, width + 1)
            yield kind, rows[:, 1:], dict.fromkeys(self.physical.get((dimension, entity), ()), np.arange(count))
            found += count
        if found != total:
            raise section.error(f"it announces {total} elements, and {found} follow")

    def _elements_2(self, section: _Section) -> Iterator[_Block]:
        """Read elements, which all have a number; in binary files several of one type can follow one header."""
        left = section.count()
        begin = section.at
        values = section.take(section.left, _INT)
        at, run = 0, 1
        while left > 0:
            section.at = begin + (at + 3) * (4 if self.order else 1)
            if at + 3 > len(values):
                raise section.fault("it ends too early", section.end)
            first, second, tags = values[at : at + 3].tolist()
            kind, width = self._type(section, first if self.order else second)
            single = not self.order or second == 1  # every element has a header of its own
            head, own = (0, 4 if self.order else 3) if single else (3, 1)  # numbers before all, and before one's tags
            step = max(own + tags + width, 1)
            count = min(left, 2 * run, (len(values) - at) // step) if single else second
            if not (tags >= 0 and 1 <= count <= left and at + head + count * step <= len(values)):
                raise section.error("an element has more tags or nodes than follow")
            rows = values[at + head : at + head + count * step].reshape(count, step)
            if single:  # as many as have the same header
                columns = slice(0, 3) if self.order else slice(1, 3)
                same = (rows[:, columns] == rows[0, columns]).all(axis=1)
                rows = rows[: len(rows) if same.all() else int(np.argmin(same))]
            physical = np.abs(rows[:, own]) if tags else np.zeros(len(rows), dtype=np.int64)
            if kind == "triangle" and tags > 3:  # groups, entity, number of partitions, partition
                self.partitions.update(np.unique(rows[:, own + 3]).tolist())
            numbers = np.unique(physical[physical > 0]).tolist()  # 0 is the mark of an element without a group
            yield kind, rows[:, own + tags :], {number: np.flatnonzero(physical == number) for number in numbers}
            run = len(rows)
            at += head + run * step
            left -= run
        section.at = begin + at * (4 if self.order else 1)

    def _type(self, section: _Section, code: int) -> tuple[str, int]:
        if code not in _TYPES:
            raise section.error(f"elements of the type {code}; accepted: triangles (2), lines (1), points (15)")
        return _TYPES[code]

    def _number_nodes(self) -> None:
        """Replace the numbers of nodes in the file by their places among the points."""
        order = np.argsort(self.tags)
        known = self.tags[order]
        for kind in _DIMENSION:
            nodes = self.found.elements.get(kind)
            if nodes is None:
                continue
            position = np.minimum(np.searchsorted(known, nodes), len(known) - 1) if len(known) else nodes * 0
            bad = known[position] != nodes if len(known) else np.ones(nodes.shape, dtype=np.bool_)
            if bad.any():
                what = f"a {kind} has the node {nodes[bad][0]}, which the file does not hold"
                raise fault(f"{what} (number {int(np.argmax(bad.any(axis=1))) + 1} of its {kind}s)")
            self.found.elements[kind] = order[position]


def _numbers(words: Sequence[bytes], kind: npt.DTypeLike) -> NDArray[Any]:
    return np.array(words, dtype="S" if words else None).astype(np.float64 if kind == _REAL else np.int64)


def _is_number(word: bytes, kind: npt.DTypeLike) -> bool:
    try:
        return len(_numbers([word], kind)) == 1
    except (ValueError, OverflowError):
        return False


def _text(word: bytes) -> str:
    return short(word.decode("utf-8", "replace"), 30)
