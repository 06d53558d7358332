"""A finished run, read from its folder."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import meshio
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ffsi import folder, seals, vtu
from ffsi.domain import meshed
from ffsi.evaluation import Evaluations, Notes, words
from ffsi.fields import FLUID, Fields, FloatArray
from ffsi.folder import InputError
from ffsi.quantities import flatten as flatten
from ffsi.quantities import published_value as published_value
from ffsi.quantities import unit as unit
from ffsi.reading import read_frame
from ffsi.scene import Aneurysm, Scene, load_scene, with_values
from ffsi.shapes import refuse_other_types
from ffsi.timesteps import SavedStep, read_history, read_saved_steps

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

    from matplotlib.figure import Figure

    from ffsi.hemodynamics.aneurysm import AneurysmState
    from ffsi.hemodynamics.state import WallState
    from ffsi.rawfiles import RawMesh


@dataclass(frozen=True)
class Result:
    """One solved (or failed) point and its files.

    Attributes:
        scene: the scene as solved.
        directory: the run folder.
        data: the content of `result.json` (docs/formats.md).
    """

    scene: Scene
    directory: Path
    data: dict[str, Any]
    _temporary: TemporaryDirectory[str] | None = field(default=None, repr=False, compare=False)

    @property
    def status(self) -> str:
        """`converged` or `failed`."""
        return str(self.data["status"])

    @property
    def reason(self) -> str:
        """Why the run failed, in words; empty if it did not."""
        return str(self.data.get("reason") or "")

    @property
    def converged(self) -> bool:
        """Whether the run was solved and, unless that was switched off, checked."""
        return self.status == "converged"

    @property
    def warnings(self) -> list[str]:
        """What the result may lack although its equations are solved, each with the key to change."""
        return [str(item) for item in self.data.get("warnings", [])]

    @property
    def checked(self) -> bool:
        """Whether the independent checker has passed these results; never of a file without a checksum."""
        return bool(self.data.get("checked")) and "digest" in self.data

    @property
    def file(self) -> Path:
        """The result file of this point."""
        return self.directory / (folder.numbered(folder.RESULT, self.point) if "varied" in self.data else folder.RESULT)

    @property
    def check_failures(self) -> list[str]:
        """What the reference checker objects to; empty if it passed or did not run."""
        return [str(item) for item in self.data.get("check_failures", [])]

    @property
    def verdict(self) -> str:
        """The status, and whether a solved point was checked."""
        return f"{self.status}, not checked" if self.converged and not self.checked else self.status

    @property
    def not_evaluated(self) -> Notes:
        """What of a result could not be evaluated, and why: `what` and `why` of each."""
        return list(self.data.get("not_evaluated") or [])

    @property
    def point(self) -> int:
        """Number of this point within its run folder, from 1."""
        return int(self.data.get("point", 1))

    @property
    def quantities(self) -> dict[str, Any]:
        """Forces (N/m), displacements (m), pressures (Pa), ...; each a mean, amplitude, frequency if unsteady."""
        return dict(self.data.get("quantities") or {})

    @property
    def reached(self) -> dict[str, float]:
        """Of a failed point what was reached, flat.

        `load` (the part of what drives the scene), the varied values or the `time` (s), and the quantities of the last
        state that was solved. If only the check failed, the quantities that it failed for.
        """
        return flatten(self.data.get("reached") or {})

    @property
    def last_quantities(self) -> dict[str, Any]:
        """Quantities of the last state of a computation in time; those of a steady one."""
        in_time = self.data.get("time")
        return self.quantities if in_time is None else dict(in_time.get("last") or {})

    @property
    def shown_quantities(self) -> tuple[str, dict[str, float]]:
        """Flat quantities for people: over the last period, of the last state, or what was reached; and which."""
        in_time = self.data.get("time")
        if self.failure and not self.quantities:
            words = {"check": "at a state that failed the check", "stopped": "at the stop"}
            return words.get(self.failure, "at the last solved state, before the failure"), self.reached
        if in_time is None:
            return "", flatten(self.quantities)
        periods = any(name.endswith("_mean") for name in flatten(self.quantities))
        if periods or not self.last_quantities:
            return "over the last period" if periods else "", flatten(self.quantities)
        return f"at t = {in_time['reached']:g} s", flatten(self.last_quantities)

    @property
    def parameters(self) -> dict[str, Any]:
        """Every value the script really used, by the scene's dotted keys."""
        return dict(self.data.get("parameters") or {})

    @cached_property
    def history(self) -> pd.DataFrame:
        """In time one row per step (see `timesteps.read_history`), else this point's Newton iterations (`newton.csv`).

        Raises:
            InputError: the folder holds no such file.
        """
        if self.scene.time is not None:
            return read_history(self.directory)
        path = self.directory / folder.HISTORY
        if not path.is_file():
            raise InputError(f"{self.directory} holds no {folder.HISTORY}")
        table = read_frame(path)
        if "point" not in table:
            raise InputError(f"{path} is damaged: it has no column point")
        return table[table["point"] == self.point].reset_index(drop=True)

    @cached_property
    def fields(self) -> Fields:
        """The fields of this point; for a failed run those of the last converged state.

        Raises:
            InputError: no state was saved.
        """
        state = self.state_file
        if state is None:
            raise InputError(
                f"{self.directory} holds no fields of point {self.point}: {self.reason or 'nothing was saved'}"
            )
        return self._read_fields(state)

    @cached_property
    def saved_steps(self) -> list[SavedStep]:
        """The steps of a computation in time whose fields were saved (`time.output_interval`); none if it is steady.

        Steps that were only saved to be checked are not among them.
        """
        found = read_saved_steps(self.directory) if self.scene.time is not None else []
        return [step for step in found if step.tolerance == 0.0]

    def fields_of(self, step: SavedStep) -> Fields:
        """Return the fields at the end of a saved step."""
        return self._read_fields(step.new)

    def fields_at(self, time: float) -> Fields:
        """Return the saved fields of a computation in time that are nearest to a time in s.

        Raises:
            InputError: no step was saved.
        """
        if not self.saved_steps:
            raise InputError(f"{self.directory} holds no saved time steps")
        return self.fields_of(min(self.saved_steps, key=lambda step: abs(step.time - time)))

    def _read_fields(self, state: str) -> Fields:
        from ffsi.rawfiles import read_state

        mixed = [region for region, solid in enumerate(self.scene.solid.values(), start=FLUID + 1) if solid.mixed]
        return Fields.from_raw(self._raw_mesh, read_state(self.directory / state, self._raw_mesh), mixed)

    @property
    def aneurysm(self) -> AneurysmState:
        """Wall shear stress, effective stress and flow into the dome of the last state.

        Raises:
            InputError: no state was saved, or the geometry is no aneurysm.
        """
        if self.state_file is None:
            raise InputError(f"{self.directory} holds no state")
        return self.aneurysm_at(self.state_file)

    def aneurysm_at(self, state: str) -> AneurysmState:
        """Return the same of a saved state, given the name of its file.

        Raises:
            InputError: the geometry is no aneurysm.
        """
        from ffsi.hemodynamics.aneurysm import AneurysmState

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
        from ffsi.hemodynamics.aneurysm import AneurysmState
        from ffsi.hemodynamics.state import WallState, reports_walls
        from ffsi.rawfiles import read_state

        if not reports_walls(self.scene):
            return None
        kind = AneurysmState if isinstance(self.scene.geometry, Aneurysm) else WallState
        raw = read_state(self.directory / state, self._raw_mesh)
        return kind(self.scene, self._raw_mesh, raw, self._read_fields(state))

    @property
    def wall(self) -> pd.DataFrame | None:
        """Stress along the walls, one row per edge: with `output.wall` over each written cycle, else of the last state.

        Columns: see `hemodynamics.cycles.cycle_tables` and `hemodynamics.state.WallState.wall`; None without any.
        """
        from ffsi.hemodynamics import cycles, indices

        if self.scene.output.wall is not None:
            found = indices.read_cycles(self.directory)
            return cycles.cycle_tables(self.scene, self._raw_mesh, found) if found else None
        walls = self.walls
        return None if walls is None else walls.wall

    @property
    def cycles(self) -> list[dict[str, Any]]:
        """Indices of the wall shear stress in each written cycle (`hemodynamics.cycles.cycle_summary`); often none."""
        from ffsi.hemodynamics import cycles, indices

        found = indices.read_cycles(self.directory)
        return cycles.cycle_summary(self.scene, self._raw_mesh, found) if found else []

    def wall_data(self, state: str) -> dict[str, FloatArray]:
        """Return point data of a saved state beside its fields: stress on and in the walls.

        `wall_shear_stress`, `effective_stress` (see `WallState.point_data`, `AneurysmState.point_data`); of the last
        state also `tawss`, `osi`, `rrt` of the last whole cycle (`hemodynamics.cycles.cycle_point_data`).
        """
        return {name: value for evaluate in self.wall_fields(state).values() for name, value in evaluate().items()}

    def wall_fields(self, state: str) -> Evaluations[FloatArray]:
        """Return what `wall_data` consists of, each to be evaluated by itself."""
        walls = self.walls_at(state)
        found = {} if walls is None else walls.field_evaluations
        last = self.saved_steps[-1].new if self.saved_steps else self.state_file
        if state in (last, self.state_file) and self.scene.output.wall is not None:
            found["fields of the last cycle"] = lambda: self._last_cycle
        return found

    @property
    def _last_cycle(self) -> dict[str, FloatArray]:
        from ffsi.hemodynamics import cycles, indices

        found = indices.read_cycles(self.directory)
        return cycles.cycle_point_data(self.scene, self._raw_mesh, found[-1]) if found else {}

    @cached_property
    def _raw_mesh(self) -> RawMesh:
        from ffsi.rawfiles import read_mesh

        return read_mesh(self.directory / folder.MESH)

    @property
    def domain(self) -> dict[str, Any]:
        """Areas of the `regions`, roles and lengths of the `boundaries` (`domain.meshed`); nothing without a mesh."""
        return meshed(self.scene, self._raw_mesh) if (self.directory / folder.MESH).is_file() else {}

    @property
    def state_file(self) -> str | None:
        """Name of the file with this point's unknowns (of a failed point: its last converged state), or None."""
        name = self.data.get("state")
        return (
            str(name)
            if name and (self.directory / name).is_file() and (self.directory / folder.MESH).is_file()
            else None
        )

    @property
    def solved(self) -> bool:
        """Whether Newton's method converged, whatever the checker says; also up to where a run in time was stopped."""
        return self.failure in ("", "check", "stopped")

    @property
    def failure(self) -> str:
        """Empty, `check`, `not-converged`, `not-reached`, `stopped` or `crash`.

        Not reached: an earlier point of the chain failed; stopped: by the user, before the end of a run in time.
        """
        return str(self.data.get("failure", "" if self.converged else "not-converged"))

    @property
    def rank(self) -> int:
        """How much this result is worth beside others of the same point."""
        ranks = {"": 4, "check": 3, "not-converged": 2, "not-reached": 1}
        return ranks.get(self.failure, 0) + int(self.checked)

    @property
    def mesh(self) -> meshio.Mesh:
        """Quadratic triangles (`triangle6`) on the reference configuration with all fields, as a meshio mesh."""
        return vtu.to_meshio(self.fields, self.wall_data(self.state_file) if self.state_file else {})

    def sample(self, points: ArrayLike) -> pd.DataFrame:
        """Evaluate the fields at reference points.

        Args:
            points: (m, 2) reference coordinates, metres.

        Returns:
            One row per point: `x`, `y` (m), `region`, `ux`, `uy` (m), `vx`, `vy` (m/s), `p` (Pa); NaN outside of the
            mesh, and `p` is NaN inside a solid.
        """
        values = self.fields.sample(points)
        table = pd.DataFrame(np.asarray(points, dtype=float), columns=["x", "y"], dtype=float)
        return table.assign(**values)

    def at(self, x: float, y: float) -> dict[str, float]:
        """Evaluate the fields at one reference point (metres); keys as in `sample`.

        Raises:
            ValueError: the point is outside of the mesh.
        """
        values = self.fields.sample([[x, y]])
        if not values["region"][0] >= 0:
            raise ValueError(f"({x}, {y}) is outside of the reference mesh of {self.data['case']}")
        return {key: float(value[0]) for key, value in values.items()}

    def picture(self, name: str = "velocity") -> Figure:
        """Draw `velocity`, `pressure` or `displacement` on the deformed mesh.

        Raises:
            ValueError: another name, or the scene has no such field.
            InputError: no state was saved.
        """
        from ffsi.report import figures

        return figures.draw(name, self.fields, title=self.title)

    @property
    def title(self) -> str:
        """Case and mesh in words, for headings."""
        words = [str(self.data["case"])]
        if self.data.get("level") is not None:
            words.append(f"mesh level {self.data['level']}")
        words += [f"{key} = {value:g}" for key, value in (self.data.get("varied") or {}).items()]
        if not self.solved:
            words.append("last converged state")
        return ", ".join(words)

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{html.escape(key)}</th><td>{value:.6g}</td><td>{html.escape(unit(key))}</td></tr>"
            for key, value in self.shown_quantities[1].items()
        )
        heading = f"<p><b>{html.escape(self.title)}</b>: {html.escape(self.verdict)} {html.escape(self.reason)}</p>"
        notes = [*self.warnings, *(f"not evaluated: {words(note)}" for note in self.not_evaluated)]
        remarks = "".join(f"<p>{html.escape(note)}</p>" for note in notes)
        return f"{heading}{remarks}<table>{rows}</table>{self._picture_html()}"

    def _picture_html(self) -> str:
        from ffsi.report import figures

        if self.state_file is None:
            return ""
        try:
            name = figures.available(self.fields)[0]
            encoded = base64.b64encode(figures.to_png(self.picture(name))).decode("ascii")
        except (ValueError, RuntimeError, OSError) as error:
            return f"<p>no picture: {html.escape(str(error))}</p>"
        return f'<img style="max-width:100%" alt="{name}" src="data:image/png;base64,{encoded}">'


def load_result(directory: str | Path, point: int | None = None) -> Result:
    """Read a run folder.

    Args:
        directory: what `ffsi run --out` or `run.solve` has written, or one chain of a sweep.
        point: which point of a chain; by default the last one.

    Raises:
        InputError: the folder or the point is not there, or its files are damaged, or were changed after the run.
        SceneError: its `scene.toml` cannot be read.
    """
    return _load(Path(directory), point, believe=False)


def _load(directory: Path, point: int | None, believe: bool) -> Result:
    if not folder.is_run_folder(directory):
        raise InputError(
            f"{directory} is no run folder of ffsi" + ("" if directory.exists() else folder.missing(directory))
        )
    name = folder.RESULT
    if point is not None and not (
        (directory / name).is_file() and point == 1 and not (directory / folder.CHAIN).is_file()
    ):
        name = folder.numbered(folder.RESULT, point)
    data = folder.read_json(directory / name)
    refuse_other_types(directory / name, data)
    if missing := [key for key in ("case", "status") if key not in data]:
        raise InputError(f"{directory / name} lacks {', '.join(missing)}")
    if name != folder.RESULT and data.get("point") != point:
        raise InputError(f"{directory / name} is the result of point {data.get('point')}")
    if not believe and "digest" in data and (wrong := seals.problems(directory / name, data)):
        raise InputError(f"{directory}: {'; '.join(wrong)}. What was computed is not what lies there; run it again")
    scene = load_scene(str(directory / folder.SCENE), [])
    if varied := data.get("varied"):
        scene = with_values(scene, varied)
    return Result(scene, directory, data)


def load_results(directory: str | Path, *, believe: bool = False) -> list[Result]:
    """Read every point of a run folder, a chain or a sweep, in the order of the folders and points.

    With `believe` checksums are not compared, for a caller that does so itself.

    Raises:
        InputError: as `load_result`; also if there is no result yet.
    """
    directory = Path(directory)
    if folder.is_sweep_folder(directory):
        chains = sorted(path for path in directory.glob("chain-*") if folder.is_run_folder(path))
        results = best(result for chain in chains for result in _points(chain, believe))
    elif (directory / folder.CHAIN).is_file():
        results = _points(directory, believe)
    else:
        results = [_load(directory, None, believe)]
    if not results:
        raise InputError(f"{directory} holds no result yet")
    return results


def _points(chain: Path, believe: bool) -> list[Result]:
    numbers = sorted(int(path.stem.rpartition("-")[2]) for path in chain.glob("result-[0-9]*.json"))
    return [_load(chain, number, believe) for number in numbers]


def best(results: Iterable[Result]) -> list[Result]:
    """Return one result of every point that was solved several times: the best one, of equally good ones the first."""
    found: dict[tuple[object, ...], Result] = {}
    for result in results:
        at = tuple((result.data.get("varied") or {}).values())
        if at not in found or result.rank > found[at].rank:
            found[at] = result
    return list(found.values())
