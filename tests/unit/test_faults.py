"""What the machine does to a command: streams that are closed or full, disks, limits, and faults of ffsi itself."""

import errno
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from test_cli import call

from ffsi.files import folder, machine
from ffsi.run import execute

LEVEL = ["--set", "mesh.level=0", "--set", "output.pictures=false", "--set", "output.vtu=false"]


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.mark.parametrize(("words", "code", "said"), [
    ("cases >&-", 4, "standard output: closed"), ("cases > /dev/full", 4, "standard output: No space left on device"),
    ("--version > /dev/full", 4, "standard output: No space left on device"), ("cases | head -1 >&2", 0, "case"),
    ("run x 2> /dev/full", 2, ""), ("run x >&- 2>&-", 2, ""), ("cases <&- > /dev/null", 0, ""),
    ("cases | cat > /dev/null", 0, ""),
])  # fmt: skip
def test_a_stream_that_fails_changes_nothing_but_a_good_end(words, code, said):
    command = f"set -o pipefail; {sys.executable} -m ffsi {words}"
    source = str(Path(folder.__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": source, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == code, done.stderr
    assert said in done.stderr and "Traceback" not in done.stderr and "Exception ignored" not in done.stderr


def test_a_verdict_is_not_lost_with_its_words(capsys, monkeypatch, freefem, check):
    class Full:
        def write(self, text):
            raise OSError(errno.ENOSPC, "No space left on device")

        def flush(self):
            pass

    check.wrong = 0.12
    monkeypatch.setattr(sys, "stdout", Full())
    code, _, err = call(capsys, "run", "flap-svk", *LEVEL)
    assert code == 1
    assert "standard output: No space left on device; what this command printed there is lost" in err
    assert Path("runs/flap-svk/result.json").is_file()


@pytest.mark.parametrize(("kilobytes", "words"), [(30_000, "cases"), (80_000, "run flap-svk")])
def test_a_machine_that_cannot_load_the_libraries_gets_a_message(kilobytes, words):
    command = f"ulimit -v {kilobytes}; {sys.executable} -m ffsi {words}"
    source = str(Path(folder.__file__).parents[2])
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": source}, timeout=60
    )
    assert done.returncode == 4
    assert done.stderr.splitlines()[-1].startswith(("error: ffsi cannot be loaded: ", "error: the memory ended"))


@pytest.mark.parametrize(("number", "words"), [
    (errno.ENOSPC, "the disk is full"), (errno.EFBIG, "ulimit -f"), (errno.EDQUOT, "quota"),
    (errno.EMFILE, "ulimit -n"), (errno.EACCES, "Permission denied"),
])  # fmt: skip
@pytest.mark.parametrize("command", ["run", "sweep"])
def test_what_cannot_be_written_during_a_run_is_no_bad_input(
    capsys, monkeypatch, freefem, check, number, words, command
):
    real = Path.write_bytes

    def write_bytes(path, content):
        if path.name.startswith(".result"):
            raise OSError(number, os.strerror(number))
        return real(path, content)

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    more = ["--vary", "inflow.mean_velocity=0.01,0.02"] if command == "sweep" else []
    code, _, err = call(capsys, command, "flap-svk", *LEVEL, *more, "--out", "there")
    assert code == 4
    assert "result" in err and words in err and "what it has written there stays" in err
    assert not list(Path().rglob(".*.part"))


def test_what_can_be_made_again_makes_room_for_the_result(capsys, monkeypatch, freefem, check):
    real = Path.write_bytes

    def write_bytes(path, content):
        if path.name.startswith(".result") and Path("there/fields.vtu").exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(path, content)

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    code, _, err = call(capsys, "run", "flap-svk", *LEVEL[:4], "--out", "there")
    assert code == 4 and "not evaluated: pictures and VTU: " in err and "the disk is full" in err
    assert Path("there/result.json").is_file() and not Path("there/fields.vtu").exists()


def test_a_folder_that_vanishes_during_the_run_is_named(capsys, monkeypatch, freefem, check):
    real = freefem.run_script

    def run_script(*arguments, **options):
        done = real(*arguments, **options)
        shutil.rmtree("there")
        return done

    monkeypatch.setattr(execute, "run_script", run_script)
    code, _, err = call(capsys, "run", "flap-svk", *LEVEL, "--out", "there")
    assert code == 4
    assert "there has gone" in err or "there/" in err


def test_a_write_that_fails_names_its_file_and_leaves_no_part(tmp_path):
    (tmp_path / "x").mkdir()
    with pytest.raises(OSError) as caught:
        folder.write_text(tmp_path / "x", "text")  # a file cannot replace a folder
    assert caught.value.filename == str(tmp_path / "x") and [path.name for path in tmp_path.iterdir()] == ["x"]
    with pytest.raises(OSError) as caught, machine.writing(Path("/dev/full")), Path("/dev/full").open("w") as file:
        file.write("x" * 100_000)
    assert machine.words(caught.value) == "/dev/full: the disk is full (No space left on device)"


@pytest.mark.parametrize("command", ["run", "sweep"])
def test_a_folder_that_cannot_be_written_is_bad_input_before_anything_starts(capsys, monkeypatch, freefem, command):
    Path("file").write_text("")
    monkeypatch.setattr(os, "access", lambda path, mode: not mode & os.W_OK or Path(path).name != "locked")
    Path("locked").mkdir()
    more = ["--vary", "inflow.mean_velocity=0.01,0.02"] if command == "sweep" else []
    for out, said in {
        "locked": "read-only", "locked/a/b": "read-only", "file/a": "is a file", "new/" + "x" * 300: "too long",
        "/".join(["x" * 200] * 25): "too long",
    }.items():  # fmt: skip
        code, _, err = call(capsys, command, "flap-svk", *LEVEL, *more, "--out", out)
        assert (code, said in err) == (2, True), err
        assert len(err) < 1000
    assert sorted(path.name for path in Path().iterdir()) == ["file", "locked"] and freefem.solved == []


@pytest.mark.parametrize(("error", "code", "said"), [
    (KeyError("a\x1b[31m"), 70, "a fault of ffsi itself: KeyError"), (AssertionError("no"), 70, "please report it"),
    (RecursionError("deep"), 70, "a fault of ffsi itself"), (MemoryError(), 4, "the memory ended"),
    (OSError(errno.ENOSPC, "No space left on device", "a\nb"), 4, "a?b: the disk is full"),
    (FileNotFoundError(errno.ENOENT, "No such file or directory", "a"), 2, "a: No such file"),
    (KeyboardInterrupt(), 130, ""),
])  # fmt: skip
def test_an_error_that_nobody_expected_never_ends_with_1(capsys, monkeypatch, error, code, said):
    def fail(*_):
        raise error

    monkeypatch.setattr("ffsi.scene.load_scene", fail)
    found, out, err = call(capsys, "render", "cook")
    assert (found, out) == (code, "") and said in err and "Traceback" not in err and "\x1b" not in err
    faults = list(Path().glob("ffsi-fault-*.txt"))
    assert len(faults) == (code == 70)
    if faults:
        assert "Traceback" in faults[0].read_text() and str(faults[0].name) in err


def test_the_version_is_told(capsys):
    code, out, err = call(capsys, "--version")
    assert (code, err) == (0, "")
    assert out.startswith("ffsi ") and out.count("\n") == 1


@pytest.mark.parametrize(
    "error", [MemoryError(), OSError(errno.ENOSPC, "No space left on device", "r/fields.vtu")], ids=["memory", "disk"]
)
def test_a_machine_that_fails_an_evaluation_or_the_check_is_no_failed_check(capsys, monkeypatch, freefem, check, error):
    def fail(*_, **__):
        raise error

    with monkeypatch.context() as patched:
        patched.setattr("ffsi.result.vtu.write_vtu", fail)
        code, _, err = call(capsys, "run", "flap-svk", *LEVEL[:4], "--out", "a")
    assert code == 4
    assert "not evaluated: VTU: " in err and machine.words(error) in err
    assert Path("a/result.json").is_file()
    monkeypatch.setattr("ffsi.reference.check_run", fail)
    code, _, err = call(capsys, "run", "flap-svk", *LEVEL, "--out", "b")
    assert code == 4 and "the reference check could not be done: " + machine.words(error) in err
    assert Path("b/result.json").is_file()
