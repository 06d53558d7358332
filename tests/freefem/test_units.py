"""Runs in other units, and what is evaluated after them: the same numbers and the same iterations.

Some scenes here, one mixture of units each; every scene of the catalogue is in tests/verification/test_units.py.
"""

from dataclasses import replace

import numpy as np
import pytest
from conftest import PLAIN
from units_scaling import compare, factor_of, first_steps, in_units

from ffsi.files.arrays import read_mesh, read_state
from ffsi.hemodynamics.aneurysm import AneurysmState
from ffsi.result import pictures
from ffsi.result.fields import Fields
from ffsi.result.quantities import unit

UNITS = [(1e-6, 1.0, 1.0), (1e6, 1e-6, 1e6), (1e-6, 1e6, 1e-6), (1e6, 1e6, 1.0), (1.0, 1e-6, 1e-6)]
NAMES = {"wall_shear_stress": "Pa", "effective_stress": "Pa"}


def assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.nanmax(np.abs(expected)))


@pytest.mark.parametrize("units", UNITS)
def test_an_aneurysm_in_other_units(solved, units):
    result = solved("aneurysm")
    mesh = read_mesh(result.directory / "mesh.bin")
    state = read_state(result.directory / "point-0001.bin", mesh)
    length, speed, stress = (factor_of(name, *units) for name in ("m", "m/s", "Pa"))
    scaled = replace(mesh, vertices=length * mesh.vertices)
    other = replace(state, u=length * state.u, v=speed * state.v, p=stress * state.p, ps=stress * state.ps)
    fields = Fields.from_raw(scaled, other, (2, 3))
    found = AneurysmState(in_units(result.scene, *units), scaled, other, fields)
    plain = result.aneurysm
    assert list(found.quantities) == list(plain.quantities)
    for name, value in plain.quantities.items():
        expected = pytest.approx(value * factor_of(unit(name), *units), rel=1e-9, abs=1e-12 if unit(name) == "1" else 0)
        assert found.quantities[name] == expected, name
    for name, values in plain.point_data.items():
        assert_close(found.point_data[name], values * factor_of(NAMES[name], *units))
    wall, before = found.wall, plain.wall
    assert wall["part"].tolist() == before["part"].tolist() and wall["line"].tolist() == before["line"].tolist()
    for name, factor in {"arc": length, "x": length, "wss": stress, "pressure": stress}.items():
        assert_close(wall[name].to_numpy(), before[name].to_numpy() * factor)
    at = mesh.vertices[mesh.triangles].mean(axis=1)
    for name, factor in {"ux": length, "vy": speed, "p": stress, "region": 1.0}.items():
        assert_close(fields.sample(length * at)[name], result.fields.sample(at)[name] * factor)
    assert all(len(pictures.to_png(pictures.draw(name, fields), 50)) > 1000 for name in pictures.available(fields))


MIXTURES = {
    "cook": (1e6, 1e-6, 1e3), "flap-neo-hookean": (1e-6, 1e6, 1e-3), "turek-cfd1": (1e3, 1e-6, 1e6),
    "turek-csm3": (1e-6, 1e-6, 1e6), "turek-fsi3": (1e6, 1e-6, 1e-3),
}  # fmt: skip
LAWS = {"turek-cfd1": ['fluid={law="power-law", density=1000, consistency=1, exponent=0.6}']}


@pytest.mark.parametrize("case", MIXTURES)
def test_other_units_are_the_same_computation(tmp_path, case):
    settings = ["mesh.level=0", "mesh.size_factor=2", *PLAIN, *first_steps(case, 5), *LAWS.get(case, [])]
    assert compare(case, settings, *MIXTURES[case], tmp_path) < 1e-8
