"""Commands on folders of runs that are there: `animate`, `check` and `report`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ffsi.cli import show
from ffsi.cli.arguments import AsJson, check_output
from ffsi.cli.exit_codes import CHECK_FAILED, NOT_CONVERGED
from ffsi.files import folder, machine
from ffsi.files.errors import InputError
from ffsi.text import nearest

if TYPE_CHECKING:
    from ffsi.hemodynamics.result import Result
    from ffsi.scene import Scene

FIELDS = ", ".join(folder.PICTURES)


def animate(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="The folder of a run in time.", show_default=False)],
    field: Annotated[
        str | None, typer.Option("--field", help=FIELDS, show_default="velocity, of a solid alone displacement")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="The GIF file.", show_default="DIR/FIELD.gif")
    ] = None,
) -> None:
    """Write a GIF of a computation in time, from the states saved every time.output_interval."""
    from ffsi.hemodynamics.result import load_result

    result = load_result(directory)
    name = field or ("velocity" if result.scene.fluid else "displacement")
    check_animation(result.scene, name)
    if output is not None:
        check_output(output)
    _animate(result, name, output or directory / f"{name}.gif")


def check(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a run, a sweep or a script.", show_default=False)
    ],
    json: AsJson = False,
) -> None:
    """Run the independent checker on results that are already there.

    Exit codes: 0 passed, 1 failed, 2 bad input, 3 nothing converged there.
    """
    from ffsi.hemodynamics.result import load_results
    from ffsi.result import table
    from ffsi.run import recheck
    from ffsi.run.direct import adopt
    from ffsi.run.verdict import verdict

    adopt(directory)
    results = load_results(directory, believe=True)
    solved = [result for result in results if result.solved]
    problems = table.problems(directory) if folder.is_sweep_folder(directory) else []
    found = [(result, recheck.problems(result)) for result in results if result.solved or "digest" in result.data]
    problems += [f"{result.file}: {text}" for result, texts in found for text in texts]
    if not solved and not problems:
        show.error(f"{directory} holds no converged point, there is nothing to check")
        raise typer.Exit(NOT_CONVERGED)
    reports = []
    for result in solved:
        try:
            reports.append((result, verdict(result.directory, result.scene, result.point)))
        except (ValueError, OSError) as error:  # its files do not fit together: damaged, or of another scene
            if machine.ended(error):
                raise
            problems.append(f"{result.directory}, point {result.point}: {machine.words(error)}")
    passed = not problems and all(report.passed for _, report in reports)
    if json:
        sys.stdout.write(folder.to_json({"passed": passed, "problems": problems, "points": show.check_rows(reports)}))
    elif reports:
        show.checks(reports)
    for text in problems:
        show.error(text)
    for result, report in reports:
        for failure in report.failures:
            show.error(f"{result.directory}, point {result.point}: {failure}")
    raise typer.Exit(0 if passed else CHECK_FAILED)


def report(
    directories: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="Run folders and sweeps.", show_default=False)
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The HTML file, or a Markdown file if it ends in .md.")
    ] = Path("report.html"),
    title: Annotated[str | None, typer.Option("--title", help="Its heading.", show_default="names of cases")] = None,
    author: Annotated[str | None, typer.Option("--author", help="Who wrote it.", show_default="your account")] = None,
) -> None:
    """Write one self-contained report, HTML or Markdown; a run that has not ended is shown as far as it got."""
    from ffsi.report import write_report
    from ffsi.run.direct import adopt

    check_output(output)
    if output.suffix.lower() not in (".html", ".htm", ".md"):
        raise InputError(f"-o {output}: accepted: a name that ends in .html or .md")
    for directory in directories:
        adopt(directory)
    write_report(directories, output, title, author)
    show.note(f"wrote {output}")


def holds(directory: Path, scene: Scene) -> bool:
    """Tell whether the run in a folder is one of this scene; not where its `scene.toml` cannot be read."""
    from ffsi.scene import SceneError, load_scene

    try:
        return load_scene(directory / folder.SCENE) == scene
    except (InputError, SceneError):
        return False


def check_animation(scene: Scene, field: str) -> None:
    """Refuse an animation that cannot be made, before anything is computed."""
    fluid, solid = scene.fluid is not None, bool(scene.solid)
    there = {"velocity": fluid, "pressure": fluid, "displacement": solid}
    known = [name for name, is_there in there.items() if is_there]
    if field not in known:
        guess = nearest(field, known)
        hint = f' (did you mean "{guess}"?)' if guess else ""
        raise InputError(f"no animation of {field!r}; of this scene there is {', '.join(known)}{hint}")
    if scene.time is None:
        raise InputError(f"{scene.name} is steady; there is nothing to animate")
    if scene.time.output_interval is None:
        raise InputError("an animation needs the fields at several times: set time.output_interval")


def _animate(result: Result, field: str, output: Path) -> None:
    from ffsi.report.animation import write_animation

    count = write_animation(result, field, output)
    show.note(f"wrote {output} ({count} frames)")


COMMANDS: dict[str, Callable[..., None]] = {"animate": animate, "check": check, "report": report}
