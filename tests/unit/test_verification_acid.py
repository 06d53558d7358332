"""`python -m studies verify --acid`: its exact value, what is made of its runs, its meshes and scenes."""

import math

import numpy as np
import pandas as pd
import pytest

from ffsi.scene import boundaries
from studies.harness import Run
from studies.verification import acid


def test_balance_and_extrapolation_of_the_inflated_cylinder():
    """The radial stress of sigma_tt - sigma_rr = mu (l^2 - 1/l^2), l = r/R, integrated over the deformed wall."""
    a = acid.INNER + acid.inflated()
    c = a**2 - acid.INNER**2
    r = np.linspace(a, math.sqrt(acid.OUTER**2 + c), 20001)
    square = r**2 / (r**2 - c)
    assert np.trapezoid(acid.SHEAR * (square - 1 / square) / r, r) == pytest.approx(acid.PRESSURE, rel=1e-8)
    runs = {n: Run("", {"quantities": {"tip_ux": 0.4 + 3 / n**2 - 5 / n**4}}) for n in (8, 16, 32)}
    value, bar = acid.extrapolated({f"cylinder-{n}": run for n, run in runs.items()})
    assert value == pytest.approx(0.4, rel=1e-13) and 1e-6 < bar < 1e-3


@pytest.mark.parametrize(("ours", "bar", "word"), [(1.5, 0.1, "yes"), (2.05, 0.1, "with its bar"), (2.2, 0.1, "no")])
def test_a_value_is_judged_by_its_band(ours, bar, word):
    value = acid.Value("test", "u", "1 to 2", 1.0, 2.0, lambda runs: (ours, bar))
    assert acid._row(value, {"a": Run("", {})})["inside"] == word
    failed = acid._row(value, {"a": Run("", {"failure": "crash"})})
    assert failed["inside"] == "no" and math.isnan(failed["ours"])


def test_a_cycle_is_the_last_one():
    time = np.arange(1, 13) * 1.0
    history = pd.DataFrame({"time": time, "tip_uy": np.where(time > 7, time, 100.0)})
    runs = {name: Run("", {}, history=history) for name in ("mok-16-0.1", "mok-32-0.1", "mok-32-0.05")}
    assert acid.of_cycle(np.max)(runs) == (12, 0) and acid.of_cycle(np.min)(runs) == (8, 0)


@pytest.mark.parametrize("test", acid.TESTS, ids=lambda test: test.name)
def test_scenes_are_valid_and_their_meshes_what_they_say(test, tmp_path):
    for name, scene in test.scenes(tmp_path).items():
        roles = {side.role for side in boundaries(scene)}
        assert roles >= ({"loaded", "slip"} if "cylinder" in name else {"inlet", "outlet", "no-slip", "interface"})
        area = sum(scene.exact_areas().values())
        exact = {"cyl": math.pi * 3 / 4, "mok": 1.002, "fla": 24}[name[:3]]
        assert area == pytest.approx(exact, rel=1e-2 if "cyl" in name else 1e-9)
