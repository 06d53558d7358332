"""Flow rate and pressure at the outlet and in the reservoir behind it: of a state, and along the history of a run."""

from collections.abc import Callable, Sequence

from ffsi.files.arrays import Floats, RawState
from ffsi.reference import momentum, terms
from ffsi.reference.conditions import Outlet
from ffsi.reference.history import History
from ffsi.reference.quantities import Quantity
from ffsi.reference.step import Step
from ffsi.reference.system import System

# What is below this fraction of its scale is a difference of larger numbers, compared on that scale.
_SMALL = 1e-4


def at_outlet(system: System, state: RawState) -> dict[str, Quantity]:
    """Return what a state has at an outlet with a pressure, by name; nothing without one.

    The flow rate out, m2/s, and the pressure, Pa, those at the end of a step; of a Windkessel in a step that of the
    reservoir at both ends, Pa.
    """
    outlet = system.problem.outlet
    if system.fluid is None or outlet is None or not outlet.presses:
        return {}
    sides = momentum.outlet_sides(system, system.fluid)

    def flow_of(v: Floats) -> float:
        return float(terms.outlet_flow(sides.normal, v[sides.nodes]))

    flow = flow_of(state.v)
    through = float(abs(state.v[sides.nodes]).max() * abs(sides.normal).sum())
    found = {"flow_rate_out": Quantity.of(flow, through, _SMALL)}
    if (increment := system.increment) is None:
        size = abs(outlet.pressure) + (outlet.resistance + outlet.distal) * through
        return found | {"outlet_pressure": Quantity.of(float(outlet.steady(flow)), size, _SMALL)}
    step, old, new = increment.step, increment.reservoir, 0.0
    if outlet.stores:
        new = float(outlet.reservoir_after(step, flow, flow_of(increment.old.v), old))
        size = max(abs(old), abs(new))
        found |= {"windkessel_old": Quantity.of(old, size, _SMALL), "windkessel_new": Quantity.of(new, size, _SMALL)}
    size = abs(outlet.pressure_at(step.time)) + abs(new) + outlet.resistance * through
    return found | {"outlet_pressure": Quantity.of(outlet.at_end(step, flow, new), size, _SMALL)}


def reservoirs(outlet: Outlet, history: History, theta: Callable[[float, int], float]) -> list[float]:
    """Pressure of the reservoir before the first step, which starts from rest, and after each, (steps + 1,) Pa.

    It follows from the flow rates of the history; ``theta`` is the weight of a step by its length and its number.
    Raises ``ValueError`` if the history has no flow rates.
    """
    if missing := {"flow_rate_out", "outlet_pressure"} - history.columns.keys():
        raise ValueError(f"{history.path}: no column {', '.join(sorted(missing))}")
    flow, times = history.columns["flow_rate_out"], zip(history.columns["step"], history.columns["time"], strict=True)
    steps = [Step(k, theta(k, number), time) for number, (k, time) in enumerate(times, start=1)]
    return _reservoirs(outlet, steps, flow)


def _reservoirs(outlet: Outlet, steps: Sequence[Step], flow: Sequence[float]) -> list[float]:
    found = [outlet.pressure_at(0.0)]
    if not outlet.stores:
        return found * (len(steps) + 1)
    for step, new, old in zip(steps, flow, [0.0, *flow], strict=False):
        found.append(float(outlet.reservoir_after(step, new, old, found[-1])))
    return found
