"""Every case of the catalogue on its coarsest mesh, and the distance of level 1 from the published values."""

import math

import pytest

from ffsi.references import references_for
from ffsi.scene import CASES, boundaries

RESIDUALS = ("momentum", "continuity", "kinematics", "mesh_motion", "dirichlet")
DIFFERENCES = ("drag_difference", "lift_difference", "coefficient_difference")

INNER_LINE = 99  # edges that only shape the mesh

# Regression values of level 0, in SI: what this program computes there, not what is right. A change of mesh,
# quadrature or discretisation changes them; then they are measured again (see LEVEL_1 for what must stay true).
LEVEL_0 = {
    "flap-svk": {
        "drag": 0.005819651344,
        "lift": -0.002503316324,
        "drag_surface": 0.005750164407,
        "lift_surface": -0.002530657028,
        "pressure_drop": 0.03511740078,
        "tip_ux": 0.1340660827,
        "tip_uy": -0.05894389747,
        "min_jacobian": 0.5679852703,
    },
    "turek-cfd1": {
        "drag": 14.29268632,
        "lift": 1.122309963,
        "drag_surface": 14.15801229,
        "lift_surface": 1.120474427,
        "pressure_drop": 85.10453754,
        "min_jacobian": 0.8455714512,
    },
    "turek-cfd2": {
        "drag": 135.2831584,
        "lift": 10.70846172,
        "drag_surface": 130.340547,
        "lift_surface": 10.65386509,
        "pressure_drop": 519.5779503,
        "min_jacobian": 0.8455714512,
    },
    "turek-csm1": {
        "tip_ux": -0.00718563769,
        "tip_uy": -0.06609165555,
        "min_jacobian": 0.9855581635,
    },
    "turek-csm2": {
        "tip_ux": -0.0004688672858,
        "tip_uy": -0.01697111409,
        "min_jacobian": 0.996594221,
    },
    "turek-fsi1": {
        "drag": 14.31393105,
        "lift": 0.7753720646,
        "drag_surface": 14.25415537,
        "lift_surface": 0.7775496194,
        "pressure_drop": 85.22493645,
        "tip_ux": 2.224748247e-05,
        "tip_uy": 0.0008784040737,
        "min_jacobian": 0.9366339069,
    },
    "cylinder-2d1": {
        "drag": 0.01115784778,
        "lift": 2.093215149e-05,
        "drag_surface": 0.01113541537,
        "lift_surface": 2.092040742e-05,
        "pressure_drop": 0.06944614567,
        "pressure_difference": 0.1176310334,
        "min_jacobian": 0.8845522084,
    },
    "cavity-flexible-floor": {
        "drag": -0.01651823854,
        "lift": -5.291087715,
        "drag_surface": -0.01659977062,
        "lift_surface": -5.29124642,
        "pressure_drop": 1.483169683,
        "tip_ux": 0.000108492981,
        "tip_uy": -0.2404091961,
        "min_jacobian": 0.9398271457,
    },
}

# Largest relative errors at level 1 against ffsi/data/turek_hron.csv: as measured, and a margin of a half.
LEVEL_1 = {
    ("turek-cfd1", "drag"): 1.6e-04,  # 1.07e-04
    ("turek-cfd1", "lift"): 7.5e-04,  # 4.99e-04
    ("turek-cfd2", "drag"): 2.3e-03,  # 1.56e-03
    ("turek-cfd2", "lift"): 4.8e-02,  # 3.18e-02
    ("turek-csm1", "tip_ux"): 9.6e-05,  # 6.37e-05
    ("turek-csm1", "tip_uy"): 5.5e-05,  # 3.68e-05
    ("turek-csm2", "tip_ux"): 9.5e-05,  # 6.35e-05
    ("turek-csm2", "tip_uy"): 5.8e-05,  # 3.89e-05
    ("turek-fsi1", "tip_ux"): 3.0e-03,  # 2.02e-03
    ("turek-fsi1", "tip_uy"): 1.2e-03,  # 8.30e-04
    ("turek-fsi1", "drag"): 2.6e-04,  # 1.71e-04
    ("turek-fsi1", "lift"): 8.2e-03,  # 5.44e-03
    ("cylinder-2d1", "drag_coefficient"): 1.4e-05,  # 9.26e-06
    ("cylinder-2d1", "lift_coefficient"): 1.2e-02,  # 8.20e-03
    ("cylinder-2d1", "pressure_difference"): 9.9e-04,  # 6.58e-04
}


@pytest.mark.parametrize("case", CASES)
def test_the_case_converges(solved, case):
    result = solved(case)
    assert (result.status, result.reason) == ("converged", "")
    assert result.data["level"] == 0
    assert 500 < result.data["unknowns"] < 10_000
    for name, value in result.quantities.items():
        assert math.isfinite(value), name
    assert 0 < result.quantities["min_jacobian"] <= 1


@pytest.mark.parametrize("case", CASES)
def test_the_checker_agrees(solved, case):
    scene, check = CASES[case], solved(case).data["check"]
    expected = {"momentum", "dirichlet"}
    expected |= {"continuity", *DIFFERENCES} if scene.fluid else set()
    expected |= {"kinematics", "mesh_motion"} if scene.physics == "fsi" else set()
    assert {name for name, value in check.items() if value is not None} == expected
    assert set(check) == {*RESIDUALS, *DIFFERENCES}
    for name in expected:
        assert 0 <= check[name] < 1e-8, name


@pytest.mark.parametrize(("case", "quantity"), [(case, name) for case, values in LEVEL_0.items() for name in values])
def test_regression_at_level_0(solved, case, quantity):
    assert solved(case).quantities[quantity] == pytest.approx(LEVEL_0[case][quantity], rel=1e-6, abs=0)


def test_every_case_has_regression_values():
    assert set(LEVEL_0) == set(CASES)


@pytest.mark.parametrize(("case", "quantity"), list(LEVEL_1))
def test_level_1_is_near_the_published_value(solved, case, quantity):
    result = solved(case, "mesh.level=1")
    assert result.converged
    error = references_for(result.scene)[quantity].relative_error(result.quantities[quantity])
    assert abs(error) < LEVEL_1[case, quantity]


@pytest.mark.parametrize("case", [case for case, scene in CASES.items() if scene.forces])
def test_the_two_forms_of_the_force_are_near_each_other(solved, case):
    """The surface form is less accurate; a factor or a sign would not pass."""
    quantities = solved(case).quantities
    size = math.hypot(quantities["drag"], quantities["lift"])
    for name in ("drag", "lift"):
        assert abs(quantities[name] - quantities[f"{name}_surface"]) < 0.05 * size


@pytest.mark.parametrize("case", ["turek-cfd1", "turek-cfd2", "turek-fsi1"])
def test_the_parts_add_up(solved, case):
    """The surface forms exactly; the residual forms share the nodes where the parts meet."""
    quantities = solved(case).quantities
    for name in ("drag", "lift", "drag_surface", "lift_surface"):
        force, _, form = name.partition("_")
        parts = [quantities["_".join(filter(None, (force, part, form)))] for part in ("cylinder", "beam")]
        size = abs(parts[0]) + abs(parts[1])
        assert sum(parts) == pytest.approx(quantities[name], abs=(1e-12 if form else 1e-3) * size, rel=0)


@pytest.mark.parametrize("case", [case for case, scene in CASES.items() if scene.forces])
def test_coefficients(solved, case):
    result = solved(case)
    values = result.parameters
    scale = values["fluid.density"] * values["inflow.mean_velocity"] ** 2 * values["forces.reference_length"] / 2
    for name in ("drag", "lift"):
        assert result.quantities[f"{name}_coefficient"] * scale == pytest.approx(result.quantities[name], rel=1e-13)


@pytest.mark.parametrize("case", CASES)
def test_the_parameters_are_those_of_the_scene(solved, case):
    result = solved(case)
    expected = {key: value for key, value in result.scene.parameters().items() if key != "solver.time_limit"}
    assert result.parameters == pytest.approx(expected, rel=1e-15)


WAVY = pytest.mark.xfail(strict=True, reason="adaptmesh smooths the straight walls where they touch the round lips")


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=WAVY if case == "cavity-flexible-floor" else ()) for case in CASES]
)
def test_every_boundary_has_its_label(solved, case):
    """Straight boundaries have their exact length; arcs are polygons with their corners on the circle."""
    from ffsi.rawfiles import read_mesh

    result = solved(case)
    mesh = read_mesh(result.directory / "mesh.bin")
    ends = mesh.vertices[mesh.edges]
    lengths = ((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1) ** 0.5
    outline = boundaries(result.scene)
    assert set(mesh.label) - {INNER_LINE} == {boundary.label for boundary in outline}
    for boundary in outline:
        length = lengths[mesh.label == boundary.label].sum()
        arc = boundary.circle is not None or (boundary.label == 6 and result.scene.geometry.kind == "channel-cylinder")
        assert length == pytest.approx(boundary.exact_length, rel=0.02 if arc else 1e-10), boundary.name


@pytest.mark.parametrize("case", ["turek-fsi1", "turek-cfd1", "turek-csm1"])
def test_umfpack_computes_the_same(solved, case):
    usual, other = solved(case), solved(case, "solver.linear_solver=umfpack")
    assert (usual.data["freefem"]["solver"], other.data["freefem"]["solver"]) == ("MUMPS", "UMFPACK")
    assert other.converged
    for name, value in usual.quantities.items():
        if name in ("drag", "lift", "tip_ux", "tip_uy"):
            assert other.quantities[name] == pytest.approx(value, rel=1e-7)
