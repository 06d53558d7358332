"""Files of a computation in time: what a kill leaves of them, and what is read from it."""

import shutil

import numpy as np
import pandas as pd
import pytest
from time_folders import HEAD, NEWTON_HEAD, STEPS_HEAD, write_checkpoint

from ffsi.files.arrays import read_arrays, write_arrays
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
