"""Formulas in a scene, such as an inflow profile: parsed against an allow-list, never executed as text.

The text is read by Python's parser into a tree; every node must be on the list below. The tree that was checked is
compiled for values, with the names below and no others, and printed as FreeFEM text. Nothing of the user's text is.
"""

from __future__ import annotations

import ast
import copy
import functools
import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import CodeType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ffsi.scene.errors import names as quoted
from ffsi.scene.errors import number_text

MAX_LENGTH = 200
MAX_EXPONENT = 16.0

Values = NDArray[np.float64]

# Operators in FreeFEM, and how strongly they bind.
_OPERATORS: dict[type[ast.operator], tuple[str, int]] = {
    **{ast.Add: ("+", 1), ast.Sub: ("-", 1), ast.Mult: ("*", 2), ast.Div: ("/", 2), ast.Pow: ("^", 3)}
}
_FUNCTIONS: dict[str, Callable[[Any], Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "tanh": np.tanh,
}
_EXTREMA: dict[str, Callable[[Any, Any], Any]] = {"min": np.minimum, "max": np.maximum}
_CONSTANTS = {"pi": math.pi}
_NAMES: dict[str, Any] = {
    **_FUNCTIONS,
    **{name: lambda *values, of=of: functools.reduce(of, values) for name, of in _EXTREMA.items()},
    **{name: np.float64(value) for name, value in _CONSTANTS.items()},
    "number": np.float64,
    "__builtins__": {},
}
_FORBIDDEN_CHARACTER = re.compile(r"[^A-Za-z0-9_ .+\-*/^(),]")


class ExpressionError(ValueError):
    """The text is no formula made of the accepted names, functions and operators."""


@dataclass(frozen=True)
class Expression:
    """A formula, as written, of variables; make one with `Expression.parse`."""

    text: str
    variables: tuple[str, ...]
    _tree: ast.expr = field(repr=False, compare=False)

    @classmethod
    def parse(cls, text: str, variables: Sequence[str] = ("y", "H")) -> Expression:
        """Read a formula.

        Args:
            text: numbers, variables, pi, + - * / ^ (or **), brackets, and the functions sin, cos, tan, exp, log,
                sqrt, abs, tanh, min, max.
            variables: names that may occur.

        Raises:
            ExpressionError: anything else occurs in the text, or it is longer than 200 characters.
        """
        return _parsed(text, tuple(variables))

    @classmethod
    def polygon(cls, at: Sequence[float], value: Sequence[float], variables: Sequence[str]) -> Expression:
        """Return the formula of straight lines between samples, in the first variable: constant beyond them.

        It is the mean of the first and the last value and, for every sample, half the change of the slope there times
        the distance from it.
        """
        slope = np.diff(value) / np.diff(at)
        change = np.diff(np.concatenate([[0.0], slope, [0.0]])) / 2
        terms = [
            f"({half!r})*abs({variables[0]} - ({place!r}))" for half, place in zip(change.tolist(), at, strict=True)
        ]
        text = " + ".join([f"({(value[0] + value[-1]) / 2!r})", *terms])
        return cls(text, tuple(variables), ast.parse(text, mode="eval").body)

    @classmethod
    def spline(cls, at: Sequence[float], value: Sequence[float], variables: Sequence[str]) -> Expression:
        """Return the formula of a cubic spline through samples, in the first variable, for values between them.

        At the first sample its slope is 0, at the last one its second derivative. It is a cubic polynomial and, for
        every sample between, half the change of its cubic coefficient times the distance from it cubed.
        """
        from scipy.interpolate import CubicSpline

        found = CubicSpline(at, value, bc_type=((1, np.array(0.0)), (2, np.array(0.0))))
        halves, middle = np.diff(found.c[0]) / 2, (at[0] + at[-1]) / 2
        # in the distance from the middle, where less cancels
        whole = np.polynomial.Polynomial(found.c[::-1, 0])(np.polynomial.Polynomial([middle - at[0], 1.0]))
        for half, place in zip(halves, at[1:-1], strict=True):
            whole += half * np.polynomial.Polynomial([middle - place, 1.0]) ** 3
        u = f"({variables[0]} - ({float(middle)!r}))"
        terms = [f"({float(c)!r})*{u}**{n}" for n, c in enumerate(whole.coef[1:], start=1)]
        terms += [
            f"({float(half)!r})*(({variables[0]} - ({float(x)!r}))**2)**1.5"
            for half, x in zip(halves, at[1:-1], strict=True)
        ]
        text = " + ".join(terms)
        first = cls(text, tuple(variables[:1]), ast.parse(text, mode="eval").body).evaluate(**{variables[0]: at[0]})
        text = f"({float(value[0] - first)!r}) + {text}"
        return cls(text, tuple(variables), ast.parse(text, mode="eval").body)

    def plus(self, text: str) -> Expression:
        """Return the sum with a formula in the same variables, as text of ours, which is not restricted."""
        text = f"{self.text} + {text}"
        return Expression(text, self.variables, ast.parse(text, mode="eval").body)

    def evaluate(self, **values: ArrayLike) -> Values:
        """Return the formula's values for arrays (or numbers) of its variables.

        Where it is not defined (a division by zero, the root of a negative number) the value is inf or nan.

        Raises:
            TypeError: the keywords are not the formula's variables.
        """
        if set(values) != set(self.variables):
            raise TypeError(f"values for {quoted(self.variables)} are needed, got {quoted(values)}")
        arrays = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in values.values()))
        known: dict[str, object] = dict(zip(values, arrays, strict=True))
        shape = arrays[0].shape if arrays else ()
        with np.errstate(all="ignore"):
            return np.array(np.broadcast_to(eval(self._code, _NAMES, known), shape), dtype=np.float64)

    def derivative(self, variable: str) -> Expression:
        """Return the derivative by a variable, longer than a formula that is read may be.

        Raises:
            ExpressionError: the formula has a function with kinks, abs, min or max, of the variable.
        """
        tree = _derivative(self._tree, variable)
        return Expression(f"d({self.text})/d{variable}", self.variables, ast.Constant(0.0) if tree is None else tree)

    @functools.cached_property
    def _code(self) -> CodeType:
        return _compiled(self._tree)

    def to_freefem(self, rename: Mapping[str, str] | None = None) -> str:
        """Return the formula as FreeFEM text, with other names for variables that are called otherwise there."""
        return _freefem(self._tree, rename or {})[0]


@functools.lru_cache(1024)  # a scene is validated again with every change of a value
def _parsed(text: str, variables: tuple[str, ...]) -> Expression:
    tree = _parse(text)
    _check(tree, variables)
    return Expression(text, variables, tree)


def _parse(text: str) -> ast.expr:
    if not text.strip():
        raise ExpressionError("the formula is empty")
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"the formula has {len(text)} characters, at most {MAX_LENGTH} are accepted")
    found = _FORBIDDEN_CHARACTER.search(text)
    if found:
        raise ExpressionError(f"the character {found.group()!r} is not accepted in a formula")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text.replace("^", "**").strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError("not a formula (operators are + - * / ^, every product needs its *)") from None


def _check(node: ast.expr, variables: tuple[str, ...]) -> None:
    """Raise unless every node of the tree is accepted."""
    check = functools.partial(_check, variables=variables)
    match node:
        case ast.Constant(value=value):
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ExpressionError(f"{value!r} is not a number")
            _number(node)
        case ast.Name(id=name):
            if name in _FUNCTIONS or name in _EXTREMA:
                raise ExpressionError(f'the function "{name}" needs its argument in brackets')
            if name not in variables and name not in _CONSTANTS:
                raise ExpressionError(f'unknown name "{name}"; accepted: {quoted((*variables, *_CONSTANTS))}')
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            check(operand)
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
            check(left)
            check(right)
            if isinstance(operator, ast.Pow):
                _check_exponent(right, variables)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            _check_call(name, arguments)
            for argument in arguments:
                check(argument)
        case _:
            raise ExpressionError(f"{_WORDS.get(type(node), type(node).__name__)} is not accepted in a formula")


_WORDS: dict[type[ast.expr], str] = {
    ast.BinOp: "an operator other than + - * / ^",
    ast.UnaryOp: "an operator other than + - * / ^",
    ast.Call: "such a function call",
    ast.Attribute: "an attribute (a dot behind a name)",
    ast.Tuple: "a list of values",
    ast.Lambda: "a function definition",
    ast.IfExp: "a condition",
    ast.BoolOp: "a condition",
    ast.Compare: "a comparison",
    ast.Starred: "a star before a value",
}


def _check_call(name: str, arguments: list[ast.expr]) -> None:
    accepted = (*_FUNCTIONS, *_EXTREMA)
    if name not in accepted:
        raise ExpressionError(f'unknown function "{name}"; accepted: {quoted(accepted)}')
    if name in _EXTREMA and len(arguments) < 2:
        raise ExpressionError(f'"{name}" takes two or more arguments')
    if name in _FUNCTIONS and len(arguments) != 1:
        raise ExpressionError(f'"{name}" takes one argument')


def _check_exponent(node: ast.expr, variables: tuple[str, ...]) -> None:
    if any(isinstance(inner, ast.Name) and inner.id in variables for inner in ast.walk(node)):
        raise ExpressionError("an exponent must be a constant")
    with np.errstate(all="ignore"):
        exponent = float(eval(_compiled(node), _NAMES))
    if not abs(exponent) <= MAX_EXPONENT:
        raise ExpressionError(
            f"the exponent {number_text(exponent)} is too large, at most {number_text(MAX_EXPONENT)} is accepted"
        )


def _number(node: ast.Constant) -> float:
    value = node.value
    assert isinstance(value, int | float)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ExpressionError("a number is too large")
    return number


class _Numbers(ast.NodeTransformer):
    """Makes every number one of numpy's: they divide by zero and overflow without an exception."""

    def visit_Constant(self, node: ast.Constant) -> ast.Call:
        """Return the call that makes it."""
        return ast.Call(ast.Name("number", ast.Load()), [ast.Constant(_number(node))], [])


def _compiled(tree: ast.expr) -> CodeType:
    """Return the code of a tree that was checked."""
    numbers = _Numbers().visit(copy.deepcopy(tree))
    return compile(ast.fix_missing_locations(ast.Expression(numbers)), "<formula>", "eval")


_SLOPES = {
    "sin": "cos(u)", "cos": "-sin(u)", "tan": "1 + tan(u)**2", "exp": "exp(u)", "log": "1/u", "sqrt": "0.5/sqrt(u)",
    "tanh": "1 - tanh(u)**2",
}  # fmt: skip


def _insert(text: str, **nodes: ast.expr) -> ast.expr:
    """Return a text as a tree, with trees for its names, which it shares."""

    class Names(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.expr:
            return nodes.get(node.id, node)

    result: ast.expr = Names().visit(ast.parse(text, mode="eval").body)
    return result


def _derivative(node: ast.expr, variable: str) -> ast.expr | None:
    """Return the derivative of a tree that was checked; None for zero."""
    match node:
        case ast.Name(id=name) if name == variable:
            return ast.Constant(1.0)
        case ast.UnaryOp(op=operator, operand=operand):
            slope = _derivative(operand, variable)
            return slope and ast.UnaryOp(operator, slope)
        case ast.BinOp(left=left, op=operator, right=right):
            first, second = _derivative(left, variable), _derivative(right, variable)
            if isinstance(operator, ast.Pow):  # the exponent is a constant
                return first and _insert("n*u**(n - 1)*s", n=right, u=left, s=first)
            terms = {
                ast.Add: ("s", "t"), ast.Sub: ("s", "-t"), ast.Mult: ("s*v", "u*t"), ast.Div: ("s/v", "-u*t/v**2"),
            }[type(operator)]  # fmt: skip
            there = [text for text, slope in zip(terms, (first, second), strict=True) if slope is not None]
            known = {"u": left, "v": right, "s": first or left, "t": second or right}
            return _insert(" + ".join(there), **known) if there else None
        case ast.Call(func=ast.Name(id=name), args=arguments):
            slopes = [_derivative(argument, variable) for argument in arguments]
            if not any(slopes):
                return None
            if name not in _SLOPES:
                raise ExpressionError(f'the function "{name}" has no derivative everywhere')
            return _insert(f"({_SLOPES[name]})*s", u=arguments[0], s=slopes[0] or arguments[0])
    return None


def _freefem(node: ast.expr, identifiers: Mapping[str, str]) -> tuple[str, int]:
    """Return a tree as text, and how strongly its outermost operation binds: a sign 0, what has none 4."""

    def bracketed(inner: ast.expr, rank: int) -> str:
        text, own = _freefem(inner, identifiers)
        return text if own >= rank else f"({text})"

    match node:
        case ast.Constant():  # as a float: FreeFEM divides whole numbers without remainder
            return repr(_number(node)), 4
        case ast.Name(id=name):
            return identifiers.get(name, name), 4
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _freefem(operand, identifiers)
        case ast.UnaryOp(operand=operand):
            return f"-{bracketed(operand, 4)}", 0
        case ast.BinOp(left=left, op=operator, right=right):
            sign, rank = _OPERATORS[type(operator)]
            # Same rank on the right needs brackets; powers get them on both sides.
            return f"{bracketed(left, rank + (sign == '^'))} {sign} {bracketed(right, rank + 1)}", rank
        case ast.Call(func=ast.Name(id=name), args=arguments):
            texts = [_freefem(argument, identifiers)[0] for argument in arguments]
            if name in _EXTREMA:  # of two at a time
                return functools.reduce(lambda left, right: f"{name}({left}, {right})", texts), 4
            return f"{name}({texts[0]})", 4
    raise AssertionError(f"unchecked node {type(node).__name__}")
