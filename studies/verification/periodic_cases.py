"""The catalogue's cases in time that have published values: what runs, what is compared, and how exact it must be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ffsi.result.published import references
from ffsi.scene import CASES, Scene, load_scene

LARGEST = 40_000
"""Unknowns, at most, of the meshes that the bounds are meant for."""
PLAIN = ("output.pictures=false", "output.vtu=false")


@dataclass(frozen=True)
class Compared:
    """A number of a periodic quantity, beside its published value.

    Attributes:
        quantity: as in `result.json`.
        part: `mean`, `amplitude`, `frequency`, `maximum` or `peak-to-peak`, all over the last period.
        bound: largest accepted relative error, dimensionless.
        title: heading of its column.
    """

    quantity: str
    part: str
    bound: float
    title: str

    @property
    def name(self) -> str:
        """Name of its columns in the CSV."""
        return f"{self.quantity}_{self.part.replace('-', '_')}"

    def value(self, quantities: Mapping[str, Any]) -> float:
        """Return the number from the quantities of a run (SI); NaN if the run has no period."""
        parts = quantities.get(self.quantity)
        return self._of(parts) if isinstance(parts, Mapping) else math.nan

    def published(self, case: str) -> float:
        """Return the published number, SI.

        Raises:
            KeyError: there is none.
        """
        return self._of(vars(references(case)[self.quantity]))

    def error(self, case: str, quantities: Mapping[str, Any]) -> float:
        """Return (value - published) / |published|; NaN if the run has no period."""
        published = self.published(case)
        return (self.value(quantities) - published) / abs(published)

    def _of(self, parts: Mapping[str, Any]) -> float:
        mean, amplitude, frequency = (
            math.nan if parts.get(name) is None else float(parts[name]) for name in ("mean", "amplitude", "frequency")
        )
        return {
            "mean": mean, "amplitude": amplitude, "frequency": frequency, "maximum": mean + amplitude,
            "peak-to-peak": 2 * amplitude,
        }[self.part]  # fmt: skip


@dataclass(frozen=True)
class PeriodicCase:
    """A case of the catalogue that is run until it is periodic, on several meshes and with several time steps.

    Attributes:
        name: of the case.
        compared: what is compared.
        coarser: the meshes, as levels below the catalogue's.
        parts: the time steps, as parts of the catalogue's.
    """

    name: str
    compared: tuple[Compared, ...]
    coarser: tuple[int, ...] = (0, 1)
    parts: tuple[float, ...] = (1.0, 2.0)

    @property
    def runs(self) -> list[PeriodicRun]:
        """Every mesh with every time step, those of the catalogue first."""
        scene = CASES[self.name]
        assert scene.time is not None
        levels = [scene.mesh.level - down for down in self.coarser if scene.mesh.level >= down]
        return [PeriodicRun(self, level, scene.time.step * part) for level in levels for part in self.parts]


@dataclass(frozen=True)
class PeriodicRun:
    """One run: mesh level and time step (s)."""

    case: PeriodicCase
    level: int
    step: float

    @property
    def name(self) -> str:
        """Name in notes, and of the run folder."""
        return f"{self.case.name}-level-{self.level}-step-{self.step:g}"

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return load_scene(self.case.name, [f"mesh.level={self.level}", f"time.step={self.step!r}", *PLAIN])

    @property
    def is_default(self) -> bool:
        """Whether mesh and time step are those of the catalogue."""
        scene = CASES[self.case.name]
        return scene.time is not None and (self.level, self.step) == (scene.mesh.level, scene.time.step)


def _beam(ux: float, uy: float, drag: float, lift: float, frequency: float) -> tuple[Compared, ...]:
    """Return what is compared of a beam in a flow: bounds of the amplitudes, of the drag that of the mean."""
    return (
        Compared("tip_uy", "amplitude", uy, "u_y amplitude"),
        Compared("tip_ux", "amplitude", ux, "u_x amplitude"),
        Compared("drag", "mean", drag, "drag mean"),
        Compared("lift", "amplitude", lift, "lift amplitude"),
        Compared("tip_uy", "frequency", frequency, "frequency"),
    )


PERIODIC_CASES = (
    PeriodicCase(
        "turek-cfd3",
        (
            Compared("drag", "mean", 0.5e-2, "drag mean"),
            Compared("drag", "amplitude", 3e-2, "drag amplitude"),
            Compared("lift", "amplitude", 1.5e-2, "lift amplitude"),
            Compared("lift", "frequency", 1e-2, "frequency"),
        ),
    ),
    PeriodicCase(
        "turek-csm3",
        (
            *(
                Compared(f"tip_{name}", part, 1.5e-2, f"u_{name[1]} {part}")
                for name in ("ux", "uy")
                for part in ("mean", "amplitude")
            ),
            Compared("tip_uy", "frequency", 0.5e-2, "frequency"),
        ),
    ),
    PeriodicCase("turek-fsi2", _beam(ux=4e-2, uy=2e-2, drag=1.5e-2, lift=5e-2, frequency=1.5e-2)),
    PeriodicCase("turek-fsi3", _beam(ux=6e-2, uy=3e-2, drag=1e-2, lift=8e-2, frequency=1.5e-2)),
    PeriodicCase(
        "cylinder-2d2",
        (
            Compared("drag_coefficient", "maximum", 0.5e-2, "drag maximum"),
            Compared("lift_coefficient", "peak-to-peak", 1e-2, "lift peak to peak"),
            # f D/U: its relative error is that of the frequency.
            Compared("lift_coefficient", "frequency", 0.7e-2, "Strouhal number"),
        ),
    ),
)
