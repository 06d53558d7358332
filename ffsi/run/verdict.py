"""The independent checker on a run folder, beside what is shown of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ffsi.scene import Scene

if TYPE_CHECKING:
    from ffsi.reference import CheckReport


def verdict(directory: Path, scene: Scene, point: int) -> CheckReport:
    """Check one point of a run folder, the wall shear stress that is shown of it included (`reference.check_run`)."""
    from ffsi.hemodynamics.walls import shown_stress
    from ffsi.reference import check_run

    return check_run(directory, scene, point=point, shown=shown_stress)
