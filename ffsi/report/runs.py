"""What a report shows of one run, finished or not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.files.reading import read_text
from ffsi.hemodynamics.result import Result, load_results
from ffsi.report import animation, blood, formulas, history, scene, viewer
from ffsi.report.blocks import Block, Picture, Pictures, Section, Text, Viewer, marked
from ffsi.report.curves import sensitivity_bars
from ffsi.report.refinement import adapted
from ffsi.report.tables import Rows, about_key, cell
from ffsi.result import in_time, pictures, views
from ffsi.result.evaluation import Notes, attempt
from ffsi.result.evaluation import words as note_words
from ffsi.result.published import references_for
from ffsi.result.quantities import CHECKED, WORDS, error_bar, flatten, in_table, published_value, unit
from ffsi.result.sketch import sketch
from ffsi.result.words import OUTCOMES, time_line
from ffsi.scene import load_scene

CAPTIONS = {
    "domain": "The reference domain and its boundaries with their roles.",
    "velocity": "Velocity magnitude and direction on the deformed mesh; grey: solid. "
    "The arrows' length grows like the root of the speed.",
    "pressure": "Pressure contours on the deformed mesh. "
    "The few extreme values at sharp corners lie outside of the colour bar's range.",
    "displacement": "Displacement magnitude of the solid and the deformed mesh; dashed: before the deformation.",
    "vorticity": "Vorticity ∂v_y/∂x − ∂v_x/∂y on the deformed mesh; the few extreme values at corners are cut off.",
    "effective stress": "Effective stress (von Mises) of the Cauchy stress in the solid, in plane strain; at corners, "
    "where it is singular, it is cut off.",
}
CHECK_TEXT = (
    "A second implementation, which shares no code with the FreeFEM script, reads the raw unknowns and computes from "
    "them the residual of every equation, relative to its largest term, and every quantity once more."
)
FRAMES, FRAME_DPI = 24, 64
_BARS = 400_000  # bytes of their picture, at most
_OF_HISTORY = {
    "time": "s",
    "step": "s",
    "seconds": "s",
    **dict.fromkeys(("kinetic", "elastic", "dissipated", "work"), "J/m"),
}
UNFINISHED = "it has not ended, or was ended from outside: there is no result.json. What follows is not checked"


def open_run(directory: Path) -> list[Result]:
    """Return the results of a run folder or chain; of a run that left none, what its history and states tell.

    Raises:
        InputError: the folder is none of a run, is damaged, or holds nothing to show.
    """
    try:
        return load_results(directory)
    except InputError:
        done = (directory / folder.RESULT).exists() or any(directory.glob("result-*.json"))
        if done or not folder.is_run_folder(directory):
            raise
    run = load_scene(str(directory / folder.SCENE), [])
    data: dict[str, Any] = {
        "case": run.name, "status": "failed", "failure": in_time.STOPPED, "reason": UNFINISHED, "quantities": {},
        "check": {}, "timings": {}, "parameters": run.parameters(), "level": run.mesh.level,
    }  # fmt: skip
    result = Result(run, directory, data)
    if run.time is not None and (directory / folder.TIME_HISTORY).is_file():
        in_time.complete(data, run, directory)
        steps = in_time.with_coefficients(run, result.history)
        data["time"]["last"] = {name: float(steps[name].iloc[-1]) for name in steps if name in WORDS and len(steps)}
        if result.saved_steps:
            data["state"] = result.saved_steps[-1].new
    if (directory / folder.MESH).is_file():
        data |= {"triangles": len(result.raw_mesh.triangles), **result.domain}
    return [result]


def run_section(result: Result, maximum: int, *, more: Sequence[Block] = ()) -> Section:
    """Return what the report shows about one point.

    Args:
        result: the point.
        maximum: bytes of one picture, at most.
        more: blocks that come first, of the sweep that the point belongs to.
    """
    notes = result.not_evaluated
    section = Section(result.title, result.scene.description, status(result), whole(result))
    section.blocks = [*more, *_scene(result, notes, maximum), *_results(result), *_check(result)]
    if result.scene.time is not None:
        section.blocks += attempt(notes, "curves over time", lambda: _in_time(result, maximum)) or []
        section.blocks += attempt(notes, "animation", lambda: _animation(result)) or []
    if result.state_file is not None:
        section.blocks += attempt(notes, "pictures", lambda: _state(result, notes, maximum)) or []
        section.blocks += _wall_tables(result)
    section.blocks += _numerics(result, notes, maximum) + _background(result)
    section.notes = warnings(result, notes)
    if program := result.data.get("freefem"):
        section.programs = [f"FreeFEM {program['version']} with {program['solver']}"]
    return section


def whole(result: Result) -> bool:
    """Return whether a point is solved, checked, and evaluated as a whole."""
    return result.converged and result.checked and not result.not_evaluated


def status(result: Result) -> str:
    """Return what became of a point, in words."""
    if result.converged:
        return "solved and checked" if result.checked else "solved, not checked"
    return OUTCOMES.get(result.failure, "not converged")


def warnings(result: Result, notes: Notes) -> list[str]:
    """Return why a point failed, what the program warned of, and what could not be evaluated, now or after the run."""
    missing = [f"not evaluated: {note_words(note)}" for note in notes]
    return [text for text in (result.reason, *result.warnings, *missing) if text]


def _scene(result: Result, notes: Notes, maximum: int) -> list[Block]:
    found: list[Block] = []
    if (result.directory / folder.MESH).is_file():
        found += _drawn("Domain", {"domain": lambda: sketch(result.scene, result.raw_mesh, " ")}, notes, maximum)
    regions, sides = result.data.get("regions") or {}, result.data.get("boundaries") or {}
    body = [[name, "region", f"{area:.6g}", "m²"] for name, area in regions.items()]
    body += [[name, side["role"], f"{side['length']:.6g}", "m"] for name, side in sides.items()]
    if body:
        head = ["name", "role", "area or length", "unit"]
        found.append(Rows(head, body, [False, False, True, False], "Regions and boundaries"))
    return [*found, *scene.in_words(result.scene)]


def _results(result: Result) -> list[Block]:
    when, values = result.shown_quantities
    values = {name: value for name, value in values.items() if not blood.of_a_part(name)}
    if not values:
        return []
    published = {} if when.startswith("at") else references_for(result.scene)
    head, numeric = ["quantity", "value", "unit"], [False, True, False]
    if published:
        head, numeric = [*head, "published", "error", "source"], [*numeric, True, True, False]
    body = []
    for name, value in values.items():
        bar = error_bar(name, result.data)
        cells = [name, f"{value:.8g}" + (f" ± {bar:.2g}" if bar else ""), unit(name)]
        if published:
            found = published_value(name, published)
            cells += ["", "", ""] if found is None else [
                f"{found[0]:.8g}", f"{100 * (value - found[0]) / abs(found[0]):+.3f} %", found[1].source,
            ]  # fmt: skip
        body.append(cells)
    return [Rows(head, body, numeric, f"Quantities {when}".strip()), *_meshes(result), *_sensitivities(result)]


def _meshes(result: Result) -> list[Block]:
    if "adaptation" not in result.data:
        return []
    rows, figure = adapted(result.data["adaptation"])
    caption = "Sizes of the estimated errors, relative to the values, by the unknowns of the meshes; line: tolerance."
    return [rows, *([Pictures("", [Picture.of(figure, caption, _BARS)])] if figure else [])]


def _sensitivities(result: Result) -> list[Block]:
    """Return the logarithmic derivatives of the quantities that tables show, as numbers and bars."""
    known = result.data.get("sensitivities") or {}
    names = [name for name in in_table("points") if name in known]
    keys = list(known[names[0]]) if names else []
    logs = {name: {key: known[name][key]["logarithmic"] for key in keys} for name in names}
    keys = [key for key in keys if any(abs(logs[name][key] or 0.0) > 1e-6 for name in names)]
    if not keys:
        return []
    body = [[key, *(cell(logs[name][key], "+.5f") for name in names)] for key in keys]
    title = "Sensitivities: relative change of a quantity over that of a number, p/J dJ/dp"
    rows = Rows(["number", *names], body, [False, *(True for _ in names)], title)
    figure = sensitivity_bars({name: {key: logs[name][key] or 0.0 for key in keys} for name in names})
    return [rows, Pictures("", [Picture.of(figure, title, _BARS)])]


def _check(result: Result) -> list[Block]:
    numbers = {name: value for name, value in (result.data.get("check") or {}).items() if value is not None}
    if result.check_failures:
        verdict = f"It did not pass: {'; '.join(result.check_failures)}."
    elif not result.checked or not numbers:
        verdict = "It has not passed this point: what stands here was computed once."
    else:
        worst = max((name for name in CHECKED if name in numbers), key=lambda name: float(numbers[name]))
        words = worst.replace("_", " ")
        verdict = f"It passed. The largest of its {len(numbers)} numbers is {words}, {numbers[worst]:.1e}."
    text = Text("Independent check", [f"{CHECK_TEXT} {verdict}"])
    body = [[name.replace("_", " "), f"{value:.1e}"] for name, value in numbers.items()]
    table = Rows(["relative", "value"], body, [False, True], "Numbers of the check", folded=True)
    return [text, table] if body else [text]


def _in_time(result: Result, maximum: int) -> list[Block]:
    try:
        table = in_time.with_coefficients(result.scene, result.history)
    except InputError:
        return []
    last = in_time.last_period(table)
    period = (last.start, last.end) if last else None
    grey = f"; on the right the last {history.ZOOMED} periods, grey: the last one" if period else ""
    figures = [
        (history.time_history(table, period), f"Over time: {time_line(result.data)}{grey}."),
        (history.motion(table, period), history.MOTION_TEXT),
        (history.energy(table), history.ENERGY_TEXT),
    ]
    shown = [Pictures("", [Picture.of(figure, text, maximum)]) for figure, text in figures if figure is not None]
    csv = read_text(result.directory / folder.TIME_HISTORY)
    body = [[name, _OF_HISTORY.get(name) or unit(name)] for name in map(str, table)]
    note = f"{len(table)} steps; the file holds a row for each of them."
    files = (folder.TIME_HISTORY, csv if len(csv) < 10 * maximum else "")
    columns = Rows(["column", "unit"], body, [False, False], "Columns of the history", note, files, folded=True)
    return [*shown, columns]


def _animation(result: Result) -> list[Block]:
    if len(result.saved_steps) < 2:
        return []
    name = "velocity" if result.scene.fluid is not None else "displacement"
    data, count = animation.moving(result, name, FRAMES, FRAME_DPI)
    first, last = result.saved_steps[0].time, result.saved_steps[-1].time
    text = f"The {name} in {count} of the {len(result.saved_steps)} saved steps, t = {first:g} to {last:g} s."
    return [Pictures("Animation", [Picture(data, text, "gif")])]


def _state(result: Result, notes: Notes, maximum: int) -> list[Block]:
    state, fields = str(result.state_file), result.fields
    drawings: dict[str, Callable[[], Figure]] = {
        name: partial(result.picture, name) for name in views.available(fields)
    }
    if fields.has_fluid:
        drawings["vorticity"] = partial(pictures.vorticity, fields, result.title)
    if fields.has_solid and not blood.has_stress(result):

        def stress() -> Figure:
            values = viewer.stress_in_solids(result, state, fields)
            return pictures.nodal(fields, values, "effective stress (Pa)", result.title)

        drawings["effective stress"] = stress
    found = _drawn("Fields", drawings, notes, maximum)
    walls = [
        Picture.of(*each, maximum)
        for what, make in blood.PICTURES.items()
        for each in attempt(notes, what, partial(make, result)) or []
    ]
    found += [Pictures("Walls", walls)] if walls else []
    data = attempt(notes, "fields to look into", lambda: viewer.encode(fields, viewer.scalars(result, state)))
    return [*found, *([Viewer(f"Look into the fields of {result.title}", data)] if data else [])]


def _drawn(title: str, drawings: Mapping[str, Callable[[], Figure]], notes: Notes, maximum: int) -> list[Block]:
    """Return the pictures that can be drawn, each with its caption; a failure of one is noted."""
    found = []
    for name, draw in drawings.items():
        if (figure := attempt(notes, f"picture of the {name}", draw)) is not None:
            found.append(Picture.of(figure, CAPTIONS[name], maximum))
    return [Pictures(title, found)] if found else []


def _wall_tables(result: Result) -> list[Block]:
    found = [blood.part_table(result), blood.cycle_table(result), blood.flow_table(result)]
    return [table for table in found if table is not None]


def _numerics(result: Result, notes: Notes, maximum: int) -> list[Block]:
    data, found = result.data, list[Block]()
    if data.get("triangles"):
        program = data.get("freefem") or {}
        solver = f", solved by FreeFEM {program['version']} with {program['solver']}" if program else ""
        unknowns = f", {data['unknowns']} unknowns" if data.get("unknowns") else ""
        found.append(Text("Mesh and solver", [f"{data['triangles']} triangles{unknowns}{solver}."]))
    if result.scene.time is None and (result.directory / folder.HISTORY).is_file():
        figure = attempt(notes, "Newton's history", lambda: history.newton_history(result.history))
        newton = data.get("newton") or {}
        text = (
            f"{newton.get('iterations', '?')} iterations and {newton.get('factorizations', '?')} factorisations "
            "on the final mesh. Dotted: a finer mesh or another load step begins."
        )
        found += [Pictures("", [Picture.of(figure, text, maximum)])] if figure is not None else []
    names = {"script": "FreeFEM since its start"}
    timings = {key: value for key, value in (data.get("timings") or {}).items() if value is not None}
    body = [[names.get(key, key.replace("_", " ")), f"{value:.3f}"] for key, value in timings.items()]
    return [*found, *([Rows(["phase", "seconds"], body, [False, True], "Time", folded=True)] if body else [])]


def _background(result: Result) -> list[Block]:
    found: list[Block] = []
    if remarks := formulas.remarks(result.scene):
        if difference := formulas.force_difference(flatten(result.quantities)):
            remarks[0] = replace(remarks[0], here=f"{remarks[0].here} {difference}")
        lines = [f"<b>{item.topic}.</b> Paper: {item.paper} Here: {item.here}" for item in remarks]
        lines += [text for text in [formulas.solid_remark(result)] if text]
        found.append(Text("Formulas: the paper and the standard form", [marked(line) for line in lines]))
    body = [[key, cell(value, ".10g"), *about_key(key)] for key, value in _parameters(result).items()]
    if body:
        head = ["key", "value", "unit", "meaning"]
        found.append(Rows(head, body, [False, True, False, False], f"Parameters ({len(body)})", folded=True))
    return [*found, Text("The scene as a file, scene.toml", [], result.scene.to_toml(), folded=True)]


def _parameters(result: Result) -> dict[str, Any]:
    """Return every word and number that defines the run, in the order of the scene's tables."""
    found = {**result.scene.words(), **result.parameters}
    tables = [*type(result.scene).model_fields, *(key.partition(".")[0] for key in found)]
    groups = list(dict.fromkeys(key.rpartition(".")[0] for key in found))
    place = {key: (tables.index(key.partition(".")[0]), groups.index(key.rpartition(".")[0])) for key in found}
    return {key: found[key] for key in sorted(found, key=lambda key: place[key])}
