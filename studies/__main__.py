"""The command `python -m studies`: `verify`, `bench` and `paper` measure ffsi itself and write results/."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from ffsi.cli.exit_codes import TEXT, worst
from ffsi.cli.main import main as run
from ffsi.files.errors import InputError

app = typer.Typer(
    name="studies",
    help="Measure ffsi: against published and exact values, in seconds, and by the paper's study.",
    epilog=TEXT,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

TableFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Write CSV, Markdown, pictures there.", show_default=False)
]
Readme = Annotated[
    Path | None,
    typer.Option("--readme", metavar="FILE", help="Replace this command's tables in FILE.", show_default=False),
]
Runs = Annotated[
    Path | None,
    typer.Option(
        "--runs",
        metavar="DIR",
        help="The run folders of what takes long; a second call goes on from there.",
        show_default="in runs/",
    ),
]
Kinds = Mapping[str, tuple[str, tuple[str, ...]]]
"""By the flag of a command's kind: the module that does it, and which options it has."""
VERIFY: Kinds = {
    "": ("verification.command", ("levels", "out", "readme")),
    "--unsteady": ("verification.periodic", ("jobs", "runs", "out", "readme")),
    "--long": ("verification.long", ("jobs", "runs", "out", "readme")),
    "--blood": ("verification.blood", ("jobs", "runs", "out", "readme")),
    "--hard": ("verification.hard", ("jobs", "runs", "out", "only")),
}
BENCH: Kinds = {
    "": ("bench.levels", ("case", "levels", "repeat", "out", "readme")),
    "--scenes": ("bench.scenes", ("repeat", "out", "readme")),
    "--mesh-motion": ("bench.mesh_motion", ("level", "out", "readme")),
    "--unsteady": ("bench.unsteady", ("repeat", "runs", "out", "readme")),
}
PAPER: Kinds = {
    "": ("paper.study", ("cases", "level", "jobs", "out", "runs")),
    "--aneurysm": ("paper.aneurysm", ("level", "out", "runs")),
}


@app.command()
def verify(
    unsteady: Annotated[
        bool,
        typer.Option("--unsteady", help="The cases in time instead, two meshes and time steps each (takes hours)."),
    ] = False,
    long: Annotated[
        bool, typer.Option("--long", help="FSI2 and FSI3 over many periods instead (takes an hour or so).")
    ] = False,
    blood: Annotated[
        bool, typer.Option("--blood", help="The flow of blood in channels and the aneurysm instead (takes minutes).")
    ] = False,
    hard: Annotated[
        bool,
        typer.Option("--hard", help="Scenes that must be solved rightly or refused with the cause (takes hours)."),
    ] = False,
    levels: Annotated[
        str | None,
        typer.Option(
            "--levels",
            metavar="A,B,...",
            help="Mesh levels of every case.",
            show_default="0 to 3, FSI1 and flaps 0 to 4",
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", min=1, help="Runs at a time, with one of the flags above.", show_default="1"),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option("--only", metavar="GLOB,...", help="With --hard: names such as h-*.", show_default="all"),
    ] = None,
    runs: Runs = None,
    out: TableFolder = None,
    readme: Readme = None,
) -> None:
    """Run every case that has published values on several meshes and print the errors (takes minutes).

    Exit codes: 0 all runs solved and checked, else as `ffsi run`; errors against published values do not count. With
    --hard 0 if all is as expected; 1 also if a number or a cause is wrong.
    """
    flags = {"--unsteady": unsteady, "--long": long, "--blood": blood, "--hard": hard}
    given = {"jobs": jobs, "runs": runs, "out": out, "readme": readme, "only": only}
    _do("verify", VERIFY, flags, given | {"levels": None if levels is None else partial(_levels, levels)})


@app.command()
def bench(
    scenes: Annotated[
        bool,
        typer.Option(
            "--scenes", help="Cost ratios of every steady scene near 30 000 unknowns instead, and formulations."
        ),
    ] = False,
    mesh_motion: Annotated[
        bool, typer.Option("--mesh-motion", help="How far each mesh motion carries the flap instead, and its cost.")
    ] = False,
    unsteady: Annotated[
        bool, typer.Option("--unsteady", help="What a time step of FSI3 at full swing costs instead (minutes).")
    ] = False,
    case: Annotated[str | None, typer.Option("--case", help="The case to measure.", show_default="turek-fsi1")] = None,
    levels: Annotated[
        str | None,
        typer.Option("--levels", metavar="A,B,...", help="Mesh levels, separated by commas.", show_default="0,1,2,3,4"),
    ] = None,
    level: Annotated[
        int | None,
        typer.Option("--level", min=0, max=4, help="Mesh level, with --mesh-motion.", show_default="1"),
    ] = None,
    repeat: Annotated[
        int | None, typer.Option("--repeat", min=1, help="Runs per level or scene; medians.", show_default="1")
    ] = None,
    runs: Runs = None,
    out: TableFolder = None,
    readme: Readme = None,
) -> None:
    """Measure error against seconds, and what assembly costs beside one factorisation, over the mesh levels.

    Exit codes: as `ffsi run`, but where a mesh motion ends is a result: 3 only if no mesh motion solved any point.
    """
    flags = {"--scenes": scenes, "--mesh-motion": mesh_motion, "--unsteady": unsteady}
    given = {"case": case, "level": level, "repeat": repeat, "runs": runs, "out": out, "readme": readme}
    _do("bench", BENCH, flags, given | {"levels": None if levels is None else partial(_levels, levels)})


@app.command()
def paper(
    aneurysm: Annotated[
        bool, typer.Option("--aneurysm", help="Section 5.4 instead: the aneurysm, figures 15 to 18 (minutes).")
    ] = False,
    cases: Annotated[
        str | None,
        typer.Option("--cases", metavar="A,B,...", help="Numbers of the paper's cases.", show_default="1,2,3"),
    ] = None,
    level: Annotated[int, typer.Option("--level", help="Mesh level, 0 to 4.")] = 2,
    jobs: Annotated[int | None, typer.Option("--jobs", min=1, help="Sweeps at a time.", show_default="1")] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Write CSV, PNG, Markdown there.")] = Path(
        "results/paper"
    ),
    runs: Annotated[Path, typer.Option("--runs", metavar="DIR", help="The runs; a second call resumes them.")] = Path(
        "runs/paper"
    ),
) -> None:
    """Reproduce the paper's sections 5.1 to 5.3: figures 3 to 14 and their tables (takes minutes).

    Exit codes: as `ffsi run`, but where a sweep ends is a result: 3 only if a sweep has solved no point.
    """
    given = {"jobs": jobs, "level": level, "out": out, "runs": runs}
    numbers = None if cases is None else partial(_numbers, "--cases", cases)
    _do("paper", PAPER, {"--aneurysm": aneurysm}, given | {"cases": numbers})


def _do(command: str, kinds: Kinds, flags: Mapping[str, bool], given: Mapping[str, Any]) -> None:
    """Do the kind of a study whose flag was given, with the options that were given; a text is read after both.

    Raises:
        InputError: several flags, or an option that this kind does not have.
    """
    kind, *more = [name for name, value in flags.items() if value] or [""]
    if more:
        raise InputError(f"give either {kind} or {more[0]}, not both")
    module, accepted = kinds[kind]
    options = {name: value for name, value in given.items() if value is not None}
    if wrong := [name for name in options if name not in accepted]:
        raise InputError(f"{f'python -m studies {command} {kind}'.strip()} has no option --{wrong[0]}")
    values = {name: value() if isinstance(value, partial) else value for name, value in options.items()}
    raise typer.Exit(worst(import_module(f"studies.{module}").main(**values)))


def _levels(text: str) -> list[int]:
    """Read mesh levels such as `0,1,2`."""
    numbers = _numbers("--levels", text)
    if min(numbers) < 0 or max(numbers) > 4:
        raise InputError(f"--levels: mesh levels go from 0 to 4, not {text!r}")
    return numbers


def _numbers(option: str, text: str) -> list[int]:
    """Read integers such as `0,1,2`."""
    try:
        numbers = [int(item) for item in text.split(",")]
    except ValueError:
        raise InputError(f"{option} takes integers separated by commas such as 1,2, not {text!r}") from None
    if len(set(numbers)) < len(numbers):
        raise InputError(f"{option}: a number occurs twice in {text!r}")
    return numbers


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; always ends in SystemExit."""
    run(arguments, app, "python -m studies")


if __name__ == "__main__":
    main()
