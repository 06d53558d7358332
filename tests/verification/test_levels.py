"""Convergence of the paper's flaps, which nobody published values of, by `make verify`."""

from itertools import pairwise

import pytest

from studies.verification import steady

LEVELS = range(5)
TIP, DRAG = 0.5e-2, 0.3e-2  # largest relative difference between two levels; half of it between the finest two


@pytest.mark.parametrize("variant", steady.FLAPS, ids=lambda item: item.case)
def test_levels_differ_by_little(measured, variant):
    runs = [measured(variant, level) for level in LEVELS]
    found = [steady.differences(*pair) for pair in pairwise(runs)]
    tips, drags = ([item[name] for item in found] for name in ("tip", "drag"))
    print(f"{variant.case}: tip {tips}, drag {drags}")
    assert max(tips) < TIP and max(drags) < DRAG and tips[-1] < TIP / 2 and drags[-1] < DRAG / 2
    for run in runs:
        assert run.check_maximum < 1e-8
