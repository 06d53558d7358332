"""Labels, roles, lengths and areas, against outlines drawn here; the aneurysm's variants; the plain channel."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from ffsi.scene import CASES, Aneurysm, Scene, SceneError, boundaries, load_scene
from ffsi.scene.geometry import Channel, dome
from ffsi.scene.numerics import Mesh
from ffsi.script.render import render

Points = Sequence[tuple[float, float]]


def arc(x: float, y: float, radius: float, start: float, end: float, pieces: int = 20000) -> Points:
    angles = np.radians(np.linspace(start, end, pieces + 1))
    return list(zip(x + radius * np.cos(angles), y + radius * np.sin(angles), strict=True))


def length_and_area(outline: Points) -> tuple[float, float]:
    x, y = np.array(outline).T
    dx, dy = np.roll(x, -1) - x, np.roll(y, -1) - y
    return float(np.hypot(dx, dy).sum()), abs(float((x * dy - y * dx).sum()) / 2)


def box(x0: float, y0: float, x1: float, y1: float) -> Points:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


FLAP = box(0.5, 0, 0.54, 0.2)
CHANNEL_WITHOUT_FLAP = [(0, 0), (0.5, 0), (0.5, 0.2), (0.54, 0.2), (0.54, 0), (2.5, 0), (2.5, 0.4), (0, 0.4)]
ANGLE = math.degrees(math.asin(0.01 / 0.05))
BODY = [*arc(0.2, 0.2, 0.05, ANGLE, 360 - ANGLE), (0.6, 0.19), (0.6, 0.21)]
BEAM = [*arc(0.2, 0.2, 0.05, ANGLE, -ANGLE), (0.6, 0.19), (0.6, 0.21)]
CAVITY = [
    (0, 0), *arc(1.75, -0.25, 0.25, 90, 0), (2, -1), (6, -1), *arc(6.25, -0.25, 0.25, 180, 90), (14, 0), (14, 1),
    (0, 1),
]  # fmt: skip
FLOOR = box(2, -1.4, 6, -1)


def aneurysm() -> dict[str, list[Points]]:
    """Fluid, vessel (three pieces that meet in points, as one outline) and dome of the aneurysm, in metres."""
    outline = 1e-3 * np.array([
        [-4.7613, 6.4289], [-5.3399, 6.6365], [-5.9055, 6.8295], [-6.4651, 7.0387], [-6.75, 7.125], [-7.3321, 6.9607],
        [-7.7481, 6.519], [-7.8724, 5.9242], [-7.6694, 5.352], [-7.1994, 4.9667], [-6.5953, 4.8857], [-6.252, 4.9912],
    ])  # fmt: skip
    outline[[0, -1]] *= 8e-3 / np.hypot(*outline[[0, -1]].T)[:, None]
    spline = CubicSpline(np.cumsum([0, *np.hypot(*np.diff(outline, axis=0).T)]), outline)
    s = np.linspace(0, spline.x[-1], 400001)
    wet, slope = spline(s), spline(s, 1)
    dry = wet + 0.125e-3 * np.column_stack([slope[:, 1], -slope[:, 0]]) / np.hypot(*slope.T)[:, None]
    out, shell = (np.flatnonzero(np.hypot(*curve.T) > 8.25e-3) for curve in (wet, dry))
    angle = [math.degrees(math.atan2(y, x)) for x, y in (wet[0], wet[-1], wet[out[0]], wet[out[-1]], dry[shell[0]],
                                                         dry[shell[-1]])]  # fmt: skip
    first, last = wet[: out[0] + 1], wet[out[-1] :]
    lumen = [*arc(0, 0, 8e-3, 90, angle[0]), *wet[1:-1], *arc(0, 0, 8e-3, angle[1], 180), *arc(0, 0, 6e-3, 180, 90)]
    inner = [*arc(0, 0, 6e-3, 90, 180), *arc(0, 0, 5.75e-3, 180, 90)]
    upstream = [*arc(0, 0, 8.25e-3, 90, angle[2]), *first[::-1], *arc(0, 0, 8e-3, angle[0], 90)]
    downstream = [*arc(0, 0, 8.25e-3, angle[3], 180), *arc(0, 0, 8e-3, 180, angle[1]), *last[::-1]]
    dome = [*dry[shell[0] : shell[-1]], *arc(0, 0, 8.25e-3, angle[5], angle[3]), *wet[out[0] : out[-1]][::-1],
            *arc(0, 0, 8.25e-3, angle[2], angle[4])]  # fmt: skip
    return {"fluid": [lumen], "vessel": [inner, upstream, downstream], "dome": [dome]}


# Cases with the same outline.
FLAPS = ("flap-svk", "flap-neo-hookean", "flap-mooney-rivlin")
ROOFS = ("flap-neo-hookean-roof", "flap-mooney-rivlin-roof")
CFD, CSM, FSI = (tuple(f"turek-{kind}{number}" for number in (1, 2, 3)) for kind in ("cfd", "csm", "fsi"))
CYLINDERS, ANEURYSMS = ("cylinder-2d1", "cylinder-2d2"), ("aneurysm", "aneurysm-carreau", "aneurysm-pulsatile")

# For each region of each case: the outlines (outer, then holes).
OUTLINES: dict[str, dict[str, list[Points]]] = {
    **{key: {"fluid": [CHANNEL_WITHOUT_FLAP], "flap": [FLAP]} for key in FLAPS},
    **{key: {"fluid": [CHANNEL_WITHOUT_FLAP], "flap": [FLAP], "roof": [box(0, 0.4, 2.5, 0.42)]} for key in ROOFS},
    **{key: {"fluid": [box(0, 0, 2.5, 0.41), BODY]} for key in CFD},
    **{key: {"beam": [BEAM]} for key in CSM},
    **{key: {"fluid": [box(0, 0, 2.5, 0.41), BODY], "beam": [BEAM]} for key in FSI},
    **{key: {"fluid": [box(0, 0, 2.2, 0.41), arc(0.2, 0.2, 0.05, 0, 360)]} for key in CYLINDERS},
    **dict.fromkeys(ANEURYSMS, aneurysm()),
    "cavity-flexible-floor": {"fluid": [CAVITY], "floor": [FLOOR]},
    "cook": {"membrane": [[(0, 0), (48, 44), (48, 60), (0, 44)]]},
    "cantilever": {"beam": [box(0, 0, 1, 0.01)]},
}

# The labels around a region.
WET, DRY = {1, 2, 3, 4, 5, 8, 9, 10, 13, 14, 15}, {5, 6, 7, 12}
SIDES = {key: {"fluid": WET, "flap": {5, 6}, "roof": {7, 10, 11}} for key in ROOFS}

INLET, OUTLET, WALLS = (1, "inlet", None), (2, "outlet", None), (3, "no-slip", None)


def test_tables_cover_the_catalogue() -> None:
    assert set(OUTLINES) == set(CASES)


@pytest.mark.parametrize("case", CASES)
def test_areas_and_perimeters(case: str) -> None:
    areas = CASES[case].exact_areas()
    assert list(areas) == list(OUTLINES[case])
    for name, (outer, *others) in OUTLINES[case].items():
        sign = 1 if name == "vessel" else -1  # three pieces; elsewhere what follows are holes
        area = length_and_area(outer)[1] + sign * sum(length_and_area(other)[1] for other in others)
        assert areas[name] == pytest.approx(area, rel=1e-8)
    found = {boundary.label: boundary.exact_length for boundary in boundaries(CASES[case])}
    for name, outlines in OUTLINES[case].items():
        if case in ANEURYSMS and name != "fluid":
            continue  # its solids touch each other along a line without a label
        sides = SIDES.get(case, {}).get(name, WET if name == "fluid" else DRY)
        length = sum(length_and_area(outline)[0] for outline in outlines)
        assert sum(found[label] for label in sides & found.keys()) == pytest.approx(length, rel=1e-8)


def test_arcs_tips_and_scenes_of_one_part() -> None:
    circles = {
        case: found
        for case, scene in CASES.items()
        if (found := {boundary.label: boundary.circle for boundary in boundaries(scene) if boundary.circle})
    }
    cylinder = (0.2, 0.2, 0.05)
    bent = {13: (0.0, 0.0, 0.006), 14: (0.0, 0.0, 0.008)}
    assert circles == {
        **{key: {4: cylinder} for key in (*CFD, *CYLINDERS)},
        **{key: {6: cylinder} for key in CSM},
        **{key: {4: cylinder, 6: cylinder} for key in FSI},
        "cavity-flexible-floor": {8: (1.75, -0.25, 0.25), 9: (6.25, -0.25, 0.25)},
        **dict.fromkeys(ANEURYSMS, bent),
    }
    # The root of a beam is an arc, too, but clamped.
    roles = {boundary.label: boundary.role for boundary in boundaries(CASES["turek-fsi1"]) if boundary.circle}
    assert roles == {4: "no-slip", 6: "clamped"}
    table = CASES["flap-svk"].model_dump(exclude_none=True)
    rigid = Scene.model_validate({key: table[key] for key in table if key not in ("solid", "mesh_motion")})
    assert rigid.physics == "fluid"
    assert [(b.label, b.role, b.part) for b in boundaries(rigid)] == [INLET, OUTLET, WALLS, (5, "no-slip", "flap")]
    assert rigid.exact_areas() == {"fluid": pytest.approx(0.992)} and rigid.tip is None
    alone = Scene.model_validate({key: table[key] for key in ("name", "geometry", "solid")})
    assert alone.physics == "solid"
    assert [(b.label, b.role, b.part) for b in boundaries(alone)] == [(5, "free", None), (6, "clamped", None)]
    assert alone.exact_areas() == {"flap": pytest.approx(0.008)}
    with pytest.raises(SceneError, match="inflow"):
        alone.inflow_profile()
    tips = {case: scene.tip for case, scene in CASES.items() if scene.tip}
    expected = {
        **dict.fromkeys((*FLAPS, *ROOFS), (0.52, 0.2)), **dict.fromkeys((*CSM, *FSI), (0.6, 0.2)),
        "cavity-flexible-floor": (4.0, -1.0), **dict.fromkeys(ANEURYSMS, (-7.7481e-3, 6.519e-3)), "cook": (48.0, 60.0),
        "cantilever": (1.0, 0.005),
    }  # fmt: skip
    assert set(tips) == set(expected)
    for case, tip in expected.items():
        assert tips[case] == pytest.approx(tip, rel=1e-14)


def test_lengths_and_probes_follow_the_numbers() -> None:
    scene = load_scene("cavity-flexible-floor", ["geometry.cavity_width=5", "geometry.floor_thickness=0.2"])
    found = {boundary.name: boundary.exact_length for boundary in boundaries(scene)}
    assert (found["surface"], found["outer_side"], found["ends"]) == (5.0, 5.0, 0.4)
    assert scene.tip == (4.5, -1.0)
    probes = {case: scene.probes for case, scene in CASES.items() if scene.probes}
    assert probes == {case: {"roof": (1.25, 0.4)} for case in ROOFS}
    scene = load_scene("flap-neo-hookean-roof", ["geometry.length=3", "geometry.height=0.5"])
    assert scene.probes == {"roof": (1.5, 0.5)}
    scene = load_scene("flap-neo-hookean-roof", ["geometry.roof.thickness=3 cm", "geometry.length=2"])
    found = {boundary.name: boundary.exact_length for boundary in boundaries(scene)}
    assert found["walls"] == pytest.approx(1.96)
    assert (found["roof"], found["outer_side"], found["roof_ends"]) == (2.0, 2.0, 0.06)
    assert scene.exact_areas()["roof"] == pytest.approx(0.06)
    panel = load_scene("cook", ["geometry.rise=-3", "geometry.width=4", "geometry.left_height=2",
                                "geometry.right_height=8"])  # fmt: skip
    found = {boundary.name: boundary.exact_length for boundary in boundaries(panel)}
    assert found == {"clamped_side": 2.0, "free_sides": 5.0 + 5.0, "loaded_side": 8.0}
    assert panel.exact_areas() == {"membrane": 20.0} and panel.tip == (4.0, 5.0)
    strip = load_scene("cantilever", ["geometry.length=2", "geometry.thickness=0.5"])
    assert strip.exact_areas() == {"beam": 1.0} and strip.tip == (2.0, 0.25)
    with pytest.raises(SceneError, match="inflow"):
        strip.inflow_profile()


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


def test_what_does_not_fit_an_aneurysm_is_refused() -> None:
    with pytest.raises(SceneError, match=r'geometry.cylinder_x = 1: unknown key; .* "aneurysm" has [^?]*$'):
        load_scene("aneurysm", ["geometry.cylinder_x=1"])
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


def channel(mesh: dict[str, Any] | None = None, **geometry: object) -> Scene:
    flow = {
        key: getattr(CASES["turek-cfd1"], key).model_dump(exclude_none=True) for key in ("fluid", "inflow", "outlet")
    }
    table = {"name": "channel", "geometry": {"kind": "channel", "length": 3.0, "height": 0.5, **geometry}, **flow}
    return Scene.model_validate(table | {"mesh": mesh or {}})


def test_a_channel_has_walls_with_forces_and_lengths_by_its_height() -> None:
    found = {b.name: (b.label, b.role, b.part, b.exact_length) for b in boundaries(channel())}
    sides = {"inlet": (1, "inlet", None, 0.5), "outlet": (2, "outlet", None, 0.5)}
    assert found == sides | {"walls": (3, "no-slip", "walls", 6.0)}
    assert channel().exact_areas() == {"fluid": 1.5} and channel().physics == "fluid"
    assert (channel().tip, channel().probes) == (None, {})
    scene = channel(height="2 mm")
    assert scene.forces is not None and scene.forces.reference_length == 0.002
    sizes, unit = scene.mesh, Channel.default_sizes
    assert sizes.growth == unit["growth"]
    assert (sizes.far_size, sizes.body_size) == pytest.approx((0.002 * unit["far_size"], 0.002 * unit["body_size"]))
    given = channel({"body_size": 0.01})
    assert given.mesh == Mesh(**{**channel().mesh.model_dump(), "body_size": 0.01})
    assert given.mesh.far_size == 0.5 * unit["far_size"]
    assert "adaptmesh(" not in render(channel()) and "adaptmesh(" in render(CASES["turek-cfd1"])
    assert Scene.from_toml(channel().to_toml()) == channel()
