"""What is evaluated after a run does not depend on the units of its scene: a run's raw unknowns in others."""

from dataclasses import replace

import numpy as np
import pytest
from units_scaling import factor_of, in_units

from ffsi.files.arrays import RawMesh, read_mesh, read_state
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
    scaled = RawMesh(**{**vars_of(mesh), "vertices": length * mesh.vertices})
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


def vars_of(mesh: RawMesh) -> dict[str, np.ndarray]:
    """Return the arrays of a mesh without what it has derived from them."""
    return {name: getattr(mesh, name) for name in mesh.__dataclass_fields__}
