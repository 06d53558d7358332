"""`python -m studies verify --acid`: its exact value, what is made of its runs, its meshes and scenes."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import newton
from scipy.special import ivp, kvp

from ffsi.scene import boundaries
from studies.harness import Run
from studies.verification import acid
from studies.verification.acid_scenes import INNER, OUTER, scenes_of


def test_balance_and_extrapolation_of_the_inflated_cylinder():
    """The radial stress of sigma_tt - sigma_rr = mu (l^2 - 1/l^2), l = r/R, integrated over the deformed wall."""
    a = INNER + acid.inflated()
    c = a**2 - INNER**2
    r = np.linspace(a, math.sqrt(OUTER**2 + c), 20001)
    square = r**2 / (r**2 - c)
    assert np.trapezoid((square - 1 / square) / r, r) == pytest.approx(0.4, rel=1e-8)  # pressure over mu
    runs = {n: Run("", {"quantities": {"tip_ux": 0.4 + 3 / n**2 - 5 / n**4}}) for n in (8, 16, 32)}
    value, bar = acid.extrapolated({f"cylinder-{n}": run for n, run in runs.items()})
    assert value == pytest.approx(0.4, rel=1e-13) and 1e-6 < bar < 1e-3


@pytest.mark.parametrize(("ours", "bar", "word"), [(1.5, 0.1, "yes"), (2.05, 0.1, "with its bar"), (2.2, 0.1, "no")])
def test_a_value_is_judged_by_its_band(ours, bar, word):
    value = acid.expected("cylinder")[0]._replace(low=1.0, high=2.0)
    assert acid.inside(value, ours, bar) == word
    assert acid.inside(value._replace(low=math.nan, high=math.nan), ours, bar) == "no band"
    failed = acid._row(value, {"a": Run("", {"failure": "crash"})})
    assert failed["inside"] == "no" and math.isnan(failed["ours"])


def history(time, **columns) -> Run:
    return Run("", {}, history=pd.DataFrame({"time": time, **columns}))


def test_a_cycle_is_the_last_one():
    time = np.arange(1, 13) * 1.0
    run = history(time, tip_uy=np.where(time > 7, time, 100.0))
    assert acid.extreme("max", "tip_uy", -5)(run.history) == 12 and acid.extreme("min", "tip_uy", -5)(run.history) == 8


def test_a_developed_swing_is_a_mean_of_its_periods():
    time = np.arange(1, 700) * 0.01
    run = history(time, tip_uy=np.where(time < 3, 9.0, 0.2 + (1 + 0.1 * time) * np.sin(2 * np.pi * 3.1 * time)))
    assert acid.late("frequency", "tip_uy", 4)(run.history) == pytest.approx(3.1, rel=1e-3)
    assert acid.late("amplitude", "tip_uy", 4)(run.history) == pytest.approx(1.55, rel=1e-2)


def test_errors_of_second_order_in_mesh_and_step_are_extrapolated_away():
    runs = {f"a-{n}-{k}": history([1.0], u=[5 + 0.3 / n**2 + 2 * k**2]) for n, k in ((1, 0.2), (2, 0.2), (2, 0.1))}
    pick = acid.extreme("max", "u")
    others = {"ab-1": history([1.0], u=[7])}
    assert acid.settled("a", pick, True)({**runs, **others})[0] == pytest.approx(5, rel=1e-14)
    assert acid.settled("a", pick)(runs) == pytest.approx((5.095, 0.225 + 0.06), rel=1e-12)


def test_frequency_and_damping_of_a_swing_come_from_its_later_periods():
    omega, sigma = acid.MODES[140]
    time = np.linspace(0.07, 14.28, 204)
    swing = acid.AMPLITUDE * np.exp(0.97 * sigma * time) * np.cos(1.01 * omega * time + 0.3)
    run = history(time, tip_ux=np.where(time < 7, 1.0, swing + 1e-6))
    assert acid.swing(omega, sigma, 0)(run.history) == pytest.approx(1.01 * omega, rel=1e-9)
    assert acid.swing(omega, sigma, 1)(run.history) == pytest.approx(0.97 * sigma, rel=1e-7)


def ring_determinant(s: complex, rho: float) -> complex:
    """What is 0 at a mode exp(s t): a plane-strain ring, free inside, in a viscous fluid up to a wall, cos(2 angle).

    u = grad phi + curl psi of the ring and v of the fluid alike; there phi is harmonic, with the pressure -rho s phi.
    """
    young, poisson, density, viscosity = 1e6, 0.3, 1000.0, 1e-3 * rho
    shear, bulk = young / 2 / (1 + poisson), young * poisson / (1 + poisson) / (1 - 2 * poisson)

    def bessel(k, scale):
        return [
            lambda r, d, f=f, sign=sign: f(2, k * r, d) * k**d * np.exp(sign * scale)
            for f, sign in ((ivp, -1), (kvp, 1))
        ]

    def powers():
        return [lambda r, d: (r**2, 2 * r, 2)[d], lambda r, d: (r**-2, -2 * r**-3, 6 * r**-4)[d]]

    def terms(phis, psis, mu, normal):  # of each potential: u_r, u_t, stress rr and rt
        def at(r):
            found = []
            for phi in phis:
                p = [phi(r, d) for d in range(3)]
                found.append(
                    (p[1], -2 * p[0] / r, 2 * mu * p[2] + normal * p[0], mu * (4 * p[0] / r**2 - 4 * p[1] / r))
                )
            for psi in psis:
                p = [psi(r, d) for d in range(3)]
                rr = 4 * mu * (p[1] / r - p[0] / r**2)
                found.append((2 * p[0] / r, -p[1], rr, mu * (p[1] / r - 4 * p[0] / r**2 - p[2])))
            return np.array(found).T

        return at

    fast, slow, layer = s / math.sqrt((bulk + 2 * shear) / density), s / math.sqrt(shear / density), np.sqrt(s / 1e-3)
    solid = terms(bessel(fast, 0), bessel(slow, 0), shear, bulk * fast**2)
    fluid = terms(powers(), bessel(layer, layer.real * 1.3), viscosity, rho * s)
    zero, wet = np.zeros((2, 4)), (solid(1.05), fluid(1.05))
    rows = [
        np.hstack([solid(0.95)[2:] / young, zero]), np.hstack([zero, fluid(1.5)[:2]]),
        np.hstack([s * wet[0][:2], -wet[1][:2]]), np.hstack([wet[0][2:], -wet[1][2:]]) / young,
    ]  # fmt: skip
    return np.linalg.det(np.vstack(rows))


def test_values_have_their_exact_numbers_in_narrow_bands():
    """Of every test the runs that a row names are made."""
    found = {test: acid.expected(test) for test in acid.TESTS}
    bands = [(found["cylinder"][0], acid.inflated(), 1e-6)]
    for index, modes in enumerate(acid.MODES.values()):
        bands += [(found["ring"][2 * index], modes[0], 1e-3), (found["ring"][2 * index + 1], modes[1], 2e-2)]
    for value, exact, part in bands:
        assert value.low == pytest.approx(exact - part * abs(exact), rel=1e-9)
        assert value.high == pytest.approx(exact + part * abs(exact), rel=1e-9)
    rows = pd.read_csv(acid.VALUES)
    unknown = rows["low"].isna() & rows["high"].isna()
    assert all(((rows["low"] < rows["high"]) | unknown) & rows["expected"].notna()) and set(rows["test"]) == set(found)


@pytest.mark.parametrize("test", acid.TESTS)
def test_every_value_is_found_in_the_runs_that_are_made(test, tmp_path):
    time, steady, runs = np.arange(0.05, 36, 0.05), {"quantities": {"tip_ux": 1.0, "tip_uy": 2.0}}, {}
    for name in scenes_of(test, acid.TESTS[test], tmp_path):
        omega, sigma = acid.MODES[int(name.split("-")[1])] if test == "ring" else (1.0, 0.0)
        wave = acid.AMPLITUDE * np.exp(sigma * time) * np.cos(omega * time)
        runs[name] = Run("", steady, history=pd.DataFrame({"time": time, "tip_ux": wave, "tip_uy": wave}))
    for value in acid.expected(test):
        assert np.isfinite(acid.of_row(value)(runs)).all(), value.quantity


@pytest.mark.parametrize("rho", acid.MODES)
def test_modes_of_the_ring_are_roots_of_its_determinant(rho):
    omega, sigma = acid.MODES[rho]
    start = complex(sigma, omega)
    s = newton(ring_determinant, 1.001 * start, args=(rho,), x1=0.9995 * start, tol=1e-12)
    assert (s.imag, s.real) == pytest.approx((omega, sigma), rel=1e-7)


def test_histories_are_compared_with_published_ones():
    known = acid.published("collapsible-1").iloc[1:]
    run = history(known["t"], tip_uy=known["value"] + np.where(np.isclose(known["t"], 1), 0.002, -0.001))
    assert acid.worst("collapsible-1", "tip_uy", 0.2)(run.history) == pytest.approx(0.01)
    peaks = {"collapsible-1": -0.21571, "collapsible-massless": -0.215634, "leaflet-0.0125": 0.374828}
    for name, published in {**peaks, "mok": 0.2695, "flap": 0.1986}.items():
        values = acid.published(name)["value"]
        assert values.iloc[values.abs().argmax()] == pytest.approx(published, rel=2e-2), name


def test_a_leaflet_of_no_thickness_lies_on_a_line():
    def of(h, n, k):
        return history([1.0], u=[3 + 2 * h + (n == 1) * 0.5 + (k == 0.02) * 0.25])

    runs = {f"leaflet-{h}-2-0.01": of(h, 2, 0.01) for h in (0.05, 0.025, 0.0125)}
    runs = {"leaflet-0.025-1-0.02": of(0.025, 1, 0.02), "leaflet-0.025-2-0.02": of(0.025, 2, 0.02), **runs}
    value, bar = acid.thin(acid.extreme("max", "u"))(runs)
    assert (value, bar) == pytest.approx((3, 0.75), rel=1e-12)


AREAS = {
    **{"cylinder": math.pi * 3 / 4, "ring": math.pi / 4 * (1.5**2 - 0.95**2), "collapsible": 25.5, "leaflet": 8},
    **{"blob": 9.75, "mok": 1.002, "flap": 24, "wall": 0.0233},
}


@pytest.mark.parametrize("test", acid.TESTS)
def test_scenes_are_valid_and_their_meshes_what_they_say(test, tmp_path):
    for name, scene in scenes_of(test, acid.TESTS[test], tmp_path).items():
        roles = {side.role for side in boundaries(scene)}
        pressed = set() if test == "collapsible" else {"inlet"}
        assert roles >= ({"loaded", "slip"} if "cylinder" in name else {"outlet", "no-slip", "interface"} | pressed)
        area = sum(scene.exact_areas().values())
        assert area == pytest.approx(AREAS[test], rel=1e-2 if test in ("cylinder", "ring") else 1e-9), name


def test_histories_are_drawn():
    drawn = {test["title"]: test["drawn"][0] for test in acid.TESTS.values() if "drawn" in test}
    runs = {name: history([0.0, 1.0], tip_ux=[0.0, 0.1], tip_uy=[0.0, 0.1]) for name in drawn.values()}
    assert [axes.get_title(loc="left") for axes in acid.draw(runs).axes] == [*drawn] and len(drawn) == 4
