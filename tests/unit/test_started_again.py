"""What a run in time that failed is started again with."""

import pytest

from ffsi.run.one_scene import _what_goes_further
from ffsi.scene import load_scene

FOLDS = "J = det F falls; the fluid mesh folds at (0, 0): J = 0.1"
BACK = "; fluid comes back through the outlet, 52 % of what passes it, which outlet.backflow = 0.5 keeps stable"


@pytest.mark.parametrize(
    ("settings", "reason", "wanted"),
    [
        ([], "no convergence", {}),
        ([], FOLDS + BACK, {"mesh_motion.kind": "hyperelastic"}),
        (["mesh_motion.kind=hyperelastic"], FOLDS + BACK, {"outlet.backflow": 0.5}),
        (["mesh_motion.kind=harmonic"], FOLDS, {}),
        ([], "no convergence" + BACK, {"outlet.backflow": 0.5}),
        ([], "no convergence" + BACK.replace("52", "19"), {}),
        (["outlet.backflow=0.2"], "no convergence" + BACK, {}),
    ],
)
def test_what_the_scene_left_open_is_changed(settings, reason, wanted):
    assert _what_goes_further(load_scene("turek-fsi2", ["mesh_motion=none", *settings]), {"reason": reason}) == wanted
    assert _what_goes_further(load_scene("turek-fsi1"), {"reason": reason}) == {}
