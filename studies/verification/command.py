"""`python -m studies verify` itself: runs all sections, prints and writes their tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from ffsi.cli import show
from studies.harness import Study, has_block
from studies.measurement import Measurement
from studies.verification.benchmarks import BENCHMARKS
from studies.verification.cook import COOK
from studies.verification.elastica import ELASTICA
from studies.verification.flaps import FLAPS
from studies.verification.section import Section, markdown
from studies.verification.sources import COLUMNS

CSV = "verification.csv"
MARKDOWN = "verification.md"
SECTIONS = (BENCHMARKS, COOK, ELASTICA, FLAPS)
EXPLANATION = (
    "Errors are (value - reference) / |reference|. Seconds: all that `ffsi run` does, with check and pictures. "
    "Largest check: the largest relative residual or difference that the independent checker finds."
)
Runs = Sequence[tuple[Section, Sequence[Measurement]]]


def main(
    levels: Sequence[int] | None = None,
    out: Path | None = None,
    readme: Path | None = None,
    sections: Sequence[Section] = SECTIONS,
) -> list[str]:
    """Run every section, print its tables, and write them down.

    Args:
        levels: mesh levels; None: 0 to 4 for FSI1 and the flaps, and 0 to 3 for the others.
    """
    shown = [section for section in sections if readme is not None and has_block(readme, section.block)]
    blocks = [sections[0].block, *(section.block for section in shown)]
    study = Study("verify" + (f" --levels {','.join(map(str, levels))}" if levels else ""), out, readme, blocks)
    done = [(section, _run(section, levels)) for section in sections]
    runs = [run for _, own in done for run in own]
    written = study.written(runs)
    study.write({CSV: lambda: to_frame(runs), MARKDOWN: lambda: document(done, written)})
    said = f"{written} {EXPLANATION}{study.links('All levels', [MARKDOWN])}"
    return study.publish([run.failure for run in runs], brief([pair for pair in done if pair[0] in shown], said))


def _run(section: Section, levels: Sequence[int] | None) -> list[Measurement]:
    runs = section.run(levels)
    for part in section.full(runs):
        if isinstance(part, str):
            show.note(part)
        else:
            part.print()
    return runs


def brief(done: Runs, said: str) -> dict[str, str]:
    """Return the contents of the blocks of docs/results.md; behind its table the first one says who wrote them."""
    blocks: dict[str, str] = {}
    for section, runs in done:
        table, *rest = section.brief(runs)
        blocks[section.block] = markdown([table, *([] if blocks else [said]), *rest])
    return blocks


def document(done: Runs, written: str) -> str:
    """Return `verification.md`: all levels of all sections."""
    parts = ["# Verification", written, EXPLANATION]
    for section, runs in done:
        parts += [f"## {section.title}"] if section.title else []
        parts.append(markdown(section.full(runs)))
    return "\n\n".join(parts) + "\n"


def to_frame(runs: Iterable[Measurement]) -> pd.DataFrame:
    """Return one row per run: sizes, seconds, Newton, and each quantity with its references and relative errors."""
    frame = pd.DataFrame([_row(run) for run in runs])
    parts = ("", "_reference", "_error", "_second_reference", "_second_error")
    values = [name + part for name in COLUMNS for part in parts]
    order = [name for name in frame if name not in values] + [name for name in values if name in frame]
    return frame[order].astype(dict.fromkeys(("unknowns", "triangles", "iterations", "factorizations"), "Int64"))


def _row(run: Measurement) -> dict[str, Any]:
    newton = run.data.get("newton") or {}
    sources = run.compared
    row: dict[str, Any] = {
        "case": run.case,
        "variant": run.variant,
        "level": run.level,
        "status": run.data.get("status"),
        "unknowns": run.data.get("unknowns"),
        "triangles": run.data.get("triangles"),
        "seconds": run.timings.get("total"),
        "script_seconds": run.timings.get("script"),
        "iterations": newton.get("iterations"),
        "factorizations": newton.get("factorizations"),
        "check_maximum": run.check_maximum,
        **{name: source.source for name, source in zip(("source", "second_source"), sources, strict=False)},
        **(run.quantities if not sources else {}),
    }
    for prefix, source in zip(("", "second_"), sources, strict=False):
        for name, error in run.errors(source).items():
            row[name] = run.quantities[name]
            row[f"{name}_{prefix}reference"] = source.values[name]
            row[f"{name}_{prefix}error"] = error
    return row
