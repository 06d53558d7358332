"""Tables and picture of the runs that end when they are periodic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ffsi.report.curves import LINES, MARKERS
from ffsi.result.in_time import last_period
from ffsi.result.oscillation import reference_column
from ffsi.result.pictures import FAINT, INK
from ffsi.result.published import references
from studies.kept_runs import TimeRun
from studies.tables import NOTHING, TextTable, number, percent
from studies.verification.periodic_cases import LARGEST, PeriodicCase, PeriodicRun

COSTS_TEXT = (
    "t: where the run ended, with `!` if that was not where it should end. Seconds: processor time of the script, one "
    "thread; seconds and iterations per step, new factors (rebuilds) in 100 steps. Check: the largest relative "
    "residual or difference that the independent checker finds at the last step."
)
SHOWN_PERIODS = 2.5
SIGNALS = {"tip_uy": "$u_y$ of the tip (m)", "lift": "lift (N/m)"}


@dataclass(frozen=True)
class Outcome:
    """What was planned, and what became of it."""

    plan: PeriodicRun
    run: TimeRun

    @property
    def errors(self) -> list[float]:
        """Relative errors of the case's compared numbers; NaN where there is no value."""
        return [item.error(self.plan.case.name, self.run.quantities) for item in self.plan.case.compared]

    @property
    def unknowns(self) -> int | None:
        """Number of unknowns."""
        return self.run.data.get("unknowns")

    @property
    def periodic(self) -> bool:
        """Whether the motion was periodic at the end."""
        return bool(self.run.in_time.get("periodic"))


def cost_head() -> list[str]:
    """Return the headings of `cost_cells`."""
    return ["unknowns", "dt s", "t s", "steps", "seconds", "per step", "iterations", "rebuilds"]


def cost_cells(run: TimeRun, step: float, largest: float = math.inf) -> list[str]:
    """Return size, steps and costs of a run; `!` marks more unknowns than `largest`."""
    unknowns = run.data.get("unknowns")
    reached = run.in_time.get("reached")
    return [
        number(unknowns, "{:d}") + (" !" if unknowns is not None and unknowns > largest else ""),
        f"{step:g}",
        number(reached, "{:.2f}"),
        str(run.steps),
        f"failed ({run.failure})" if run.failure else number(run.seconds, "{:.0f}"),
        number(run.seconds_per_step, "{:.3f}"),
        number(run.iterations_per_step, "{:.1f}"),
        number(run.rebuilds_per_100_steps, "{:.1f}"),
    ]


def case_table(case: PeriodicCase, outcomes: Sequence[Outcome]) -> TextTable:
    """Return one row per run of a case, with the errors; `!` marks what is above its bound, or is not there."""
    compared = [f"{item.title} (< {100 * item.bound:g} %)" for item in case.compared]
    table = TextTable(["level", *cost_head(), *compared, "check"], title=case.name)
    for item in outcomes:
        largest = LARGEST if item.plan.is_default else math.inf
        costs = cost_cells(item.run, item.plan.step, largest)
        if not item.run.failure and not item.periodic:
            costs[2] += " !"
        errors = [marked(error, part.bound) for error, part in zip(item.errors, case.compared, strict=True)]
        table.add(
            str(item.plan.level),
            *costs,
            *(errors if not item.run.failure else [NOTHING] * len(errors)),
            number(item.run.check_maximum, "{:.0e}"),
        )
    return table


def marked(error: float, bound: float) -> str:
    """Return a relative error in percent, with `!` if its size is above the bound or it is NaN."""
    return percent(error) + ("" if abs(error) <= bound else " !")


def to_frame(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Return one row per run: sizes, steps, costs, and of each compared number value, reference, error and bound."""
    return pd.DataFrame([_row(item) for item in outcomes]).astype({"unknowns": "Int64", "triangles": "Int64"})


def _row(item: Outcome) -> dict[str, Any]:
    plan, run = item.plan, item.run
    row: dict[str, Any] = {
        "case": plan.case.name,
        "level": plan.level,
        "step": plan.step,
        "status": run.data.get("status"),
        "periodic": item.periodic,
        "reached": run.in_time.get("reached"),
        "unknowns": item.unknowns,
        "triangles": run.data.get("triangles"),
        "steps": run.steps,
        "seconds": run.seconds,
        "seconds_per_step": run.seconds_per_step,
        "iterations_per_step": run.iterations_per_step,
        "rebuilds_per_100_steps": run.rebuilds_per_100_steps,
        "check_maximum": run.check_maximum,
    }
    for part, error in zip(plan.case.compared, item.errors, strict=True):
        row |= {
            part.name: part.value(run.quantities),
            f"{part.name}_reference": part.published(plan.case.name),
            f"{part.name}_error": error,
            f"{part.name}_bound": part.bound,
        }
    return row


# Picture ----------------------------------------------------------------------------------------------------------


def draw(groups: Sequence[tuple[PeriodicCase, Sequence[Outcome]]]) -> Figure:
    """Draw, for each case, the last periods of u_y or the lift, and |error| over the seconds of the script."""
    figure = Figure(figsize=(13, 3.6 * len(groups)), layout="constrained", facecolor="white")
    grid = figure.subplots(len(groups), 2, squeeze=False)
    for (left, right), (case, outcomes) in zip(grid, groups, strict=True):
        _signals(left, case, outcomes)
        _errors(right, case, outcomes)
        for axes in (left, right):
            axes.grid(True, which="major", color="#e3e6ea", linewidth=0.7)
            axes.set_axisbelow(True)
            axes.tick_params(colors=INK, labelsize=9, width=0.6)
            for side, spine in axes.spines.items():
                spine.set_visible(side in ("left", "bottom"))
                spine.set_color(FAINT)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(frameon=False, fontsize=8, labelcolor=INK, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _signals(axes: Axes, case: PeriodicCase, outcomes: Sequence[Outcome]) -> None:
    """Draw the last periods of every run, counted back from the end of its last one; dashed: what was published."""
    axes.set_title(case.name, loc="left", fontsize=11, color=INK)
    axes.set_xlabel("periods before the last upward crossing of the mean", color=INK)
    for i, item in enumerate(outcomes):
        history, name = item.run.history, reference_column(item.run.history)
        period = last_period(history)
        if name is None or period is None:
            continue
        periods = (history["time"] - period.end) / (period.end - period.start)
        part = (periods >= -SHOWN_PERIODS) & (periods <= 0.5)
        label = f"level {item.plan.level}, dt {item.plan.step:g} s"
        line = ("-", "--", "-.", ":")[i % 4]
        axes.plot(
            periods[part], history[name][part], label=label, linewidth=1.3, color=LINES[i % len(LINES)], linestyle=line
        )
        axes.set_ylabel(SIGNALS[name], color=INK)
    name = "tip_uy" if "tip_uy" in references(case.name) else "lift"
    published = references(case.name).get(name)
    if published is not None and published.mean is not None and published.amplitude is not None:
        for sign in (-1, 1):
            axes.axhline(published.mean + sign * published.amplitude, color=FAINT, linewidth=0.9, linestyle=":")
    axes.ticklabel_format(axis="y", scilimits=(-3, 5), useMathText=True)


def _errors(axes: Axes, case: PeriodicCase, outcomes: Sequence[Outcome]) -> None:
    """Draw the size of each error; filled: the catalogue's time step; lines join meshes with the same time step."""
    axes.set_title("filled: the catalogue's time step; open: others", loc="left", fontsize=9, color=FAINT)
    axes.set_xlabel("seconds of the FreeFEM script, one thread", color=INK)
    axes.set_ylabel("relative error (%)", color=INK)
    solved = [item for item in outcomes if not item.run.failure]
    for i, part in enumerate(case.compared):
        colour, marker = LINES[i % len(LINES)], MARKERS[i % len(MARKERS)]
        for j, step in enumerate(dict.fromkeys(item.plan.step for item in solved)):
            points = [
                (item.run.seconds, 100 * abs(item.errors[i]))
                for item in solved
                if item.plan.step == step and math.isfinite(item.errors[i])
            ]
            if points:
                axes.plot(
                    *zip(*points, strict=True), color=colour, marker=marker, linewidth=1.0, markersize=5,
                    markerfacecolor=colour if not j else "white", label=part.title if not j else "_",
                )  # fmt: skip
    if axes.lines:
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
