"""The checker against real FreeFEM runs, also of inlets, outlets and supports: it agrees with correct ones alone."""

import numpy as np
import pytest
from conftest import scene_of

from ffsi.files.arrays import RawState, read_mesh, read_state
from ffsi.freefem import FreeFEMError
from ffsi.reference import check_run
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.solve import solve
from ffsi.reference.system import System
from ffsi.scene import Scene
from ffsi.script.render import render

fsi1 = pytest.fixture(lambda solved: solved("turek-fsi1"), scope="module")
mesh = pytest.fixture(lambda fsi1: read_mesh(fsi1.directory / "mesh.bin"), scope="module")
state = pytest.fixture(lambda fsi1, mesh: read_state(fsi1.directory / "point-0001.bin", mesh), scope="module")


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

SLOW = "inflow.mean_velocity=0.03"
RIGID = scene_of("aneurysm", *(f"{key}=none" for key in ("solid.vessel", "solid.dome", "mesh_motion")))
FSI1, CFD1 = scene_of("turek-fsi1"), scene_of("turek-cfd1")
# At level 0 the far outlet has so few edges that its term may vanish by symmetry. A near one has several.
NEAR = scene_of("turek-fsi1", "geometry.length=1")
SVK, NEO, MOONEY = (scene_of(f"flap-{name}", SLOW) for name in ("svk", "neo-hookean", "mooney-rivlin"))
WOMERSLEY = channel({"kind": "do-nothing"}, profile="womersley", **BEATING)
# Scene, text of the rendered script, the same with one other sign or factor.
MUTATIONS = {
    "adjugate in G": (FSI1, "G11 -= a(:, DYVX)", "G11 += a(:, DYVX)"),
    "convection": (FSI1, "work += G12.*a(:, VY);", "work -= G12.*a(:, VY);"),
    "cofactor": (FSI1, "work -= S12.*a(:, DYUX); f(:, PXX)", "work += S12.*a(:, DYUX); f(:, PXX)"),
    "J of the fluid": (FSI1, "fluidJ -= a(:, DYUX)", "fluidJ += a(:, DYUX)"),
    "symmetry of the viscous stress": (FSI1, "S12 += G21; S12 = S12.", "S12 -= G21; S12 = S12."),
    "continuity": (CFD1, "work = G11; work += G22;", "work = G11; work -= G22;"),
    "pressure of the fluid": (CFD1, "S22 -= a(:, P);", "S22 += a(:, P);"),
    "shear strain": (FSI1, "E12 += a(:, 2).*F22;", "E12 -= a(:, 2).*F22;"),
    "first Lame constant": (FSI1, "S11 += lambda*E22;", "S11 -= lambda*E22;"),
    "F S": (FSI1, "work += a(:, 1).*S12; f(:, 0)", "work -= a(:, 1).*S12; f(:, 0)"),
    "weight": (scene_of("turek-csm1"), "-loadFactor*gravityY, solidMass", "loadFactor*gravityY, solidMass"),
    "outlet, x": (NEAR, "doNothingLabels)(farViscosity*(", "doNothingLabels)(-farViscosity*("),
    "outlet, y": (NEAR, "doNothingLabels)(-farViscosity*(", "doNothingLabels)(farViscosity*("),
    "mesh motion": (FSI1, "() alpha*beta*(dy(a)*dx(b))", "() -alpha*beta*(dy(a)*dx(b))"),
    "hyperelastic motion, F^-T": (SVK, "motionFactor += motionPart;", "motionFactor -= motionPart;"),
    "hyperelastic motion, cof F": (SVK, "-= a(:, DXUY); motionPart *=", "+= a(:, DXUY); motionPart *="),
    "neo-Hookean, ln J": (NEO, "logJ *= lambda;", "logJ *= -lambda;"),
    "neo-Hookean, cof F": (NEO, "work -= factor.*a(:, 2);", "work += factor.*a(:, 2);"),
    "Mooney-Rivlin, I1": (MOONEY, "factor *= -2./3.;", "factor *= 2./3.;"),
    "Mooney-Rivlin, I2": (MOONEY, "square *= -4./3.;", "square *= 4./3.;"),
    "Mooney-Rivlin, volume": (MOONEY, "work *= K; factor += work;", "work *= K; factor -= work;"),
    "circle": (CFD1, "bendY = BendY(0, Vh, tgv=1);", "bendY = BendY(0, Vh, tgv=1); bendX *= -1;"),
    "curved boundary": (RIGID, "bendX += wayX;", "bendX -= wayX;"),
    "its cubic": (RIGID, "middle = (at[2]+at[3])/2", "middle = (at[2]+at[3])/2.02"),
    "end of a curved boundary": (RIGID, "(v[4] >= 0 || v[0] < 0 ? 1 : 0)", "1"),
    "drag": (CFD1, "forceX -= fluidMomentumX", "forceX += fluidMomentumX"),
    "wall beside the flap": (SVK, "'*stepTractionY; forceY", "'*stepTractionY; forceY *= -1; forceY"),
    "pressure": (channel(PRESSURE), *(f"= {sign}OutflowPressure(FlowRate(X));\n  WriteRaw" for sign in ("", "-"))),
    "pressure in time": (channel(PRESSURE, **BEATING), "Level = StepPressure(", "Level = -StepPressure("),
    "pressure, walls that move": (scene_of(*ROOF, *PRESSED),
        "AddPressure(loadFactor*outletPressure", "AddPressure(-loadFactor*outletPressure"),
    "pressure in time, walls that move": (scene_of(*ROOF, *PRESSED, *MOVING),
        "AddPressure(OldOutflowPressure(", "AddPressure(-OldOutflowPressure("),
    "ramp of the pressure": (channel({"kind": "pressure", "pressure": 3.0}, **BEATING),
        "outletPressure*Ramp(timeNow+timeTheta*timeK)", "outletPressure*Ramp(timeNow-timeTheta*timeK)"),
    "resistance": (channel({"kind": "resistance", "resistance": 3.0}),
        "outflowResistance() outletResistance", "outflowResistance() -outletResistance"),
    "resistance in time": (channel({"kind": "resistance", "resistance": 3.0}, **BEATING),
        "(1-timeTheta)*OutflowResistance()*oldFlow;", "(timeTheta-1)*OutflowResistance()*oldFlow;"),
    "Windkessel": (channel(WINDKESSEL), "outletProximalResistance + outlet", "outletProximalResistance - outlet"),
    "Windkessel in time": (channel(WINDKESSEL, **BEATING), "(c-(1-timeTheta)*d)", "(c+(1-timeTheta)*d)"),
    "compliance": (channel(WINDKESSEL, **BEATING),
        "(outletCompliance/timeK+timeTheta", "(outletCompliance/timeK-timeTheta"),
    "backflow": (channel({"kind": "do-nothing", "backflow": 0.5}, profile=REVERSED),
        *(f"outletBackflow*fluidDensity*{part}(outflowNormal, 0.)*outflowVX*b)" for part in ("min", "max"))),
    "backflow in time": (channel({"kind": "do-nothing", "backflow": 0.5}, waveform="-1", ramp=0.3),
        "Backflow(1-timeTheta, oldRows)", "Backflow(timeTheta-1, oldRows)"),
    "stiffness of the support": (STEADY, "matrix m = stepWeight*springs", "matrix m = (1.1*stepWeight)*springs"),
    "stiffness in time": (IN_TIME, "(springs, 1-timeTheta, oldX", "(springs, timeTheta-1, oldX"),
    "damping": (IN_TIME, "(dampers, 1-timeTheta, oldX", "(dampers, timeTheta-1, oldX"),
    "waveform": (channel({"kind": "do-nothing"}, **BEATING), " + waveSine[k]*sin(", " - waveSine[k]*sin("),
    "Womersley's profile, c_k": (WOMERSLEY, "(waveCosine[k]-1i*waveSine[k])", "(waveCosine[k]+1i*waveSine[k])"),
    "Womersley's profile, f_k": (WOMERSLEY, "(exp((at-h)*b)+exp(", "(exp((at-h)*b)-exp("),
}  # fmt: skip


@pytest.mark.parametrize("scene, right, wrong", MUTATIONS.values(), ids=MUTATIONS)
def test_one_wrong_sign_is_caught(run_text, scene, right, wrong):
    text = render(scene)
    assert text.count(right) == 1, "the templates have changed: adapt this mutation"
    # A wrong sign that keeps Newton from converging need not be tried with ever smaller loads.
    text = text.replace(right, wrong).replace("return max(1e-6, 5e-4*s);", "return 0.3;")
    text = text.replace("timeStep*1e-3", "timeStep*0.3")
    try:
        folder, done = run_text(text)
    except FreeFEMError as error:  # a singular matrix is as good as no convergence
        assert error.kind in ("singular-matrix", "mumps", "floating-point")
        return
    assert done.status == "failed" or not check_run(folder, scene).passed


# What differs between the others is checked in test_cases.
OWN = {scene.to_toml(): scene for scene, *_ in MUTATIONS.values() if scene.name == "channel" or scene.support}
OWN["near"] = NEAR


@pytest.mark.parametrize("scene", OWN.values(), ids=range(len(OWN)))
def test_the_right_signs_pass(run_text, scene):
    folder, done = run_text(render(scene))
    assert done.status == "converged" and check_run(folder, scene).passed
    assert scene != NEAR or (read_mesh(folder / "mesh.bin").label == 2).sum() >= 4


@pytest.fixture(scope="module")
def scipy_solution(fsi1, mesh):
    return solve(System.build(problem_from_scene(fsi1.scene), mesh))


@pytest.mark.parametrize("field", ["u", "v", "p"])
def test_the_checkers_own_solution_is_the_same(scipy_solution, state, field):
    """Both start from rest, with nothing in common but the mesh and the page docs/theory.md."""
    own, freefem = getattr(scipy_solution.state, field), getattr(state, field)
    assert np.abs(own).max() > 0 and np.abs(own - freefem).max() < 1e-9 * np.abs(own).max()


def test_the_checkers_own_newton_needs_as_few_iterations(scipy_solution):
    assert len(scipy_solution.steps) <= 6


@pytest.mark.parametrize("case, tolerance", [("cylinder-2d1", 1e-10), ("turek-csm2", 1e-8)])
def test_a_pure_fluid_and_a_pure_solid_agree_too(solved, case, tolerance):
    """The residual of a slender beam cannot be smaller than about 1e-9 of its stress: rounding."""
    result = solved(case)
    mesh = read_mesh(result.directory / "mesh.bin")
    state = read_state(result.directory / "point-0001.bin", mesh)
    start = RawState(1.001 * state.u, 1.001 * state.v, 1.001 * state.p)
    own = solve(System.build(problem_from_scene(result.scene), mesh), tolerance=tolerance, start=start)
    assert own.residuals[0] > 1e-6
    for field in "uvp":
        values, freefem = getattr(own.state, field), getattr(state, field)
        assert np.abs(values - freefem).max() <= 1e-8 * np.abs(freefem).max()
