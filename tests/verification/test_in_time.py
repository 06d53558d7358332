"""Published values of the cases in time, from the tables that `make verify` and `make verify-long` have just written.

Those runs take hours, so they are not repeated here; the errors are computed again from the values in the tables.
"""

from functools import cache
from pathlib import Path

import pandas as pd
import pytest

from ffsi.scene import CASES
from studies.verification import in_time
from studies.verification.in_time import LARGEST, PERIODIC_CASES

RESULTS = Path(__file__).parents[2] / "results"
COMPARED = [(case, item) for case in PERIODIC_CASES for item in case.compared]
CHECK = 1e-8


@cache
def table(name: str) -> pd.DataFrame:
    path = RESULTS / name
    assert path.is_file(), f"{path} is missing: make verify and make verify-long write it"
    return pd.read_csv(path)


def default_run(case: str) -> pd.Series:
    rows, scene = table(in_time.CSV), CASES[case]
    (row,) = rows[
        (rows["case"] == case) & (rows["level"] == scene.mesh.level) & (abs(rows["step"] / scene.time.step - 1) < 1e-9)
    ].iloc
    return row


@pytest.mark.parametrize(("case", "item"), COMPARED, ids=lambda item: item.name)
def test_the_catalogues_mesh_and_step_meet_the_published_value(case, item):
    value, published = default_run(case.name)[item.name], item.published(case.name)
    error = abs(value - published) / abs(published)
    print(f"{case.name} {item.name}: {value:.6g}, published {published:.6g}, {100 * error:.3f} %")
    assert error <= item.bound


@pytest.mark.parametrize("case", PERIODIC_CASES, ids=lambda case: case.name)
def test_the_catalogues_mesh_is_moderate_and_its_motion_periodic(case):
    row = default_run(case.name)
    assert row["unknowns"] <= LARGEST and row["status"] == "converged" and row["periodic"]


def test_every_run_is_there_and_checked():
    rows = table(in_time.CSV)
    assert len(rows) == sum(len(case.plans) for case in PERIODIC_CASES) and (rows["status"] == "converged").all()
    assert (rows["check_maximum"] < CHECK).all()


@pytest.mark.parametrize("case", in_time.LONG_CASES, ids=lambda case: case.name)
def test_long_runs_keep_their_amplitude_and_their_mesh(case):
    rows = table(in_time.LONG_CSV)
    own = rows[rows["case"] == case.name]
    assert own["complete"].all() and own["reached"].iloc[-1] >= case.end * (1 - 1e-9)
    amplitude, least = (own[name].to_numpy() for name in ("amplitude", "min_jacobian"))
    print(f"{case.name}: {len(own)} blocks, amplitude {amplitude[-2]:.6g}, {amplitude[-1]:.6g}, J {least[-2:]}")
    assert len(own) >= 10
    assert abs(amplitude[-1] - amplitude[-2]) < in_time.BOUND * amplitude[-1] and abs(least[-1] - least[-2]) < 0.02
    assert own["check_maximum"].iloc[-1] < CHECK
