"""Flow of blood, from the table that `make verify` has just written (`python -m studies verify --blood`, minutes).

Errors are computed again from the values in the table, exact values again where they have a closed form.
"""

from functools import cache
from pathlib import Path

import pandas as pd
import pytest

from studies.verification import blood
from studies.verification.blood import CHANGE, CHECK, FAR, LONGEST, OSCILLATING, PLANE

RESULTS = Path(__file__).parents[2] / "results"
STEADY, PULSATILE = ([case for case in blood.CASES if case.group == group] for group in ("steady", "pulsatile"))
PLACES = ("upstream", "downstream")


@cache
def table() -> pd.DataFrame:
    path = RESULTS / blood.CSV
    assert path.is_file(), f"{path} is missing: make verify writes it"
    return pd.read_csv(path, keep_default_na=False, na_values={"value": "", "reference": "", "error": "", "bound": ""})


def numbers(case: str) -> pd.DataFrame:
    rows = table()
    return rows[rows["case"] == case].set_index("quantity")


def error(case: str, quantity: str) -> float:
    value, reference = numbers(case).loc[quantity, ["value", "reference"]].astype(float)
    print(f"{case} {quantity}: {value:.8g}, exact {reference:.8g}, {100 * (value / reference - 1):.4f} %")
    return abs(value / reference - 1)


@pytest.mark.parametrize("case", blood.CASES, ids=lambda case: case.folder)
def test_every_run_is_there_and_checked(case):
    found = numbers(case.folder)
    assert set(found["failure"]) == {""} and found.loc["check", "value"] < CHECK
    if "mass_balance" in found.index:
        assert abs(found.loc["mass_balance", "value"]) < CHECK


@pytest.mark.parametrize("case", [case for case in blood.CASES if case.group == "plane"], ids=lambda case: case.folder)
def test_plane_flow(case):
    assert numbers(case.folder).loc["unknowns", "value"] < 6000
    assert numbers(case.folder).loc["wall_shear_stress", "reference"] == pytest.approx(
        1e-3 * float(case.labels[1]), rel=1e-9
    )
    for quantity in ("gradient", "largest", "wall_shear_stress"):
        assert error(case.folder, quantity) < PLANE


@pytest.mark.parametrize(("gradient", "mean", "largest"), [
    (10, 6.3527417e-5, 9.4270969e-5), (100, 0.0032008878, 0.0043290559), (1000, 0.07601542, 0.1102402),
])  # fmt: skip
def test_exact_values_of_carreau_blood(gradient, mean, largest):
    found = numbers(f"plane-carreau-{gradient}")
    assert found.loc["mean", "value"] == pytest.approx(mean, rel=1e-7)
    assert found.loc["largest", "reference"] == pytest.approx(largest, rel=1e-7)


def test_oscillating_flow_on_two_meshes():
    coarse, fine = (
        numbers(case.folder).loc[["velocity_difference", "pressure_difference"], "value"] for case in blood.CASES
        if case.group == "oscillating"
    )  # fmt: skip
    assert (coarse < OSCILLATING).all() and (fine < coarse / 2).all()


@pytest.mark.parametrize("case", STEADY, ids=lambda case: case.folder)
def test_far_from_the_dome(case):
    """Elastic walls without support widen the lumen towards the dome: there the blood's inertia belongs to the flow."""
    ending = "_slowed" if case.labels[0] in ("elastic, Newtonian", "elastic, Carreau") else ""
    for place in PLACES:
        for what in ("pressure", "inner", "outer"):
            assert error(case.folder, f"{place}_{what}{ending}") < FAR
            if ending and what == "pressure":
                assert error(case.folder, f"{place}_{what}") > FAR


@pytest.mark.parametrize(
    "variant", sorted({case.folder.removeprefix("aneurysm-").rpartition("-level-")[0] for case in STEADY})
)
def test_the_finest_levels_of_the_steady_flow_differ_by_little(variant):
    found = numbers(f"aneurysm-{variant}")
    for quantity in ("wss_mean_dome", *(["effective_stress_max"] if "elastic" in variant else [])):
        coarser, finer = (numbers(f"aneurysm-{variant}-level-{level}").loc[quantity, "value"] for level in (2, 3))
        assert found.loc[f"{quantity}_3", "value"] == pytest.approx(1 - coarser / finer, abs=1e-8)
        assert abs(1 - coarser / finer) < CHANGE


@pytest.mark.parametrize("case", PULSATILE, ids=lambda case: case.folder)
def test_cycles(case):
    found = numbers(case.folder)["value"]
    assert found["tawss_change"] < CHANGE and 0 <= found["tawss_min_dome"] < found["tawss_mean_dome"]
    assert 0 <= found["osi_max_dome"] <= 0.5 and found["seconds"] < LONGEST
