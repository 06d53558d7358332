"""The checker on inlets, outlets and supports: it agrees with the right script and catches one wrong sign."""

import pytest
from conftest import scene_of

from ffsi.freefem import FreeFEMError
from ffsi.reference import check_run
from ffsi.scene import Scene
from ffsi.script.render import render

REVERSED = "-1.5 * 4 * y * (H - y) / H^2"  # the flow comes in at the outlet
WINDKESSEL = {"kind": "windkessel", "proximal_resistance": 3.0, "distal_resistance": 5.0, "compliance": 0.1}


def channel(outlet: dict[str, object], **inflow: object) -> Scene:
    table: dict[str, object] = {
        "name": "channel", "geometry": {"kind": "channel", "length": 2.0, "height": 1.0}, "mesh": {"level": 0},
        "fluid": {"density": 1.0, "viscosity": 0.1}, "inflow": {"mean_velocity": 1.0} | inflow, "outlet": outlet,
        "output": {"vtu": False, "pictures": False},
    }  # fmt: skip
    if "waveform" in inflow:
        table["time"] = {"step": 0.1, "end": 0.4, "output_interval": 0.2}
    return Scene.model_validate(table)


SUPPORT = ("support.stiffness=100", "support.damping=3")
ROOF = ("flap-neo-hookean-roof", "mesh.size_factor=2", "inflow.mean_velocity=0.05", *SUPPORT)
MOVING = ("time={step=0.02, end=0.1}", "inflow.ramp=0.1", "mesh_motion.kind=harmonic")
STEADY, IN_TIME = scene_of(*ROOF), scene_of(*ROOF, *MOVING)
PRESSURE = {"kind": "pressure", "pressure": 3.0}
PRESSED = ("outlet.kind=pressure", "outlet.pressure=0.01")
BEATING = {"waveform": "mca", "ramp": 0.3}

# Scene, text of the rendered script, the same with one other sign or factor.
MUTATIONS = {
    "pressure": (channel(PRESSURE), *(f"= {sign}OutflowPressure(FlowRate(X));\n  WriteRaw" for sign in ("", "-"))),
    "pressure in time": (channel(PRESSURE, **BEATING), "Level = StepPressure(", "Level = -StepPressure("),
    "pressure, walls that move": (
        scene_of(*ROOF, *PRESSED),
        "AddMomentum(loadFactor*outletPressure, outletX",
        "AddMomentum(-loadFactor*outletPressure, outletX",
    ),
    "pressure in time, walls that move": (
        scene_of(*ROOF, *PRESSED, *MOVING),
        "nodes = behind*outletX;",
        "nodes = -behind*outletX;",
    ),
    "ramp of the pressure": (
        channel({"kind": "pressure", "pressure": 3.0}, **BEATING),
        "outletPressure*Ramp(timeNow+timeTheta*timeK)",
        "outletPressure*Ramp(timeNow-timeTheta*timeK)",
    ),
    "resistance": (
        channel({"kind": "resistance", "resistance": 3.0}),
        "outflowResistance() outletResistance",
        "outflowResistance() -outletResistance",
    ),
    "resistance in time": (
        channel({"kind": "resistance", "resistance": 3.0}, **BEATING),
        "(1-timeTheta)*OutflowResistance()*oldFlow;",
        "(timeTheta-1)*OutflowResistance()*oldFlow;",
    ),
    "Windkessel": (channel(WINDKESSEL), "outletProximalResistance + outlet", "outletProximalResistance - outlet"),
    "Windkessel in time": (channel(WINDKESSEL, **BEATING), "(c-(1-timeTheta)*d)", "(c+(1-timeTheta)*d)"),
    "compliance": (
        channel(WINDKESSEL, **BEATING),
        "(outletCompliance/timeK+timeTheta",
        "(outletCompliance/timeK-timeTheta",
    ),
    "backflow": (
        channel({"kind": "do-nothing", "backflow": 0.5}, profile=REVERSED),
        "outletBackflow*fluidDensity*min(outflowNormal, 0.)*outflowVX*b)",
        "outletBackflow*fluidDensity*max(outflowNormal, 0.)*outflowVX*b)",
    ),
    "backflow in time": (
        channel({"kind": "do-nothing", "backflow": 0.5}, waveform="-1", ramp=0.3),
        "Backflow(1-timeTheta, oldRows)",
        "Backflow(timeTheta-1, oldRows)",
    ),
    "stiffness of the support": (STEADY, "matrix m = stepWeight*springs", "matrix m = (1.1*stepWeight)*springs"),
    "stiffness in time": (IN_TIME, "(springs, 1-timeTheta, oldX", "(springs, timeTheta-1, oldX"),
    "damping": (IN_TIME, "(dampers, 1-timeTheta, oldX", "(dampers, timeTheta-1, oldX"),
    "waveform": (channel({"kind": "do-nothing"}, **BEATING), " + waveSine[k]*sin(", " - waveSine[k]*sin("),
    "Womersley's profile, c_k": (
        channel({"kind": "do-nothing"}, profile="womersley", **BEATING),
        "(waveCosine[k]-1i*waveSine[k])",
        "(waveCosine[k]+1i*waveSine[k])",
    ),
    "Womersley's profile, f_k": (
        channel({"kind": "do-nothing"}, profile="womersley", **BEATING),
        "(exp((at-h)*b)+exp(",
        "(exp((at-h)*b)-exp(",
    ),
}  # fmt: skip


def passes(folder, scene: Scene) -> bool:
    return check_run(folder, scene).passed


@pytest.mark.parametrize("scene, right, wrong", MUTATIONS.values(), ids=MUTATIONS)
def test_one_wrong_sign_is_caught(run_text, scene, right, wrong):
    text = render(scene)
    assert text.count(right) == 1, "the templates have changed: adapt this mutation"
    text = text.replace(right, wrong).replace("return max(1e-6, 5e-4*s);", "return 0.3;")
    text = text.replace("timeStep*1e-3", "timeStep*0.3")
    try:
        folder, done = run_text(text)
    except FreeFEMError as error:
        assert error.kind in ("singular-matrix", "mumps", "floating-point")
        return
    assert done.status == "failed" or not passes(folder, scene)


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_right_signs_pass(run_text, name):
    scene = MUTATIONS[name][0]
    folder, done = run_text(render(scene))
    assert done.status == "converged" and passes(folder, scene)
