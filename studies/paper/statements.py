"""The paper's statements in words beside the computed numbers: it prints no number that could be compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ffsi.scene.geometry import FlapChannel
from studies.paper.cases import CASES, MEAN_VELOCITY, Curve, PaperCase
from studies.paper.sweeps import Outcome


@dataclass(frozen=True)
class Statement:
    """A sentence of the paper (its section, its words) and what the sweeps say about it."""

    section: str
    quote: str
    found: str


def statements(case: PaperCase, outcomes: Mapping[Curve, Outcome]) -> list[Statement]:
    """Return what the paper says about a case in words, with the numbers found; empty if no point was solved."""
    outcome, stiff = outcomes[case.curve], outcomes.get(CASES[2].curve)
    if outcome.solved.empty:
        return []
    found = {1: _first, 2: _second, 3: _third}[case.number](outcome)
    return [*found, *_both_roofs(outcome, stiff)] if case.number == 2 and stiff else found


def _first(outcome: Outcome) -> list[Statement]:
    first, last, height = outcome.solved.iloc[0], _last(outcome), _geometry(outcome).flap_height
    parts = [f"{100 * _size(row) / height:.3g} % of the flap's height at {_at(row)}" for row in (first, last)]
    return [
        Statement("5", "relatively small beam displacements (around 4%)", f"the tip moves by {' and '.join(parts)}."),
        Statement("5.1", "the significant deformation of the flap", _tip_size(outcome)),
        Statement(
            "6",
            "the displacement of the flap increases with the increase in the value of the flow velocity",
            _growth(outcome),
        ),
    ]


def _second(outcome: Outcome) -> list[Statement]:
    return [
        Statement("5.2", "the small deformation of the flap under the fluid flow", _tip_size(outcome)),
        Statement(
            "5.2",
            "the SVK material model has a relatively minor impact on the behavior of the top roof",
            _roof_size(outcome),
        ),
    ]


def _third(outcome: Outcome) -> list[Statement]:
    last = _last(outcome)
    ratio = abs(last.get("tip_uy", 0.0) / last["tip_ux"])
    smaller = (
        "The displacement of the vertical flap in the y-direction was found to be significantly less than that in the "
        "x-direction"
    )
    return [
        Statement("5.3", "the very little deformation of the flap under the fluid flow", _tip_size(outcome)),
        Statement("6", smaller, f"at {_at(last)} the ratio of the two is {ratio:.2g}."),
        Statement("6", "most of the flow's effects being directed towards the top roof", _roof_size(outcome)),
    ]


def _both_roofs(soft: Outcome, stiff: Outcome) -> list[Statement]:
    """Return the statement about soft and stiff flaps, at the highest velocity that both sweeps have reached."""
    if "roof_uy" not in soft.solved or "roof_uy" not in stiff.solved:
        return []
    both = pd.merge(soft.solved, stiff.solved, on=MEAN_VELOCITY, suffixes=("", "_stiff"))
    if both.empty:
        return []
    last = both.sort_values(MEAN_VELOCITY).iloc[-1]
    quote = (
        "if the flap undergoes significant deformation, the diversion of flow towards the top roof is reduced, "
        "resulting in less deformation of the roof"
    )
    found = (
        f"at {_at(last)} the middle of the roof rises by {last['roof_uy']:.3g} m over this flap and by "
        f"{last['roof_uy_stiff']:.3g} m over the stiff one of case 3."
    )
    return [Statement("6", quote, found)]


def _tip_size(outcome: Outcome) -> str:
    last, height = _last(outcome), _geometry(outcome).flap_height
    size = _size(last)
    return f"at {_at(last)} the tip moves by {size:.3g} m, {100 * size / height:.3g} % of the flap's height."


def _roof_size(outcome: Outcome) -> str:
    last = _last(outcome)
    if "roof_uy" not in last:
        return "the roof of this computation is rigid."
    part = 100 * last["roof_uy"] / _geometry(outcome).height
    return (
        f"at {_at(last)} the middle of the roof rises by {last['roof_uy']:.3g} m, {part:.3g} % of the channel's "
        f"height; the tip of the flap moves by {_size(last):.3g} m. The paper states neither the roof's thickness nor "
        "how it is held, see below."
    )


def _growth(outcome: Outcome) -> str:
    rows = outcome.solved
    sizes = [_size(row) for _, row in rows.iterrows()]
    word = "it grows at every step" if bool((np.diff(sizes) > 0).all()) else "it does not grow at every step"
    first, last = rows.iloc[0], rows.iloc[-1]
    return f"{word}: {sizes[0]:.3g} m at {_at(first)}, {sizes[-1]:.3g} m at {_at(last)}."


def _last(outcome: Outcome) -> pd.Series:
    return outcome.solved.iloc[-1]


def _size(row: pd.Series) -> float:
    """Return how far the flap's tip has moved, m."""
    return float(np.hypot(row["tip_ux"], row.get("tip_uy", 0.0)))


def _at(row: pd.Series) -> str:
    return f"{row[MEAN_VELOCITY]:g} m/s"


def _geometry(outcome: Outcome) -> FlapChannel:
    assert isinstance(outcome.scene.geometry, FlapChannel)
    return outcome.scene.geometry
