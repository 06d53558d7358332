"""The pictures that a run leaves, as `pictures` draws them, with numpy and Pillow alone.

Matplotlib takes longer to load than a small run to solve.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from ffsi.files.arrays import Floats, Ints, distinct
from ffsi.result import views
from ffsi.result.fields import FLUID, Fields

Colours = NDArray[np.uint8]
_ZOOM = 2  # what is inside of the axes is painted so much larger, then averaged
_AROUND = [0, 3, 1, 4, 2, 5]  # the nodes of a quadratic triangle in turn
_NEAREST = Image.Resampling.NEAREST
_WHITE, _DARKER = 255, 100  # in palettes of 256: outside, and where the colours of contour lines begin
_ARROW = np.array(
    [[-0.5, 0.1], [-0.4, 0.1], [-0.5, 0.45], [0.5, 0], [-0.5, -0.45], [-0.4, -0.1], [-0.5, -0.1]]
)  # a head
_STRETCH = np.array([-0.5, 0.5, 0.5, 0.5, 0.5, 0.5, -0.5])  # where its nodes go with the length of the shaft
_PALETTES = {  # at equal distances; matplotlib's
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b "
    "addc30 d8e219 fde725",
    "plasma": "0d0887 310597 4c02a1 6600a7 7e03a8 9511a1 aa2395 bc3587 cc4778 da5a6a e66c5c f0804e f89540 fdac33 "
    "fdc527 f8df25 f0f921",
    "YlGnBu": "ffffd9 edf8b1 c6e9b4 7ecdbb 40b5c4 1d90c0 225da8 243392 081d58",
    "RdBu_r": "053061 2065ab 4393c3 90c4dd d1e5f0 f7f6f6 fddbc7 f3a481 d6604d b1182b 67001f",
}


def paint(name: str, fields: Fields, title: str = "") -> bytes:
    """Paint `velocity`, `pressure` or `displacement` on the deformed mesh; return a PNG.

    Raises:
        ValueError: these fields have no such picture, or a value in it is no number.
    """
    views.refuse(name, fields)
    sheet, wet = _Sheet(views.window_of(name, fields), title), fields.region == FLUID
    if name == "pressure":
        levels, palette = views.pressure_levels(fields.pressure[distinct(fields.cells[wet])])
        colours = _colours(palette, len(levels) + 1)
        sheet.contours(fields, wet, fields.pressure, levels, colours)
        sheet.bar(colours, levels[0], levels[-1], views.every_other(levels), views.LABELS[name], extended=True)
    else:
        vectors, shown, palette = (
            (fields.velocity, wet, "viridis") if name == "velocity" else (fields.displacement, ~wet, "YlGnBu")
        )
        top, colours = views.range_of(name, fields)[1] or 1.0, _colours(palette, _WHITE)
        sheet.shades(fields, shown, np.hypot(*vectors.T), 0.0, top, colours)
        sheet.bar(colours, 0.0, top, views.ticks(0.0, top, 8), views.LABELS[name])
    if name == "displacement":
        _mesh(sheet, fields)
        return sheet.png()
    if name == "velocity":
        sheet.arrows(*views.arrows(fields, None))
    for i, region in enumerate(views.solid_regions(fields)):
        selected = fields.region == region
        for cell in sheet.at(fields.deformed)[fields.cells[selected][:, _AROUND]].reshape(-1, 12).tolist():
            sheet.pen.polygon(cell, views.SOLID_COLOURS[i % len(views.SOLID_COLOURS)])
        sheet.outline(fields, selected, 1.3)
    sheet.outline(fields, wet, 0.9)
    return sheet.png()


def _mesh(sheet: _Sheet, fields: Fields) -> None:
    solid = fields.region != FLUID
    points, before = sheet.at(fields.deformed), sheet.at(fields.points)
    width = float(np.clip(20.0 / np.sqrt(len(fields.cells)), 0.15, 0.5))
    for selected, colour in ((~solid, "#b3b5b7"), (solid, "#5d666f")):
        edges = points[views.edges_of(fields, selected)[0]]
        seen = ((edges.max(axis=1) > 0) & (edges.min(axis=1) < sheet.inside.size)).all(axis=1)
        sheet.lines(edges[seen], width, colour)
    sheet.outline(fields, np.full(len(solid), True), 0.9)
    for region in views.solid_regions(fields):
        sheet.outline(fields, fields.region == region, 1.4)
        for loop in views.loops(views.outer_edges(fields, fields.region == region)):
            sheet.dashes(before[loop], 1.1, views.DASHED)


class _Sheet:
    """A page with axes; coordinates in m, pixels of the inside, which `shades` or `contours` make."""

    inside: Image.Image
    pen: ImageDraw.ImageDraw

    def __init__(self, window: tuple[Floats, Floats], title: str) -> None:
        self.frame = frame = views.Frame.of(window)
        self.page = Image.new("RGB", [int(value * views.DPI + 1e-6) for value in frame.size], "white")
        left, below, width, height = frame.box
        self.corner = _pixels(left, frame.size[1] - below - height)
        self.size = _pixels(width, height)
        self.text = ImageDraw.Draw(self.page)
        x, y = self.corner
        self.text.text((x, y - 10), title, views.INK, _font(11), "ls")
        self._axis(x, y + self.size[1], "x", 8)
        self._axis(x, y, "y", int(np.clip(24 * height / width, 4, 8)))

    def _axis(self, x: int, y: int, name: str, most: int) -> None:
        """Put numbers and the name to the lower or to the left side, which begins at a pixel."""
        across, (width, height) = int(name == "y"), self.size
        low, high = self.frame.low[across], self.frame.high[across]
        at = views.ticks(low, high, most)
        at = at[(at >= low) & (at <= high)]
        numbers, factor = _numbers(at, -5, 6)
        for value, number in zip((at - low) / (high - low), numbers, strict=True):
            if across:
                level = y + (1 - value) * height
                self.text.line((x - 6, level, x, level), views.INK)
                self.text.text((x - 12, level), number, views.INK, _font(9), "rm")
            else:
                level = x + value * width
                self.text.line((level, y, level, y + 6), views.INK)
                self.text.text((level, y + 11), number, views.INK, _font(9), "mt")
        label = f"{name} ({factor}m)"
        if across:
            self._upright(x - round(0.7 * views.DPI), y + height // 2, label)
        else:
            self.text.text((x + width / 2, y + 0.38 * views.DPI), label, views.INK, _font(10), "mt")

    def _upright(self, right: int, middle: int, words: str) -> None:
        """Write upwards, left of a pixel."""
        left, top, end, bottom = (round(value) for value in _font(10).getbbox(words, anchor="lt"))
        line = Image.new("RGB", (end - left + 2, bottom - top + 2), "white")
        ImageDraw.Draw(line).text((1, 1), words, views.INK, _font(10), "lt")
        turned = line.transpose(Image.Transpose.ROTATE_90)
        self.page.paste(turned, (right - turned.width, middle - turned.height // 2))

    def at(self, points: Floats, zoom: int = _ZOOM) -> Floats:
        """Return the pixels of points (n, 2), not rounded."""
        scale = zoom * np.array(self.size) / (self.frame.high - self.frame.low)
        return np.asarray((points - [self.frame.low[0], self.frame.high[1]]) * scale * [1, -1])

    def lines(self, lines: Iterable[Floats], width: float, colour: str = views.INK) -> None:
        """Draw lines of pixels (n, 2); their width in points."""
        thick = max(1, round(width * views.DPI * _ZOOM / 72))
        core, ink = self.pen.draw, self.pen.draw.draw_ink(ImageColor.getrgb(colour))
        for line in lines:
            if thick > 4:
                self.pen.line(line.ravel().tolist(), colour, thick, "curve")
            else:  # without joints, past what Pillow does about colours for each line, which takes longer than drawing
                core.draw_lines(line.ravel().tolist(), ink, thick)

    def outline(self, fields: Fields, selected: NDArray[np.bool_], width: float) -> None:
        """Draw the outer edges of triangles."""
        points = self.at(fields.deformed)
        self.lines((points[loop] for loop in views.loops(views.outer_edges(fields, selected))), width)

    def dashes(self, line: Floats, width: float, colour: str) -> None:
        """Draw a dashed line of pixels (n, 2)."""
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
        period = 5.3 * width * views.DPI * _ZOOM / 72
        starts = np.arange(0.0, along[-1], period)
        ends = np.minimum(starts + 0.7 * period, along[-1])
        stops = np.sort(np.concatenate([starts, ends, along]))
        points = np.column_stack([np.interp(stops, along, values) for values in line.T])
        places = zip(np.searchsorted(stops, starts), np.searchsorted(stops, ends, "right"), strict=True)
        self.lines((points[first:past] for first, past in places), width, colour)

    def shades(
        self, fields: Fields, shown: NDArray[np.bool_], values: Floats, low: float, high: float, colours: Colours
    ) -> None:
        """Colour triangles by values at the nodes, linear on the four parts of a large triangle."""
        first, where, found = self._values(fields, shown, values, 1, 6.0)
        found -= np.float32(low)
        found *= np.float32((len(colours) - 1) / (high - low))
        shade = np.where(where, np.clip(found, 0, len(colours) - 1), _WHITE).astype(np.uint8)
        self._fill(
            first, Image.fromarray(shade).resize((_ZOOM * shade.shape[1], _ZOOM * shade.shape[0]), _NEAREST), colours
        )

    def contours(
        self, fields: Fields, shown: NDArray[np.bool_], values: Floats, levels: Floats, colours: Colours
    ) -> None:
        """Colour triangles between levels, with lines at them."""
        first, where, found = self._values(fields, shown, values, _ZOOM, np.inf)
        found -= np.float32(levels[0])
        found *= np.float32(1 / (levels[1] - levels[0]))
        band = np.clip(np.floor(found) + 1, 0, len(levels)).astype(np.uint8)
        line = np.zeros(band.shape, bool)
        line[:, 1:] |= (band[:, 1:] != band[:, :-1]) & where[:, :-1]
        line[1:] |= (band[1:] != band[:-1]) & where[:-1]
        ink = np.array([int(views.INK[i : i + 2], 16) for i in (1, 3, 5)])
        both = np.zeros((_WHITE, 3), np.uint8)
        both[: len(colours)] = colours
        both[_DARKER : _DARKER + len(colours)] = 0.45 * colours + 0.55 * ink
        self._fill(first, Image.fromarray(np.where(where, band + np.uint8(_DARKER) * line, np.uint8(_WHITE))), both)

    def _values(
        self, fields: Fields, shown: NDArray[np.bool_], values: Floats, zoom: int, smallest: float
    ) -> tuple[Ints, NDArray[np.bool_], NDArray[np.float32]]:
        """Return the first pixel around the triangles and of each whether it lies in one, and the value there.

        A pixel of the page has `zoom` to each side; values are linear on each triangle, of larger ones on each part.
        """
        cells, points = fields.cells[shown], self.at(fields.deformed, zoom)
        around = points[cells].reshape(-1, 2)
        first = np.maximum(np.floor(around.min(axis=0)), 0).astype(int)
        beyond = np.minimum(np.ceil(around.max(axis=0)) + 1, zoom * np.array(self.size)).astype(int)
        points -= first
        large = shown & (np.ptp(points[fields.cells], axis=1).max(axis=1) > smallest)
        parts, cells = fields.linear_triangles(large), fields.cells[shown & ~large]
        triangles = np.concatenate([parts, cells[:, :3]])
        corners = points[triangles]
        image = Image.new("I", tuple((beyond - first).tolist()), 0)
        core = ImageDraw.Draw(image).draw  # as for lines
        shapes = [*points[parts].reshape(-1, 6).tolist(), *points[cells[:, _AROUND]].reshape(-1, 12).tolist()]
        for i, shape in enumerate(shapes, 1):
            core.draw_polygon(shape, core.draw_ink(i), 1)
        number = np.asarray(image).astype(np.intp)  # once, not by each of the arrays that it picks from
        (a, b), change = np.moveaxis(corners[:, 1:] - corners[:, :1], 0, -1), values[triangles]
        rise, other = change[:, 1] - change[:, 0], change[:, 2] - change[:, 0]
        area = a[0] * b[1] - a[1] * b[0]
        area = np.where(abs(area) < 1e-9, np.inf, area)  # thinner than a pixel
        slope = np.array([rise * b[1] - other * a[1], other * a[0] - rise * b[0]]) / area
        base = change[:, 0] - (slope * corners[:, 0].T).sum(axis=0)
        plane = np.zeros((3, len(triangles) + 1), np.float32)
        plane[:, 1:] = base, *slope
        height, width = number.shape
        found = plane[1][number] * np.arange(width, dtype=np.float32)
        found += plane[2][number] * np.arange(height, dtype=np.float32)[:, None]
        found += plane[0][number]
        return _ZOOM // zoom * first, np.asarray(number > 0), found

    def _fill(self, first: Ints, image: Image.Image, colours: Colours) -> None:
        image.putpalette([*colours.ravel().tolist(), *[255] * (3 * (256 - len(colours)))])
        self.inside = Image.new("RGB", (_ZOOM * self.size[0], _ZOOM * self.size[1]), "white")
        self.inside.paste(image.convert("RGB"), (int(first[0]), int(first[1])))
        self.pen = ImageDraw.Draw(self.inside)

    def arrows(self, at: Floats, arrows: Floats) -> None:
        """Draw arrows (2, n) with their middles at places (2, n)."""
        along = self.at((at + arrows).T) - self.at(at.T)
        length = np.maximum(np.hypot(*along.T), 1e-30)[:, None]
        along, full = along / length, 0.075 * views.DPI * _ZOOM  # the length of heads
        head = np.minimum(length, full)
        forward, aside = head * _ARROW[:, 0] + (length - head) * _STRETCH, head * _ARROW[:, 1]
        shapes = forward[..., None] * along[:, None] + aside[..., None] * (along[:, ::-1] * [-1, 1])[:, None]
        for shape in (self.at(at.T)[:, None] + shapes).reshape(-1, 2 * len(_ARROW)).tolist():
            self.pen.polygon(shape, views.INK, "white")

    def bar(
        self, colours: Colours, low: float, high: float, ticks: Floats, label: str, *, extended: bool = False
    ) -> None:
        """Put the colour bar; `extended`: with the first and the last colour beyond its ends."""
        (left, below, width, height), long = views.bar_of(self.frame.box)
        length, thick = (_ZOOM * value for value in _pixels(*((width, height) if long else (height, width))))
        end = round(length / 22) if extended else 0
        strip = Image.new("RGB", (length, thick), "white")
        pen, shades = ImageDraw.Draw(strip), colours[1:-1] if extended else colours
        strip.paste(Image.fromarray(shades[None]).resize((length - 2 * end, thick), _NEAREST), (end, 0))
        frame: list[float] = [0, 0, length - 1, 0, length - 1, thick - 1, 0, thick - 1]
        if extended:
            middle, last = thick / 2, length - end
            pen.polygon([end, 0, 0, middle, end, thick], tuple(colours[0].tolist()))
            pen.polygon([last, 0, length, middle, last, thick], tuple(colours[-1].tolist()))
            frame = [end, 0, last, 0, length - 1, middle, last, thick - 1, end, thick - 1, 0, middle]
        pen.line([*frame, *frame[:2]], views.INK)
        strip = (strip if long else strip.transpose(Image.Transpose.ROTATE_90)).reduce(_ZOOM)
        x, y = _pixels(left, self.frame.size[1] - below - height)
        self.page.paste(strip, (x, y))
        ticks = ticks[(ticks >= low) & (ticks <= high)]
        numbers, factor = _numbers(ticks, -2, 4)
        for value, number in zip((ticks - low) / (high - low), numbers, strict=True):
            at = (end + value * (length - 2 * end)) / _ZOOM
            if long:
                self.text.line((x + at, y + strip.height, x + at, y + strip.height + 6), views.INK)
                self.text.text((x + at, y + strip.height + 11), number, views.INK, _font(9), "mt")
            else:
                level = y + strip.height - at
                self.text.line((x + strip.width, level, x + strip.width + 6, level), views.INK)
                self.text.text((x + strip.width + 12, level), number, views.INK, _font(9), "lm")
        label = label.replace("(", f"({factor}")
        if long:
            self.text.text((x + strip.width / 2, y + 0.46 * views.DPI), label, views.INK, _font(10), "mt")
        else:
            self._upright(x + strip.width + views.DPI, y + strip.height // 2, label)

    def png(self) -> bytes:
        """Return the page as PNG; each row as differences of neighbours (Pillow tries five filters for every row)."""
        self.page.paste(self.inside.reduce(_ZOOM), self.corner)
        width, height = self.page.size
        colours = np.asarray(self.page).reshape(height, 3 * width)
        rows = np.ones((height, 3 * width + 1), np.uint8)
        rows[:, 1:4], rows[:, 4:] = colours[:, :3], colours[:, 3:] - colours[:, :-3]
        header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
        parts = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 1)), (b"IEND", b""))
        chunks = [
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
            for kind, data in parts
        ]
        return b"".join([b"\x89PNG\r\n\x1a\n", *chunks])


def _pixels(*inches: float) -> tuple[int, int]:
    width, height = (round(value * views.DPI) for value in inches)
    return width, height


@cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font of the other pictures; size in points."""
    places = getattr(find_spec("matplotlib"), "submodule_search_locations", None) or [""]
    pixels = size * views.DPI / 72
    try:
        return ImageFont.truetype(str(Path(places[0], "mpl-data/fonts/ttf/DejaVuSans.ttf")), pixels)
    except OSError:
        return ImageFont.load_default(pixels)


def _colours(name: str, count: int) -> Colours:
    known = np.array([list(bytes.fromhex(colour)) for colour in _PALETTES[name].split()])
    at = np.linspace(0, len(known) - 1, count)
    return np.stack([np.interp(at, np.arange(len(known)), part) for part in known.T], axis=1).round().astype(np.uint8)


def _numbers(values: Floats, least: int, most: int) -> tuple[list[str], str]:
    """Return numbers in words, and for the label the power of ten that they lack, unless from least to most."""
    largest = float(abs(values).max(initial=0.0))
    power = int(np.floor(np.log10(largest) + 1e-9)) if largest else 0
    power = power if power < least or power >= most else 0
    scaled = values / 10.0**power
    digits = next((n for n in range(12) if np.allclose(scaled * 10**n, np.round(scaled * 10**n), atol=1e-6)), 12)
    return [f"{value + 0.0:.{digits}f}".replace("-", "\u2212") for value in scaled], f"1e{power} " if power else ""
