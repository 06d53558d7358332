"""Scenes that explain themselves: `ffsi keys`, `schema`, `new` and `show`, as far as no FreeFEM is needed."""

import json
import tomllib

import pytest
from jsonschema import Draft202012Validator
from rich.prompt import Prompt
from vessel_meshes import vessel

from ffsi.cli.main import main
from ffsi.freefem import FreeFEMNotFound
from ffsi.result.numbers import inlet_words, numbers
from ffsi.run import meshing
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values
from ffsi.scene.drafts import MESH, Answers, choices, draft, guess, kinds
from ffsi.scene.keys import scene_keys

VALIDATOR = Draft202012Validator(Scene.model_json_schema())

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


@pytest.fixture
def no_freefem(monkeypatch):
    def nowhere():
        raise FreeFEMNotFound("missing-binary", "FreeFem++ is not installed")

    monkeypatch.setattr(meshing, "find_freefem", nowhere)


def call(capsys, *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stopped:
        main(list(arguments))
    out, err = capsys.readouterr()
    return int(stopped.value.code or 0), out, " ".join(err.split())


@pytest.mark.parametrize("case", CASES)
def test_the_keys_of_a_scene_have_its_values_and_names(case):
    scene = CASES[case]
    values = {item.key: item.value for item in scene_keys(scene=scene)}
    assert not [key for key in values if "NAME" in key and key.startswith("solid")]
    for key, value in {**scene.parameters(), **scene.words()}.items():
        assert tomllib.loads(f"x = {values[key]}")["x"] == (pytest.approx(value) if values[key][0] != '"' else value)


def test_the_keys_of_a_scene_and_of_a_case(capsys):
    keys = {item.key for item in scene_keys(scene=CASES["cook"])}
    assert keys > {"solid.membrane.young_modulus", "geometry.rise", "gravity.x"}
    assert not keys & {"fluid.law", "inflow.mean_velocity", "geometry.length", "solid.membrane.c10"}
    code, out, _ = call(capsys, "keys", "turek-fsi1", "solid", "--json")
    found = {item["key"]: item for item in json.loads(out)}
    assert code == 0 and found["solid.beam.poisson_ratio"]["value"] == "0.4"
    code, out, _ = call(capsys, "keys", "turek-fsi1")
    assert code == 0 and "solid.beam.density" in out and "value" in out and "flap_height" not in out


@pytest.mark.parametrize(("words", "said"), [
    (["turek-fsi1", "geometry.flap_height"], "no key of turek-fsi1 is 'geometry.flap_height'"),
    (["turek-fsj1", "fluid"], 'did you mean "turek-fsi1"?'),
    (["nowhere.toml"], "no such file"),
    (["a", "b", "c"], "3 words; accepted: a case or scene file, and a pattern"),
])  # fmt: skip
def test_the_command_refuses_other_words(words, said, capsys):
    code, out, err = call(capsys, "keys", *words)
    assert (code, out) == (2, "") and said in err


def test_the_command_prints_the_schema(capsys):
    code, out, err = call(capsys, "schema")
    assert (code, err) == (0, "") and json.loads(out) == Scene.model_json_schema()


@pytest.mark.parametrize("kind", [kind for kind in kinds() if kind != MESH])
def test_every_draft_is_a_scene(kind):
    assert choices(kind)
    for what in choices(kind):
        for material in ("mooney-rivlin", "st-venant-kirchhoff") if what != "fluid" else (None,):
            text = draft("mine", Answers(kind, what, material, end="10 s" if material else None, level="0"))
            scene = Scene.from_toml(text)
            assert (scene.name, scene.physics, scene.mesh.level) == ("mine", what, 0)
            assert {solid.material for solid in scene.solid.values()} <= {material}
            assert scene.steady is (material is None) and not list(VALIDATOR.iter_errors(tomllib.loads(text)))


def test_a_draft_says_what_its_keys_mean_and_is_as_stiff_as_its_case():
    text = draft("mine", Answers(velocity="20 cm/s"))
    assert 'mean_velocity = "20 cm/s"  # mean velocity of the built-in profiles, m/s' in text
    assert "[solid.flap]  # Neo-Hookean solid" in text
    assert Scene.from_toml(text).inflow.mean_velocity == pytest.approx(0.2)
    stiff = [
        Scene.from_toml(draft("mine", Answers("flap-channel", material=law))).solid["flap"].young_poisson
        for law in ("neo-hookean", "mooney-rivlin", "st-venant-kirchhoff")
    ]
    assert stiff[1] == pytest.approx(stiff[0], rel=1e-5) and stiff[2] == pytest.approx(stiff[0], rel=1e-5)


@pytest.mark.parametrize(("answers", "said"), [
    (Answers("flap-chanel"), 'did you mean "flap-channel"?'),
    (Answers(what="both"), "solve"),
    (Answers("cook", "fsi"), 'solve = "fsi": accepted with this domain: "solid"'),
    (Answers(material="rubber"), "solid.flap.material"),
    (Answers(velocity="3 m"), "inflow.mean_velocity"),
    (Answers("cook", velocity="1 m/s"), "inflow"),
    (Answers(end="soon"), 'time.end = "soon"'),
    (Answers(level="9"), "mesh.level"),
    (Answers(MESH), "mesh"),
    (Answers(MESH, mesh="no.msh"), "no.msh"),
], ids=str)  # fmt: skip
def test_an_answer_that_cannot_be_used_is_refused(answers, said):
    with pytest.raises(SceneError) as error:
        draft("mine", answers)
    assert said in str(error.value)


def test_names_are_guessed_in_a_draft_of_ones_own_mesh(tmp_path):
    vessel().write(tmp_path / "vessel.msh")
    text = draft("mine", Answers(MESH, mesh="vessel.msh", unit="mm"), tmp_path)
    geometry = tomllib.loads(text)["geometry"]
    assert (geometry["file"], geometry["regions"]) == ("vessel.msh", {"fluid": "lumen", "wall": "wall"})
    assert geometry["boundaries"] == {"inlet": "in", "outlet": "out", "clamped": "ends", "walls": "inner"}
    assert Scene.from_toml(text).physics == "fsi"
    with pytest.raises(SceneError, match=r"outfow.*accepted"):
        draft("mine", Answers(MESH, mesh="vessel.msh", outlet="outfow"))
    solid = tomllib.loads(draft("mine", Answers(MESH, mesh="vessel.msh", inlet="none")))
    assert solid["geometry"]["regions"] == {"lumen": "lumen", "wall": "wall"} and "fluid" not in solid
    found = ["outside", "inflow", "outflow", "left end"]
    assert [guess(what, found) for what in ("inlet", "outlet", "clamped")] == ["inflow", "outside", "left end"]
    assert guess("inlet", ["a"]) == "none"


def test_the_command_writes_a_scene_without_a_question(capsys, monkeypatch):
    monkeypatch.setattr(Prompt, "ask", None)
    code, out, err = call(capsys, "new", "My scene.toml", "--geometry", "channel-cylinder", "--solve", "fluid")
    assert (code, out) == (0, "") and "ffsi show" in err
    scene = load_scene("My scene.toml")
    assert (scene.name, scene.physics, scene.geometry.kind) == ("my-scene", "fluid", "channel-cylinder")


def test_the_command_never_overwrites(capsys, tmp_path):
    (tmp_path / "a.toml").write_text("mine")
    for words in (["a.toml"], ["a.txt"], ["no/a.toml"], ["b.toml", "--velocity", "fast"]):
        assert call(capsys, "new", *words)[0] == 2
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.toml", "mine")]


def terminal(monkeypatch, answers: list[str]) -> list[str]:
    """Let a person answer; what they are asked. An empty answer takes what is offered."""
    asked = []

    def ask(question, *, console, choices, default):
        assert answers, f"one question too many: {question}"
        asked.append(question)
        given = answers.pop(0)
        assert choices is None or not given or given in choices
        return given or default

    monkeypatch.setattr(Prompt, "ask", ask)
    monkeypatch.setattr("ffsi.cli.scenes.on_terminal", lambda: True)
    return asked


def test_the_command_asks_at_most_six_questions(capsys, monkeypatch):
    asked = terminal(
        monkeypatch, ["cylinder", "channel-cylinder", "fsi", "mooney-rivlin", "fast", "20 cm/s", "10 s", "0"]
    )
    code, _, err = call(capsys, "new", "a.toml")
    scene = load_scene("a.toml")
    assert code == 0 and len(set(asked)) == 6
    assert 'did you mean "channel-cylinder"?' in err and "inflow.mean_velocity" in err  # both asked again
    assert (scene.solid["beam"].material, scene.inflow.mean_velocity, scene.time.end) == ("mooney-rivlin", 0.2, 10.0)


def test_the_command_asks_about_a_mesh(capsys, monkeypatch, tmp_path):
    vessel().write(tmp_path / "vessel.msh")
    asked = terminal(monkeypatch, ["mesh", "none.msh", "vessel.msh", "mm", "", "", ""])
    assert call(capsys, "new", "a.toml")[0] == 0
    assert len(set(asked)) == 6 and load_scene("a.toml").geometry.inlet.height == pytest.approx(3e-3)


def test_what_an_option_says_is_not_asked(capsys, monkeypatch):
    asked = terminal(monkeypatch, [""])
    assert call(capsys, "new", "a.toml", "--geometry", "cook", "--end", "steady", "--level", "1")[0] == 0
    assert asked == ["Of which material are the solids?"]


def test_numbers_and_inflow_in_words():
    found = {number.name: number.value for number in numbers(CASES["turek-fsi3"])}
    assert found["Reynolds number"] == pytest.approx(200) and found["mass ratio of beam"] == pytest.approx(1)
    assert found["stiffness ratio of beam"] == pytest.approx(1.4e3)
    carreau = with_values(CASES["turek-fsi1"], {"fluid.law": "carreau"})
    assert "at the shear rate" in numbers(carreau)[0].formula
    assert numbers(CASES["cook"])[0].value == pytest.approx(4 / 200)
    womersley = numbers(CASES["aneurysm-pulsatile"])[1]
    assert womersley.name == "Womersley number" and womersley.value == pytest.approx(1.613, rel=1e-3)
    assert inlet_words(CASES["cook"]) == []
    steady, in_time = inlet_words(CASES["turek-fsi1"]), inlet_words(CASES["turek-fsi3"])
    assert steady == [
        "profile parabolic: mean_velocity 0.2 m/s, largest 0.3 m/s, flow rate 0.082 m²/s over an inlet of 0.41 m"
    ]
    assert "factor from 0 to 1, from rest within 2 s" in in_time[1]


@pytest.mark.usefixtures("no_freefem")
def test_the_command_tells_what_is_known_without_freefem(capsys):
    code, out, err = call(capsys, "show", "turek-fsi1", "--set", "inflow.mean_velocity=0.4")
    assert code == 0 and "mesh: not made" in err
    for words in ("interface", "fluid and solid move together", "Reynolds number", "40", "profile parabolic"):
        assert words in out
    code, _, err = call(capsys, "show", "turek-fsi1", "-o", "a.png")
    assert code == 4 and "FreeFem++ is not installed" in err


@pytest.mark.parametrize(("words", "said"), [
    (["turek-fsi1", "--set", "fluid.densty=1"], 'did you mean "fluid.density"?'),
    (["turek-fsi1", "-o", "a.jpg"], "PNG"),
    (["turek-fsi1", "-o", "no/a.png"], "no does not exist"),
    (["none.toml"], "no such file"),
])  # fmt: skip
def test_a_scene_with_errors_is_not_shown(words, said, capsys):
    code, out, err = call(capsys, "show", *words)
    assert (code, out) == (2, "") and said in err
