"""One scene on several meshes: what every quantity tends to, and how far the finest value is off."""

from __future__ import annotations

import numbers
from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from ffsi.files import folder
from ffsi.files.arguments import path_of
from ffsi.files.errors import InputError
from ffsi.freefem.events import OnEvent
from ffsi.hemodynamics.result import load_results
from ffsi.result import refinement
from ffsi.run.sweep import sweep
from ffsi.scene import Scene

TABLE = "levels.csv"


def levels(
    scene: Scene | str | Path,
    levels: Iterable[int],
    out: str | Path,
    *,
    jobs: int | None = None,
    check: bool = True,
    on_event: OnEvent | None = None,
) -> pd.DataFrame:
    """Solve a scene, steady or in time, on at least three levels of its mesh, as a sweep over `mesh.level` in `out`.

    Args:
        scene: as of `sweep`, and so are `out`, `jobs`, `check` and `on_event`.
        levels: of the mesh, from coarse to fine.

    Returns:
        One row per quantity, also in `out/levels.csv`: its value on every level, `order`, `extrapolated` and `error`,
        an error bar of the finest value (`ffsi.result.refinement.Refinement`; NaN without an order). Empty unless every
        level was solved.

    Raises:
        InputError: fewer than three levels, or not from coarse to fine; and as `sweep`.
    """
    accepted = "accepted: at least three levels from coarse to fine, such as 0,1,2"
    given = [*levels] if isinstance(levels, Iterable) and not isinstance(levels, str | Mapping) else []
    if len(given) < 3 or not all(isinstance(each, numbers.Real) for each in given) or given != sorted(set(given)):
        raise InputError(f"levels = {','.join(map(str, given)) or repr(levels)}: {accepted}")
    directory = path_of(out, "out")
    sweep(scene, {"mesh.level": given}, directory, jobs=jobs, check=check, on_event=on_event)
    found = refinement.of_results(load_results(directory))
    known = found[2] if found is not None and len(found[0]) == len(given) else {}
    heads = [f"level {level}" for level in given]
    rows = {name: [*item.values, item.order, item.limit, item.bar] for name, item in known.items()}
    table = pd.DataFrame.from_dict(
        rows, orient="index", columns=[*heads, "order", "extrapolated", "error"], dtype=float
    )
    table.index.name = "quantity"
    folder.write_text(directory / TABLE, table.to_csv())
    return table
