"""The base of every table of a scene: a frozen pydantic model whose errors are `SceneError`."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import PydanticCustomError

from ffsi.scene.errors import Problem, SceneError
from ffsi.scene.json_schema import SceneJsonSchema
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

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True, defer_build=True)

    follows: ClassVar[tuple[str, ...]] = ()
    """Keys that follow from other values where they are not given."""

    def __init__(self, **values: Any) -> None:
        """Check the values."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise SceneError(scene_problems(error, type(self))) from None

    # Says that this is an ordinary constructor: pydantic must not call it for the tables within a table.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse a new value, in our words.

        Raises:
            SceneError: always, for a key.
        """
        if name in type(self).model_fields:
            raise SceneError([Problem(name, "a scene does not change: ffsi.with_values returns one with new values")])
        super().__setattr__(name, value)

    def given(self) -> dict[str, Any]:
        """Return the table as `model_dump` does, without what follows from the other values."""
        dump = self.model_dump(exclude_none=True)
        for name in set(self.follows) - self.model_fields_set:
            dump.pop(name, None)
        for name in dump:
            inner = getattr(self, name)
            if isinstance(inner, Table):
                dump[name] = inner.given()
            elif isinstance(inner, Mapping):
                dump[name] |= {key: item.given() for key, item in inner.items() if isinstance(item, Table)}
        return dump

    def fill(self, **values: Any) -> None:
        """Set what follows from other values, in a validator: the only way in which a table changes."""
        for key, value in values.items():
            object.__setattr__(self, key, value)

    def filled(self, values: Mapping[str, Any]) -> Self:
        """Return a copy with values that follow from others: they do not count as given."""
        copy = self.model_copy(update=dict(values))
        copy.fill(__pydantic_fields_set__=set(self.model_fields_set))
        return copy

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

    @classmethod
    def model_json_schema(cls, *args: Any, **options: Any) -> dict[str, Any]:
        """Return the JSON schema of the table as a TOML file holds it."""
        return super().model_json_schema(*args, **{"schema_generator": SceneJsonSchema, **options})
