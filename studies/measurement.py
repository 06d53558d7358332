"""One run of a case on one mesh level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ffsi.result.quantities import check_maximum
from ffsi.scene import load_scene
from studies.harness import solved
from studies.tables import number
from studies.verification.sources import COLUMNS, ReferenceSet, reference_sets


@dataclass(frozen=True)
class Variant:
    """A catalogue case with other settings.

    Attributes:
        case: name of the case.
        name: short name of the variant; empty for the case itself.
        text: what tables call it.
        settings: `KEY=VALUE`, as after `--set`.
    """

    case: str
    name: str = ""
    text: str = ""
    settings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measurement:
    """One run of a case on one mesh level; `data` is the content of its `result.json`."""

    case: str
    level: int
    data: Mapping[str, Any]
    variant: str = ""

    @property
    def failure(self) -> str:
        """Empty, or why there is nothing to compare: as `Result.failure`."""
        return str(self.data.get("failure", ""))

    @property
    def quantities(self) -> dict[str, float]:
        """Quantities (SI) that have a column in the tables."""
        return {name: value for name, value in (self.data.get("quantities") or {}).items() if name in COLUMNS}

    @property
    def timings(self) -> dict[str, float]:
        """Seconds by phase."""
        return dict(self.data.get("timings") or {})

    @property
    def seconds(self) -> str:
        """Seconds of the whole run as text, or that it failed."""
        return number(self.timings.get("total")) if not self.failure else f"failed ({self.failure})"

    @property
    def unknowns(self) -> str:
        """Number of unknowns as text."""
        return number(self.data.get("unknowns"), "{:d}")

    @property
    def check_maximum(self) -> float:
        """Largest number of the reference checker (relative residuals and differences); NaN if it did not run."""
        return check_maximum(self.data)

    @property
    def compared(self) -> list[ReferenceSet]:
        """Sources that the errors are taken against."""
        return [source for source in reference_sets(self.case, self.variant) if source.compared]

    def value(self, quantity: str) -> float:
        """Return a quantity (SI); NaN if a failed or other run does not have it."""
        return float("nan") if self.failure else self.quantities.get(quantity, float("nan"))

    def errors(self, source: ReferenceSet) -> dict[str, float]:
        """Return the relative error of each quantity that `source` has."""
        return {name: source.error(name, self.quantities[name]) for name in source.values if name in self.quantities}


def measure(case: str, level: int, variant: Variant | None = None) -> Measurement:
    """Run and check a catalogue case on one mesh level, with one thread and in a temporary folder.

    A process that dies is a Measurement with the failure `crash`.

    Args:
        case: name of the case.
        level: mesh level, 0 to 4.
        variant: of this case; None for the case itself.

    Raises:
        FreeFEMNotFound: no FreeFEM on this machine.
    """
    variant = variant or Variant(case)
    name = f"{case} {variant.name} level {level}".replace("  ", " ")
    scene = load_scene(case, [*variant.settings, f"mesh.level={level}"])
    return Measurement(case, level, solved(scene, name), variant.name)


def measure_all(variants: Sequence[Variant], levels: Sequence[int]) -> list[Measurement]:
    """Run several variants, each on every level."""
    return [measure(variant.case, level, variant) for variant in variants for level in levels]
