"""The frame of every study: outputs refused first, runs side by side, tables and figures written, blocks of a page."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.freefem import stop_all
from ffsi.freefem.events import OnEvent

K = TypeVar("K")
T = TypeVar("T")
Content = Callable[[], str | bytes | pd.DataFrame]


@dataclass(frozen=True)
class Study:
    """What a study is called and where its findings go; made before anything is computed."""

    command: str  # the command that does it, without `python -m studies`
    out: Path | None = None  # folder of its files, which is made; None: none are written
    readme: Path | None = None  # file in which `blocks` are replaced, unless a run failed; None: nothing is
    blocks: Sequence[str] = ()  # those that must be there

    def __post_init__(self) -> None:
        """Refuse unusable outputs."""
        if self.readme is not None:
            for block in self.blocks:
                _replaced(self.readme, block, "")
        if self.out is not None:
            if self.out.exists() and not self.out.is_dir():
                raise InputError(f"{self.out} is a file; --out takes a folder")
            self.out.mkdir(parents=True, exist_ok=True)

    def written(self, data: Iterable[Mapping[str, Any]]) -> str:
        """Return one sentence about who wrote a table, with which FreeFEM and on which machine."""
        return origin(f"python -m studies {self.command}", data, f", one thread; {processor()}")

    def write(self, files: Mapping[str, Content], digits: str | None = "%.8g") -> None:
        """Make and write the files by their names, and say so; a table becomes CSV with so many digits."""
        if self.out is None:
            return
        for name, make in files.items():
            content = make()
            if isinstance(content, pd.DataFrame):
                content = content.to_csv(index=False, float_format=digits)
            if isinstance(content, bytes):
                (self.out / name).write_bytes(content)
            else:
                folder.write_text(self.out / name, content)
        *first, last = (str(self.out / name) for name in files)
        show.note(f"wrote {', '.join(first)}{' and ' if first else ''}{last}")

    def links(self, text: str, names: Sequence[str]) -> str:
        """Return ` TEXT: [name](path), ....`, paths as seen from `readme`; empty without `out` or `readme`."""
        if self.out is None or self.readme is None:
            return ""
        paths = [Path(os.path.relpath(self.out / name, self.readme.parent)).as_posix() for name in names]
        return f" {text}: {', '.join(f'[{name}]({path})' for name, path in zip(names, paths, strict=True))}."

    def publish(self, failures: Sequence[str], blocks: Mapping[str, str]) -> list[str]:
        """Write each content between the markers of its block, unless a run failed, and say so; return the failures."""
        if self.readme is not None and any(failures):
            show.error(f"{self.readme} stays as it is, because a run failed")
        elif self.readme is not None:
            for block, content in blocks.items():
                folder.write_text(self.readme, _replaced(self.readme, block, content))
            show.note(f"wrote the block{'s' if len(blocks) > 1 else ''} {', '.join(blocks)} of {self.readme}")
        return list(failures)


def side_by_side(
    tasks: Mapping[K, Callable[[OnEvent], T]], jobs: int, label: str, points: int | None = None
) -> dict[K, T]:
    """Do tasks, `jobs` at a time, under one line of progress that counts `points`; return what they return by key."""
    with (
        show.progress(label, len(tasks) if points is None else points) as on_event,
        ThreadPoolExecutor(max_workers=jobs, thread_name_prefix="ffsi-run") as pool,
    ):
        running = {key: pool.submit(task, on_event) for key, task in tasks.items()}
        try:
            for job in as_completed(running.values()):
                job.result()
        except BaseException:  # Ctrl-C reaches this thread only
            pool.shutdown(wait=False, cancel_futures=True)
            stop_all()
            raise
    return {key: job.result() for key, job in running.items()}


def replace_block(text: str, name: str, content: str) -> str:
    """Replace what stands between the markers `<!-- NAME:begin -->` and `<!-- NAME:end -->`."""
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise InputError(f"the text needs one line {begin} and after it one line {end}")
    head, _, rest = text.partition(begin)
    return f"{head}{begin}\n{content.strip()}\n{end}{rest.partition(end)[2]}"


def _replaced(readme: Path, block: str, content: str) -> str:
    if not readme.is_file():
        raise InputError(f"--readme: there is no file {readme}")
    try:
        return replace_block(readme.read_text(encoding="utf-8"), block, content)
    except InputError as error:
        raise InputError(f"{readme}: {error}") from error


def origin(command: str, data: Iterable[Mapping[str, Any]], more: str = "") -> str:
    """Return one sentence about who wrote a text, with the FreeFEM of the first `result.json` that names it."""
    used: Mapping[str, Any] = next((item["freefem"] for item in data if item.get("freefem")), {})
    return f"Written by `{command}` (FreeFEM {used.get('version', '?')} with {used.get('solver', '?')}{more})."


def processor() -> str:
    """Return the name of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
