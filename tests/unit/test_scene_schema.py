"""The JSON schema of a scene, against an independent validator, the models and the key reference."""

import copy
import tomllib
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from vessel_meshes import scene_table, vessel

from ffsi.scene import CASES, Scene, SceneError
from ffsi.scene.files import FOLDER
from ffsi.scene.keys import scene_keys
from ffsi.scene.units import Count, Length, Quantity

SCHEMA = Scene.model_json_schema()
VALIDATOR = Draft202012Validator(SCHEMA)


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


@pytest.mark.parametrize(("case", "changes"), WRONG, ids=lambda value: str(value)[:60])
def test_what_the_model_refuses_the_schema_refuses(case, changes):
    table = changed(of_case(case), changes)
    assert not accepted(table) and not VALIDATOR.is_valid(table)


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


@pytest.mark.parametrize(("case", "changes"), RIGHT, ids=lambda value: str(value)[:60])
def test_what_the_model_accepts_the_schema_accepts(case, changes):
    table = changed(of_case(case), changes)
    assert accepted(table) and not list(VALIDATOR.iter_errors(table))


@pytest.mark.parametrize(("changes", "good"), [
    ({}, True),
    ({"geometry.regions.fluid": ["lumen", 3], "geometry.probes": {"a": {"x": 1, "y": "2 mm"}}}, None),
    ({"support": {}, "geometry.boundaries.supported": "outside"}, True),
    ({"support": {}}, False),
    ({"geometry.boundaries.supported": "outside"}, False),
    ({"traction": {}}, False),
    ({"mesh.body_size": 1.0}, False),
    ({"mesh.size_factor": 2.0}, False),
    ({"mesh.size_factor": 1.0, "mesh.level": 1}, True),
    ({"geometry.boundaries.inlet": None}, False),
    ({"geometry.boundaries.walls": []}, False),
    ({"geometry.boundaries.walls": True}, False),
    ({"geometry.regions.fluid": None}, False),
    ({"fluid": None}, False),
], ids=str)  # fmt: skip
def test_a_mesh_of_ones_own_obeys_the_schema(changes, good, tmp_path):
    """None: right for the schema, which does not look into the file."""
    table = changed(scene_table(str(vessel().write(tmp_path / "vessel.msh"))), changes)
    assert VALIDATOR.is_valid(table) is (good is not False) and accepted(table) is bool(good)
