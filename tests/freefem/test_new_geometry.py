"""The section "A new geometry" of docs/extend.md, done to a copy of the program and nothing else, and run there."""

from pathlib import Path

import pytest
from recipes import attempt, copy_program, differing, insert, join_union, read_places, refused, replace, result_of, run

UNION_FILE = "ffsi/scene/geometry/__init__.py"
PLACES = read_places("A new geometry")
LIBRARY, SCENE = (place.files[0] for place in PLACES[:2])
SOLID = """
[solid.wall]
material = "neo-hookean"
density = 1
young_modulus = 1e6
poisson_ratio = 0.4
"""
FLUID = """
[fluid]
density = 1
viscosity = 0.01

[inflow]
mean_velocity = 1

[outlet]
kind = "pressure"
pressure = 1
"""


def scene(root: Path, *tables: str) -> str:
    path = root / "scene.toml"
    path.write_text("\n".join(['name = "tube"', "[geometry]", 'kind = "collapsible-channel"', *tables]))
    return str(path)


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    assert PLACES[2].files[0] == UNION_FILE
    (library,), (geometry,), (imported,) = [place.blocks for place in PLACES]
    root = copy_program(tmp_path_factory.mktemp("copy"))
    (root / LIBRARY).write_text(library, encoding="utf-8")
    (root / SCENE).write_text(geometry, encoding="utf-8")
    insert(root / UNION_FILE, "from ffsi.scene.geometry.flap", imported)
    join_union(root / UNION_FILE, "    FlapChannel |", "CollapsibleChannel")
    return root


def test_fluid_and_solids_steady_and_in_time(copy):
    found = result_of(run(copy, scene(copy, SOLID, FLUID), "both"))
    assert found["regions"] == pytest.approx({"fluid": 8.0, "wall": 0.4}, rel=1e-6)
    assert found["boundaries"]["surface"]["role"] == "interface"
    # Poiseuille's pressure in the middle and that of the outlet bend a clamped strip by q l^4/(384 E I/(1 - nu^2)).
    bent = (1 + 12 * 0.01 * 4) * 4**4 / (384 * 1e6 / (1 - 0.4**2) * 0.1**3 / 12)
    assert found["quantities"]["tip_uy"] == pytest.approx(bent, rel=0.03)
    steps = "[time]\nstep = 0.05\nend = 0.1\n[support]\nstiffness = 100\ndamping = 1"
    found = result_of(run(copy, scene(copy, SOLID, FLUID, steps), "time"))
    assert found["boundaries"]["outer_side"]["role"] == "supported"
    found = result_of(run(copy, scene(copy, FLUID), "rigid"))["quantities"]
    assert found["pressure_drop"] == pytest.approx(12 * 0.01 * 8, rel=1e-6)
    assert found["drag"] == pytest.approx(6 * 0.01 * 4, rel=1e-6)
    # Under its weight.
    found = result_of(run(copy, scene(copy, SOLID, "[gravity]", "y = -15"), "solid"))["quantities"]
    assert found["tip_uy"] == pytest.approx(-1.5 * 4**4 / (384 * 1e6 / (1 - 0.4**2) * 0.1**3 / 12), rel=0.03)


def test_mistakes_are_caught(copy):
    tables = scene(copy, SOLID, FLUID)
    told = refused(copy, LIBRARY, "tipX = (wallLeft+wallRight)/2", "tipX = (wallLeft+wallRight)/3", tables)
    assert "tip_ux is reported" in told or "tip_uy is reported" in told
    replace(copy / LIBRARY, "wallTop-geometryWallThickness*t; label = 6", "wallTop-geometryWallThickness*t; label = 7")
    done = attempt(copy, tables, "label")
    replace(copy / LIBRARY, "wallTop-geometryWallThickness*t; label = 7", "wallTop-geometryWallThickness*t; label = 6")
    assert done.returncode == 2 and "mesh: the length of the ends is" in done.stderr


def test_what_does_not_fit_is_refused_and_nothing_else_touched(copy):
    done = attempt(copy, scene(copy, SOLID, FLUID), "long", "geometry.wall_length=6")
    assert done.returncode == 2 and "geometry.wall_length = 6" in done.stderr
    assert differing(copy) == ({UNION_FILE}, {LIBRARY, SCENE})
