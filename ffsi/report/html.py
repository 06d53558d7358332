"""A report about runs and sweeps as one self-contained HTML file, or as Markdown with its pictures beside it."""

from __future__ import annotations

import base64
import datetime
import getpass
import platform
import re
import shlex
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.report import runs, scene, sweeps
from ffsi.report.blocks import Picture, Section
from ffsi.script.render import package_version
from ffsi.text import printable

MARKDOWN = (".md", ".markdown")
LARGEST = 5_000_000
"""Bytes that a report keeps to by what it leaves out: fields to look into, then animations, the last first."""
_PICTURE, _PICTURES = 110_000, 40_000 * 60  # bytes of one picture, and about those of all of them


def write_report(
    directories: Iterable[str | Path], output: str | Path, title: str | None = None, author: str | None = None
) -> None:
    """Write a report about run folders and sweeps, without any part outside of it.

    Args:
        directories: run folders, chains or sweeps, in the order of the report's sections; a run that has not ended is
            shown as far as it got.
        output: the HTML file; one that ends in .md is written as Markdown, its pictures into a folder beside it.
        title: heading; by default the names of the cases.
        author: who wrote it; by default the name of the user's account.

    Raises:
        InputError: no folder, or one of them holds nothing to show.
    """
    paths = [Path(item) for item in directories]
    if not paths:
        raise InputError("a report needs at least one run folder or sweep")
    opened = [(path, None if folder.is_sweep_folder(path) else runs.open_run(path)) for path in paths]
    alone = [result for _, results in opened for result in results or []]
    count = len(alone) + sum(1 for _, results in opened if results is None)
    maximum = min(_PICTURE, _PICTURES // (10 * count))
    sections: list[Section] = [sweeps.comparison(alone, maximum)] if len(alone) > 1 else []
    commands: list[str] = []
    for path, results in opened:
        if results is None:
            section, how = sweeps.sweep_section(path, maximum)
            sections.append(section)
            commands.append(how)
        else:
            sections += [runs.run_section(result, maximum) for result in results]
            what = scene.command(results[0].scene) or "scene.toml"
            asked = scene.options(results[0].data)
            verb = "sensitivities" if results[0].data.get("sensitivities") and not asked else "run"
            commands.append(f"ffsi {verb} {what} {shlex.join([*asked, '--out', path.name])}")
    names = dict.fromkeys(section.title for section in sections if section.status)
    commands.append(shlex.join(["ffsi", "report", *(path.name for path in paths), "-o", Path(output).name]))
    write_sections(sections, output, title or "Report: " + ", ".join(names), author, commands)


def write_sections(
    sections: Sequence[Section], output: str | Path, title: str, author: str | None, commands: Sequence[str]
) -> None:
    """Write sections into one file, as `write_report` does; `commands` make them again."""
    for i, section in enumerate(sections, start=1):
        section.anchor = f"s{i}"
    target = Path(output)
    content: dict[str, Any] = {
        "title": title, "author": author or _user(), "sections": sections,
        "date": datetime.date.today().isoformat(), "commands": commands, "versions": _versions(sections),
    }  # fmt: skip
    if target.suffix.lower() in MARKDOWN:
        _write_markdown(target, content)
        return
    text = _render("report.html.j2", content)
    why = f"Left out: with this the report would be larger than {LARGEST / 1e6:g} MB."
    for heavy, section in ((heavy, section) for heavy in ("viewer", "gif") for section in reversed(sections)):
        if len(text.encode()) > LARGEST and section.leave_out(heavy, why):
            text = _render("report.html.j2", content)
    folder.write_text(target, text)


def _write_markdown(target: Path, content: dict[str, Any]) -> None:
    """Write the same as Markdown; what can only be looked into stays out of it."""
    pictures = target.parent / f"{target.stem}-pictures"
    made: list[Picture] = []

    def save(picture: Picture) -> str:
        pictures.mkdir(exist_ok=True)
        made.append(picture)
        path = pictures / f"{len(made):02d}.{picture.kind}"
        path.write_bytes(picture.data)
        return f"{pictures.name}/{path.name}"

    text = _render("report.md.j2", {**content, "save": save})
    folder.write_text(target, re.sub(r"\n{3,}", "\n\n", text))


def _render(name: str, content: dict[str, Any]) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("ffsi.report"), autoescape=name.endswith(".html.j2"),
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_clean,
    )  # fmt: skip
    environment.filters |= {"cell": _cell, "base64": lambda text: base64.b64encode(text.encode()).decode("ascii")}
    return environment.get_template(name).render(content)


def _clean(value: Any) -> Any:
    """Return a text without control characters but the ends of lines; it may be a name from a file."""
    if type(value) is not str:
        return value
    return "\n".join(printable(line) for line in value.split("\n"))


def _cell(value: str | Markup) -> str:
    """Return a text for Markdown in which nothing is taken as markup, unless it is a fragment of HTML of ours."""
    if isinstance(value, Markup):
        return str(value)
    return re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", " ".join(str(value).split()))


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # an account without a name
        return "unknown"


def _versions(sections: Iterable[Section]) -> str:
    programs = dict.fromkeys(text for section in sections for text in section.programs)
    libraries = [f"{name} {version(name)}" for name in ("numpy", "scipy", "pandas", "matplotlib")]
    return ", ".join([f"ffsi {package_version()}", *programs, f"Python {platform.python_version()}", *libraries])
