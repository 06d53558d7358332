"""Lengths of a geometry as the script's names: its exact areas and lengths, stated in the scene, become formulas."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ffsi.scene import Scene
from ffsi.scene.base import Table

_SUM, _PRODUCT, _ATOM = range(3)


def _operation(sign: str, binds: int, swapped: bool = False) -> Callable[[Formula, Any], Formula]:
    """Return an operation of formulas; the right side of a difference or a quotient must bind tighter."""
    tighter = binds + (sign in (" - ", "/"))

    def operate(self: Formula, other: Any) -> Formula:
        right = other if isinstance(other, Formula) else Formula(repr(other))
        left, right = (right, self) if swapped else (self, right)
        return Formula(left.within(binds) + sign + right.within(tighter), binds)

    return operate


def _function(name: str) -> Callable[[Formula], Formula]:
    """Return what numpy's function of a formula calls."""
    return lambda self: Formula(f"{name}({self})")


class Formula:
    """FreeFEM text of a number, which arithmetic and numpy's functions make longer."""

    def __init__(self, text: str, binds: int = _ATOM) -> None:
        """Take the text of a sum, a product or what binds tighter."""
        self.text, self.binds = text, binds

    def __str__(self) -> str:
        """Return the text."""
        return self.text

    def within(self, binds: int) -> str:
        """Return the text as a part of one that binds so."""
        return self.text if self.binds >= binds else f"({self.text})"

    def __neg__(self) -> Formula:
        """Return the text with another sign."""
        return Formula(f"-{self.within(_PRODUCT)}", _SUM)

    def __pow__(self, power: int) -> Formula:
        """Return the text of a power."""
        return Formula(f"{self.within(_ATOM)}^{power}", _PRODUCT)

    __add__, __radd__ = _operation(" + ", _SUM), _operation(" + ", _SUM, swapped=True)
    __sub__, __rsub__ = _operation(" - ", _SUM), _operation(" - ", _SUM, swapped=True)
    __mul__, __rmul__ = _operation("*", _PRODUCT), _operation("*", _PRODUCT, swapped=True)
    __truediv__ = _operation("/", _PRODUCT)
    sin, cos, arcsin, sqrt = _function("sin"), _function("cos"), _function("asin"), _function("sqrt")


def with_formulas(scene: Scene, variables: Mapping[str, str]) -> Scene:
    """Return the scene with the script's ``variables``, by key, in the place of its geometry's lengths."""

    def named(value: Any, key: str) -> Any:
        if isinstance(value, Table):
            fields = {name: named(getattr(value, name), f"{key}.{name}") for name in type(value).model_fields}
            return value.model_copy(update=fields)
        return Formula(variables[key]) if key in variables else value

    return scene.model_copy(update={"geometry": named(scene.geometry, "geometry")})
