"""What pictures of fields show, in numbers: ranges, windows, levels, arrows, outlines, places; without matplotlib."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ffsi.files.arrays import Floats, Ints, distinct
from ffsi.result.fields import FLUID, Fields

Box = tuple[float, float, float, float]
INK = "#22262b"
DASHED = "#b3402a"
SOLID_COLOURS = ("#c9c3b8", "#aeb6bd", "#bfc8b5")
WIDTH = 11.0  # inches
DPI = 120
LABELS = {
    "velocity": "velocity magnitude (m/s)",
    "pressure": "pressure (Pa)",
    "displacement": "displacement magnitude (m)",
}
STEPS = [1, 2, 2.5, 5, 10]  # of the numbers on axes and colour bars
_LONG = 2.0  # above this ratio of length to height the colour bar lies below the picture
_ALONG = 38  # at most so many arrows along the longer side
ARROWS = 350  # at most about so many in all
_ROW_GAP = 0.85  # distance of the rows of arrows, in distances along a row
_LEFT = 0.95  # inches left of the axes
_THIN = 1e-6  # part of a picture's longer side that the other one has at least
_CONSTANT = 1e-9  # relative difference below which values are the same but for rounding
_EDGES = np.array([[0, 3, 1], [1, 4, 2], [2, 5, 0]])  # of a quadratic triangle in VTK's order


@dataclass(frozen=True)
class Scale:
    """What several pictures of one field have in common: its range (SI) and the window, lower left and upper right."""

    low: float
    high: float
    window: tuple[Floats, Floats]


def available(fields: Fields) -> list[str]:
    """Return the pictures that make sense for these fields, the most telling first."""
    names = ["velocity", "pressure"] if fields.has_fluid else []
    return [*names, "displacement"] if fields.has_solid else names


def refuse(name: str, fields: Fields) -> None:
    """Raise ValueError where these fields have no such picture, or a value in it is no number."""
    if name not in available(fields):
        raise ValueError(f"no picture {name!r} of these fields; there is {', '.join(available(fields))}")
    shown = distinct(fields.cells[(fields.region == FLUID) != (name == "displacement")])
    for what, values in (("displacement", fields.deformed), (name, getattr(fields, name)[shown])):
        if not np.isfinite(values).all():
            raise ValueError(f"the {what} holds a value that is not finite")


def range_of(name: str, fields: Fields) -> tuple[float, float]:
    """Return the range of the colours in SI."""
    wet = fields.region == FLUID
    if name == "pressure":
        return _most(fields.pressure[distinct(fields.cells[wet])])
    vectors, shown = (fields.velocity, wet) if name == "velocity" else (fields.displacement, ~wet)
    return 0.0, float(np.hypot(*vectors[distinct(fields.cells[shown])].T).max())


def window_of(name: str, fields: Fields) -> tuple[Floats, Floats]:
    """Return the lower left and the upper right corner of what a picture shows, in m."""
    if name == "displacement":
        return _around(fields, fields.region != FLUID)
    return fields.deformed.min(axis=0), fields.deformed.max(axis=0)


def _around(fields: Fields, selected: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return the corners of a window around the selected part, before and after the deformation, within the domain."""
    nodes = distinct(fields.cells[selected])
    corners = np.concatenate([fields.points[nodes], fields.deformed[nodes]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.35 * float((high - low).max())
    return np.maximum(low - margin, fields.deformed.min(axis=0)), np.minimum(high + margin, fields.deformed.max(axis=0))


def _most(values: Floats) -> tuple[float, float]:
    """Return the range of 99.4 % of the values, `np.percentile`, which loads numpy.ma."""
    low, high = np.interp([0.003, 0.997], np.linspace(0.0, 1.0, len(values)), np.sort(values))
    return float(low), float(high)


def pressure_levels(values: Floats) -> tuple[Floats, str]:
    """Return levels in Pa a round distance apart for most of these values, and the name of their palette."""
    low, high = _most(values)
    if high - low <= _CONSTANT * max(abs(low), abs(high)):
        half = 0.5 * (abs(low) or 1.0)
        low, high = low - half, high + half
    palette = "plasma"
    if low < 0 < high and min(-low, high) > 0.5 * max(-low, high):
        low, high, palette = -max(-low, high), max(-low, high), "RdBu_r"
    return ticks(low, high, 24), palette


def every_other(levels: Floats) -> Floats:
    """Return at most nine of the levels, a round distance apart and with zero among them if it is a level."""
    step = float(levels[1] - levels[0])
    least = -(-len(levels) // 9)
    stride = next(stride for stride in range(least, 10 * least + 1) if _is_round(stride * step))
    zero = int(np.abs(levels).argmin())
    return levels[(zero % stride) :: stride]


def _is_round(value: float) -> bool:
    leading = value / 10 ** np.floor(np.log10(value) + 1e-9)
    return bool(np.isclose(leading, [1, 2, 2.5, 5]).any())


def _centred(low: float, high: float, step: float) -> Floats:
    count = max(1, round((high - low) / step))
    return np.asarray(low + (np.arange(count) + 0.5) * (high - low) / count)


def solid_regions(fields: Fields) -> list[int]:
    """Return the numbers of the solids."""
    return [int(region) for region in distinct(fields.region) if region != FLUID]


def outline(fields: Fields, selected: NDArray[np.bool_]) -> list[Floats]:
    """Return the edges of one selected triangle only, each (3, 2): start, middle, end on the deformed mesh."""
    return list(fields.deformed[outer_edges(fields, selected)])


def outer_edges(fields: Fields, selected: NDArray[np.bool_]) -> Ints:
    """Return the nodes (n, 3) of the edges that belong to one selected triangle only: start, middle, end."""
    edges, count = edges_of(fields, selected)
    return np.asarray(edges[count == 1])


def edges_of(fields: Fields, selected: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Return the nodes (n, 3) of every edge of the selected triangles, and how many of them have it."""
    nodes = fields.cells[selected][:, _EDGES].reshape(-1, 3)
    _, first, count = np.unique(nodes[:, 1], return_index=True, return_counts=True)
    return np.asarray(nodes[first]), count


def loops(edges: Ints) -> list[list[int]]:
    """Join directed edges (n, 3) to closed lines of nodes, as a dashed line needs them."""
    rest: dict[int, list[tuple[int, int]]] = {}
    for start, middle, end in edges.tolist():
        rest.setdefault(start, []).append((middle, end))
    loops = []
    while rest:
        loop = [next(iter(rest))]
        while loop[-1] in rest:
            start = loop[-1]
            loop.extend(rest[start].pop())
            if not rest[start]:
                del rest[start]
        loops.append(loop)
    return loops


def mesh_lines(fields: Fields, selected: NDArray[np.bool_]) -> list[Floats]:
    """Return all edges of the selected triangles, each (3, 2), on the deformed mesh."""
    return list(fields.deformed[edges_of(fields, selected)[0]])


@dataclass(frozen=True)
class Frame:
    """The size of a page in inches, where its axes lie (left, below, width, height), and what they show, in m."""

    low: Floats
    high: Floats
    size: tuple[float, float]
    box: Box

    @classmethod
    def of(cls, window: tuple[Floats, Floats]) -> Frame:
        """Return that of a window, lower left and upper right corner in m, with equal axes."""
        low, high = window
        longer = float((high - low).max())
        length, height = np.maximum(high - low, _THIN * longer or 1.0).tolist()
        margin = 0.012 * max(length, height)
        length, height = length + 2 * margin, height + 2 * margin
        ratio, long = height / length, length > _LONG * height
        width = WIDTH - _LEFT - 0.2 if long else min(8.0, 5.5 / ratio)
        below, right = (1.35, 0.2) if long else (0.55, 1.4)
        size, box = (_LEFT + width + right, below + width * ratio + 0.35), (_LEFT, below, width, width * ratio)
        return cls(low - margin, high + margin, size, box)


def bar_of(box: Box) -> tuple[Box, bool]:
    """Return where the colour bar of axes lies, in inches: beside them, or (True) below long ones."""
    left, below, width, height = box
    if width > _LONG * height:
        return (left + 0.2 * width, 0.55, 0.6 * width, 0.13), True
    return (left + width + 0.15, below + 0.075 * height, 0.2, 0.85 * height), False


def arrows(fields: Fields, longest: float | None) -> tuple[Floats, Floats]:
    """Return places (2, n) in m on the deformed mesh and what is drawn there (2, n), in m, too; none in resting fluid.

    Their length goes with the root of the speed, so that slow regions stay readable. `longest`: the speed of the
    longest ones, in m/s, else the largest there is.
    """
    x, y = fields.deformed[distinct(fields.cells[fields.region == FLUID])].T
    length, height = float(np.ptp(x)), float(np.ptp(y))
    step = max(max(length, height) / _ALONG, np.sqrt(length * height / (_ROW_GAP * ARROWS)))
    grid = np.meshgrid(
        _centred(float(x.min()), float(x.max()), step), _centred(float(y.min()), float(y.max()), _ROW_GAP * step)
    )
    at = np.reshape(grid, (2, -1))
    found = replace(fields, points=fields.deformed).sample(at.T)
    wet = found["region"] == FLUID
    at, velocity = at[:, wet], np.array([found["vx"][wet], found["vy"][wet]])
    speed = np.hypot(*velocity)
    top = speed.max(initial=0.0) if longest is None else longest
    keep = speed > 0.02 * top
    if top == 0:
        return np.empty((2, 0)), np.empty((2, 0))
    return at[:, keep], velocity[:, keep] * (0.95 * step / top * np.sqrt(top / speed[keep]))


def ticks(low: float, high: float, most: int) -> Floats:
    """Return at most about so many round numbers, from the last below the range to the first above it."""
    least = max((high - low) / most, 1e-12 * max(abs(low), abs(high)), 1e-300)
    size = 10.0 ** np.floor(np.log10(least))
    step = size * next(factor for factor in STEPS if factor * size >= least * (1 - 1e-9))
    return np.asarray(step * np.arange(np.floor(low / step + 1e-9), np.ceil(high / step - 1e-9) + 1))
