"""Areas of regions and lengths of boundaries: what the scene says, and what was meshed."""

import json

import pytest
import tomli_w
from run_folders import report_text, structured_mesh
from vessel_meshes import scene_table, write_scene

from ffsi.cli.main import main
from ffsi.result.domain import intended, meshed, words
from ffsi.run import execute
from ffsi.scene import CASES, load_scene


@pytest.mark.parametrize("case", sorted(CASES))
def test_every_case_says_what_it_is_computed_on(case) -> None:
    scene = CASES[case]
    found = intended(scene)
    assert ("fluid" in found["regions"]) == (scene.fluid is not None)
    assert set(found["regions"]) - {"fluid"} == set(scene.solid)
    assert all(value > 0 for value in found["regions"].values())
    assert all(side["length"] > 0 for side in found["boundaries"].values())
    roles = {side["role"] for side in found["boundaries"].values()}
    assert ({"inlet", "outlet"} <= roles) == (scene.fluid is not None)


def test_what_was_meshed_and_its_parts(tmp_path) -> None:
    """The structured mesh of 2.5 x 0.4 has a column of solid in its lower half, and only its bottom has a label (3)."""
    found = meshed(load_scene("flap-svk"), structured_mesh())
    assert found["regions"] == pytest.approx({"fluid": 0.95, "flap": 0.05})
    assert found["boundaries"]["walls"] == {"role": "no-slip", "length": pytest.approx(2.5)}
    assert found["boundaries"]["root"] == {"role": "clamped", "length": 0.0}
    assert words(found)[0] == "regions: fluid 0.95 m², flap 0.05 m²" and "walls (no-slip) 2.5 m" in words(found)[1]
    assert meshed(load_scene("cantilever"), structured_mesh())["regions"] == pytest.approx({"beam": 0.05})
    write_scene(tmp_path)
    table = scene_table(parts={"free": "interface", "walls": "inner"})
    (tmp_path / "scene.toml").write_text(tomli_w.dumps(table))
    found = intended(load_scene(tmp_path / "scene.toml"))["boundaries"]
    assert {name: side["role"] for name, side in found.items()} == {
        "inlet": "inlet", "outlet": "outlet", "clamped": "clamped", "free": "free",
        "free (part)": "interface", "walls": "no-slip",
    }  # fmt: skip


def test_it_is_shown_before_solving_and_kept(freefem, tmp_path, capsys, monkeypatch) -> None:
    def solve(*arguments: object, **options: object) -> None:
        seen.append(capsys.readouterr().out)
        return real(*arguments, **options)

    seen: list[str] = []
    real = freefem.run_script
    monkeypatch.setattr(execute, "run_script", solve)
    arguments = ["run", "flap-svk", "--no-check", "--set", "output.pictures=false", "--out", str(tmp_path / "run")]
    for json_only in (False, True):
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            main([*arguments, *(["--json"] if json_only else [])])
        assert not stopped.value.code
    shown = "regions: fluid 0.992 m², flap 0.008 m²\nboundaries: inlet 0.4 m, outlet 0.4 m, walls (no-slip) 4.96 m, "
    assert seen == [f"{shown}surface (interface) 0.44 m, root (clamped) 0.04 m\n", ""]
    data = json.loads((tmp_path / "run" / "result.json").read_text())
    assert json.loads(capsys.readouterr().out) == data
    assert data["regions"] == pytest.approx({"fluid": 0.95, "flap": 0.05})
    assert data["boundaries"]["walls"]["length"] == pytest.approx(2.5)
    text = report_text(tmp_path, tmp_path / "run")
    assert '<td>walls</td><td>no-slip</td><td class="number">2.5</td><td>m</td>' in text
    assert '<td>flap</td><td>region</td><td class="number">0.05</td><td>m²</td>' in text
