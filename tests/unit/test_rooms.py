"""The rooms of the package lie on floors: imports go down only, in no circle, and the checker stands alone."""

import ast
import functools
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import ffsi

PACKAGE = Path(ffsi.__file__).parent
FLOORS = ("freefem", "files", "scene", "script", "reference", "result", "hemodynamics", "report", "run", "cli")
GROUND = ("text",)  # modules of no room, below all of them
TOP = ("__init__", "__main__")
CHECKER = {"reference", "scene", "files"}


def sources() -> dict[str, str]:
    """Text by the name of the module; a package is a module with the name `ROOM.__init__`."""
    paths = PACKAGE.rglob("*.py")
    return {".".join(path.relative_to(PACKAGE).with_suffix("").parts): path.read_text() for path in paths}


@functools.cache
def nodes(text: str) -> list[ast.AST]:
    kinds = (ast.Import, ast.ImportFrom, ast.Constant)
    return [node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds)]


def imported(name: str, text: str, known: dict[str, str]) -> Iterator[str]:
    """Modules of ours that a module imports, wherever in its text that stands, for types only or not."""
    for node in nodes(text):
        found: list[str] = []
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            package = ["ffsi", *name.split(".")][: -node.level] if node.level else []
            base = ".".join([*package, *([node.module] if node.module else [])])
            found = [f"{base}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and name not in TOP:
            found = [node.value] if node.value.removeprefix("ffsi.") in known else []
        for full in found:
            if full.partition(".")[0] not in ("ffsi", "studies"):
                continue
            words = full.split(".")[1:]
            while words and ".".join(words) not in known and ".".join([*words, "__init__"]) not in known:
                words.pop()
            module = ".".join(words)
            package = f"{module}.__init__".removeprefix(".")
            yield "studies" if full.startswith("studies") else module if module in known else package


def floor(module: str) -> int:
    """Where a module lies; raises where it is in no room."""
    room = module.partition(".")[0]
    return -1 if room in GROUND else len(FLOORS) if module in TOP else FLOORS.index(room)


def wrong(known: dict[str, str]) -> list[str]:
    found, graph = [], {}
    for name, text in known.items():
        room, graph[name] = name.partition(".")[0], set(imported(name, text, known)) - {name}
        for other in graph[name]:
            if other == "studies":
                found.append(f"{name} imports the studies")
            elif floor(other) > floor(name) or (floor(other) == floor(name) and other.partition(".")[0] != room):
                found.append(f"{name} imports {other}, which is above")
            elif room == "reference" and other.partition(".")[0] not in CHECKER:
                found.append(f"{name} imports {other}")
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        found.append(f"a circle: {' > '.join(error.args[1])}")
    return found


def test_imports_go_down_and_in_no_circle():
    assert wrong(sources()) == []


@pytest.mark.parametrize(("module", "line", "said"), [
    ("scene.model", "from ffsi.script.render import render", "script.render, which is above"),
    ("result.result", "if TYPE_CHECKING:\n    from ffsi.hemodynamics import state", "hemodynamics.state, which is"),
    ("files.folder", "def late():\n    import ffsi.cli.show", "cli.show, which is above"),
    ("freefem.process", "from ..files import arrays", "files.arrays, which is above"),
    ("reference.terms", "from ffsi.text import cut", "reference.terms imports text"),
    ("reference.terms", "from ffsi.freefem import run_script", "reference.terms imports freefem.__init__"),
    ("run.one_scene", "from studies.paper import main", "imports the studies"),
    ("scene.units", "from ffsi.scene.model import Scene", "a circle"),
    ("text", "from ffsi.files.errors import InputError", "which is above"),
    ("scene.model", "import_module('ffsi.result.result')", "result.result, which is above"),
    ("result.words", "from ffsi import solve", "result.words imports __init__, which is above"),
])  # fmt: skip
def test_a_wrong_import_is_found(module, line, said):
    known = sources()
    assert module in known and any(said in text for text in wrong(known | {module: f"{known[module]}\n{line}\n"}))


def test_a_module_of_no_room_is_found():
    with pytest.raises(ValueError, match="tuple"):
        wrong(sources() | {"helpers": "from ffsi.text import cut"})
