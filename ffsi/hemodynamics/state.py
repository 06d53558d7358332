"""What one state of an aneurysm comes to: stress along its walls and in them, flow into the dome."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ffsi.fields import Fields
from ffsi.hemodynamics.flow import dome_flow, rates
from ffsi.hemodynamics.parts import over_parts, wall_frame
from ffsi.hemodynamics.stress import effective_stress
from ffsi.hemodynamics.walls import WallPoints, deformed_length, wall_labels, wall_points, wall_shear_stress
from ffsi.rawfiles import RawMesh, RawState
from ffsi.scene import Scene
from ffsi.scene.boundaries import DOME_WALL
from ffsi.scene.geometry import Aneurysm

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class AneurysmState:
    """One state of an aneurysm.

    Attributes:
        scene: the scene; its geometry is an aneurysm.
        mesh: the reference mesh.
        state: the unknowns.
        fields: the same unknowns as fields.
    """

    scene: Scene
    mesh: RawMesh
    state: RawState
    fields: Fields

    @property
    def geometry(self) -> Aneurysm:
        """The aneurysm."""
        assert isinstance(self.scene.geometry, Aneurysm)
        return self.scene.geometry

    @cached_property
    def points(self) -> WallPoints:
        """The points of all walls."""
        return wall_points(self.mesh, wall_labels(self.scene))

    @cached_property
    def wall_shear_stress(self) -> Floats:
        """Shear stress of the fluid on its walls at their points, (n, 2) Pa."""
        assert self.scene.fluid is not None
        return wall_shear_stress(self.points, self.state, self.scene.fluid)

    @cached_property
    def effective_stress(self) -> dict[str, Floats]:
        """Effective stress of each wall at the P2 nodes, (n2,) Pa, NaN outside of it."""
        return effective_stress(self.scene, self.mesh, self.state)

    @property
    def wall(self) -> pd.DataFrame:
        """The walls as a table: `line`, `arc` (m), `x`, `y` (m), `part`, `wss_x`, `wss_y`, `wss`, `pressure` (Pa)."""
        points, tau = self.points, self.wall_shear_stress
        return wall_frame(self.scene, points).assign(
            wss_x=tau[:, 0], wss_y=tau[:, 1], wss=np.hypot(*tau.T), pressure=self.fields.pressure[points.middle]
        )

    @property
    def quantities(self) -> dict[str, float]:
        """Flow rates, wall shear stress by part, largest effective stress, flow into the dome; in SI."""
        found = rates(self.mesh, self.state)
        size = np.hypot(*self.wall_shear_stress.T)
        for part, values in over_parts(self.geometry, self.points, size, self._lengths).items():
            found |= {f"wss_{what}_{part}": value for what, value in values.items()}
        flow = dome_flow(self.geometry, self.mesh, self.state, self.fields)
        found |= {"dome_inflow": flow.inflow, "dome_area": flow.area}
        if np.isfinite(flow.turnover_time):
            found["turnover_time"] = flow.turnover_time
        if self.scene.solid:
            away = ~near_corners(self.geometry, self.mesh.p2_coordinates)
            largest = {name: float(np.nanmax(values[away])) for name, values in self.effective_stress.items()}
            found["effective_stress_max"] = max(largest.values())
            found |= {f"effective_stress_max_{name}": value for name, value in largest.items()}
            dome = self.state.u[self.points.middle[self.points.label == DOME_WALL]]
            found["dome_displacement_max"] = float(np.hypot(*dome.T).max())
        return found

    @property
    def point_data(self) -> dict[str, Floats]:
        """Fields for ParaView: `wall_shear_stress` (n2, 2) Pa, zero off the walls, and `effective_stress` (n2,) Pa."""
        points, tau = self.points, self.wall_shear_stress
        nodal = np.zeros((self.mesh.n_p2, 2))
        nodal[points.middle] = tau
        count = np.bincount(points.ends.ravel(), minlength=self.mesh.n_p2)
        for axis in (0, 1):  # at a vertex the mean of its two edges
            total = np.bincount(points.ends.ravel(), weights=np.repeat(tau[:, axis], 2), minlength=self.mesh.n_p2)
            nodal[count > 0, axis] = (total / np.maximum(count, 1))[count > 0]
        found = {"wall_shear_stress": nodal}
        if self.scene.solid:
            found["effective_stress"] = np.nan_to_num(np.fmax.reduce(list(self.effective_stress.values())))
        return found

    @cached_property
    def _lengths(self) -> Floats:
        return deformed_length(self.points, self.state)


def near_corners(geometry: Aneurysm, position: Floats) -> NDArray[np.bool_]:
    """Return which reference points (n, 2) are nearer to a corner than twice the vessel's wall is thick.

    Corners are the clamped end faces, the neck's ends and where the dome's wall meets the vessel's: there the stress is
    singular.
    """
    radius = 2 * geometry.wall_thickness
    near = (-position[:, 0] < radius) | (position[:, 1] < radius)
    for corner in geometry.corners:
        near |= np.hypot(*(position - np.array(corner)).T) < radius
    return np.asarray(near)
