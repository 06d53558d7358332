"""What nobody means well with: numbers, texts and files that cost memory or time, or write to the terminal."""

import io
import json
import logging
import os
import time
import unicodedata
from pathlib import Path

import pytest
from run_folders import make_run

from ffsi.cli import show, vary
from ffsi.cli.main import main
from ffsi.files import folder, reading, seals
from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMError
from ffsi.freefem.output import Output
from ffsi.hemodynamics.result import load_result
from ffsi.run.design import columns_of
from ffsi.scene import Scene, SceneError, load_scene
from ffsi.scene.overrides import parse_overrides
from ffsi.text import cut, listed, nearest, printable

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")

EVIL = "a\x1b[31m\x07\x9b2J\u202e\u200b\r\nerror: fake\udcff"


def is_clean(text: str) -> bool:
    return not any(unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp") for c in text.replace("\n", ""))


@pytest.mark.parametrize(("text", "fragment"), [
    ("k=0:1e999999:1", "1e300"), ("k=0:1e99999999:1", "1e300"), ("k=0:1:1e-999999999", "1e-300"),
    ("k=1e-999999999", "1e-300"), ("k=-1e400", "1e300"), ("k=0:1e300:1e-300", "about 1e600 values"),
    ("k=0:1000000:1", "1000001 values"), ("k=" + "1" * 5000, "characters"), ("k=" + "1." + "0" * 5000, "characters"),
    ("k=sNaN", "not finite"), ("k=-inf", "not finite"), ("k=" + ",".join(map(str, range(100_001))), "more than 100000"),
    ("k=" + "x" * 5000, "characters"),
])  # fmt: skip
def test_a_range_is_counted_before_it_is_made(text, fragment):
    begin = time.perf_counter()
    with pytest.raises(InputError, match=fragment) as caught:
        vary.parse_vary(text)
    assert time.perf_counter() - begin < 1 and len(str(caught.value)) < 400


def test_numbers_are_counted_before_they_are_made():
    assert vary.parse_vary("k=0e99999999:1:0.5") == ("k", [0, 0.5, 1.0])
    many = ["inflow.mean_velocity=1:100000:1", "fluid.viscosity=1:100000:1"]
    with pytest.raises(InputError, match="100000 x 100000 = about 1e10 points, more than 100000"):
        columns_of(load_scene("flap-svk"), vary.parse_all(many))


@pytest.mark.parametrize("key", ["mesh.level", "solver.max_iterations", "inflow.mean_velocity", "name", "output.vtu"])
@pytest.mark.parametrize("value", ["1" + "0" * 400, "-1" + "0" * 4000, "1" + "0" * 9000, "1e999", "nan"])
def test_a_number_of_many_digits_is_refused_by_its_key(key, value):
    with pytest.raises(SceneError) as caught:
        load_scene("flap-svk", [f"{key}={value}"])
    assert str(caught.value).startswith(f"{key} = ") and len(str(caught.value)) < 500


# TOML -----------------------------------------------------------------------------------------------------------------

BOMBS = {
    "keys": "\n".join(f"a{i}=1" for i in range(90_000)), "unknown keys": "\n".join(f"a{i}=1" for i in range(2000)),
    "unknown solids": "[solid]\n" + "\n".join(f"a{i}=1" for i in range(2000)),
    "unknown tables": "\n".join(f"[a{i}]\nb=1" for i in range(2000)), "deep arrays": "a=" + "[" * 20_000 + "]" * 20_000,
    "less deep arrays": "a=" + "[" * 200 + "]" * 200, "deep tables": "[" + ".".join(["a"] * 3000) + "]",
    "less deep tables": "[" + ".".join(["a"] * 100) + "]", "a long key": "a" * 900_000 + "=1",
    "a long value": 'name="' + "a" * 900_000 + '"', "digits": "a=1" + "0" * 900_000, "a bad line": "x\x1b[31m = = 1",
}  # fmt: skip


@pytest.mark.parametrize("text", BOMBS.values(), ids=BOMBS.keys())
def test_a_bomb_of_toml_is_refused_quickly_and_briefly(text):
    begin = time.perf_counter()
    with pytest.raises(SceneError) as caught:
        Scene.from_toml(text)
    assert time.perf_counter() - begin < 3
    assert len(str(caught.value)) < 10_000 and is_clean(str(caught.value))


def test_of_many_problems_the_first_are_shown_and_the_rest_counted():
    with pytest.raises(SceneError) as caught:
        Scene.from_toml(BOMBS["unknown keys"])
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert lines[-1] == "scene: and 1982 more problems"  # 2000, and the name and the geometry that are missing


@pytest.mark.parametrize("text", ["a=" + "[" * 3000, "a={b=" * 200, "mesh=" + "[" * 30 + "]" * 30])
def test_a_deep_override_stays_a_text(text):
    assert all(isinstance(value, str) for value in parse_overrides([text]).values())


def errors_with_names() -> dict[str, Exception]:
    found = {}
    calls = {
        "key": lambda: Scene.from_toml(json.dumps(EVIL[:12]) + " = 1\n"),
        "value": lambda: load_scene("flap-svk", [f"solver.linear_solver={EVIL}"]),
        "override": lambda: load_scene("flap-svk", [EVIL]), "case": lambda: load_scene(EVIL),
        "scene": lambda: load_scene(f"{EVIL}.toml"),
        "waveform": lambda: load_scene("turek-fsi3", [f"inflow.waveform_file={EVIL}.csv"]),
        "json": lambda: folder.read_json(Path(EVIL)),
        "folder": lambda: folder.check_usable(Path(f"/proc/version/{EVIL}")),
        "vary": lambda: vary.parse_vary(f"{EVIL}=1"), "vary value": lambda: vary.parse_vary(f"key={EVIL}"),
        "input": lambda: (_ for _ in ()).throw(InputError(f"the file {EVIL}")),
        "freefem": lambda: (_ for _ in ()).throw(FreeFEMError("crash", EVIL, 1, EVIL, Path(EVIL))),
    }  # fmt: skip
    for name, call in calls.items():
        try:
            call()
        except (SceneError, InputError, FreeFEMError, OSError) as error:
            found[name] = error
    return found


def test_names_from_outside_are_cleaned_everywhere(tmp_path, capsys):
    found = errors_with_names()
    for name, error in found.items():
        if not isinstance(error, OSError):  # Python's own; cleaned where it is printed
            assert is_clean(str(error)), name
        assert is_clean(repr(error)), name
        show.error(str(error))
        text = capsys.readouterr().err
        assert is_clean(text), name
        assert not any(line.startswith("error: fake") for line in text.splitlines()), name
    show.LogHandler().emit(logging.LogRecord("ffsi.x", logging.WARNING, "", 0, "%s", (EVIL,), None))
    show.note(EVIL.replace("\n", ""))
    out = make_run(Path("r"), quantities={f"drag{EVIL}[red]": 1.0}, reason=EVIL, status="failed", failure="check")
    show.result(load_result(out))
    found = capsys.readouterr()
    assert is_clean(found.err) and is_clean(found.out)
    assert "[red]" in found.out  # a name, and no colour
    seen = []
    with Output(None, seen.append) as output:
        output.feed(b"@ffsi failed text=\x1b[31mred\x9b\n")
    assert is_clean(seen[0].text)


@pytest.mark.parametrize("arguments", [["run", EVIL], ["run", "cook", f"--{EVIL}"], ["check", EVIL], [EVIL]])
def test_names_from_outside_are_cleaned_by_the_command_line(arguments, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2 and is_clean(capsys.readouterr().err)


def test_long_names_are_cut_and_marks_accepted():
    assert len(cut("a" * 10**6)) == 120 and listed(range(2000)).endswith("39 and 1960 more")
    assert printable("µ ν²") == "µ ν²"
    assert nearest("flap", (f"flap{i}" for i in range(10**6))) is not None and nearest("x" * 10**6, ["x"]) is None
    Path("a.json").write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert reading.read_json(Path("a.json")) == {"a": 1}


def test_what_is_no_ordinary_file_is_refused_before_it_is_read(tmp_path):
    os.mkfifo("pipe")
    Path("folder").mkdir()
    with Path("huge").open("wb") as file:
        file.truncate(10**12)
    Path("bytes").write_bytes(b"\xff\xfe\x00")
    Path("utf16").write_text("name = 'x'", encoding="utf-16")
    for name, fragment in {
        "/dev/zero": "a device", "pipe": "a pipe", "folder": "s a folder", "huge": "too large", "bytes": "UTF-8",
        "utf16": "UTF-8", "nothing": "No such file", "a\0b": "no name of a file", "x" * 5000: "too long",
    }.items():  # fmt: skip
        begin = time.perf_counter()
        for read in (reading.read_text, reading.read_json, folder.read_json):
            with pytest.raises((InputError, OSError), match=fragment):
                read(Path(name))
        with pytest.raises(SceneError):
            load_scene("turek-fsi3", [f"inflow.waveform_file={name}"])
        with pytest.raises(SceneError):
            load_scene(name)
        assert time.perf_counter() - begin < 2, name


@pytest.mark.parametrize(("text", "fragment"), [
    ("", "no valid JSON"), ('{"a": NaN}', "NaN is no number"), ('{"a": -Infinity}', "-Infinity is no number"),
    ('{"a": 1e999}', "too large"), ('{"a": ' + "1" * 25 + "}", "25 digits"), ('{"a": ' + "1" * 10_000 + "}", "digits"),
    ('{"a": 1, "a": 2}', "twice"), ("[" * 100_000, "too deep"), ('{"a":' * 100_000, "too deep"),
    ("[1]", "no JSON object"), ("3", "no JSON object"),
])  # fmt: skip
def test_json_is_strict(text, fragment):
    Path("a.json").write_text(text)
    with pytest.raises(InputError, match=fragment) as caught:
        folder.read_json(Path("a.json"))
    assert "a.json" in str(caught.value)


def test_the_output_of_a_program_that_ends_with_a_broken_line_is_read():
    with Output(None) as output:
        output.feed(io.BytesIO(b"@ffsi end status=converged").read())
        output.finish()
    assert output.end_status == "converged"


# A run folder with values of another type -----------------------------------------------------------------------------

WRONG = [None, [], {}, "x", -1, True, [1], {"a": "b"}, {"a": [1]}, 10**17]


@pytest.mark.parametrize("key", [
    "case", "status", "point", "quantities", "newton", "timings", "parameters", "check", "varied", "failure", "time",
])  # fmt: skip
@pytest.mark.parametrize("name", ["result.json", "point-0001.json"])
def test_a_value_of_another_type_is_no_fault_of_ffsi(capsys, name, key):
    make_run(Path("r"))
    data = json.loads(Path("r", name).read_text())
    for value in WRONG:
        Path("r", name).write_text(json.dumps(data | {key: value}))
        for words in (["check", "r"], ["report", "r", "-o", "r.html"]):
            with pytest.raises(SystemExit) as stopped:
                main(words)
            found = capsys.readouterr()
            assert stopped.value.code in (0, 1, 2, 3), (value, found.err)
            assert "a fault of ffsi" not in found.err and is_clean(found.err)


def test_a_value_of_another_type_is_named_with_its_file():
    path = make_run(Path("r"))
    data = json.loads((path / "result.json").read_text())
    for change, said in {
        "point": ("x", "result.json is damaged: point is 'x', not a whole number"),
        "timings": ({"mesh": "x"}, "timings is {'mesh': 'x'}, not a table of numbers"),
        "quantities": ([1], "quantities is [1], not a table"),
    }.items():
        (path / "result.json").write_text(json.dumps(data | {change: said[0]}))
        with pytest.raises(InputError) as caught:
            load_result(path)
        assert said[1] in str(caught.value)


def test_a_checksum_is_not_asked_of_a_pipe_nor_of_more_bytes_than_there_are(tmp_path):
    os.mkfifo("pipe")
    assert not seals.fits(Path("pipe"), {"bytes": 1, "sha256": ""})
    Path("file").write_text("x")
    assert seals.fits(Path("file"), seals.seal(Path("file")))
    assert not seals.fits(Path("file"), seals.seal(Path("file")) | {"bytes": 10**18, "grows": True})
    assert not seals.fits(Path("file"), seals.seal(Path("file")) | {"bytes": -1})
