"""Tests from the literature that decide, their values and ours: `verify --acid`, results/acid.*."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import brentq, curve_fit

from ffsi.report.curves import dress
from ffsi.result.oscillation import mean_amplitude_frequency
from ffsi.result.pictures import to_small_png
from ffsi.result.views import INK
from studies.harness import Content, Run, Study, run_one, side_by_side
from studies.tables import TextTable, columns, table
from studies.verification.acid_scenes import INNER, OUTER, scenes_of

RUNS = Path("runs/acid")
TABLES, PUBLISHED, VALUES = (Path(__file__).parents[1] / "data" / f"acid{x}" for x in (".toml", ".csv", "_values.csv"))
TESTS: Mapping[str, Mapping[str, Any]] = tomllib.loads(TABLES.read_text(encoding="utf-8"))
Pick = Callable[[pd.DataFrame], float]
Of = Callable[[Mapping[str, Run]], tuple[float, float]]


# Ours -----------------------------------------------------------------------------------------------------------------


def settled(name: str, pick: Pick, extrapolate: bool = False) -> Of:
    """Return ours on the finest of `name-*`, with its changes by mesh and step, or a third of them at second order."""

    def found(runs: Mapping[str, Run]) -> tuple[float, float]:
        coarse, middle, fine = (pick(run.history) for key, run in runs.items() if key.startswith(f"{name}-"))
        mesh, step = middle - coarse, fine - middle
        bar = abs(mesh) + abs(step)
        return (fine + (mesh + step) / 3, bar / 3) if extrapolate else (fine, bar)

    return found


def extreme(kind: str, column: str, start: float = 0.0, end: float = math.inf) -> Pick:
    """Return what picks the `min`, `max` or `mean` of a column between two times, the first before the end if < 0."""

    def pick(history: pd.DataFrame) -> float:
        first = start if start >= 0 else history["time"].max() + start * (1 - 1e-9)
        return float(history.loc[history["time"].between(first, end), column].agg(kind))

    return pick


def late(rule: str, column: str, start: float) -> Pick:
    """Return what picks the mean `amplitude` or `frequency` of the full periods after a time."""

    def pick(history: pd.DataFrame) -> float:
        found: list[float] = []
        while (last := mean_amplitude_frequency(history["time"], history[column])).start >= start:
            found.append(last.amplitude if rule == "amplitude" else 1 / (last.end - last.start))
            history = history[history["time"] < last.start + 0.3 * (last.end - last.start)]
        return float(np.mean(found)) if found else math.nan

    return pick


def extrapolated(runs: Mapping[str, Run]) -> tuple[float, float]:
    """Value of infinitely many elements: the polygons' errors go with h^2 and h^4; the bar is the last change."""
    coarse, middle, fine = (runs[f"cylinder-{n}"].value("tip_ux") for n in (8, 16, 32))
    first, second = middle + (middle - coarse) / 3, fine + (fine - middle) / 3
    return second + (second - first) / 15, abs(second - first)


def inflated() -> float:
    """Displacement of the inside by p = mu [ln(la/lb) + c/2 (1/a^2 - 1/b^2)], c = a^2 - A^2, la = a/A, lb = b/B."""
    inner, outer, scene = INNER, OUTER, TESTS["cylinder"]["scene"]
    load = scene["loads"]["inside"]["pressure"] / scene["solid"]["rubber"]["lame_mu"]

    def missing(a: float) -> float:
        c = a**2 - inner**2
        b = math.sqrt(outer**2 + c)
        return float(math.log(a / inner * outer / b) + c / 2 * (1 / a**2 - 1 / b**2) - load)

    return float(brentq(missing, inner, 3 * inner, xtol=1e-15)) - inner


def swing(omega: float, sigma: float, which: int) -> Pick:
    """Return what fits exp(sigma t) cos(omega t + phase) + offset after two periods, and picks omega or sigma."""

    def pick(history: pd.DataFrame) -> float:
        late = history[history["time"] > 4 * np.pi / omega]

        def mode(t: Any, omega: float, sigma: float, even: float, odd: float, offset: float) -> Any:
            return np.exp(sigma * t) * (even * np.cos(omega * t) + odd * np.sin(omega * t)) + offset

        found, _ = curve_fit(mode, late["time"], late["tip_ux"] / AMPLITUDE, (omega, sigma, 1.0, 0.0, 0.0))
        return float(found[which])

    return pick


def worst(runs: str, column: str, scale: float) -> Pick:
    """Return what picks the largest difference from the published history, by a scale."""

    def pick(history: pd.DataFrame) -> float:
        known = published(runs)
        ours = np.interp(known["t"], [0, *history["time"]], [0, *history[column]])
        return float(np.abs(ours - known["value"]).max() / scale)

    return pick


def published(runs: str) -> pd.DataFrame:
    """Return the published histories beside the runs of a series: `curve`, `t`, `value`, SI."""
    rows = pd.read_csv(PUBLISHED)
    return rows[rows["runs"] == runs]


def thin(pick: Pick) -> Of:
    """Return ours of a leaflet without thickness, by a line through the two thinnest.

    The bar has the change from the line through the others, and those by mesh and step, which a parabola would enlarge.
    """

    def found(runs: Mapping[str, Run]) -> tuple[float, float]:
        thick, middle, fine = (pick(run.history) for name, run in runs.items() if name.endswith("-2-0.01"))
        first, second = 2 * middle - thick, 2 * fine - middle
        return second, abs(second - first) + settled("leaflet-0.025", pick)(runs)[1]

    return found


def resting(quantity: str) -> Of:
    """Return ours of the steady blob, and the change by the mesh."""

    def found(runs: Mapping[str, Run]) -> tuple[float, float]:
        coarse, fine = (runs[f"blob-{n}"].value(quantity) for n in (2, 4))
        return fine, abs(fine - coarse)

    return found


def above_outline(history: pd.DataFrame) -> float:
    """Height of the blob's top at 1 s above Liu's outline there (arXiv:1401.0082, Fig. 5.3)."""
    last = history.iloc[-1]
    return float(last["tip_uy"] - np.interp(1.5 + last["tip_ux"], [1.55369, 1.57912], [-0.00833, -0.00888]))


# What is expected -----------------------------------------------------------------------------------------------------

MODES = {14: (2.42565010410, -1.1209667e-2), 140: (1.75739835109, -5.1717531e-2), 1400: (0.71317305386, -6.0295735e-2)}
"""Omega and sigma of the linear modes by density, 1/s: roots of a determinant of Bessel functions."""
PEAK, AMPLITUDE = 0.216, 5e-4  # of the collapsible wall, and with which the ring is let go, m


def pick_of(row: Any) -> Pick:
    """Return what the rule of a row of `VALUES` picks."""
    if row.rule in ("omega", "sigma"):
        return swing(*MODES[int(row.runs.split("-")[1])], int(row.rule == "sigma"))
    if row.rule in ("history", "outline"):
        return worst(row.runs, row.column, PEAK) if row.rule == "history" else above_outline
    if row.rule in ("amplitude", "frequency"):
        return late(row.rule, row.column, row.start)
    return extreme(row.rule, row.column, row.start, row.end)


def of_row(row: Any) -> Of:
    """Return what makes ours of the runs."""
    if row.test in ("cylinder", "leaflet"):
        return extrapolated if row.test == "cylinder" else thin(pick_of(row))
    return resting(row.column) if row.runs == "blob" else settled(row.runs, pick_of(row), row.test == "ring")


def expected(test: str) -> list[Any]:
    """Return the values of a test that stand in `VALUES`: their rows, with the columns as attributes."""
    rows = pd.read_csv(VALUES, dtype={"expected": str, "others": str})
    rows = rows.rename(columns={"from": "start", "to": "end"}).fillna(
        {"others": "", "runs": "", "rule": "", "column": "", "start": 0.0, "end": math.inf}
    )
    return list(rows[rows["test"] == test].itertuples())


def inside(value: Any, ours: float, bar: float) -> str:
    """Return whether a number lies in the band of a value."""
    if math.isnan(value.low):
        return "no band"
    if value.low <= ours <= value.high:
        return "yes"
    return "with its bar" if value.low - bar <= ours <= value.high + bar else "no"


COLUMNS = columns("quantity | published or exact = expected | other programs = others | ours :.8g | bar :.1e | inside")


# The report -----------------------------------------------------------------------------------------------------------


def main(jobs: int = 1, runs: Path = RUNS, out: Path | None = None) -> list[str]:
    """Run every test, or what is missing of it; return the failures of its runs.

    Args:
        jobs: runs at a time.
        runs: their folders, kept.
        out: folder of acid.md, acid.csv and acid.png.
    """
    study = Study("verify --acid", out, name="acid")
    tests: list[tuple[Mapping[str, Any], TextTable, Mapping[str, Run]]] = []
    rows: list[Mapping[str, Any]] = []
    every: dict[str, Run] = {}
    for key, test in TESTS.items():
        scenes = scenes_of(key, test, runs / "meshes")
        done = side_by_side({n: partial(run_one, n, s, runs / n) for n, s in scenes.items()}, jobs, test["title"])
        found = [_row(value, done) for value in expected(key)]
        tests.append((test, table(found, COLUMNS, title=test["title"]), done))
        every |= done
        rows += found
    files: dict[str, Content] = {"acid.csv": lambda: pd.DataFrame(rows), "acid.png": lambda: to_small_png(draw(every))}
    return study.finish([run.data for run in every.values()], [shown for _, shown, _ in tests], files, tests=tests)


def draw(runs: Mapping[str, Run]) -> Figure:
    """Draw histories of ours beside published ones."""
    figure = Figure(figsize=(9.6, 6.4), layout="constrained", facecolor="white")
    shown = [(test["title"], *test["drawn"]) for test in TESTS.values() if "drawn" in test]
    for axes, (title, name, column, label) in zip(figure.subplots(2, 2).flat, shown, strict=True):
        history = runs[name].history
        for curve, known in published(name.rsplit("-", 2)[0]).groupby("curve", sort=False):
            axes.plot(known["t"], known["value"], "o", markersize=3, markerfacecolor="none", label=curve)
        axes.plot(history["time"], history[column], color=INK, linewidth=0.9, label="ours")
        axes.legend(frameon=False, fontsize=8)
        dress(axes, title, "t, s", label)
    return figure


def _row(value: Any, runs: Mapping[str, Run]) -> dict[str, Any]:
    ours, bar = (math.nan, math.nan) if any(run.failure for run in runs.values()) else of_row(value)(runs)
    return {
        "test": value.test, "quantity": value.quantity, "expected": value.expected, "others": value.others or None,
        "ours": ours, "bar": bar, "inside": inside(value, ours, bar),
    }  # fmt: skip
