"""The energy balance of a history."""

import pandas as pd
import pytest

from ffsi.result.in_time import energy_balance


def history(work: float) -> pd.DataFrame:
    rows = {"time": [0.1, 0.2], "kinetic": [1.0, 2.0], "elastic": [0.5, 1.0], "dissipated": [0.1, 0.5]}
    return pd.DataFrame(rows | {"work": [1.6, work]})


def test_the_parts_of_the_last_state_and_what_is_left():
    found = energy_balance(history(4.0))
    assert found == {"kinetic": 2.0, "elastic": 1.0, "dissipated": 0.5, "work": 4.0, "imbalance": pytest.approx(-0.125)}
    assert energy_balance(history(3.5))["imbalance"] == 0.0


def test_a_history_without_energies_has_no_balance():
    assert energy_balance(history(4.0).drop(columns="work")) == {}
    assert energy_balance(history(4.0).iloc[:0]) == {}
