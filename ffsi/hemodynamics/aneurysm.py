"""What one state of an aneurysm comes to beside its walls: stress in them, flow into the dome."""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np

from ffsi.files.arrays import Floats
from ffsi.hemodynamics.flow import dome_flow
from ffsi.hemodynamics.state import WallState
from ffsi.hemodynamics.stress import effective_stress, largest_beyond
from ffsi.result.evaluation import Evaluations
from ffsi.result.fields import FLUID
from ffsi.scene.boundaries import DOME_WALL
from ffsi.scene.geometry import Aneurysm


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
    def evaluations(self) -> Evaluations[float]:
        """Those of every flow with walls, flow into the dome, largest effective stress, displacement; in SI."""
        found = super().evaluations | {"flow into the dome": self._dome_flow}
        if self.scene.solid:
            found["largest effective stress"] = self._largest_stress
            found["displacement of the dome"] = self._dome_displacement
        return found

    def _dome_flow(self) -> dict[str, float]:
        return dome_flow(self.mesh, self.state, self.fields)

    def _largest_stress(self) -> dict[str, float]:
        beyond = partial(beyond_corners, self.geometry)
        largest = {
            name: largest_beyond(self.mesh, self.mesh.region == region, values, beyond)
            for region, (name, values) in enumerate(self.effective_stress.items(), start=FLUID + 1)
        }
        found = {"effective_stress_max": float(np.max(list(largest.values())))}  # unlike max(), it passes a NaN on
        return found | {f"effective_stress_max_{name}": value for name, value in largest.items()}

    def _dome_displacement(self) -> dict[str, float]:
        dome = self.state.u[self.points.middle[self.points.label == DOME_WALL]]
        return {"dome_displacement_max": float(np.hypot(*dome.T).max())}

    @property
    def field_evaluations(self) -> Evaluations[Floats]:
        """Those of every flow with walls and, with elastic ones, `effective_stress` (n2,) Pa, zero outside of them."""
        found = super().field_evaluations
        return found | {"field of the effective stress": self._stress_at_nodes} if self.scene.solid else found

    def _stress_at_nodes(self) -> dict[str, Floats]:
        """Effective stress of all walls, at a node of two of them the larger one; NaN within them stays a gap."""
        values = np.zeros(self.mesh.n_p2)
        for region, stress in enumerate(self.effective_stress.values(), start=FLUID + 1):
            nodes = np.unique(self.mesh.p2[self.mesh.region == region])
            values[nodes] = np.maximum(values[nodes], stress[nodes])
        return {"effective_stress": values}


def beyond_corners(geometry: Aneurysm, position: Floats) -> Floats:
    """Return how much farther than twice the thickness of the vessel's wall reference points (..., 2) are from corners.

    Corners are the clamped end faces, the neck's ends and where the dome's wall meets the vessel's: there the stress is
    singular.
    """
    x, y = np.moveaxis(position, -1, 0)
    distances = [-x, y, *(np.hypot(x - corner[0], y - corner[1]) for corner in geometry.corners)]
    return np.asarray(np.min(distances, axis=0) - 2 * geometry.wall_thickness)
