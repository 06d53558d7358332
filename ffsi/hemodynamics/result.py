"""A finished run with what its walls bear: shear stress, its indices over cycles, flow into a dome."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ffsi.files.arguments import count_of, path_of
from ffsi.files.arrays import Floats, read_state
from ffsi.files.cycles import read_cycles
from ffsi.files.errors import InputError
from ffsi.hemodynamics import cycles
from ffsi.hemodynamics.aneurysm import AneurysmState
from ffsi.hemodynamics.state import WallState, reports_walls
from ffsi.result.evaluation import Evaluations
from ffsi.result.result import PlainResult
from ffsi.scene import Aneurysm

if TYPE_CHECKING:
    import pandas as pd


class Result(PlainResult):
    """One solved (or failed) point and its files, with what its walls bear."""

    @property
    def aneurysm(self) -> AneurysmState:
        """Stresses and flow into the dome of the last state; raises InputError without one, or without an aneurysm."""
        if self.state_file is None:
            raise InputError(f"{self.directory} holds no state")
        return self.aneurysm_at(self.state_file)

    def aneurysm_at(self, state: str) -> AneurysmState:
        """Return the same of a saved state, given the name of its file; raises InputError without an aneurysm."""
        found = self.walls_at(state)
        if not isinstance(found, AneurysmState):
            raise InputError(f'the geometry "{self.scene.geometry.kind}" is no aneurysm')
        return found

    @property
    def walls(self) -> WallState | None:
        """Wall shear stress and flow rates of the last state; None where none was saved or the scene reports none."""
        return None if self.state_file is None else self.walls_at(self.state_file)

    def walls_at(self, state: str) -> WallState | None:
        """Return the same of a saved state, given the name of its file."""
        if not reports_walls(self.scene):
            return None
        kind = AneurysmState if isinstance(self.scene.geometry, Aneurysm) else WallState
        raw = read_state(self.directory / state, self.raw_mesh)
        return kind(self.scene, self.raw_mesh, raw, self.read_fields(state))

    @property
    def wall(self) -> pd.DataFrame | None:
        """Stress along the walls, one row per edge: with `output.wall` over each written cycle, else of the last state.

        Columns: see `hemodynamics.cycles.cycle_tables` and `hemodynamics.state.WallState.wall`; None without any.
        """
        if self.scene.output.wall is not None:
            found = read_cycles(self.directory)
            return cycles.cycle_tables(self.scene, self.raw_mesh, found) if found else None
        walls = self.walls
        return None if walls is None else walls.wall

    @property
    def cycles(self) -> list[dict[str, Any]]:
        """Indices of the wall shear stress in each written cycle (`hemodynamics.cycles.cycle_summary`); often none."""
        found = read_cycles(self.directory)
        return cycles.cycle_summary(self.scene, self.raw_mesh, found) if found else []

    def wall_data(self, state: str) -> dict[str, Floats]:
        """Return point data of a saved state beside its fields: stress on and in the walls.

        `wall_shear_stress`, `effective_stress` (see `WallState.point_data`, `AneurysmState.point_data`); of the last
        state also `tawss`, `osi`, `rrt` of the last whole cycle (`hemodynamics.cycles.cycle_point_data`).
        """
        return {name: value for evaluate in self.point_data(state).values() for name, value in evaluate().items()}

    def point_data(self, state: str) -> Evaluations[Floats]:
        """Return what `wall_data` consists of, each to be evaluated by itself."""
        walls = self.walls_at(state)
        found = {} if walls is None else walls.field_evaluations
        last = self.saved_steps[-1].new if self.saved_steps else self.state_file
        if state in (last, self.state_file) and self.scene.output.wall is not None:
            found["fields of the last cycle"] = self._last_cycle
        return found

    def _last_cycle(self) -> dict[str, Floats]:
        found = read_cycles(self.directory)
        return cycles.cycle_point_data(self.scene, self.raw_mesh, found[-1]) if found else {}


def load_result(directory: str | Path, point: int | None = None) -> Result:
    """Read a run folder.

    Args:
        directory: what `ffsi run --out` or `ffsi.solve` has written, or one chain of a sweep.
        point: which point of a chain; by default the last one.

    Raises:
        InputError: the folder or the point is not there, or its files are damaged, or were changed after the run.
        SceneError: its `scene.toml` cannot be read.
    """
    number = None if point is None else count_of(point, "point")
    return Result.load(path_of(directory, "directory"), number)


def load_results(directory: str | Path, *, believe: bool = False) -> list[Result]:
    """Read every point of a run folder, a chain or a sweep (`PlainResult.load_all`)."""
    return Result.load_all(Path(directory), believe=believe)
