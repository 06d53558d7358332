"""One piece of a study: its points in one FreeFEM process, and in another one behind each that fails."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import Result
from ffsi.run.chain import OnResult, run_chain
from ffsi.run.plan import Piece, beyond
from ffsi.scene import Scene

logger = logging.getLogger(__name__)

Stop = threading.Event

_OF_THE_MACHINE = ("killed", "disk-full", "missing-binary", "missing-plugin", "syntax")
"""Kinds of death of a process that the next point would share."""


def run_piece(
    scene: Scene,
    piece: Piece,
    new_folder: Callable[[], Path],
    *,
    check: bool,
    draw: bool = True,
    leads: int = 0,
    on_event: OnEvent | None = None,
    on_result: OnResult | None = None,
    stop: Stop | None = None,
    asked: Sequence[str] = (),
) -> None:
    """Solve points, each from the solution before it; behind one that fails the rest goes on from the one before.

    Behind two that fail one after the other, those straight beyond, on the way from the one before, are not tried.

    Args:
        scene: where all other values come from.
        piece: the points.
        new_folder: returns the folder of the next chain.
        check: verify every point.
        draw: write VTU and pictures of the last solved point of every chain.
        leads: 1 if the first point only leads to the others, and is not reported.
        on_event: as of `run_chain`.
        on_result: called with every Result but those of points that are tried again.
        stop: when set, nothing more is begun.
        asked: as of `run_chain`.
    """
    rest, failed = list(piece), 0
    while len(rest) > leads and not (stop is not None and stop.is_set()):
        waiting: list[Result] = []
        report = partial(_report, leads=leads, waiting=waiting, on_result=on_result)
        results = _run(scene, rest, new_folder(), check, draw, on_event, report, asked)
        bad = next((i for i, result in enumerate(results) if result.failure not in ("", "check")), len(results))
        of_the_machine = bad < len(results) and any(f"({kind})" in results[bad].reason for kind in _OF_THE_MACHINE)
        lead = rest[bad - 1] if bad else None
        again = [] if scene.time is not None or of_the_machine else rest[max(bad + 1, leads) :]
        failed = failed + 1 if bad == leads else 1
        if lead is not None and failed > 1:
            again = [values for values in again if not beyond(values, rest[bad], lead)]
        for result in waiting:
            if on_result is not None and result.point > max(leads, bad + 1) and rest[result.point - 1] not in again:
                on_result(result)
        rest, leads = ([lead, *again], 1) if lead is not None else (again, 0)


def _report(result: Result, *, leads: int, waiting: list[Result], on_result: OnResult | None) -> None:
    """Pass a result on, unless its point begins anew."""
    if result.failure == "not-reached" or (result.failure == "crash" and waiting):
        waiting.append(result)
    elif on_result is not None and result.point > leads:
        on_result(result)
        if result.failure == "crash":
            waiting.append(result)


def _run(
    scene: Scene, piece: Piece, path: Path, check: bool, draw: bool, on_event: OnEvent | None, on_result: OnResult,
    asked: Sequence[str],
) -> list[Result]:  # fmt: skip
    run = partial(
        run_chain, scene, piece, path, check=check, draw="last" if draw else "none", on_event=on_event,
        on_result=on_result, asked=asked,
    )  # fmt: skip
    if not scene.steady and folder.is_run_folder(path):
        try:
            return run(resume=True)
        except InputError as error:  # what lies there cannot be believed
            logger.warning("%s. The point is computed anew", error)
    return run()
