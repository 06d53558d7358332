"""Binary files: what is written is read back, and what is wrong is named."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from test_reference_cases import flap_mesh

from ffsi.files.arrays import (
    RawFileError,
    RawState,
    read_arrays,
    read_mesh,
    read_state,
    write_arrays,
    write_mesh,
    write_state,
)


@pytest.fixture
def state():
    mesh, rng = flap_mesh(), np.random.default_rng(1)
    return RawState(
        rng.normal(size=(mesh.n_p2, 2)), rng.normal(size=(mesh.n_p2, 2)), rng.normal(size=len(mesh.vertices))
    )


def test_reading_sets_no_more_memory_aside_than_the_file_has_bytes(tmp_path):
    """What is accepted at most is 20 GB: with a bound on the memory (ulimit -v) no run could be checked."""
    path = tmp_path / "small.bin"
    write_arrays(path, [np.arange(1000.0)])
    tracemalloc.start()
    try:
        read_arrays(path, (float,))
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def test_layout_and_round_trip(tmp_path):
    path = tmp_path / "two.bin"
    write_arrays(path, [np.array([1, -2]), np.array([0.5])])
    assert path.read_bytes() == (
        (2).to_bytes(8, "little")
        + (1).to_bytes(8, "little")
        + (-2).to_bytes(8, "little", signed=True)
        + (1).to_bytes(8, "little")
        + bytes.fromhex("000000000000e03f")
    )
    whole, fraction = read_arrays(path, (int, float))
    assert whole.tolist() == [1, -2] and fraction.tolist() == [0.5]
    mesh = flap_mesh()
    write_mesh(tmp_path / "mesh.bin", mesh)
    again = read_mesh(tmp_path / "mesh.bin")
    for field in dataclasses.fields(mesh):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(mesh, field.name))


@pytest.mark.parametrize("mixed", [0, 1, 3])
def test_state_round_trip(tmp_path, state, mixed):
    state = dataclasses.replace(state, ps=np.random.default_rng(2).normal(size=(mixed, len(state.p))))
    write_state(tmp_path / "point-0001.bin", state)
    again = read_state(tmp_path / "point-0001.bin", flap_mesh())
    for field in ("u", "v", "p", "ps"):
        np.testing.assert_array_equal(getattr(again, field), getattr(state, field))


def test_pressures_of_solids_fit_their_mesh(state, tmp_path):
    assert state.ps.shape == (0, len(state.p))
    path = tmp_path / "point-0001.bin"
    write_state(path, state)
    whole = path.read_bytes()
    write_arrays(tmp_path / "more.bin", [state.p, state.p[:-1]])
    path.write_bytes(whole + (tmp_path / "more.bin").read_bytes())
    with pytest.raises(RawFileError, match=r"ps 2 has \d+ values, the mesh has"):
        read_state(path, flap_mesh())
    for rest in (b"\0" * 4, (5).to_bytes(8, "little")):
        path.write_bytes(whole + rest)
        with pytest.raises(RawFileError, match=r"point-0001\.bin: truncated: array 6 of 6"):
            read_state(path, flap_mesh())


@pytest.mark.parametrize("kept", [0, 7, 8, 60, -1])
def test_truncated_file_is_refused(tmp_path, kept):
    path = tmp_path / "mesh.bin"
    write_mesh(path, flap_mesh())
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(RawFileError, match=r"mesh\.bin: truncated: array \d of 8"):
        read_mesh(path)


@pytest.mark.parametrize(("change", "message"), [
    (lambda data: data.extend(b"\0" * 8), "8 bytes follow the last of 8 arrays"),
    (lambda data: data.__setitem__(8, 2), r"header \[2, "),  # version
    (lambda data: data.__setitem__(16, data[16] + 1), r"x has \d+ values, the header says"),  # nv
    (lambda data: data.__setitem__(40, data[40] ^ 1), r"P2 nodes are used, the header says"),  # n2
])  # fmt: skip
def test_headers_that_disagree_with_the_file_are_refused(tmp_path, change, message):
    path = tmp_path / "mesh.bin"
    write_mesh(path, flap_mesh())
    data = bytearray(path.read_bytes())
    change(data)
    path.write_bytes(data)
    with pytest.raises(RawFileError, match=message):
        read_mesh(path)


def test_what_does_not_fit_a_mesh_is_refused(tmp_path, state):
    write_state(tmp_path / "point-0001.bin", dataclasses.replace(state, p=state.p[:-1]))
    with pytest.raises(RawFileError, match=r"p has \d+ values, the mesh has"):
        read_state(tmp_path / "point-0001.bin", flap_mesh())
    state.v[3, 1] = np.nan
    write_state(tmp_path / "point-0001.bin", state)
    with pytest.raises(RawFileError, match="vy has a value that is not finite, the first at node 3"):
        read_state(tmp_path / "point-0001.bin", flap_mesh())
    mesh = flap_mesh()
    with pytest.raises(RawFileError, match="triangles names a vertex outside"):
        dataclasses.replace(mesh, triangles=mesh.triangles + 1)
    with pytest.raises(RawFileError, match="without a gap"):
        dataclasses.replace(mesh, p2=mesh.p2 + 1)
    first, second, middle = mesh.p2_coordinates[mesh.edge_nodes].transpose(1, 0, 2)
    np.testing.assert_array_equal(first, mesh.vertices[mesh.edges[:, 0]])
    np.testing.assert_array_equal(second, mesh.vertices[mesh.edges[:, 1]])
    np.testing.assert_allclose(middle, 0.5 * (first + second), rtol=0, atol=1e-16)
    far = np.array([[0, len(mesh.vertices) - 1]])
    with pytest.raises(RawFileError, match="edge 0 is no side of any triangle"):
        _ = dataclasses.replace(mesh, edges=far, label=np.array([1])).edge_nodes
