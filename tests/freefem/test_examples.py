"""Every example runs, and finds the number that it asserts."""

import re
import runpy
import shutil
from pathlib import Path

import matplotlib
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(path.name for path in EXAMPLES.glob("*.py"))
NOTEBOOKS = sorted(path.name for path in EXAMPLES.glob("*.ipynb"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_script(name, tmp_path, monkeypatch):
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert "assert " in (EXAMPLES / name).read_text(encoding="utf-8")
    assert name in ("fsi1.py", "incompressible.py", "blood.py") or list(tmp_path.iterdir())


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook(name, tmp_path):
    import nbformat
    from nbclient import NotebookClient

    shutil.copy(EXAMPLES / name, tmp_path)
    notebook = nbformat.read(tmp_path / name, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)  # they would be another version's
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert [output for output in shown if "text/html" in output.get("data", {})]
    assert [output for output in shown if "image/png" in output.get("data", {})]


def test_the_python_of_the_readme(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (EXAMPLES.parent / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    assert len([line for line in block.splitlines() if line]) <= 8
    known: dict[str, object] = {}
    exec(block, known)
    assert known["result"].checked and list(known["table"]["status"]) == 6 * ["converged"]
    assert Path("runs/tip.png").is_file()


def test_the_list_of_examples_is_whole():
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert all(f"]({name})" in page for name in (*SCRIPTS, *NOTEBOOKS)) and len(SCRIPTS) + len(NOTEBOOKS) == 12
