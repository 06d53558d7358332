"""`ffsi show`: the mesh of a scene without a solution, in words and as a picture."""

import pytest
from PIL import Image

from ffsi.cli.main import main
from ffsi.freefem import FreeFEMError
from ffsi.result.domain import intended, meshed
from ffsi.result.sketch import sketch
from ffsi.run.meshing import mesh_of
from ffsi.scene import Scene, boundaries, load_scene
from ffsi.scene.drafts import Answers, draft


@pytest.mark.parametrize("case", ["turek-fsi1", "aneurysm-pulsatile", "cook", "cylinder-2d1"])
def test_the_mesh_is_that_of_the_scene(case):
    scene = load_scene(case, ["mesh.level=0"])
    found = mesh_of(scene)
    assert meshed(scene, found.mesh)["regions"] == pytest.approx(intended(scene)["regions"], rel=0.01)
    figure = sketch(scene, found.mesh)
    words = {text.get_text() for text in figure.legends[0].get_texts()}
    assert all(any(side.name in text and side.role in text for text in words) for side in boundaries(scene))
    assert set(scene.exact_areas()) < words


def test_meshes_are_those_of_runs_or_refused(solved):
    scene = Scene.from_toml(draft("mine", Answers("channel-cavity", what="solid", level="0")))
    assert list(meshed(scene, mesh_of(scene).mesh)["regions"]) == ["floor"]
    result = solved("turek-fsi1")
    found = mesh_of(result.scene)
    assert (len(found.mesh.triangles), found.unknowns) == (result.data["triangles"], result.data["unknowns"])
    with pytest.raises(FreeFEMError, match="smaller elements are needed there") as error:
        mesh_of(load_scene("cylinder-2d1", ["mesh.level=0", "mesh.size_factor=30"]))
    assert error.value.kind == "bad-input"


def test_the_command_draws_a_draft(tmp_path, capsys):
    path, picture = tmp_path / "mine.toml", tmp_path / "mine.png"
    path.write_text(draft("mine", Answers("channel", level="0")))
    with pytest.raises(SystemExit) as ended:
        main(["show", str(path), "-o", str(picture)])
    out, err = capsys.readouterr()
    assert ended.value.code == 0 and str(picture) in err
    assert Scene.from_toml(path.read_text()).heading in out and "unknowns" in out
    with Image.open(picture) as image:
        assert min(image.size) > 300 and len(image.getcolors(10**6) or []) > 50
