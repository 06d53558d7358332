"""Whole reports: where their numbers are from, what a browser makes of them, Markdown, runs that have not ended."""

import html
import json
import math
import re
import zlib
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from browser import CHROMIUM, chromium
from run_folders import make_run, report_text

from ffsi.files.errors import InputError
from ffsi.hemodynamics.result import Result, load_result
from ffsi.report import runs, scene, viewer, write_report
from ffsi.result.refinement import limit, refinement
from ffsi.run import one_scene, sweep
from ffsi.scene import load_scene
from ffsi.scene.keys import scene_keys
from studies import report
from studies.__main__ import main

KEY = "inflow.mean_velocity"
SWING = ("mesh.level=0", "time.step=0.05", "output.pictures=false", "output.vtu=false")
NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")


def shown(text: str) -> dict[str, str]:
    """Every number of a report with what stands before it, but those of commands, versions, scene.toml, formulas."""
    hidden = r"<(style|script|pre)\b.*?</\1>|<header>.*?</header>|Versions: [^<]*|Formulas: the paper.*?<details"
    text = html.unescape(re.sub(r"<[^>]*>", " ", re.sub(hidden, " ", text, flags=re.DOTALL)))
    return {found.group(): text[max(0, found.start() - 60) : found.end()] for found in NUMBER.finditer(text)}


def numbers(found: Any) -> list[float]:
    """Every number in what a file holds, those in its texts among them."""
    if isinstance(found, dict):
        return [number for item in (*found, *found.values()) for number in numbers(item)]
    if isinstance(found, list):
        return [number for item in found for number in numbers(item)]
    if isinstance(found, str):
        return [float(text) for text in NUMBER.findall(found)]
    return [float(found)] if isinstance(found, int | float) and not isinstance(found, bool) else []


def traced(text: str, known: list[float]) -> bool:
    """Whether a number, as it is shown, is one of those that are known, to the digits that it has."""
    value = float(text.replace("−", "-"))
    digits = max(1, len(re.sub(r"e.*|[-+−.]", "", text).lstrip("0")))
    return any(value == float(f"{number:.{digits}g}") or math.isclose(value, number, rel_tol=1e-9) for number in known)


def of_files(directory: Path) -> list[float]:
    """Every number in the files of a run or a sweep that people may read."""
    found: list[float] = []
    for path in directory.rglob("*"):
        if path.suffix == ".json":
            found += numbers(json.loads(path.read_text()))
        elif path.suffix == ".csv":
            table = pd.read_csv(path)
            found += [*table.select_dtypes("number").to_numpy(dtype=float).ravel(), *numbers(path.read_text())]
            found += [float(len(table))]
        elif path.suffix == ".toml":
            found += numbers(path.read_text())
    return [number for number in found if math.isfinite(number)]


def of_point(result: Result) -> list[float]:
    """Dimensionless numbers of a flap by formulas of this test's own, and how many numbers its tables have."""
    point = result.scene
    assert point.fluid is not None and point.inflow is not None and point.forces is not None
    rho, mu, speed = point.fluid.density, point.parameters()["fluid.viscosity"], float(point.inflow.mean_velocity or 0)
    flap = point.solid["flap"]
    lame, shear = flap.lame
    young, height = shear * (3 * lame + 2 * shear) / (lame + shear), point.forces.reference_length
    inlet = float(load_scene("flap-svk", []).parameters()["geometry.height"])
    ratios = [rho * speed * height / mu, flap.density / rho, young / (rho * speed**2), 1.5 * speed, speed * inlet]
    check = [value for value in result.data["check"].values() if value is not None]
    meanings = [item.meaning for item in scene_keys()]  # some tell a default
    return [*ratios, len(check), len({**point.words(), **result.parameters}), *numbers(meanings)]


def test_every_number_of_a_run_is_in_its_files(tmp_path, quick):
    run = make_run(tmp_path / "run")
    known = of_files(run) + of_point(load_result(run))
    found = shown(report_text(tmp_path, run))
    assert len(found) > 30 and [where for number, where in found.items() if not traced(number, known)] == []
    assert not traced("123.4567", known)


def test_every_number_of_a_sweep_is_in_its_files(tmp_path, quick, freefem, check):
    freefem.fail = 0.03
    base = load_scene("flap-svk", ["mesh.level=0", "output.pictures=false", "output.vtu=false"])
    sweep.sweep(base, {KEY: [0.01, 0.02, 0.03], "fluid.density": [1.0, 2.0]}, tmp_path / "sweep")
    text = report_text(tmp_path, tmp_path / "sweep")
    table = pd.read_csv(tmp_path / "sweep" / "sweep.csv")
    shown_point = table[table["status"] == "converged"].iloc[-1]
    last = load_result(tmp_path / "sweep" / shown_point["folder"], int(shown_point["point"]))
    known = [*of_files(tmp_path / "sweep"), *of_point(last), *table["failure"].value_counts(), len(table)]
    known += [float(table["checked"].sum())]
    assert [where for number, where in shown(text).items() if not traced(number, known)] == []
    assert "Over both varied values" in text and "J too small" in text


def test_commands_and_series_are_told_if_they_hold():
    settings = ["mesh.level=0", "inflow.mean_velocity=0.03", "outlet.kind=do-nothing", "output.vtu=false"]
    changed = load_scene("flap-svk", settings)
    assert (
        scene.command(changed) == "flap-svk --set mesh.level=0 --set inflow.mean_velocity=0.03 --set output.vtu=false"
    )
    assert scene.command(changed.model_copy(update={"name": "own"})) is None
    h = [0.4, 0.2, 0.1]
    order, value = limit(h, [3 + 5 * size**2.5 for size in h])
    assert (order, value) == (pytest.approx(2.5), pytest.approx(3))
    for values in ([1, 2, 1], [1, 1, 1], [1, 2, 4]):
        assert limit(h, values) is None and refinement(h, values).bar == max(values) - min(values)
    for power, believed in ((1.5, 1.5), (2.5, 2)):  # the bar of the finest value
        finest, before = (5 * size**power for size in (0.1, 0.2))
        bar = refinement(h, [3 + 5 * size**power for size in h]).bar
        assert bar == pytest.approx(1.25 * (before - finest) / (2**believed - 1))


def test_the_viewer_holds_the_fields(tmp_path):
    result = load_result(make_run(tmp_path / "run"))
    values = viewer.scalars(result, str(result.state_file))
    data = viewer.encode(result.fields, values)
    n, cells = data["nodes"], data["cells"]
    packed = zlib.decompress(b64decode(data["data"]))
    floats = np.frombuffer(packed, "<f4", (2 + len(values)) * n).reshape(-1, n)
    np.testing.assert_allclose(floats[:2], result.fields.deformed.T, rtol=1e-6)
    np.testing.assert_array_equal(
        np.frombuffer(packed, "<i4", 6 * cells, 4 * floats.size).reshape(-1, 6), result.fields.cells
    )
    names = [field["name"] for field in data["fields"]]
    assert {"speed", "pressure", "vorticity", "displacement", "effective stress"} <= set(names)
    for name, row in zip(names, floats[2:], strict=True):
        np.testing.assert_allclose(row, values[name][1], rtol=1e-4)
    node = np.argmin(np.hypot(*(result.fields.points - [1.2, 0.2]).T))
    there = result.at(*result.fields.points[node])
    assert floats[2 + names.index("velocity x")][node] == pytest.approx(there["vx"], rel=1e-4)


def test_a_run_that_was_killed_is_shown_as_far_as_it_got(tmp_path, quick, in_time, check):
    found = load_scene("turek-csm3", [*SWING, "time.end=2", "time.output_interval=0.4"])
    in_time.stop_at = 24
    one_scene.solve(found, tmp_path / "run")
    (tmp_path / "run" / "result.json").unlink()
    (result,) = runs.open_run(tmp_path / "run")
    assert result.data["time"]["reached"] == pytest.approx(1.2)
    text = report_text(tmp_path, tmp_path / "run")
    assert "it has not ended, or was ended from outside" in text
    assert '<span class="status bad">stopped before its end</span>' in text and "t = 1.2 of 2 s, 24 steps" in text
    assert "data:image/gif;base64," in text
    history = pd.read_csv(tmp_path / "run" / "history.csv")
    assert f"{history['tip_uy'].iloc[-1]:.8g}" in text


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(InputError, match="is no run folder"):
        runs.open_run(tmp_path)


def test_runs_stand_beside_each_other(tmp_path, quick):
    paths = [make_run(tmp_path / name, case=case) for name, case in (("a", "flap-svk"), ("b", "flap-neo-hookean"))]
    text = report_text(tmp_path, *paths, author="A. Person")
    table = text[text.index("Scenes side by side") : text.index("Scenes side by side") + 4000]
    assert "st-venant-kirchhoff" in table and "neo-hookean" in table
    assert text.index("Quantities side by side") < text.index('id="s2"') and "A. Person" in text


def test_a_report_leaves_out_what_makes_it_large(tmp_path, quick, monkeypatch):
    paths = [make_run(tmp_path / name) for name in ("a", "b")]
    whole = report_text(tmp_path, *paths)
    assert whole.count("<canvas class=") == 2 and "Left out" not in whole
    monkeypatch.setattr("ffsi.report.html.LARGEST", len(whole.encode()) - 1)
    text = report_text(tmp_path, *paths)
    assert len(text) < len(whole) and text.count("<canvas class=") == 1
    assert text.index("<canvas class=") < text.index("Left out: with this")


def test_markdown_has_the_same_tables_and_its_pictures(tmp_path, quick):
    write_report([make_run(tmp_path / "run")], tmp_path / "report.md")
    text = (tmp_path / "report.md").read_text()
    assert re.search(r"\| quantity \| value \| unit \|\n\| --- \| ---: \| --- \|\n\| drag \|", text)
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert len(pictures) == 7 and all((tmp_path / name).read_bytes() == b"png" for name in pictures)
    assert "<td" not in text and "viewer" not in text


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (make test-system)")
def test_a_browser_shows_and_prints_it(tmp_path, monkeypatch, in_time, check):
    """Nothing in the console, no request, nothing beyond the page's edge at 400 and 1600 px, fields drawn, a PDF."""
    scene_in_time = load_scene(
        "turek-csm3", ["mesh.level=0", "time.step=0.05", "time.end=1", "time.output_interval=0.5"]
    )
    one_scene.solve(scene_in_time, tmp_path / "swing")
    run = make_run(tmp_path / "run", reason="a_word_that_is_so_long_that_it_would_go_beyond_the_edge_of_a_page" * 3)
    write_report([run, tmp_path / "swing"], tmp_path / "report.html")
    with chromium() as page:
        for width, scheme in ((1600, "light"), (400, "dark")):
            page.media("", scheme)
            page.width(width)
            page.open(tmp_path / "report.html")
            assert page.value(DRAWN), "a field was not drawn"
            assert page.value("document.documentElement.scrollWidth") <= width and page.value(BEYOND) == []
            assert page.value(OVERLAP) == []
            assert page.value("[...document.images].every(image => image.complete && image.naturalWidth > 0)")
        assert page.value(LOOK).startswith("x = ")
        page.value("document.querySelector('table.sortable th').click()")
        assert page.value("document.querySelector('table.sortable th').getAttribute('aria-sort')") == "ascending"
        page.media("print")
        for width, tables in ((687, ".scroll:not(.wide)"), (1016, ".scroll.wide")):  # A4 between its margins, both ways
            page.width(width)
            assert page.value(CUT.replace("TABLES", tables)) == []
        assert page.pdf().startswith(b"%PDF") and page.complaints == [] and page.requests == []


DRAWN = """(async () => { for (let i = 0; i < 300; i++) {
  const all = [...document.querySelectorAll(".viewer")];
  if (all.length && all.every(each => each.dataset.drawn > 1000)) return true;
  await new Promise(done => setTimeout(done, 20)); } return false; })()"""
BEYOND = """[...document.querySelectorAll("body *")].filter(each => { const box = each.getBoundingClientRect();
  return box.width && box.right > document.documentElement.clientWidth + 1 && !each.closest(".scroll"); })
  .map(each => each.outerHTML.slice(0, 80))"""
OVERLAP = """(() => { const found = [];
  const all = [...document.querySelectorAll("section > *")].map(each => [each, each.getBoundingClientRect()]);
  const over = (a, b, start, end) => Math.min(a[end], b[end]) - Math.max(a[start], b[start]) > 1;
  for (const [a, p] of all) for (const [b, q] of all)
    if (a !== b && p.width && q.width && over(p, q, "left", "right") && over(p, q, "top", "bottom"))
      found.push([a.outerHTML.slice(0, 60), b.outerHTML.slice(0, 60)]);
  return found; })()"""
CUT = """[...document.querySelectorAll("TABLES")]
  .filter(each => each.scrollWidth > each.parentElement.clientWidth + 1).map(each => each.innerText.slice(0, 80))"""
LOOK = """(() => { const canvas = document.querySelector("canvas.field"), box = canvas.getBoundingClientRect();
  const at = {clientX: box.left + box.width / 2, clientY: box.top + box.height / 2};
  canvas.dispatchEvent(new PointerEvent("pointermove", at));
  return document.querySelector(".values").textContent; })()"""


def test_the_documents_of_the_studies_are_one_page(tmp_path):
    (tmp_path / "paper").mkdir()
    (tmp_path / "paper" / "one.png").write_bytes(b"png")
    (tmp_path / "paper" / "paper.md").write_text(
        "# A *study* of `it`\n\nWords, **bold** <b>.\n\n![Figure 3](one.png)\n\n*Figure 3: it is `so`.*\n\n"
        "## Part\n\n| name | value |\n| --- | ---: |\n| a \\| b | 1 |\n\n- one\n- two [there](https://x.y)\n"
    )
    with pytest.raises(SystemExit, match="0"):
        main(["report", "--out", str(tmp_path)])
    text = (tmp_path / "report.html").read_text()
    for part in (
        *("<b>bold</b> &lt;b&gt;.", "data:image/png;base64,cG5n", "<figcaption>Figure 3: it is", "<p>• one</p>"),
        *('<td>a | b</td><td class="number">1</td>', "<h2>Part</h2>", '<a href="https://x.y">there</a>'),
    ):
        assert part in text
    with pytest.raises(InputError, match="holds none of"):
        report.main(tmp_path / "paper")
