"""Steady flow of blood in a plane channel, beside the exact flow of each viscosity law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ffsi.files import folder
from ffsi.files.arrays import read_mesh, read_state
from ffsi.hemodynamics.result import Result
from ffsi.hemodynamics.walls import wall_labels, wall_points, wall_shear_stress
from ffsi.scene import Scene
from studies.verification.measured import Measured, worst
from studies.verification.plane_channel import PlaneFlow, plane_flow

HALF_HEIGHT, LENGTH = 1e-3, 13e-3
# Rows from 35 micrometres at the walls, where the stress is largest, to 70 in the middle, where a Carreau fluid has its
# thick core.
MESH = {"level": 0, "body_size": 3.5e-5, "growth": 0.04, "far_size": 0.9e-3}
_MIDDLE = 0.4, 0.6  # part of the length; ahead of it the inlet is felt, behind it the outlet
_SAMPLES = 9


@dataclass(frozen=True)
class PlaneCase:
    """The flow of a fluid, given by its table in a scene, that a pressure gradient in Pa/m drives."""

    name: str
    fluid: Mapping[str, Any]
    gradient: float
    group = "plane"
    level = 0

    @property
    def folder(self) -> str:
        """Name of the run folder."""
        return f"plane-{self.name.lower().replace(' ', '-')}-{self.gradient:g}"

    @property
    def labels(self) -> tuple[str, ...]:
        """Fluid and pressure gradient."""
        return self.name, f"{self.gradient:g}"

    @cached_property
    def exact(self) -> PlaneFlow:
        """The flow."""
        return plane_flow(self._scene({"mean_velocity": 1.0}).fluid, self.gradient, HALF_HEIGHT)  # type: ignore[arg-type]

    @property
    def scene(self) -> Scene:
        """What is solved: the mean velocity is given, and a power of the distance from the middle as profile.

        It has the exact ratio of largest and mean velocity, so that a short vessel is enough to leave the inlet behind.
        """
        exact = self.exact
        power = float(f"{1 / (exact.largest / exact.mean - 1):.4g}")
        profile = f"{(power + 1) / power:.15g} * (1 - abs(2 * y / H - 1)^{power})"
        return self._scene({"mean_velocity": exact.mean, "profile": profile})

    def measure(self, result: Result) -> dict[str, Measured]:
        """Return pressure gradient (Pa/m), and where they are farthest off largest velocity and wall shear stress."""
        x = np.linspace(*_MIDDLE, _SAMPLES) * LENGTH
        found = result.sample(np.column_stack([x, np.full_like(x, HALF_HEIGHT)]))
        mesh = read_mesh(result.directory / folder.MESH)
        points = wall_points(mesh, wall_labels(result.scene))
        state = read_state(result.directory / str(result.state_file), mesh)
        assert result.scene.fluid is not None
        wall = np.hypot(*wall_shear_stress(points, state, result.scene.fluid).T)
        place = points.position[:, 0] / LENGTH
        return {
            "mean": Measured(self.exact.mean),
            "gradient": Measured(-float(np.polyfit(x, found["p"], 1)[0]), self.gradient),
            "largest": worst(found["vx"].to_numpy(), self.exact.largest),
            "wall_shear_stress": worst(wall[(place > _MIDDLE[0]) & (place < _MIDDLE[1])], self.exact.wall_shear_stress),
        }

    def _scene(self, inflow: Mapping[str, Any]) -> Scene:
        return Scene.model_validate({
            "name": self.folder,
            "geometry": {"kind": "channel", "length": LENGTH, "height": 2 * HALF_HEIGHT},
            "mesh": MESH,
            "fluid": self.fluid,
            "inflow": inflow,
            "outlet": {"kind": "do-nothing"},
            "output": {"pictures": False, "vtu": False},
        })  # fmt: skip


_DENSITY = {"density": 1035.0}
_CARREAU = {"law": "carreau"} | _DENSITY
PLANE_CASES = (
    PlaneCase("Newtonian", {"law": "newtonian", "viscosity": 3.5e-3} | _DENSITY, 100.0),
    *(PlaneCase("Carreau", _CARREAU, gradient) for gradient in (10.0, 100.0, 1000.0)),
    PlaneCase("power law", {"law": "power-law", "consistency": 0.0147, "exponent": 0.7755} | _DENSITY, 100.0),
    PlaneCase("Casson", {"law": "casson", "yield_stress": 0.005, "viscosity_infinity": 0.0035} | _DENSITY, 500.0),
)
