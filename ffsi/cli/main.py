"""The command line; for its exit codes see `exit_codes.TEXT`."""

from __future__ import annotations

import contextlib
import copy
import functools
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from ffsi.cli import folders, scenes, show
from ffsi.cli.arguments import AsJson, Case, OptionalCase, Settings
from ffsi.cli.exit_codes import BAD_INPUT, FAULT, INTERRUPTED, NO_FREEFEM, TEXT, worst
from ffsi.cli.streams import guarded
from ffsi.files import folder, machine
from ffsi.files.arguments import Design
from ffsi.files.errors import InputError
from ffsi.text import printable

if TYPE_CHECKING:
    import pandas as pd

    from ffsi.hemodynamics.result import Result
    from ffsi.scene import Scene

app = typer.Typer(
    name="ffsi",
    help="Strongly coupled fluid-structure interaction in 2D with FreeFEM: solve, check, study, report.",
    epilog=TEXT,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

NoCheck = Annotated[bool, typer.Option("--no-check", help="Skip the independent reference check.")]


def _print_version(wanted: bool) -> None:
    if wanted:
        from ffsi.script.render import package_version

        sys.stdout.write(f"ffsi {package_version()}\n")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Strongly coupled fluid-structure interaction in 2D with FreeFEM: solve, check, study, report."""


for name, command in scenes.COMMANDS.items():
    app.command(name)(command)


@app.command()
def run(
    case: OptionalCase = None,
    settings: Settings = [],  # noqa: B006
    out: Annotated[
        Path | None, typer.Option("--out", help="The run folder; a run in it is replaced.", show_default="runs/CASE")
    ] = None,
    json: AsJson = False,
    no_check: NoCheck = False,
    resume: Annotated[
        Path | None,
        typer.Option(
            "--resume",
            metavar="DIR",
            help="Go on with the run in time in DIR, which was killed or stopped, instead of a case; a "
            "finished one with --set time.end=LATER; steps, loads, outputs can change too.",
            show_default=False,
        ),
    ] = None,
    error: Annotated[
        bool, typer.Option("--error", help="Error bars of the quantities; in time by two more runs beside this one.")
    ] = False,
    levels: Annotated[
        str | None,
        typer.Option(
            "--levels",
            metavar="0,1,2",
            show_default=False,
            help="Solve it on these levels of the mesh: order, extrapolated values, error bars; DIR becomes a sweep.",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="With --levels: processes at a time.")] = 1,
    adapt: Annotated[
        str,
        typer.Option("--adapt", metavar="A,B", help="Steady: a mesh made for quantities.", show_default=False),
    ] = "",
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", metavar="0.1%", help="Of each of them.", show_default=False)
    ] = None,
    unknowns: Annotated[
        int | None, typer.Option("--unknowns", metavar="N", help="At most, of that mesh.", show_default=False)
    ] = None,
    animate: Annotated[
        str | None,
        typer.Option(
            "--animate",
            metavar="FIELD",
            show_default=False,
            help=f"In time: write FIELD.gif ({folders.FIELDS}).",
        ),
    ] = None,
) -> None:
    """Solve one case and check it.

    Exit codes: 0 solved and checked, 1 the check failed, 2 bad input, 3 not converged (partial results are kept),
    4 FreeFEM missing or crashed or the machine out of disk, memory or time.
    """
    from ffsi.freefem import FreeFEMError
    from ffsi.result import resolution
    from ffsi.result.in_time import STOPPED
    from ffsi.run.adaptation import asked_of
    from ffsi.run.beside import scenes_beside
    from ffsi.run.longer import lengthen
    from ffsi.run.one_scene import solve
    from ffsi.run.resume import check_resumable
    from ffsi.scene import load_scene
    from ffsi.scene.overrides import parse_overrides

    alone = {"resume": resume, "animate": animate, "error": error, "adapt": adapt}
    if levels is not None and (others := [f"--{name}" for name, given in alone.items() if given]):
        raise InputError(f"give either --levels or {others[0]}, not both")
    names = [name for name in adapt.split(",") if name]

    def accepted(scene: Scene) -> Scene:
        if animate is not None:
            folders.check_animation(scene, animate)
        if error and scene.time is not None:
            scenes_beside(scene)
        return asked_of(scene, names, tolerance, unknowns)[0]

    if resume is not None:
        if case is not None or out is not None:
            raise InputError("--resume takes case, values and folder from DIR: give no CASE or --out")
        directory, values = resume, parse_overrides(settings)
        scene = lengthen(resume, values, accepted, error=error) if settings else accepted(check_resumable(resume))
    elif case is None:
        raise InputError("Missing argument CASE or scene.toml, or --resume DIR")
    else:
        scene = load_scene(case, settings)
        if levels is not None:
            _levels(scene, levels, out or Path("runs") / f"{scene.name}-levels", jobs, json=json, check=not no_check)
        scene = accepted(scene)
        directory = out or Path("runs") / scene.name
        folder.check_usable(directory)
        inside = folder.is_sweep_folder(directory.parent)  # which is refused
        if (directory / folder.RESULT).is_file() and not inside and not folders.holds(directory, scene):
            show.note(f"the run of another scene in {directory} is replaced; --out keeps both")
    if not json:
        show.domain(scene)
    try:
        with machine.computing(directory), show.progress(scene.name) as on_event:
            result = solve(
                scene,
                directory,
                check=not no_check,
                on_event=on_event,
                resume=resume is not None,
                animate=animate,
                error=error,
                adapt=names,
                tolerance=tolerance,
                unknowns=unknowns,
            )
    except (FreeFEMError, machine.MachineError) as error:
        if json:
            sys.stdout.write(_crash_json(directory, scene.name, error))
        for warning in resolution.of_scene(scene):
            show.note(f"warning: {warning}")
        _say_how_to_resume(scene, directory)
        raise
    except KeyboardInterrupt:
        _say_how_to_resume(scene, directory)
        raise
    if json:
        sys.stdout.write(folder.to_json(result.data))
    else:
        show.result(result)
    if animate is not None and (directory / f"{animate}.gif").is_file():
        show.note(f"wrote {directory / animate}.gif ({len(result.saved_steps)} frames)")
    if result.failure == STOPPED:
        _say_how_to_resume(scene, directory)
    _finish([result], directory)


@app.command()
def sensitivities(
    case: Case,
    of: Annotated[str, typer.Option("--of", metavar="A,B", help="Quantities.", show_default="all")] = "",
    to: Annotated[str, typer.Option("--to", metavar="KEY,KEY", help="Numbers of the scene.", show_default="all")] = "",
    settings: Settings = [],  # noqa: B006
    out: Annotated[Path | None, typer.Option("--out", help="The run folder.", show_default="none is kept")] = None,
    json: AsJson = False,
) -> None:
    """Derivatives of the quantities of a case by its numbers, absolute in SI and logarithmic, p/J dJ/dp.

    In time they are differences of two runs for every KEY, a hundredth of it to either side.
    """
    from ffsi.run.one_scene import solve
    from ffsi.run.sensitivities import differences, refuse_unknown
    from ffsi.run.sensitivities import sensitivities as table_of
    from ffsi.scene import load_scene

    scene = load_scene(case, settings)
    names, keys = (list(dict.fromkeys(filter(None, text.split(",")))) for text in (of, to))
    refuse_unknown(scene, names, keys)
    if scene.time is not None:
        with show.progress(scene.name, 2 * len(keys)) as on_event:
            _print_sensitivities(differences(scene, names, keys, out, on_event), json=json)
        return
    if out is not None:
        folder.check_usable(out)
    with show.progress(scene.name) as on_event:
        result = solve(scene, out, on_event=on_event, sensitivities=True)
    if result.converged:
        tables = [table_of(result, names, keys, logarithmic=logarithmic) for logarithmic in (False, True)]
        _print_sensitivities(tables, json=json)
    _finish([result], result.directory)


@app.command()
def sweep(
    case: Annotated[
        str,
        typer.Argument(
            metavar="CASE|scene.toml|study.toml",
            help="A case of `ffsi cases`, a scene file, or a file that says all of a study (docs/studies.md).",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", help="The sweep's folder; a second call resumes it.", show_default=False)
    ],
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary",
            metavar="KEY=START:STOP:STEP|A,B,C|LOW:HIGH",
            help="A parameter and its values, with or without units, or the range of samples; repeatable.",
            show_default=False,
        ),
    ] = [],  # noqa: B006
    points: Annotated[
        Path | None,
        typer.Option("--points", metavar="FILE.csv", help="A line of keys, then points.", show_default=False),
    ] = None,
    design: Annotated[
        str | None,
        typer.Option("--design", metavar="|".join(get_args(Design)), help="Of the values.", show_default="product"),
    ] = None,
    samples: Annotated[
        int | None, typer.Option("--samples", metavar="N", help="Of ranges.", show_default=False)
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", metavar="S", help="Of samples.", show_default="0")] = None,
    settings: Settings = [],  # noqa: B006
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, help="FreeFEM processes at a time.", show_default="1")
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option("--dask", metavar="ADDRESS", help="Dask scheduler instead of --jobs.", show_default=False),
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option("--cache", metavar="DIR", help="Points solved once, for many studies.", show_default=False),
    ] = None,
    json: AsJson = False,
    no_check: NoCheck = False,
    error: Annotated[bool, typer.Option("--error", help="Steady: error bars in columns ..._error.")] = False,
    derivatives: Annotated[
        bool, typer.Option("--sensitivities", help="Steady: derivatives by the varied keys, in columns ..._by_KEY.")
    ] = False,
) -> None:
    """Solve a case at many values of its parameters into one table, sweep.csv."""
    from ffsi.cli.vary import parse_all, read_points, read_study
    from ffsi.result.table import TABLE
    from ffsi.run.design import columns_of
    from ffsi.run.sweep import sweep as run_sweep
    from ffsi.scene import load_scene, with_values
    from ffsi.scene.overrides import parse_overrides

    if jobs is not None and dask is not None:
        raise InputError("give either --jobs or --dask, not both")
    if vary and points is not None:
        raise InputError("give either --vary or --points, not both")
    said = read_study(Path(case)) if Path(case).suffix == ".toml" and Path(case).is_file() else None
    if said is not None and (vary or points is not None or design is not None or samples is not None):
        raise InputError(f"{case} is a study: its points are said there, not by --vary, --points, --design, --samples")
    if said is None:
        said = {"scene": case, "set": {}, "vary": parse_all(vary, sampled=samples is not None), "points": points}
        said |= {"design": design, "samples": samples, "seed": seed}
        if points is None and not vary:
            raise InputError("--vary or --points is missing: what is to be varied")
    elif seed is not None:
        said["seed"] = seed
    scene = with_values(with_values(load_scene(said["scene"]), said["set"]), parse_overrides(settings))
    varied: Any = read_points(Path(said["points"])) if said.get("points") else said["vary"]
    plan: dict[str, Any] = {
        "design": said.get("design") or "product",
        "samples": said.get("samples"),
        "seed": said.get("seed"),
    }
    count = len(columns_of(scene, varied, **plan)[1])  # refuses what the scene does not accept
    if not json:
        show.domain(scene)
    try:
        with machine.computing(out), show.progress(scene.name, count) as on_event:
            table = run_sweep(
                scene, varied, out, **plan, jobs=jobs, dask=dask, cache=cache, check=not no_check, on_event=on_event,
                error=error, sensitivities=derivatives,
            )  # fmt: skip
    except KeyboardInterrupt:
        show.note(f"interrupted; the same call goes on with what is missing in {out}")
        raise
    if json:
        sys.stdout.write(folder.to_json(table.to_dict("records")))
    else:
        show.sweep(table, list(varied), out)
    failures = sorted({str(item) for item in table["failure"]})
    for name in failures:
        if name:
            count = int((table["failure"] == name).sum())
            show.error(f"{count} of {len(table)} points: {name}; see the column reason of {out / TABLE}")
    if "not_evaluated" in table:
        for text in table["not_evaluated"].dropna().unique():
            show.error(f"not evaluated: {text}")
        failures.append("not-evaluated")
    raise typer.Exit(worst(failures))


for name, command in folders.COMMANDS.items():
    app.command(name)(command)


@app.command()
def doctor() -> None:
    """Look for FreeFEM and everything else that a run needs. Exit code 0, or 4 if something is missing."""
    raise typer.Exit(0 if show.doctor() else NO_FREEFEM)


def main(arguments: Sequence[str] | None = None, commands: typer.Typer = app, name: str = "ffsi") -> None:
    """Run the command line, or another program's commands in its way; always ends in SystemExit."""
    log = logging.getLogger("ffsi")
    handler, level = show.LogHandler(logging.INFO), log.level
    handler.addFilter(lambda record: record.name != "ffsi.run.execute")  # its failures are printed here
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        with guarded() as stdout:
            code = _call(arguments, commands, name)
            stdout.flush()
            if stdout.lost:
                show.error(f"standard output: {stdout.lost}; what this command printed there is lost")
                code = code or NO_FREEFEM
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
    sys.exit(code)


@functools.cache
def _tree(commands: typer.Typer, called: str) -> Any:
    """Return the command that is called, or all of them: to make these takes 13 ms."""
    called_alone = copy.copy(commands)
    called_alone.registered_commands = [
        each for each in commands.registered_commands if each.callback and called in (each.name, each.callback.__name__)
    ]
    found = commands.registered_callback and called_alone.registered_commands
    return typer.main.get_command(called_alone if found else commands)


def _call(arguments: Sequence[str] | None, commands: typer.Typer, name: str) -> int:
    """Run a command and return its exit code; whatever goes wrong is said in one place."""
    try:
        words = list(sys.argv[1:] if arguments is None else arguments)
        return int(_tree(commands, words[0] if words else "")(args=words, prog_name=name, standalone_mode=False) or 0)
    except InputError as error:
        show.error(str(error))
        return BAD_INPUT
    except machine.MachineError as error:
        show.error(str(error))
        return NO_FREEFEM
    except ImportError as error:  # what a command needs is loaded when it begins
        hint = "is its memory limited (ulimit -v), is a package missing?"
        show.error(f"ffsi cannot be loaded: {printable(error)}; {hint}")
        return NO_FREEFEM
    except OSError as error:
        show.error(machine.words(error))
        return NO_FREEFEM if machine.ended(error) else BAD_INPUT
    except MemoryError:
        show.error(machine.words(MemoryError()))
        return NO_FREEFEM
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        if hasattr(error, "format_message"):  # of the command line itself; typer has no public name for it
            return show.usage(error)
        kinds = {kind.__name__ for kind in type(error).__mro__}  # loads nothing: memory may have ended
        if kinds & {"SceneError", "FreeFEMError"}:
            show.error(str(error))
            return NO_FREEFEM if getattr(error, "kind", "bad-input") != "bad-input" else BAD_INPUT
        show.fault(error)
        return FAULT


def _levels(scene: Scene, text: str, directory: Path, jobs: int, *, json: bool, check: bool) -> None:
    """Solve a scene on several levels and print what its quantities tend to; always ends in Exit."""
    from ffsi.hemodynamics.result import load_results
    from ffsi.run.levels import levels

    try:
        wanted = [int(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--levels {text}: accepted: whole numbers such as 0,1,2") from None
    with machine.computing(directory), show.progress(scene.name, len(wanted)) as on_event:
        table = levels(scene, wanted, directory, jobs=jobs, check=check, on_event=on_event)
    if json:
        sys.stdout.write(folder.to_json(table.to_dict("index")))
    else:
        show.levels(table, directory)
    _finish(load_results(directory), directory)


def _print_sensitivities(tables: Sequence[pd.DataFrame], *, json: bool) -> None:
    if json:
        parts = zip(("derivative", "logarithmic"), tables, strict=True)
        sys.stdout.write(folder.to_json({part: table.to_dict("index") for part, table in parts}))
    else:
        show.sensitivities(*tables)


def _finish(results: Sequence[Result], directory: Path) -> None:
    from ffsi.result.evaluation import words

    for result in results:
        if not result.converged:
            show.error(f"{result.reason}; what there is lies in {directory}")
        for note in result.not_evaluated:
            show.error(f"not evaluated: {words(note)}")
    raise typer.Exit(worst([result.failure or _not_evaluated(result) for result in results]))


def _not_evaluated(result: Result) -> str:
    """Return why a result is not whole: a fault of its evaluation, or a full disk or memory."""
    if any(note.get("cause") == "machine" for note in result.not_evaluated):
        return "crash"
    return "not-evaluated" if result.not_evaluated else ""


def _say_how_to_resume(scene: Scene, directory: Path) -> None:
    from ffsi.files.manifest import newest_checkpoint

    with contextlib.suppress(InputError):
        if scene.time is not None and (last := newest_checkpoint(directory)) is not None:
            show.note(f"ffsi run --resume {directory} goes on from t = {last.time:g} s")


def _crash_json(directory: Path, name: str, error: Exception) -> str:
    """Return what the run left behind, unless that is an earlier run's result."""
    path = directory / folder.RESULT
    data = folder.read_json(path) if path.is_file() else {}
    if data.get("failure") != "crash":
        data = {"case": name, "status": "failed", "reason": str(error)}
    return folder.to_json(data)
