"""Time: the scheme, its steps, when a computation ends and when fields are written."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, PrivateAttr, StrictBool, field_validator, model_validator

from ffsi.files.errors import InputError
from ffsi.files.initial import STORED, Initial
from ffsi.scene.base import Table, refuse
from ffsi.scene.errors import Problem, number_text, short
from ffsi.scene.json_schema import equals, given, when
from ffsi.scene.units import Duration, Quantity, Rate

MAX_STEPS = 1e9
"""Steps that fit into a computation, at most; a smaller step would be lost in the rounding of the time."""


class Time(Table):
    """The steps in time from t = 0, of a theta scheme; a scene without this table is steady.

    The last step, and those before an output, are shortened (or made longer by up to a thousandth, where a sliver would
    be left) so that they end where they should.
    """

    model_config = ConfigDict(json_schema_extra=when(given("smallest_step"), equals("adaptive", True)))

    scheme: Literal["shifted-crank-nicolson", "crank-nicolson", "backward-euler"] = Field(
        "shifted-crank-nicolson",
        description='"shifted-crank-nicolson" (theta = 1/2 + shift step, at most 1), "crank-nicolson" (theta = 1/2) '
        'or "backward-euler" (theta = 1)',
    )
    shift: Rate = Field(1.0, description="shift of theta per time step, shifted-crank-nicolson only, 1/s")
    step: Duration = Field(description="time step, with adaptive the first and the largest one, s")
    end: Duration = Field(description="time at which the computation ends, s")
    stop: Literal["end", "periodic"] = Field(
        "end", description='when to stop: at the "end", or before it as soon as the motion is "periodic"'
    )
    adaptive: StrictBool = Field(False, description="choose each step by its local error (true or false)")
    smallest_step: Duration | None = Field(
        None, description="smallest step (adaptive only; a thousandth of step if absent), s"
    )
    error: Annotated[float, Quantity("1", above=0.0, at_most=0.1)] = Field(
        1e-3, description="accepted local error of a step, relative, adaptive only, dimensionless"
    )
    output_interval: Duration | None = Field(
        None, description="fields are written at its multiples and at the end (only at the end if absent), s"
    )
    checkpoint_interval: Duration | None = Field(
        None, description="simulated time between two checkpoints (every 100 steps if absent), s"
    )

    initial: str | None = Field(
        None,
        description="folder of a run, steady or in time, also on another mesh, with whose last state this one starts; "
        "beside the scene's file",
    )
    _initial: Initial | None = PrivateAttr(None)

    @field_validator("initial")
    @classmethod
    def _absolute(cls, initial: str | None) -> str | None:
        return initial and str(Path(initial).absolute())

    @model_validator(mode="after")
    def _fits(self) -> Self:
        refuse(list(self._problems()))
        if self.initial is not None:
            try:
                self._initial = Initial.read(self.initial)
            except (OSError, InputError) as error:
                why = error.strerror if isinstance(error, OSError) else error
                text = f"no state of a run: {why}; accepted: the folder of a run that has ended well"
                refuse([Problem("initial", text, short(self.initial))])
        return self

    @property
    def initial_state(self) -> Initial | None:
        """What `initial` holds."""
        return self._initial

    def store(self, directory: Path) -> Self:
        """Copy the state that it starts from into a run folder; return the table that finds it there."""
        if self._initial is None:
            return self
        self._initial.write(directory)
        return self.model_copy(update={"initial": STORED})

    @property
    def _essence(self) -> tuple[Any, ...]:
        """What is computed, wherever the state at its start lies."""
        return (self.model_dump(exclude={"initial"}), self._initial and self._initial.digest)

    def __eq__(self, other: object) -> bool:
        """Compare what is computed."""
        return self._essence == other._essence if isinstance(other, Time) else NotImplemented

    def __hash__(self) -> int:
        """Hash what `__eq__` compares."""
        return hash((self.step, self.end, self._essence[1]))

    def _problems(self) -> Iterator[Problem]:
        step = f"step = {number_text(self.step)} s"
        for key in ("end", "output_interval", "checkpoint_interval"):
            value = getattr(self, key)
            if value is not None and value < self.step:
                yield Problem(key, f"must be at least {step}", f"{short(value)} s")
        for key in ("step", "smallest_step"):
            value = getattr(self, key)
            if value is not None and value < self.end / MAX_STEPS:
                least = f"end / {number_text(MAX_STEPS)} = {number_text(self.end / MAX_STEPS)} s"
                yield Problem(key, f"must be at least {least}", f"{short(value)} s")
        if self.smallest_step is None:
            return
        if not self.adaptive:
            yield Problem("smallest_step", "only accepted with adaptive = true", f"{short(self.smallest_step)} s")
        elif self.smallest_step > self.step:
            yield Problem("smallest_step", f"must be at most {step}", f"{short(self.smallest_step)} s")

    def theta_of(self, step: float) -> float:
        """Return the weight of the new time level for a step in s, 1/2 to 1, dimensionless."""
        match self.scheme:
            case "backward-euler":
                return 1.0
            case "crank-nicolson":
                return 0.5
        return min(1.0, 0.5 + self.shift * step)
