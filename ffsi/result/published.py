"""Published values of the benchmark cases (ffsi/data/turek_hron.csv; its sources are named in ffsi/data/README.md)."""

from __future__ import annotations

import csv
import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from ffsi.scene import CASES, Scene, load_scene

# What may differ from the catalogue's case without changing its exact solution.
_NUMERICAL = {"time", "mesh", "mesh_motion", "solver", "output", "title", "description"}


@dataclass(frozen=True)
class Reference:
    """A published value: `mean` in `unit`, and for periodic quantities its amplitude (`unit`) and frequency (Hz).

    None where nothing was published.
    """

    quantity: str
    mean: float | None
    amplitude: float | None
    frequency: float | None
    unit: str
    source: str

    def relative_error(self, value: float) -> float:
        """Return (value - mean) / |mean|; NaN without a published mean."""
        return math.nan if self.mean is None else (value - self.mean) / abs(self.mean)


@cache
def _table() -> dict[str, dict[str, Reference]]:
    table: dict[str, dict[str, Reference]] = {}
    text = files("ffsi").joinpath("data/turek_hron.csv").read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        mean, amplitude, frequency = (float(row[it]) if row[it] else None for it in ("mean", "amplitude", "frequency"))
        reference = Reference(row["quantity"], mean, amplitude, frequency, row["unit"], row["source"])
        table.setdefault(row["case"], {})[reference.quantity] = reference
    return table


def references(case: str) -> dict[str, Reference]:
    """Return the published values of a case by quantity; empty if there are none."""
    return dict(_table().get(case, {}))


def references_for(scene: Scene) -> dict[str, Reference]:
    """Return the published values that `scene` can be compared with: none if a physical parameter was changed."""
    found = references(scene.name) if scene.name in CASES else {}
    return found if found and _physical(scene) == _physical(load_scene(scene.name, [])) else {}


def _physical(scene: Scene) -> dict[str, object]:
    return {key: value for key, value in tomllib.loads(scene.to_toml()).items() if key not in _NUMERICAL}
