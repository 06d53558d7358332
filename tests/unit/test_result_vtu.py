"""VTU files of quadratic triangles."""

import re

import meshio
import numpy as np
import pytest
from run_folders import given_state, structured_mesh

from ffsi.fields import Fields
from ffsi.vtu import read_vtu, write_vtu


@pytest.fixture
def fields() -> Fields:
    mesh = structured_mesh(5, 2)
    return Fields.from_raw(mesh, given_state(mesh))


def test_round_trip_keeps_every_bit(tmp_path, fields):
    write_vtu(tmp_path / "fields.vtu", fields)
    back = read_vtu(tmp_path / "fields.vtu")
    for name in ("points", "cells", "region", "displacement", "velocity", "pressure"):
        np.testing.assert_array_equal(getattr(back, name), getattr(fields, name), err_msg=name)
    assert [item.name for item in tmp_path.iterdir()] == ["fields.vtu"]


def test_file_is_compressed_binary_with_vectors_that_paraview_can_warp_by(tmp_path, fields):
    write_vtu(tmp_path / "fields.vtu", fields)
    head = (tmp_path / "fields.vtu").read_bytes().decode("latin-1")
    assert 'compressor="vtkZLibDataCompressor"' in head
    assert 'format="ascii"' not in head
    for name in ("displacement", "velocity"):
        array = next(tag for tag in re.findall("<DataArray[^>]*>", head) if f'Name="{name}"' in tag)
        assert 'NumberOfComponents="3"' in array


def test_other_cells_are_refused(tmp_path):
    meshio.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [("triangle", [[0, 1, 2]])]).write(tmp_path / "linear.vtu")
    with pytest.raises(ValueError, match="quadratic triangles"):
        read_vtu(tmp_path / "linear.vtu")
