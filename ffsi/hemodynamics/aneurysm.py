"""What one state of an aneurysm comes to beside its walls: stress in them, flow into the dome."""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ffsi.hemodynamics.flow import dome_flow
from ffsi.hemodynamics.state import WallState
from ffsi.hemodynamics.stress import effective_stress, largest_beyond
from ffsi.scene.boundaries import DOME_WALL
from ffsi.scene.geometry import Aneurysm

Floats = NDArray[np.float64]


class AneurysmState(WallState):
    """One state of an aneurysm; the scene's geometry is one."""

    @property
    def geometry(self) -> Aneurysm:
        """The aneurysm."""
        assert isinstance(self.scene.geometry, Aneurysm)
        return self.scene.geometry

    @cached_property
    def effective_stress(self) -> dict[str, Floats]:
        """Effective stress of each wall at the P2 nodes, (n2,) Pa, NaN outside of it."""
        return effective_stress(self.scene, self.mesh, self.state)

    @property
    def quantities(self) -> dict[str, float]:
        """Those of every flow with walls, largest effective stress, flow into the dome; in SI."""
        found = super().quantities
        flow = dome_flow(self.mesh, self.state, self.fields)
        found |= {"dome_inflow": flow.inflow, "dome_area": flow.area}
        if np.isfinite(flow.turnover_time):
            found["turnover_time"] = flow.turnover_time
        if self.scene.solid:
            largest = {
                name: largest_beyond(self.mesh, values, partial(beyond_corners, self.geometry))
                for name, values in self.effective_stress.items()
            }
            found["effective_stress_max"] = max(largest.values())
            found |= {f"effective_stress_max_{name}": value for name, value in largest.items()}
            dome = self.state.u[self.points.middle[self.points.label == DOME_WALL]]
            found["dome_displacement_max"] = float(np.hypot(*dome.T).max())
        return found

    @property
    def point_data(self) -> dict[str, Floats]:
        """Those of every flow with walls and, with elastic ones, `effective_stress` (n2,) Pa, zero outside of them."""
        found = super().point_data
        if self.scene.solid:
            found["effective_stress"] = np.nan_to_num(np.fmax.reduce(list(self.effective_stress.values())))
        return found


def beyond_corners(geometry: Aneurysm, position: Floats) -> Floats:
    """Return how much farther than twice the thickness of the vessel's wall reference points (..., 2) are from corners.

    Corners are the clamped end faces, the neck's ends and where the dome's wall meets the vessel's: there the stress is
    singular.
    """
    x, y = np.moveaxis(position, -1, 0)
    distances = [-x, y, *(np.hypot(x - corner[0], y - corner[1]) for corner in geometry.corners)]
    return np.asarray(np.min(distances, axis=0) - 2 * geometry.wall_thickness)
