"""Pictures of the fields on the deformed mesh (matplotlib `Figure` objects, no global state)."""

from __future__ import annotations

import io
from collections.abc import Iterable
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

from ffsi.files.arrays import Floats
from ffsi.result import gradients, views
from ffsi.result.fields import FLUID, Fields
from ffsi.result.views import DPI, INK, STEPS, Scale, outline

FAINT = "#8a9099"
_COARSEST = 50  # dots per inch
_TOGETHER = 1000  # lines in a path


def draw(name: str, fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Draw `velocity`, `pressure` or `displacement` on the deformed mesh; with a scale to compare several.

    Raises:
        ValueError: these fields have no such picture, or a value in it is no number.
    """
    views.refuse(name, fields)
    return {"velocity": velocity, "pressure": pressure, "displacement": displacement}[name](fields, title, scale)


def common_scale(name: str, states: Iterable[Fields]) -> Scale:
    """Return the range and the window that fit one kind of picture of all states.

    Raises:
        ValueError: there is no state, or no such picture of one, or a value in it is no number.
    """
    found = []
    for fields in states:
        views.refuse(name, fields)
        found.append((*views.range_of(name, fields), *views.window_of(name, fields)))
    if not found:
        raise ValueError("no state to draw")
    low, high, lower, upper = zip(*found, strict=True)
    return Scale(min(low), max(high), (np.min(lower, axis=0), np.max(upper, axis=0)))


def to_png(figure: Figure, dpi: int = DPI) -> bytes:
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
    figure, axes = canvas(title, scale.window if scale else views.window_of("velocity", fields))
    speed = np.hypot(*fields.velocity.T)
    triangulation = split_triangles(fields, fields.region == FLUID)
    top = (scale.high if scale else views.range_of("velocity", fields)[1]) or 1.0
    colours = axes.tripcolor(triangulation, speed, shading="gouraud", cmap="viridis", vmin=0, vmax=top, rasterized=True)
    _arrows(axes, fields, scale.high if scale else None)
    _solids(axes, fields)
    colour_bar(figure, axes, colours, views.LABELS["velocity"])
    return figure


def pressure(fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Pressure contours in Pa; the few extreme values at sharp corners are cut off and marked on the colour bar."""
    figure, axes = canvas(title, scale.window if scale else views.window_of("pressure", fields))
    triangulation = split_triangles(fields, fields.region == FLUID)
    values = fields.pressure
    shown = np.array([scale.low, scale.high]) if scale else values[np.unique(triangulation.triangles)]
    levels, palette = views.pressure_levels(shown)
    colours = axes.tricontourf(triangulation, values, levels=levels, cmap=palette, extend="both")
    axes.tricontour(triangulation, values, levels=levels, colors=INK, linewidths=0.35, linestyles="solid", alpha=0.55)
    _solids(axes, fields)
    colour_bar(figure, axes, colours, views.LABELS["pressure"], views.every_other(levels))
    return figure


def displacement(fields: Fields, title: str = "", scale: Scale | None = None) -> Figure:
    """Displacement magnitude of the solids in m with the deformed mesh around them; dashed: before the deformation."""
    solid = fields.region != FLUID
    figure, axes = canvas(title, scale.window if scale else views.window_of("displacement", fields))
    size = np.hypot(*fields.displacement.T)
    triangulation = split_triangles(fields, solid)
    top = (scale.high if scale else views.range_of("displacement", fields)[1]) or 1.0
    colours = axes.tripcolor(triangulation, size, shading="gouraud", cmap="YlGnBu", vmin=0, vmax=top, rasterized=True)
    width = float(np.clip(20.0 / np.sqrt(len(fields.cells)), 0.15, 0.5))
    _lines(axes, views.mesh_lines(fields, ~solid), width, alpha=0.35)
    _lines(axes, views.mesh_lines(fields, solid), width, alpha=0.6)
    for region in views.solid_regions(fields):
        before = [fields.points[loop] for loop in views.loops(views.outer_edges(fields, fields.region == region))]
        axes.add_collection(LineCollection(before, colors=views.DASHED, linewidths=1.1, linestyles="dashed", zorder=6))
        _lines(axes, outline(fields, fields.region == region), 1.4, zorder=5)
    _lines(axes, outline(fields, np.full(len(solid), True)), 0.9)
    colour_bar(figure, axes, colours, views.LABELS["displacement"])
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
    figure, axes = canvas(title, views.window_of("velocity" if fluid else "displacement", fields))
    low, high = np.percentile(values[np.unique(fields.cells[shown])], [0.5, 99.5])
    low, high = (-max(-low, high), max(-low, high)) if low < 0 else (0.0, high or 1.0)
    colours = axes.tripcolor(
        split_triangles(fields, shown), values, shading="gouraud", cmap=palette, vmin=low, vmax=high, rasterized=True
    )
    if fluid:
        _solids(axes, fields)
    for region in views.solid_regions(fields):
        axes.add_collection(LineCollection(outline(fields, fields.region == region), colors=INK, linewidths=0.7))
    axes.add_collection(LineCollection(outline(fields, np.full(len(shown), True)), colors=INK, linewidths=0.9))
    colour_bar(figure, axes, colours, label)
    return figure


def canvas(title: str, window: tuple[Floats, Floats]) -> tuple[Figure, Axes]:
    """Return an empty picture of a window, lower left and upper right corner in m, with equal axes."""
    frame = views.Frame.of(window)
    (wide, tall), (left, below, width, height) = frame.size, frame.box
    # Laid out here: matplotlib would draw everything once more for it.
    figure = Figure(figsize=frame.size, facecolor="white")
    axes = figure.add_axes((left / wide, below / tall, width / wide, height / tall))
    axes.set_aspect("equal")
    axes.set_xlim(frame.low[0], frame.high[0])
    axes.set_ylim(frame.low[1], frame.high[1])
    axes.set_xlabel("x (m)", color=INK)
    axes.set_ylabel("y (m)", color=INK)
    axes.xaxis.set_label_coords(0.5, -0.38 / height)
    axes.yaxis.set_label_coords(-0.7 / width, 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=STEPS))
    axes.yaxis.set_major_locator(MaxNLocator(int(np.clip(24 * height / width, 4, 8)), steps=STEPS))
    axes.tick_params(colors=INK, labelsize=9, width=0.6)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(title, loc="left", fontsize=11, color=INK, y=1.0)
    return figure, axes


def colour_bar(figure: Figure, axes: Axes, colours: Any, label: str, ticks: Floats | None = None) -> None:
    """Put a colour bar beside a picture, or below a long one."""
    wide, high = figure.get_size_inches()
    left, low, width, height = axes.get_position().bounds
    at, long = views.bar_of((left * wide, low * high, width * wide, height * high))
    place = (at[0] / wide, at[1] / high, at[2] / wide, at[3] / high)
    bar = figure.colorbar(colours, cax=figure.add_axes(place), orientation="horizontal" if long else "vertical")
    bar.set_label(label, color=INK, fontsize=10)
    if long:
        bar.ax.xaxis.set_label_coords(0.5, -0.33 / at[3])
    else:
        bar.ax.yaxis.set_label_coords(1 + 0.75 / at[2], 0.5)
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
    at, shown = views.arrows(fields, longest)
    if shown.size:
        axes.quiver(
            *at, *shown,
            angles="xy", scale_units="xy", scale=1.0, units="inches", width=0.015, headwidth=4.5, headlength=5,
            headaxislength=4.5, minlength=0.5, pivot="middle", facecolor=INK, edgecolor="white", linewidth=0.3,
            zorder=3,
        )  # fmt: skip


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
    for i, region in enumerate(views.solid_regions(fields)):
        selected = fields.region == region
        colour = views.SOLID_COLOURS[i % len(views.SOLID_COLOURS)]
        triangles = fields.deformed[fields.linear_triangles(selected)]
        axes.add_collection(_paths(triangles, facecolors=colour, edgecolors=colour, linewidths=0.3, zorder=4))
        _lines(axes, outline(fields, selected), 1.3, zorder=5, capstyle="round")
    _lines(axes, outline(fields, fields.region == FLUID), 0.9, zorder=5, capstyle="round")
