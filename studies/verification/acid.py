"""Tests from the literature that decide, on structured meshes of their own: `verify --acid`, results/acid.*."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pandas as pd

from ffsi.files.arrays import Floats
from ffsi.scene import Scene
from studies.harness import Run, Study, run_one, side_by_side
from studies.tables import columns, markdown, table

Curve = Callable[[float, float], str]
"""Name of the boundary on which the middle of an edge, or of the region in which a point, lies; empty in none."""
RUNS = Path("runs/acid")


@dataclass(frozen=True)
class Value:
    """A number of a test: the published or exact one with its band, ours by run, and where it comes from."""

    test: str
    name: str
    expected: str
    low: float
    high: float
    of: Callable[[Mapping[str, Run]], tuple[float, float]]  # ours, and its error bar
    others: str = ""


@dataclass(frozen=True)
class Test:
    """Scenes by the name of their run, and what is looked at."""

    name: str
    said: str
    scenes: Callable[[Path], Mapping[str, Scene]]
    values: Sequence[Value]


# Meshes -----------------------------------------------------------------------------------------------------------


def grid(
    path: Path, x: Floats, y: Floats, region: Callable[[float, float], str], curve: Curve, turn: bool = False
) -> Path:
    """Write a mesh of the rectangles between grid lines, each split in two; with `turn` x is a radius, y an angle."""
    nx, triangles, regions = len(x), [], []
    for j in range(len(y) - 1):
        for i in range(nx - 1):
            if name := region((x[i] + x[i + 1]) / 2, (y[j] + y[j + 1]) / 2):
                a = j * nx + i
                b, c, d = a + 1, a + 1 + nx, a + nx
                triangles += [(a, b, c), (a, c, d)] if (i + j) % 2 == 0 else [(a, b, d), (b, c, d)]
                regions += [name, name]
    flat = np.column_stack([axis.ravel() for axis in np.meshgrid(x, y)])
    sides = np.sort(np.array(triangles)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    outer = edges[count == 1]
    named = [(edge, name) for edge in outer if (name := curve(*flat[edge].mean(axis=0)))]
    points = flat
    if turn:
        points = flat[:, :1] * np.column_stack([np.cos(flat[:, 1]), np.sin(flat[:, 1])])
        points[np.isclose(flat[:, 1], np.pi / 2), 0] = 0
    surfaces, lines = sorted(set(regions)), sorted({name for _, name in named})
    data = [np.array([surfaces.index(name) + 1 for name in regions]), np.array([lines.index(n) + 1 for _, n in named])]
    path.parent.mkdir(parents=True, exist_ok=True)
    meshio.Mesh(
        points,
        [("triangle", np.array(triangles)), ("line", np.array([edge for edge, _ in named]))],
        cell_data={"gmsh:physical": data, "gmsh:geometrical": data},
        field_data={name: np.array([i + 1, 2]) for i, name in enumerate(surfaces)}
        | {name: np.array([i + 1, 1]) for i, name in enumerate(lines)},
    ).write(path, file_format="gmsh22")
    return path


def scene(name: str, mesh: Path, regions: Mapping[str, str], boundaries: Mapping[str, Any], **tables: Any) -> Scene:
    """Return a scene on a mesh of `grid`."""
    tip = tables.pop("tip")
    geometry = {"kind": "mesh", "file": str(mesh), "regions": regions, "boundaries": boundaries, "tip": tip}
    plain = {"output": {"pictures": False, "vtu": False}}
    return Scene.model_validate({"name": name, "geometry": geometry, **plain, **tables})


# A cylinder under pressure ------------------------------------------------------------------------------------------

INNER, OUTER, SHEAR, PRESSURE = 1.0, 2.0, 1.0, 0.4


def cylinder(folder: Path) -> Mapping[str, Scene]:
    """A quarter of a thick incompressible neo-Hookean cylinder between its lines of symmetry, on three meshes."""
    law = {"material": "neo-hookean", "formulation": "incompressible", "density": 1.0, "lame_mu": SHEAR}

    def curve(r: float, angle: float) -> str:
        return {0.0: "x", np.pi / 2: "y"}.get(angle) or {INNER: "inside", OUTER: "outside"}.get(r, "")

    found = {}
    for n in (8, 16, 32):
        radii, angles = np.linspace(INNER, OUTER, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1)
        mesh = grid(folder / f"cylinder{n}.msh", radii, angles, lambda r, angle: "rubber", curve, turn=True)
        found[f"cylinder-{n}"] = scene(
            "acid-cylinder", mesh, {"rubber": "rubber"}, {"symmetry": ["x", "y"], "loaded": "inside"},
            tip={"x": INNER, "y": 0.0}, solid={"rubber": law}, loads={"inside": {"pressure": PRESSURE}},
        )  # fmt: skip
    return found


def inflated() -> float:
    """Displacement of the inside by p = mu [ln(la/lb) + c/2 (1/a^2 - 1/b^2)], c = a^2 - A^2, la = a/A, lb = b/B."""

    def missing(a: float) -> float:
        c = a**2 - INNER**2
        b = math.sqrt(OUTER**2 + c)
        return SHEAR * (math.log(a / INNER * OUTER / b) + c / 2 * (1 / a**2 - 1 / b**2)) - PRESSURE

    low, high = INNER, 3 * INNER
    for _ in range(100):
        low, high = ((low + high) / 2, high) if missing((low + high) / 2) < 0 else (low, (low + high) / 2)
    return low - INNER


def extrapolated(runs: Mapping[str, Run]) -> tuple[float, float]:
    """Value of infinitely many elements: the polygons' errors go with h^2 and h^4; the bar is the last change."""
    coarse, middle, fine = (runs[f"cylinder-{n}"].value("tip_ux") for n in (8, 16, 32))
    first, second = middle + (middle - coarse) / 3, fine + (fine - middle) / 3
    return second + (second - first) / 15, abs(second - first)


# Lid-driven cavity with a flexible bottom, group B ------------------------------------------------------------------


def mok(folder: Path) -> Mapping[str, Scene]:
    """Two meshes and two steps."""
    return {f"mok-{n}-{step}": mok_scene(folder, n, step, 45.0) for n, step in ((16, 0.1), (32, 0.1), (32, 0.05))}


def mok_scene(folder: Path, n: int, step: float, end: float) -> Scene:
    """Return the cavity with n x n rectangles, and its membrane of two rows under it."""
    thick = 0.002

    def curve(x: float, y: float) -> str:
        if x in (0.0, 1.0):
            return "ends" if y < 0 else {0.0: "in", 1.0: "out"}[x] if y > 0.875 else "sides"
        return {1.0: "lid"}.get(y, "")

    membrane = {"material": "st-venant-kirchhoff", "density": 500.0, "young_modulus": 250.0, "poisson_ratio": 0.0}
    lines = np.linspace(0, 1, n + 1)
    rows = np.concatenate([[-thick, -thick / 2], lines])
    mesh = grid(folder / f"mok{n}.msh", lines, rows, lambda x, y: "water" if y > 0 else "membrane", curve)
    return scene(
        "acid-mok", mesh, {"fluid": "water", "bottom": "membrane"},
        {"inlet": "in", "outlet": "out", "walls": ["sides", "lid"], "clamped": "ends"},
        tip={"x": 0.5, "y": -thick / 2},
        walls={"lid": {"velocity_x": 1.0}},
        fluid={"density": 1.0, "viscosity": 0.01},
        solid={"bottom": membrane},
        inflow={"mean_velocity": 0.5, "profile": "2*y/H", "waveform": "1-cos(2*pi*t/5)", "period": 5.0},
        outlet={"kind": "do-nothing"},
        time={"step": step, "end": end, "checkpoint_interval": 5.0},
    )  # fmt: skip


def of_cycle(pick: Callable[[Floats], float]) -> Callable[[Mapping[str, Run]], tuple[float, float]]:
    """Return ours of the last cycle, and the sum of its changes by mesh and by step."""

    def found(runs: Mapping[str, Run]) -> tuple[float, float]:
        values = []
        for name in ("mok-16-0.1", "mok-32-0.1", "mok-32-0.05"):
            history = runs[name].history
            last = history[history["time"] > history["time"].max() - 5 * (1 - 1e-9)]
            values.append(pick(last["tip_uy"].to_numpy()))
        return values[2], abs(values[1] - values[0]) + abs(values[2] - values[1])

    return found


# Perpendicular flap -------------------------------------------------------------------------------------------------


def flap(folder: Path) -> Mapping[str, Scene]:
    """Two meshes and two steps, of a linear elastic solid."""
    return {f"flap-{n}-{step}": flap_scene(folder, n, step) for n, step in ((1, 0.02), (2, 0.02), (2, 0.01))}


def flap_scene(folder: Path, n: int, step: float) -> Scene:
    """Return the channel with 2 n elements across the flap."""
    half = 0.05

    def curve(x: float, y: float) -> str:
        if y in (0.0, 4.0):
            return "root" if y == 0 and abs(x) < half else "walls"
        return {-3.0: "in", 3.0: "out"}.get(x, "")

    away = half + (3 - half) * np.linspace(0, 1, 12 * n + 1) ** 2
    x = np.concatenate([-away[::-1], np.linspace(-half, half, 2 * n + 1)[1:-1], away])
    y = np.concatenate([np.linspace(0, 1, 10 * n + 1), 1 + 3 * np.linspace(0, 1, 8 * n + 1)[1:] ** 1.5])
    mesh = grid(folder / f"flap{n}.msh", x, y, lambda x, y: "steel" if abs(x) < half and y < 1 else "water", curve)
    solid = {"material": "linear-elastic", "density": 3000.0, "young_modulus": 4e6, "poisson_ratio": 0.3}
    return scene(
        "acid-flap", mesh, {"fluid": "water", "flap": "steel"},
        {"inlet": "in", "outlet": "out", "walls": "walls", "clamped": "root"}, tip={"x": 0.0, "y": 1.0},
        fluid={"density": 1.0, "viscosity": 1.0}, solid={"flap": solid},
        inflow={"mean_velocity": 10.0, "profile": "uniform"}, outlet={"kind": "do-nothing"},
        time={"step": step, "end": 2.6},
    )  # fmt: skip


def of_swing(pick: Callable[[Floats, Floats], float]) -> Callable[[Mapping[str, Run]], tuple[float, float]]:
    """Return ours, and the sum of its changes by mesh and by step."""

    def found(runs: Mapping[str, Run]) -> tuple[float, float]:
        histories = [runs[name].history for name in ("flap-1-0.02", "flap-2-0.02", "flap-2-0.01")]
        values = [pick(each["time"].to_numpy(), each["tip_ux"].to_numpy()) for each in histories]
        return values[2], abs(values[1] - values[0]) + abs(values[2] - values[1])

    return found


# ----------------------------------------------------------------------------------------------------------------------

EXACT = inflated()
NEAR = EXACT * (1 - 1e-6), EXACT * (1 + 1e-6)
FINEST = "0.262 to 0.289; finest 0.2861, heading to 0.285"
FIRST = "0.1950 to 0.1956 (Nutils), 0.1983 to 0.1991 (OpenFOAM)"
CYCLE = [
    Value("mok", "largest u_y of a cycle, m", FINEST, 0.26, 0.29, of_cycle(np.max), "0.2695, 0.2619, 0.2769, 0.2861"),
    Value("mok", "smallest u_y of a cycle, m", "0.195 to 0.206", 0.195, 0.206, of_cycle(np.min),
          "0.1967, 0.2033, –, 0.2044"),
    Value("mok", "mean u_y of a cycle, m", "0.231 to 0.248", 0.231, 0.248, of_cycle(np.mean),
          "0.2321, 0.2316, 0.2466, 0.2445"),
]  # fmt: skip
SWING = [
    Value("flap", "first largest u_x, m", "0.1949 to 0.1992", 0.1949, 0.1992, of_swing(lambda t, u: u[t < 1.2].max()),
          FIRST),
    Value("flap", "first smallest u_x, m", "-0.0023 to -0.0013", -0.0023, -0.0013,
          of_swing(lambda t, u: u[t > 1].min()), "-0.0021 to -0.0023, -0.0013 to -0.0018"),
    Value("flap", "second largest u_x, m", "0.180 to 0.1863", 0.18, 0.1863, of_swing(lambda t, u: u[t > 1.9].max()),
          "0.1801 to 0.1830, 0.1834 to 0.1862"),
]  # fmt: skip
TESTS = [
    Test(
        "Cylinder under inner pressure",
        "Incompressible neo-Hookean, plane strain, a pressure that follows the inside, radii 1 and 2, p = 0.4 mu; in "
        "closed form. Of 8, 16 and 32 elements across, extrapolated.",
        cylinder, [Value("cylinder", "u_r inside, m", f"{EXACT:.9f} (exact)", *NEAR, extrapolated)],
    ),
    Test(
        "Lid-driven cavity with a flexible bottom",
        "Group B: the inflow opposite to the outlet grows linearly to the lid's velocity 1 - cos(2 pi t/5). Others: "
        "Valdes 2007, Kratos, Tiba et al. 2026, solids4foam on 96² cells. Here 16² and 32² rectangles, steps of 0.1 "
        "and 0.05 s.",
        mok, CYCLE,
    ),
    Test(
        "Perpendicular flap",
        "preCICE's tutorial: its pairs of programs, all with small-strain solids, agree to 2 or 3 %; Nutils with "
        "deal.II, CalculiX and FEniCS starts from rest, as here, OpenFOAM at full speed. Two and four elements across, "
        "steps of 0.02 and 0.01 s.",
        flap, SWING,
    ),
]  # fmt: skip
COLUMNS = columns("quantity | published or exact = expected | other programs = others | ours :.8g | bar :.1e | inside")


def main(jobs: int = 1, runs: Path = RUNS, out: Path | None = None) -> list[str]:
    """Run every test, or what is missing of it; return the failures of its runs.

    Args:
        jobs: runs at a time.
        runs: their folders, kept.
        out: folder of acid.md and acid.csv.
    """
    study = Study("verify --acid", out)
    parts: list[Any] = []
    rows, failures, every = [], [], []
    for test in TESTS:
        scenes = test.scenes(runs / "meshes")
        done = side_by_side({n: partial(run_one, n, s, runs / n) for n, s in scenes.items()}, jobs, test.name)
        failures += [run.failure for run in done.values()]
        every += [run.data for run in done.values()]
        found = [_row(value, done) for value in test.values]
        rows += found
        seconds = ", ".join(f"{name} {run.seconds:.0f} s" for name, run in done.items())
        check = max(run.check_maximum for run in done.values())
        parts += [
            f"## {test.name}", test.said, table(found, COLUMNS),
            f"Seconds: {seconds}. Largest number of the checker: {check:.1e}.",
        ]  # fmt: skip
        table(found, COLUMNS, title=test.name).print()
    head = ["# Acid tests", study.written(every) + " Bar: what mesh and step still change."]
    study.write({"acid.md": lambda: markdown([*head, *parts]) + "\n", "acid.csv": lambda: pd.DataFrame(rows)})
    return failures


def _near(value: Value, ours: float, bar: float) -> bool:
    return value.low - bar <= ours <= value.high + bar


def _row(value: Value, runs: Mapping[str, Run]) -> dict[str, Any]:
    ours, bar = (math.nan, math.nan) if any(run.failure for run in runs.values()) else value.of(runs)
    inside = "yes" if value.low <= ours <= value.high else "with its bar" if _near(value, ours, bar) else "no"
    return {
        "test": value.test, "quantity": value.name, "expected": value.expected, "others": value.others or None,
        "ours": ours, "bar": bar, "inside": inside,
    }  # fmt: skip
