"""The catalogue: scenes with published or stated values, each a TOML file that a user can copy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from pathlib import Path

from ffsi.scene.model import Scene
from ffsi.scene.toml import parse_toml

FOLDER = Path(__file__).parents[1] / "cases"


class Catalogue(Mapping[str, Scene]):
    """Scenes by name, in alphabetical order; each is read when it is asked for."""

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))

    @property
    def steady(self) -> list[str]:
        """Names of the scenes that are steady."""
        return [name for name in self if self[name].steady]

    def __getitem__(self, name: str) -> Scene:
        """Return a scene. Raises ``KeyError`` for a name that is none."""
        if name not in self._names:
            raise KeyError(name)
        return _read(name)

    def __iter__(self) -> Iterator[str]:
        """Go through the names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return the number of scenes."""
        return len(self._names)


@cache
def _read(name: str) -> Scene:
    path = FOLDER / f"{name}.toml"
    return Scene.model_validate(parse_toml(path.read_text(encoding="utf-8"), path.name))


CASES = Catalogue()
