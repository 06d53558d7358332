"""The pages that people read: their links lead somewhere, and what is generated is what its generator writes."""

import csv
import json
import re
import tomllib
from pathlib import Path

import pytest
from test_cli import call

from ffsi.scene.keys import markdown, scene_keys

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "examples").glob("*.md")])
LINK = re.compile(r"\]\(([^)\s]+)\)")


def anchors(page: Path) -> set[str]:
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def dead_links(page: Path) -> list[str]:
    found = []
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if target.startswith(("http://", "https://")):
            continue
        name, _, anchor = target.partition("#")
        file = page.parent / name if name else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            found.append(target)
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_link_is_dead(page):
    assert not dead_links(page)


def test_pages_links_and_keys(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# One two\n[a](#one-two) [b](#three) [c](none.md) [d](page.md#one-two) [e](https://example.org)")
    assert dead_links(page) == ["#three", "none.md"]
    pages = {page.name for page in (ROOT / "docs").glob("*.md")}
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    assert pages == {*re.findall(r"\]\((\w+\.md)\)", index), "index.md"}
    assert pages == set(re.findall(r"^  - (\w+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE))
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
    # `make keys` writes them.
    page = (ROOT / "docs/scene.md").read_text(encoding="utf-8")
    assert page.partition("<!-- keys:begin -->\n")[2] == markdown()


def test_a_key_says_what_is_accepted():
    by_key = {(item.key, item.only): item for item in scene_keys()}
    viscosity = by_key["fluid.viscosity", 'fluid.law = "newtonian"']
    assert (viscosity.unit, viscosity.default, viscosity.range) == ("Pa s", "needed", "> 0")
    assert by_key["fluid.law", ""].default == '"newtonian"'
    assert by_key["solid.NAME.poisson_ratio", 'solid.NAME.material = "neo-hookean"'].range == "> -1 and < 0.5"
    assert by_key["mesh.level", ""].accepted == "whole number 0 to 6"
    assert by_key["geometry.regions.NAME", 'geometry.kind = "mesh"'].meaning
    assert not [item for item in scene_keys() if not item.meaning or not item.type]


@pytest.mark.parametrize(("pattern", "first", "count"), [
    ("outlet", "outlet.kind", 16), ("*velocity", "inflow.mean_velocity", 4), ("solid.flap.c10", "solid.NAME.c10", 1),
])  # fmt: skip
def test_the_command_lists_a_table_or_a_pattern(pattern, first, count, capsys):
    code, out, _ = call(capsys, "keys", pattern, "--json")
    found = json.loads(out)
    assert (code, found[0]["key"], len(found)) == (0, first, count)


# What the README says of a case on a level: the largest error of these quantities, in per cent.
CLAIMS = [("cylinder-2d1", 2, ("drag_coefficient",), 0.001), ("cylinder-2d1", 2, ("lift_coefficient",), 0.1)]


@pytest.mark.parametrize(("case", "level", "quantities", "claim"), CLAIMS)
def test_the_readme_tells_the_errors_that_were_measured(case, level, quantities, claim):
    with (ROOT / "results/verification.csv").open(encoding="utf-8") as file:
        (row,) = [row for row in csv.DictReader(file) if (row["case"], row["level"]) == (case, str(level))]
    assert max(100 * abs(float(row[f"{quantity}_error"])) for quantity in quantities) < claim
    (line,) = [
        line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
        if f"`ffsi run {case} --set mesh.level={level}`" in line
    ]  # fmt: skip
    assert f"within {claim} %" in line and f"{int(row['unknowns']):,} unknowns".replace(",", " ") in line


def test_the_walk_of_contributing_and_the_citation_are_true():
    """Every file that it names is there, and holds the names that stand beside it."""
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = re.search(r"^## A walk.*?(?=^## )", page, re.DOTALL | re.MULTILINE).group(0)
    steps = re.findall(r"^\d+\. (.*)$", section, re.MULTILINE)
    assert len(steps) == 10
    for step in steps:
        words = re.findall(r"`([^`]+)`", step)
        files = [word for word in words if re.fullmatch(r"[\w.-]+/[\w./-]+", word)]
        texts = [(ROOT / file).read_text(encoding="utf-8") for file in files]
        for word in set(words) - set(files) - {"result.json"}:
            name = word.removeprefix("-").replace("_", "[_.]") if word.startswith("-") else re.escape(word)
            assert any(re.search(name, text) for text in texts), (step, word)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {project['version']}\n" in citation
    assert f"\n## {project['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
