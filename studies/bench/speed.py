"""Error against processor time and unknowns, of whole processes: over the mesh levels, and of FSI1 beside NGSolve."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from ffsi.cli import show
from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.freefem import find_freefem
from ffsi.report.curves import LINES, MARKERS, dress
from ffsi.result.pictures import to_png
from ffsi.result.quantities import WORDS
from ffsi.result.views import INK
from studies.harness import Content, Place, Study, repeated
from studies.tables import Column, TextTable, columns, logarithmic, table, unsigned
from studies.verification.sources import ReferenceSet, compared

PEER_PYTHON = Path(".venv-peers/bin/python")  # made by `make bench-peers`
SCRIPTS = Path(__file__).parents[2] / "edp"
PEER_SCRIPT = Path(__file__).with_name("ngsolve_fsi1.py")
Values = Mapping[str, Any]
Task = Callable[[], tuple[float, Values]]  # returns seconds of processor time, and a `result.json` or what it has of it


class Sample(NamedTuple):
    """A case on several mesh levels, and the quantities whose errors count."""

    case: str
    quantities: tuple[str, ...]
    levels: Sequence[int] = range(5)


SAMPLES = (
    Sample("turek-cfd1", ("drag", "lift"), range(4)),
    Sample("turek-csm1", ("tip_ux", "tip_uy")),
    Sample("turek-fsi1", ("tip_ux", "tip_uy", "drag", "lift"), range(7)),
    Sample("flap-svk", ("tip_ux", "tip_uy", "drag", "lift")),
    Sample("aneurysm", ("pressure_drop", "wss_mean_dome", "dome_displacement_max")),
)
FSI1 = SAMPLES[2]
SIZES = ((3, 0.2, 3), (4, 0.25, 2), (4, 0.2, 3), (5, 0.15, 4), (6, 0.1, 6))  # order, size in m, layers at corners


def _mesh(far: str, body: str, corner: str, growth: str) -> tuple[str, ...]:
    sizes = {"far_size": far, "body_size": body, "corner_size": corner, "growth": growth}
    return ("mesh.level=1", *(f"mesh.{key}={value}" for key, value in sizes.items()))


# Of the flow upstream and beside the beam most of the error in u_x and lift comes: fine there, coarse at the bodies.
OWN: Mapping[str, tuple[str, ...]] = {
    "coarse, even": _mesh("0.07", "0.026", "0.006", "0.8"),
    "medium, even": _mesh("0.06", "0.026", "0.006", "0.5"),
    "level 1": ("mesh.level=1",),
    "fine, even": _mesh("0.045", "0.012", "0.004", "0.5"),
    "level 4": ("mesh.level=4",),
}
"""The settings of this program's meshes beside NGSolve."""
PROGRAMS = ("ffsi run", "ffsi script", "NGSolve")
TOLERANCES = (0.005, 0.001, 0.0002)


class Measured(NamedTuple):
    """What a process with all that it started took, with one thread: processor time in s, most memory of one in MB."""

    seconds: float
    memory: float
    code: int
    output: str
    complaint: str


def measured(command: Sequence[str | Path], environment: Mapping[str, str] = os.environ) -> Measured:
    """Run a command."""
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    with tempfile.TemporaryFile("w+") as output, tempfile.TemporaryFile("w+") as complaint:
        process = subprocess.Popen(command, env={**environment, **threads}, stdout=output, stderr=complaint)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        texts = [(file.seek(0), file.read())[1] for file in (output, complaint)]
    return Measured(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3, process.returncode, *texts)


def processor_time(command: Sequence[str | Path]) -> tuple[float, Values]:
    """Run a command that prints JSON; return seconds of processor time, and what it printed with its `memory`.

    What printed nothing has the failure `crash`, with the last line of its complaint as the reason.
    """
    done = measured(command)
    if not done.output.strip():
        reason = (done.complaint.strip().splitlines() or [f"exit code {done.code}"])[-1]
        return done.seconds, {"failure": "crash", "reason": reason}
    return done.seconds, {**json.loads(done.output), "memory": done.memory}


def own(case: str, settings: Iterable[str]) -> tuple[float, Values]:
    """Run a case of the catalogue by the command line, in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="ffsi-bench-") as out:
        flags = [part for setting in settings for part in ("--set", setting)]
        return processor_time([sys.executable, "-m", "ffsi", "run", case, *flags, "--json", "--out", out])


def script(path: Path, settings: Iterable[str]) -> tuple[float, Values]:
    """Run a script without Python, in a temporary folder: it solves and writes, as the peer's does."""
    used = find_freefem()
    with tempfile.TemporaryDirectory(prefix="ffsi-bench-") as out:
        pairs = [setting.split("=") for setting in settings]
        flags = [part for key, value in pairs for part in (f"-{key.replace('.', '_')}", value)]
        start: list[str | Path] = [used.binary, "-nw", "-ns", "-v", "0", path]
        done = measured([*start, *flags, "-out", out], used.environment())
        found = Path(out) / folder.numbered(folder.POINT, 1)
        if done.code or not found.is_file():
            return done.seconds, {"failure": "crash", "reason": f"exit code {done.code}"}
        return done.seconds, {**folder.read_json(found), "memory": done.memory}


def peer(order: int, size: float, layers: int) -> tuple[float, Values]:
    """Run FSI1 by NGSolve."""
    seconds, found = processor_time([PEER_PYTHON, PEER_SCRIPT, str(order), str(size), str(layers)])
    return seconds, found if "failure" in found else {**found, "quantities": found}


def alternating(tasks: Mapping[tuple[str, Any], Task], repeat: int) -> dict[tuple[str, Any], dict[str, Any]]:
    """Do all tasks, one after the other, so many times; by key what the last one found, with the median `seconds`."""
    times: dict[tuple[str, Any], list[float]] = {key: [] for key in tasks}
    found: dict[tuple[str, Any], Values] = {}
    for _ in range(repeat):
        for key, task in tasks.items():
            seconds, values = task()
            times[key].append(seconds)
            if not found.get(key, {}).get("failure"):  # one that failed counts
                found[key] = values
            name, failure = f"{key[0]} {key[1]}", values.get("failure")
            (show.error if failure else show.note)(f"{name}: {values.get('reason') if failure else f'{seconds:.2f} s'}")
    return {key: {**values, "seconds": median(times[key])} for key, values in found.items()}


def reference(sample: Sample, finest: Values) -> ReferenceSet:
    """Return what errors are taken against: the last source that is compared with, else the finest level's values."""
    sources = compared(sample.case)
    return sources[-1] if sources else ReferenceSet("the own finest level", finest.get("quantities", {}))


def row(found: Values, source: ReferenceSet, quantities: Sequence[str], **labels: Any) -> dict[str, Any]:
    """Return a line of the tables: of each quantity value and relative error `error_NAME`, the largest one `error`."""
    sizes = {name: found.get(name) for name in ("unknowns", "seconds", "memory")}
    line = {**labels, **sizes, "failure": found.get("failure", "")}
    values = {} if line["failure"] else {name: found["quantities"][name] for name in quantities}
    errors = {f"error_{name}": source.error(name, value) for name, value in values.items()}
    return {**line, **values, **errors, "error": max(map(abs, errors.values()), default=math.nan)}


def word(quantity: str) -> str:
    """Return what a quantity is called in tables and pictures."""
    return WORDS.get(quantity) or quantity.replace("_", " ")


def error_columns(quantities: Sequence[str]) -> list[Column]:
    """Return the columns of sizes and errors."""
    errors = [Column(word(name), f"error_{name}", "%") for name in quantities]
    return [*columns("unknowns | seconds :.2f | MB = memory :.0f"), *errors]


Curve = tuple[str, Sequence[Values], str]  # label, rows, and the key of the error


def draw(panels: Mapping[str, Sequence[Curve]]) -> Figure:
    """Draw the sizes of errors over seconds and over unknowns, a column of panels for each title."""
    figure = Figure(figsize=(4.0 * len(panels) + 1, 6.8), layout="constrained", facecolor="white")
    shown = figure.subplots(2, len(panels), squeeze=False)
    axis = {"seconds": "seconds of processor time", "unknowns": "unknowns"}
    for column, (title, curves) in zip(shown.T, panels.items(), strict=True):
        for axes, (key, name) in zip(column, axis.items(), strict=True):
            for i, (label, rows, error) in enumerate(curves):
                # The level that the others are compared with has the error 0.
                points = [(line[key], 100 * abs(line[error])) for line in rows if line.get(error)]
                style = {"color": LINES[i % len(LINES)], "marker": MARKERS[i % len(MARKERS)]}
                if points:
                    axes.plot(*zip(*points, strict=True), label=label, linewidth=1.4, markersize=5, **style)
            logarithmic(axes)
            dress(axes, title if axes is column[0] else "", name, "size of the relative error (%)")
        column[0].legend(frameon=False, fontsize=9, labelcolor=INK)
    return figure


def growth(small: Values, large: Values) -> str:
    """Return with which powers of the unknowns seconds and memory grow between two rows."""
    ratio = math.log(large["unknowns"] / small["unknowns"])
    time, memory = (math.log(large[name] / small[name]) / ratio for name in ("seconds", "memory"))
    return (
        f"From {small['unknowns']} to {large['unknowns']} unknowns n the whole process takes n^{time:.2f} of time and "
        f"n^{memory:.2f} of memory."
    )


def main_levels(*, repeat: int = 1, out: Place = None, readme: Place = None) -> list[str]:
    """Run every sample on its levels, and print errors over processor time and unknowns."""
    study = Study(repeated("bench --work-precision", repeat), out, readme, "work-precision")
    tasks = {(x.case, level): partial(own, x.case, [f"mesh.level={level}"]) for x in SAMPLES for level in x.levels}
    found = alternating(tasks, repeat)
    parts: list[str | TextTable] = []
    printed: list[TextTable] = []
    rows: list[dict[str, Any]] = []
    panels: dict[str, list[Curve]] = {}
    for case, names, levels in SAMPLES:
        source = reference(Sample(case, names), found[case, levels[-1]])
        lines = [row(found[case, level], source, names, case=case, level=level) for level in levels]
        shown = table(lines, [*columns("level"), *error_columns(names)], title=f"{case}, against {source.source}")
        printed.append(shown)
        parts += [f"`{case}`, against {source.source}:", shown]
        if case == FSI1.case and not any(line["failure"] for line in lines):
            parts.append(growth(lines[2], lines[-1]))
        rows += lines
        panels[shown.title] = [(f"${word(x)}$" if "_" in word(x) else word(x), lines, f"error_{x}") for x in names]
    return study.finish(found.values(), printed, _files(study, rows, panels), parts=parts)


def main_peers(*, repeat: int = 1, out: Place = None, readme: Place = None) -> list[str]:
    """Run FSI1 by this program and by NGSolve, alternating, and print errors over processor time and unknowns."""
    if not PEER_PYTHON.is_file():
        raise InputError(f"there is no {PEER_PYTHON}; `make bench-peers` makes that environment, and measures")
    study = Study(repeated("bench --peers", repeat), out, readme, "peers")
    both = partial(own, FSI1.case), partial(script, SCRIPTS / f"{FSI1.case}.edp")
    tasks: dict[tuple[str, Any], Task] = {
        (name, mesh): partial(do, settings)
        for name, do in zip(PROGRAMS, both, strict=False)
        for mesh, settings in OWN.items()
    }
    tasks |= {
        (PROGRAMS[-1], f"P{p}, h {h:g} m, {layers} layers"): partial(peer, p, h, layers) for p, h, layers in SIZES
    }
    found, source = alternating(tasks, repeat), reference(FSI1, {})
    rows = [row(item, source, FSI1.quantities, program=key[0], mesh=key[1]) for key, item in found.items()]
    sizes = table(rows, [*columns("program | mesh"), *error_columns(FSI1.quantities)], left=2, title=FSI1.case)
    best = table(within(rows), WITHIN, left=3, title="The least processor time with all four quantities within")
    curves = [(name, [line for line in rows if line["program"] == name], "error") for name in PROGRAMS]
    panels = {f"{FSI1.case}, the largest of four errors": curves}
    return study.finish(found.values(), [sizes, best], _files(study, rows, panels), sizes=sizes, best=best)


def within(rows: Sequence[Values]) -> list[dict[str, Any]]:
    """Return by tolerance and program the cheapest row whose errors are all within; `ratio`: to NGSolve's seconds."""
    made = []
    for tolerance in TOLERANCES:
        good = sorted((line for line in rows if line["error"] <= tolerance), key=lambda line: -float(line["seconds"]))
        best = {line["program"]: line for line in good}  # the cheapest comes last
        peers = best.get(PROGRAMS[-1], {}).get("seconds", math.nan)
        made += [{**x, "tolerance": f"{100 * tolerance:g} %", "ratio": x["seconds"] / peers} for x in best.values()]
    return made


WITHIN = (
    *columns("within = tolerance | program | mesh | unknowns | seconds :.2f"),
    Column("largest error", lambda line: unsigned(line["error"])),
    *columns("of NGSolve's seconds = ratio :.2f"),
)


def _files(study: Study, rows: Sequence[Values], panels: Mapping[str, Sequence[Curve]]) -> Mapping[str, Content]:
    return {f"{study.name}.csv": lambda: pd.DataFrame(rows), f"{study.name}.png": lambda: to_png(draw(panels))}
