"""The checker against real FreeFEM runs: it agrees with correct ones and catches wrong ones."""

import json
import shutil

import numpy as np
import pytest
from conftest import scene_of

from ffsi.files.arrays import RawState, read_mesh, read_state, write_state
from ffsi.freefem import FreeFEMError
from ffsi.reference import check_run
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.solve import solve
from ffsi.reference.system import System
from ffsi.script.render import render

# At level 0 the far outlet has so few edges that its term may vanish by symmetry. A near one has several.
NEAR_OUTLET = "geometry.length=1"

fsi1 = pytest.fixture(lambda solved: solved("turek-fsi1"), scope="module")
mesh = pytest.fixture(lambda fsi1: read_mesh(fsi1.directory / "mesh.bin"), scope="module")
state = pytest.fixture(lambda fsi1, mesh: read_state(fsi1.directory / "point-0001.bin", mesh), scope="module")


def largest(values: np.ndarray, among: np.ndarray) -> int:
    """Number of the node, among the given ones, with the largest value."""
    return int(among[np.argmax(np.abs(values.reshape(len(values), -1)[among]).sum(axis=1))])


@pytest.mark.parametrize(("field", "where", "equation"), [
    ("u", "solid", "momentum"), ("u", "interface", "momentum"), ("u", "fluid", "mesh_motion"),
    ("v", "fluid", "momentum"), ("v", "fluid", "continuity"), ("p", "fluid", "momentum"),
])  # fmt: skip
def test_one_perturbed_unknown_is_caught(fsi1, mesh, state, tmp_path, field, where, equation):
    folder = tmp_path / "run"
    shutil.copytree(fsi1.directory, folder)
    assert check_run(folder, fsi1.scene).passed
    nodes = {"solid": np.unique(mesh.p2[mesh.region > 1]), "fluid": np.unique(mesh.p2[mesh.region == 1])}
    inside = {
        "solid": np.setdiff1d(nodes["solid"], nodes["fluid"]),
        "fluid": np.setdiff1d(nodes["fluid"], nodes["solid"]),
        "interface": np.intersect1d(nodes["solid"], nodes["fluid"]),
    }[where]
    values = {"u": state.u.copy(), "v": state.v.copy(), "p": state.p.copy()}
    at = largest(values[field], np.arange(len(state.p)) if field == "p" else inside)
    values[field][at] *= 1 + 1e-3
    write_state(folder / "point-0001.bin", RawState(**values))
    report = check_run(folder, fsi1.scene)
    assert not report.passed
    assert getattr(report, equation) > 1e3 * report.tolerance or any(equation in text for text in report.failures)


@pytest.mark.parametrize("quantity", ["drag", "lift", "drag_coefficient", "lift_coefficient"])
def test_a_wrong_force_is_caught(fsi1, tmp_path, quantity):
    folder = tmp_path / "run"
    shutil.copytree(fsi1.directory, folder)
    point = json.loads((folder / "point-0001.json").read_text())
    point["quantities"][quantity] *= 1 + 1e-6
    (folder / "point-0001.json").write_text(json.dumps(point))
    assert any("difference" in text for text in check_run(folder, fsi1.scene).failures)


SLOW = "inflow.mean_velocity=0.03"
# Case, settings, text of the rendered script, the same with one other sign.
MUTATIONS = {
    "adjugate in G": ("turek-fsi1", [], "G11 -= a(:, DYVX)", "G11 += a(:, DYVX)"),
    "convection": ("turek-fsi1", [], "work += G12.*a(:, VY);", "work -= G12.*a(:, VY);"),
    "cofactor": ("turek-fsi1", [], "work -= S12.*a(:, DYUX); f(:, PXX)", "work += S12.*a(:, DYUX); f(:, PXX)"),
    "J of the fluid": ("turek-fsi1", [], "fluidJ -= a(:, DYUX)", "fluidJ += a(:, DYUX)"),
    "symmetry of the viscous stress": ("turek-fsi1", [], "S12 += G21; S12 = S12.", "S12 -= G21; S12 = S12."),
    "continuity": ("turek-cfd1", [], "work = G11; work += G22;", "work = G11; work -= G22;"),
    "pressure": ("turek-cfd1", [], "S22 -= a(:, P);", "S22 += a(:, P);"),
    "shear strain": ("turek-fsi1", [], "E12 += a(:, 2).*F22;", "E12 -= a(:, 2).*F22;"),
    "first Lame constant": ("turek-fsi1", [], "S11 += lambda*E22;", "S11 -= lambda*E22;"),
    "F S": ("turek-fsi1", [], "work += a(:, 1).*S12; f(:, 0)", "work -= a(:, 1).*S12; f(:, 0)"),
    "weight": ("turek-csm1", [], "-loadFactor*gravityY, solidMass", "loadFactor*gravityY, solidMass"),
    "outlet, x": ("turek-fsi1", [NEAR_OUTLET], "doNothingLabels)(farViscosity*(", "doNothingLabels)(-farViscosity*("),
    "outlet, y": ("turek-fsi1", [NEAR_OUTLET], "doNothingLabels)(-farViscosity*(", "doNothingLabels)(farViscosity*("),
    "mesh motion": ("turek-fsi1", [], "() alpha*beta*(dy(a)*dx(b))", "() -alpha*beta*(dy(a)*dx(b))"),
    "hyperelastic motion, F^-T": ("flap-svk", [SLOW], "motionFactor += motionPart;", "motionFactor -= motionPart;"),
    "hyperelastic motion, cof F": ("flap-svk", [SLOW], "-= a(:, DXUY); motionPart *=", "+= a(:, DXUY); motionPart *="),
    "neo-Hookean, ln J": ("flap-neo-hookean", [SLOW], "logJ *= lambda;", "logJ *= -lambda;"),
    "neo-Hookean, cof F": ("flap-neo-hookean", [SLOW], "work -= factor.*a(:, 2);", "work += factor.*a(:, 2);"),
    "Mooney-Rivlin, I1": ("flap-mooney-rivlin", [SLOW], "factor *= -2./3.;", "factor *= 2./3.;"),
    "Mooney-Rivlin, I2": ("flap-mooney-rivlin", [SLOW], "square *= -4./3.;", "square *= 4./3.;"),
    "Mooney-Rivlin, volume": ("flap-mooney-rivlin", [SLOW], "work *= K; factor += work;", "work *= K; factor -= work;"),
    "curved boundary": ("turek-cfd1", [], "bendX += bx;", "bendX -= bx;"),
    "drag": ("turek-cfd1", [], "forceX = -(", "forceX = +("),
    "wall beside the flap": ("flap-svk", [SLOW], "indicator - restY)", "indicator + restY)"),
}  # fmt: skip


@pytest.mark.parametrize("case, settings, right, wrong", MUTATIONS.values(), ids=MUTATIONS)
def test_one_wrong_sign_is_caught(run_text, case, settings, right, wrong):
    scene = scene_of(case, *settings)
    text = render(scene)
    assert text.count(right) == 1, "the templates have changed: adapt this mutation"
    # A wrong sign that keeps Newton from converging need not be tried with ever smaller loads.
    text = text.replace(right, wrong).replace("return max(1e-6, 5e-4*s);", "return 0.3;")
    try:
        folder, done = run_text(text)
    except FreeFEMError as error:  # a singular matrix is as good as no convergence
        assert error.kind in ("singular-matrix", "mumps", "floating-point")
        return
    assert done.status == "failed" or not check_run(folder, scene).passed


def test_the_right_signs_pass(run_text):
    """The control of the runs above; what differs between the cases is checked in test_cases."""
    scene = scene_of("turek-fsi1", NEAR_OUTLET)
    folder, done = run_text(render(scene))
    assert done.status == "converged" and check_run(folder, scene).passed
    outlet = read_mesh(folder / "mesh.bin").label == 2
    assert outlet.sum() >= 4


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
