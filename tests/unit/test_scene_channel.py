"""The plain channel: walls as the only part, sizes in proportion to the height, what is refused."""

from typing import Any

import pytest
from test_scene_malformed import check

from ffsi.scene import CASES, Scene, SceneError, boundaries, load_scene
from ffsi.scene.geometry import Channel
from ffsi.scene.numerics import Mesh
from ffsi.script.render import render


def channel(mesh: dict[str, Any] | None = None, **geometry: object) -> Scene:
    flow = {
        key: getattr(CASES["turek-cfd1"], key).model_dump(exclude_none=True) for key in ("fluid", "inflow", "outlet")
    }
    table = {"name": "channel", "geometry": {"kind": "channel", "length": 3.0, "height": 0.5, **geometry}, **flow}
    return Scene.model_validate(table | {"mesh": mesh or {}})


def test_a_channel_has_walls_with_forces_and_lengths_by_its_height() -> None:
    found = {b.name: (b.label, b.role, b.part, b.exact_length) for b in boundaries(channel())}
    assert found == {
        "inlet": (1, "inlet", None, 0.5),
        "outlet": (2, "outlet", None, 0.5),
        "walls": (3, "no-slip", "walls", 6.0),
    }
    assert channel().exact_areas() == {"fluid": 1.5} and channel().physics == "fluid"
    assert (channel().tip, channel().probes) == (None, {})
    scene = channel(height="2 mm")
    assert scene.forces is not None and scene.forces.reference_length == 0.002
    sizes, unit = scene.mesh, Channel.default_sizes
    assert sizes.growth == unit["growth"]
    assert (sizes.far_size, sizes.body_size) == pytest.approx((0.002 * unit["far_size"], 0.002 * unit["body_size"]))
    given = channel({"body_size": 0.01})
    assert given.mesh == Mesh(**{**channel().mesh.model_dump(), "body_size": 0.01})
    assert given.mesh.far_size == 0.5 * unit["far_size"]
    assert "adaptmesh(" not in render(channel()) and "adaptmesh(" in render(CASES["turek-cfd1"])
    assert Scene.from_toml(channel().to_toml()) == channel()


@pytest.mark.parametrize(("text", "fragments"), [
    ("height = 1", ["geometry.length: missing;", "length of the channel, m"]),
    ("height = -1\nlength = 1", ["geometry.height = -1:", "> 0 in m"]),
    ("height = 1\nlength = 1\nhieght = 1", ["geometry.hieght = 1:", 'mean "geometry.height"']),
    ("height = 1\nlength = 1\n[solid.flap]\ndensity = 1", ["solid.flap:", 'the geometry "channel" holds no solid']),
    ("height = 1\nlength = 1", ["fluid: missing;"]),
])  # fmt: skip
def test_malformed(text: str, fragments: list[str], tmp_path: Any) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(f'name = "channel"\n[geometry]\nkind = "channel"\n{text}\n')
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    check(caught.value, fragments)
