"""Runs in other units of length, mass and time: the same numbers and the same iterations.

Some scenes here, one mixture of units each; every scene of the catalogue is in tests/verification/test_units.py.
"""

import pytest
from conftest import PLAIN
from units_scaling import compare, first_steps

MIXTURES = {
    "cook": (1e6, 1e-6, 1e3),
    "flap-neo-hookean": (1e-6, 1e6, 1e-3),
    "turek-cfd1": (1e3, 1e-6, 1e6),
    "turek-csm3": (1e-6, 1e-6, 1e6),
    "turek-fsi3": (1e6, 1e-6, 1e-3),
}
LAWS = {"turek-cfd1": ['fluid={law="power-law", density=1000, consistency=1, exponent=0.6}']}


@pytest.mark.parametrize("case", MIXTURES)
def test_other_units_are_the_same_computation(tmp_path, case):
    settings = ["mesh.level=0", "mesh.size_factor=2", *PLAIN, *first_steps(case, 5), *LAWS.get(case, [])]
    assert compare(case, settings, *MIXTURES[case], tmp_path) < 1e-8
