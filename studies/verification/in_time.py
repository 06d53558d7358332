"""`verify --unsteady`: cases in time beside published values; `verify --long`: whether large oscillations stay."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ffsi.report.curves import LINES, MARKERS, dress
from ffsi.report.history import time_history
from ffsi.result.in_time import last_period
from ffsi.result.oscillation import BLOCK as PERIODS
from ffsi.result.oscillation import blocks, reference_column
from ffsi.result.pictures import FAINT, to_small_png
from ffsi.result.published import references
from ffsi.result.views import INK
from ffsi.scene import CASES, Scene, load_scene
from studies.harness import PLAIN, Content, Place, Run, Study, run_all
from studies.tables import Column, TextTable, bounded, columns, logarithmic, table

RUNS = Path("runs/verify")
LARGEST = 40_000
"""Unknowns, at most, of the meshes that the bounds are meant for."""
SHOWN_PERIODS = 2.5
SIGNALS = {"tip_uy": "$u_y$ of the tip (m)", "lift": "lift (N/m)"}


@dataclass(frozen=True)
class Compared:
    """A number of a periodic quantity, beside its published value."""

    quantity: str  # as in `result.json`
    part: str  # `mean`, `amplitude`, `frequency`, `maximum` or `peak-to-peak`, all over the last period
    bound: float  # largest accepted relative error, dimensionless
    title: str  # heading of its column

    @property
    def name(self) -> str:
        """Name of its columns in the CSV."""
        return f"{self.quantity}_{self.part.replace('-', '_')}"

    def value(self, quantities: Mapping[str, Any]) -> float:
        """Return the number from the quantities of a run (SI); NaN if the run has no period."""
        parts = quantities.get(self.quantity)
        names = ("mean", "amplitude", "frequency")
        known: Mapping[str, Any] = parts if isinstance(parts, Mapping) else {}
        numbers = {name: math.nan if known.get(name) is None else float(known[name]) for name in names}
        mean, amplitude, _ = numbers.values()
        return {**numbers, "maximum": mean + amplitude, "peak-to-peak": 2 * amplitude}[self.part]

    def published(self, case: str) -> float:
        """Return the published number, SI; KeyError: there is none."""
        return self.value({self.quantity: vars(references(case)[self.quantity])})

    def error(self, case: str, quantities: Mapping[str, Any]) -> float:
        """Return (value - published) / |published|; NaN if the run has no period."""
        published = self.published(case)
        return (self.value(quantities) - published) / abs(published)


@dataclass(frozen=True)
class PeriodicCase:
    """A case of the catalogue that is run until it is periodic, on several meshes and with several time steps."""

    name: str  # of the case
    compared: tuple[Compared, ...]  # what is compared
    coarser: tuple[int, ...] = (0, 1)  # the meshes, as levels below the catalogue's
    parts: tuple[float, ...] = (1.0, 2.0)  # the time steps, as parts of the catalogue's

    @property
    def plans(self) -> list[Plan]:
        """Every mesh with every time step, those of the catalogue first."""
        scene = CASES[self.name]
        assert scene.time is not None
        levels = [scene.mesh.level - down for down in self.coarser if scene.mesh.level >= down]
        return [Plan(self, level, scene.time.step * part) for level in levels for part in self.parts]


@dataclass(frozen=True)
class Plan:
    """One run: mesh level and time step (s)."""

    case: PeriodicCase
    level: int
    step: float

    @property
    def name(self) -> str:
        """Name in notes, and of the run folder."""
        return f"{self.case.name}-level-{self.level}-step-{self.step:g}"

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return load_scene(self.case.name, [f"mesh.level={self.level}", f"time.step={self.step!r}", *PLAIN])


PERIODIC_CASES = tuple(
    PeriodicCase(str(name), tuple(Compared(*row) for row in own.drop(columns="case").itertuples(index=False)))
    for name, own in pd.read_csv(Path(__file__).parents[1] / "data" / "periodic.csv").groupby("case", sort=False)
)


def line(plan: Plan, run: Run) -> dict[str, Any]:
    """Return the line of the CSV: sizes, steps, costs, and of each compared number value, reference, error, bound."""
    found: dict[str, Any] = {
        "case": plan.case.name, "level": plan.level, "step": plan.step, "status": run.data.get("status"),
        "periodic": bool(run.in_time.get("periodic")), "reached": run.in_time.get("reached"),
        "unknowns": run.data.get("unknowns"), "triangles": run.data.get("triangles"), **run.steps,
    }  # fmt: skip
    quantities = {} if run.failure else run.quantities
    for part in plan.case.compared:
        found |= {
            part.name: part.value(quantities), f"{part.name}_reference": part.published(plan.case.name),
            f"{part.name}_error": part.error(plan.case.name, quantities), f"{part.name}_bound": part.bound,
        }  # fmt: skip
    return found


def costs(run: Run, step: float, complete: bool, largest: float = math.inf) -> dict[str, Any]:
    """Return what `COSTS` show of a run; `!`: not complete, or more unknowns than `largest`; `step` in s."""
    unknowns = run.data.get("unknowns")
    return run.steps | {
        "step": step,
        "unknowns": f"{unknowns} !" if unknowns is not None and unknowns > largest else unknowns,
        "reached": Column("", "reached", "{:.2f}").cell(run.in_time) + ("" if complete else " !"),
        **({"seconds": f"failed ({run.failure})"} if run.failure else {}),
    }


COSTS = columns(
    "unknowns | dt s = step :g | t s = reached | steps | seconds :.0f | per step = seconds_per_step :.3f | "
    "iterations = iterations_per_step :.1f | rebuilds = rebuilds_per_100_steps :.1f"
)
CHECK = Column("check", "check_maximum", "{:.0e}")
SIZES = {"unknowns": "Int64", "triangles": "Int64"}
Cases = Sequence[PeriodicCase]
Outcomes = Sequence[tuple[Plan, Run]]


def case_table(case: PeriodicCase, outcomes: Outcomes) -> TextTable:
    """Return one row per run of a case, with the errors; `!` marks what is above its bound, or is not there."""
    rows = []
    for i, (plan, run) in enumerate(outcomes):
        complete = bool(run.failure or run.in_time.get("periodic"))
        row = {"level": plan.level} | costs(run, plan.step, complete, math.inf if i else LARGEST)
        errors = {part.name: part.error(case.name, run.quantities) for part in case.compared if not run.failure}
        rows.append(row | errors)
    compared = [bounded(part.title, part.name, part.bound) for part in case.compared]
    return table(rows, [Column("level", "level"), *COSTS, *compared, CHECK], title=case.name)


def main(
    *, jobs: int = 1, out: Place = None, readme: Place = None, runs: Path = RUNS, cases: Cases = PERIODIC_CASES
) -> list[str]:
    """Run every case until it is periodic, print errors and costs, and write them down. A second call goes on."""
    study = Study("verify --unsteady", out, readme, "verification-unsteady")
    plans = [plan for case in cases for plan in case.plans]
    done = run_all({plan.name: plan.scene for plan in plans}, runs, jobs, study.command)
    outcomes = list(zip(plans, done, strict=True))
    groups = {case: [item for item in outcomes if item[0].case == case] for case in cases}
    tables = [case_table(*group) for group in groups.items()]
    files: dict[str, Content] = {
        f"{study.name}.csv": lambda: pd.DataFrame([line(*item) for item in outcomes]).astype(SIZES),
        f"{study.name}.png": lambda: to_small_png(draw(groups)),
    }
    return study.finish([run.data for run in done], tables, files, tables=tables, largest=LARGEST)


def draw(groups: Mapping[PeriodicCase, Outcomes]) -> Figure:
    """Draw, for each case, the last periods of u_y or the lift, and |error| over the seconds of the script."""
    figure = Figure(figsize=(13, 3.6 * len(groups)), layout="constrained", facecolor="white")
    grid = figure.subplots(len(groups), 2, squeeze=False)
    for (left, right), (case, outcomes) in zip(grid, groups.items(), strict=True):
        _signals(left, case, outcomes)
        _errors(right, case, [(plan, run) for plan, run in outcomes if not run.failure])
        for axes in (left, right):
            if axes.get_legend_handles_labels()[0]:
                axes.legend(frameon=False, fontsize=8, labelcolor=INK, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _signals(axes: Axes, case: PeriodicCase, outcomes: Outcomes) -> None:
    """Draw the last periods of every run, counted back from the end of its last one; dashed: what was published."""
    dress(axes, case.name, "periods before the last upward crossing of the mean", "")
    for i, (plan, run) in enumerate(outcomes):
        history, name, period = run.history, reference_column(run.history), last_period(run.history)
        if name is None or period is None:
            continue
        periods = (history["time"] - period.end) / (period.end - period.start)
        part = (periods >= -SHOWN_PERIODS) & (periods <= 0.5)
        label, dashes = f"level {plan.level}, dt {plan.step:g} s", ("-", "--", "-.", ":")[i % 4]
        style: dict[str, Any] = {"label": label, "linewidth": 1.3, "color": LINES[i % len(LINES)], "linestyle": dashes}
        axes.plot(periods[part], history[name][part], **style)
        axes.set_ylabel(SIGNALS[name], color=INK)
    published = references(case.name).get("tip_uy" if "tip_uy" in references(case.name) else "lift")
    if published is not None and published.mean is not None and published.amplitude is not None:
        for sign in (-1, 1):
            axes.axhline(published.mean + sign * published.amplitude, color=FAINT, linewidth=0.9, linestyle=":")
    axes.ticklabel_format(axis="y", scilimits=(-3, 5), useMathText=True)


def _errors(axes: Axes, case: PeriodicCase, outcomes: Outcomes) -> None:
    """Draw the size of each error; filled: the catalogue's time step; lines join meshes with the same time step."""
    title = "filled: the catalogue's time step; open: others"
    dress(axes, title, "seconds of the FreeFEM script, one thread", "relative error (%)")
    for i, part in enumerate(case.compared):
        colour = LINES[i % len(LINES)]
        for j, step in enumerate(dict.fromkeys(plan.step for plan, _ in outcomes)):
            own = [run for plan, run in outcomes if plan.step == step]
            found = [(run.seconds, 100 * abs(part.error(case.name, run.quantities))) for run in own]
            points = [point for point in found if math.isfinite(point[1])]
            style: dict[str, Any] = {"color": colour, "marker": MARKERS[i % len(MARKERS)], "markersize": 5}
            style |= {"markerfacecolor": "white" if j else colour, "label": "_" if j else part.title}
            if points:
                axes.plot(*zip(*points, strict=True), linewidth=1.0, **style)
    logarithmic(axes)
    if axes.lines:
        axes.yaxis.set_major_formatter("{x:g}")


# Long runs ------------------------------------------------------------------------------------------------------------

SIGNAL = "tip_uy"
BOUND = 1e-2
"""Largest accepted change of the amplitude from the last but one block to the last."""


@dataclass(frozen=True)
class LongCase:
    """A case of the catalogue that is run to a time in s, with the catalogue's mesh and time step."""

    name: str
    end: float

    @property
    def picture(self) -> str:
        """Name of the picture: `long-fsi2.png`."""
        return f"long-{self.name.removeprefix('turek-')}.png"

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return load_scene(self.name, [f"time.end={self.end!r}", "time.stop=end", *PLAIN])


LONG_CASES = (LongCase("turek-fsi2", 35.0), LongCase("turek-fsi3", 20.0))


@dataclass(frozen=True)
class LongRun:
    """What became of a long run."""

    case: LongCase
    run: Run

    @property
    def complete(self) -> bool:
        """Whether it came to its end."""
        return not self.run.failure and float(self.run.in_time.get("reached", 0.0)) >= self.case.end * (1 - 1e-9)

    @cached_property
    def blocks(self) -> list[dict[str, Any]]:
        """Of each block of two periods its numbers, change relative to its own amplitude, and smallest J."""
        history = self.run.history
        try:
            found = blocks(history["time"], history[SIGNAL]) if len(history) else []
        except ValueError:  # a value is not finite
            found = []
        before = [math.nan, *(block.amplitude for block in found)]
        return [
            {
                "block": count,
                **{name: getattr(block, name) for name in ("start", "end", "frequency", "mean", "amplitude")},
                "change": (block.amplitude - last) / block.amplitude,
                "min_jacobian": float(history["min_jacobian"][history["time"].between(block.start, block.end)].min()),
            }
            for count, (last, block) in enumerate(zip(before, found, strict=False), start=1)
        ]

    def draw(self) -> Figure | None:
        """Draw the history, and its last period."""
        end = self.blocks[-1]["end"] if self.blocks else math.nan
        period = (end - (end - self.blocks[-1]["start"]) / PERIODS, end) if self.blocks else None
        return time_history(self.run.history, period)


def summary_table(runs: Sequence[LongRun]) -> TextTable:
    """Return one row per run: costs, amplitude and J of the last block, and the last change with its bound."""
    rows = []
    for item in runs:
        time, lines = CASES[item.case.name].time, item.blocks
        assert time is not None
        row = {"case": item.case.name, "blocks": len(lines)} | costs(item.run, time.step, item.complete)
        row |= {"amplitude": lines[-1]["amplitude"] if lines else None, "change": math.nan}
        if lines:
            least = [block["min_jacobian"] for block in lines]
            row |= {"change": lines[-1]["change"], "first": least[0], "last": least[-1], "least": min(least)}
        rows.append(row)
    last = f"blocks | u_y amplitude m = amplitude :.5f | last change = change :% < {BOUND}"
    found = columns(f"{last} | min J first = first :.4f | last :.4f | least :.4f")
    return table(rows, [Column("case", "case"), *COSTS, *found, CHECK])


BLOCK_COLUMNS = columns(
    "block | from t in s = start :.3f | to t in s = end :.3f | frequency in Hz = frequency :.4f | "
    "mean in m = mean :.6f | amplitude in m = amplitude :.6f | change :% | min J = min_jacobian :.4f"
)


def long_frame(runs: Iterable[LongRun]) -> pd.DataFrame:
    """Return one row per block of every run; a run without blocks has one row."""
    rows: list[dict[str, Any]] = []
    for item in runs:
        run = item.run
        common = {"case": item.case.name, "level": run.level, "unknowns": run.data.get("unknowns")}
        common |= {"complete": item.complete, "reached": run.in_time.get("reached"), "check_maximum": run.check_maximum}
        rows += [common | block for block in item.blocks] or [common]
    return pd.DataFrame(rows)


def main_long(
    *, jobs: int = 1, out: Place = None, readme: Place = None, runs: Path = RUNS, cases: Sequence[LongCase] = LONG_CASES
) -> list[str]:
    """Run the long cases, print amplitudes and J of their blocks, and write them down. A second call goes on."""
    study = Study("verify --long", out, readme, "long")
    done = run_all({f"{case.name}-long": case.scene for case in cases}, runs, jobs, study.command)
    found = [LongRun(case, run) for case, run in zip(cases, done, strict=True)]
    summary = summary_table(found)
    drawn = {item.case.picture: figure for item in found if (figure := item.draw()) is not None}
    files: dict[str, Content] = {"long.csv": lambda: long_frame(found)}
    files |= {name: partial(to_small_png, figure) for name, figure in drawn.items()}
    return study.finish(
        [run.data for run in done], [summary], files, summary=summary, periods=PERIODS, bound=BOUND,
        tables={item.case.name: table(item.blocks, BLOCK_COLUMNS) for item in found},
        pictures={case.name: case.picture for case in cases},
    )  # fmt: skip
