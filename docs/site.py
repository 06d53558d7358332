"""Hooks of MkDocs: files outside of this folder that pages link to, tables and pictures among them, come along."""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"\]\(((?:\.\./)?)([^)#\s:]+)((?:#[^)]*)?)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add what the pages link to, and what is linked to there."""
    known = {file.src_uri for file in files}
    waiting = [(ROOT / "docs", file.content_string) for file in list(files) if file.is_documentation_page()]
    while waiting:
        folder, text = waiting.pop()
        for up, name, _ in LINK.findall(text):
            path = (folder / up / name).resolve()
            if not path.is_relative_to(ROOT) or path.is_relative_to(ROOT / "docs") or path.is_dir():
                continue
            uri = path.relative_to(ROOT).as_posix()
            if path.is_file() and uri not in known and uri != "README.md":  # it would be a second index
                known.add(uri)
                files.append(File.generated(config, uri, abs_src_path=str(path)))
                if path.suffix == ".md":
                    waiting.append((path.parent, path.read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links out of `docs/` into the site, and those of pages from outside into it."""
    folder = posixpath.dirname(page.file.src_uri)
    outside = (ROOT / page.file.src_uri).is_file()

    def lead(match: re.Match[str]) -> str:
        up, name, anchor = match.groups()
        if outside:
            target = posixpath.normpath(posixpath.join(folder, up + name))
            target = "index.md" if target == "README.md" else target.removeprefix("docs/")
            return f"]({posixpath.relpath(target, folder or '.')}{anchor})"
        return f"]({name}{anchor})" if up and not folder else match.group(0)

    return LINK.sub(lead, markdown)
