"""Curves through the vertices of boundaries whose edges are bent (docs/theory.md)."""

from collections import defaultdict

import numpy as np

from ffsi.files.arrays import Floats, Ints

_CORNER = np.radians(45.0)


def off_chords(vertices: Floats, edges: Ints) -> Floats:
    """Return how far, (n, 2) m, the curve through the vertices (nv, 2) m of one boundary is off its edges' middles.

    ``edges`` (n, 2) are all of the boundary's, in any order and direction.
    """
    place = vertices @ [1.0, 1j]
    known: defaultdict[int, list[int]] = defaultdict(list)
    for start, end in edges.tolist():
        known[start].append(end)
        known[end].append(start)

    def onward(behind: int, here: int) -> list[int]:
        """The next two vertices at most, along the curve."""
        found: list[int] = []
        while len(found) < 2:
            further = [vertex for vertex in known[here] if vertex != behind]
            if len(further) != 1:
                break
            if abs(np.angle((place[further[0]] - place[here]) / (place[here] - place[behind]))) > _CORNER:
                break
            behind, here = here, further[0]
            found.append(here)
        return found

    return np.array([_off(place, onward(b, a), [a, b], onward(a, b)) for a, b in edges.tolist()]).reshape(-1, 2)


def _off(place: Floats, left: list[int], edge: list[int], right: list[int]) -> tuple[float, float]:
    """Of one edge, with up to two vertices on either side of it, nearest first."""
    both = bool(left) and bool(right)
    left, right = (left[:1], right[:1]) if both else (left, right)
    points = place[[*left[::-1], *edge, *right]]
    middle, size = points[len(left) :][:2].mean(), abs(place[edge[1]] - place[edge[0]])
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))]) / size
    powers = np.vander(length - length[len(left) :][:2].mean(), increasing=True)
    way = np.linalg.solve(powers, points - middle)[0]
    return float(way.real), float(way.imag)
