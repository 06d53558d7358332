"""What one state of a flow comes to along its walls: shear stress, pressure, flow rates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ffsi.files.arrays import Floats, RawMesh, RawState
from ffsi.hemodynamics.flow import rates
from ffsi.hemodynamics.parts import over_parts, wall_frame
from ffsi.hemodynamics.walls import WallPoints, at_nodes, deformed_length, wall_labels, wall_points, wall_shear_stress
from ffsi.result.evaluation import Evaluations
from ffsi.result.fields import Fields
from ffsi.scene import Scene, boundaries
from ffsi.scene.geometry import Aneurysm, Channel, MeshGeometry

if TYPE_CHECKING:
    import pandas as pd

VESSELS = (Aneurysm, Channel, MeshGeometry)
"""Geometries whose walls are reported; others have forces on bodies."""


def reports_walls(scene: Scene) -> bool:
    """Return whether the states of a scene are reported along their walls: a fluid with walls in a vessel."""
    return scene.fluid is not None and isinstance(scene.geometry, VESSELS) and bool(wall_labels(scene))


@dataclass(frozen=True)
class WallState:
    """One state of a flow with walls, in a scene with a fluid; `fields` are the unknowns of the `state` as fields."""

    scene: Scene
    mesh: RawMesh
    state: RawState
    fields: Fields

    @cached_property
    def points(self) -> WallPoints:
        """The points of all walls."""
        return wall_points(self.mesh, wall_labels(self.scene))

    @cached_property
    def wall_shear_stress(self) -> Floats:
        """Shear stress of the fluid on its walls at their points, (n, 2) Pa."""
        assert self.scene.fluid is not None
        return wall_shear_stress(self.points, self.state, self.scene.fluid)

    @property
    def wall(self) -> pd.DataFrame:
        """The walls as a table: `line`, `arc` (m), `x`, `y` (m), `part`, `wss_x`, `wss_y`, `wss`, `pressure` (Pa)."""
        points, tau = self.points, self.wall_shear_stress
        return wall_frame(self.scene, points).assign(
            wss_x=tau[:, 0], wss_y=tau[:, 1], wss=np.hypot(*tau.T), pressure=self.fields.pressure[points.middle]
        )

    @property
    def evaluations(self) -> Evaluations[float]:
        """What `quantities` consists of, by what it is in words: one that fails takes no other with it."""
        return {"flow rates": self._flow_rates, "wall shear stress by part": self._stress_by_part}

    def _flow_rates(self) -> dict[str, float]:
        assert self.scene.fluid is not None
        sides = [side for side in boundaries(self.scene) if side.role in ("inlet", "outlet")]
        inlets = [side.label for side in sides if side.role == "inlet" or side.opening in self.scene.inlet]
        outlets = [side.label for side in sides if side.label not in inlets]
        return rates(self.mesh, self.state, float(self.scene.fluid.apparent_viscosity(np.zeros(1))[0]), inlets, outlets)

    def _stress_by_part(self) -> dict[str, float]:
        size = np.hypot(*self.wall_shear_stress.T)
        parts = over_parts(self.scene, self.points, size, deformed_length(self.points, self.state))
        return {f"wss_{what}_{part}": value for part, values in parts.items() for what, value in values.items()}

    @property
    def quantities(self) -> dict[str, float]:
        """Flow rates and their balance, wall shear stress by part; in SI."""
        return {name: value for evaluate in self.evaluations.values() for name, value in evaluate().items()}

    @property
    def field_evaluations(self) -> Evaluations[Floats]:
        """What `point_data` consists of, likewise."""
        return {"field of the wall shear stress": self._stress_at_walls}

    def _stress_at_walls(self) -> dict[str, Floats]:
        return {"wall_shear_stress": at_nodes(self.points, self.wall_shear_stress, self.mesh.n_p2)}

    @property
    def point_data(self) -> dict[str, Floats]:
        """Fields for ParaView: `wall_shear_stress` (n2, 2) Pa, NaN off the walls."""
        return {name: value for evaluate in self.field_evaluations.values() for name, value in evaluate().items()}
