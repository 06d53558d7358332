"""VTU files of quadratic triangles."""

import json
import re
from dataclasses import replace

import meshio
import numpy as np
import pytest
from run_folders import given_state, make_run, structured_mesh

from ffsi.files import seals
from ffsi.files.arrays import write_state
from ffsi.hemodynamics.result import load_result
from ffsi.result.fields import Fields
from ffsi.result.vtu import write_vtu
from ffsi.scene import CASES, with_values


@pytest.fixture
def fields() -> Fields:
    mesh = structured_mesh(5, 2)
    return Fields.from_raw(mesh, given_state(mesh))


def test_round_trip_keeps_every_bit(tmp_path, fields):
    write_vtu(tmp_path / "fields.vtu", fields)
    back = meshio.read(tmp_path / "fields.vtu")
    assert [block.type for block in back.cells] == ["triangle6"]
    np.testing.assert_array_equal(back.points[:, :2], fields.points)
    np.testing.assert_array_equal(back.cells[0].data, fields.cells)
    np.testing.assert_array_equal(back.cell_data["region"][0], fields.region)
    for name in ("displacement", "velocity"):
        np.testing.assert_array_equal(back.point_data[name][:, :2], getattr(fields, name), err_msg=name)
    np.testing.assert_array_equal(back.point_data["pressure"], fields.pressure)
    assert [item.name for item in tmp_path.iterdir()] == ["fields.vtu"]


@pytest.fixture
def mixed() -> Fields:
    """The block of region 2 is mixed, with a pressure that is linear on it and zero at other vertices."""
    mesh, pressure = structured_mesh(5, 2), np.zeros((1, 18))
    inside = np.unique(mesh.triangles[mesh.region == 2])
    pressure[0, inside] = 1.0 + mesh.vertices[inside] @ [2.0, 3.0]
    return Fields.from_raw(mesh, replace(given_state(mesh), ps=pressure), [2])


def test_pressures_of_mixed_solids_are_kept_where_they_are(mixed, tmp_path, fields):
    inside = np.isin(np.arange(len(mixed.points)), mixed.cells[mixed.region == 2])
    np.testing.assert_allclose(mixed.solid_pressure[inside], 1.0 + mixed.points[inside] @ [2.0, 3.0], rtol=1e-14)
    assert (mixed.solid_pressure[~inside] == 0.0).all() and inside.any() and not inside.all()
    write_vtu(tmp_path / "mixed.vtu", mixed)
    found = meshio.read(tmp_path / "mixed.vtu").point_data["solid_pressure"]
    np.testing.assert_array_equal(found, mixed.solid_pressure)
    write_vtu(tmp_path / "fields.vtu", fields)
    assert "solid_pressure" not in meshio.read(tmp_path / "fields.vtu").point_data


def test_pressures_belong_to_their_solids(tmp_path):
    run = make_run(tmp_path / "run", "flap-neo-hookean")
    scene, mesh = with_values(CASES["flap-neo-hookean"], {"solid.flap.formulation": "mixed"}), structured_mesh()
    (run / "scene.toml").write_text(scene.to_toml())
    write_state(run / "point-0001.bin", replace(given_state(mesh), ps=np.ones((1, len(mesh.vertices)))))
    data = json.loads((run / "result.json").read_text())
    seals.write(run / "result.json", data | {"files": seals.seal_all(run, ("point-*.bin", "scene.toml"))})
    fields = load_result(run).fields
    np.testing.assert_array_equal(np.flatnonzero(fields.solid_pressure), np.unique(mesh.p2[mesh.region == 2]))
    mesh = structured_mesh(5, 2)
    with pytest.raises(ValueError, match="pressures of 0 mixed solids, the scene has 1"):
        Fields.from_raw(mesh, given_state(mesh), [2])


def test_file_is_compressed_binary_with_vectors_that_paraview_can_warp_by(tmp_path, fields):
    write_vtu(tmp_path / "fields.vtu", fields)
    head = (tmp_path / "fields.vtu").read_bytes().decode("latin-1")
    assert 'compressor="vtkZLibDataCompressor"' in head and 'format="ascii"' not in head
    for name in ("displacement", "velocity"):
        array = next(tag for tag in re.findall("<DataArray[^>]*>", head) if f'Name="{name}"' in tag)
        assert 'NumberOfComponents="3"' in array
