"""The base of every table of a scene: a frozen pydantic model whose errors are `SceneError`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import PydanticCustomError

from ffsi.scene.errors import Problem, SceneError
from ffsi.scene.validation import scene_problems


def refuse(problems: Sequence[Problem]) -> None:
    """Raise the problems from inside a pydantic validator; do nothing if there are none.

    Raises:
        PydanticCustomError: there is at least one problem.
    """
    if problems:
        raise PydanticCustomError("problems", "problems", {"problems": list(problems)})


class Table(BaseModel):
    """A table of the scene: immutable, no unknown keys, values checked.

    Raises:
        SceneError: a key or value is not valid (on construction and in `model_validate`).
    """

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)

    def __init__(self, **values: Any) -> None:
        """Check the values."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise SceneError(scene_problems(error, type(self))) from None

    # Says that this is an ordinary constructor: pydantic must not call it for the tables within a table.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """Check a dictionary (or an instance) and return the table.

        Raises:
            SceneError: a key or value is not valid.
        """
        try:
            return super().model_validate(obj, **options)
        except ValidationError as error:
            raise SceneError(scene_problems(error, cls)) from None
