"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ffsi.files.errors import InputError

Case = Annotated[
    str, typer.Argument(metavar="CASE|scene.toml", help="A case of `ffsi cases`, or a scene file.", show_default=False)
]
OptionalCase = Annotated[
    str | None,
    typer.Argument(metavar="CASE|scene.toml", help="A case of `ffsi cases`, or a scene file.", show_default=False),
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value of the scene, or remove it with KEY=none; repeatable.",
        show_default=False,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout, and nothing else there.")]


def check_output(path: Path) -> None:
    """Refuse a file that cannot be written, before anything is computed. Raises ``InputError``."""
    if path.is_dir():
        raise InputError(f"{path} is a folder; -o takes the name of a file")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent} does not exist; make that folder first")
