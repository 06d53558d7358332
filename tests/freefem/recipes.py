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
    """Copy the program to a folder, with what Python has compiled of it."""
    for name in FOLDERS:
        shutil.copytree(ROOT / name, root / name)
    return root


def insert(path: Path, line: str, text: str, *, after: str = "") -> None:
    """Insert the text before the first line that starts so and comes after another one."""
    found = path.read_text(encoding="utf-8")
    at = found.index(f"\n{line}", found.index(f"\n{after}")) + 1
    path.write_text(found[:at] + text + found[at:], encoding="utf-8")


def append(path: Path, text: str) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write("\n\n" + text)


def enter(path: Path, registry: str, text: str) -> None:
    """Add an entry at the end of the table that begins with a line."""
    insert(path, "}", textwrap.indent(text, "    "), after=registry)


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, (path, old)
    path.write_text(text.replace(old, new), encoding="utf-8")


def join_union(path: Path, start: str, name: str) -> None:
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


CALLS = """
import json, sys, ffsi.cli.main as module
assert module.__file__.startswith(sys.argv[1])
for arguments in json.loads(sys.argv[2]):
    try:
        module.main(arguments)
    except SystemExit as stopped:
        if stopped.code:
            raise
"""


def ffsi(root: Path, *calls: list[str]) -> subprocess.CompletedProcess[str]:
    """Call the copy's command line, once or several times in one process, until one ends with another code than 0."""
    command = [sys.executable, "-c", CALLS, str(root), json.dumps(calls)]
    environment, limit = os.environ | {"PYTHONPATH": str(root)}, 120 * len(calls)
    return subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=limit)


def call(root: Path, case: str, out: str, *settings: str) -> list[str]:
    options = [option for setting in ("mesh.level=0", *PLAIN, *settings) for option in ("--set", setting)]
    return ["run", case, "--out", str(root / out), *options]


def attempt(root: Path, case: str, out: str, *settings: str) -> subprocess.CompletedProcess[str]:
    return ffsi(root, call(root, case, out, *settings))


def run_all(root: Path, runs: dict[str, list[str]]) -> dict[str, Path]:
    """Solve cases, each with its settings, with the copy and return the folders; all must be solved and checked."""
    done = ffsi(root, *(call(root, case, out, *settings) for out, (case, *settings) in runs.items()))
    assert done.returncode == 0, done.stdout + done.stderr
    return {out: root / out for out in runs}


def run(root: Path, case: str, out: str, *settings: str) -> Path:
    return run_all(root, {out: [case, *settings]})[out]


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
