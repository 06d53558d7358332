"""What a person meets in Python: names, help, how a scene shows itself, and messages for wrong types."""

import pydoc
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ffsi
from ffsi.files import folder
from ffsi.scene import CASES

NOT_STARTED = "FreeFEM was looked for before the arguments were checked"


@pytest.fixture(autouse=True)
def no_freefem(monkeypatch):
    def find():
        raise AssertionError(NOT_STARTED)

    for home in (sys.modules[ffsi.solve.__module__], sys.modules[ffsi.sweep.__module__]):
        monkeypatch.setattr(home, "find_freefem", find)


def test_every_public_name_is_listed_has_help_and_types():
    code = "import sys, ffsi; print(*dir(ffsi)); print('pandas' in sys.modules, 'scipy' in sys.modules)"
    names, loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.splitlines()
    assert set(ffsi.__all__) <= set(names.split())
    assert not [name for name in names.split() if name not in ffsi.__all__ and not name.startswith("__")]
    assert loaded == "False False"
    text = pydoc.render_doc(ffsi, renderer=pydoc.plaintext)
    for name in ffsi.__all__:
        assert re.search(rf"^    (class |    |  )?{name}\b", text, re.MULTILINE), name
    assert 'ffsi.solve("turek-fsi1")' in text and (Path(ffsi.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize("case", CASES)
def test_a_scene_shows_every_table_and_unit(case):
    scene = CASES[case]
    text, page = repr(scene), scene._repr_html_()
    assert text == str(scene) and text.startswith(f"Scene {case}: ") and max(map(len, text.splitlines())) < 250
    for name, value in scene.given().items():
        if name not in ("name", "description") and value != {}:
            assert f"\n  {name}" in text and f">{name}" in page
    if scene.fluid:
        assert f"density {scene.fluid.density:g} kg/m^3" in text


def test_a_scene_with_markup_in_its_description_is_shown_as_it_is():
    scene = CASES["cook"].model_copy(update={"description": "<b>&"})
    assert "<b>&" in repr(scene) and "&lt;b&gt;&amp;" in scene._repr_html_()


SCENE = CASES["turek-fsi1"]
VARY = {"fluid.density": [900.0, 1000.0]}


@pytest.mark.parametrize(("call", "message"), [
    (lambda out: ffsi.load_scene(5), "scene = 5 (int): accepted: the name of a case or of a TOML file"),
    (lambda out: ffsi.load_scene(None), "scene = NoneType: accepted"),
    (lambda out: ffsi.load_scene(SCENE), "this is a scene already, ffsi.with_values changes it"),
    (lambda out: ffsi.load_scene("cook", "mesh.level=1"), 'accepted: a list of texts such as ["mesh.level=1"]'),
    (lambda out: ffsi.load_scene("cook", {"mesh.level": 1}), 'ffsi.with_values takes {"mesh.level": 1}'),
    (lambda out: ffsi.load_scene("cook", [5]), "override = 5: accepted: key=value"),
    (lambda out: ffsi.with_values("cook", {}), 'scene = "cook" (str): accepted: a scene'),
    (lambda out: ffsi.with_values(SCENE, ["mesh.level=1"]), "values = list: accepted: a table of keys"),
    (lambda out: ffsi.with_values(SCENE, {5: 1}), "values = dict: accepted"),
    (lambda out: ffsi.solve("turek-fsi9", out), 'no such case and no such file; cases: "'),
    (lambda out: ffsi.solve("turek-fsi9", out), 'did you mean "turek-fsi'),
    (lambda out: ffsi.solve(5, out), "scene = 5 (int)"),
    (lambda out: ffsi.solve({"name": "x"}, out), "scene = dict"),
    (lambda out: ffsi.solve(SCENE, 5), "out = 5: accepted: a path"),
    (lambda out: ffsi.solve(SCENE, out, animate="speed"), "accepted: velocity, pressure, displacement"),
    (lambda out: ffsi.solve(SCENE, out, on_event=5), "on_event = 5: accepted: a function"),
    (lambda out: ffsi.sweep("turek-fsi9", VARY, out), 'did you mean "turek-fsi'),
    (lambda out: ffsi.sweep(SCENE, ["fluid.density"], out), "vary: accepted: keys and their values"),
    (lambda out: ffsi.sweep(SCENE, {"fluid.density": 5}, out), "vary fluid.density = 5: accepted: a list of num"),
    (lambda out: ffsi.sweep(SCENE, {"fluid.density": "1 g/cm^3"}, out), "= '1 g/cm^3': accepted: a list of num"),
    (lambda out: ffsi.sweep(SCENE, {"fluid.density": [None]}, out), "vary fluid.density: a value is missing"),
    (lambda out: ffsi.sweep(SCENE, {"fluid.density": [{}]}, out), "accepted: a number, a text or a truth value"),
    (lambda out: setattr(SCENE.fluid, "density", 3.0), "a scene does not change: ffsi.with_values"),
    (lambda out: ffsi.sweep(SCENE, VARY, out, jobs="2"), "jobs = '2': accepted"),
    (lambda out: ffsi.sweep(SCENE, VARY, 5), "out = 5: accepted: a path"),
    (lambda out: ffsi.load_result(5), "directory = 5: accepted: a path"),
    (lambda out: ffsi.load_result(out, "1"), "point = '1': accepted"),
    (lambda out: ffsi.resume(None), "directory = None: accepted: a path"),
    (lambda out: folder.held(Path("/proc/x/y")).__enter__(), "/proc/x/y cannot be made: No such file"),
    (lambda out: ffsi.sensitivities(SCENE, of=None), "of = None: accepted: a name, or a list of names"),
    (lambda out: ffsi.levels(SCENE, (i for i in range(2)), out), "levels = 0,1: accepted: at least three levels"),
    (lambda out: ffsi.levels(SCENE, None, out), "levels = None: accepted"),
    (lambda out: ffsi.with_values(SCENE, {"mesh.level": (i for i in ())}), "accepted: numbers, texts, truth values"),
])  # fmt: skip
def test_a_wrong_type_is_refused_in_words_and_nothing_is_written(call, message, tmp_path):
    with pytest.raises((ffsi.SceneError, ffsi.InputError)) as refused:
        call(tmp_path / "out")
    assert message in str(refused.value) and not list(tmp_path.iterdir())


def test_the_list_of_cases_loads_no_model_and_nothing_that_only_results_need():
    """Names, not seconds: these take more than a second together."""
    code = "import atexit, sys; from ffsi.cli.main import main; atexit.register(lambda: print(*sys.modules)); main()"
    printed = subprocess.run([sys.executable, "-c", code, "cases"], capture_output=True, text=True, check=True).stdout
    assert "turek-fsi1" in printed
    heavy = ("scipy", "pandas", "matplotlib", "pint", "shapely", "meshio", "jinja2", "distributed", "xarray", "numpy")
    heavy = (*heavy, "ffsi.scene", "ffsi.freefem", "rich.progress")
    assert [name for name in heavy if name in printed.splitlines()[-1].split()] == []
