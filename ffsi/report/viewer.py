"""Fields of one state as numbers for the viewer in a report, which draws them on a canvas."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from matplotlib import colormaps

from ffsi.files.arrays import Floats, read_state
from ffsi.hemodynamics.result import Result
from ffsi.hemodynamics.stress import effective_stress
from ffsi.result import gradients
from ffsi.result.fields import FLUID, Fields

DIGITS = 14
"""Bits of a value's mantissa that are kept: four decimal digits, which is what the viewer shows."""
_SIGNED = 0.2  # quotient of the ends of a range above which zero is in the middle of the colours
_PART = 0.5  # percent of the values at either end that lie outside of the colours' range


def scalars(result: Result, state: str) -> dict[str, tuple[str, Floats]]:
    """Return unit and values (n,) at the nodes of every field, NaN where there is none of it, by name."""
    fields = result.read_fields(state)
    wet = np.isin(np.arange(len(fields.points)), fields.cells[fields.region == FLUID])
    solid = np.isin(np.arange(len(fields.points)), fields.cells[fields.region != FLUID])
    found: dict[str, tuple[str, Floats]] = {}
    if fields.has_fluid:
        found["speed"] = "m/s", np.where(wet, np.hypot(*fields.velocity.T), np.nan)
        found["velocity x"], found["velocity y"] = (("m/s", np.where(wet, v, np.nan)) for v in fields.velocity.T)
        found["pressure"] = "Pa", np.where(wet, fields.pressure, np.nan)
        found["vorticity"] = "1/s", gradients.vorticity(fields)
    if fields.has_solid:
        found["displacement"] = "m", np.where(solid, np.hypot(*fields.displacement.T), np.nan)
        found["displacement x"], found["displacement y"] = (
            ("m", np.where(solid, u, np.nan)) for u in fields.displacement.T
        )
        found["effective stress"] = "Pa", stress_in_solids(result, state, fields)
    return found


def stress_in_solids(result: Result, state: str, fields: Fields) -> Floats:
    """Return the effective stress (n,) in Pa at the nodes, the larger one at a node of two solids; NaN elsewhere."""
    mesh = result.raw_mesh
    found = effective_stress(result.scene, mesh, read_state(result.directory / state, mesh))
    return np.asarray(np.fmax.reduce([*found.values(), np.full(len(fields.points), np.nan)]))


def encode(fields: Fields, values: dict[str, tuple[str, Floats]]) -> dict[str, Any]:
    """Return what the viewer needs, for JSON: names, units and ranges, and the numbers compressed as base64.

    The numbers are x and y of the nodes on the deformed mesh (m), each field's values (float32), and the six nodes of
    every triangle (int32), one after the other.
    """
    parts = [fields.deformed.T.astype("<f4").tobytes()]
    entries = []
    for name, (unit, at_nodes) in values.items():
        there = at_nodes[np.isfinite(at_nodes)]
        if not there.size:
            continue
        low, high = np.percentile(there, [_PART, 100 - _PART])
        signed = bool(low < 0 < high and min(-low, high) > _SIGNED * max(-low, high))
        if signed:
            low, high = -max(-low, high), max(-low, high)
        entries.append({"name": name, "unit": unit, "low": low, "high": high, "signed": signed})
        parts.append(_rounded(at_nodes).tobytes())
    parts.append(fields.cells.astype("<i4").tobytes())
    palettes = {
        name: base64.b64encode((colormaps[name](np.linspace(0, 1, 256))[:, :3] * 255).round().astype("u1").tobytes())
        for name in ("viridis", "RdBu_r")
    }
    return {
        "fields": entries,
        "nodes": len(fields.points),
        "cells": len(fields.cells),
        "plain": palettes["viridis"].decode("ascii"),
        "signed": palettes["RdBu_r"].decode("ascii"),
        "data": base64.b64encode(zlib.compress(b"".join(parts), 9)).decode("ascii"),
    }


def _rounded(values: Floats) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Return values as float32 whose last bits are zero, which compresses better."""
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.round(mantissa * 2**DIGITS) / 2**DIGITS, exponent), dtype="<f4")
