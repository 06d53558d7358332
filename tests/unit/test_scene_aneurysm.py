"""The aneurysm's variants: rigid walls, walls of another thickness, struts of a stent; and what does not fit."""

import math

import numpy as np
import pytest

from ffsi.scene import CASES, Aneurysm, Scene, SceneError, boundaries, load_scene
from ffsi.scene.geometry import dome
from ffsi.script.render import render


def rigid(**geometry: object) -> Scene:
    table = CASES["aneurysm"].model_dump(exclude_none=True)
    kept = {key: table[key] for key in table if key not in ("solid", "mesh_motion")}
    return Scene.model_validate(kept | {"geometry": {"kind": "aneurysm", **geometry}})


def test_areas_outline_and_thickness_are_those_of_the_source() -> None:
    found = {boundary.label: boundary.role for boundary in boundaries(rigid())}
    assert found == {1: "inlet", 2: "outlet", 13: "no-slip", 14: "no-slip", 15: "no-slip"}
    assert rigid().exact_areas() == {"fluid": CASES["aneurysm"].exact_areas()["fluid"]}
    # Stated there for a dome closed by its chord and for a polygon; the curve through its points is a little fuller.
    areas = {name: 1e6 * area for name, area in CASES["aneurysm"].exact_areas().items()}
    assert areas["fluid"] - 21.99 == pytest.approx(4.409, rel=0.01)
    assert areas["vessel"] + areas["dome"] == pytest.approx(5.66, rel=0.02)
    points = dome.curve(dome.knots())
    assert points == pytest.approx(dome.lumen().outline, abs=1e-17)
    assert math.hypot(*points[0]) == pytest.approx(8e-3, rel=1e-14)
    s = np.linspace(0, dome.knots()[-1], 50)
    assert np.hypot(*(dome.curve(s, 2e-4) - dome.curve(s)).T) == pytest.approx(2e-4)
    thick = load_scene("aneurysm", ["geometry.dome_wall_thickness=0.2 mm"]).exact_areas()
    thin = CASES["aneurysm"].exact_areas()
    assert thick["dome"] / thin["dome"] == pytest.approx(0.2 / 0.125, rel=0.05)
    assert (thick["fluid"], thick["vessel"]) == (thin["fluid"], thin["vessel"])


@pytest.mark.parametrize("elastic", [True, False])
def test_struts_are_rigid_circles_on_the_neck_line(elastic: bool) -> None:
    settings = ["geometry.stent.count=3", "geometry.stent.diameter=0.2 mm"]
    scene = load_scene("aneurysm", settings) if elastic else rigid(stent={"count": 3, "diameter": 2e-4})
    struts = [boundary for boundary in boundaries(scene) if boundary.label >= 20]
    assert [(strut.label, strut.role) for strut in struts] == [(20, "no-slip"), (21, "no-slip"), (22, "no-slip")]
    centres = np.array([strut.circle[:2] for strut in struts if strut.circle])
    neck = np.array([[-4.7613e-3, 6.4289e-3], [-6.252e-3, 4.9912e-3]])
    assert centres == pytest.approx(neck[0] + np.array([[1], [3], [5]]) / 6 * (neck[1] - neck[0]), rel=1e-4)
    assert all(strut.exact_length == pytest.approx(math.pi * 2e-4) for strut in struts)
    without = CASES["aneurysm"].exact_areas()["fluid"]
    assert scene.exact_areas()["fluid"] == pytest.approx(without - 3 * math.pi * 1e-8)
    assert "nStruts = 3" in render(scene)


@pytest.mark.parametrize(("settings", "words"), [
    (["geometry.wall_thickness=1 mm"], "geometry.wall_thickness"),
    (["geometry.dome_wall_thickness=0.4 mm"], "geometry.dome_wall_thickness"),
    (["geometry.stent.count=10", "geometry.stent.diameter=0.2 mm"], "geometry.stent.diameter"),
    (["geometry.stent.count=21"], "geometry.stent.count"),
    (["solid.flap.density=1"], "solid.flap"),
])  # fmt: skip
def test_what_does_not_fit_is_named(settings: list[str], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        load_scene("aneurysm", settings)


def test_what_does_not_fit_an_aneurysm_is_refused() -> None:
    with pytest.raises(SceneError, match=r'geometry.cylinder_x = 1: unknown key; .* "aneurysm" has [^?]*$'):
        load_scene("aneurysm", ["geometry.cylinder_x=1"])
    with pytest.raises(SceneError, match=r'did you mean "geometry.stent.diameter"'):
        load_scene("aneurysm", ["geometry.diametre=1"])
    period, late = CASES["aneurysm-pulsatile"].inflow.period, ["output.wall.first_cycle=5"]
    with pytest.raises(
        SceneError, match=r"output.wall.first_cycle = 5: accepted: at most 4, the last whole cycle \(time"
    ):
        load_scene("aneurysm-pulsatile", late)
    assert load_scene("aneurysm-pulsatile", [*late, f"time.end={5 * period}"]).output.wall.first_cycle == 5
    assert load_scene("aneurysm-pulsatile", ["time.end=0.12"]).output.wall.first_cycle == 1  # a trial
    table = CASES["aneurysm"].model_dump(exclude_none=True)
    del table["solid"]["dome"]
    with pytest.raises(SceneError, match=r"solid\.dome"):
        Scene.model_validate(table)
    table = CASES["aneurysm"].model_dump(exclude_none=True)
    with pytest.raises(SceneError, match="fluid"):
        Scene.model_validate({key: table[key] for key in ("name", "geometry", "solid")})
    inlet = Aneurysm().inlet
    assert (inlet.start, inlet.inward, inlet.height) == ((0.0, 8e-3), (-1.0, 0.0), pytest.approx(2e-3))
