"""Where tables go: a folder, and blocks of the README between markers; and the sentence that says who wrote them."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError


class Ran(Protocol):
    """A run of which there is the content of `result.json`."""

    @property
    def data(self) -> Mapping[str, Any]:
        """The content."""


def replace_block(text: str, name: str, content: str) -> str:
    """Replace what stands between `<!-- NAME:begin -->` and `<!-- NAME:end -->`.

    Raises:
        InputError: the two markers are not there exactly once and in this order.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise InputError(f"the text needs one line {begin} and after it one line {end}")
    head, _, rest = text.partition(begin)
    tail = rest.partition(end)[2]
    return f"{head}{begin}\n{content.strip()}\n{end}{tail}"


def has_block(readme: Path, name: str) -> bool:
    """Return whether there is a file with a line `<!-- NAME:begin -->`."""
    return readme.is_file() and f"<!-- {name}:begin -->" in readme.read_text(encoding="utf-8")


def prepare(out: Path | None, readme: Path | None, block: str) -> None:
    """Refuse unusable outputs before anything is computed, and make the folder `out`.

    Raises:
        InputError: `out` is a file, or `readme` is not there or lacks the markers of `block`.
    """
    if readme is not None:
        _replaced(readme, block, "")
    if out is not None:
        if out.exists() and not out.is_dir():
            raise InputError(f"{out} is a file; --out takes a folder")
        out.mkdir(parents=True, exist_ok=True)


def publish(readme: Path | None, failures: Iterable[str], blocks: Mapping[str, str]) -> None:
    """Write each content between the markers of its block, unless a run failed, and say so.

    Args:
        readme: the file; None: nothing is written.
        failures: of all runs, as `Result.failure`.
        blocks: contents by the names of their blocks.

    Raises:
        InputError: as `prepare`.
    """
    if readme is None:
        return
    if any(failures):
        show.error(f"{readme} stays as it is, because a run failed")
        return
    for block, content in blocks.items():
        folder.write_text(readme, _replaced(readme, block, content))
    show.note(f"wrote the block{'s' if len(blocks) > 1 else ''} {', '.join(blocks)} of {readme}")


def links(text: str, names: Sequence[str], out: Path | None, readme: Path | None) -> str:
    """Return ` TEXT: [name](path), ....` with the paths of files in `out` as seen from `readme`; "" without `out`."""
    if out is None or readme is None:
        return ""
    return f" {text}: {', '.join(f'[{name}]({link(out / name, readme)})' for name in names)}."


def _replaced(readme: Path, block: str, content: str) -> str:
    if not readme.is_file():
        raise InputError(f"--readme: there is no file {readme}")
    try:
        return replace_block(readme.read_text(encoding="utf-8"), block, content)
    except InputError as error:
        raise InputError(f"{readme}: {error}") from error


def origin(command: str, runs: Iterable[Ran]) -> str:
    """Return one sentence about who wrote a table, with which FreeFEM and on which machine."""
    used: Mapping[str, Any] = next((run.data["freefem"] for run in runs if run.data.get("freefem")), {})
    solver = f"FreeFEM {used.get('version', '?')} with {used.get('solver', '?')}, one thread"
    return f"Written by `{command}` ({solver}; {processor()})."


def processor() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def link(target: Path, readme: Path) -> str:
    """Return the path of `target` as seen from the folder of `readme`."""
    return Path(os.path.relpath(target, readme.parent)).as_posix()


def command_line(name: str, levels: Sequence[int] | None) -> str:
    """Return the command that wrote a table; `levels` only if they were chosen."""
    return f"python -m studies {name}" + (f" --levels {','.join(map(str, levels))}" if levels else "")
