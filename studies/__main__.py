"""The command `python -m studies`: `verify`, `bench` and `paper` measure ffsi itself and write results/."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from ffsi.cli.exit_codes import TEXT, worst
from ffsi.cli.main import main as run
from ffsi.files.errors import InputError

app = typer.Typer(
    name="studies", help="Measure ffsi: against published and exact values, in seconds, and by the paper's study.",
    epilog=TEXT, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip


def _option(name: str, text: str, kind: str | None = None, default: bool | str = False, **more: Any) -> Any:
    return typer.Option(f"--{name}", help=text, metavar=kind, show_default=default, **more)


Out = Annotated[Path | None, _option("out", "Write CSV, Markdown, pictures there.", "DIR")]
Readme = Annotated[Path | None, _option("readme", "Replace this command's tables in FILE.", "FILE")]
_KEPT = "The run folders of what takes long; a second call goes on from there."
Runs = Annotated[Path | None, _option("runs", _KEPT, "DIR", "in runs/")]
Jobs = Annotated[int | None, _option("jobs", "Runs or sweeps at a time, of what takes long.", default="1", min=1)]
Repeat = Annotated[int | None, _option("repeat", "Runs per level or scene; medians.", default="1", min=1)]
Kinds = Mapping[str, tuple[str, str, tuple[str, ...]]]
"""By the flag of a command's kind: module and function that do it, and which options it has."""
_LONG = ("jobs", "runs", "out", "readme")
VERIFY: Kinds = {
    "": ("verification.steady", "main", ("out", "readme")),
    "--unsteady": ("verification.in_time", "main", _LONG),
    "--long": ("verification.in_time", "main_long", _LONG),
    "--blood": ("verification.blood", "main", _LONG),
    "--hard": ("verification.hard", "main", ("jobs", "runs", "out", "only")),
    "--errors": ("verification.errors", "main", ("jobs", "runs", "out")),
    "--acid": ("verification.acid", "main", ("jobs", "runs", "out")),
}
BENCH: Kinds = {
    "": ("bench.steady", "main_levels", ("repeat", "out", "readme")),
    "--work-precision": ("bench.speed", "main_levels", ("repeat", "out", "readme")),
    "--peers": ("bench.speed", "main_peers", ("repeat", "out", "readme")),
    "--factors": ("bench.factors", "main", ("repeat", "out", "readme")),
    "--scenes": ("bench.steady", "main_scenes", ("repeat", "out", "readme")),
    "--mesh-motion": ("bench.mesh_motion", "main", ("out",)),
    "--unsteady": ("bench.unsteady", "main", ("repeat", "runs", "out", "readme")),
}
PAPER: Kinds = {
    "": ("paper.flap", "main", ("jobs", "out", "runs")),
    "--aneurysm": ("paper.aneurysm", "main", ("out", "runs")),
}


@app.command()
def verify(
    unsteady: Annotated[
        bool, _option("unsteady", "The cases in time instead, two meshes and time steps each (takes hours).")
    ] = False,
    long: Annotated[bool, _option("long", "FSI2 and FSI3 over many periods instead (takes an hour or so).")] = False,
    blood: Annotated[
        bool, _option("blood", "The flow of blood in channels and the aneurysm instead (takes minutes).")
    ] = False,
    hard: Annotated[
        bool, _option("hard", "Scenes that must be solved rightly or refused with the cause (takes hours).")
    ] = False,
    acid: Annotated[
        bool, _option("acid", "Tests of the literature that others fail, or that are exact (takes minutes).")
    ] = False,
    errors: Annotated[bool, _option("errors", "Error bars against errors instead (takes half an hour).")] = False,
    jobs: Jobs = None,
    only: Annotated[str | None, _option("only", "With --hard: names such as h-*.", "GLOB,...", "all")] = None,
    runs: Runs = None,
    out: Out = None,
    readme: Readme = None,
) -> None:
    """Run every case that has published values on several meshes and print the errors (takes minutes).

    Exit codes: 0 all runs solved and checked, else as `ffsi run`; errors against published values do not count. With
    --hard 0 if all is as expected; 1 also if a number or a cause is wrong.
    """
    _do("verify", VERIFY, locals())


@app.command()
def bench(
    work_precision: Annotated[
        bool, _option("work-precision", "Errors against processor time and unknowns instead (takes minutes).")
    ] = False,
    peers: Annotated[bool, _option("peers", "FSI1 beside NGSolve instead; `make bench-peers` installs it.")] = False,
    factors: Annotated[bool, _option("factors", "FSI1 without each part of the method instead (a minute).")] = False,
    scenes: Annotated[
        bool, _option("scenes", "Cost ratios of every steady scene near 30 000 unknowns instead, and formulations.")
    ] = False,
    mesh_motion: Annotated[
        bool, _option("mesh-motion", "How far each mesh motion carries the flap instead, and its cost.")
    ] = False,
    unsteady: Annotated[bool, _option("unsteady", "What a time step costs instead (takes minutes).")] = False,
    repeat: Repeat = None,
    runs: Runs = None,
    out: Out = None,
    readme: Readme = None,
) -> None:
    """Measure what FSI1 costs over the mesh levels, in units of one factorisation.

    Exit codes: as `ffsi run`, but where a mesh motion ends is a result: 3 only if no mesh motion solved any point.
    """
    _do("bench", BENCH, locals())


@app.command()
def report(out: Out = None) -> None:
    """Write one HTML file, results/report.html, of all kept results: the paper's study, verification, bench."""
    from studies.report import main

    main(out or Path("results"))


@app.command()
def paper(
    aneurysm: Annotated[
        bool, _option("aneurysm", "Section 5.4 instead: the aneurysm, figures 15 to 18 (minutes).")
    ] = False,
    jobs: Jobs = None,
    out: Annotated[Path, _option("out", "Write CSV, PNG, Markdown there.", "DIR", True)] = Path("results/paper"),
    runs: Annotated[Path, _option("runs", "The runs; a second call resumes them.", "DIR", True)] = Path("runs/paper"),
) -> None:
    """Reproduce the paper's sections 5.1 to 5.3: figures 3 to 14 and their tables (takes minutes).

    Exit codes: as `ffsi run`, but where a sweep ends is a result: 3 only if a sweep has solved no point.
    """
    _do("paper", PAPER, locals())


def _do(command: str, kinds: Kinds, given: Mapping[str, Any]) -> None:
    """Do the kind of a study whose flag was given, with the options that were given."""
    flags = {flag: flag[2:].replace("-", "_") for flag in kinds if flag}
    kind, *more = [flag for flag, name in flags.items() if given[name]] or [""]
    if more:
        raise InputError(f"give either {kind} or {more[0]}, not both")
    module, function, accepted = kinds[kind]
    options = {name: value for name, value in given.items() if value is not None and name not in flags.values()}
    if wrong := [name for name in options if name not in accepted]:
        raise InputError(f"{f'python -m studies {command} {kind}'.strip()} has no option --{wrong[0]}")
    raise typer.Exit(worst(getattr(import_module(f"studies.{module}"), function)(**options)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; always ends in SystemExit."""
    run(arguments, app, "python -m studies")


if __name__ == "__main__":
    main()
