"""Several inlets and outlets, inlets with a pressure: exact flows, the same as the single ones, wrong scripts."""

import numpy as np
import pytest
from own_mesh import scene_on, write_mesh
from structured import structured_mesh
from test_walls import RUBBER, WATER, state_of

from ffsi.result.domain import intended
from ffsi.run.one_scene import resume, solve
from ffsi.scene import Scene, SceneError, load_scene, with_values

LENGTH, RHO, MU = 3.0, WATER["density"], WATER["viscosity"]
SIDES = {"low": 1, "high": 2, "bottom": 3, "top": 4, "walls": 5, "ends": 6, "wet": 7}
NONE = {"kind": "do-nothing"}
LOW = {"low": {"pressure": 2}}
BOTH = {**LOW, "high": {"pressure": 2}}


def channel(folder, *, slip=False, wall=False, **tables) -> Scene:
    """A channel [0, 3] x [0, 1], each end of it in two parts; with slip sides, or an elastic block on the floor."""
    x, y = np.linspace(0, LENGTH, 10), np.linspace(0, 1, 5)

    def region(x, y):
        return 2 if wall and 1 < x < 1.7 and y < 0.25 else 1

    def label(x, y):
        if x in (0.0, LENGTH):
            return (1 if x == 0 else 3) + (y > 0.5)
        if wall and 0.99 < x < 1.68 and y < 0.26:
            return 6 if y == 0 else 7
        return 5

    solid = {"block": 2} if wall else {}
    path = write_mesh(folder / f"channel{wall}.msh", structured_mesh(x, y, region, label), {"fluid": 1, **solid}, SIDES)
    sides = {"inlet": ["low", "high"], "outlet": ["bottom", "top"], "slip" if slip else "walls": "walls"}
    sides |= {"clamped": "ends"} if wall else {}
    precise = {"solver": {"step_tolerance": 1e-12}} if "time" in tables else {}
    more = {"solid": {"block": RUBBER}} if wall else {}
    regions = {"fluid": "fluid"} | {name: name for name in solid}
    return scene_on(path, sides, regions, **{"fluid": WATER, **precise, **more, **tables})


def pressed(value: float) -> dict:
    return {"kind": "pressure", "pressure": value}


def poiseuille(result, drop: float) -> None:
    """Compare a state with the channel flow of a pressure that falls by so much over the length."""
    mesh, state = state_of(result)
    y = mesh.p2_coordinates[:, 1]
    speed = drop / (2 * MU * LENGTH)
    np.testing.assert_allclose(state.v, np.column_stack([speed * y * (1 - y), 0 * y]), rtol=0, atol=1e-9 * speed)


@pytest.mark.parametrize("direction", ["free", "normal"])
def test_a_pressure_drives_poiseuilles_flow_through_two_outlets(direction, tmp_path):
    inlets = {name: {"pressure": 2, "direction": direction} for name in ("low", "high")}
    scene = channel(tmp_path, inlet=inlets, outlet={"bottom": pressed(0.5), "top": pressed(0.5)})
    result = solve(scene, tmp_path / "run")
    assert result.checked
    poiseuille(result, 1.5)
    flow = 1.5 / (12 * MU * LENGTH)
    found = result.quantities
    for name in ("low", "high", "bottom", "top"):  # symmetry
        assert found[f"flow_through_{name}"] == pytest.approx(flow / 2, rel=1e-10)
    assert found["pressure_at_low"] == pytest.approx(2, rel=1e-10)
    assert found["pressure_at_top"] == pytest.approx(0.5, rel=1e-10)
    assert found["flow_rate_in"] == pytest.approx(flow, rel=1e-10)
    assert load_scene(tmp_path / "run/scene.toml") == scene
    assert {side["role"] for side in intended(scene)["boundaries"].values()} == {"inlet", "outlet", "no-slip"}


def test_two_inlets_make_one_profile(tmp_path):
    halves = {"low": {"flow_rate": 0.5, "profile": "6*y*(1-y)"}, "high": {"flow_rate": 0.5, "profile": "6*(y+H)*(H-y)"}}
    result = solve(channel(tmp_path, inlet=halves, outlet={"bottom": NONE, "top": NONE}), tmp_path / "run")
    assert result.checked
    poiseuille(result, 12 * MU * LENGTH)
    assert result.quantities["drag_coefficient"] > 0


def test_two_plugs_carry_what_they_are_said_to(tmp_path):
    """Less and less on coarser meshes, as their end nodes rest at the walls."""
    plugs = {name: {"flow_rate": rate, "profile": "uniform"} for name, rate in (("low", 0.5), ("high", 0.3))}
    result = solve(channel(tmp_path, inlet=plugs, outlet={"bottom": NONE, "top": NONE}), tmp_path / "run")
    assert result.checked
    found = result.quantities
    assert found["flow_through_bottom"] + found["flow_through_top"] == pytest.approx(found["flow_rate_in"], rel=1e-9)
    assert found["flow_through_high"] == pytest.approx(0.3, rel=1e-9)


def test_a_resistance_shares_the_pressure_with_the_channel(tmp_path):
    resistance = 4.0  # of each half of the outlet
    behind = {"kind": "resistance", "resistance": resistance}
    scene = channel(tmp_path, inlet=BOTH, outlet={"bottom": behind, "top": behind})
    result = solve(scene, tmp_path / "run")
    assert result.checked
    flow = 2 / (12 * MU * LENGTH + resistance / 2)
    poiseuille(result, 12 * MU * LENGTH * flow)
    assert result.quantities["pressure_at_top"] == pytest.approx(resistance / 2 * flow, rel=1e-9)
    slopes = solve(scene, tmp_path / "slopes", sensitivities=True)  # those of what vanishes by symmetry are rounding
    assert slopes.checked, slopes.reason
    assert slopes.data["sensitivities"]["flow_through_top"]["outlet.top.resistance"]["derivative"] < 0
    less = with_values(scene, {"outlet.bottom.resistance": 1, "inlet.high.flow_rate": 0.1})
    assert less.inlet["high"].pressure is None and less.inlet["high"].mean_velocity == pytest.approx(0.2)


WAVES = [{"waveform": "t"}, {"ramp": 0.3}, {"series": {"cosine": [0.5, 1.0], "sine": [0.0, 0.25]}, "period": 2.0}]


@pytest.mark.parametrize("wave", WAVES, ids=["formula", "ramp", "series"])
def test_a_plug_is_pushed(wave, tmp_path):
    """Between slip walls rho L dU/dt = P f(t) - R Q, which a step solves with what acts at t_n + theta k."""
    resistance, k = 3.0, 0.05
    behind = {"kind": "resistance", "resistance": resistance}  # of a half
    inlets = {name: {"pressure": 2, **wave} for name in ("low", "high")}
    time = {"step": k, "end": 8 * k, "scheme": "crank-nicolson"}
    scene = channel(tmp_path, slip=True, inlet=inlets, outlet={"bottom": behind, "top": behind}, time=time)
    result = solve(scene, tmp_path / "run")
    assert result.checked
    speed, flows, factor = 0.0, [], scene.inlet["low"].factor
    for n in range(8):
        theta = 1.0 if n < 2 and abs(float(factor(0.0))) > 0 else 0.5
        driven = 2 * float(factor((n + theta) * k)) - (1 - theta) * resistance / 2 * speed
        speed = (RHO * LENGTH * speed + k * driven) / (RHO * LENGTH + theta * k * resistance / 2)
        flows.append(speed / 2)
    history = result.history
    for name in ("low", "bottom"):
        np.testing.assert_allclose(history[f"flow_through_{name}"], flows, rtol=1e-9)
    last = history.iloc[-1]
    if "waveform" in wave or "ramp" in wave:  # theta = 1/2 loses nothing
        assert last["kinetic"] + last["dissipated"] == pytest.approx(last["work"], rel=1e-9)


@pytest.mark.parametrize("time", [None, {"step": 0.02, "end": 0.1}], ids=["steady", "in time"])
@pytest.mark.parametrize("kind", [{"kind": "zero-traction"}, {"kind": "resistance", "resistance": 2, "pressure": 1}])
def test_one_of_each_is_the_same_by_name(kind, time, tmp_path):
    """Beside an elastic block, with gravity, against the tables for a single inlet and outlet."""
    inflow = {"mean_velocity": 1.0, "profile": "6*y*(1-y)"} | ({"waveform": "sin(9*t)"} if time else {})
    outlet = kind | {"backflow": 0.3, "hydrostatic": True}
    tables = {"gravity": {"y": -1.0}, **({"time": time} if time else {})}
    many = channel(tmp_path, wall=True, inflow=inflow, outlet=outlet, **tables)
    geometry = many.geometry.model_dump(exclude_none=True)
    sides = {key: geometry["boundaries"].pop(key) for key in ("inlet", "outlet")}
    geometry |= {"inlets": {"in": sides["inlet"]}, "outlets": {"out": sides["outlet"]}}
    table = {**many.given(), "geometry": geometry, "inlet": {"in": inflow}, "outlet": {"out": outlet}}
    table.pop("inflow")
    one, named = (solve(scene, tmp_path / str(n)) for n, scene in enumerate((many, Scene.model_validate(table))))
    assert one.checked and named.checked
    (_, state), (_, same) = state_of(one), state_of(named)
    for field in ("u", "v", "p"):
        values = getattr(state, field)
        np.testing.assert_allclose(getattr(same, field), values, rtol=0, atol=1e-8 * np.abs(values).max())


def test_a_built_in_channel_has_them_too(tmp_path):
    geometry = {"kind": "channel", "length": LENGTH, "height": 1.0}
    tables = {"geometry": geometry, "fluid": WATER, "inlet": {"inlet": {"pressure": 2}}, "outlet": {"outlet": NONE}}
    result = solve(Scene.model_validate({"name": "pipe", **tables}), tmp_path / "run")
    assert result.checked
    poiseuille(result, 2)


def windkessels(folder, **time) -> Scene:
    """A plug between slip sides, pushed into a Windkessel of its own behind each half of the outlet."""
    inlets = {name: {"pressure": 2, "waveform": "t"} for name in ("low", "high")}
    behind = {"kind": "windkessel", "proximal_resistance": 1.0, "distal_resistance": 4.0, "compliance": 0.05}
    outlets = {"bottom": behind | {"pressure": 0.3}, "top": behind | {"pressure": 0.3}}
    return channel(folder, slip=True, inlet=inlets, outlet=outlets, time=time)


def test_each_outlet_has_a_windkessel_of_its_own(tmp_path):
    """Between slip walls rho L dU/dt = P t - R_p Q - p_c for each half, C dp_c/dt + (p_c - P_d)/R_d = Q = U/2.

    Its later half with half the step, other pressures and another compliance.
    """
    k, scheme = 0.05, "crank-nicolson"
    solve(windkessels(tmp_path, step=k, end=4 * k, scheme=scheme, checkpoint_interval=4 * k), tmp_path / "run")
    changed = {"time.step": k / 2, **{f"inlet.{name}.pressure": 3.0 for name in ("low", "high")}}
    changed |= {f"outlet.{name}.compliance": 0.08 for name in ("bottom", "top")}
    result = resume(tmp_path / "run", end=8 * k, values=changed)
    assert result.checked, result.reason
    assert result.data["time"]["changed"] == [{"step": 4, "time": 0.2, "settings": {**changed, "time.end": 0.4}}]
    speed, stored, at, flows, pressures = 0.0, 0.3, 0.0, [], []
    for k, pressure, compliance in [(0.05, 2.0, 0.05)] * 4 + [(0.025, 3.0, 0.08)] * 8:
        # unknowns: U and p_c at the end, theta = 1/2
        matrix = np.array([[RHO * LENGTH / k + 0.25, 0.5], [-0.25, compliance / k + 0.125]])
        right = [
            RHO * LENGTH / k * speed + pressure * (at + k / 2) - 0.25 * speed - 0.5 * stored,
            0.25 * speed + compliance / k * stored - 0.125 * stored + 0.3 / 4,
        ]
        speed, stored = np.linalg.solve(matrix, right)
        at += k
        flows.append(speed / 2)
        pressures.append(stored)
    for name in ("bottom", "top"):
        np.testing.assert_allclose(result.history[f"flow_through_{name}"], flows, rtol=1e-8)
        np.testing.assert_allclose(result.history[f"windkessel_{name}"], pressures, rtol=1e-8)
    last = result.history.iloc[-1]
    assert last["kinetic"] + last["dissipated"] == pytest.approx(last["work"], rel=1e-9)


def test_windkessels_go_on_from_a_checkpoint(tmp_path):
    whole = solve(windkessels(tmp_path, step=0.05, end=0.4), tmp_path / "whole")
    solve(windkessels(tmp_path, step=0.05, end=0.2, checkpoint_interval=0.05), tmp_path / "run")
    later = resume(tmp_path / "run", end=0.4)
    assert later.checked, later.reason
    for key in ("windkessel_bottom", "flow_through_top"):
        np.testing.assert_allclose(later.history[key], whole.history[key], rtol=1e-12)


# A wrong script does not pass.
WRONG = {
    "inlet": ("factor*inletFactor[j]*mean[j]", "-factor*inletFactor[j]*mean[j]"),
    "reported": ("-unitVelocity*unitLength*int1d", "unitVelocity*unitLength*int1d"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_script_is_caught(name, tmp_path, broken_script):
    broken_script(*WRONG[name])
    wave = {"waveform": "sin(9*t)"}
    inlets = {"low": {"pressure": 1, **wave}, "high": {"mean_velocity": 0.1, **wave}}
    outlets = {"bottom": {"kind": "resistance", "resistance": 2}, "top": NONE}
    time = {"step": 0.02, "end": 0.1}
    assert not solve(channel(tmp_path, inlet=inlets, outlet=outlets, time=time), tmp_path / "run").checked


REFUSED = [
    ({"inlet": LOW}, 'geometry.boundaries.inlet: each needs a table inlet.NAME of the scene.*without one: "high"'),
    ({"inlet": {**BOTH, "hihg": {"pressure": 1}}}, r'inlet\.hihg: no inlet of this name.*did you mean "high"'),
    ({"inlet": BOTH, "inflow": {"mean_velocity": 1}}, "inflow: not accepted beside tables inlet.NAME"),
    ({"inlet": {**LOW, "high": {"presure": 2}}}, r"inlet\.high\.presure.*did you mean .inlet.high.pressure"),
    ({"inlet": {**LOW, "high": {"pressure": 2, "mean_velocity": 1}}}, r"inlet\.high\.mean_velocity: .* are given"),
    ({"inlet": {**LOW, "high": {"pressure": 2, "profile": "y"}}},
     r"inlet\.high\.profile.*only accepted with a velocity"),
    ({"inlet": {**LOW, "high": {"pressure": 2, "waveform": "t"}}}, r"inlet\.high\.waveform.*table time"),
    ({"inlet": {**LOW, "high": {"pressure": "2 m"}}}, r"inlet\.high\.pressure = .2 m"),
    ({"inlet": {**LOW, "high": {"mean_velocity": 2, "direction": "normal"}}}, r"inlet\.high\.direction"),
    ({"inlet": BOTH, "outlet": {"bottom": {"kind": "presure"}, "top": NONE}}, r"outlet\.bottom\.kind.*did you mean"),
    ({"inlet": BOTH, "outlet": {"bottom": NONE, "top": pressed(1) | {"hydrostatic": True}}},
     r"outlet\.top\.hydrostatic"),
    ({"inlet": BOTH, "outlet": {"bottom": NONE, "kind": "do-nothing"}}, r"outlet\.kind.*must be a table"),
]  # fmt: skip


@pytest.mark.parametrize(("tables", "text"), REFUSED)
def test_refused(tables, text, tmp_path):
    with pytest.raises(SceneError, match=text):
        channel(tmp_path, **{"outlet": {"bottom": NONE, "top": NONE}, **tables})


def test_a_number_as_a_name_is_told_where_to_get_one(tmp_path):
    channel(tmp_path, inlet=BOTH, outlet={"bottom": NONE, "top": NONE})
    sides = {"inlet": ["low", "high"], "outlet": [3, 4], "walls": "walls"}
    with pytest.raises(SceneError, match=r"outlets = \{some_name = 3\} in geometry, not boundaries.outlet"):
        scene_on(
            tmp_path / "channelFalse.msh", sides, {"fluid": "fluid"}, fluid=WATER, inlet=BOTH,
            outlet={"3": NONE, "4": NONE},
        )  # fmt: skip
