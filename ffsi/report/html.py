"""One self-contained HTML file about runs and sweeps."""

from __future__ import annotations

import base64
import datetime
import math
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from matplotlib.figure import Figure

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.reading import read_frame, read_text
from ffsi.hemodynamics.result import Result, load_results
from ffsi.report import blood, curves, formulas
from ffsi.report import history as histories
from ffsi.report.tables import Rows, cell, with_unit
from ffsi.result import pictures
from ffsi.result.evaluation import Notes, attempt, words
from ffsi.result.in_time import last_period, with_coefficients
from ffsi.result.published import references_for
from ffsi.result.quantities import flatten, in_table, published_value, unit
from ffsi.result.table import TABLE, problems, row
from ffsi.result.words import OUTCOMES, tally, time_line
from ffsi.script.render import package_version
from ffsi.text import printable

CAPTIONS = {
    "velocity": "Velocity magnitude and direction on the deformed mesh; grey: solid. "
    "The arrows' length grows like the root of the speed.",
    "pressure": "Pressure contours on the deformed mesh. "
    "The few extreme values at sharp corners lie outside of the colour bar's range.",
    "displacement": "Displacement magnitude of the solid and the deformed mesh; dashed: before the deformation.",
}
CHECK_TEXT = (
    "Recomputed from the raw unknowns by a second implementation that shares no code with the FreeFEM script: "
    "relative residuals of every equation, and relative differences of the forces."
)


@dataclass
class Section:
    """What the template shows about one folder."""

    title: str
    description: str
    status: str
    good: bool
    size: str = ""
    reason: str = ""
    warnings: list[str] = field(default_factory=list)
    quantities_title: str = "Quantities"
    quantities: Rows | None = None
    domain: Rows | None = None
    parameters: Rows | None = None
    check: Rows | None = None
    check_text: str = CHECK_TEXT
    timings: Rows | None = None
    points: Rows | None = None
    pictures: list[dict[str, str]] = field(default_factory=list)
    walls: list[dict[str, str]] = field(default_factory=list)
    wall_tables: list[tuple[str, Rows]] = field(default_factory=list)
    curves: list[dict[str, str]] = field(default_factory=list)
    newton: list[dict[str, str]] = field(default_factory=list)
    remarks: list[formulas.Remark] = field(default_factory=list)
    solid_remark: str = ""


def write_report(directories: Iterable[str | Path], output: str | Path, title: str | None = None) -> None:
    """Write a report about run folders and sweeps into one HTML file without any external part.

    Args:
        directories: run folders, chains or sweeps, in the order of the report's sections.
        output: the HTML file.
        title: heading; by default the names of the cases.

    Raises:
        InputError: no folder, or one of them holds no result.
    """
    paths = [Path(item) for item in directories]
    if not paths:
        raise InputError("a report needs at least one run folder or sweep")
    sections: list[Section] = []
    for path in paths:
        sections += [_sweep(path)] if folder.is_sweep_folder(path) else map(_run, load_results(path))
    text = _template().render(
        title=title or "Report: " + ", ".join(dict.fromkeys(section.title for section in sections)),
        version=package_version(),
        date=datetime.date.today().isoformat(),
        sections=sections,
    )
    folder.write_text(Path(output), text)


def _template() -> jinja2.Template:
    source = files("ffsi.report").joinpath("template.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, finalize=_clean
    )
    return environment.from_string(source)


def _clean(value: Any) -> Any:
    """Return a text without control characters; it may be a name from a file."""
    return printable(value) if type(value) is str else value


def _run(result: Result) -> Section:
    data = result.data
    section = Section(
        title=result.title,
        description=result.scene.description,
        status=_status(result),
        good=result.converged and result.checked and not result.not_evaluated,
        size=_size(data),
        reason=result.reason,
        quantities=_quantities(result),
        domain=_domain(data),
        parameters=_pairs(("key", "value"), _parameters(result)),
        check=_pairs(
            ("relative", "value"), {key: _sign(value) for key, value in data["check"].items() if value is not None}
        ),
        timings=_timings(data),
        remarks=_formulas(result),
        solid_remark=formulas.solid_remark(result),
    )
    notes = result.not_evaluated
    if result.state_file is not None:
        section.pictures = attempt(notes, "pictures", lambda: _pictures(result, notes)) or []
        for what, make in blood.PICTURES.items():
            section.walls += attempt(notes, what, lambda make=make: [_image(*each) for each in make(result)]) or []  # type: ignore[misc]
        section.wall_tables = _wall_tables(result)
    if result.scene.time is not None:
        section.curves = attempt(notes, "curves over time", lambda: _in_time(result)) or []
        section.quantities_title = f"Quantities {result.shown_quantities[0]}"
    elif (result.directory / folder.HISTORY).is_file():
        section.newton = attempt(notes, "Newton's history", lambda: _newton(result)) or []
    section.warnings = _warnings(data, notes)
    return section


def _warnings(data: Mapping[str, Any], notes: Notes) -> list[str]:
    """Return what the program warned of, and what could not be evaluated, now or after the run."""
    missing = [f"not evaluated: {words(note)}" for note in notes]
    return [*map(str, data.get("warnings") or []), *missing]


def _pictures(result: Result, notes: Notes) -> list[dict[str, str]]:
    def image(name: str) -> dict[str, str]:
        return _image(result.picture(name), CAPTIONS[name])

    names = pictures.available(result.fields)
    found = [attempt(notes, f"picture of the {name}", lambda name=name: image(name)) for name in names]  # type: ignore[misc]
    return [each for each in found if each is not None]


def _newton(result: Result) -> list[dict[str, str]]:
    figure = histories.newton_history(result.history)
    return [] if figure is None else [_image(figure, _newton_text(result.data))]


def _wall_tables(result: Result) -> list[tuple[str, Rows]]:
    found = [blood.part_table(result)]
    if (cycles := blood.cycle_table(result)) is not None:
        found.append(("Cycles", cycles))
    if (flow := blood.flow_table(result)) is not None:
        found.append((f"Flow at t = {result.data['time']['reached']:g} s", flow))
    return [table for table in found if table is not None]


def _in_time(result: Result) -> list[dict[str, str]]:
    try:
        history = with_coefficients(result.scene, result.history)
    except InputError:
        return []
    period = last_period(history)
    figure = histories.time_history(history, (period.start, period.end) if period else None)
    if figure is None:
        return []
    words = f"; on the right the last {histories.ZOOMED} periods, grey: the last one" if period else ""
    return [_image(figure, f"Over time: {time_line(result.data)}{words}.")]


def _sweep(directory: Path) -> Section:
    if (directory / TABLE).is_file() and (wrong := problems(directory)):
        raise InputError("; ".join(wrong))
    results = load_results(directory)
    keys = list((results[-1].data.get("varied") or {}).keys())
    table = _table(directory, results, keys)
    shown = [result for result in results if result.converged] or [result for result in results if result.solved]
    last = max(shown or results, key=lambda result: tuple(result.data["varied"].values()))
    section = _run(last)
    section.title = f"{last.scene.name}, sweep over {', '.join(keys)}"
    section.status, section.good = tally(table, _planned(directory))
    section.good &= not any(result.not_evaluated for result in results)
    section.reason = "; ".join(dict.fromkeys(str(text) for text in table["reason"].dropna() if text))
    of_points = [text for result in results for text in _warnings(result.data, result.not_evaluated)]
    section.warnings = [f"{text} ({count} of {len(results)} points)" for text, count in Counter(of_points).items()] + [
        text for text in section.warnings if text not in of_points
    ]
    section.points = _points(table, keys)
    section.quantities_title += " of the point in the pictures: " + ", ".join(
        f"{key} = {value:g}" for key, value in last.data["varied"].items()
    )
    figure = curves.sweep_curves(table, keys)
    if figure is not None:
        section.curves = [_image(figure, "Over the sweep; every marker is one computed point."), *section.curves]
    return section


def _planned(directory: Path) -> int:
    """Return the number of points that a sweep was to have."""
    try:
        vary = tomllib.loads(read_text(directory / folder.SWEEP)).get("vary", {})
    except ValueError as error:
        raise InputError(f"{directory / folder.SWEEP} is damaged: {error}") from error
    return math.prod(len(values) for values in vary.values())


def _table(directory: Path, results: Sequence[Result], keys: Sequence[str]) -> pd.DataFrame:
    path = directory / TABLE
    if path.is_file():
        return read_frame(path)
    return pd.DataFrame(
        [row(result, {key: result.data["varied"][key] for key in keys}, directory) for result in results]
    )


def _points(table: pd.DataFrame, keys: Sequence[str]) -> Rows:
    wanted = [*keys, "status", "checked", *in_table("points")]
    jacobians = [str(name) for name in table if str(name).startswith("min_jacobian")]
    wanted += [*(name for name in jacobians if not name.endswith(("_x", "_y"))), "check_maximum", "seconds"]
    wanted += [*(str(name) for name in table if str(name).startswith("reached_")), "warnings", "not_evaluated"]
    columns = [name for name in dict.fromkeys(wanted) if name in table and table[name].notna().any()]
    forms = {"check_maximum": ".1e", "seconds": ".1f"}
    body = [[cell(line[name], forms.get(name, ".6g")) for name in columns] for _, line in table.iterrows()]
    words = ("status", "checked", "warnings", "not_evaluated")
    return Rows([_head(name) for name in columns], body, [name not in words for name in columns])


def _quantities(result: Result) -> Rows | None:
    when, values = result.shown_quantities
    values = {name: value for name, value in values.items() if not blood.of_a_part(name)}
    if not values:
        return None
    published = {} if when.startswith("at") else references_for(result.scene)
    head, numeric = ["quantity", "value", "unit"], [False, True, False]
    if published:
        head, numeric = [*head, "published", "error", "source"], [*numeric, True, True, False]
    body = []
    for name, value in values.items():
        cells = [name, f"{value:.8g}", unit(name)]
        if published:
            found = published_value(name, published)
            cells += ["", "", ""] if found is None else [
                f"{found[0]:.8g}", f"{100 * (value - found[0]) / abs(found[0]):+.3f} %", found[1].source,
            ]  # fmt: skip
        body.append(cells)
    return Rows(head, body, numeric)


def _domain(data: Mapping[str, Any]) -> Rows | None:
    regions, sides = data.get("regions") or {}, data.get("boundaries") or {}
    body = [[name, "region", f"{area:.6g}", "m²"] for name, area in regions.items()]
    body += [[name, side["role"], f"{side['length']:.6g}", "m"] for name, side in sides.items()]
    return Rows(["name", "role", "area or length", "unit"], body, [False, False, True, False]) if body else None


def _parameters(result: Result) -> dict[str, Any]:
    """Return every word and number that defines the run, in the order of the scene's tables."""
    found = {**result.scene.words(), **result.parameters}
    tables = [*type(result.scene).model_fields, *(key.partition(".")[0] for key in found)]
    groups = list(dict.fromkeys(key.rpartition(".")[0] for key in found))
    place = {key: (tables.index(key.partition(".")[0]), groups.index(key.rpartition(".")[0])) for key in found}
    return {key: found[key] for key in sorted(found, key=lambda key: place[key])}


def _timings(data: Mapping[str, Any]) -> Rows | None:
    names = {"script": "FreeFEM since its start"}
    found = {
        names.get(key, key.replace("_", " ")): value for key, value in data["timings"].items() if value is not None
    }
    return (
        Rows(["phase", "seconds"], [[key, f"{value:.3f}"] for key, value in found.items()], [False, True])
        if found
        else None
    )


def _pairs(head: tuple[str, str], values: Mapping[str, Any]) -> Rows | None:
    return (
        Rows(
            head,
            [
                [key.replace("_", " ") if head[0] == "relative" else key, cell(value, ".10g")]
                for key, value in values.items()
            ],
            [False, True],
        )
        if values
        else None
    )


def _formulas(result: Result) -> list[formulas.Remark]:
    """Return where the paper's formulas differ, for flap cases only."""
    found = formulas.remarks(result.scene)
    difference = formulas.force_difference(flatten(result.quantities))
    if found and difference:
        found[0] = replace(found[0], here=f"{found[0].here} {difference}")
    return found


def _status(result: Result) -> str:
    if result.converged:
        return "solved and checked" if result.checked else "solved, not checked"
    return OUTCOMES.get(result.failure, "not converged")


def _size(data: Mapping[str, Any]) -> str:
    if not data.get("unknowns"):
        return ""
    program = data.get("freefem") or {}
    solver = f"FreeFEM {program.get('version', '')} with {program.get('solver', '')}"
    return f"{data['triangles']} triangles, {data['unknowns']} unknowns; {solver}"


def _newton_text(data: Mapping[str, Any]) -> str:
    newton = data.get("newton") or {}
    return (
        f"{newton.get('iterations', '?')} iterations and {newton.get('factorizations', '?')} factorisations "
        "on the final mesh. Dotted: a finer mesh or another load step begins."
    )


def _image(figure: Figure, caption: str) -> dict[str, str]:
    data = base64.b64encode(pictures.to_png(figure, dpi=140)).decode("ascii")
    return {"data": data, "caption": caption, "alt": caption.partition(".")[0].partition(";")[0]}


def _head(name: str) -> str:
    return with_unit(name.replace("_", " "), name)


def _sign(value: float) -> str:
    return f"{value:.1e}"
