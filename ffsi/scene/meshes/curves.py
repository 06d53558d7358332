"""The boundaries of a mesh: which edges they are, and their labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ffsi.files.arrays import Ints
from ffsi.scene.boundaries import OUTER, PARTS, SURFACE, WALLS, Role
from ffsi.scene.errors import Problem, names, short
from ffsi.scene.meshes.errors import MeshError, count, fault, place
from ffsi.scene.meshes.naming import FLUID, ROLES, Naming, chosen_groups
from ffsi.scene.meshes.reading import Group
from ffsi.scene.meshes.topology import Topology


@dataclass(frozen=True)
class Edges:
    """One labelled boundary.

    Args:
        name: key of the scene, "interface", or the part's name.
        label: its label.
        role: condition on it.
        part: body part, None if it is in none.
        length: m.
    """

    name: str
    label: int
    role: Role
    part: str | None
    length: float


class Curves:
    """The edges of the mesh with the regions on both sides, and the named boundaries of the file."""

    def __init__(self, topology: Topology, region: Ints, lines: Ints, groups: Sequence[Group]) -> None:
        """Take (nt,) regions, (nl, 2) points of the file's lines (-1: of no triangle) and the groups of the lines."""
        self.topology, self.lines, self.groups = topology, lines, groups
        edges, left = topology.left
        right = topology.right
        regions = np.stack([region[left], np.where(right < 0, 0, region[right])], axis=1)
        self.outer = right < 0
        self.interface = (regions.min(axis=1) == FLUID) & (regions.max(axis=1) > FLUID)
        self.wet = self.outer & (regions[:, 0] == FLUID)
        self.dry = self.outer & (regions[:, 0] > FLUID)
        self.solid = regions.max(axis=1)
        swap = self.interface & (regions[:, 0] > FLUID)
        self.directed = np.where(swap[:, None], edges[:, ::-1], edges)

    def labels(self, naming: Naming) -> tuple[Ints, dict[int, tuple[str, Role]]]:
        """Return the label of each edge, 0 inside the regions; and name and role of the body parts by label."""
        label = np.zeros(len(self.outer), dtype=np.int64)
        label[self.interface] = SURFACE
        label[self.dry] = OUTER
        problems: list[Problem] = []
        given = np.full(len(label), -1, dtype=np.int64)
        chosen: list[tuple[str, str]] = []  # key and name
        for key, wanted in naming.boundaries:
            for name, group in chosen_groups(wanted, self.groups, f"boundaries.{key}", "boundary", problems):
                edges = self._edges(group, f"boundaries.{key}")
                if misplaced := self._misplaced(key, name, edges):
                    problems += misplaced
                    continue
                label[edges] = np.where(given[edges] < 0, ROLES[key].label, label[edges])
                twice = edges[label[edges] != ROLES[key].label]
                if twice.size:
                    other, title = chosen[given[twice[0]]]
                    text = f"shares edges with boundaries.{other} = {short(title)}, the first at {self._at(twice[0])}"
                    accepted = "accepted: one role for each edge"
                    problems.append(Problem(f"boundaries.{key}", f"{text}; {accepted}", short(name)))
                given[edges] = len(chosen)
                chosen.append((key, name))
        if problems:
            raise MeshError(problems)
        self._refuse_without_role(label)
        parts = self._parts(naming, label)
        return label, parts

    def _find(self, group: Group) -> Ints:
        """Return the edges of a group of lines, -1 where a line is no edge."""
        pairs = self.lines[group.cells]
        return np.where((pairs < 0).any(axis=1), -1, self.topology.find(np.maximum(pairs, 0)))

    def _edges(self, group: Group, key: str) -> Ints:
        """Return the edges of a group of lines.

        Raises:
            MeshError: a line is no edge.
        """
        edges = self._find(group)
        if (edges < 0).any():
            bad = count(int((edges < 0).sum()), "line")
            raise fault(f"of {short(group.title)}, {bad} of {len(edges)} are no sides of triangles", key)
        return edges

    def _misplaced(self, key: str, name: str, edges: Ints) -> list[Problem]:
        """Return the problem of edges that cannot have the role of a key."""
        role = ROLES[key]
        bad = edges[~(self.wet if role.fluid else self.dry)[edges]]
        if not bad.size:
            return []
        owner = "the fluid" if role.fluid else "a solid"
        accepted = f"accepted: outer boundaries of {owner}"
        if self.interface[bad[0]]:
            what = "lies between fluid and solid; such an interface is found without being named"
        elif self.outer[bad[0]]:
            what = f"is a boundary of {'a solid' if role.fluid else 'the fluid'}"
        else:
            what = "lies inside of the domain"
        return [Problem(f"boundaries.{key}", f"at {self._at(bad[0])} it {what}; {accepted}", short(name))]

    def _refuse_without_role(self, label: Ints) -> None:
        bare = np.flatnonzero(self.wet & (label == 0))
        if not bare.size:
            return
        touched = [group.title for group in self.groups if np.isin(self._find(group), bare).any()]
        named = f" (in the mesh: {names(touched)})" if touched else ""
        text = f"{count(bare.size, 'boundary edge')} of the fluid without a role, the first at {self._at(bare[0])}"
        accepted = "accepted: each of them in inlet, outlet or walls"
        raise fault(f"{text}{named}; {accepted}", "boundaries")

    def _parts(self, naming: Naming, label: Ints) -> dict[int, tuple[str, Role]]:
        """Give the body parts labels of their own; without any, the wet side of each solid, or else the walls."""
        chosen: list[tuple[str, Ints]] = []
        problems: list[Problem] = []
        for part, wanted in naming.parts:
            groups = chosen_groups(wanted, self.groups, f"parts.{part}", "boundary", problems)
            found = [self._edges(group, f"parts.{part}") for _, group in groups]
            chosen.append((part, np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *found]))))
        if problems:
            raise MeshError(problems)
        return self._label_parts(chosen or self._default_parts(naming, label), label)

    def _default_parts(self, naming: Naming, label: Ints) -> list[tuple[str, Ints]]:
        solids = {number: name for name, number in naming.numbers.items()}
        wet = np.unique(self.solid[self.interface]).tolist()
        parts = [(solids[number], np.flatnonzero(self.interface & (self.solid == number))) for number in wet]
        walls = np.flatnonzero(label == WALLS)
        return parts or ([("walls", walls)] if walls.size else [])

    def _label_parts(self, parts: Sequence[tuple[str, Ints]], label: Ints) -> dict[int, tuple[str, Role]]:
        roles: dict[int, Role] = {SURFACE: "interface", WALLS: "no-slip"}
        found: dict[int, tuple[str, Role]] = {}
        for number, (part, edges) in enumerate(parts, start=PARTS):
            kinds = np.unique(label[edges]).tolist()
            if len(kinds) != 1 or kinds[0] not in roles:
                text = "must be either one of the walls or an interface between fluid and solid"
                bad = next((edge for edge in edges.tolist() if label[edge] not in roles), None)
                where = "" if bad is None else f"; not so at {self._at(bad)}"
                raise fault(f"{text}, and in no other part{where}", f"parts.{part}")
            found[number] = (part, roles[kinds[0]])
            label[edges] = number
        return found

    def _at(self, edge: int) -> str:
        return place(self.topology.middles[edge], self.topology.unit)


def meaning(label: int, parts: dict[int, tuple[str, Role]]) -> tuple[str, int, Role, str | None]:
    """Return name, label, role and part of a label."""
    if label in parts:
        name, role = parts[label]
        return name, label, role, name
    if label == SURFACE:
        return "interface", label, "interface", None
    name = next(key for key, meaning in ROLES.items() if meaning.label == label)
    return name, label, ROLES[name].role, None
