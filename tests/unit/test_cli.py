"""The command line: what it refuses, its exit codes, and what goes to which stream."""

import json
import re
from pathlib import Path

import pytest
from rich.console import Console
from run_folders import make_run

from ffsi.cli import show
from ffsi.cli.main import main
from ffsi.cli.plain import Table, Words
from ffsi.scene import CASES
from studies.__main__ import main as studies

LEVEL = ["--set", "mesh.level=0"]
SWEEP = ["sweep", "flap-svk", "--out", "s"]

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")

STUDIES = ("verify", "bench", "paper")


def call(capsys, *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout, and stderr without the boxes and line breaks of the usage errors."""
    with pytest.raises(SystemExit) as stopped:
        (studies if arguments[0] in STUDIES else main)(list(arguments))
    out, err = capsys.readouterr()
    return int(stopped.value.code or 0), out, re.sub(r"[\s│╭╮╰╯─]+", " ", err)


BAD_INPUT = [
    (["rum"], "No such command 'rum'. Did you mean 'run'?"), (["run"], "Missing argument"),
    (["run", "flap-svq"], 'did you mean "flap-svk"?'), (["run", "scene.toml"], "no such file"),
    (["run", "."], "this is a folder"), (["run", "flap-svk", "--otu", "x"], "No such option: --otu"),
    (["run", "flap-svk", "again"], "unexpected extra argument"),
    (["run", "flap-svk", "--set", "mesh.level"], "key=value"),
    (["run", "flap-svk", "--set", "mesh.level=9"], "mesh.level = 9"),
    (["run", "flap-svk", "--adapt", "drag,lifft", "--tolerance", "0.1%"], 'did you mean "lift"?'),
    (["run", "flap-svk", "--adapt", "drag", "--tolerance", "0"], "tolerance = '0': accepted"),
    (["run", "flap-svk", "--levels", "0,1"], "at least three levels"),
    (["run", "flap-svk", "--levels", "0,1,x"], "accepted: whole numbers"),
    (["run", "flap-svk", "--levels", "0,1,9"], "mesh.level = 9"),
    (["run", "flap-svk", "--levels", "0,1,2", "--error"], "not both"),
    (["render", "flap-svq"], 'did you mean "flap-svk"?'),
    (["render", "flap-svk", "-o", "no/such/folder.edp"], "no/such does not exist"),
    (["render", "flap-svk", "-o", "."], "is a folder"),
    (["sweep", "flap-svk", "--vary", "mesh.level=0,1"], "Missing option '--out'"),
    (["sweep", "flap-svk", "--out", "s"], "--vary or --points is missing"),
    ([*SWEEP, "--vary", "inflow.mean_velocity"], "KEY=START:STOP:STEP"),
    ([*SWEEP, "--vary", "inflow.mean_velocity=0.1,slow"], 'inflow.mean_velocity = "slow"'),
    ([*SWEEP, "--vary", "inflow.mean_velocity=1 cm"], "wrong dimension"),
    ([*SWEEP, "--vary", "mesh.level=0", "--design", "zipp"], 'did you mean "zip"?'),
    ([*SWEEP, "--vary", "inflow.mean_velocity=0.1:0.2", "--samples", "3"], "samples and seed belong to"),
    ([*SWEEP, "--points", "nothing.csv"], "nothing.csv"),
    ([*SWEEP, "--points", "p.csv", "--vary", "mesh.level=0"], "not both"),
    ([*SWEEP, "--vary", "inflow.mean_velocitty=0.1"], 'did you mean "inflow.mean_velocity"?'),
    ([*SWEEP, "--vary", "mesh.level=0:7:1"], "mesh.level = 7"), ([*SWEEP, "--vary", "mesh.level=0.5"], "level = 0.5"),
    ([*SWEEP, "--vary", "mesh.level=0", "--vary", "mesh.level=1"], "given twice"),
    ([*SWEEP, "--vary", "mesh.level=0", "--jobs", "0"], "jobs"),
    ([*SWEEP, "--vary", "mesh.level=0", "--jobs", "2", "--dask", "tcp://x"], "not both"),
    (["check"], "Missing argument"), (["check", "nothing"], "nothing is no run folder of ffsi (it does not exist)"),
    (["check", "."], "is no run folder"), (["report"], "Missing argument"), (["report", "nothing"], "is no run folder"),
    (["report", ".", "-o", "no/report.html"], "no does not exist"),
    (["paper", "--aneurysm", "--jobs", "2"], "python -m studies paper --aneurysm has no option --jobs"),
    (["paper", "--jobs", "0"], "jobs"), (["doctor", "now"], "unexpected extra argument"),
    (["cases", "--jsn"], "No such option: --jsn"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), BAD_INPUT, ids=[" ".join(words) for words, _ in BAD_INPUT])
def test_bad_input_ends_with_2_names_the_reason_and_writes_nothing(capsys, tmp_path, freefem, arguments, message):
    code, out, err = call(capsys, *arguments)
    assert message in err and (code, out) == (2, "")
    assert list(tmp_path.iterdir()) == [] and freefem.solved == []


@pytest.mark.parametrize(("words", "said"), [
    (["run", "flap-svk"], "is not empty and is no run folder of ffsi"),
    (["sweep", "flap-svk", "--vary", "mesh.level=0"], "is not empty and holds no sweep"),
])  # fmt: skip
def test_a_foreign_folder_is_refused(capsys, tmp_path, freefem, words, said):
    Path("notes.txt").write_text("mine")
    code, out, err = call(capsys, *words, "--out", str(tmp_path))
    assert said in err and code == 2 and (out == "" or words[0] == "sweep")
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_run_prints_quantities_check_and_files(capsys, freefem, check):
    code, out, err = call(capsys, "run", "flap-svk", *LEVEL)
    assert code == 0
    assert re.search(r"drag +0\.24 +N/m", out) and "Newton: 4 iterations, 2 factorisations" in out
    assert "check: passed, the largest is momentum with 1.0e-11" in out and "files: runs/flap-svk" in out
    assert Path("runs/flap-svk/result.json").is_file() and err == ""


def test_json_is_alone_on_stdout(capsys, freefem, check):
    code, out, err = call(capsys, "run", "flap-svk", *LEVEL, "--json", "--out", "there")
    assert (code, err) == (0, "") and json.loads(out) == json.loads(Path("there/result.json").read_text())


def test_runs_and_sweeps_that_nobody_checked_say_so(capsys, freefem, check):
    code, out, _ = call(capsys, "run", "flap-svk", *LEVEL, "--no-check")
    assert (code, "converged, not checked" in out, "check: not done" in out) == (0, True, True)
    _, out, _ = call(capsys, *SWEEP, *LEVEL, "--vary", "inflow.mean_velocity=0.01,0.02", "--no-check")
    assert "0 of 2 points solved and checked; 2 solved, not checked" in out
    code, out, _ = call(capsys, "run", "flap-svk", *LEVEL, "--no-check")
    assert (code, check.calls) == (0, []) and "check: not done" in out


@pytest.mark.parametrize(("ending", "code", "failure", "reason"), [
    ("wrong", 1, "check", "the reference check disagrees"), ("fail", 3, "not-converged", "J too small"),
    ("die", 4, "crash", "SIGSEGV"),
])  # fmt: skip
def test_failures_have_their_own_exit_code_and_still_print_json(capsys, freefem, check, ending, code, failure, reason):
    setattr(check if ending == "wrong" else freefem, ending, 0.12)
    found, out, err = call(capsys, "run", "flap-svk", *LEVEL, "--json")
    assert found == code
    data = json.loads(out)
    assert data["status"] == "failed" and reason in data["reason"]
    assert reason in err and json.loads(Path("runs/flap-svk/result.json").read_text())["failure"] == failure


def test_an_earlier_result_is_not_taken_for_that_of_a_run_that_never_started(capsys, request, freefem, check):
    assert call(capsys, "run", "flap-svk", *LEVEL)[0] == 0
    request.getfixturevalue("no_freefem")
    code, out, err = call(capsys, "run", "flap-svk", *LEVEL, "--json")
    assert code == 4 and json.loads(out)["status"] == "failed"
    assert "no FreeFem++ on this machine" in err
    assert json.loads(Path("runs/flap-svk/result.json").read_text())["status"] == "converged"


def test_sweep_prints_its_table_and_the_worst_exit_code(capsys, freefem, check):
    words = ["sweep", "flap-svk", *LEVEL, "--vary", "inflow.mean_velocity=0.01:0.03:0.01", "--out", "s"]
    check.wrong = 0.02
    code, out, err = call(capsys, *words)
    assert code == 1
    assert re.search(r"0\.01 +converged +0\.02 ", out) and re.search(r"0\.02 +failed", out)
    assert "1 of 3 points: check; see the column reason of s/sweep.csv" in err
    freefem.fail = 0.02
    code, out, err = call(capsys, *words[:-1], "t", "--json")
    assert code == 3 and [line["failure"] for line in json.loads(out)] == ["", "not-converged", ""]


def test_check_reads_what_is_there(capsys, check):
    make_run(Path("r"))
    code, out, _ = call(capsys, "check", "r")
    assert code == 0 and re.search(r"momentum +1\.0e-11", out)
    check.wrong = 0.12
    code, out, err = call(capsys, "check", "r", "--json")
    assert code == 1
    assert json.loads(out)["passed"] is False and json.loads(out)["points"][0]["momentum"] == 1e-3
    assert "r, point 1: momentum: the relative residual" in err


def test_a_table_says_the_same_in_a_file_as_on_a_terminal(capsys):
    table = Table()
    table.add_column("quantity [1]")
    table.add_column("value", right=True)
    table.add_row(Words("drag [bold]", "red"), "14.3")
    Console(width=80).print(table)
    assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == str(table).splitlines()


def test_reports_cases_and_folders_that_are_not_there(capsys):
    make_run(Path("flap-run"))
    code, _, err = call(capsys, "check", "flap-rum")
    assert (code, 'did you mean "flap-run"?' in err) == (2, True)
    assert 'did you mean "flap-run"?' in call(capsys, "run", "--resume", "flap-rn")[2]
    code, out, _ = call(capsys, "cases")
    assert code == 0 and re.search(r"turek-fsi1 +fsi +Turek-Hron FSI1", out)
    _, out, _ = call(capsys, "cases", "--json")
    assert {"name", "physics", "description"} == set(json.loads(out)[0])


def test_what_was_not_solved_is_said_and_reports_written(capsys):
    make_run(Path("r"), status="failed", failure="not-converged", reason="J too small")
    code, _, err = call(capsys, "check", "r")
    assert code == 3 and "no converged point" in err
    make_run(Path("s"))
    code, out, err = call(capsys, "report", "s", "-o", "r.html")
    assert (code, out) == (0, "") and "wrote r.html" in err
    assert "data:image/png" in Path("r.html").read_text()


@pytest.mark.parametrize(("failures", "code"), [([], 0), (["check"], 1), (["not-converged"], 3), (["crash"], 4)])
def test_paper_passes_its_options_on_and_ends_with_the_worst_failure(capsys, monkeypatch, failures, code):
    seen = []

    monkeypatch.setattr("studies.paper.flap.main", lambda **options: seen.append(options) or failures)
    words = ["--jobs", "2", "--out", "there", "--runs", "sweeps"]
    assert call(capsys, "paper", *words)[0] == code and call(capsys, "paper")[0] == code
    options = {"jobs": 2, "out": Path("there"), "runs": Path("sweeps")}
    default = {"out": Path("results/paper"), "runs": Path("runs/paper")}
    assert seen == [options, default]


THERE, ALWAYS = Path("there"), {"out": Path("results/paper"), "runs": Path("runs/paper")}


@pytest.mark.parametrize(("words", "does", "options"), [
    ("verify --unsteady --jobs 2", "verification.in_time.main", {"jobs": 2}),
    ("verify --long --runs there", "verification.in_time.main_long", {"runs": THERE}),
    ("verify --blood --jobs 2 --runs there", "verification.blood.main", {"jobs": 2, "runs": THERE}),
    ("verify --hard --only h-* --out there", "verification.hard.main", {"only": "h-*", "out": THERE}),
    ("verify --acid", "verification.acid.main", {}), ("bench --mesh-motion", "bench.mesh_motion.main", {}),
    ("bench --repeat 2", "bench.steady.main_levels", {"repeat": 2}),
    ("bench --scenes --repeat 3", "bench.steady.main_scenes", {"repeat": 3}),
    ("bench --unsteady --repeat 3", "bench.unsteady.main", {"repeat": 3}),
    ("paper --aneurysm", "paper.aneurysm.main", ALWAYS),
])  # fmt: skip
def test_a_study_is_chosen_by_its_option(capsys, monkeypatch, words, does, options):
    seen = []
    monkeypatch.setattr(f"studies.{does}", lambda **given: seen.append(given) or ["not-converged"])
    assert call(capsys, *words.split())[0] == 3 and seen == [options]


@pytest.mark.parametrize(("words", "message"), [
    ("verify --unsteady --long", "give either --unsteady or --long, not both"),
    ("verify --unsteady --only x", "python -m studies verify --unsteady has no option --only"),
    ("verify --jobs 2", "python -m studies verify has no option --jobs"),
    ("verify --long --only h-*", "python -m studies verify --long has no option --only"),
    ("verify --hard --readme README.md", "python -m studies verify --hard has no option --readme"),
    ("bench --scenes --mesh-motion", "either --scenes or --mesh-motion"),
    ("bench --scenes --runs there", "python -m studies bench --scenes has no option --runs"),
    ("bench --mesh-motion --repeat 2", "python -m studies bench --mesh-motion has no option --repeat"),
    ("bench --repeat 0", "greater than or equal to 1"),
])  # fmt: skip
def test_options_of_another_study_are_refused(capsys, words, message):
    code, _, err = call(capsys, *words.split())
    assert code == 2 and message in err


@pytest.mark.parametrize(("healthy", "code"), [(True, 0), (False, 4)])
def test_doctor_tells_by_its_exit_code(capsys, monkeypatch, healthy, code):
    monkeypatch.setattr(show, "doctor", lambda: healthy)
    assert call(capsys, "doctor")[0] == code


def test_a_case_with_published_values_shows_them_unless_its_physics_is_changed(capsys, freefem, check):
    _, out, _ = call(capsys, "run", "turek-fsi1", *LEVEL)
    assert re.search(r"drag +0\.4 +N/m +14\.29426 +-97\.202 %", out)
    _, out, _ = call(capsys, "run", "turek-fsi1", *LEVEL, "--set", "inflow.mean_velocity=0.3")
    assert "14.29426" not in out and re.search(r"drag +0\.6 +N/m", out)


def test_an_incompressible_material_is_shown_without_infinite_constants():
    line = show.material_line("dome", CASES["aneurysm"].solid["dome"])
    assert line.startswith("dome: neo-hookean, E 1e+05 Pa, ν 0.5, μ ") and "inf" not in line
