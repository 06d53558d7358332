"""run_script with shell scripts in the place of FreeFEM."""

import contextlib
import io
import math
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from ffsi.cli.progress import ProgressDisplay
from ffsi.freefem import Completed, Event, FreeFEMError, Installation, child, parse_event, process, run_script, stop_all
from ffsi.freefem.errors import Ending, explain
from ffsi.freefem.process import command_line

END = "echo '@ffsi end status=converged'"


@pytest.fixture
def fake(tmp_path):
    """A function from shell text to an Installation whose binary it is; the script is tmp_path/case.edp."""
    (tmp_path / "case.edp").write_text("int a = 1;\n")

    def make(text: str) -> Installation:
        binary = tmp_path / "FreeFem++-nw"
        binary.write_text(f"#!/bin/bash\n{text}\n")
        binary.chmod(binary.stat().st_mode | stat.S_IXUSR)
        return Installation(binary, "4.9", "/plugins;;", "/idp;;", Path("/plugins"), frozenset({"MUMPS_seq"}))

    return make


def run(fake, tmp_path, text, **options) -> Completed:
    return run_script(tmp_path / "case.edp", installation=fake(text), log=tmp_path / "freefem.log", **options)


def death(fake, tmp_path, text, **options) -> FreeFEMError:
    with pytest.raises(FreeFEMError) as caught:
        run(fake, tmp_path, text, **options)
    return caught.value


def is_alive(pid: int) -> bool:
    """Whether a process runs; a zombie that nobody has reaped yet does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


def wait_until(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


def test_a_complete_run_with_its_command_environment_and_folder(fake, tmp_path):
    events = []
    text = f"""echo '@ffsi start case=x'; echo noise; echo '@ffsi point point=1 points=2 status=converged'
    echo '@ffsi warning text=slow going'; echo '@ffsi point point=2 points=2 status=failed'; {END}"""
    done = run(fake, tmp_path, text, on_event=events.append)
    assert (done.status, done.exit_code, done.reason) == ("converged", 0, "") and done.warnings == ("slow going",)
    assert done.points == {1: "converged", 2: "failed"}
    assert [event.kind for event in events] == ["start", "point", "warning", "point", "end"]
    assert (tmp_path / "freefem.log").read_text().splitlines()[1] == "noise"
    assert done.peak_memory >= 0 and 0 < done.seconds < 5
    (tmp_path / "sub").mkdir()
    text = f'echo "$@"; echo "$FF_LOADPATH $FF_INCLUDEPATH $OPENBLAS_NUM_THREADS $OMP_NUM_THREADS"; pwd; {END}'
    run(fake, tmp_path, text, arguments={"mesh_level": 2, "x": 0.1}, cwd=tmp_path / "sub")
    first, second, third, _ = (tmp_path / "freefem.log").read_text().splitlines()
    assert first == f"-nw -ns -v 0 {tmp_path / 'case.edp'} -mesh_level 2 -x 0.1"
    assert second == "/plugins;; /idp;; 1 1" and third == str(tmp_path / "sub")


def test_paths_below_the_folder_are_handed_over_relative_to_it(fake, tmp_path):
    deep = tmp_path.joinpath(*["e" * 200] * 10)
    deep.mkdir(parents=True)
    (deep / "case.edp").write_text("")
    installation = fake(f'echo "$@"; {END}')
    given = {"out": str(deep), "mesh": deep / "a.mesh", "resume": str(deep / "b.bin"), "x": 0.5, "name": "a/b"}
    run_script(deep / "case.edp", given, installation=installation, cwd=deep, log=deep / "log")
    assert (deep / "log").read_text().splitlines()[0] == (
        "-nw -ns -v 0 case.edp -out . -mesh a.mesh -resume b.bin -x 0.5 -name a/b"
    )
    with pytest.raises(ValueError, match="longer than the 900 bytes"):
        run_script(deep / "case.edp", given, installation=installation, cwd=tmp_path, log=tmp_path / "log")


def test_a_run_is_complete_by_its_marker_and_code(fake, tmp_path):
    text = "echo '@ffsi failed point=3 text=no step left'; echo '@ffsi end status=failed'; exit 3"
    done = run(fake, tmp_path, text)
    assert (done.status, done.exit_code, done.reason) == ("failed", 3, "no step left")
    assert run(fake, tmp_path, f"{END}; exit 3").status == "failed"
    error = death(fake, tmp_path, "echo '@ffsi point point=1 status=converged'")
    assert (error.kind, error.log) == ("crash", tmp_path / "freefem.log") and "without its end marker" in str(error)
    assert death(fake, tmp_path, "printf '@ffsi en'").kind == "crash"
    assert run(fake, tmp_path, "printf '@ffsi end status=converged'").status == "converged"
    error = death(fake, tmp_path, f"{END}; echo '  current line = 1'; echo 'Exec error : exec assert'; exit 8")
    assert error.kind == "assert" and error.source_line == "int a = 1;"
    done = run(fake, tmp_path, f"{END}; kill -SEGV $$")
    assert done.status == "converged" and "signal 11" in done.warnings[0]
    error = death(fake, tmp_path, "echo '@ffsi bad-input text=no parameter speed'; exit 2")
    assert (error.kind, error.message) == ("bad-input", "no parameter speed")


def test_sigkill_while_the_kernel_counted_an_out_of_memory_kill(fake, tmp_path, monkeypatch):
    counts = iter([4, 5, 5, 5])
    monkeypatch.setattr(child, "oom_kills", lambda: next(counts))
    assert death(fake, tmp_path, "kill -KILL $$").kind == "out-of-memory"


def test_time_limit_kills_the_whole_group(fake, tmp_path):
    start = time.monotonic()
    text = f"echo '@ffsi newton point=1 iteration=4'; sleep 60 & echo $! > {tmp_path}/pid; wait"
    error = death(fake, tmp_path, text, time_limit=0.3)
    assert time.monotonic() - start < 3 and error.kind == "time-limit"
    assert "time limit of 0.3 s" in str(error) and "newton point=1 iteration=4" in error.message
    wait_until(lambda: not is_alive(int((tmp_path / "pid").read_text())))


def test_the_time_limit_holds_whatever_a_process_does(fake, tmp_path):
    for text in ("while true; do echo noise; done", f"{END}; exec >&- 2>&-; sleep 60"):
        assert death(fake, tmp_path, text, time_limit=0.3).kind == "time-limit"


def test_processes_that_keep_the_pipe_or_say_much_at_the_end(fake, tmp_path):
    start = time.monotonic()
    text = f"setsid sleep 20 & echo $! > {tmp_path}/pid; {END}"
    assert run(fake, tmp_path, text).status == "converged" and time.monotonic() - start < 5
    os.kill(int((tmp_path / "pid").read_text()), signal.SIGKILL)
    # Much output right before the end: the reader must not stop at the first sight of a dead process.
    done = run(fake, tmp_path, f"for i in $(seq 20000); do echo line $i of many; done; {END}")
    assert done.status == "converged" and len((tmp_path / "freefem.log").read_text().splitlines()) == 20001


@pytest.mark.parametrize("error", [RuntimeError("stop"), KeyboardInterrupt()])
def test_an_exception_of_the_callback_kills_the_process(fake, tmp_path, error):
    def callback(event):
        raise error

    with pytest.raises(type(error)):
        run(fake, tmp_path, f"echo $$ > {tmp_path}/pid; echo '@ffsi start case=x'; sleep 60", on_event=callback)
    assert not is_alive(int((tmp_path / "pid").read_text()))


PROGRAM = """
import sys
from pathlib import Path
from ffsi.freefem import Installation, run_script
folder = Path(sys.argv[1])
run_script(folder / "case.edp", installation=Installation(
    folder / "FreeFem++-nw", "4.9", ";;", ";;", folder, frozenset()))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_the_process_dies_with_python(fake, tmp_path, number):
    if number == signal.SIGKILL and shutil.which("setpriv") is None:
        pytest.skip("no setpriv here")
    fake(f"echo $$ > {tmp_path}/new; mv {tmp_path}/new {tmp_path}/pid; exec sleep 60")
    root = str(Path(process.__file__).parents[2])
    python = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, tmp_path], env={**os.environ, "PYTHONPATH": root}, stderr=subprocess.DEVNULL
    )
    wait_until((tmp_path / "pid").exists)
    pid = int((tmp_path / "pid").read_text())
    assert is_alive(pid)
    python.send_signal(number)
    code = python.wait(10)
    wait_until(lambda: not is_alive(pid))
    assert code == (128 + number if number == signal.SIGTERM else -number)


def test_sigterm_is_ours_only_during_the_run(fake, tmp_path):
    seen, before = [], signal.getsignal(signal.SIGTERM)
    run(fake, tmp_path, f"echo '@ffsi start'; {END}", on_event=lambda e: seen.append(signal.getsignal(signal.SIGTERM)))
    assert callable(seen[0]) and signal.getsignal(signal.SIGTERM) is before


def test_stop_all_from_another_thread(fake, tmp_path, monkeypatch):
    monkeypatch.setattr(child, "oom_kills", lambda: 0)
    errors = []

    def work():
        try:
            run(fake, tmp_path, "echo '@ffsi start case=x'; exec sleep 60", on_event=lambda event: started.set())
        except FreeFEMError as error:
            errors.append(error.kind)

    started, thread = threading.Event(), threading.Thread(target=work)
    thread.start()
    assert started.wait(5) and stop_all() == 1
    thread.join(5)
    assert errors == ["killed"] and stop_all() == 0


def test_a_log_on_a_full_disk(fake, tmp_path):
    with pytest.raises(FreeFEMError, match="No space left") as caught:
        run_script(
            tmp_path / "case.edp", installation=fake(f"echo $$ > {tmp_path}/pid; {END}; sleep 60"), log="/dev/full"
        )
    assert caught.value.kind == "disk-full" and not is_alive(int((tmp_path / "pid").read_text()))


@pytest.mark.parametrize("ending", [END, "exit 8"])
def test_a_full_run_folder(fake, tmp_path, monkeypatch, ending):
    full, real = SimpleNamespace(f_blocks=1000, f_bfree=3, f_bavail=3, f_frsize=4096), os.statvfs
    monkeypatch.setattr(process.os, "statvfs", lambda path: full if Path(path).name == "out" else real(path))
    (tmp_path / "out").mkdir()
    error = death(fake, tmp_path, ending, arguments={"out": str(tmp_path / "out")})
    assert error.kind == "disk-full" and "full" in str(error)


@pytest.mark.parametrize(("ending", "kind", "fragment"), [
    *((f"kill -{name} $$; sleep 5", kind, f"SIG{name}") for name, kind in {
        "KILL": "killed", "TERM": "killed", "SEGV": "crash", "FPE": "floating-point",
    }.items()),
    ("ulimit -S -t 1; while :; do :; done", "time-limit", "used up its processor time"),
    ("ulimit -f 1; exec head -c 100000 /dev/zero > big", "disk-full", "ulimit -f"),
    ("kill -KILL $$", "killed", "signal 9"),
    ("echo std::bad_alloc; exit 134", "out-of-memory", "bad_alloc"),
])  # fmt: skip
def test_signals_and_limits_of_the_shell_are_named(fake, tmp_path, monkeypatch, ending, kind, fragment):
    monkeypatch.setattr(child, "oom_kills", lambda: 0)
    error = death(fake, tmp_path, ending, cwd=tmp_path)
    assert error.kind == kind and fragment in str(error)


def test_limits_that_python_itself_has_are_named(tmp_path):
    """A hard limit of processor time is a SIGKILL, one of the memory any kind of crash."""
    ending = Ending(-signal.SIGKILL, limits={"cpu": "5 s (ulimit -t)"})
    assert explain(ending, tmp_path / "case.edp").kind == "time-limit"
    ending = Ending(-signal.SIGSEGV, limits={"memory": "0.50 GiB (ulimit -v)"})
    assert "its memory is limited to 0.50 GiB (ulimit -v)" in str(explain(ending, tmp_path / "case.edp"))


@pytest.mark.parametrize("setpriv", [True, False])
def test_a_binary_that_is_gone(fake, tmp_path, monkeypatch, setpriv):
    if not setpriv:
        monkeypatch.setattr(child, "_die_with_parent", list)
    installation = fake(END)
    installation.binary.unlink()
    with pytest.raises(FreeFEMError) as caught:
        run_script(tmp_path / "case.edp", installation=installation)
    assert caught.value.kind == "missing-binary"


def test_umfpacks_complaint_becomes_a_warning_and_broken_progress_lines_are_skipped(fake, tmp_path, caplog):
    done = run(fake, tmp_path, f"echo ' Error umpfack umfpack_di_numeric  status  1'; {END}")
    assert done.warnings == ("UMFPACK: Error umpfack umfpack_di_numeric  status  1",)

    assert run(fake, tmp_path, f"echo '@ffsi point 3'; {END}").status == "converged"
    assert "not key=value" in caplog.text


def test_scripts_that_are_absent_and_logs_in_new_folders(fake, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.edp"):
        run_script(tmp_path / "nothing.edp", installation=fake(END))
    run_script(tmp_path / "case.edp", installation=fake(END), log=tmp_path / "a/b/log")
    assert (tmp_path / "a/b/log").exists()


def test_arguments_keep_every_digit():
    values = {"level": 2, "viscosity": 1e-3 / 3, "time_step": 1e-20, "out": Path("/x y"), "name": "flap", "flag": True}
    assert command_line(values) == [
        "-level", "2", "-viscosity", "0.0003333333333333333", "-time_step", "1e-20", "-out", "/x y", "-name", "flap",
        "-flag", "1",
    ]  # fmt: skip
    numpy = pytest.importorskip("numpy")
    assert command_line({"x": numpy.float64(0.1), "n": numpy.int64(3)}) == ["-x", "0.1", "-n", "3"]


@pytest.mark.parametrize(
    "arguments", [{"x": float("nan")}, {"x": float("inf")}, {"": 1}, {"-x": 1}, {"a b": 1}, {"x": ""}]
)
def test_arguments_that_cannot_be_passed_on(arguments):
    with pytest.raises(ValueError, match=r"finite|no name|empty"):
        command_line(arguments)


def test_lines_have_typed_fields_and_a_text():
    event = parse_event(
        "@ffsi newton point=1 points=10 residual=1.2e-5 correction=3e-4 step=1 stage=.5 case=turek-fsi1\n"
    )
    assert event is not None and event.kind == "newton"
    assert event.fields == {
        "point": 1, "points": 10, "residual": 1.2e-5, "correction": 3e-4, "step": 1, "stage": 0.5, "case": "turek-fsi1",
    }  # fmt: skip
    assert isinstance(event.fields["point"], int) and isinstance(event.fields["residual"], float) and event.text == ""
    event = parse_event("@ffsi failed point=7 text=J = 0.1 at x=3, text=again")
    assert event == Event("failed", {"point": 7}, "J = 0.1 at x=3, text=again")
    assert parse_event("@ffsi warning text=") == Event("warning", {}, "")


@pytest.mark.parametrize("value", ["nan", "-nan", "inf", "-inf"])
def test_values_that_are_not_finite_are_numbers(value):
    event = parse_event(f"@ffsi newton residual={value}")
    assert event is not None and not math.isfinite(event.number("residual"))


@pytest.mark.parametrize("word", ["12abc", "1e", "1_000", "infinite", "3.1.1", "0x10"])
def test_what_only_starts_like_a_number_stays_text(word):
    event = parse_event(f"@ffsi start case={word}")
    assert event is not None and event.fields["case"] == word


@pytest.mark.parametrize(
    "line", ["", "init MUMPS_SEQ: MPI_Init", "@ffsinewton point=1", "see @ffsi end status=converged"]
)
def test_other_lines_are_no_events(line):
    assert parse_event(line) is None


@pytest.mark.parametrize("line", ["@ffsi", "@ffsi status=converged", "@ffsi point 7", "@ffsi point =7"])
def test_a_marked_line_that_breaks_the_format_raises(line):
    with pytest.raises(ValueError, match="progress line"):
        parse_event(line)


def test_accessors_fall_back_when_the_type_is_wrong():
    event = Event("newton", {"point": "x", "residual": 2})
    assert event.integer("point", 5) == 5 and event.number("residual") == 2.0 and math.isnan(event.number("case"))
    assert event.word("residual") == "2"


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def terminal(is_terminal=True):
    stream = io.StringIO()
    return stream, Console(file=stream, force_terminal=is_terminal, width=200)


def feed(display, *lines):
    for line in lines:
        display(parse_event("@ffsi " + line))


def test_sweeps_single_runs_and_chains_show_their_own():
    clock = Clock()
    stream, console = terminal()
    with ProgressDisplay(console=console, clock=clock) as show:
        feed(show, "start case=flap-svk", "newton point=1 points=4 iteration=2 residual=1.25e-5 load=1 stages=1")
        assert show.seconds_left is None
        clock.now = 90.0
        feed(show, "point point=1 points=4 status=converged")
        assert show.seconds_left == 270.0
        feed(show, "newton point=2 points=4 iteration=3 residual=2e-7 stage=2 stages=2 load=0.5")
        assert show.state == "1/4 done · point 2/4 · mesh 2/2 · load 0.5 · Newton 3 · residual 2.0e-07"
    text = stream.getvalue()
    assert "flap-svk" in text and "residual 2.0e-07" in text and "about 4:30 left" in text
    _, console = terminal()
    with ProgressDisplay(console=console) as show:
        feed(show, "mesh stage=1 stages=2 level=1 triangles=10 unknowns=50")
        assert show.state == "mesh 1/2, 50 unknowns"
        feed(show, "newton point=1 points=1 iteration=5 residual=nan")
        assert show.state == "Newton 5 · residual nan"
        feed(show, "point point=1 points=1 status=converged")
        assert show.seconds_left is None
    clock = Clock()
    with ProgressDisplay("sweep", points=8, console=console, clock=clock) as show:
        clock.now = 10.0
        feed(show, "point point=1 points=4 status=converged", "point point=1 points=4 status=failed")
        assert show.finished == 2 and show.seconds_left == 30.0 and show.state.startswith("2/8 done")


def test_progress_in_time_and_of_its_sweeps():
    clock, (stream, console) = Clock(), terminal()
    with ProgressDisplay(console=console, clock=clock) as show:
        feed(show, "start case=turek-fsi3", "mesh stage=1 stages=1 unknowns=6995", "time step=10 time=1 end=6 dt=0.1")
        assert show.seconds_left is None
        clock.now = 60.0
        feed(show, "time step=20 time=2 end=6 dt=0.1 iterations=3")
        feed(show, "signal name=tip_uy unit=m mean=0.00123456 amplitude=0.035 frequency=5.461234")
        assert show.state == "t = 2 of 6 s · step 20 · tip_uy 0.001235 ± 0.035 m, 5.461 Hz"
        assert show.seconds_left == pytest.approx(240.0)
    assert "about 4:00 left" in stream.getvalue()
    with ProgressDisplay(points=3, console=console) as show:
        feed(show, "time step=20 time=2 end=6 dt=0.1", "signal name=lift unit=N/m mean=1 amplitude=2 frequency=3")
        assert show.state == "0/3 done · t = 2 of 6 s · step 20"


def test_nothing_at_all_when_it_is_no_terminal(capsys):
    stream, console = terminal(is_terminal=False)
    with ProgressDisplay("case", console=console) as show:
        feed(show, "newton point=1 points=4 iteration=2 residual=1.25e-5", "point point=1 points=4 status=converged")
    assert stream.getvalue() == ""
    with ProgressDisplay("case") as show:  # pytest's stderr is no terminal
        feed(show, "newton point=1 points=4 iteration=2 residual=1.25e-5")
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err == ""
    _, console = terminal()
    with ProgressDisplay("case", console=console) as show:
        feed(show, "point point=1 points=4 status=converged")
        print("result")
    assert capsys.readouterr().out == "result\n"
