"""`python -m studies report`: the documents in results/ and their pictures as one HTML file."""

from __future__ import annotations

import html
import re
from pathlib import Path

from ffsi.cli import show
from ffsi.files.errors import InputError
from ffsi.files.reading import read_bytes, read_text
from ffsi.report.blocks import Block, Picture, Pictures, Section, Text, marked
from ffsi.report.html import write_sections
from ffsi.report.tables import Rows

DOCUMENTS = (
    *("paper/paper.md", "paper/aneurysm.md", "verification.md", "verification-unsteady.md", "long.md", "blood.md"),
    *("hard.md", "acid.md", "speed.md", "mesh-motion.md", "bench-scenes.md"),
)
COMMANDS = ("make paper verify verify-long verify-hard bench bench-peers", "make report")
_INLINE = ((r"`([^`]*)`", r"<code>\1</code>"), (r"\*\*([^*]+)\*\*", r"<b>\1</b>"), (r"\*([^*]+)\*", r"<i>\1</i>"),
           (r"\[([^]]*)\]\((https?:[^)]*)\)", r'<a href="\2">\1</a>'), (r"\[([^]]*)\]\([^)]*\)", r"\1"))  # fmt: skip


def main(out: Path) -> None:
    """Write `report.html` of the documents that lie in a folder.

    Raises:
        InputError: none does.
    """
    sections = [section for name in DOCUMENTS if (out / name).is_file() for section in document(out / name)]
    if not sections:
        raise InputError(f"{out} holds none of {', '.join(DOCUMENTS)}")
    write_sections(sections, out / "report.html", "ffsi: the paper's study and the verification", "ffsi", COMMANDS)
    show.note(f"wrote {out / 'report.html'}")


def document(path: Path) -> list[Section]:
    """Return a document of Markdown as sections, one for each heading, with its pictures."""
    found: list[Section] = []
    for paragraph in re.split(r"\n\s*\n", read_text(path)):
        lines = [line for line in paragraph.strip().splitlines() if line]
        if not lines:
            continue
        if heading := re.fullmatch(r"#+ (.*)", lines[0]):
            found.append(Section(heading.group(1).replace("`", "")))
            lines = lines[1:]
        last = found[-1].blocks[-1] if found and found[-1].blocks else None
        if isinstance(last, Pictures) and (caption := re.fullmatch(r"\*(.*)\*", " ".join(lines))):
            last.pictures[0].caption = caption.group(1)
        elif lines:
            found = found or [Section(path.stem)]
            found[-1].blocks.append(_block(lines, path.parent))
    return found


def _block(lines: list[str], folder: Path) -> Block:
    if lines[0].startswith("|"):
        head, rule, *body = ([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines)
        return Rows([_inline(cell) for cell in head], [[_inline(cell) for cell in row] for row in body],
                    [cell.endswith(":") for cell in rule])  # fmt: skip
    if picture := re.fullmatch(r"!\[([^]]*)\]\(([^)]+)\)", lines[0]):
        return Pictures("", [Picture(read_bytes(folder / picture.group(2), 10**7), picture.group(1))])
    listed = any(line.startswith("- ") for line in lines)
    return Text("", [_inline(re.sub("^- ", "• ", line)) for line in (lines if listed else [" ".join(lines)])])


def _inline(text: str) -> str:
    text = html.escape(text.replace("\\|", "|"), quote=False)
    for pattern, by in _INLINE:
        text = re.sub(pattern, by, text)
    return marked(text)
