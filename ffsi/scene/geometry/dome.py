"""The curve of the aneurysm's dome: a cubic spline through the points of its outline, and its offset by the wall."""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from ffsi.files.arrays import Floats

_MILLIMETRE = 1e-3


@dataclass(frozen=True)
class Lumen:
    """Radii of the vessel's lumen (m) and the outline of the dome's lumen from neck to neck, (n, 2) m."""

    radii: tuple[float, float]
    outline: Floats


@functools.cache
def lumen() -> Lumen:
    """Read the geometry (`ffsi/data/aneurysm.json`, where its source is stated)."""
    data = json.loads(files("ffsi").joinpath("data/aneurysm.json").read_text(encoding="utf-8"))
    inner, outer = (round(_MILLIMETRE * radius, 9) for radius in data["lumen_radii"])
    # Rounded to nanometres: a decimal fraction times 0.001 is not always the double that is meant.
    outline = np.round(_MILLIMETRE * np.asarray(data["dome_lumen_outline"]), 9)
    # Its two ends lie on the lumen's circle up to the digits that are printed: onto it.
    outline[[0, -1]] *= outer / np.hypot(*outline[[0, -1]].T)[:, None]
    return Lumen((inner, outer), outline)


@functools.cache
def _spline() -> Any:
    from scipy.interpolate import CubicSpline  # takes a noticeable fraction of a second to load

    points = lumen().outline
    chords = np.hypot(*np.diff(points, axis=0).T)
    return CubicSpline([float(f"{length:.12g}") for length in np.cumsum([0.0, *chords])], points)


def knots() -> Floats:
    """Return the parameters of the outline's points: length of the polygon through them, to 12 digits, m."""
    return np.asarray(_spline().x)


def coefficients() -> Floats:
    """Return the spline's coefficients (2, 4, n): of x and y, of the powers 3 to 0 of the distance to the knot before.

    Rounded to 12 digits, so that a script has the same text wherever it is rendered; those of the power 0 are the
    outline's points.
    """
    digits = np.vectorize(lambda value: float(f"{value:.12g}"))
    found = digits(np.moveaxis(_spline().c, 2, 0))
    found[:, 3] = lumen().outline[:-1].T
    return np.asarray(found)


def curve(s: Floats, offset: float = 0.0) -> Floats:
    """Return points (n, 2) in m of the curve, or of its offset to the outside (m), at parameters s (n,) in m."""
    slope = np.asarray(_spline()(s, 1))
    normal = np.column_stack([slope[..., 1], -slope[..., 0]]) / np.hypot(*slope.T)[:, None]
    return np.asarray(_spline()(s) + offset * normal)


@dataclass(frozen=True)
class Crossing:
    """Where a curve crosses a circle around the origin: parameter (m) and angle (radians) of both points."""

    first: float
    second: float
    first_angle: float
    second_angle: float


@functools.cache
def crossing(radius: float, offset: float = 0.0) -> Crossing:
    """Return where the dome's curve, or its offset, crosses a circle around the vessel's centre; lengths in m."""
    from scipy.optimize import brentq

    end = float(knots()[-1])

    def distance(s: float) -> float:
        return float(np.hypot(*curve(np.array([s]), offset)[0])) - radius

    # The apex is outside of any circle that the neck can touch.
    found = [float(brentq(distance, *bounds, xtol=1e-15)) for bounds in ((0.0, end / 2), (end / 2, end))]
    angles = [math.atan2(y, x) for x, y in curve(np.array(found), offset)]
    return Crossing(*found, *angles)


@functools.cache
def measures(start: float, end: float, offset: float = 0.0) -> tuple[float, float]:
    """Return the length (m) of a part of the curve, and the area (m^2) between it and the origin, its sector."""
    edges = np.unique(np.concatenate([[start], knots()[(knots() > start) & (knots() < end)], [end]]))
    edges = np.interp(np.linspace(0, len(edges) - 1, 40 * (len(edges) - 1) + 1), np.arange(len(edges)), edges)
    points, weights = np.polynomial.legendre.leggauss(5)
    s = (edges[:-1, None] + np.diff(edges)[:, None] * (points + 1) / 2).ravel()
    weight = (np.diff(edges)[:, None] * weights / 2).ravel()
    first, second = _spline()(s, 1), _spline()(s, 2)
    speed = np.hypot(*first.T)
    curvature = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    tangent = first * (1 + offset * curvature)[:, None]  # of the offset curve
    at = curve(s, offset)
    length = float(weight @ np.hypot(*tangent.T))
    return length, float(weight @ (at[:, 0] * tangent[:, 1] - at[:, 1] * tangent[:, 0])) / 2
