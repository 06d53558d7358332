"""Flow rate and pressure at the outlet and in the reservoir behind it: of a state, and along the history of a run."""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ffsi.rawfiles import Floats, RawState
from ffsi.reference import momentum, terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.step import Step
from ffsi.reference.system import System

# What is below this fraction of its scale is a difference of larger numbers, compared on that scale.
_SMALL = 1e-3


@dataclass(frozen=True)
class AtOutlet:
    """``flow`` rate out, m2/s, and ``pressure``, Pa; that of the ``reservoir`` before a step and at its end, Pa.

    Of a step flow and pressure are those at its end; other than a Windkessel in a step has no reservoir. The scales are
    the sizes of what they are made of.
    """

    flow: float
    pressure: float
    reservoir: tuple[float, float] | None
    flow_scale: float
    pressure_scale: float

    def difference(self, reported: Mapping[str, float]) -> float:
        """Largest relative difference from what is reported of these; infinite if one is not."""
        values = {
            "flow_rate_out": (self.flow, self.flow_scale),
            "outlet_pressure": (self.pressure, self.pressure_scale),
        }
        if self.reservoir is not None:
            values["windkessel_old"] = (self.reservoir[0], self.pressure_scale)
            values["windkessel_new"] = (self.reservoir[1], self.pressure_scale)
        found = [_relative(float(reported.get(name, math.inf)), *value) for name, value in values.items()]
        return float(np.max(found))  # unlike max(), it passes a NaN on


def at_outlet(system: System, state: RawState) -> AtOutlet | None:
    """Return what a state has at an outlet with a pressure; None without one."""
    outlet = system.problem.outlet
    if system.fluid is None or outlet is None or not outlet.presses:
        return None
    sides = momentum.outlet_sides(system, system.fluid)

    def flow_of(v: Floats) -> float:
        return float(terms.outlet_flow(sides.normal, v[sides.nodes]))

    flow = flow_of(state.v)
    largest = float(abs(state.v[sides.nodes]).max() * abs(sides.normal).sum())
    reservoir, stored = None, 0.0
    if (increment := system.increment) is None:
        given, pressure = outlet.pressure, float(outlet.steady(flow))
    else:
        step = increment.step
        given = outlet.pressure_at(step.time)
        if outlet.kind == "windkessel":
            mean = step.theta * flow + (1.0 - step.theta) * flow_of(increment.old.v)
            stored = float(outlet.reservoir_after(step, mean, increment.reservoir))
            reservoir = (increment.reservoir, stored)
        pressure = outlet.at_end(step, flow, stored)
    size = abs(given) + abs(stored) + (outlet.resistance + outlet.distal) * largest
    return AtOutlet(flow, pressure, reservoir, largest, size)


def _relative(found: float, expected: float, size: float) -> float:
    difference = abs(found - expected)
    return difference / ((abs(expected) if abs(expected) > _SMALL * size else size) or 1.0)


@dataclass(frozen=True)
class OutletHistory:
    """What a run says of its outlet at the end of every step, and the reservoir that follows from it.

    ``flow`` rate out, m2/s, and ``pressure``, Pa, (steps,); ``reservoirs`` (steps + 1,) Pa, with that before the first
    step, which starts from rest.
    """

    path: Path
    flow: list[float]
    pressure: list[float]
    reservoirs: list[float]

    @classmethod
    def read(cls, path: Path, outlet: Outlet, theta: Callable[[float, int], float]) -> "OutletHistory":
        """Read ``history.csv``, whose row n is step n; ``theta`` is the weight of a step by its length and
        its number.

        Raises ``ValueError`` where a column is missing or no number.
        """
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        try:
            flow = [float(row["flow_rate_out"]) for row in rows]
            pressure = [float(row["outlet_pressure"]) for row in rows]
            times = [(float(row["step"]), float(row["time"])) for row in rows]
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: no number where one is expected ({error})") from error
        steps = [Step(k, theta(k, number), time) for number, (k, time) in enumerate(times, start=1)]
        return cls(path, flow, pressure, _reservoirs(outlet, steps, flow))

    def reported(self, number: int) -> dict[str, float]:
        """Quantities of a step by its number, from 1. Raises ``ValueError`` if there is no such step."""
        if not 0 < number <= len(self.flow):
            raise ValueError(f"{self.path}: no step {number}, the last is {len(self.flow)}")
        return {"flow_rate_out": self.flow[number - 1], "outlet_pressure": self.pressure[number - 1]}


def _reservoirs(outlet: Outlet, steps: Sequence[Step], flow: Sequence[float]) -> list[float]:
    found = [outlet.pressure_at(0.0)]
    if outlet.kind != "windkessel":
        return found * (len(steps) + 1)
    for step, new, old in zip(steps, flow, [0.0, *flow], strict=False):
        mean = step.theta * new + (1.0 - step.theta) * old
        found.append(float(outlet.reservoir_after(step, mean, found[-1])))
    return found
