"""What a report shows of sweeps, and of several runs beside each other."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ffsi.files.errors import InputError
from ffsi.files.reading import read_frame
from ffsi.hemodynamics.result import Result, load_results
from ffsi.report import blood, curves, refinement, runs, scene
from ffsi.report.blocks import Block, Picture, Pictures, Section
from ffsi.report.tables import Rows, about_key, cell, label, value_text, words
from ffsi.result import pictures, study_definition, views
from ffsi.result.evaluation import attempt
from ffsi.result.quantities import in_table, unit
from ffsi.result.refinement import LEVEL
from ffsi.result.study_definition import points_of
from ffsi.result.table import TABLE, frame, place, problems
from ffsi.result.table import units as units_of
from ffsi.result.words import OUTCOMES, tally
from ffsi.scene import Scene

CHOSEN = 6
"""Points of a sweep in the gallery."""
_FORMS = {"check_maximum": ".1e", "seconds": ".1f"}


def sweep_section(directory: Path, maximum: int) -> tuple[Section, str]:
    """Return what the report shows about a sweep, its points, and one of them as a run; and the command that makes it.

    Raises:
        InputError: the sweep holds no result, or its table is not that of its results.
    """
    if (directory / TABLE).is_file() and (wrong := problems(directory)):
        raise InputError("; ".join(wrong))
    results, definition = load_results(directory), study_definition.read(directory)
    keys, points = list(definition["vary"]), points_of(definition)
    known = {place(result.data["varied"], keys): result for result in results}
    results = [known[at] for each in points if (at := place(each, keys)) in known]
    path = directory / TABLE
    table = read_frame(path) if path.is_file() else frame(directory, keys, points, known)
    units = units_of(table, keys)
    shown = [item for item in results if item.converged] or [item for item in results if item.solved] or results
    last = shown[-1]
    notes = last.not_evaluated
    more: list[Block] = []
    for what, make, text in (
        ("curves of the sweep", curves.sweep_curves, "Over the sweep; every marker is one computed point."),
        ("maps of the sweep", curves.heat_maps, "Over both varied values; a cell is one computed point."),
        ("main effects", _effects, "Over each varied value by itself: all points, and their means in red."),
    ):
        figure = attempt(notes, what, lambda make=make: make(table, keys, units))  # type: ignore[misc]
        more += [Pictures("", [Picture.of(figure, text, maximum)])] if figure is not None else []
    if keys == [LEVEL]:
        more += series_blocks(results, maximum)
    more += [*_points(table, keys, units), *_failed(table, keys)]
    more += attempt(notes, "gallery", lambda: gallery(shown, maximum)) or []
    section = runs.run_section(last, maximum, more=more)
    for block in section.blocks[len(more) :]:
        block.title = f"{block.title} at {_at(last)}" if block.title.startswith("Quantities") else block.title
    section.title = f"{last.scene.name}, sweep over {', '.join(map(words, keys))}"
    section.status, section.good = tally(table, len(points))
    section.good &= not any(result.not_evaluated for result in results)
    told = [result for result in results if result.failure != "not-reached"]
    of_points = [text for result in told for text in runs.warnings(result, result.not_evaluated)]
    section.notes = [f"{text} ({count} of {len(results)} points)" for text, count in Counter(of_points).items()]
    return section, _command(directory, definition, last.data)


def comparison(results: Sequence[Result], maximum: int) -> Section:
    """Return a section about several runs beside each other: quantities, what differs, pictures with one scale."""
    names = [f"{i}: {result.scene.name}" for i, result in enumerate(results, start=1)]
    found = [result.shown_quantities for result in results]
    rows = dict.fromkeys(name for _, values in found for name in values if not blood.of_a_part(name))
    body = [[name, unit(name), *(cell(values.get(name), ".6g") for _, values in found)] for name in rows]
    body.insert(0, ["status", "", *map(runs.status, results)])
    numeric = [False, False, *[True] * len(results)]
    blocks: list[Block] = [Rows(["quantity", "unit", *names], body, numeric, "Quantities side by side")]
    scenes = [{**result.scene.words(), **result.scene.parameters()} for result in results]
    every = dict.fromkeys(key for each in scenes for key in each)
    keys = [key for key in every if len({each.get(key) for each in scenes}) > 1]
    if keys:
        body = [[words(key), about_key(key)[0], *(cell(each.get(key), ".6g") for each in scenes)] for key in keys]
        blocks.append(Rows(["what differs", "unit", *names], body, numeric, "Scenes side by side"))
    if keys == [LEVEL]:
        blocks += series_blocks(results, maximum)
    blocks += gallery(results, maximum, slider=False)
    good = all(map(runs.whole, results))
    return Section("Comparison", "The runs of this report beside each other.", "", good, [], blocks)


def series_blocks(results: Sequence[Result], maximum: int) -> list[Block]:
    """Return table and picture of a series of meshes; nothing with fewer than three of them."""
    if (found := refinement.series(results)) is None:
        return []
    rows, figure = found
    text = "Distance of each quantity from its extrapolated value; a straight line is a convergence of one order."
    return [rows, *([Pictures("", [Picture.of(figure, text, maximum)])] if figure is not None else [])]


def gallery(results: Sequence[Result], maximum: int, *, slider: bool = True) -> list[Block]:
    """Return the first picture of up to `CHOSEN` points with fields; in one geometry all have the same colours."""
    there = [result for result in results if result.state_file is not None]
    chosen = [there[i] for i in np.unique(np.linspace(0, len(there) - 1, CHOSEN).round().astype(int))] if there else []
    kinds = [views.available(result.fields) for result in chosen]
    name = next((name for name in (kinds[0] if kinds else []) if all(name in each for each in kinds)), None)
    if len(chosen) < 2 or name is None:
        return []
    alike = all(result.scene.geometry == chosen[0].scene.geometry for result in chosen)
    scale = pictures.common_scale(name, (result.fields for result in chosen)) if alike else None
    found = []
    for result in chosen:
        text = f"The {name} at {_at(result)}." if result.data.get("varied") else f"The {name}, {result.title}."
        figure = pictures.draw(name, result.fields, result.title, scale)
        found.append(Picture.of(figure, text, maximum * 2 // 3))
    return [Pictures(f"The {name}" + (" with the same colours" if alike else ""), found, slider)]


def _command(directory: Path, definition: Mapping[str, Any], data: Mapping[str, Any]) -> str:
    """Return the command that makes a sweep again."""
    base = scene.command(Scene.model_validate(definition["scene"])) or "scene.toml"
    vary, product = definition["vary"], definition.get("design") == "product"
    options = [part for key, values in vary.items() for part in ("--vary", f"{key}={','.join(map(str, values))}")]
    if any(value == "" for values in vary.values() for value in values):
        options = ["--points", "points.csv"]  # some points leave a key as the scene has it
    options += [] if product or "--points" in options else ["--design", "zip"]
    options += [*scene.options(data), *(["--sensitivities"] if data.get("sensitivities") else [])]
    return f"ffsi sweep {base} {shlex.join(options)} --out {shlex.quote(directory.name)}"


def _effects(table: pd.DataFrame, keys: Sequence[str], units: dict[str, str]) -> Any:
    varied = [key for key in keys if table[key].nunique(dropna=False) > 1]
    return None if curves.is_product(table, varied) else curves.main_effects(table, keys, units)


def _at(result: Result) -> str:
    return ", ".join(
        f"{words(key)} = {value_text(value)} {about_key(key)[0]}".rstrip()
        for key, value in result.data["varied"].items()
    )


def _points(table: pd.DataFrame, keys: Sequence[str], units: dict[str, str]) -> list[Block]:
    wanted = [*keys, "status", "checked", *(curves.column(table, name) or "" for name in in_table("points"))]
    jacobians = [str(name) for name in table if str(name).startswith("min_jacobian")]
    wanted += [*(name for name in jacobians if not name.endswith(("_x", "_y"))), "check_maximum", "seconds"]
    wanted += ["warnings", "not_evaluated"]
    columns = [name for name in dict.fromkeys(wanted) if name in table and table[name].notna().any()]
    body = [[cell(line[name], _FORMS.get(str(name), ".6g")) for name in columns] for _, line in table.iterrows()]
    file = (TABLE, table.to_csv(index=False))
    texts = ("status", "checked", "warnings", "not_evaluated")
    head = [words(str(name)) if name in texts else label(str(name), units) for name in columns]
    numeric = [pd.api.types.is_numeric_dtype(table[name]) and name not in texts for name in columns]
    return [Rows(head, body, numeric, "Points", "A click on a head sorts; the file holds every column.", file)]


def _failed(table: pd.DataFrame, keys: Sequence[str]) -> list[Block]:
    failed = table[table["status"] != "converged"]
    reached = [name for name in ("reached_load", "reached_time") if name in table]
    body = [
        [
            *(cell(line[key], ".6g") for key in keys), OUTCOMES.get(str(line["failure"]), "not converged"),
            cell(line["reason"], ""), *(cell(line[name], ".4g") for name in reached),
        ]
        for _, line in failed.iterrows()
    ]  # fmt: skip
    head = [*map(label, keys), "what", "reason", *(words(name) for name in reached)]
    numeric = [*(pd.api.types.is_numeric_dtype(table[key]) for key in keys), False, False, *[True] * len(reached)]
    return [Rows(head, body, numeric, "Points that failed")] if body else []
