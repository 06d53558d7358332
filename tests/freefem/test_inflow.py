"""The inlet in any direction."""

import json
import math

import numpy as np
import pytest

from ffsi.freefem import run_script
from ffsi.scene import CASES, Scene
from ffsi.script.render import render

INLET = "real inletX = 0, inletY = 0, inwardX = 1, inwardY = 0,"
LAST_OF_MESH = "  ShapeMesh();\n}"


def rigid_flap() -> Scene:
    table = CASES["flap-svk"].model_dump(exclude_none=True)
    table = {key: table[key] for key in table if key not in ("solid", "mesh_motion")}
    table["mesh"] = {"level": 0}
    table["inflow"]["profile"] = "y * (H - y) * (1 + y / H)"  # not symmetric: the direction along the inlet matters
    return Scene.model_validate(table)


def turned(text: str, angle: float, dx: float, dy: float) -> str:
    """Return the script with its whole mesh turned about the origin (rad) and shifted (m)."""
    c, s = repr(math.cos(angle)), repr(math.sin(angle))
    assert INLET in text and LAST_OF_MESH in text
    text = text.replace(INLET, f"real inletX = {dx}, inletY = {dy}, inwardX = {c}, inwardY = {s},")
    moved = f"  Th = movemesh(Th, [{dx} + {c}*x - {s}*y, {dy} + {s}*x + {c}*y]);\n"
    return text.replace(LAST_OF_MESH, "  ShapeMesh();\n" + moved + "}")


@pytest.fixture(scope="module")
def forces(installation, tmp_path_factory):
    def forces(text: str) -> dict[str, float]:
        folder = tmp_path_factory.mktemp("run")
        (folder / "case.edp").write_text(text, encoding="utf-8")
        run_script(folder / "case.edp", {"out": folder}, installation=installation, cwd=folder, time_limit=60)
        return json.loads((folder / "point-0001.json").read_text())["quantities"]

    return forces


straight = pytest.fixture(lambda forces: forces(render(rigid_flap())), scope="module")


@pytest.mark.parametrize(("angle", "shift"), [(math.pi / 2, (0.0, 0.0)), (2.5, (0.3, -0.7))])
def test_a_turned_channel_has_turned_forces(forces, straight, angle, shift):
    after = forces(turned(render(rigid_flap()), angle, *shift))
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    for form in ("", "_surface"):
        expected = rotation @ [straight[f"drag{form}"], straight[f"lift{form}"]]
        np.testing.assert_allclose([after[f"drag{form}"], after[f"lift{form}"]], expected, rtol=1e-7)
    assert after["pressure_drop"] == pytest.approx(straight["pressure_drop"], rel=1e-7)
