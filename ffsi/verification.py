"""`ffsi verify`: the benchmark cases on several meshes, beside published values, as CSV, Markdown and in the README."""

from __future__ import annotations

import csv
import math
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ffsi import folder, show
from ffsi.folder import InputError
from ffsi.freefem import FreeFEMError, FreeFEMNotFound
from ffsi.references import references
from ffsi.run import solve
from ffsi.scene import CASES, load_scene

CSV = "verification.csv"
MARKDOWN = "verification.md"
FINEST = {"turek-fsi1": 4}  # finest mesh level where it is not 3
SHORT_LEVEL = 2  # the level of the README's table
CAVITY = "cavity-flexible-floor"

# Quantities that have references, and their column in the tables.
COLUMNS = {
    "tip_ux": "u_x",
    "tip_uy": "u_y",
    "drag": "drag",
    "lift": "lift",
    "drag_coefficient": "drag",
    "lift_coefficient": "lift",
    "pressure_difference": "Δp",
}
HEAD = tuple(dict.fromkeys(COLUMNS.values()))
NOTHING = "–"


@dataclass(frozen=True)
class ReferenceSet:
    """Values of one source for one case: `values` by quantity (SI); those not `compared` are only listed."""

    source: str
    values: Mapping[str, float]
    compared: bool = True

    def error(self, quantity: str, value: float) -> float:
        """Return (value - reference) / |reference|; NaN if the source has no such quantity."""
        reference = self.values.get(quantity)
        return float("nan") if reference is None else (value - reference) / abs(reference)


def reference_sets(case: str) -> list[ReferenceSet]:
    """Return what is known about a steady case, the published benchmark values first; empty if there is nothing.

    Periodic values (those with an amplitude) are left out.
    """
    steady = {name: item.mean for name, item in references(case).items() if item.amplitude is None}
    first = [ReferenceSet("Featflow" if case.startswith("turek") else "DFG", steady)] if steady else []
    return [*first, *_further().get(case, [])]


@cache
def _further() -> dict[str, list[ReferenceSet]]:
    found: dict[str, dict[tuple[str, bool], dict[str, float]]] = {}
    text = files("ffsi").joinpath("data/further_values.csv").read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        values = found.setdefault(row["case"], {}).setdefault((row["source"], row["use"] == "error"), {})
        values[row["quantity"]] = float(row["value"])
    return {
        case: [ReferenceSet(source, values, compared) for (source, compared), values in sources.items()]
        for case, sources in found.items()
    }


@dataclass(frozen=True)
class Measurement:
    """One run of a case on one mesh level; `data` is the content of its `result.json`."""

    case: str
    level: int
    data: Mapping[str, Any]

    @property
    def failure(self) -> str:
        """Empty, or why there is nothing to compare: as `Result.failure`."""
        return str(self.data.get("failure", ""))

    @property
    def quantities(self) -> dict[str, float]:
        """Quantities (SI) that have a column in the tables."""
        return {name: value for name, value in (self.data.get("quantities") or {}).items() if name in COLUMNS}

    @property
    def timings(self) -> dict[str, float]:
        """Seconds by phase."""
        return dict(self.data.get("timings") or {})

    @property
    def check_maximum(self) -> float:
        """Largest number of the reference checker (relative residuals and differences); NaN if it did not run."""
        numbers = [value for value in (self.data.get("check") or {}).values() if isinstance(value, (int, float))]
        return max(numbers, default=float("nan"))

    def errors(self, source: ReferenceSet) -> dict[str, float]:
        """Return the relative error of each quantity that `source` has."""
        return {name: source.error(name, self.quantities[name]) for name in source.values if name in self.quantities}


def measure(case: str, level: int) -> Measurement:
    """Run and check a catalogue case on one mesh level, with one thread and in a temporary folder.

    A process that dies is a Measurement with the failure `crash`.

    Raises:
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    scene = load_scene(case, [f"mesh.level={level}"])
    try:
        with show.progress(f"{case} level {level}") as on_event:
            data: Mapping[str, Any] = solve(scene, on_event=on_event, threads=1).data
    except FreeFEMNotFound:
        raise
    except FreeFEMError as error:
        data = {"case": case, "status": "failed", "failure": "crash", "reason": str(error), "level": level}
    if data.get("failure"):
        show.error(f"{case} level {level}: {data['reason']}")
    return Measurement(case, level, data)


@dataclass
class TextTable:
    """A table of text for a terminal or Markdown; the first `left` columns are aligned to the left."""

    head: Sequence[str]
    left: int = 1
    title: str = ""
    body: list[list[str]] = field(default_factory=list)

    def add(self, *cells: str) -> None:
        """Append a row.

        Raises:
            ValueError: another number of cells than columns.
        """
        if len(cells) != len(self.head):
            raise ValueError(f"{len(cells)} cells for {len(self.head)} columns")
        self.body.append(list(cells))

    def markdown(self) -> str:
        """Return the table in Markdown."""
        marks = ["---" if i < self.left else "---:" for i in range(len(self.head))]
        return "\n".join(f"| {' | '.join(row)} |" for row in [list(self.head), marks, *self.body])

    def print(self) -> None:
        """Print the table on stdout."""
        table = Table(box=None, pad_edge=False, header_style="bold", title=self.title or None, title_justify="left")
        for i, name in enumerate(self.head):
            table.add_column(Text(name), justify="left" if i < self.left else "right", no_wrap=True)
        for row in self.body:
            table.add_row(*(Text(cell) for cell in row))
        console = Console(highlight=False)
        (console if console.is_terminal else Console(highlight=False, width=200)).print(table)


def percent(error: float) -> str:
    """Return a relative error in percent: three decimals, more where two digits need them."""
    if math.isnan(error):
        return NOTHING
    decimals = 3 if abs(error) < 1e-10 else min(max(3, 1 - math.floor(math.log10(100 * abs(error)))), 8)
    return f"{100 * error:+.{decimals}f} %"


def number(value: Any, form: str = "{:.1f}") -> str:
    """Return a formatted number, or a dash if there is none."""
    return NOTHING if value is None or pd.isna(value) else form.format(value)


def error_table(runs: Iterable[Measurement]) -> TextTable:
    """Return one row per run and source: unknowns, seconds, errors, the checker's largest number."""
    table = TextTable(("case", "compared with", "level", "unknowns", "seconds", *HEAD, "largest check"), left=2)
    for run in runs:
        for source in reference_sets(run.case):
            if source.compared:
                errors = {COLUMNS[name]: error for name, error in run.errors(source).items()}
                table.add(
                    run.case,
                    source.source,
                    str(run.level),
                    number(run.data.get("unknowns"), "{:d}"),
                    number(run.timings.get("total")) if not run.failure else f"failed ({run.failure})",
                    *(percent(errors.get(name, float("nan"))) for name in HEAD),
                    number(run.check_maximum, "{:.0e}"),
                )
    return table


def cavity_table(runs: Iterable[Measurement]) -> TextTable:
    """Return the values of the cavity's floor: this program by level, then every published mesh."""
    table = TextTable(("source", "u_y(4, -1) in m", "F_y in N/m"))
    for run in runs:
        if run.case == CAVITY and not run.failure:
            size = f"this program, level {run.level}, {run.data.get('unknowns')} unknowns"
            table.add(size, *_cavity_cells(run.quantities))
    for source in sorted(reference_sets(CAVITY), key=lambda item: item.source, reverse=True):
        table.add(source.source, *_cavity_cells(source.values))
    return table


def _cavity_cells(values: Mapping[str, float]) -> tuple[str, str]:
    return number(values.get("tip_uy"), "{:.5f}"), number(values.get("lift"), "{:.4f}")


def to_frame(runs: Iterable[Measurement]) -> pd.DataFrame:
    """Return one row per run: sizes, seconds, Newton, and each quantity with its references and relative errors."""
    frame = pd.DataFrame([_row(run) for run in runs])
    parts = ("", "_reference", "_error", "_second_reference", "_second_error")
    values = [name + part for name in COLUMNS for part in parts]
    order = [name for name in frame if name not in values] + [name for name in values if name in frame]
    return frame[order].astype(dict.fromkeys(("unknowns", "triangles", "iterations", "factorizations"), "Int64"))


def _row(run: Measurement) -> dict[str, Any]:
    newton = run.data.get("newton") or {}
    sources = [source for source in reference_sets(run.case) if source.compared]
    row: dict[str, Any] = {
        "case": run.case,
        "level": run.level,
        "status": run.data.get("status"),
        "unknowns": run.data.get("unknowns"),
        "triangles": run.data.get("triangles"),
        "seconds": run.timings.get("total"),
        "script_seconds": run.timings.get("script"),
        "iterations": newton.get("iterations"),
        "factorizations": newton.get("factorizations"),
        "check_maximum": run.check_maximum,
        **{name: source.source for name, source in zip(("source", "second_source"), sources, strict=False)},
    }
    for prefix, source in zip(("", "second_"), sources, strict=False):
        for name, error in run.errors(source).items():
            row[name] = run.quantities[name]
            row[f"{name}_{prefix}reference"] = source.values[name]
            row[f"{name}_{prefix}error"] = error
    return row


def replace_block(text: str, name: str, content: str) -> str:
    """Replace what stands between `<!-- NAME:begin -->` and `<!-- NAME:end -->`.

    Raises:
        InputError: the two markers are not there exactly once and in this order.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise InputError(f"the text needs one line {begin} and after it one line {end}")
    head, _, rest = text.partition(begin)
    tail = rest.partition(end)[2]
    return f"{head}{begin}\n{content.strip()}\n{end}{tail}"


def prepare(out: Path | None, readme: Path | None, block: str) -> None:
    """Refuse unusable outputs before anything is computed, and make the folder `out`.

    Raises:
        InputError: `out` is a file, or `readme` is not there or lacks the markers of `block`.
    """
    if readme is not None:
        _replaced(readme, block, "")
    if out is not None:
        if out.exists() and not out.is_dir():
            raise InputError(f"{out} is a file; --out takes a folder")
        out.mkdir(parents=True, exist_ok=True)


def update_readme(readme: Path, block: str, content: str) -> None:
    """Write `content` between the markers of `block`.

    Raises:
        InputError: as `prepare`.
    """
    folder.write_text(readme, _replaced(readme, block, content))


def _replaced(readme: Path, block: str, content: str) -> str:
    if not readme.is_file():
        raise InputError(f"--readme: there is no file {readme}")
    try:
        return replace_block(readme.read_text(encoding="utf-8"), block, content)
    except InputError as error:
        raise InputError(f"{readme}: {error}") from error


def origin(command: str, runs: Iterable[Measurement]) -> str:
    """Return one sentence about who wrote a table, with which FreeFEM and on which machine."""
    used: Mapping[str, Any] = next((run.data["freefem"] for run in runs if run.data.get("freefem")), {})
    solver = f"FreeFEM {used.get('version', '?')} with {used.get('solver', '?')}, one thread"
    return f"Written by `{command}` ({solver}; {processor()})."


def processor() -> str:
    """Return the name of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def link(target: Path, readme: Path) -> str:
    """Return the path of `target` as seen from the folder of `readme`."""
    return Path(os.path.relpath(target, readme.parent)).as_posix()


def command_line(name: str, levels: Sequence[int] | None) -> str:
    """Return the command that wrote a table; `levels` only if they were chosen."""
    return f"ffsi {name}" + (f" --levels {','.join(map(str, levels))}" if levels else "")


def short(runs: Sequence[Measurement]) -> list[Measurement]:
    """Return what the README shows: every level of the cases in `FINEST`, level 2 (or the finest run) of the others."""
    chosen = []
    for case in dict.fromkeys(run.case for run in runs):
        own = [run for run in runs if run.case == case]
        near = [run for run in own if run.level == SHORT_LEVEL] or [max(own, key=lambda run: run.level)]
        chosen += own if case in FINEST else near
    return chosen


def main(levels: Sequence[int] | None = None, out: Path | None = None, readme: Path | None = None) -> list[str]:
    """Run every steady case that has published values, print the errors, and write them down.

    Args:
        levels: mesh levels; None: 0 to 4 for FSI1 and 0 to 3 for the others.
        out: folder for `verification.csv` and `verification.md`.
        readme: file whose block `verification` is replaced, unless a run failed.

    Returns:
        The failures of all runs, as `Result.failure`; empty strings where all is well.

    Raises:
        InputError: `out` or `readme` cannot be used; nothing was computed.
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    prepare(out, readme, "verification")
    runs = [
        measure(case, level)
        for case in CASES
        if reference_sets(case)
        for level in levels or range(FINEST.get(case, 3) + 1)
    ]
    error_table(runs).print()
    written = origin(command_line("verify", levels), runs)
    if out is not None:
        frame = to_frame(runs)
        folder.write_text(out / CSV, frame.to_csv(index=False, float_format="%.8g"))
        folder.write_text(out / MARKDOWN, document(runs, written))
        show.note(f"wrote {out / CSV} and {out / MARKDOWN}")
    failures = [run.failure for run in runs]
    if readme is not None and any(failures):
        show.error(f"{readme} stays as it is, because a run failed")
    elif readme is not None:
        update_readme(readme, "verification", summary(runs, written, link(out / MARKDOWN, readme) if out else ""))
        show.note(f"wrote the block verification of {readme}")
    return failures


EXPLANATION = (
    "Errors are (value - reference) / |reference|. Seconds: all that `ffsi run` does, with check and pictures. "
    "Largest check: the largest relative residual or difference that the independent checker finds."
)


def document(runs: Sequence[Measurement], written: str) -> str:
    """Return `verification.md`: all levels, and the cavity's values beside all published ones."""
    parts = ["# Verification", written, EXPLANATION, error_table(runs).markdown()]
    return "\n\n".join([*parts, "## Cavity with a flexible floor", cavity_table(runs).markdown()]) + "\n"


def summary(runs: Sequence[Measurement], written: str, full: str) -> str:
    """Return the README's block: the short table, and the cavity's values."""
    where = f" All levels: [{MARKDOWN}]({full})." if full else ""
    finest = sorted((run for run in runs if run.case == CAVITY), key=lambda run: run.level)[-2:]
    return "\n\n".join(
        [
            error_table(short(runs)).markdown(),
            f"{written} {EXPLANATION}{where}",
            "Channel over a cavity with a flexible floor, beside every published value:",
            cavity_table(finest).markdown(),
        ]
    )
