"""What a report consists of: sections of tables, pictures, texts and fields to look into."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from markupsafe import Markup
from matplotlib.figure import Figure

from ffsi.report.tables import Rows
from ffsi.result import pictures

DPI = 110


@dataclass
class Picture:
    """A picture as it is in a file, with its caption; `kind` is png or gif."""

    data: bytes
    caption: str
    kind: str = "png"

    @classmethod
    def of(cls, figure: Figure, caption: str, maximum: int) -> Picture:
        """Return a figure as a PNG of at most `maximum` bytes."""
        return cls(pictures.to_small_png(figure, DPI, maximum), caption)

    @property
    def alt(self) -> str:
        """The start of the caption."""
        return self.caption.partition(".")[0].partition(";")[0]

    @property
    def base64(self) -> str:
        """The file, for an address in a page."""
        return base64.b64encode(self.data).decode("ascii")


@dataclass
class Pictures:
    """Pictures below a heading; with `slider` one at a time on a screen, side by side on paper."""

    kind: ClassVar[str] = "pictures"
    folded: ClassVar[bool] = False
    title: str
    pictures: list[Picture]
    slider: bool = False


@dataclass
class Text:
    """Paragraphs below a heading."""

    kind: ClassVar[str] = "text"
    title: str
    paragraphs: Sequence[str | Markup]
    code: str = ""
    folded: bool = False


@dataclass
class Viewer:
    """Fields on a mesh to pan, zoom and read values from (`viewer.encode`)."""

    kind: ClassVar[str] = "viewer"
    folded: ClassVar[bool] = False
    title: str
    data: dict[str, Any]


Block = Rows | Pictures | Text | Viewer


@dataclass
class Section:
    """What the report shows about one run or sweep, or about several.

    Attributes:
        status: what became of it in words, empty of a section about several; `good` where nothing is missing.
        notes: warnings, reasons of failures, and what could not be evaluated.
        programs: what the runs were computed with.
    """

    title: str
    description: str = ""
    status: str = ""
    good: bool = True
    notes: list[str] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    programs: list[str] = field(default_factory=list)
    anchor: str = ""

    def leave_out(self, heavy: str, why: str) -> bool:
        """Put words in the place of its blocks of a kind, or with pictures of a kind; return whether there was one."""
        large = [block for block in self.blocks if heavy in (block.kind, *(each.kind for each in _pictures(block)))]
        self.blocks = [Text(block.title, [why]) if block in large else block for block in self.blocks]
        return bool(large)


def _pictures(block: Block) -> list[Picture]:
    return block.pictures if isinstance(block, Pictures) else []


def marked(text: str) -> Markup:
    """Return a text of ours that is a fragment of HTML."""
    return Markup(text)
