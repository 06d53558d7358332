"""Every scene of the catalogue in other units of length, mass and time: the same numbers and the same iterations."""

import pytest
from conftest import PLAIN
from units_scaling import compare, first_steps

from ffsi.scene import CASES

MIXTURES = [(1e-6, 1e6, 1e-3), (1e6, 1e-6, 1e6), (1e-3, 1e-6, 1e-6), (1e6, 1e6, 1e-6), (1e-6, 1e-6, 1e6)]


@pytest.mark.parametrize("units", MIXTURES, ids=lambda units: "-".join(f"{factor:g}" for factor in units))
@pytest.mark.parametrize("case", CASES)
def test_other_units_are_the_same_computation(tmp_path, case, units):
    settings = ["mesh.level=0", *PLAIN, *first_steps(case, 10)]
    assert compare(case, settings, *units, tmp_path) < 1e-8
