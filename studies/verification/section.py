"""A part of the verification: what runs, and what is shown of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from studies.measurement import Measurement
from studies.tables import TextTable

Part = str | TextTable


@dataclass(frozen=True)
class Section:
    """Runs and their tables.

    Attributes:
        block: name of its block in docs/results.md.
        title: heading in `verification.md`; empty for the first section.
        run: runs everything on the given mesh levels, None: on the usual ones.
        full: tables and texts of all runs.
        brief: what docs/results.md shows of them.
    """

    block: str
    title: str
    run: Callable[[Sequence[int] | None], list[Measurement]]
    full: Callable[[Sequence[Measurement]], list[Part]]
    brief: Callable[[Sequence[Measurement]], list[Part]]


def markdown(parts: Iterable[Part]) -> str:
    """Return tables and texts in Markdown."""
    return "\n\n".join(part if isinstance(part, str) else part.markdown() for part in parts)


def by_variant(runs: Iterable[Measurement]) -> dict[tuple[str, str], list[Measurement]]:
    """Return the runs of each case and variant, in the order of their levels."""
    groups: dict[tuple[str, str], list[Measurement]] = {}
    for run in runs:
        groups.setdefault((run.case, run.variant), []).append(run)
    return {key: sorted(group, key=lambda run: run.level) for key, group in groups.items()}
