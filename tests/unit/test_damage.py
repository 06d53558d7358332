"""Ways to damage a run folder, a sweep and a checkpoint: all are noticed, and a sweep solves again what is damaged."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
from test_cli import call
from test_study import KEY, SCENE
from time_folders import scene_in_time

import ffsi
from ffsi.files import folder, seals
from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMError
from ffsi.hemodynamics.result import load_result, load_results
from ffsi.report import write_report
from ffsi.run import one_scene, sweep

pytestmark = pytest.mark.usefixtures("check")
VALUES = {KEY: [0.01, 0.02, 0.03]}


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[2 * len(data) // 3] ^= 1
    path.write_bytes(data)


def swap(path: Path) -> None:
    """Exchange two rows, of a file without rows two halves."""
    rows = path.read_bytes().splitlines(keepends=True)
    if len(rows) > 3 and path.suffix != ".bin":
        middle = next(i for i in range(len(rows) // 2, 0, -1) if rows[i] != rows[i - 1])
        rows[middle - 1 : middle + 1] = rows[middle], rows[middle - 1]
        path.write_bytes(b"".join(rows))
    else:
        data = path.read_bytes()
        path.write_bytes(data[len(data) // 2 :] + data[: len(data) // 2])


def append(path: Path) -> None:
    """Add the last row once more, to a file without rows eight bytes."""
    data = path.read_bytes()
    path.write_bytes(data + (data.splitlines(keepends=True)[-1] if path.suffix in (".csv", ".edp") else b"\0" * 8))


def digit(path: Path) -> None:
    """Change one digit of the last row, of a file without rows one byte."""
    data = bytearray(path.read_bytes())
    at = next((i for i in range(len(data) - 1, -1, -1) if chr(data[i]).isdigit()), len(data) - 1)
    data[at] = ord("7") if data[at] != ord("7") else ord("8")
    path.write_bytes(data)


WAYS = {"cut": cut, "flip": flip, "swap": swap, "append": append, "digit": digit, "delete": Path.unlink}
STEADY = [
    *("result.json", "scene.toml", "case.edp", "mesh.bin", "newton.csv"), *("point-0001.bin", "point-0001.json"),
]  # fmt: skip
IN_TIME = [
    *("history.csv", "steps.csv", "state-000019.bin", "state-000040.bin", "checkpoint-a.bin"),
    *("checkpoint-b.bin", "manifest.json", "newton.csv", "result.json", "point-0001.json", "stop"),
]
SWEEP = [
    *(f"chain-001/{name}" for name in ("chain.json", "points.txt", "scene.toml", "case.edp", "mesh.bin", "newton.csv")),
    *(f"chain-001/{name}" for name in ("result-0002.json", "point-0002.bin", "point-0002.json", "result-0003.json")),
    *("sweep.csv", "sweep.toml"),
]


@pytest.fixture
def copy_of(tmp_path):
    def copied(whole: Path) -> Path:
        shutil.copytree(whole, tmp_path / "copy")
        return tmp_path / "copy"

    return copied


_made: dict[str, Path] = {}


@pytest.fixture
def made(tmp_path_factory):
    def made(name, make):
        if name not in _made:
            _made[name] = tmp_path_factory.mktemp("whole") / name
            make(_made[name])
        return _made[name]

    return made


def refused_by_check(capsys, directory: Path) -> bool:
    code, _, err = call(capsys, "check", str(directory))
    assert (code in (1, 2)) == ("error" in err)
    return code in (1, 2)


def test_what_is_whole_passes(capsys, tmp_path, freefem, made, copy_of):
    directory = copy_of(made("steady", lambda path: one_scene.solve(SCENE, path)))
    assert load_result(directory).checked and not refused_by_check(capsys, directory)
    swept = made("sweep", lambda path: sweep.sweep(SCENE, VALUES, path))
    assert not refused_by_check(capsys, swept)
    write_report([directory, swept], tmp_path / "report.html")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("fake", "name"), [*(("freefem", n) for n in STEADY), *(("in_time", n) for n in IN_TIME)])
def test_a_damaged_run_is_noticed(capsys, tmp_path, request, made, copy_of, fake, name, way):
    request.getfixturevalue(fake)
    kind, scene = ("steady", SCENE) if fake == "freefem" else ("time", scene_in_time())
    directory = copy_of(made(kind, lambda path: one_scene.solve(scene, path)))
    WAYS[way](directory / name)
    assert refused_by_check(capsys, directory)
    if (directory / folder.RESULT).is_file():
        with pytest.raises(ValueError):
            write_report([directory], tmp_path / "report.html")
    else:  # then it is a run that has not ended
        write_report([directory], tmp_path / "report.html")
        assert "not checked" in (tmp_path / "report.html").read_text()


def died_at_23(path: Path) -> None:
    with pytest.raises(FreeFEMError):
        one_scene.solve(scene_in_time(), path)
    (path / "result.json").unlink()


def go_on(in_time, made, copy_of, damage) -> tuple[Path, Path]:
    """Damage what a run that died after step 23 has left, and resume it; return its folder and that of a whole run."""
    in_time.die = 23
    directory = copy_of(made("died", died_at_23))
    in_time.die = None
    whole = made("time", lambda path: one_scene.solve(scene_in_time(), path))
    damage(directory)
    in_time.first_steps.clear()
    assert ffsi.resume(directory).converged
    return directory, whole


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "name", ["history.csv", "newton.csv", "state-000009.bin", "mesh.bin", "manifest.json", "scene.toml", "case.edp"]
)
def test_a_run_with_damage_before_its_checkpoint_does_not_go_on(in_time, made, copy_of, name, way):
    def damage(directory: Path) -> None:
        path = directory / name
        if path.suffix == ".csv" and way not in ("delete", "cut"):  # in what the checkpoints cover
            head = path.read_text().splitlines(keepends=True)
            path.write_text("".join(head[:8]))
            WAYS[way](path)
            path.write_text(path.read_text() + "".join(head[8:]))
        else:
            WAYS[way](path)

    if name == "manifest.json" and way == "delete":  # then nothing is believed
        directory, whole = go_on(in_time, made, copy_of, damage)
        assert in_time.first_steps == [1]
        assert (directory / "history.csv").read_text() == (whole / "history.csv").read_text()
        return
    with pytest.raises(ValueError):
        go_on(in_time, made, copy_of, damage)
    assert in_time.first_steps in ([], [1, 1])


@pytest.mark.parametrize("way", WAYS)
def test_a_damaged_checkpoint_is_not_taken(in_time, made, copy_of, way, caplog):
    """That of step 20 is checkpoint-b; the run goes on from step 15, and comes to the same."""
    directory, whole = go_on(in_time, made, copy_of, lambda path: WAYS[way](path / "checkpoint-b.bin"))
    assert in_time.first_steps[-1] == 16
    assert "the checkpoint of t = 1 s is missing or was changed; going on from t = 0.75 s" in caplog.text
    for name in ("history.csv", "steps.csv"):
        assert (directory / name).read_text() == (whole / name).read_text()


@pytest.mark.parametrize("way", ["flip", "append", "digit"])
def test_damage_after_a_checkpoint_is_computed_again(in_time, made, copy_of, way, caplog):
    """The last row of steps.csv, of step 20, belongs to the last checkpoint alone."""
    directory, whole = go_on(in_time, made, copy_of, lambda path: WAYS[way](path / "steps.csv"))
    if way != "append":  # what stands behind the rows of the checkpoint is cut off
        assert "steps.csv was changed after it was written; going on from t = 0.75 s" in caplog.text
    assert (directory / "steps.csv").read_text() == (whole / "steps.csv").read_text()


@pytest.mark.parametrize("way", WAYS)
def test_without_a_whole_checkpoint_a_run_does_not_go_on(in_time, made, copy_of, way):
    def damage(directory: Path) -> None:
        for name in folder.CHECKPOINTS:
            WAYS[way](directory / name)

    with pytest.raises(InputError, match="cannot go on: the checkpoint of t = 1 s is missing or was changed"):
        go_on(in_time, made, copy_of, damage)


@pytest.mark.parametrize("name", ["history.csv", "point-0001.json", "point-0001.bin", "newton.csv"])
def test_what_a_script_has_written_to_its_end_is_read_only_if_it_is_whole(in_time, made, copy_of, name, caplog):
    """Python was killed before it wrote the result; the last checkpoint is that of the last step."""
    whole = made("time", lambda path: one_scene.solve(scene_in_time(), path))
    directory = copy_of(whole)
    (directory / "result.json").unlink()
    flip(directory / name)
    in_time.first_steps.clear()
    if name.endswith(".csv"):
        with pytest.raises(InputError, match="was changed after it was written"):
            ffsi.resume(directory)
    else:
        assert ffsi.resume(directory).converged and in_time.first_steps == [41]


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch):
    """Pictures take longer than all the rest, and nothing here looks at them."""
    for drawing in ("painting.paint", "pictures.to_png"):
        monkeypatch.setattr(f"ffsi.result.{drawing}", lambda *arguments, **options: b"")
    for drawing in ("result.pictures.draw", "report.curves.sweep_curves"):
        monkeypatch.setattr(f"ffsi.{drawing}", lambda *arguments, **options: None)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SWEEP)
def test_a_damaged_sweep_is_noticed_and_mended(capsys, tmp_path, freefem, made, copy_of, name, way):
    directory = copy_of(made("sweep", lambda path: sweep.sweep(SCENE, VALUES, path)))
    before = pd.read_csv(directory / "sweep.csv")
    WAYS[way](directory / name)
    assert refused_by_check(capsys, directory)
    if name != "sweep.csv" or way != "delete":
        with pytest.raises((ValueError, OSError)):
            write_report([directory], tmp_path / "report.html")
    freefem.solved.clear()
    if name == "sweep.toml":
        with pytest.raises(InputError):
            sweep.sweep(SCENE, VALUES, directory)
        return
    after, told = sweep.sweep(SCENE, VALUES, directory), ["drag", "status", "checked"]
    assert after[told].to_numpy().tolist() == before[told].to_numpy().tolist()
    mended = [] if name == "sweep.csv" or "result" in name else [0.02] if "0002" in name else [0.01, 0.02, 0.03]
    assert freefem.solved == mended or (name.endswith("newton.csv") and way == "append" and freefem.solved == [0.03])
    assert not refused_by_check(capsys, directory)
    write_report([directory], tmp_path / "report.html")
    freefem.solved.clear()
    sweep.sweep(SCENE, VALUES, directory)
    assert freefem.solved == []


def test_swapped_results_are_noticed(capsys, freefem, made, copy_of):
    directory = copy_of(made("sweep", lambda path: sweep.sweep(SCENE, VALUES, path)))
    one, two = (directory / "chain-001" / f"result-000{i}.json" for i in (1, 2))
    text = one.read_text()
    one.write_text(two.read_text())
    two.write_text(text)
    assert refused_by_check(capsys, directory)
    assert sweep.sweep(SCENE, VALUES, directory)["drag"].tolist() == [0.02, 0.04, 0.06]
    assert not refused_by_check(capsys, directory)


def test_an_altered_result_with_another_checksum_is_noticed_by_its_files(capsys, freefem, made, copy_of):
    directory = copy_of(made("steady", lambda path: one_scene.solve(SCENE, path)))
    data = json.loads((directory / "result.json").read_text())
    data["quantities"]["tip_ux"] = 9.99
    seals.write(directory / "result.json", data)
    code, _, err = call(capsys, "check", str(directory))
    assert (code, "quantities.tip_ux is 9.99, the run's files say" in err) == (1, True)


def test_a_result_of_an_older_version_is_not_called_checked(capsys, freefem, made, copy_of):
    directory = copy_of(made("steady", lambda path: one_scene.solve(SCENE, path)))
    data = json.loads((directory / "result.json").read_text())
    del data["digest"]
    (directory / "result.json").write_text(json.dumps(data))
    assert not load_result(directory).checked
    code, _, err = call(capsys, "check", str(directory))
    assert (code, "carries no checksum" in err) == (1, True)


@pytest.mark.parametrize("name", ["case.edp", "mesh.bin", "result.json", "freefem.log", "history.csv"])
def test_nothing_is_written_through_a_link(tmp_path, freefem, name):
    one_scene.solve(SCENE, tmp_path / "run")
    (tmp_path / "precious.txt").write_text("mine")
    (tmp_path / "run" / name).unlink(missing_ok=True)
    (tmp_path / "run" / name).symlink_to(tmp_path / "precious.txt")
    with pytest.raises(InputError, match=f"{name} is a symbolic link"):
        one_scene.solve(SCENE, tmp_path / "run")
    assert (tmp_path / "precious.txt").read_text() == "mine"


def test_a_chain_elsewhere_is_refused(tmp_path, freefem):
    sweep.sweep(SCENE, VALUES, tmp_path / "sweep")
    (tmp_path / "sweep" / "chain-001").rename(tmp_path / "elsewhere")
    (tmp_path / "sweep" / "chain-001").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="chain-001 is a symbolic link"):
        sweep.sweep(SCENE, VALUES, tmp_path / "sweep")


def test_a_foreign_script_is_not_run(in_time, made, copy_of):
    def damage(directory: Path) -> None:
        (directory / "case.edp").write_text('exec("id");\n')

    with pytest.raises(InputError, match=r"case.edp is not the script of scene.toml.*Nothing was run; to start anew"):
        go_on(in_time, made, copy_of, damage)


def test_a_sweep_in_time_computes_a_chain_with_a_foreign_script_anew(tmp_path, in_time):
    values = {"fluid.viscosity": [1.0]}
    in_time.die = 23
    sweep.sweep(scene_in_time(), values, tmp_path / "s")
    in_time.die = None
    (tmp_path / "s" / "chain-001" / "case.edp").write_text('exec("id");\n')
    assert sweep.sweep(scene_in_time(), values, tmp_path / "s")["status"].tolist() == ["converged"]
    assert in_time.first_steps == [1, 1]
    assert "exec" not in (tmp_path / "s" / "chain-001" / "case.edp").read_text()


def test_a_check_that_fails_on_files_that_nobody_watched_is_solved_again(tmp_path, freefem, check):
    sweep.sweep(SCENE, VALUES, tmp_path / "s")
    (tmp_path / "s" / "chain-001" / "result-0002.json").unlink()
    check.wrong = 0.02  # as of a state that was damaged meanwhile
    freefem.solved.clear()
    table = sweep.sweep(SCENE, VALUES, tmp_path / "s")
    assert freefem.solved == [0.02]
    assert table["failure"].tolist() == ["", "check", ""]  # it still fails: that is how it is
    freefem.solved.clear()
    assert sweep.sweep(SCENE, VALUES, tmp_path / "s")["failure"].tolist() == ["", "check", ""]
    assert freefem.solved == []


def test_results_of_chains_that_follow_each_other_are_one_per_point(tmp_path, freefem):
    freefem.die = 0.03
    sweep.sweep(SCENE, VALUES, tmp_path / "s")
    freefem.die = None
    sweep.sweep(SCENE, VALUES, tmp_path / "s")
    results = load_results(tmp_path / "s")
    assert [result.data["varied"][KEY] for result in results] == [0.01, 0.02, 0.03]
    assert all(result.checked for result in results)
