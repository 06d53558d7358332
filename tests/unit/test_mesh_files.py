"""Gmsh's format byte by byte, damage, names that are no names, and meshes of any size."""

import re
import struct
import time
from pathlib import Path

import meshio
import numpy as np
import pytest
from test_mesh_malformed import BROKEN
from vessel_meshes import Drawing, beam_scene, lengths, vessel, write_scene

from ffsi.result.domain import intended, words
from ffsi.scene import Scene, SceneError, boundaries, load_scene, stored
from ffsi.script.render import render

TEXT = """$MeshFormat
4.1 0 8
$EndMeshFormat
$Comments
what $Nodes holds
$EndComments
$PhysicalNames
3
1 5 "fixed"
2 1 "beam"
1 9 "nothing"
$EndPhysicalNames
$Entities
0 2 1 0
1 0 0 0 0 1 0 1 5 0
2 2 0 0 2 1 0 1 -5 0
1 0 0 0 2 1 0 1 1 2 1 -2
$EndEntities
$Nodes
1 6 1 6
2 1 0 6
1
2
3
4
5
6
0 0 0
1 0 0
2 0 0
0 1 0
1 1 0
2 1 0
$EndNodes
$Elements
3 6 1 6
1 1 1 1
1 4 1
1 2 1 1
2 3 6
2 1 2 4
3 1 2 5
4 1 5 4
5 2 3 6
6 2 6 5
$EndElements
$ElementData
1
"a view"
1
0
$EndElementData
"""


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_the_text_is_read(ends, tmp_path) -> None:
    (tmp_path / "a.msh").write_bytes(TEXT.replace("\n", ends).encode())
    assert lengths(beam_scene(tmp_path / "a.msh", "fixed")) == {"clamped": 2.0, "free": 4.0}


@pytest.mark.parametrize("order", ["<", ">"])
def test_binary_of_both_orders(order, tmp_path) -> None:
    """Version 2.2, with the right side in its group reversed, and a triangle in two groups."""
    points = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    nodes = b"".join(struct.pack(f"{order}i3d", i, x, y, 0) for i, (x, y) in enumerate(points, start=1))
    lines = struct.pack(f"{order}3i", 1, 2, 2) + struct.pack(f"{order}10i", 1, 5, 1, 4, 1, 2, -5, 2, 3, 6)
    rows = [(3, 1, 1, 1, 2, 5), (4, 1, 1, 1, 5, 4), (5, 1, 1, 2, 3, 6), (6, 1, 1, 2, 6, 5), (7, 8, 1, 6, 2, 5)]
    triangles = struct.pack(f"{order}3i", 2, 5, 2) + b"".join(struct.pack(f"{order}6i", *row) for row in rows)
    data = b"$MeshFormat\n2.2 1 8\n" + struct.pack(f"{order}i", 1) + b"\n$EndMeshFormat\n$Nodes\n6\n" + nodes
    data += b"\n$EndNodes\n$Elements\n7\n" + lines + triangles + b"\n$EndElements\n"
    (tmp_path / "a.msh").write_bytes(data)
    assert lengths(beam_scene(tmp_path / "a.msh", 5, 1)) == {"clamped": 2.0, "free": 4.0}
    with pytest.raises(SceneError, match='the mesh has the region "1", which is used nowhere'):
        beam_scene(tmp_path / "a.msh", 5, 8)


DAMAGED = [
    ("4.1 0 8", "4.1 0", "damaged at line 2: no version, type and size as in 4.1 0 8"),
    ("4.1 0 8", "4.2 0 8", "this is version 4.2 of Gmsh's format; accepted: versions 4.1 and 2.2"),
    ("1 4 1\n1 2", "1 4 1x\n1 2", r'damaged at line 38, in the section \$Elements: "x" is no number'),
    ("2 3 6\n2 1 2 4", "2 3 6.5\n2 1 2 4", r'line 40, in the section \$Elements: "6.5" is no whole number'),
    ("0 1 0\n1 1 0", "0 1 0\n1 1. .0 0", r"line 33, in the section \$Nodes: there is more than it announces"),
    ("1 1 0\n2 1 0", "1 1 0\n2 - 0", r'line 33, in the section \$Nodes: "-" is no number'),
    ("1 1 0\n2 1 0", "1 1 0\n2 1", r"line 34, in the section \$Nodes: it ends too early"),
    ("1 6 1 6\n2", "1 7 1 6\n2", r"line 33, in the section \$Nodes: it announces 7 nodes, and 6 follow"),
    ("3 6 1 6\n1", "3 5 1 6\n1", r"in the section \$Elements: it announces 5 elements, and 6 follow"),
    ("2 1 0 6\n", "2 1 0 999999999999\n", r"line 21, in the section \$Nodes: 999999999999 things are announced"),
    ("2 1 0 6\n", "2 1 0 -6\n", r"line 21, in the section \$Nodes: -6 things are announced"),
    ("2 1 2 4", "2 1 99 4", r"line 41, in the section \$Elements: elements of the type 99; accepted: triangles"),
    ("3 1 2 5", "3 1 2 50", r"a triangle has the node 50, which the file does not hold \(number 1 of its triangles\)"),
    ("5\n6\n0 0", "5\n5\n0 0", "the file has two nodes with the number 5"),
    ("$EndNodes\n", "", r"the section \$Nodes, which begins at line 19, has no end: the file is cut"),
    ("$EndElements\n", "$EndElement\n", r"the section \$Elements, which begins at line 35, has no end"),
    ("$Entities", "$Entitie", r"the section \$Entitie, which begins at line 13, has no end"),
    ("$Entities", "Entities", r'line 13: a section such as \$Nodes should begin here, not "Entities"'),
    ("$PhysicalNames\n3", "$PhysicalNames\n4", r"PhysicalNames: it announces 4 names, and 3 follow"),
    ('"fixed"', '"fixed', r"line 8, in the section \$PhysicalNames: it announces 3 names, and"),
    ("0 2 1 0\n1", "0 3 1 0\n1", r"in the section \$Entities: it"),
    ("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n", "", r"damaged at line 5: the section \$PhysicalNames comes before"),
    ("1 1 0\n2 1 0", "1 1 0\n2 1e999 0", "the coordinates of node 6 are not finite"),
    ("1 1 0\n2 1 0", "1 1 0\n2e200 1 0", r"the coordinates of node 6 are beyond 1e\+100"),
    ("1 1 0\n2 1 0", "1 1 0\n2 1" + 100 * "0" + " 0", "is no number"),
]


@pytest.mark.parametrize(("old", "new", "message"), DAMAGED, ids=[row[2][:60] for row in DAMAGED])
def test_damage_is_refused_with_its_place(old, new, message, tmp_path) -> None:
    assert TEXT.count(old) >= 1
    (tmp_path / "a.msh").write_text(TEXT.replace(old, new, 1))
    with pytest.raises(SceneError, match=message):
        beam_scene(tmp_path / "a.msh", "fixed")


# Names ---------------------------------------------------------------------------------------------------------------

HOSTILE = [
    "\x1b[31mred\x07", "\x1b]0;title\x07", "\x1b]52;c;ZXZpbA==\x07", "two\nlines", 'quo"ted', "\u202egnihton",
    "a');exec('touch /tmp/pwned')//", "<script>alert(1)</script>", "x" * 900,
]  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE, ids=range(len(HOSTILE)))
def test_names_from_files_are_words_only(name, tmp_path) -> None:
    """They can be used like any other, and in a message they are one short line without control characters."""
    (tmp_path / "a.msh").write_text(TEXT.replace("fixed", name), newline="")
    found = beam_scene(tmp_path / "a.msh", name)
    assert lengths(found) == {"clamped": 2.0, "free": 4.0} and name not in render(found)
    for text in ("\n".join(words(intended(found))), stored(found, tmp_path).to_toml()):
        assert name not in text
    with pytest.raises(SceneError, match="no such boundary; the mesh has ") as caught:
        beam_scene(tmp_path / "a.msh", "elsewhere")
    assert str(caught.value).isprintable() and len(str(caught.value)) < 1000


def test_two_thousand_names(tmp_path) -> None:
    entity, count = "1 0 0 0 0 1 0 1 5 0", 2000
    groups = " ".join(str(number) for number in [5, *range(100, 100 + count)])
    named = f"{count + 3}\n" + "".join(f'1 {100 + number} "side {number}"\n' for number in range(count))
    text = TEXT.replace(entity, f"1 0 0 0 0 1 0 {count + 1} {groups} 0").replace("Names\n3\n", f"Names\n{named}")
    (tmp_path / "a.msh").write_text(text)
    begin = time.perf_counter()
    assert lengths(beam_scene(tmp_path / "a.msh", "side 1234")) == {"clamped": 1.0, "free": 5.0}
    with pytest.raises(SceneError, match="no such boundary") as caught:
        beam_scene(tmp_path / "a.msh", "sude 1234")
    assert 'did you mean "side ' in str(caught.value) and len(str(caught.value)) < 3000
    assert time.perf_counter() - begin < 5


def verdict(drawing: Drawing, factor: float, folder: Path) -> str:
    """Return the lengths in sizes of the mesh, or the message without its numbers."""
    drawing.points = drawing.points * factor
    try:
        found = load_scene(write_scene(folder, None, drawing))
    except SceneError as error:
        return re.sub(r"[-+]?\d[\d.]*(e[-+]\d+)?", "#", str(error))
    return " ".join(f"{name} {length / factor:.9g}" for name, length in lengths_exactly(found).items())


def lengths_exactly(found: Scene) -> dict[str, float]:
    return {boundary.name: boundary.exact_length for boundary in boundaries(found)}


@pytest.mark.parametrize("factor", [1e-9, 1e-6, 1e-3, 7e5, 1e6])
def test_the_size_of_a_mesh_does_not_matter(factor, tmp_path) -> None:
    """Every mesh of the tests of broken ones gets the same verdict in micrometres and in kilometres."""
    for change in (None, *(row[0] for row in BROKEN if row[0] is not None and not row[1])):
        verdicts = []
        for size in (1.0, factor):
            drawing = vessel()
            if change is not None:
                change(drawing)
            verdicts.append(verdict(drawing, size, tmp_path))
        assert verdicts[0] == verdicts[1], change
        assert verdicts[0].startswith("inlet" if change is None else "geometry"), change


@pytest.mark.parametrize("noise", [1e-13, 1e-12, 1e-11])
@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_noise_in_coordinates(noise, factor, tmp_path) -> None:
    """Neither verdict nor lengths change, and sides that were parallel to an axis are again."""
    points = np.array([(x, y, 0.0) for x in np.linspace(0, 3, 31) for y in np.linspace(0, 1, 11)])
    moved = points + 3 * noise * np.random.default_rng(7).uniform(-1, 1, points.shape)
    corner = np.array([i * 11 + j for i in range(30) for j in range(10)])
    triangles = np.concatenate([corner[:, None] + (0, 11, 12), corner[:, None] + (0, 12, 1)])
    lines = np.array([(j, j + 1) for j in range(10)])
    mesh = meshio.Mesh(moved * factor, [("triangle", triangles), ("line", lines)])
    mesh.cell_data = {"gmsh:physical": [np.full(600, 1), np.full(10, 5)]}
    mesh.cell_data["gmsh:geometrical"] = mesh.cell_data["gmsh:physical"]
    mesh.write(tmp_path / "a.msh", file_format="gmsh22")
    found = beam_scene(tmp_path / "a.msh", 5, 1)
    assert lengths_exactly(found) == pytest.approx({"clamped": factor, "free": 7 * factor}, rel=1e-9)
    for axis, count in ((0, 31), (1, 11)):
        assert len(np.unique(found.geometry._mesh.vertices[:, axis])) == count
    assert np.abs(found.geometry._mesh.vertices - factor * points[:, :2]).max() < 1e-10 * factor
    (tmp_path / "stored.toml").write_text(stored(found, tmp_path).to_toml())
    assert load_scene(tmp_path / "stored.toml") == found
