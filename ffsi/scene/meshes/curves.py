"""The boundaries of a mesh: what the scene's names mean, which edges they are, and their labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ffsi.files.arrays import Floats, Ints
from ffsi.scene.boundaries import (
    CLAMPED,
    INLET,
    INLETS,
    LOADED,
    LOADS,
    MOVING,
    OUTER,
    OUTLET,
    OUTLETS,
    PARTS,
    SLIP,
    SLIP_X,
    SLIP_Y,
    SUPPORTED,
    SURFACE,
    WALLS,
    Role,
)
from ffsi.scene.errors import Problem, SceneError, count, fault, names, nearest, place, short
from ffsi.scene.meshes.reading import Group
from ffsi.scene.meshes.topology import Topology, cross

Names = tuple[str, ...]

FLUID = 1
PARALLEL = 1e-9
"""Largest sine of the angle between an axis and an edge that is parallel to it."""
BEND = 1e-8
"""Largest sine of the angle between two edges of a straight piece."""
SMOOTH, CORNER = 30.0, 75.0
"""Largest turn, degrees, between two edges of a curve, and smallest one at a corner: between them it may be either."""
STRAIGHT = 0.1
"""Largest turn, degrees, in walls that have no curve: what rounding makes of them is none."""
KINK = 2.0, 4.0
"""A turn (degrees) of more, and so many times the curvature at both vertices beside it, are a corner, too."""
UNEVEN = 3.0
"""Where a wall turns, an edge more than so many times as long as the next one would be bent more than its arc is."""


class RoleOf(NamedTuple):
    """What a key of the table of boundaries means: condition, label, whether it bounds fluid (None: or a solid)."""

    role: Role
    label: int
    fluid: bool | None


ROLES: dict[str, RoleOf] = {
    "inlet": RoleOf("inlet", INLET, True),
    "outlet": RoleOf("outlet", OUTLET, True),
    "walls": RoleOf("no-slip", WALLS, True),
    "clamped": RoleOf("clamped", CLAMPED, False),
    "free": RoleOf("free", OUTER, False),
    "loaded": RoleOf("loaded", LOADED, False),
    "supported": RoleOf("free", SUPPORTED, False),
    "slip": RoleOf("slip", SLIP_X, True),
    "symmetry": RoleOf("slip", SLIP_X, None),
}


class Part(NamedTuple):
    """A body part: its name, the role of its edges, and the moving wall that they are, if any."""

    name: str
    role: Role
    moving: str | None


class Naming(NamedTuple):
    """What "fluid", each solid, key of `ROLES`, part, moving wall, load and opening have, in the scene's order."""

    regions: tuple[tuple[str, Names], ...]
    boundaries: tuple[tuple[str, Names], ...]
    parts: tuple[tuple[str, Names], ...]
    moving: tuple[tuple[str, Names], ...] = ()
    loads: tuple[tuple[str, Names], ...] = ()
    inlets: tuple[tuple[str, Names], ...] = ()
    outlets: tuple[tuple[str, Names], ...] = ()
    curved: Names = ()

    @property
    def numbers(self) -> dict[str, int]:
        """Number of each region: 1 for the fluid, 2 and on for the solids."""
        solids = [name for name, _ in self.regions if name != "fluid"]
        return {name: FLUID if name == "fluid" else solids.index(name) + 2 for name, _ in self.regions}


def chosen_groups(
    wanted: Names, groups: Sequence[Group], key: str, noun: str, problems: list[Problem]
) -> list[tuple[str, Group]]:
    """Return the groups that the scene names, all those with a name; what is not there or empty becomes a problem."""
    found = []
    for name in wanted:
        called = [group for group in groups if group.name == name]
        numbered = [group for group in groups if str(group.number) == name and group.name != name]
        if called and numbered:
            text = f"means two: a {noun} with this name, and one with this number, which has"
            problems.append(Problem(key, f"{text} the name {names([numbered[0].title])}", short(name)))
            continue
        called = called or numbered
        if filled := [group for group in called if len(group.cells)]:
            found += [(name, group) for group in filled]
            continue
        titles = [group.title for group in groups if len(group.cells)]
        plural = "regions" if noun == "region" else "boundaries"
        hint = "(in Gmsh: physical groups, and Mesh.SaveAll = 0)"
        holds = f"the mesh has {names(titles)}" if titles else f"the mesh names no {plural} {hint}"
        if called:
            text = f"the file names this {noun}, but nothing belongs to it; {holds}"
            problems.append(Problem(key, text, short(name)))
        else:
            problems.append(Problem(key, f"no such {noun}; {holds}", short(name), nearest(str(name), titles)))
    return found


def refuse_uncurved(wanted: Names, walls: dict[str, int], curves: Curves, label: Ints) -> list[int]:
    """Return the labels of the walls that are to be bent; refuse unknown ones, and vertices that lie on no curve."""
    problems: list[Problem] = []
    for name in wanted:
        if name not in walls:
            text = f"no such wall; accepted: rigid ones by their names, {names(walls) or 'but there is none'}"
            problems.append(Problem("curved", text, short(name), nearest(name, walls)))
            continue
        edges = curves.directed[label == walls[name]]
        along = np.diff(curves.topology.points[edges], axis=1)[:, 0]
        length, first = np.hypot(*along.T), {vertex: i for i, vertex in enumerate(edges[:, 0].tolist())}
        pairs = np.array([(i, first[v]) for i, v in enumerate(edges[:, 1].tolist()) if v in first]).reshape(-1, 2)
        a, b = along[pairs.T]
        turn = np.degrees(np.abs(np.arctan2(cross(a, b), (a * b).sum(axis=1))))
        curvature = np.full(len(edges) + 1, np.nan)  # at the start of each edge, none at ends and corners
        curvature[pairs[:, 1]] = np.where(turn < CORNER, turn / length[pairs].sum(axis=1), np.nan)
        before, after = np.full((2, len(edges)), len(edges))
        before[pairs[:, 1]], after[pairs[:, 0]] = pairs.T
        beside = np.fmax(curvature[before[pairs[:, 1]]], curvature[after[pairs[:, 1]]])
        kink = (turn > SMOOTH) | ((turn > KINK[0]) & (curvature[pairs[:, 1]] > KINK[1] * beside))
        if (bad := np.flatnonzero(kink & (turn < CORNER))).size:
            where = place(curves.topology.points[edges[pairs[bad[0], 1], 0]], curves.topology.unit)
            text = f"at {where} it turns by {turn[bad[0]]:.0f} degrees: neither a smooth curve nor a corner"
            text += (
                f"; accepted: at most {SMOOTH:.0f} degrees on a curve, as its neighbours do, {CORNER:.0f} at corners"
            )
            problems.append(Problem("curved", f"{text}; pieces of it apart in geometry.parts", short(name)))
        longer = length[pairs].max(axis=1) / length[pairs].min(axis=1)
        turns = np.fmax(beside, curvature[pairs[:, 1]]) * length[pairs].sum(axis=1) > STRAIGHT
        if (uneven := np.flatnonzero(turns & (turn < CORNER) & (longer > UNEVEN))).size and not bad.size:
            where = place(curves.topology.points[edges[pairs[uneven[0], 1], 0]], curves.topology.unit)
            text = f"at {where}, where it turns, an edge is {longer[uneven[0]]:.1f} times as long as the next one"
            text += f"; accepted: at most {UNEVEN:.0f} times, straight pieces of it apart in geometry.parts"
            problems.append(Problem("curved", text, short(name)))
        elif not turn.max(initial=0.0, where=turn < CORNER) > STRAIGHT:
            problems.append(Problem("curved", "is straight; accepted: walls with a curved piece", short(name)))
    if problems:
        raise SceneError(problems)
    return [walls[name] for name in wanted]


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

    def labels(self, naming: Naming) -> tuple[Ints, dict[int, Part]]:
        """Return the label of each edge, 0 inside the regions; and the body parts by label."""
        label = np.zeros(len(self.outer), dtype=np.int64)
        label[self.interface] = SURFACE
        label[self.dry] = OUTER
        problems: list[Problem] = []
        given = np.full(len(label), -1, dtype=np.int64)
        chosen: list[tuple[str, str]] = []  # key and name
        roles = [(f"boundaries.{key}", ROLES[key], wanted) for key, wanted in naming.boundaries]
        for number, (name, wanted) in enumerate(naming.moving, start=MOVING):
            roles.append((f"moving.{name}", ROLES["walls"]._replace(label=number), wanted))
        for number, (name, wanted) in enumerate(naming.loads, start=LOADS):
            roles.append((f"loads.{name}", ROLES["loaded"]._replace(label=number), wanted))
        for key, first, several in (("inlet", INLETS, naming.inlets), ("outlet", OUTLETS, naming.outlets)):
            for number, (name, wanted) in enumerate(several, start=first):
                roles.append((f"{key}s.{name}", ROLES[key]._replace(label=number), wanted))
        for key, role, wanted in roles:
            for name, group in chosen_groups(wanted, self.groups, key, "boundary", problems):
                edges = self._edges(group, key)
                if misplaced := self._misplaced(key, role, name, edges):
                    problems += misplaced
                    continue
                meant = self._slips(edges) if role.role == "slip" else role.label
                label[edges] = np.where(given[edges] < 0, meant, label[edges])
                twice = edges[label[edges] != meant]
                if twice.size:
                    other, title = chosen[given[twice[0]]]
                    text = f"shares edges with {other} = {short(title)}, the first at {self._at(twice[0])}"
                    accepted = "accepted: one role for each edge"
                    problems.append(Problem(key, f"{text}; {accepted}", short(name)))
                given[edges] = len(chosen)
                chosen.append((key, name))
        if problems:
            raise SceneError(problems)
        self._refuse_without_role(label)
        self._refuse_bends(label)
        return label, self._parts(naming, label)

    def _find(self, group: Group) -> Ints:
        """Return the edges of a group of lines, -1 where a line is no edge."""
        pairs = self.lines[group.cells]
        return np.where((pairs < 0).any(axis=1), -1, self.topology.find(np.maximum(pairs, 0)))

    def _edges(self, group: Group, key: str) -> Ints:
        """Return the edges of a group of lines; refuse one with a line that is no edge."""
        edges = self._find(group)
        if (edges < 0).any():
            bad = count(int((edges < 0).sum()), "line")
            raise fault(f"of {short(group.title)}, {bad} of {len(edges)} are no sides of triangles", key)
        return edges

    def _slopes(self, edges: Ints) -> Floats:
        """Return the size of the two components of unit vectors along edges, (n, 2)."""
        start, end = self.topology.points[self.directed[edges]].transpose(1, 0, 2)
        return np.asarray(np.abs(end - start) / np.hypot(*(end - start).T)[:, None])

    def _slips(self, edges: Ints) -> Ints:
        """Return the labels of edges that are slip boundaries."""
        along_x, along_y = self._slopes(edges).T
        return np.where(along_x < PARALLEL, SLIP_X, np.where(along_y < PARALLEL, SLIP_Y, SLIP))

    def _refuse_bends(self, label: Ints) -> None:
        """Refuse inclined slip boundaries that are polygons of curves: where single edges meet at a bend."""
        edges = np.flatnonzero(np.isin(label, (SLIP_X, SLIP_Y, SLIP)))
        start, end = self.topology.points[self.directed[edges]].transpose(1, 0, 2)
        along = (end - start) / np.hypot(*(end - start).T)[:, None]
        first = {vertex: i for i, vertex in enumerate(self.directed[edges, 0].tolist())}
        pairs = [(i, first[v]) for i, v in enumerate(self.directed[edges, 1].tolist()) if v in first]
        joins, bends = np.zeros((2, len(edges)), dtype=np.bool_)
        for pair in pairs:
            straight = abs(cross(*along[list(pair)])) <= BEND
            (joins if straight else bends)[list(pair)] = straight or SLIP in label[edges[list(pair)]]
        if (bad := edges[bends & ~joins]).size:
            text = f"at {self._at(bad[0])} it bends behind a single edge; accepted: straight pieces of several edges"
            key = "boundaries.slip" if self.wet[bad[0]] else "boundaries.symmetry"
            raise fault(f"{text}, in coordinates of at least 9 digits", key)

    def _misplaced(self, key: str, role: RoleOf, name: str, edges: Ints) -> list[Problem]:
        """Return the problem of edges that cannot have a role."""
        able = {True: self.wet, False: self.dry, None: self.outer}[role.fluid]
        bad = edges[~able[edges]]
        if not bad.size:
            return []
        owner = {True: "the fluid", False: "a solid", None: "the fluid or a solid"}[role.fluid]
        accepted = f"accepted: outer boundaries of {owner}"
        if self.interface[bad[0]]:
            what = "lies between fluid and solid; such an interface is found without being named"
        elif self.outer[bad[0]]:
            what = f"is a boundary of {'a solid' if role.fluid else 'the fluid'}"
        else:
            what = "lies inside of the domain"
        return [Problem(key, f"at {self._at(bad[0])} it {what}; {accepted}", short(name))]

    def _refuse_without_role(self, label: Ints) -> None:
        bare = np.flatnonzero(self.wet & (label == 0))
        if not bare.size:
            return
        touched = [group.title for group in self.groups if np.isin(self._find(group), bare).any()]
        named = f" (in the mesh: {names(touched)})" if touched else ""
        text = f"{count(bare.size, 'boundary edge')} of the fluid without a role, the first at {self._at(bare[0])}"
        accepted = "accepted: each of them in inlet, outlet, walls, slip or symmetry"
        raise fault(f"{text}{named}; {accepted}", "boundaries")

    def _parts(self, naming: Naming, label: Ints) -> dict[int, Part]:
        """Give the body parts labels of their own; without any, the wet side of each solid, or else the walls."""
        chosen: list[tuple[str, Ints]] = []
        problems: list[Problem] = []
        for part, wanted in naming.parts:
            groups = chosen_groups(wanted, self.groups, f"parts.{part}", "boundary", problems)
            edges = [self._edges(group, f"parts.{part}") for _, group in groups]
            chosen.append((part, np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *edges]))))
        if problems:
            raise SceneError(problems)
        if not chosen:
            solids = {number: name for name, number in naming.numbers.items()}
            wet = np.unique(self.solid[self.interface]).tolist()
            chosen = [(solids[number], np.flatnonzero(self.interface & (self.solid == number))) for number in wet]
            chosen = chosen or [("walls", walls) for walls in [np.flatnonzero(label == WALLS)] if walls.size]
        roles: dict[int, tuple[Role, str | None]] = {SURFACE: ("interface", None), WALLS: ("no-slip", None)}
        roles |= {number: ("no-slip", name) for number, (name, _) in enumerate(naming.moving, start=MOVING)}
        found: dict[int, Part] = {}
        for number, (part, own) in enumerate(chosen, start=PARTS):
            kinds = np.unique(label[own]).tolist()
            if len(kinds) != 1 or kinds[0] not in roles:
                text = "must be either one of the walls or an interface between fluid and solid"
                bad = next((edge for edge in own.tolist() if label[edge] not in roles), None)
                where = "" if bad is None else f"; not so at {self._at(bad)}"
                raise fault(f"{text}, and in no other part{where}", f"parts.{part}")
            found[number] = Part(part, *roles[kinds[0]])
            label[own] = number
        return found

    def _at(self, edge: int) -> str:
        return place(self.topology.middles[edge], self.topology.unit)
