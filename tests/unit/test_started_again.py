"""What a mesh made for quantities is refused for, and what is changed where a run in time starts again."""

import pytest

import ffsi
from ffsi.run.adaptation import asked_of, goals
from ffsi.run.one_scene import _what_goes_further
from ffsi.scene import CASES, load_scene
from ffsi.scene.geometry import Channel


@pytest.mark.parametrize(("case", "asked", "message"), [
    ("turek-fsi3", {"adapt": ["drag"], "tolerance": 1e-3}, "adapt: turek-fsi3 is a scene in time"),
    ("turek-fsi1", {"adapt": ["dragg"], "tolerance": 1e-3}, "'dragg' is no quantity .* did you mean \"drag\""),
    ("cook", {"adapt": ["drag"], "tolerance": 1e-3}, "accepted: tip_ux, tip_uy"),
    ("turek-fsi1", {"adapt": ["drag"], "tolerance": 0}, "tolerance = 0: accepted"),
    ("turek-fsi1", {"adapt": ["drag"], "tolerance": "-1%"}, "tolerance = '-1%': accepted"),
    ("turek-fsi1", {"adapt": ["drag"], "tolerance": "few"}, "tolerance = 'few': accepted"),
    ("turek-fsi1", {"adapt": ["drag"], "tolerance": True}, "tolerance = True: accepted"),
    ("turek-fsi1", {"adapt": ["drag"], "unknowns": 0}, "unknowns = 0: accepted"),
    ("turek-fsi1", {"adapt": ["drag"]}, "give tolerance"), ("turek-fsi1", {"tolerance": 1e-3}, "belong to adapt"),
    ("turek-fsi1", {"adapt": ["drag"], "tolerance": 1e-3, "sensitivities": True}, "not both"),
])  # fmt: skip
def test_it_is_refused(tmp_path, case, asked, message):
    with pytest.raises(ffsi.InputError, match=message):
        ffsi.solve(case, tmp_path / "run", **asked)
    assert not (tmp_path / "run").exists()


def test_a_mesh_without_sizes_is_refused():
    channel = load_scene("flap-svk").model_copy(update={"geometry": Channel(length=1.0, height=1.0)})
    with pytest.raises(ffsi.InputError, match="'channel' has no sizes"):
        asked_of(channel, ["pressure_drop"], 1e-3, None)


def test_the_script_is_asked_for_a_fraction():
    scene, asked = asked_of(CASES["turek-fsi1"], ["drag", "tip_uy", "drag"], "0.1%", 20000)
    assert asked == {"adapt": "drag,tip_uy", "tolerance": "0.001", "unknowns": "20000"}
    assert scene.mesh.level == 0
    assert {"drag_beam", "lift_cylinder", "drag_coefficient", "pressure_drop", "tip_ux"} <= set(goals(scene))


FOLDS = "J = det F falls; the fluid mesh folds at (0, 0): J = 0.1"
BACK = "; fluid comes back through the outlet, 52 % of what passes it, which outlet.backflow = 0.5 keeps stable"


@pytest.mark.parametrize(("settings", "reason", "wanted"), [
    ([], "no convergence", {}), ([], FOLDS + BACK, {"mesh_motion.kind": "hyperelastic"}),
    (["mesh_motion.kind=hyperelastic"], FOLDS + BACK, {"outlet.backflow": 0.5}),
    (["mesh_motion.kind=harmonic"], FOLDS, {}), ([], "no convergence" + BACK, {"outlet.backflow": 0.5}),
    ([], "no convergence" + BACK.replace("52", "19"), {}), (["outlet.backflow=0.2"], "no convergence" + BACK, {}),
])  # fmt: skip
def test_what_the_scene_left_open_is_changed(settings, reason, wanted):
    assert _what_goes_further(load_scene("turek-fsi2", ["mesh_motion=none", *settings]), {"reason": reason}) == wanted
    assert _what_goes_further(load_scene("turek-fsi1"), {"reason": reason}) == {}
