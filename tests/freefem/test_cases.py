"""Every case of the catalogue on its coarsest mesh, and the distance of level 1 from the published values."""

import json
import math
from pathlib import Path

import pytest

from ffsi.result.published import references_for
from ffsi.scene import CASES, Scene, boundaries

STEADY = {name: scene for name, scene in CASES.items() if scene.time is None}

RESIDUALS = ("momentum", "continuity", "incompressibility", "kinematics", "mesh_motion", "dirichlet")
OF_ALL = {"start_difference", "quantities_difference", "sensitivities_difference", "errors_difference"}
DIFFERENCES = ("drag_difference", "lift_difference", "coefficient_difference")

INNER_LINE = 99  # edges that only shape the mesh

# Values of level 0, in SI: what this program computed there, not what is right. A change of mesh, quadrature or
# discretisation changes them; then they are measured again (see LEVEL_1 for what must stay true).
BEFORE = json.loads((Path(__file__).parents[1] / "verification/data/values-before.json").read_text(encoding="utf-8"))
KEPT = {"drag", "lift", "drag_surface", "lift_surface", "tip_ux", "tip_uy", "min_jacobian"}
KEPT |= {"pressure_drop", "pressure_difference"}

# Largest relative errors at level 1 against ffsi/data/turek_hron.csv: as measured, and a margin of a half.
LEVEL_1 = {
    ("turek-cfd1", "drag"): 6.0e-05,  # 4.01e-05
    ("turek-cfd1", "lift"): 3.6e-04,  # 2.41e-04
    ("turek-cfd2", "drag"): 8.4e-04,  # 5.62e-04
    ("turek-cfd2", "lift"): 4.1e-02,  # 2.72e-02
    ("turek-csm1", "tip_ux"): 1.0e-04,  # 6.99e-05
    ("turek-csm1", "tip_uy"): 6.1e-05,  # 4.04e-05
    ("turek-csm2", "tip_ux"): 1.0e-04,  # 6.99e-05
    ("turek-csm2", "tip_uy"): 6.4e-05,  # 4.26e-05
    ("turek-fsi1", "tip_ux"): 1.2e-03,  # 7.68e-04
    ("turek-fsi1", "tip_uy"): 7.5e-03,  # 4.98e-03
    ("turek-fsi1", "drag"): 1.0e-05,  # 2.24e-06
    ("turek-fsi1", "lift"): 9.3e-03,  # 6.19e-03
    ("cylinder-2d1", "drag_coefficient"): 5.1e-05,  # 3.38e-05
    ("cylinder-2d1", "lift_coefficient"): 6.5e-03,  # 4.35e-03
    ("cylinder-2d1", "pressure_difference"): 1.4e-04,  # 9.53e-05
}


def has_forces(scene: Scene) -> bool:
    return any(boundary.part for boundary in boundaries(scene))


@pytest.mark.parametrize("case", STEADY)
def test_the_case_converges_is_checked_and_keeps_its_values(solved, case):
    result = solved(case)
    assert (result.status, result.reason) == ("converged", "") and result.data["level"] == 0
    assert 500 < result.data["unknowns"] < 11_000
    for name, value in result.quantities.items():
        assert math.isfinite(value), name
    assert 0 < result.quantities["min_jacobian"] <= 1
    scene, check = STEADY[case], solved(case).data["check"]
    expected = {"momentum", "dirichlet", "quantities_difference"}
    expected |= {"continuity", "wall_difference"} if scene.fluid else set()
    expected |= set(DIFFERENCES) if has_forces(scene) else set()
    expected |= {"kinematics", "mesh_motion"} if scene.physics == "fsi" else set()
    expected |= {"incompressibility"} if any(solid.mixed for solid in scene.solid.values()) else set()
    assert {name for name, value in check.items() if value is not None} == expected
    assert set(check) == {*RESIDUALS, *DIFFERENCES, "outlet_difference", "wall_difference", *OF_ALL}
    for name in expected:
        assert 0 <= check[name] < 1e-8, name
    found, before = solved(case).quantities, BEFORE[f"{case} on level 0"]["quantities"]
    assert found.keys() & KEPT == before.keys() & KEPT
    for name in found.keys() & KEPT:
        assert found[name] == pytest.approx(before[name], rel=1e-6, abs=0), name


@pytest.mark.parametrize(("case", "quantity"), list(LEVEL_1))
def test_level_1_is_near_the_published_value(solved, case, quantity):
    result = solved(case, "mesh.level=1")
    assert result.converged
    error = references_for(result.scene)[quantity].relative_error(result.quantities[quantity])
    assert abs(error) < LEVEL_1[case, quantity]


@pytest.mark.parametrize("case", [case for case, scene in STEADY.items() if has_forces(scene)])
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


@pytest.mark.parametrize("case", [case for case, scene in STEADY.items() if has_forces(scene)])
def test_coefficients(solved, case):
    result = solved(case)
    values = result.parameters
    scale = values["fluid.density"] * values["inflow.mean_velocity"] ** 2 * values["forces.reference_length"] / 2
    for name in ("drag", "lift"):
        assert result.quantities[f"{name}_coefficient"] * scale == pytest.approx(result.quantities[name], rel=1e-13)


@pytest.mark.parametrize("case", STEADY)
def test_parameters_and_labels_are_those_of_the_scene(solved, case):
    result = solved(case)
    expected = {key: value for key, value in result.scene.parameters().items() if key != "solver.time_limit"}
    assert result.parameters == pytest.approx(expected, rel=1e-15)
    # Straight boundaries have their exact length; arcs are polygons with their corners on the circle.
    from ffsi.files.arrays import read_mesh

    mesh = read_mesh(result.directory / "mesh.bin")
    ends = mesh.vertices[mesh.edges]
    lengths, outline = ((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1) ** 0.5, boundaries(result.scene)
    assert set(mesh.label) - {INNER_LINE} == {boundary.label for boundary in outline}
    for boundary in outline:
        length = lengths[mesh.label == boundary.label].sum()
        arc = (
            boundary.circle is not None
            or boundary.curved
            or (boundary.label == 6 and result.scene.geometry.kind == "channel-cylinder")
        )
        assert length == pytest.approx(boundary.exact_length, rel=0.02 if arc else 1e-10), boundary.name


@pytest.mark.parametrize("case", ["turek-fsi1", "turek-cfd1", "turek-csm1"])
def test_umfpack_computes_the_same(solved, case):
    usual, other = solved(case), solved(case, "solver.linear_solver=umfpack")
    assert (usual.data["freefem"]["solver"], other.data["freefem"]["solver"]) == ("MUMPS", "UMFPACK")
    assert other.converged
    for name, value in usual.quantities.items():
        if name in ("drag", "lift", "tip_ux", "tip_uy"):
            assert other.quantities[name] == pytest.approx(value, rel=1e-7)
