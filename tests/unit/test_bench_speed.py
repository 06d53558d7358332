"""Error against processor time: what whole processes cost, against what errors are taken, beside NGSolve."""

import math
import sys
from itertools import count
from pathlib import Path

import pandas as pd
import pytest

from ffsi.files.errors import InputError
from studies.bench import speed
from studies.bench.speed import SAMPLES, Sample, alternating, processor_time, reference, row, within

PROGRAMS = ("ffsi run", "ffsi script", "NGSolve")
BURN = "import time; t = time.process_time()\nwhile time.process_time() - t < {}: pass\n"
NESTED = "import subprocess, sys; subprocess.run([sys.executable, '-c', {!r}]); print('{{\"unknowns\": 7}}')"


def test_children_count_tasks_alternate_and_failures_stay():
    seconds, found = processor_time([sys.executable, "-c", NESTED.format(BURN.format(0.3))])
    assert found["unknowns"] == 7 and found["memory"] > 5 and 0.3 < seconds < 3
    _, found = processor_time([sys.executable, "-c", "raise SystemExit('no such mesh')"])
    assert found == {"failure": "crash", "reason": "no such mesh"}
    order, numbers = [], count()

    def task(name, seconds, failing=-1):
        def do():
            order.append(name)
            return next(seconds), {"failure": "check" if next(numbers) == failing else ""}

        return do

    tasks = {("a", 1): task("a", iter([1.0, 9.0, 2.0])), ("b", 1): task("b", iter([5.0, 5.0, 7.0]), failing=1)}
    found = alternating(tasks, 3)
    assert order == ["a", "b"] * 3 and [item["seconds"] for item in found.values()] == [2, 5]
    assert [item["failure"] for item in found.values()] == ["", "check"]


def test_errors_and_the_cheapest_within_each_tolerance():
    assert reference(SAMPLES[2], {}).values["tip_ux"] == 2.2681e-5
    own = reference(Sample("flap-svk", ("drag",)), {"quantities": {"drag": 2.0}})
    line = row({"unknowns": 10, "seconds": 1.0, "quantities": {"drag": 1.9, "lift": 3.0}}, own, ("drag",), level=0)
    assert (line["error_drag"], line["error"]) == (pytest.approx(-0.05), pytest.approx(0.05))
    assert math.isnan(row({"seconds": 1.0, "failure": "crash"}, own, ("drag",))["error"])

    def line(program, seconds, error):
        return {"program": program, "mesh": "", "unknowns": 1, "seconds": seconds, "error": error}

    nan = float("nan")
    rows = [
        line("ffsi run", 1.0, 0.02),
        line("ffsi run", 3.0, 0.004),
        line("ffsi run", 6.0, 0.0009),
        line("ffsi run", 0.1, nan),
    ]
    rows += [line("NGSolve", 9.0, 0.0001), line("NGSolve", 2.0, 0.0008)]
    found = {(x["tolerance"], x["program"]): (x["seconds"], x["ratio"]) for x in within(rows)}
    assert found == {
        ("0.5 %", "ffsi run"): (3, 1.5), ("0.5 %", "NGSolve"): (2, 1), ("0.1 %", "ffsi run"): (6, 3),
        ("0.1 %", "NGSolve"): (2, 1), ("0.02 %", "NGSolve"): (9, 1),
    }  # fmt: skip


def solved(case, settings):
    """A run whose errors halve from level to level."""
    level = settings if isinstance(settings, int) else int(settings[0][-1])
    names = next(sample.quantities for sample in SAMPLES if sample.case == case)
    values = {name: 1 + 0.1 / 2**level for name in names}
    return 1.0 + level, {"unknowns": 1000 * 2**level, "memory": 90.0 * 2**level, "failure": "", "quantities": values}


@pytest.mark.parametrize(("block", "main"), [("work-precision", speed.main_levels), ("peers", speed.main_peers)])
def test_tables_and_pictures_are_written(block, main, tmp_path, monkeypatch):
    page = tmp_path / "speed.md"
    page.write_text(f"<!-- {block}:begin -->\n<!-- {block}:end -->\n")
    monkeypatch.setattr(speed, "own", solved)
    monkeypatch.setattr(speed, "script", solved)
    monkeypatch.setattr(speed, "peer", lambda order, size, layers: solved("turek-fsi1", order))
    monkeypatch.setattr(speed, "PEER_PYTHON", page)
    assert set(main(out=tmp_path, readme=page)) == {""}
    frame = pd.read_csv(tmp_path / f"{block}.csv")
    assert len(frame) == (26 if block == "work-precision" else 15)
    assert (tmp_path / f"{block}.png").read_bytes().startswith(b"\x89PNG")
    text = page.read_text()
    assert f"Written by `python -m studies bench --{block}`" in text
    assert ("`flap-svk`, against the own finest level:" if block == "work-precision" else "| NGSolve |") in text


def test_without_ngsolve_the_command_that_installs_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "PEER_PYTHON", tmp_path / "python")
    with pytest.raises(InputError, match="make bench-peers"):
        speed.main_peers()


@pytest.mark.parametrize("tolerance", ["0.1 %", "0.02 %"])
def test_the_readme_tells_what_was_measured_beside_the_peer(tolerance):
    root = Path(__file__).parents[2]
    best = within(pd.read_csv(root / "results/peers.csv").to_dict("records"))
    own, script, other = (
        next(x for x in best if (x["tolerance"], x["program"]) == (tolerance, name)) for name in PROGRAMS
    )
    lines = (root / "README.md").read_text(encoding="utf-8").splitlines()
    command = " ".join(f"--set {setting}" for setting in speed.OWN[own["mesh"]])
    (line,) = [line for line in lines if f"ffsi run turek-fsi1 {command}`" in line]
    assert f"within {tolerance}" in line
    assert script["mesh"] == own["mesh"] and f"{script['seconds']:.1f} s as a script" in line
    for item in (own, other):
        assert f"{item['seconds']:.1f} s" in line and f"{item['unknowns']:,} unknowns".replace(",", " ") in line
