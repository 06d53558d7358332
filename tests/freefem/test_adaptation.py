"""Meshes made for quantities: the tolerance is met, by fewer unknowns than graded meshes need."""

import pytest
from conftest import scene_of
from test_direct import freefem  # noqa: F401

import ffsi

REFERENCE = {"drag": 14.2940, "lift": 0.76478, "tip_ux": 2.2681e-5, "tip_uy": 8.186e-4}  # FSI1 without a mesh's error


def test_the_tolerance_is_met(tmp_path):
    result = ffsi.solve("turek-fsi1", tmp_path / "run", adapt=list(REFERENCE), tolerance="0.5%")
    rounds, errors = result.data["adaptation"]["rounds"], result.data["errors"]
    assert result.checked and not [text for text in result.warnings if "second time" not in text]
    assert rounds[0]["unknowns"] == 6995 < rounds[-1]["unknowns"] == result.data["unknowns"] < 14000
    for name, value in REFERENCE.items():
        found = result.quantities[name]
        assert rounds[-1]["quantities"][name] == {
            "value": pytest.approx(found, rel=1e-12), "estimate": errors[name]["estimate"], "bar": errors[name]["bar"]
        }  # fmt: skip
        assert abs(found - value) <= errors[name]["bar"] + 1e-4 * abs(value), name
        assert errors[name]["bar"] <= 5e-3 * abs(found), name
    assert rounds[0]["quantities"]["tip_uy"]["bar"] > 10 * errors["tip_uy"]["bar"]
    # The sum of the shares' sizes is 0.0186 N/m; a twentieth of it is in the bar.
    assert errors["drag"]["bar"] - 2 * abs(errors["drag"]["estimate"]) == pytest.approx(0.05 * 0.0186, rel=0.1)


def test_the_unknowns_are_not_exceeded_and_the_tolerance_is_said_to_be_missed(tmp_path):
    """The second mesh has more unknowns for its triangles than the first, and too many."""
    scene = scene_of("aneurysm", "output.pictures=false")
    result = ffsi.solve(scene, tmp_path / "run", adapt=["tip_uy"], tolerance=1e-6, unknowns=9570, check=False)
    first, second, last = result.data["adaptation"]["rounds"]
    assert second["unknowns"] > 9570 >= last["unknowns"] == result.data["unknowns"] > 0.85 * 9570
    assert result.converged and last["quantities"]["tip_uy"]["bar"] < first["quantities"]["tip_uy"]["bar"]
    assert any("of tip_uy are above the tolerance" in text for text in result.warnings)


@pytest.mark.parametrize(("arguments", "message"), [
    (("-adapt", "drag,dragg", "-tolerance", "0.01"), "'dragg' is no quantity"),
    (("-adapt", "drag"), "-adapt needs -tolerance or -unknowns"),
    (("-adapt", "drag", "-tolerance", "0"), "-tolerance needs a number above 0"),
    (("-tolerance", "0.1"), "belong to -adapt"),
    (("-adapt", "drag", "-unknowns", "900"), "-unknowns 900: the first mesh has "),
    (("-adapt", "drag", "-unknowns", "9000", "-sensitivities", "1"), "-adapt goes with neither"),
])  # fmt: skip
def test_a_script_refuses_it(freefem, tmp_path, arguments, message):  # noqa: F811
    done = freefem("turek-cfd1", *arguments, "-out", tmp_path, cwd=tmp_path)
    assert done.returncode == 2 and message in done.stdout
    assert not list(tmp_path.glob("point*"))


def test_a_script_run_directly_is_taken_over(freefem, tmp_path):  # noqa: F811
    """Its first mesh misses the tolerance of the pressure by less than a factor of 2."""
    asked = ("-adapt", "drag,pressure_drop", "-tolerance", "0.001", "-mesh_level", 2)
    done = freefem("turek-cfd1", *asked, "-out", tmp_path, cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    result = ffsi.load_result(tmp_path)
    assert result.checked and result.scene.mesh.level == 0
    assert all(result.data["errors"][name]["bar"] <= 1e-3 * result.quantities[name] for name in asked[1].split(","))
    found = result.data["adaptation"]
    bar = found["rounds"][0]["quantities"]["pressure_drop"]["bar"]
    assert found["tolerance"] == 0.001 and bar == pytest.approx(0.149348, rel=1e-3)  # of the pressures' sum it is 0.156
