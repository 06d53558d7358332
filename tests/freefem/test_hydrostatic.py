"""A pressure behind the outlet that grows along gravity: fluid at rest stays at rest, a flow stays the same flow."""

import math

import pytest

from ffsi.hemodynamics.result import Result
from ffsi.run.one_scene import solve
from ffsi.scene import Scene, load_scene

QUIET = ["mesh.level=0", "output.pictures=false", "output.vtu=false"]
ACROSS = ["gravity.y=-9.81", "gravity.x=3", "outlet.hydrostatic=true"]
KINDS = {
    "do-nothing": [], "zero-traction": [], "pressure": ["outlet.pressure=5"], "resistance": ["outlet.resistance=3"],
    "windkessel": ["outlet.proximal_resistance=1", "outlet.distal_resistance=2", "outlet.compliance=0.1"],
}  # fmt: skip
AREA = math.pi * 0.05**2  # of the cylinder, m^2; the density is 1 kg/m^3


def run(*settings: str) -> Result:
    result = solve(load_scene("cylinder-2d1", [*QUIET, *settings]))
    assert result.converged, result.reason
    return result


@pytest.mark.parametrize("kind", KINDS)
def test_only_buoyancy_is_added_to_a_flow(kind: str) -> None:
    outlet = [f"outlet.kind={kind}", *KINDS[kind]]
    plain, heavy = run(*outlet), run(*outlet, *ACROSS)
    scale = abs(plain.quantities["drag"])
    assert heavy.quantities["lift"] - plain.quantities["lift"] == pytest.approx(9.81 * AREA, abs=1e-4 * scale)
    assert heavy.quantities["drag"] - plain.quantities["drag"] == pytest.approx(-3 * AREA, abs=1e-4 * scale)
    assert heavy.warnings == plain.warnings == []


def test_rest() -> None:
    """Exact where no triangle is curved: p = rho g.(x - x0), with x0 the outlet's upper end."""
    scene = Scene.model_validate(
        {
            "name": "rest", "geometry": {"kind": "channel", "length": 2.0, "height": 0.5}, "mesh": {"level": 0},
            "fluid": {"density": 1000.0, "viscosity": 1.0}, "inflow": {"mean_velocity": 0.0},
            "outlet": {"kind": "do-nothing", "hydrostatic": True}, "gravity": {"x": 3.0, "y": -9.81},
            "output": {"pictures": False, "vtu": False},
        }
    )  # fmt: skip
    rest = solve(scene)
    assert rest.converged, rest.reason
    x, y = rest.fields.points.T
    exact = 1000.0 * (3.0 * (x - 2.0) - 9.81 * (y - 0.5))
    assert abs(rest.fields.pressure - exact).max() < 1e-10 * abs(exact).max()
    assert abs(rest.fields.velocity).max() < 1e-10
