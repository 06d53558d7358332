"""Pictures of the fields on the deformed mesh (matplotlib `Figure` objects, no global state)."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from matplotlib.tri import Triangulation
from numpy.typing import NDArray
from PIL import Image

from ffsi.files.arrays import Floats, Ints
from ffsi.result import gradients
from ffsi.result.fields import FLUID, Fields

INK = "#22262b"
FAINT = "#8a9099"
DASHED = "#b3402a"
SOLID_COLOURS = ("#c9c3b8", "#aeb6bd", "#bfc8b5")
WIDTH = 11.0  # inches
_LONG = 2.0  # above this ratio of length to height the colour bar lies below the picture
_ALONG = 38  # at most so many arrows along the longer side
_ARROWS = 350  # at most about so many in all
_ROW_GAP = 0.85  # distance of the rows of arrows, in distances along a row
_COARSEST = 50  # dots per inch
_LEFT = 0.95  # inches left of the axes
_TOGETHER = 1000  # lines in a path
_THIN = 1e-6  # part of a picture's longer side that the other one has at least
_CONSTANT = 1e-9  # relative difference below which values are the same but for rounding
STEPS = [1, 2, 2.5, 5, 10]  # of the numbers on axes and colour bars
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


def draw(name: str, fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Draw `velocity`, `pressure` or `displacement` on the deformed mesh; with a scale to compare several.

    Raises:
        ValueError: these fields have no such picture, or a value in it is no number.
    """
    _refuse(name, fields)
    return {"velocity": velocity, "pressure": pressure, "displacement": displacement}[name](fields, title, scale)


def common_scale(name: str, states: Iterable[Fields]) -> Scale:
    """Return the range and the window that fit one kind of picture of all states.

    Raises:
        ValueError: there is no state, or no such picture of one, or a value in it is no number.
    """
    found = []
    for fields in states:
        _refuse(name, fields)
        found.append((*_range(name, fields), *_window(name, fields)))
    if not found:
        raise ValueError("no state to draw")
    low, high, lower, upper = zip(*found, strict=True)
    return Scale(min(low), max(high), (np.min(lower, axis=0), np.max(upper, axis=0)))


def _refuse(name: str, fields: Fields) -> None:
    if name not in available(fields):
        raise ValueError(f"no picture {name!r} of these fields; there is {', '.join(available(fields))}")
    shown = np.unique(fields.cells[(fields.region == FLUID) != (name == "displacement")])
    for what, values in (("displacement", fields.deformed), (name, getattr(fields, name)[shown])):
        if not np.isfinite(values).all():
            raise ValueError(f"the {what} holds a value that is not finite")


def _range(name: str, fields: Fields) -> tuple[float, float]:
    """Return the range of the colours in SI."""
    wet = fields.region == FLUID
    if name == "pressure":
        low, high = np.percentile(fields.pressure[np.unique(fields.cells[wet])], [0.3, 99.7])
        return float(low), float(high)
    vectors, shown = (fields.velocity, wet) if name == "velocity" else (fields.displacement, ~wet)
    return 0.0, float(np.hypot(*vectors[np.unique(fields.cells[shown])].T).max())


def _window(name: str, fields: Fields) -> tuple[Floats, Floats]:
    if name == "displacement":
        return _around(fields, fields.region != FLUID)
    return fields.deformed.min(axis=0), fields.deformed.max(axis=0)


def to_png(figure: Figure, dpi: int = 120) -> bytes:
    """Return the figure as PNG."""
    agg, own, png = FigureCanvasAgg(figure), figure.dpi, io.BytesIO()
    figure.dpi = dpi
    raw, size = agg.print_to_buffer()  # type: ignore[no-untyped-call]  # `savefig` draws what it lays out twice
    figure.dpi = own
    # Without the opacity, and 10 % larger than the best that the format can: half the time.
    Image.frombuffer("RGBA", size, raw).convert("RGB").save(png, "png", compress_level=2)
    return png.getvalue()


def to_small_png(figure: Figure, dpi: int = 150, maximum: int = 150_000) -> bytes:
    """Return the figure as PNG of at most `maximum` bytes: if need be with a palette of 256 colours, then coarser."""
    data = to_png(figure, dpi)
    if len(data) > maximum:
        data = _with_palette(data)
    while len(data) > maximum and dpi > _COARSEST:
        dpi = max(_COARSEST, int(0.98 * dpi * np.sqrt(maximum / len(data))))
        data = _with_palette(to_png(figure, dpi))
    return data


def _with_palette(png: bytes) -> bytes:
    """Return a picture with 256 colours: a third of the size, hardly a difference to the eye. White stays white."""
    with Image.open(io.BytesIO(png)) as opened:
        image = opened.convert("RGB")
    part = image.resize((-(-image.width // 4), -(-image.height // 4)), Image.Resampling.NEAREST)  # enough, and faster
    palette = part.quantize(256, kmeans=1)
    colours = np.reshape(palette.getpalette() or [], (-1, 3))
    colours[(colours > 247).all(axis=1)] = 255
    palette.putpalette(colours.ravel().tolist())
    buffer = io.BytesIO()
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
    return buffer.getvalue()


def velocity(fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Velocity magnitude in m/s with arrows; solids in a neutral colour."""
    figure, axes = canvas(title, scale.window if scale else _window("velocity", fields))
    speed = np.hypot(*fields.velocity.T)
    triangulation = split_triangles(fields, fields.region == FLUID)
    top = (scale.high if scale else _range("velocity", fields)[1]) or 1.0
    colours = axes.tripcolor(triangulation, speed, shading="gouraud", cmap="viridis", vmin=0, vmax=top, rasterized=True)
    _arrows(axes, fields, scale.high if scale else None)
    _solids(axes, fields)
    colour_bar(figure, axes, colours, "velocity magnitude (m/s)")
    return figure


def pressure(fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Pressure contours in Pa; the few extreme values at sharp corners are cut off and marked on the colour bar."""
    figure, axes = canvas(title, scale.window if scale else _window("pressure", fields))
    triangulation = split_triangles(fields, fields.region == FLUID)
    values = fields.pressure
    shown = np.array([scale.low, scale.high]) if scale else values[np.unique(triangulation.triangles)]
    levels, palette = _pressure_levels(shown)
    colours = axes.tricontourf(triangulation, values, levels=levels, cmap=palette, extend="both")
    axes.tricontour(triangulation, values, levels=levels, colors=INK, linewidths=0.35, linestyles="solid", alpha=0.55)
    _solids(axes, fields)
    colour_bar(figure, axes, colours, "pressure (Pa)", _every_other(levels))
    return figure


def displacement(fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Displacement magnitude of the solids in m with the deformed mesh around them; dashed: before the deformation."""
    solid = fields.region != FLUID
    figure, axes = canvas(title, scale.window if scale else _window("displacement", fields))
    size = np.hypot(*fields.displacement.T)
    triangulation = split_triangles(fields, solid)
    top = (scale.high if scale else _range("displacement", fields)[1]) or 1.0
    colours = axes.tripcolor(triangulation, size, shading="gouraud", cmap="YlGnBu", vmin=0, vmax=top, rasterized=True)
    width = float(np.clip(20.0 / np.sqrt(len(fields.cells)), 0.15, 0.5))
    _lines(axes, _mesh_lines(fields, ~solid), width, alpha=0.35)
    _lines(axes, _mesh_lines(fields, solid), width, alpha=0.6)
    for region in _solid_regions(fields):
        before = [fields.points[loop] for loop in _loops(_outer_edges(fields, fields.region == region))]
        axes.add_collection(LineCollection(before, colors=DASHED, linewidths=1.1, linestyles="dashed", zorder=6))
        _lines(axes, outline(fields, fields.region == region), 1.4, zorder=5)
    _lines(axes, outline(fields, np.full(len(solid), True)), 0.9)
    colour_bar(figure, axes, colours, "displacement magnitude (m)")
    return figure


def vorticity(fields: Fields, title: str = "") -> Figure:
    """Vorticity of the fluid in 1/s on the deformed mesh; the few extreme values at sharp corners are cut off."""
    return nodal(fields, gradients.vorticity(fields), "vorticity (1/s)", title, palette="RdBu_r")


def nodal(fields: Fields, values: Floats, label: str, title: str = "", palette: str = "inferno") -> Figure:
    """Draw values at the nodes of the fluid or of the solids on the deformed mesh, the rest in a neutral colour.

    Args:
        fields: the mesh and its motion.
        values: (n,) in the unit of the label, NaN off the fluid or off the solids.
        label: name and unit, at the colour bar.
        title: heading.
        palette: matplotlib's name; the range is that of 99 % of the values, about zero if they change sign.
    """
    shown: NDArray[np.bool_] = np.asarray(np.isfinite(values[fields.cells]).all(axis=1))
    if not shown.any():
        raise ValueError(f"no value of the {label} is finite")
    fluid = bool((fields.region[shown] == FLUID).any())
    figure, axes = canvas(title, _window("velocity" if fluid else "displacement", fields))
    low, high = np.percentile(values[np.unique(fields.cells[shown])], [0.5, 99.5])
    low, high = (-max(-low, high), max(-low, high)) if low < 0 else (0.0, high or 1.0)
    colours = axes.tripcolor(
        split_triangles(fields, shown), values, shading="gouraud", cmap=palette, vmin=low, vmax=high, rasterized=True
    )
    if fluid:
        _solids(axes, fields)
    for region in _solid_regions(fields):
        axes.add_collection(LineCollection(outline(fields, fields.region == region), colors=INK, linewidths=0.7))
    axes.add_collection(LineCollection(outline(fields, np.full(len(shown), True)), colors=INK, linewidths=0.9))
    colour_bar(figure, axes, colours, label)
    return figure


def _around(fields: Fields, selected: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return the corners of a window around the selected part, before and after the deformation, within the domain."""
    nodes = np.unique(fields.cells[selected])
    corners = np.concatenate([fields.points[nodes], fields.deformed[nodes]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.35 * float((high - low).max())
    return np.maximum(low - margin, fields.deformed.min(axis=0)), np.minimum(high + margin, fields.deformed.max(axis=0))


def canvas(title: str, window: tuple[Floats, Floats]) -> tuple[Figure, Axes]:
    """Return an empty picture of a window, lower left and upper right corner in m, with equal axes."""
    low, high = window
    longer = float((high - low).max())
    length, height = np.maximum(high - low, _THIN * longer or 1.0).tolist()
    margin = 0.012 * max(length, height)
    length, height = length + 2 * margin, height + 2 * margin
    ratio = height / length
    long = length > _LONG * height
    width = WIDTH - _LEFT - 0.2 if long else min(8.0, 5.5 / ratio)
    below, right = (1.35, 0.2) if long else (0.55, 1.4)
    wide, tall = _LEFT + width + right, below + width * ratio + 0.35
    # Laid out here: matplotlib would draw everything once more for it.
    figure = Figure(figsize=(wide, tall), facecolor="white")
    axes = figure.add_axes((_LEFT / wide, below / tall, width / wide, width * ratio / tall))
    axes.set_aspect("equal")
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    axes.set_xlabel("x (m)", color=INK)
    axes.set_ylabel("y (m)", color=INK)
    axes.xaxis.set_label_coords(0.5, -0.38 / (width * ratio))
    axes.yaxis.set_label_coords(-0.7 / width, 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=STEPS))
    axes.yaxis.set_major_locator(MaxNLocator(int(np.clip(24 * ratio, 4, 8)), steps=STEPS))
    axes.tick_params(colors=INK, labelsize=9, width=0.6)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(title, loc="left", fontsize=11, color=INK, y=1.0)
    return figure, axes


def colour_bar(figure: Figure, axes: Axes, colours: Any, label: str, ticks: Floats | None = None) -> None:
    """Put a colour bar beside a picture, or below a long one."""
    left, low, width, height = axes.get_position().bounds
    wide, high = figure.get_size_inches()
    long = width * wide > _LONG * height * high
    at = (
        (left + 0.2 * width, 0.55 / high, 0.6 * width, 0.13 / high)
        if long
        else (left + width + 0.15 / wide, low + 0.075 * height, 0.2 / wide, 0.85 * height)
    )
    bar = figure.colorbar(colours, cax=figure.add_axes(at), orientation="horizontal" if long else "vertical")
    bar.set_label(label, color=INK, fontsize=10)
    if long:
        bar.ax.xaxis.set_label_coords(0.5, -0.33 / (high * at[3]))
    else:
        bar.ax.yaxis.set_label_coords(1 + 0.75 / (wide * at[2]), 0.5)
    bar.ax.tick_params(colors=INK, labelsize=9, width=0.6)
    if ticks is None:
        bar.locator = MaxNLocator(8, steps=STEPS)
        formatter = ScalarFormatter()
        formatter.set_powerlimits((-2, 4))
        bar.formatter = formatter
        bar.update_ticks()
    else:
        bar.set_ticks(ticks.tolist())
    bar.outline.set_linewidth(0.4)


def split_triangles(fields: Fields, selected: NDArray[np.bool_]) -> Triangulation:
    """Return the selected triangles, each split into four, on the deformed mesh."""
    x, y = fields.deformed.T
    return Triangulation(x, y, fields.linear_triangles(selected))


def _arrows(axes: Axes, fields: Fields, longest: float | None) -> None:
    x, y = fields.deformed[np.unique(fields.cells[fields.region == FLUID])].T
    length, height = float(np.ptp(x)), float(np.ptp(y))
    step = max(max(length, height) / _ALONG, np.sqrt(length * height / (_ROW_GAP * _ARROWS)))
    grid = np.meshgrid(
        _centred(float(x.min()), float(x.max()), step), _centred(float(y.min()), float(y.max()), _ROW_GAP * step)
    )
    at = np.reshape(grid, (2, -1))
    found = replace(fields, points=fields.deformed).sample(at.T)
    wet = found["region"] == FLUID
    at, arrows = at[:, wet], np.array([found["vx"][wet], found["vy"][wet]])
    speed = np.hypot(*arrows)
    top = speed.max(initial=0.0) if longest is None else longest
    keep = speed > 0.02 * top
    if top == 0 or not keep.any():
        return
    shorten = 0.95 * step / top * np.sqrt(top / speed[keep])  # length ~ sqrt(speed), so that slow regions stay readable
    axes.quiver(
        *at[:, keep], *(arrows[:, keep] * shorten),
        angles="xy", scale_units="xy", scale=1.0, units="inches", width=0.015, headwidth=4.5, headlength=5,
        headaxislength=4.5, minlength=0.5, pivot="middle", facecolor=INK, edgecolor="white", linewidth=0.3, zorder=3,
    )  # fmt: skip


def _centred(low: float, high: float, step: float) -> Floats:
    count = max(1, round((high - low) / step))
    return np.asarray(low + (np.arange(count) + 0.5) * (high - low) / count)


def _pressure_levels(values: Floats) -> tuple[Floats, str]:
    low, high = np.percentile(values, [0.3, 99.7])
    if high - low <= _CONSTANT * max(abs(low), abs(high)):
        half = 0.5 * (abs(low) or 1.0)
        low, high = low - half, high + half
    palette = "plasma"
    if low < 0 < high and min(-low, high) > 0.5 * max(-low, high):
        low, high, palette = -max(-low, high), max(-low, high), "RdBu_r"
    return np.asarray(MaxNLocator(24, steps=STEPS).tick_values(low, high)), palette


def _every_other(levels: Floats) -> Floats:
    """Return at most nine of the levels, a round distance apart and with zero among them if it is a level."""
    step = float(levels[1] - levels[0])
    least = -(-len(levels) // 9)
    stride = next(stride for stride in range(least, 10 * least + 1) if _is_round(stride * step))
    zero = int(np.abs(levels).argmin())
    return levels[(zero % stride) :: stride]


def _is_round(value: float) -> bool:
    leading = value / 10 ** np.floor(np.log10(value) + 1e-9)
    return bool(np.isclose(leading, [1, 2, 2.5, 5]).any())


def _lines(axes: Axes, lines: list[Floats], width: float, **style: Any) -> None:
    """Draw lines of equally many nodes, (n, m, 2)."""
    if lines:
        axes.add_collection(_paths(np.array(lines), facecolors="none", edgecolors=INK, linewidths=width, **style))


def _paths(lines: Floats, **style: Any) -> PathCollection:
    """Return lines (n, m, 2) as few paths: matplotlib takes as long for a path of two nodes as for one of hundreds."""
    parts = np.array_split(lines, -(-len(lines) // _TOGETHER))
    codes = [[Path.MOVETO, *[Path.LINETO] * (lines.shape[1] - 1)] * len(part) for part in parts]
    paths = [Path(part.reshape(-1, 2), code) for part, code in zip(parts, codes, strict=True)]
    return PathCollection(paths, **style)


def _solids(axes: Axes, fields: Fields) -> None:
    for i, region in enumerate(_solid_regions(fields)):
        selected = fields.region == region
        colour = SOLID_COLOURS[i % len(SOLID_COLOURS)]
        triangles = fields.deformed[fields.linear_triangles(selected)]
        axes.add_collection(_paths(triangles, facecolors=colour, edgecolors=colour, linewidths=0.3, zorder=4))
        _lines(axes, outline(fields, selected), 1.3, zorder=5, capstyle="round")
    _lines(axes, outline(fields, fields.region == FLUID), 0.9, zorder=5, capstyle="round")


def _solid_regions(fields: Fields) -> list[int]:
    return [int(region) for region in np.unique(fields.region) if region != FLUID]


def outline(fields: Fields, selected: NDArray[np.bool_]) -> list[Floats]:
    """Return the edges of one selected triangle only, each (3, 2): start, middle, end on the deformed mesh."""
    return list(fields.deformed[_outer_edges(fields, selected)])


def _outer_edges(fields: Fields, selected: NDArray[np.bool_]) -> Ints:
    """Return the nodes (n, 3) of the edges that belong to one selected triangle only: start, middle, end."""
    edges, count = _edges(fields, selected)
    return np.asarray(edges[count == 1])


def _edges(fields: Fields, selected: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Return the nodes (n, 3) of every edge of the selected triangles, and how many of them have it."""
    nodes = fields.cells[selected][:, _EDGES].reshape(-1, 3)
    _, first, count = np.unique(nodes[:, 1], return_index=True, return_counts=True)
    return np.asarray(nodes[first]), count


def _loops(edges: Ints) -> list[list[int]]:
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


def _mesh_lines(fields: Fields, selected: NDArray[np.bool_]) -> list[Floats]:
    return list(fields.deformed[_edges(fields, selected)[0]])
