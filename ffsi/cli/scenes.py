"""Commands about scenes before anything is solved: what can be set, a new one, what one looks like, its script."""

from __future__ import annotations

import dataclasses
import itertools
import json as json_text
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ffsi.cli import show as printed
from ffsi.cli.arguments import AsJson, Case, Settings, check_output
from ffsi.cli.plain import Words, new_rich_table, stdout
from ffsi.files import catalogue, folder, machine
from ffsi.files.errors import InputError
from ffsi.text import listed, nearest, printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ffsi.run.meshing import Meshed
    from ffsi.scene import Scene
    from ffsi.scene.keys import Key


def cases(json: AsJson = False) -> None:
    """List the cases of the catalogue."""
    entries = catalogue.summaries()
    if json:
        sys.stdout.write(folder.to_json(entries))
    else:
        printed.cases(entries)


def keys(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[CASE|scene.toml] [PATTERN]",
            help='A scene, of which the keys that go with it, and their values; a table, or keys such as "*velocity".',
            show_default="all keys",
        ),
    ] = None,
    json: AsJson = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print all of them as the tables of docs/scene.md.")
    ] = False,
) -> None:
    """List the keys of a scene: type, unit, default, range, meaning."""
    from ffsi.scene import load_scene
    from ffsi.scene.keys import markdown as tables_of_keys
    from ffsi.scene.keys import scene_keys

    if markdown:
        if json or words:
            raise InputError("--markdown prints all keys: give no CASE, no PATTERN and no --json")
        sys.stdout.write(tables_of_keys())
        return
    case, pattern = _case_and_pattern(words or [])
    scene = None if case is None else load_scene(case)
    found = scene_keys(pattern, scene)
    if not found:
        known = [item.key for item in scene_keys("*", scene)]
        # A part of a name is a search; else a word is misspelt.
        guesses = dict.fromkeys(key for key in known if pattern in key) or filter(None, [nearest(pattern, known)])
        meant = listed(f'"{guess}"' for guess in guesses)
        where = f" of {scene.name}" if scene else ""
        raise InputError(f"no key{where} is {pattern!r}" + (f" (did you mean {meant}?)" if meant else ""))
    if json:
        sys.stdout.write(folder.to_json([dataclasses.asdict(item) for item in found]))
    else:
        _print_keys(found, values=scene is not None)


def _case_and_pattern(words: Sequence[str]) -> tuple[str | None, str]:
    """Tell a scene from a pattern: a case of the catalogue, a TOML file, or the first of two words."""
    if len(words) > 2:
        raise InputError(f"{len(words)} words; accepted: a case or scene file, and a pattern")
    is_case = len(words) == 2 or bool(words and (words[0] in catalogue.names() or words[0].endswith(".toml")))
    case, *rest = (list(words) if is_case else [None, *words]) or [None]
    return case, rest[0] if rest and rest[0] is not None else "*"


def _print_keys(found: Sequence[Key], *, values: bool) -> None:
    """Print keys, those of each table and kind together."""
    for only, group in itertools.groupby(found, key=lambda item: item.only):
        heads = ["key", "unit", *(["value"] if values else []), "default", "accepted", "meaning"]
        table = _table(only or None, *heads)
        for item in group:
            table.add_row(*(Words(getattr(item, name)) for name in heads))
        stdout().print(table)


def _table(title: str | None, *names: str) -> Table:
    table = new_rich_table(title=title, title_justify="left", header_style=None, padding=(0, 2, 0, 0))
    for name in names:
        table.add_column(name, overflow="fold", min_width=len(name))
    return table


def schema() -> None:
    """Print the JSON schema of a scene, by which editors complete and check a TOML file."""
    from ffsi.scene import Scene

    sys.stdout.write(json_text.dumps(Scene.model_json_schema(), indent=1, ensure_ascii=False) + "\n")


def show(
    case: Case,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.png", help="Draw it, too.", show_default=False)
    ] = None,
    settings: Settings = [],  # noqa: B006
) -> None:
    """Say what a scene is before it is solved: domain, roles of the boundaries, mesh, dimensionless numbers, inflow.

    FreeFEM makes the mesh; without it the rest is said, and no picture is drawn (exit code 4 with -o).
    """
    from ffsi.freefem import FreeFEMNotFound
    from ffsi.run.meshing import mesh_of
    from ffsi.scene import load_scene

    scene = load_scene(case, settings)
    if output is not None:
        check_output(output)
        if output.suffix.lower() != ".png":
            raise InputError(f"{output}: -o takes the name of a PNG file")
    _print_scene(scene)
    try:
        with printed.progress(scene.name) as on_event:
            found = mesh_of(scene, on_event)
    except FreeFEMNotFound as error:
        if output is not None:
            raise
        printed.note(f"mesh: not made, {error}")
        return
    _print_mesh(scene, found)
    if output is not None:
        from ffsi.result.pictures import to_png
        from ffsi.result.sketch import sketch

        with machine.writing(output):
            output.write_bytes(to_png(sketch(scene, found.mesh)))
        printed.note(f"wrote {output}")


def _print_scene(scene: Scene) -> None:
    """Print what is known before there is a mesh."""
    from ffsi.result.domain import CONDITIONS, PRESSED, intended
    from ffsi.result.numbers import inlet_words, numbers
    from ffsi.result.resolution import of_scene

    console, domain = stdout(), intended(scene)
    console.print(Words(printable(scene.heading), style="bold"), soft_wrap=True)
    console.print()
    regions = _table(None, "region", "area", "what is there")
    for name, area in domain["regions"].items():
        solid = scene.solid.get(name)
        what = printed.material_line(name, solid).partition(": ")[2] if solid else ""
        density = solid.density if solid else scene.fluid.density if scene.fluid else 0.0
        what = what or (scene.fluid.law if scene.fluid else "")
        regions.add_row(*map(Words, (name, f"{area:.6g} m²", f"{what}, density {density:g} kg/m³")))
    console.print(regions)
    console.print()
    sides = _table(None, "boundary", "role", "length", "condition")
    for name, side in domain["boundaries"].items():
        inlet = scene.inlet.get(name)
        condition = PRESSED if inlet is not None and inlet.pressure is not None else CONDITIONS[side["role"]]
        sides.add_row(*map(Words, (name, side["role"], f"{side['length']:.6g} m", condition)))
    console.print(sides)
    console.print()
    rows = _table(None, "number", "value", "how it is formed")
    for number in numbers(scene):
        rows.add_row(*map(Words, (number.name, f"{number.value:.4g}", number.formula)))
    if rows.row_count:
        console.print(rows)
        console.print()
    lines = [f"inlet: {line}" for line in inlet_words(scene)]
    if scene.only_outlet is not None:
        lines.append(f"outlet: {scene.only_outlet.kind}")
    lines += [f"outlet {name}: {outlet.kind}" for name, outlet in scene.outlets.items()]
    if scene.time is not None:
        step, end = scene.time.step, scene.time.end
        lines.append(f"time: steps of {step:g} s{' at most' if scene.time.adaptive else ''} to t = {end:g} s")
    for line in [*lines, *(f"warning: {warning}" for warning in of_scene(scene))]:
        console.print(Words(printable(line)), soft_wrap=True)


def _print_mesh(scene: Scene, found: Meshed) -> None:
    import numpy as np

    low, high = found.mesh.vertices.min(axis=0), found.mesh.vertices.max(axis=0)
    sides = found.mesh.vertices[found.mesh.triangles]
    lengths = np.linalg.norm(sides - np.roll(sides, 1, axis=1), axis=2)
    where = f"x {low[0]:.5g} to {high[0]:.5g} m, y {low[1]:.5g} to {high[1]:.5g} m"
    text = f"{len(sides)} triangles, {found.unknowns} unknowns, edges from {lengths.min():.3g} to {lengths.max():.3g} m"
    stdout().print(Words(f"mesh: level {scene.mesh.level}, {text}; {where}"), soft_wrap=True)


def _option(name: str, words: str, metavar: str | None = None) -> Any:
    return typer.Option(f"--{name}", help=words, metavar=metavar or name.upper(), show_default=False)


def new(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="The scene to write.", show_default=False)],
    geometry: Annotated[str | None, _option("geometry", "Kind of the domain; mesh: one of your own.", "KIND")] = None,
    what: Annotated[str | None, _option("solve", "What is solved.", "fsi|fluid|solid")] = None,
    material: Annotated[str | None, _option("material", "Material of the solids.", "LAW")] = None,
    velocity: Annotated[str | None, _option("velocity", 'Mean velocity at the inlet, such as "20 cm/s".')] = None,
    end: Annotated[str | None, _option("end", 'In time, and until when, such as "10 s".', "steady|TIME")] = None,
    level: Annotated[str | None, _option("level", "Refinement of the mesh, 0 to 6.")] = None,
    mesh: Annotated[str | None, _option("mesh", "The mesh file, for --geometry mesh.", "FILE")] = None,
    unit: Annotated[str | None, _option("unit", "Its unit of length.")] = None,
    inlet: Annotated[str | None, _option("inlet", "Its inlet; none without a fluid.", "NAME")] = None,
    outlet: Annotated[str | None, _option("outlet", "Its outlet, or several: a,b.", "NAME")] = None,
    clamped: Annotated[str | None, _option("clamped", "Where its solids are held; none: nowhere.", "NAME")] = None,
) -> None:
    """Write a scene to begin with, with comments; on a terminal it asks what no option says (six questions at most).

    Without a terminal nothing is asked, and what no option says has a usual value. A file that is there is left alone.
    """
    from ffsi.scene.drafts import MESH, Answers, draft

    if file.suffix != ".toml":
        raise InputError(f"{file}: the name of a scene ends in .toml")
    check_output(file)
    if file.exists():
        raise InputError(f"{file} is there already, and is left as it is; give another name")
    geometry = MESH if mesh is not None and geometry is None else geometry
    answers = Answers(geometry, what, material, velocity, end, level, mesh, unit, inlet, outlet, clamped)
    name = re.sub(r"[^a-z0-9]+", "-", file.stem.lower()).strip("-")[:60]
    name = name if name[:1].isalpha() else f"scene-{name}".rstrip("-")
    if on_terminal():
        _ask(answers)
    text = draft(name, answers, file.parent)
    name = file.name
    head = f"# ffsi show {name} says what this is, ffsi run {name} solves it, ffsi keys {name} lists all keys.\n"
    head += '# Numbers are in SI units; a text can have others: "20 cm/s".\n\n'
    try:
        with file.open("x", encoding="utf-8") as stream:
            stream.write(head + text)
    except FileExistsError:
        raise InputError(f"{file} is there already, and is left as it is; give another name") from None
    printed.note(f"wrote {file}; ffsi show {file} says what it is, ffsi run {file} solves it")


def on_terminal() -> bool:
    """Return whether a person can be asked."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def _ask(answers: Any) -> None:
    """Ask for what the options leave open."""
    from ffsi.scene import drafts
    from ffsi.scene.materials import MATERIALS

    def ask(key: str, question: str, default: str, accepted: Sequence[str] = (), check: _Check = str) -> None:
        if getattr(answers, key) is None:
            setattr(answers, key, _answer(question, default, accepted, check))

    def trial(**change: str) -> Callable[[str], object]:
        """Return what refuses an answer with which there is no scene."""
        (key,) = change
        return lambda text: drafts.draft("trial", dataclasses.replace(answers, **{key: text}))

    if answers.geometry is None:
        kinds = _table(None, "domain", "what it is")
        for kind, what in drafts.kinds().items():
            kinds.add_row(Words(kind), Words(what))
        _stderr().print(kinds)
    ask("geometry", "Which domain?", drafts.FIRST, check=drafts.choices)
    if answers.geometry == drafts.MESH:
        ask("mesh", "Which mesh file?", "", check=drafts.groups)
        _, curves = drafts.groups(answers.mesh)
        known = [*curves, drafts.NONE]
        ask("unit", "In which unit are its coordinates?", "m", check=trial(unit=""))
        ask("inlet", "Which boundary is the inlet?", drafts.guess("inlet", curves), known)
        if answers.inlet != drafts.NONE:
            several = f"Which ones are outlets (a, or a,b) of {', '.join(known)}?"
            ask("outlet", several, drafts.guess("outlet", curves), check=trial(outlet=""))
        ask("clamped", "Where are solids held?", drafts.guess("clamped", curves), known)
        return
    able = drafts.choices(answers.geometry)
    ask("what", "What is to be solved (fsi: fluid and solid)?", able[0], able) if len(able) > 1 else None
    answers.what = answers.what or able[0]
    if answers.what != "fluid":
        ask("material", "Of which material are the solids?", "neo-hookean", list(MATERIALS))
    if answers.what != "solid":
        ask("velocity", "Mean velocity at the inlet?", drafts.velocity(answers), check=trial(velocity=""))
    ask("end", 'Steady, or in time until when (such as "10 s")?', drafts.STEADY, check=trial(end=""))
    ask("level", "How fine is the mesh (with a flow 7000 to 150 000 unknowns)?", "1", list("01234"))


def _stderr() -> Console:
    from rich.console import Console

    return Console(stderr=True, highlight=False)


_Check = Callable[[str], object]


def _answer(question: str, default: str, accepted: Sequence[str], check: _Check) -> str:
    """Ask until the answer can be used."""
    from rich.prompt import Prompt

    from ffsi.scene import SceneError

    console = _stderr()
    while True:
        try:
            text = Prompt.ask(question, console=console, choices=list(accepted) or None, default=default or ...)
        except EOFError:
            raise KeyboardInterrupt from None
        try:
            check(str(text))
        except SceneError as error:
            printed.error(str(error))
            continue
        return str(text)


def render(
    case: Case,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Write the script here instead of stdout.", show_default=False)
    ] = None,
    settings: Settings = [],  # noqa: B006
) -> None:
    """Write the FreeFEM script of a case; with -o, also the mesh of a scene that has its own, beside it."""
    from ffsi.scene import MeshGeometry, load_scene
    from ffsi.script.render import render as render_script

    scene = load_scene(case, settings)
    if output is not None:
        check_output(output)
    if output is None:
        sys.stdout.write(render_script(scene))
        return
    if output.exists() and output.suffix != ".edp":
        raise InputError(f"{output} is there, and no script (.edp); -o would replace it")
    mesh = output.with_suffix(".mesh")
    text = render_script(scene, mesh_file=mesh.name)
    start = output.with_name("initial.mesh")
    if scene.time is not None and scene.time.initial is not None and start.exists() and not output.exists():
        raise InputError(f"{start} is there, and no start of a script {output.name}; give -o another folder")
    if isinstance(scene.geometry, MeshGeometry):
        if not re.fullmatch(r"[\w. -]+", mesh.name):
            raise InputError(f"{mesh.name!r}: the mesh beside the script needs a name of letters, digits and . - _")
        if mesh.exists() and (mesh.samefile(scene.geometry.file) or not output.exists()):
            raise InputError(f"{mesh} is there, and no mesh of a script {output.name}; give -o another name")
        scene.geometry.write(mesh)
    if scene.time is not None:
        scene.time.store(output.parent)
    folder.write_text(output, text)


COMMANDS: dict[str, Callable[..., None]] = {
    "cases": cases,
    "keys": keys,
    "schema": schema,
    "render": render,
    "new": new,
    "show": show,
}
