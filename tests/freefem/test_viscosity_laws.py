"""Viscosity laws: the script's own formulas, Poiseuille flow of each, Newton's convergence, elastic bodies, time."""

import numpy as np
import pytest
from conftest import scene_of
from test_channel import channel
from test_newton import orders

import ffsi
from ffsi.freefem import run_script
from ffsi.hemodynamics.result import Result
from ffsi.reference.from_scene import problem_from_scene
from ffsi.run.one_scene import solve
from ffsi.scene import Scene
from ffsi.scene.fluids import LAWS
from ffsi.script.render import parameters, render
from studies.verification.exact_flows import plane_flow

DENSITY, HALF, LENGTH = 1060.0, 1e-3, 30e-3
CARREAU = {"law": "carreau", "density": DENSITY}
POWER = {"law": "power-law", "density": DENSITY, "consistency": 0.0147, "exponent": 0.7755}
CASSON = {"law": "casson", "density": DENSITY, "yield_stress": 0.005, "viscosity_infinity": 0.0035}
FLUIDS = {"carreau": CARREAU, "power-law": POWER, "casson": CASSON}
# The same in the size of Turek's channel, with large differences of the viscosity.
THICK = {
    "carreau": 'fluid={law="carreau", density=1000, viscosity_zero=10, viscosity_infinity=0.5}',
    "power-law": 'fluid={law="power-law", density=1000, consistency=1, exponent=0.6}',
    "casson": 'fluid={law="casson", density=1000, yield_stress=0.2, viscosity_infinity=0.5, regularisation=0.1}',
}


def test_all_laws_are_here():
    assert set(FLUIDS) == set(THICK) == set(LAWS) - {"newtonian"}


# FreeFEM's own formulas -----------------------------------------------------------------------------------------------

RATES = np.array([0.0, 1e-6, 0.01, 0.3, 1.0, 100.0, 1000.0, 1e6])


@pytest.mark.parametrize("law", [*FLUIDS, "thickening"])
def test_the_script_s_formulas(law, installation, tmp_path):
    """For arrays and for a single value, and the viscosity of the outlet."""
    scene = channel(fluid=FLUIDS.get(law, POWER | {"exponent": 1.3}))
    part = render(scene).partition("func int SquaredShearRate()")[2].partition("\n}\n")[2]
    part = part.partition("func int TimesCofactor(")[0]
    numbers = [f"real {p.variable} = {p.value!r};" for p in parameters(scene) if p.key.startswith("fluid.")]
    script = tmp_path / "case.edp"
    script.write_text("\n".join([
        "real unitTime = 1;", *numbers, f"real[int] rates = [{', '.join(map(repr, RATES.tolist()))}], work(rates.n);",
        "func int SquaredShearRate() { work = rates.*rates; return 0; }", part,
        'Viscosity(3); ofstream out("viscosity.txt"); out.precision(17);',
        "for (int i = 0; i < rates.n; ++i) out << work[i] << \" \" << viscosityAt(rates[i]^2) << endl;",
        'out << farViscosity << " " << farViscosity << endl; cout << "@ffsi end status=converged" << endl;',
    ]))  # fmt: skip
    run_script(script, installation=installation, cwd=tmp_path, time_limit=60)
    *found, far = np.loadtxt(tmp_path / "viscosity.txt")
    law = problem_from_scene(scene).fluid.viscosity
    expected = law.at(RATES**2)
    np.testing.assert_allclose(np.array(found)[:, 0], 3 * expected, rtol=1e-14)
    np.testing.assert_allclose(np.array(found)[:, 1], expected, rtol=1e-14)
    assert far[0] == pytest.approx(law.outlet, rel=1e-14)


# Pressure gradient in Pa/m, largest and mean velocity in m/s.
FLOWS = [
    (fluid, slope, *plane_flow(channel(fluid=fluid).fluid, slope, HALF)[::-1], tolerance)
    for fluid, slopes, tolerance in (
        (CARREAU, (10.0, 100.0, 1000.0), 1e-4), (POWER, (20.0, 500.0), 1e-3), (CASSON, (50.0, 500.0), 1e-3),
    )
    for slope in slopes
]  # fmt: skip


def poiseuille(fluid: dict, mean: float, folder, **tables) -> Result:
    """Solve a vessel whose inflow is parabolic: behind some diameters the profile is the fluid's own."""
    scene = channel(
        geometry={"kind": "channel", "length": LENGTH, "height": 2 * HALF},
        mesh={"level": 0, "body_size": 1e-4, "growth": 0.01, "far_size": 1e-3},  # rows of nearly the same height
        fluid=fluid,
        inflow={"mean_velocity": mean},
        **tables,
    )
    return solve(scene, folder)


@pytest.mark.parametrize(
    "fluid, slope, largest, mean, tolerance", FLOWS, ids=[f"{flow[0]['law']} {flow[1]:g}" for flow in FLOWS]
)
def test_poiseuille_flow(fluid, slope, largest, mean, tolerance, tmp_path):
    result = poiseuille(fluid, mean, tmp_path / "run")
    assert result.converged, result.reason
    assert result.data["unknowns"] < 6000
    x = np.linspace(0.5, 0.7, 7) * LENGTH
    middle = result.sample(np.column_stack([x, np.full(7, HALF)]))
    assert -np.polyfit(x, middle["p"], 1)[0] == pytest.approx(slope, rel=tolerance)
    np.testing.assert_allclose(middle["vx"], largest, rtol=tolerance)
    assert wall_shear_stress(result, x[3]) == pytest.approx(slope * HALF, rel=tolerance)
    assert result.quantities["drag_surface"] == pytest.approx(result.quantities["drag"], rel=1e-2)


def wall_shear_stress(result: Result, x: float) -> float:
    """Return the shear stress in Pa at the lower wall, where it is linear in y.

    The derivative of a quadratic function is most exact at the two Gauss points of an element.
    """
    row = np.unique(np.round(result.fields.points[:, 1], 11))[2]
    gauss = row / 2 * (1 + np.array([-1, 1]) / np.sqrt(3))
    u = result.sample([[x, 0], [x, row / 2], [x, row]])["vx"].to_numpy()
    rate = (-3 * u[0] + 4 * u[1] - u[2]) / row + 4 * gauss * (u[0] - 2 * u[1] + u[2]) / row**2
    stress = problem_from_scene(result.scene).fluid.viscosity.at(rate**2) * rate
    return float(stress[0] - gauss[0] * (stress[1] - stress[0]) / (gauss[1] - gauss[0]))


@pytest.mark.parametrize(
    "fluid, mean", [(CARREAU, 0.07601542), (POWER, 0.05), (CASSON, 0.05)], ids=("carreau", "power-law", "casson")
)
def test_newton_is_quadratic(fluid, mean, tmp_path):
    result = poiseuille(fluid, mean, tmp_path / "run", solver={"start": "rest", "reuse_ratio": 0})
    assert result.converged, result.reason
    assert len(result.history) - 1 <= 12
    history = result.history
    assert (history["step"].iloc[-4:-1] == 1).all()
    residual = np.maximum(history["residual"].to_numpy()[-4:], 1e-13)  # below that it is rounding
    fall = orders(residual if residual[-2] > 1e-8 else residual[:-1])
    assert (fall > 1.6).all()


def test_power_laws_far_from_their_rate_and_equal_viscosities(tmp_path, solved):
    """At the walls mu is a tenth of mu(1/s): the outlet must not take more off the viscous form than there is."""
    fluid = POWER | {"consistency": 0.02, "exponent": 0.5}
    result = poiseuille(fluid, 0.02, tmp_path / "run", solver={"start": "rest"})
    assert result.converged, result.reason
    assert len(result.history) - 1 <= 15
    thick = solved("turek-cfd1", "fluid.law=carreau", "fluid.viscosity_zero=1", "fluid.viscosity_infinity=1")
    plain = solved("turek-cfd1")
    for quantity in ("drag", "lift", "drag_surface", "lift_surface", "pressure_drop"):
        assert thick.quantities[quantity] == pytest.approx(plain.quantities[quantity], rel=1e-7)


@pytest.mark.parametrize("law", THICK)
def test_with_an_elastic_body(law, solved):
    result = solved("turek-fsi1", THICK[law])
    assert result.status == "converged", result.reason
    assert result.quantities["drag"] != pytest.approx(solved("turek-fsi1").quantities["drag"], rel=0.05)


@pytest.mark.parametrize("law", THICK)
def test_in_time_with_an_elastic_body(law, solved):
    result = solved("turek-fsi3", THICK[law], "time.end=0.05", "time.output_interval=0.02", "inflow.ramp=0.1")
    assert result.status == "converged", result.reason


def test_a_sweep_over_constants_of_a_law(tmp_path):
    """The outlet's rows follow the constants; the checker looks at every point."""
    scene = Scene.model_validate(scene_of("turek-cfd1", THICK["power-law"]).model_dump(exclude_none=True))
    grid = {"fluid.consistency": [1.0, 1.5], "fluid.exponent": [0.6, 0.7]}
    table = ffsi.sweep(scene, grid, tmp_path / "sweep")
    assert (table["status"] == "converged").all()
    drags = table.set_index(list(grid))["drag"]
    assert drags[1.5, 0.6] > 1.3 * drags[1.0, 0.6] and drags[1.0, 0.7] > drags[1.0, 0.6]
