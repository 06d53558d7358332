"""A finished run, read from its folder."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ffsi.files import folder, seals
from ffsi.files.arrays import Floats, RawMesh, read_mesh, read_state
from ffsi.files.errors import InputError
from ffsi.files.history import read_history
from ffsi.files.json_types import refuse_other_types
from ffsi.files.reading import read_frame
from ffsi.files.steps import SavedStep, read_saved_steps
from ffsi.result import vtu
from ffsi.result.domain import meshed
from ffsi.result.evaluation import Evaluations, Notes, words
from ffsi.result.fields import FLUID, Fields
from ffsi.result.quantities import flatten, unit
from ffsi.result.study_definition import label
from ffsi.scene import Scene, load_scene, with_values

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

    import meshio
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class PlainResult:
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

    @classmethod
    def load(cls, directory: Path, point: int | None = None, *, believe: bool = False) -> Self:
        """Read a run folder, or one point of a chain; with `believe` checksums are not compared.

        Raises:
            InputError: the folder or the point is not there, or its files are damaged, or were changed after the run.
            SceneError: its `scene.toml` cannot be read.
        """
        if not folder.is_run_folder(directory):
            raise InputError(folder.no_run_folder(directory))
        name, chain = folder.RESULT, (directory / folder.CHAIN).is_file()
        if point is not None and (chain or point != 1 or not (directory / name).is_file()):
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
        return cls(scene, directory, data)

    @classmethod
    def load_all(cls, directory: Path, *, believe: bool = False) -> list[Self]:
        """Read every point of a run folder, a chain or a sweep, in the order of the folders and points.

        With `believe` checksums are not compared, for a caller that does so itself.

        Raises:
            InputError: as `load`; also if there is no result yet.
        """
        if folder.is_sweep_folder(directory):
            best: dict[tuple[object, ...], Self] = {}  # of a point that was solved several times
            for chain in sorted(path for path in directory.glob("chain-*") if folder.is_run_folder(path)):
                for result in cls._points(chain, believe):
                    at = tuple((result.data.get("varied") or {}).items())
                    if at not in best or result.worth > best[at].worth:
                        best[at] = result
            results = list(best.values())
        elif (directory / folder.CHAIN).is_file():
            results = cls._points(directory, believe)
        else:
            results = [cls.load(directory, believe=believe)]
        if not results:
            raise InputError(f"{directory} holds no result yet")
        return results

    @classmethod
    def _points(cls, chain: Path, believe: bool) -> list[Self]:
        numbers = sorted(int(path.stem.rpartition("-")[2]) for path in chain.glob("result-[0-9]*.json"))
        return [cls.load(chain, number, believe=believe) for number in numbers]

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
        """In time one row per step (`files.history.read_history`), else the point's Newton iterations (`newton.csv`).

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
        return self.read_fields(state)

    @cached_property
    def saved_steps(self) -> list[SavedStep]:
        """The steps of a computation in time whose fields were saved (`time.output_interval`); none if it is steady.

        Steps that were only saved to be checked are not among them.
        """
        found = read_saved_steps(self.directory) if self.scene.time is not None else []
        return [step for step in found if step.tolerance == 0.0]

    def fields_of(self, step: SavedStep) -> Fields:
        """Return the fields at the end of a saved step."""
        return self.read_fields(step.new)

    def fields_at(self, time: float) -> Fields:
        """Return the saved fields of a computation in time that are nearest to a time in s.

        Raises:
            InputError: no step was saved.
        """
        if not self.saved_steps:
            raise InputError(f"{self.directory} holds no saved time steps")
        return self.fields_of(min(self.saved_steps, key=lambda step: abs(step.time - time)))

    def read_fields(self, state: str) -> Fields:
        """Return the fields of a saved state, given the name of its file."""
        mixed = [region for region, solid in enumerate(self.scene.solid.values(), start=FLUID + 1) if solid.mixed]
        return Fields.from_raw(self.raw_mesh, read_state(self.directory / state, self.raw_mesh), mixed)

    def point_data(self, state: str) -> Evaluations[Floats]:
        """Return what of a saved state is shown beside its fields, each to be evaluated by itself: here nothing."""
        return {}

    @cached_property
    def raw_mesh(self) -> RawMesh:
        """The reference mesh as the script wrote it."""
        return read_mesh(self.directory / folder.MESH)

    @property
    def domain(self) -> dict[str, Any]:
        """Areas of the `regions`, roles and lengths of the `boundaries` (`domain.meshed`); nothing without a mesh."""
        return meshed(self.scene, self.raw_mesh) if (self.directory / folder.MESH).is_file() else {}

    @property
    def state_file(self) -> str | None:
        """Name of the file with this point's unknowns (of a failed point: its last converged state), or None."""
        name = self.data.get("state")
        there = name and (self.directory / name).is_file() and (self.directory / folder.MESH).is_file()
        return str(name) if there else None

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
    def worth(self) -> tuple[int, int]:
        """What decides between two results of a point of a sweep: rank; of two as good the first chain's.

        Of two that were not reached the last chain's, as that is where the point was given up.
        """
        digits = self.directory.name.rpartition("-")[2]
        number = int(digits) if digits.isdecimal() else 0
        return self.rank, number if self.failure == "not-reached" else -number

    @property
    def mesh(self) -> meshio.Mesh:
        """Quadratic triangles (`triangle6`) on the reference configuration with all fields, as a meshio mesh."""
        of_state = self.point_data(self.state_file).values() if self.state_file else ()
        return vtu.to_meshio(self.fields, {name: value for each in of_state for name, value in each().items()})

    def sample(self, points: ArrayLike) -> pd.DataFrame:
        """Evaluate the fields at reference points, (m, 2) coordinates in metres.

        Returns:
            One row per point: `x`, `y` (m), `region`, `ux`, `uy` (m), `vx`, `vy` (m/s), `p` (Pa); NaN outside of the
            mesh, and `p` is NaN inside a solid.
        """
        import pandas as pd

        values = self.fields.sample(points)
        return pd.DataFrame(np.asarray(points, dtype=float), columns=["x", "y"], dtype=float).assign(**values)

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
        from ffsi.result import pictures

        return pictures.draw(name, self.fields, title=self.title)

    @property
    def title(self) -> str:
        """Case and mesh in words, for headings."""
        words = [str(self.data["case"])]
        if self.data.get("level") is not None:
            words.append(f"mesh level {self.data['level']}")
        words += [label(values)] if (values := self.data.get("varied")) else []
        if not self.solved:
            words.append("last converged state")
        return ", ".join(words)

    def __repr__(self) -> str:
        """Return case, mesh, status and quantities, for people."""
        name, values = self.shown_quantities
        rows = [f"  {key:<24}{value:14.6g} {unit(key)}".removesuffix(" 1") for key, value in values.items()]
        heading = f"Result of {self.title}: {self.verdict} {self.reason}".rstrip()
        return "\n".join([heading, *([f"  {name}:"] if name else []), *rows, f"  in {self.directory}"])

    def _repr_html_(self) -> str:
        import html

        rows = "".join(
            f"<tr><th>{html.escape(key)}</th><td>{value:.6g}</td><td>{html.escape(unit(key))}</td></tr>"
            for key, value in self.shown_quantities[1].items()
        )
        heading = f"<p><b>{html.escape(self.title)}</b>: {html.escape(self.verdict)} {html.escape(self.reason)}</p>"
        notes = [*self.warnings, *(f"not evaluated: {words(note)}" for note in self.not_evaluated)]
        remarks = "".join(f"<p>{html.escape(note)}</p>" for note in notes)
        return f"{heading}{remarks}<table>{rows}</table>{self._picture_html()}"

    def _picture_html(self) -> str:
        import html

        from ffsi.result import painting, views

        if self.state_file is None:
            return ""
        try:
            name = views.available(self.fields)[0]
            encoded = base64.b64encode(painting.paint(name, self.fields, self.title)).decode("ascii")
        except (ValueError, RuntimeError, OSError) as error:
            return f"<p>no picture: {html.escape(str(error))}</p>"
        return f'<img style="max-width:100%" alt="{name}" src="data:image/png;base64,{encoded}">'
