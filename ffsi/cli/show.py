"""What the command line prints: tables on stdout, notes and errors on stderr."""

from __future__ import annotations

import logging
import math
import os
import shlex
import sys
import tempfile
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ffsi.cli.plain import Table, Words, new_rich_table, stdout
from ffsi.text import cut, printable

if TYPE_CHECKING:  # what reads results takes half a second to load
    import pandas as pd

    from ffsi.cli.progress import ProgressDisplay
    from ffsi.hemodynamics.result import Result
    from ffsi.reference import CheckReport
    from ffsi.result.published import Reference
    from ffsi.scene import Scene
    from ffsi.scene.materials import Elastic

# Quantities that only help to diagnose; they are in result.json.
MINOR = ("_surface", "_x", "_y", "drag_cylinder", "lift_cylinder", "drag_beam", "lift_beam")


def text(value: object, style: str = "") -> Words:
    """Return what a file or a person has named, fit for a table: no markup, no control characters."""
    return Words(cut(value), style)


def _lines(message: str) -> str:
    return "\n".join(printable(line) for line in message.split("\n"))


def error(message: str) -> None:
    """Print an error on stderr, as it is."""
    mark = "\x1b[1;31merror:\x1b[0m" if sys.stderr.isatty() and "NO_COLOR" not in os.environ else "error:"
    sys.stderr.write(f"{mark} {_lines(message)}\n")


def note(message: str) -> None:
    """Print a note on stderr."""
    sys.stderr.write(_lines(message) + "\n")


def usage(error_of_typer: Any) -> int:
    """Print what is wrong with the words of the command line, and where help is; return the exit code."""
    context = getattr(error_of_typer, "ctx", None)
    if type(error_of_typer).__name__ == "NoArgsIsHelpError":
        error_of_typer.show()
    else:
        error(error_of_typer.format_message())
        note(f"{context.command_path if context else 'ffsi'} --help shows what is accepted")
    return int(error_of_typer.exit_code)


def fault(error_of_ours: Exception) -> None:
    """Say that ffsi itself is wrong; the traceback goes into a file for whoever mends it."""
    from ffsi.script.render import package_version

    what = f"{type(error_of_ours).__name__}: {error_of_ours}"
    where = "".join(traceback.format_exception(error_of_ours))
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="ffsi-fault-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(f"ffsi {package_version()}\n{shlex.join(sys.argv)}\n{where}")
        kept = f"the details are in {file.name}"
    except OSError:
        kept = f"the details:\n{where}"
    error(f"a fault of ffsi itself: {cut(what, 500)}; please report it to its authors with the command; {kept}")


class LogHandler(logging.Handler):
    """Prints warnings and remarks on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one."""
        mark = "" if record.levelno < logging.WARNING else f"{record.levelname.lower()}: "
        note(mark + cut(record.getMessage(), 2000))


def progress(case: str = "", points: int | None = None) -> ProgressDisplay:
    """Return the live line on stderr, to be used as a context manager and listener."""
    from ffsi.cli.progress import ProgressDisplay

    return ProgressDisplay(case, points)


def cases(entries: Sequence[Mapping[str, Any]]) -> None:
    """Print the catalogue."""
    table = Table()
    for column in ("case", "physics", "description"):
        table.add_column(column, no_wrap=column != "description")
    for entry in entries:
        table.add_row(*map(Words, (entry["name"], entry["physics"], entry["description"])))
    stdout().print(table)


def domain(scene: Scene) -> None:
    """Print what will be computed on: areas of the regions, roles and lengths of the boundaries."""
    from ffsi.result.domain import intended, words

    for line in words(intended(scene)):
        stdout().print(Words(line), soft_wrap=True)


def result(done: Result) -> None:
    """Print quantities beside published values, Newton, check and where the files are."""
    from ffsi.result.published import references_for

    console = stdout()
    data = done.data
    style = "red" if not done.converged else "green" if done.checked else "yellow"
    size = (
        f"level {data.get('level')}, {data.get('triangles') or '?'} triangles, {data.get('unknowns') or '?'} unknowns"
    )
    console.print(text(data["case"], "bold"), text(done.verdict, style), text(f"({size})"))
    when, values = done.shown_quantities
    if values:
        published = {} if when.startswith("at") else references_for(done.scene)
        console.print(quantities(values, published, f"quantity {when}".strip(), data))
    if "adaptation" in data:
        console.print(adaptation(data["adaptation"]["rounds"]))
    for line in summary(done):
        console.print(Words(printable(line)), soft_wrap=True)


def adaptation(rounds: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of the meshes that were made for quantities: unknowns, values with their bars."""
    table = Table()
    names = list(rounds[0]["quantities"])
    for name in ("unknowns", *names):
        table.add_column(text(name), right=True)
    for step in rounds:
        found = [step["quantities"][name] for name in names]
        cells = [with_bar(each["value"], each["bar"]) if each.get("bar") else f"{each['value']:.7g}" for each in found]
        table.add_row(*map(text, [str(step["unknowns"]), *cells]))
    return table


def quantities(
    values: Mapping[str, float],
    published: Mapping[str, Reference],
    heading: str = "quantity",
    data: Mapping[str, Any] = {},
) -> Table:
    """Return the table of (flattened) quantities, with error bars, published values and differences from them."""
    from ffsi.result.quantities import error_bar, published_value, unit

    table = Table()
    table.add_column(text(heading))
    table.add_column("value", right=True)
    table.add_column("unit")
    if published:
        table.add_column("published", right=True)
        table.add_column("from published", right=True)
    for name, value in values.items():
        if name.endswith(MINOR) and name not in published:
            continue
        bar = error_bar(name, data)
        cells = [name, with_bar(value, bar) if bar else f"{value:.7g}", unit(name)]
        if (found := published_value(name, published)) is not None:
            cells += [f"{found[0]:.7g}", f"{100 * (value - found[0]) / abs(found[0]):+.3f} %"]
        table.add_row(*map(text, cells))
    return table


def with_bar(value: float, bar: float) -> str:
    """Return a value to the second digit of its error bar, "14.2943 +- 0.0031"."""
    digits = min(max(1 - math.floor(math.log10(bar)), 0), 15)
    if max(abs(value), bar) >= 1e-3 or value == 0:
        return f"{value:.{digits}f} +- {bar:.{digits}f}"
    power = math.floor(math.log10(max(abs(value), bar)))
    return f"({value / 10**power:.{max(digits + power, 0)}f} +- {bar / 10**power:.{max(digits + power, 0)}f})e{power}"


def summary(done: Result) -> list[str]:
    """Return the lines about Newton's method, the check, the time and the files, and the warnings."""
    from ffsi.result.words import time_line

    newton, timings, check = done.data["newton"], done.data["timings"], done.data["check"]
    lines = [material_line(name, solid) for name, solid in done.scene.solid.items()]
    if newton:
        lines.append(f"Newton: {newton.get('iterations')} iterations, {newton.get('factorizations')} factorisations")
    if done.data.get("time") is not None:
        lines.append(time_line(done.data))
    lines.append(check_line(check, done.check_failures))
    if (total := timings.get("total")) is not None:
        phases = ("factorize", "solve", "jacobian", "residual", "check", "pictures")
        parts = ", ".join(f"{name} {timings[name]:.2f}" for name in phases if timings.get(name) is not None)
        lines.append(f"time: {total:.2f} s ({parts})" if parts else f"time: {total:.2f} s")
    return [*lines, f"files: {done.directory}", *(f"warning: {warning}" for warning in done.warnings)]


def material_line(name: str, solid: Elastic) -> str:
    """Return the material of a solid with its elastic constants at rest, converted from those that the scene gives.

    Those of an incompressible solid that are infinite are left out.
    """
    symbols = {"young_modulus": "E", "poisson_ratio": "ν", "lame_lambda": "λ", "lame_mu": "μ", "bulk_modulus": "K"}
    constants = ", ".join(
        f"{symbols[key]} {value:.5g}{'' if key == 'poisson_ratio' else ' Pa'}"
        for key, value in solid.elastic_constants.items()
        if math.isfinite(value)
    )
    return f"{name}: {getattr(solid, 'material', 'solid')}, {constants}"


def check_line(check: Mapping[str, Any], failures: Sequence[str]) -> str:
    """Return the check in one line."""
    numbers = {name: value for name, value in check.items() if isinstance(value, (int, float))}
    if not numbers:
        return "check: not done" if not failures else "check: FAILED"
    worst = max(numbers, key=lambda name: math.inf if math.isnan(numbers[name]) else numbers[name])
    return f"check: {'FAILED' if failures else 'passed'}, the largest is {worst} with {numbers[worst]:.1e}"


_ROWS = 60


def sweep(table: pd.DataFrame, keys: Sequence[str], out: Path) -> None:
    """Print the sweep's table."""
    import pandas as pd

    from ffsi.result.quantities import in_table
    from ffsi.result.study_definition import shown as shown_value
    from ffsi.result.table import TABLE
    from ffsi.result.words import tally

    console = stdout()
    endings = ("", "_mean", "_amplitude", "_frequency")
    names = [name + ending for name in in_table("sweep") for ending in endings if name + ending in table]
    shown = Table()
    for name in [*keys, "status", *names, "check_maximum", "seconds"]:
        shown.add_column(text(name), right=name != "status")
    for _, line in table.head(_ROWS).iterrows():
        good = line["status"] == "converged" and line["checked"]
        word = line["status"] if good or line["status"] == "failed" else f"{line['status']}, not checked"
        cells: list[str] = [text("-" if pd.isna(line[key]) else shown_value(line[key])) for key in keys]
        cells.append(text(word, "green" if good else "red"))
        cells += [_cell(line[name], "{:.6g}") for name in names]
        shown.add_row(*cells, _cell(line["check_maximum"], "{:.1e}"), _cell(line["seconds"], "{:.1f}"))
    console.print(shown)
    if len(table) > _ROWS:
        console.print(f"and {len(table) - _ROWS} more in {out / TABLE}")
    console.print(Words(tally(table)[0]), soft_wrap=True)
    console.print(Words(printable(f"files: {out}")), soft_wrap=True)
    for warning, count in table["warnings"].fillna("").value_counts().items():
        if warning:
            console.print(Words(f"warning at {count} of {len(table)} points: {warning}"), soft_wrap=True)


def levels(table: pd.DataFrame, out: Path) -> None:
    """Print the quantities on several meshes, what they tend to, and the error bar of the finest."""
    from ffsi.result.quantities import unit

    shown = Table()
    for name in ("quantity", "unit", *table.columns):
        shown.add_column(text(name), right=name not in ("quantity", "unit"))
    for name, line in table.iterrows():
        if not str(name).endswith(MINOR):
            cells = [_cell(line[each], "{:.2g}" if each in ("order", "error") else "{:.7g}") for each in table.columns]
            shown.add_row(text(str(name)), text(unit(str(name))), *cells)
    console = stdout()
    console.print(shown)
    console.print(Words(printable(f"files: {out}")), soft_wrap=True)


def checks(reports: Sequence[tuple[Result, CheckReport]]) -> None:
    """Print the numbers of the checker, one column per point."""
    rows = check_rows(reports)
    table = Table()
    table.add_column("relative residual or difference")
    for line in rows:
        table.add_column(f"point {line['point']}", right=True)
    for name in list(rows[0])[3:]:
        if any(line[name] is not None for line in rows):
            table.add_row(name.replace("_", " "), *(_cell(line[name], "{:.1e}") for line in rows))
    table.add_row("passed", *("yes" if line["passed"] else "NO" for line in rows))
    stdout().print(table)


def sensitivities(slopes: pd.DataFrame, logarithmic: pd.DataFrame) -> None:
    """Print derivatives: one line per quantity and parameter, the largest logarithmic one first."""
    from ffsi.result.quantities import unit

    table = Table()
    for column in ("quantity", "by", "dJ/dp (SI)", "p/J dJ/dp"):
        table.add_column(column, right="dJ" in column)
    for name in map(str, slopes):
        for key in logarithmic[name].abs().sort_values(ascending=False).index:
            cells = [f"{name} ({unit(name)})", key, f"{slopes[name][key]:.6g}"]
            table.add_row(*map(text, cells), _cell(logarithmic[name][key], "{:+.5f}"))
    stdout().print(table)


def check_rows(reports: Sequence[tuple[Result, CheckReport]]) -> list[dict[str, Any]]:
    """Return what the checker found, one dictionary per point."""
    from ffsi.result.quantities import CHECKED

    return [
        {
            "folder": str(result.directory),
            "point": result.point,
            "passed": report.passed,
            **{name: getattr(report, name) for name in CHECKED},
        }
        for result, report in reports
    ]


def doctor() -> bool:
    """Print the diagnosis; return whether nothing failed."""
    from ffsi.freefem.doctor import diagnose, healthy

    found = diagnose()
    style = {"ok": "green", "warn": "yellow", "fail": "bold red"}
    table = new_rich_table(show_header=False)
    for item in found:
        advice = f"\n{item.advice}" if item.advice and item.status != "ok" else ""
        table.add_row(
            Words(item.status, style=style[item.status]), Words(item.name), Words(item.detail + advice, overflow="fold")
        )
    stdout().print(table)
    return healthy(found)


def _cell(value: Any, form: str) -> str:
    return "-" if value is None or (isinstance(value, float) and math.isnan(value)) else form.format(value)
