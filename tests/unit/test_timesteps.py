"""Files of a computation in time: what a kill leaves of them, and what is read from it."""

import dataclasses
import shutil
import tracemalloc

import numpy as np
import pandas as pd
import pytest
from test_reference_cases import flap_mesh
from time_folders import HEAD, NEWTON_HEAD, STEPS_HEAD, write_checkpoint

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
from ffsi.files.checkpoints import cut_back, keep_checkpoint, read_checkpoint
from ffsi.files.errors import InputError
from ffsi.files.history import read_history, seconds_of_run, seconds_of_steps
from ffsi.files.steps import read_saved_steps, read_steps


@pytest.fixture
def directory(tmp_path):
    """Twelve steps, saved at 4, 8 and 12, checkpoints after 6 (a) and 9 (b)."""
    rows = "".join(f"{0.1 * i!r},0.1,1,2,3,4,0.5,2,0,{i}\n" for i in range(1, 13))
    (tmp_path / "history.csv").write_text(HEAD + rows)
    rows = "".join(f"{i},{0.1 * i!r},0.1,{j},1e-9,0,3,0.5,{i}\n" for i in range(1, 13) for j in range(2))
    (tmp_path / "newton.csv").write_text(NEWTON_HEAD + rows)
    rows = ""
    for i in (4, 8, 12):
        rows += f"{i},{0.1 * i!r},0.1,0.6,state-{i - 1:06d}.bin,state-{i:06d}.bin,1,2\n"
        for number in (i - 1, i):
            (tmp_path / f"state-{number:06d}.bin").write_bytes(b"")
    (tmp_path / "steps.csv").write_text(STEPS_HEAD + rows)
    write_checkpoint(tmp_path / "checkpoint-a.bin", 6, 0.1 * 6)
    write_checkpoint(tmp_path / "checkpoint-b.bin", 9, 0.1 * 9)
    return tmp_path


def truncate(path, part):
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])


def test_a_line_that_was_cut_off_is_no_step(directory):
    path = directory / "history.csv"
    path.write_text(path.read_text() + "1.3,0.1,1,2,3,4,0.5,2,0")
    assert len(read_history(directory)) == 12


@pytest.mark.parametrize(("text", "message"), [(None, "missing or empty"), ("", "missing"), ('a,b\n"1\n', "damaged")])
def test_histories_that_are_none(directory, text, message):
    if text is None:
        (directory / "history.csv").unlink()
    else:
        (directory / "history.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_history(directory)


@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.99])
def test_a_checkpoint_that_was_cut_off_is_none(directory, part):
    path = directory / "checkpoint-b.bin"
    found = read_checkpoint(path)
    assert found is not None and (found.step, found.time) == (9, 0.1 * 9)
    truncate(path, part)
    assert read_checkpoint(path) is None
    path.unlink()
    assert read_checkpoint(path) is None


def test_a_checkpoint_with_another_end_mark_or_version_is_none(directory):
    path = directory / "checkpoint-b.bin"
    data = bytearray(path.read_bytes())
    for place in (8, -8):  # version, and the end mark
        spoiled = data.copy()
        spoiled[place if place > 0 else len(data) + place] += 1
        path.write_bytes(spoiled)
        assert read_checkpoint(path) is None


@pytest.mark.parametrize("name", ["checkpoint-a.bin", "checkpoint-b.bin"])
def test_the_kept_checkpoint_gets_the_second_name(directory, name):
    found = read_checkpoint(directory / name)
    assert found is not None
    kept = keep_checkpoint(found)
    assert kept.name == "checkpoint-b.bin"
    again = read_checkpoint(kept)
    assert again is not None and again.step == found.step


@pytest.mark.parametrize("cut", [False, True])
def test_everything_after_a_step_is_taken_out(directory, cut):
    if cut:  # in the middle of a line, as a kill does
        for name in ("history", "newton", "steps"):
            path = directory / f"{name}.csv"
            path.write_text(path.read_text() + "13,1.")
    for _ in range(2):  # killed in between, it is done again
        cut_back(directory, 9)
        assert read_history(directory)["time"].tolist() == pytest.approx([0.1 * i for i in range(1, 10)])
        rows = (directory / "newton.csv").read_text().splitlines()
        assert len(rows) == 1 + 18 and rows[0] + "\n" == NEWTON_HEAD
        assert [step.step for step in read_saved_steps(directory)] == [4, 8]
        states = sorted(path.name for path in directory.glob("state-*"))
        assert states == [f"state-{i:06d}.bin" for i in (3, 4, 7, 8)]


def test_cycles_after_a_step_are_taken_out(directory):
    for number in (1, 2, 3):  # of 0.4 s each; step 9 ends at 0.9 s
        arrays = [np.array([1, number, 1]), 0.4 * np.array([number - 1.0, number]), np.array([0]), *[np.ones(1)] * 4]
        write_arrays(directory / f"wall-{number:04d}.bin", arrays)
    write_arrays(directory / "wall-0004.bin", [np.array([1, 4, 1])])  # a kill cut it off
    cut_back(directory, 9)
    assert sorted(path.name for path in directory.glob("wall-*")) == ["wall-0001.bin", "wall-0002.bin"]


@pytest.mark.parametrize(("more", "whole"), [(4, True), (3, False)])
def test_a_checkpoint_with_the_sums_of_a_cycle(directory, more, whole):
    head, times, *arrays, mark = read_arrays(directory / "checkpoint-b.bin", (int, float), more=float)
    sums = [np.ones(3)] * more
    write_arrays(directory / "checkpoint-b.bin", [head, times, *arrays, *sums, mark.view(np.int64)])
    assert (read_checkpoint(directory / "checkpoint-b.bin") is not None) == whole


def test_saved_steps_need_both_files_and_seconds_add_up(directory):
    assert len(read_saved_steps(directory)) == 3
    (directory / "state-000007.bin").unlink()
    assert [step.step for step in read_saved_steps(directory)] == [4, 12]
    shutil.rmtree(directory)
    assert read_saved_steps(directory) == []
    history = pd.DataFrame({"seconds": [5.0, 6.0, 8.0, 3.0, 3.5, 1.0]})
    assert seconds_of_steps(history).tolist() == [1.0, 2.0, 0.5] and seconds_of_run(history) == 8.0 + 3.5 + 1.0
    assert seconds_of_run(history[:0]) == 0.0


def test_damaged_steps_are_named_and_those_of_a_solid_have_no_forces(directory):
    path = directory / "steps.csv"
    path.write_text(path.read_text().replace(",1,2\n", ",,\n"))
    assert [step.quantities for step in read_steps(directory)] == [{}, {}, {}]
    (directory / "steps.csv").write_text("step,time\n4,0.4\n")
    with pytest.raises(InputError, match=r"steps.csv is damaged: 'drag'|steps.csv is damaged"):
        read_saved_steps(directory)


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
