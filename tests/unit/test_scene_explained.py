"""Scenes that explain themselves: `ffsi keys`, `schema`, `new` and `show`, as far as no FreeFEM is needed."""

import copy
import json
import tomllib
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from rich.prompt import Prompt
from test_cli import call
from vessel_meshes import scene_table, vessel

from ffsi.result.numbers import inlet_words, numbers
from ffsi.scene import CASES, Scene, SceneError, load_scene, with_values
from ffsi.scene.drafts import MESH, Answers, choices, draft, guess, kinds
from ffsi.scene.files import FOLDER
from ffsi.scene.keys import scene_keys
from ffsi.scene.units import Count, Length, Quantity

SCHEMA = Scene.model_json_schema()
VALIDATOR = Draft202012Validator(SCHEMA)

pytestmark = pytest.mark.usefixtures("in_an_empty_folder")


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
    (["turek-fsj1", "fluid"], 'did you mean "turek-fsi1"?'), (["nowhere.toml"], "no such file"),
    (["a", "b", "c"], "3 words; accepted: a case or scene file, and a pattern"),
    (["fluid.densty"], "no key is 'fluid.densty' (did you mean \"fluid.density\"?)"),
    (["turek-fsi1", "peak"], "no key of turek-fsi1 is 'peak' (did you mean \"inflow.peak_velocity\", "),
    (["_velocity"], '(did you mean "inflow.mean_velocity", "inflow.peak_velocity", '), (["xyz"], "no key is 'xyz'"),
    (["fluid", "--markdown"], "--markdown prints all keys: give no CASE, no PATTERN and no --json"),
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
    (Answers("flap-chanel"), 'did you mean "flap-channel"?'), (Answers(what="both"), "solve"),
    (Answers("cook", "fsi"), 'solve = "fsi": accepted with this domain: "solid"'),
    (Answers(material="rubber"), "solid.flap.material"), (Answers(velocity="3 m"), "inflow.mean_velocity"),
    (Answers("cook", velocity="1 m/s"), "inflow"), (Answers(end="soon"), 'time.end = "soon"'),
    (Answers(level="9"), "mesh.level"), (Answers(MESH), "mesh"), (Answers(MESH, mesh="no.msh"), "no.msh"),
    (Answers("channel", unit="mm"), 'unit = "mm": only the geometry "mesh" has it'),
    (Answers("channel", material="neo-hookean"), 'material = "neo-hookean": there is no solid'),
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
    with pytest.raises(SceneError, match=r"inlet: missing, as is clamped, and no boundary sounds like one; accepted: "):
        draft("mine", Answers(MESH, mesh="vessel.msh", inlet="none", clamped="none"))
    closed = draft("mine", Answers(MESH, "fsi", "mooney-rivlin", end="1 s", mesh="vessel.msh", outlet="none"))
    young, _ = Scene.from_toml(closed).solid["wall"].young_poisson
    assert "outlet" not in tomllib.loads(closed) and young == pytest.approx(1e6, rel=1e-5)
    solid = tomllib.loads(draft("mine", Answers(MESH, mesh="vessel.msh", inlet="none")))
    assert solid["geometry"]["regions"] == {"lumen": "lumen", "wall": "wall"} and "fluid" not in solid
    found = ["inner curve", "outer bend", "inflow", "outflow", "left end"]
    assert [guess(what, found) for what in ("inlet", "outlet", "clamped")] == ["inflow", "outflow", "left end"]
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


def test_the_command_asks_for_several_outlets(capsys, monkeypatch, tmp_path):
    vessel().write(tmp_path / "vessel.msh")
    asked = terminal(monkeypatch, ["mesh", "vessel.msh", "mm", "in", "out, outsde", "out, inner", ""])
    code, _, err = call(capsys, "new", "a.toml")
    assert code == 0 and 'did you mean "outside"?' in err and len(set(asked)) == 6
    scene = tomllib.loads((tmp_path / "a.toml").read_text())
    assert scene["geometry"]["outlets"] == {"out": "out", "inner": "inner"}
    assert "outlet" not in scene["geometry"]["boundaries"] and {*load_scene("a.toml").outlets} == {"out", "inner"}
    assert scene["outlet"] == {"out": {"kind": "do-nothing"}, "inner": {"kind": "do-nothing"}}


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
    assert code == 4 and "no FreeFem++ on this machine" in err


@pytest.mark.parametrize(("words", "said"), [
    (["turek-fsi1", "--set", "fluid.densty=1"], 'did you mean "fluid.density"?'),
    (["turek-fsi1", "-o", "a.jpg"], "PNG"),
    (["turek-fsi1", "-o", "no/a.png"], "no does not exist"),
    (["none.toml"], "no such file"),
])  # fmt: skip
def test_a_scene_with_errors_is_not_shown(words, said, capsys):
    code, out, err = call(capsys, "show", *words)
    assert (code, out) == (2, "") and said in err


def of_case(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def changed(table: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """The table with some keys set, or removed where the value is None."""
    table = copy.deepcopy(table)
    for key, value in changes.items():
        *path, last = key.split(".")
        inner = table
        for name in path:
            inner = inner.setdefault(name, {})
        if value is None:
            inner.pop(last, None)
        else:
            inner[last] = value
    return table


def accepted(table: dict[str, Any]) -> bool:
    try:
        Scene.model_validate(table)
    except SceneError:
        return False
    return True


def pairs(changes: dict[str, list[dict[str, Any]]]) -> list[tuple[str, dict[str, Any]]]:
    return [(case, each) for case, own in changes.items() for each in own]


def resolved(schema: dict[str, Any]) -> dict[str, Any]:
    return SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]] | schema if "$ref" in schema else schema


def keys_of(schema: dict[str, Any], prefix: str = "", only: str = "") -> dict[tuple[str, str], dict[str, Any]]:
    """The schema of every key below a table, by the key and what must be chosen for it, as `scene_keys` has them."""
    found = {}
    for name, inner in resolved(schema).get("properties", {}).items():
        key, inner = f"{prefix}{name}", resolved(inner)
        if "oneOf" in inner and "discriminator" not in inner:  # one table, or several by name
            for choice in inner["oneOf"]:
                found |= keys_of({"properties": {name: choice}}, prefix, only)
            continue
        if isinstance(inner.get("additionalProperties"), dict):
            key, inner = f"{key}.NAME", resolved(inner["additionalProperties"])
        if "discriminator" in inner:
            tag = inner["discriminator"]["propertyName"]
            found[f"{key}.{tag}", ""] = {"enum": list(inner["discriminator"]["mapping"])}
            for value, place in inner["discriminator"]["mapping"].items():
                chosen = keys_of({"$ref": place}, f"{key}.", f'{key}.{tag} = "{value}"')
                found |= {(k, o): said for (k, o), said in chosen.items() if k != f"{key}.{tag}"}
        elif "properties" in inner:
            found |= keys_of(inner, f"{key}.", only)
        else:
            found[key, only] = inner
    return found


def test_the_schema_is_one():
    Draft202012Validator.check_schema(SCHEMA)
    assert '"null"' not in str(SCHEMA)


@pytest.mark.parametrize("case", CASES)
def test_a_case_of_the_catalogue_obeys_the_schema(case):
    assert not list(VALIDATOR.iter_errors(of_case(case))) and VALIDATOR.is_valid(tomllib.loads(CASES[case].to_toml()))


def test_schema_and_key_reference_are_the_same():
    """docs/scene.md is written from `scene_keys` (test_docs.py)."""
    found = keys_of(SCHEMA)
    assert found.keys() == {(item.key, item.only) for item in scene_keys()}
    for item in scene_keys():
        said = found[item.key, item.only]
        assert item.meaning in said.get("description", item.meaning), item.key
        if item.default not in ("", "needed") and "default" in said:
            assert tomllib.loads(f"x = {item.default}")["x"] == pytest.approx(said["default"]), item.key
        if item.unit:
            assert {"type": "number"}.items() <= said.get("anyOf", [said])[0].items(), item.key
        for bound, name in ((">= ", "minimum"), ("> ", "exclusiveMinimum"), ("< ", "exclusiveMaximum")):
            if item.type == "number" and item.range.startswith(bound):
                assert said.get("anyOf", [said])[0][name] == float(item.range.split()[1]), item.key


@pytest.mark.parametrize(("value", "good"), [
    (0.02, True), (2, True), ("20 cm", True), ("1e-3 m", True), (".5m", True), ("2 m^2/m", True), ("1 µm", True),
    ("4 m²/m", True), ("+3 m", True), (0, False), (-1.0, False), (True, False), ("0.00 m", False), ("-1 m", False),
    ("0e5 m", False), ("20", False), ("cm", False), ("1 kg/m s", False), ("1.2.3 m", False), ("m 2", False),
    ([], False),
])  # fmt: skip
def test_a_length_in_the_schema_is_a_length_in_the_model(value, good):
    annotation = Length.__metadata__[0]
    assert Draft202012Validator(annotation.__get_pydantic_json_schema__({}, None)).is_valid(value) is good
    try:
        annotation(value)
    except ValueError as error:
        assert not good or "dimension" in str(error)
    else:
        assert good


def test_a_speed_may_be_zero_in_the_schema_and_a_coordinate_negative():
    speed, coordinate = (
        Draft202012Validator(annotation.__get_pydantic_json_schema__({}, None))
        for annotation in (Quantity("m/s", at_least=0.0), Quantity("m"))
    )
    assert [speed.is_valid(text) for text in ("0 m/s", "-0.0 m/s", "-1 m/s", "1 m/s")] == [True, True, False, True]
    assert coordinate.is_valid("-1 m")
    assert not Draft202012Validator(Count(1, 3).__get_pydantic_json_schema__({}, None)).is_valid(4)


POWER_LAW = {"law": "power-law", "density": 1, "consistency": 1, "exponent": 1}
WRONG = pairs({
    "turek-fsi1": [
        {"nonsense": 1}, {"name": "Has Blanks"}, {"description": "two\nlines"}, {"fluid": None}, {"inflow": None},
        {"outlet": None}, {"solid": None}, {"geometry.kind": None}, {"geometry.kind": "cook"}, {"geometry.beam": None},
        {"geometry.flap_height": 0.1}, {"solid.roof": of_case("turek-fsi1")["solid"]["beam"]},
        {"fluid.viscosity": None}, {"fluid.viscosity": "-1 Pa s"}, {"fluid.law": "carreau"}, {"fluid.law": "newton"},
        {"solid.beam.material": None}, {"solid.beam.young_modulus": 1.0}, {"solid.beam.poisson_ratio": None},
        {"solid.beam.poisson_ratio": 0.5},
        {"solid.beam.material": "neo-hookean", "solid.beam.formulation": "incompressible"},
        {"solid.beam.formulation": "mixed"}, {"mesh.level": 7}, {"mesh.level": 1.5}, {"mesh.root_size": 0.01},
        {"inflow.peak_velocity": 1.0}, {"inflow.mean_velocity": None}, {"inflow.ramp": 1.0},
        {"inflow.waveform": "sinus"}, {"inflow.period": 1.0}, {"inflow.harmonics": 3}, {"inflow.profile": "womersley"},
        {"outlet.kind": "pressure"}, {"outlet.pressure": 1.0}, {"outlet.hydrostatic": True}, {"output.vtu": "yes"},
        {"output.wall": {}}, {"traction": {}}, {"support": {}}, {"solver.tolerance": 1.0}, {"time": {"step": 0.1}},
        {"time": {"step": 0.1, "end": 1, "smallest_step": 0.01}},
    ],
    "cook": [
        {"solid": None}, {"traction": None}, {"inflow": {"mean_velocity": 1.0}},
        {"fluid": {"density": 1.0, "viscosity": 1.0}},
    ],
    "aneurysm": [{"fluid": None, "inflow": None, "outlet": None, "mesh_motion": None}, {"solid.dome": None}],
    "aneurysm-pulsatile": [
        {"time": None}, {"inflow.waveform": None, "inflow.period": None},
        {"inflow.series": {"cosine": [1.0], "sine": [0.0]}}, {"inflow.profile": "womersley", "fluid": POWER_LAW},
    ],
    "flap-mooney-rivlin-roof": [{"geometry.roof": None}, {"solid.roof": None}, {"solid.flap.bulk_modulus": None}],
})  # fmt: skip


INCOMPRESSIBLE = {"material": "neo-hookean", "formulation": "incompressible", "density": 1, "lame_mu": 2}
RIGHT = pairs({
    "turek-fsi1": [
        {"solid": None, "mesh_motion": None}, {"solid": {}, "mesh_motion": None},
        {"fluid": None, "inflow": None, "outlet": None, "forces": None, "mesh_motion": None},
        {"fluid.law": "newtonian"}, {"fluid": {"law": "carreau", "density": "1.06 g/cm^3"}},
        {"outlet": {"kind": "resistance", "resistance": "2 kPa s/m^2"}, "inflow.profile": "y*(H-y)"},
        {"time": {"step": "10 ms", "end": 1}, "inflow.ramp": "1 s", "inflow.waveform": "1 + t"},
        {"mesh_motion.kind": "hyperelastic", "output.wall": None, "gravity": {"y": -9.81}},
        {"solid.beam": INCOMPRESSIBLE},
    ],
    "flap-mooney-rivlin-roof": [{"support.stiffness": "1 kPa/mm", "mesh.root_size": 0.01}],
    "aneurysm": [{"solid": None, "mesh_motion": None, "geometry.stent": {}}],
    "aneurysm-pulsatile": [{"inflow.profile": "womersley", "support": {}}],
})  # fmt: skip


@pytest.mark.parametrize(("case", "changes"), WRONG + RIGHT, ids=lambda value: str(value)[:60])
def test_what_the_model_accepts_the_schema_accepts_and_nothing_else(case, changes):
    table = changed(of_case(case), changes)
    assert accepted(table) == VALIDATOR.is_valid(table) == ((case, changes) in RIGHT)


@pytest.mark.parametrize(("changes", "good"), [
    ({}, True), ({"geometry.regions.fluid": ["lumen", 3], "geometry.probes": {"a": {"x": 1, "y": "2 mm"}}}, None),
    ({"support": {}, "geometry.boundaries.supported": "outside"}, True), ({"support": {}}, False),
    ({"geometry.boundaries.supported": "outside"}, False), ({"traction": {}}, False), ({"mesh.body_size": 1.0}, False),
    ({"mesh.size_factor": 2.0}, False), ({"mesh.size_factor": 1.0, "mesh.level": 1}, True),
    ({"geometry.boundaries.inlet": None}, False), ({"geometry.boundaries.walls": []}, False),
    ({"geometry.boundaries.walls": True}, False), ({"geometry.regions.fluid": None}, False), ({"fluid": None}, False),
], ids=str)  # fmt: skip
def test_a_mesh_of_ones_own_obeys_the_schema(changes, good, tmp_path):
    """None: right for the schema, which does not look into the file."""
    table = changed(scene_table(str(vessel().write(tmp_path / "vessel.msh"))), changes)
    assert VALIDATOR.is_valid(table) is (good is not False) and accepted(table) is bool(good)
