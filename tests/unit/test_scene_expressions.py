"""Formulas: values against numpy, FreeFEM text, and what is refused."""

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ffsi.scene import CASES, load_scene
from ffsi.scene.expressions import Expression, ExpressionError

Y = np.linspace(0.01, 0.4, 23)
H = 0.41


@pytest.mark.parametrize(("text", "function", "freefem"), [
    ("6*y*(H-y)/H^2", lambda y: 6 * y * (H - y) / H**2, "6.0 * y * (H - y) / H ^ 2.0"),
    ("-y^2", lambda y: -(y**2), "-(y ^ 2.0)"), ("(-y)**2", lambda y: y**2, "(-y) ^ 2.0"),
    ("2^-1", lambda y: 0.5 + 0 * y, "2.0 ^ (-1.0)"), ("1/2", lambda y: 0.5 + 0 * y, "1.0 / 2.0"),
    ("2^3^2", lambda y: 512 + 0 * y, "2.0 ^ (3.0 ^ 2.0)"), ("(2^3)^2", lambda y: 64 + 0 * y, "(2.0 ^ 3.0) ^ 2.0"),
    ("H - (y - 1)", lambda y: H - (y - 1), "H - (y - 1.0)"), ("H/(y/2)", lambda y: H / (y / 2), "H / (y / 2.0)"),
    ("H - -y", lambda y: H + y, "H - (-y)"), ("--y", lambda y: y, "-(-y)"), ("+y", lambda y: y, "y"),
    ("y^(1/7)", lambda y: y ** (1 / 7), "y ^ (1.0 / 7.0)"),
    ("min(y, 0.2, H/3)", lambda y: np.minimum(y, H / 3), "min(min(y, 0.2), H / 3.0)"),
    ("max(y, 0.2)*1e-5", lambda y: np.maximum(y, 0.2) * 1e-5, "max(y, 0.2) * 1e-05"),
    ("sin(pi*y/H) + cos(y)", lambda y: np.sin(np.pi * y / H) + np.cos(y), "sin(pi * y / H) + cos(y)"),
    ("tan(y)*exp(-y)", lambda y: np.tan(y) * np.exp(-y), "tan(y) * exp(-y)"),
    ("log(y) - sqrt(y)", lambda y: np.log(y) - np.sqrt(y), "log(y) - sqrt(y)"),
    ("abs(y - H/2) + tanh(3*y)", lambda y: np.abs(y - H / 2) + np.tanh(3 * y), "abs(y - H / 2.0) + tanh(3.0 * y)"),
])  # fmt: skip
def test_value_and_freefem_text(text: str, function: Callable[[Any], Any], freefem: str) -> None:
    expression = Expression.parse(text)
    values = expression.evaluate(y=Y, H=H)
    assert values.shape == Y.shape
    np.testing.assert_allclose(values, function(Y), rtol=1e-14, atol=0.0)
    assert expression.to_freefem() == freefem


def test_other_names_of_variables_and_undefined_values() -> None:
    expression = Expression.parse("y*(H-y)")
    assert expression.to_freefem({"H": "height"}) == "y * (height - y)"
    assert Expression.parse("2*t", ["t"]).evaluate(t=3.0) == 6.0
    with pytest.raises(ExpressionError, match='unknown name "y"'):
        Expression.parse("y", ["t"])
    with pytest.raises(TypeError, match="needed"):
        Expression.parse("y").evaluate(y=1.0)
    values = Expression.parse("1/y + sqrt(y - 1)").evaluate(y=[0.0, 2.0], H=1.0)
    assert not np.isfinite(values[0]) and values[1] == 1.5


REFUSED = [
    ('exec("rm -rf /")', "character '\"'"), ("exec(y)", 'unknown function "exec"'),
    ("system(y)", 'unknown function "system"'), ("1;exec(y)", "character ';'"),
    ("__import__(y)", 'unknown function "__import__"'), ("__import__('os').system('ls')", 'character "\'"'),
    ("y.real", "attribute"), ("y.__class__", "attribute"), ("(y).real()", "function call"),
    ("sin(y)(y)", "function call"), ("y[0]", r"character '\['"), ("lambda: 1", "character ':'"),
    ("y < 1", "character '<'"), ("y = 1", "character '='"), ("1 if y else 2", "condition"), ("y and H", "condition"),
    ("not y", "operator"), ("y // 2", "operator"), ("y % 2", "character '%'"), ("y @ y", "character '@'"),
    ("(y, H)", "list of values"), ("min(*y)", "two or more"), ("min(y)", "two or more"), ("sin(y, y)", "one argument"),
    ("sin()", "one argument"), ("sin", "argument in brackets"), ("x + y", 'unknown name "x"'),
    ("e", 'unknown name "e"'), ("True", "not a number"), ("1j", "not a number"), ("...", "not a number"),
    ("2^1000", "exponent 1000 is too large"), ("9^9^9", "too large"), ("2^-17", "too large"), ("2^(1/0)", "too large"),
    ("2^y", "exponent must be a constant"), ("1e999", "too large"), ("9" * 199 + "9" * 199, "at most 200"),
    ("y # comment", "character '#'"), ("y\nexec(y)", r"character '\\n'"), ("2 y", "not a formula"),
    ("(y", "not a formula"), ("*" * 10, "not a formula"), ("(" * 199, "not a formula"),
    ("-" * 198 + "*", "not a formula"), ("", "empty"), ("   ", "empty"), ("ｙ", "character"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "reason"), REFUSED, ids=[text[:20] for text, _ in REFUSED])
def test_refused(text: str, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "system", lambda command: pytest.fail("executed"))
    with pytest.raises(ExpressionError, match=reason):
        Expression.parse(text)


def test_long_chains_and_inflow_profiles() -> None:
    assert Expression.parse("-" * 199 + "y").evaluate(y=2.0, H=1.0) == -2.0
    scene, y = CASES["flap-svk"], np.linspace(0.0, 0.4, 5)
    np.testing.assert_allclose(scene.inflow_profile()(y), 1.5 * 0.12 * 4 * y * (0.4 - y) / 0.4**2, rtol=1e-14)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    assert weights @ scene.inflow_profile()(0.2 + 0.2 * nodes) / 2 == pytest.approx(0.12, rel=1e-14)
    uniform = load_scene("flap-svk", ["inflow.profile=uniform"])
    np.testing.assert_array_equal(uniform.inflow_profile()(y), np.full(5, 0.12))
    own = load_scene("flap-svk", ["inflow.profile=(y/H)^2"])
    np.testing.assert_allclose(own.inflow_profile()(y), 0.12 * (y / 0.4) ** 2, rtol=1e-14)
