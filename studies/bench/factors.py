"""What each part of the method is worth alone: FSI1 with and without it, seconds and error, the script as a process."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from ffsi.files import folder
from ffsi.files.errors import InputError
from ffsi.freefem import find_freefem
from ffsi.scene import load_scene
from ffsi.script.render import render
from studies.bench.speed import FSI1, Task, Values, alternating, error_columns, reference, row, script
from studies.harness import Place, Study, repeated
from studies.tables import columns, table

LEVELS = (2, 4)
WHOLE = "as it is"
_EVEN = tuple(f"mesh.{name}_size=0.049" for name in ("far", "body", "corner"))  # about as many triangles


class Factor(NamedTuple):
    """A run without a part of the method: by settings of the scene, or by text of the script, each found once."""

    name: str
    settings: Sequence[str] = ()
    replaced: Mapping[str, str] = {}


_TRIVIAL = {
    "into = [jacobianRow, jacobianColumn, value];": (
        "int m = value.n, k = nDof-active.n-splitMesh*int(meshRow.sum);"
        "int[int] rows = jacobianRow, places = jacobianColumn; rows.resize(m+k); places.resize(m+k); value.resize(m+k);"
        "for (int i = 0; i < k; ++i) { rows[m+i] = active.n+i; places[m+i] = active.n+i; value[m+i] = 1; }"
        "into = [rows, places, value];"
    ),
    "real[int] inside = jacobianMatrix^-1*rightHandSide;": (
        "rightHandSide.resize(jacobianMatrix.n); rightHandSide(active.n:rightHandSide.n-1) = 0;"
        "real[int] inside = jacobianMatrix^-1*rightHandSide; inside.resize(active.n);"
    ),
}
# What is left out, one by one.
FACTORS = (
    Factor(WHOLE),
    Factor("curved edges", replaced={"{ bendX = BendX(0, Vh, tgv=1); bendY = BendY(0, Vh, tgv=1); }": ";"}),
    Factor("graded mesh", _EVEN),
    Factor("coarse to fine", ("solver.start=rest",)),
    Factor("kept factors", ("solver.reuse_ratio=0",)),
    Factor("mesh split off", replaced={"wholeJacobian = (fromRest || solverReuseRatio == 0);": "wholeJacobian = 1;"}),
    Factor("trivial rows left out", replaced=_TRIVIAL),
    Factor("MUMPS, but UMFPACK", ("solver.linear_solver=umfpack",)),
    Factor("harmonic mesh motion, but hyperelastic", ("mesh_motion.kind=hyperelastic",)),
)


def text_of(factor: Factor, level: int) -> str:
    """Return the script of FSI1 without a part."""
    settings = [f"mesh.level={level}", *factor.settings]
    text = render(load_scene(FSI1.case, settings), mumps=find_freefem().has_mumps)
    for old, new in factor.replaced.items():
        if text.count(old) != 1:
            raise InputError(f"bench --factors: {factor.name}: the script has {text.count(old)} times {old}")
        text = text.replace(old, new)
    return text


def _run(text: str) -> tuple[float, Values]:
    with tempfile.TemporaryDirectory(prefix="ffsi-bench-") as place:
        folder.write_text(Path(place) / "case.edp", text)
        return script(Path(place) / "case.edp", [])


def main(*, repeat: int = 1, out: Place = None, readme: Place = None) -> list[str]:
    """Run FSI1 with all parts and without each, alternating, and print what they cost and how wrong they are."""
    study = Study(repeated("bench --factors", repeat), out, readme, "factors")
    tasks: dict[tuple[str, Any], Task] = {
        (factor.name, level): partial(_run, text_of(factor, level)) for level in LEVELS for factor in FACTORS
    }
    found, source = alternating(tasks, repeat), reference(FSI1, {})
    rows = [row(item, source, FSI1.quantities, without=key[0], level=key[1]) for key, item in found.items()]
    for line in rows:
        whole = next(x for x in rows if x["without"] == WHOLE and x["level"] == line["level"])
        line["ratio"] = line["seconds"] / whole["seconds"]
    shown = table(rows, COLUMNS, left=1, title="FSI1 without")
    return study.finish(found.values(), [shown], {"factors.csv": lambda: pd.DataFrame(rows)}, table=shown)


COLUMNS = (*columns("without | level | of the whole's seconds = ratio :.2f"), *error_columns(FSI1.quantities))
