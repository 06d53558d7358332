"""What the tests of docs/extend.md share: its code blocks, and copies of the program to which they are added."""

import filecmp
import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

from conftest import PLAIN

ROOT = Path(__file__).parents[2]
FOLDERS = ("ffsi", "templates", "edp")


@dataclass(frozen=True)
class Place:
    """A numbered item of a recipe: the files that it names before its first code block, and its blocks."""

    files: list[str]
    blocks: list[str]


def read_places(title: str) -> list[Place]:
    """Return the numbered items of a section of the page."""
    page = (ROOT / "docs/extend.md").read_text(encoding="utf-8")
    section = re.search(rf"^## {title}\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE).group(1)
    found = []
    for item in re.split(r"^\d\. ", section, flags=re.MULTILINE)[1:]:
        blocks = re.findall(r"^ *```\w*\n(.*?)^ *```$", item, re.DOTALL | re.MULTILINE)
        files = re.findall(r"`([\w/.-]+/[\w.-]+)`", item.split("```")[0])
        found.append(Place(files, [textwrap.dedent(block) for block in blocks]))
    return found


def copy_program(root: Path) -> Path:
    """Copy the program to a folder."""
    for name in FOLDERS:
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    return root


def insert(path: Path, line: str, text: str, *, after: str = "") -> None:
    """Insert the text before the first line that starts so and comes after another one."""
    found = path.read_text(encoding="utf-8")
    at = found.index(f"\n{line}", found.index(f"\n{after}")) + 1
    path.write_text(found[:at] + text + found[at:], encoding="utf-8")


def append(path: Path, text: str) -> None:
    """Add the text at the end of a module."""
    with path.open("a", encoding="utf-8") as file:
        file.write("\n\n" + text)


def enter(path: Path, registry: str, text: str) -> None:
    """Add an entry at the end of the table that begins with a line."""
    insert(path, "}", textwrap.indent(text, "    "), after=registry)


def replace(path: Path, old: str, new: str) -> None:
    """Replace what stands there once."""
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, (path, old)
    path.write_text(text.replace(old, new), encoding="utf-8")


def join_union(path: Path, start: str, name: str) -> None:
    """Add a name to the union of classes that begins so."""
    union = re.search(rf"^{re.escape(start)}[\w| \n]+[\w]", path.read_text(encoding="utf-8"), re.MULTILINE).group(0)
    replace(path, union, f"{union} | {name}")


def differing(root: Path) -> tuple[set[str], set[str]]:
    """Return the names of the changed and of the new files of the copy; none may be missing."""
    changed, new = set(), set()

    def compare(found: filecmp.dircmp) -> None:
        assert not found.left_only, found.left_only
        folder = Path(found.right).relative_to(root)
        _, different, errors = filecmp.cmpfiles(found.left, found.right, found.common_files, shallow=False)
        changed.update(str(folder / name) for name in [*different, *errors])
        new.update(str(folder / name) for name in found.right_only)
        for inner in found.subdirs.values():
            compare(inner)

    for name in FOLDERS:
        compare(filecmp.dircmp(ROOT / name, root / name, ignore=["__pycache__"]))
    return changed, new


def ffsi(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Call the copy's command line."""
    code = f"import sys, ffsi.cli.main as m; assert m.__file__.startswith({str(root)!r}); m.main(sys.argv[1:])"
    environment = os.environ | {"PYTHONPATH": str(root)}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=120)


def attempt(root: Path, case: str, out: str, *settings: str) -> subprocess.CompletedProcess[str]:
    """Run a case with the copy on the coarsest mesh."""
    options = [option for setting in ("mesh.level=0", *PLAIN, *settings) for option in ("--set", setting)]
    return ffsi(root, "run", case, "--out", str(root / out), *options)


def run(root: Path, case: str, out: str, *settings: str) -> Path:
    """Solve a case with the copy and return the run folder; it must be solved and checked."""
    done = attempt(root, case, out, *settings)
    assert done.returncode == 0, done.stdout + done.stderr
    return root / out


def result_of(folder: Path) -> dict:
    """Return what a run found; the checker had nothing to say."""
    result = json.loads((folder / "result.json").read_text())
    assert (result["status"], result["checked"], result["check_failures"]) == ("converged", True, [])
    return result


def refused(root: Path, path: str, old: str, new: str, case: str, *settings: str) -> str:
    """Return what the checker says of a run with another text in a file of the copy, which is then put back."""
    right = (root / path).read_text(encoding="utf-8")
    replace(root / path, old, new)
    try:
        done = attempt(root, case, "wrong", *settings)
    finally:
        (root / path).write_text(right, encoding="utf-8")
        shutil.rmtree(root / "wrong", ignore_errors=True)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout + done.stderr
