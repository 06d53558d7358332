"""A scene in other units is the same scene: no limit and no default depends on the units of length, mass and time."""

import math
from pathlib import Path

import numpy as np
import pytest
from units_scaling import FACTORS, factor_of, in_units
from vessel_meshes import write_scene

from ffsi.scene import CASES, Scene, boundaries, load_scene
from ffsi.script.parameters import units_of
from ffsi.script.render import parameters, render


def same(there: Scene, here: Scene) -> None:
    assert there.words() == here.words()
    numbers = there.parameters()
    assert numbers.keys() == here.parameters().keys()
    for key, value in here.parameters().items():
        assert numbers[key] == pytest.approx(value, rel=1e-14, abs=0), key


def follows(scaled: Scene, scene: Scene, length: float) -> None:
    for there, here in zip(boundaries(scaled), boundaries(scene), strict=True):
        assert (there.name, there.role, there.part) == (here.name, here.role, here.part)
        assert there.exact_length == pytest.approx(length * here.exact_length, rel=1e-11)
    areas = {name: length**2 * area for name, area in scene.exact_areas().items()}
    assert scaled.exact_areas() == pytest.approx(areas, rel=1e-11)
    if scene.tip is not None:
        assert scaled.tip == pytest.approx([length * value for value in scene.tip], rel=1e-11)


@pytest.mark.parametrize("name", CASES)
def test_catalogue_in_other_units_with_its_default_sizes(name: str) -> None:
    scene = CASES[name]
    for length, mass, time in FACTORS:
        scaled = in_units(scene, length, mass, time)
        assert render(scaled, bundled=False)
        follows(scaled, scene, length)
        same(in_units(scaled, 1 / length, 1 / mass, 1 / time), scene)
    table = CASES[name].model_dump(exclude_none=True)
    for key in FOLLOWING:
        del table["mesh"][key]
    table.pop("forces", None)
    scene = Scene.model_validate(table)
    for length in (1e-6, 1e6):
        scaled = in_units(scene, length, 1.0, 1.0).model_dump(exclude_none=True)
        for key in FOLLOWING:
            del scaled["mesh"][key]
        scaled.pop("forces", None)
        there = Scene.model_validate(scaled)
        for key in FOLLOWING:
            scale = 1.0 if key == "growth" else length
            assert getattr(there.mesh, key) == pytest.approx(scale * getattr(scene.mesh, key), rel=1e-14, abs=0)
        same(in_units(there, 1 / length, 1.0, 1.0), scene)


# What is not given follows from what is: a table in other units without these keys is that scene in those units.
FOLLOWING = ("growth", "far_size", "body_size", "corner_size")


def test_formulas_keep_their_values() -> None:
    scene = load_scene(
        "turek-cfd3", ["inflow.profile=y*(0.41 - y)/0.042 + 0.1*sin(y/H)", "inflow.waveform=1 + 0.5*sin(12*t)"]
    )
    s, t = np.linspace(0.05, 0.95, 7), np.linspace(0.0, 12.0, 7)
    for length, mass, time in FACTORS:
        scaled = in_units(scene, length, mass, time)
        velocities = scaled.inflow_profile()(s * 0.41 * length) / scene.inflow_profile()(s * 0.41)
        assert velocities == pytest.approx(length / time, rel=1e-12)
        assert scaled.inflow.factor(t * time) == pytest.approx(scene.inflow.factor(t), rel=1e-9)


LAWS = [
    ["fluid.law=power-law", "fluid.consistency=0.017", "fluid.exponent=0.6"],
    ["fluid.law=casson", "fluid.yield_stress=0.004", "fluid.viscosity_infinity=0.0035"],
    ["fluid.law=carreau"],
]
OUTLETS = [
    ["outlet.kind=resistance", "outlet.resistance=10"],
    ["outlet.kind=windkessel", "outlet.proximal_resistance=1", "outlet.distal_resistance=2", "outlet.compliance=1e-3"],
]


@pytest.mark.parametrize("overrides", [*LAWS, *OUTLETS, ["support.damping=3", "support.stiffness=2"]])
def test_other_keys_in_other_units(overrides: list[str]) -> None:
    scene = load_scene("aneurysm-pulsatile", overrides)
    for length, mass, time in FACTORS:
        scaled = in_units(scene, length, mass, time)
        if scene.fluid != CASES["aneurysm-pulsatile"].fluid:
            rates = np.array([0.0, 0.01, 1.0, 300.0])
            viscosity = scaled.fluid.apparent_viscosity(rates / time) / scene.fluid.apparent_viscosity(rates)
            assert viscosity == pytest.approx(mass / length / time, rel=1e-12)
        same(in_units(scaled, 1 / length, 1 / mass, 1 / time), scene)


def test_factors_and_a_mesh_of_a_file_in_other_units(tmp_path: Path) -> None:
    assert factor_of("Pa s/m^2", 2.0, 3.0, 5.0) == pytest.approx(3 / 2**3 / 5)
    assert factor_of("Pa s^m", 2.0, 3.0, 5.0, 0.5) == pytest.approx(3 / 2 / 5**2 * 5**0.5)
    assert factor_of("m^2/Pa", 2.0, 3.0, 5.0) == pytest.approx(2**3 * 5**2 / 3)
    scene = load_scene(write_scene(tmp_path))
    for length in (1e-6, 1e6):
        (tmp_path / str(length)).mkdir()
        (tmp_path / f"back-{length}").mkdir()
        scaled = in_units(scene, length, 1.0, 1.0, tmp_path / str(length))
        follows(scaled, scene, length)
        back = in_units(scaled, 1 / length, 1.0, 1.0, tmp_path / f"back-{length}")
        assert back.parameters() == pytest.approx(scene.parameters(), rel=1e-12)
        follows(back, scene, 1.0)


CHOSEN = {"unit_of_length": "m", "unit_of_size": "m", "viscosity": "Pa s", "viscous": "Pa", "drives": "Pa"}
CHOSEN |= {"unit_of_rest": "m/s", "unit_of_stiffness": "Pa", "unit_of_density": "kg/m^3"}


def chosen(scene: Scene) -> dict[str, float]:
    numbers = parameters(scene)
    names = {p.variable: p.value for p in numbers} | {"sqrt": math.sqrt}
    found = units_of(scene, numbers)
    names["unitLength"] = eval(found["unit_of_length"].replace("^", "**"), names)
    if scene.fluid:
        names["size"] = eval(found["unit_of_size"].replace("^", "**"), names)
        names["unitVelocity"] = names["inflowMeanVelocity"]
    lists = {name: [formula] if isinstance(formula, str) else formula for name, formula in found.items()}
    return {
        f"{name} {number}": eval(formula.replace("^", "**"), names)
        for name, formulas in lists.items()
        for number, formula in enumerate(formulas)
    }


SCENES = [("aneurysm", settings) for settings in ([], *LAWS, *OUTLETS)] + [("turek-csm1", []), ("cook", [])]


@pytest.mark.parametrize(("name", "overrides"), SCENES)
def test_units_of_the_script_have_their_dimensions(name: str, overrides: list[str]) -> None:
    scene = load_scene(name, overrides)
    here = chosen(scene)
    for factors in FACTORS:
        there = chosen(in_units(scene, *factors))
        for key, value in here.items():
            assert there[key] == pytest.approx(value * factor_of(CHOSEN[key.split()[0]], *factors), rel=1e-9), key
