"""The rendered scripts as texts: complete, the same every time, and only what the scene needs."""

import math
import re
from pathlib import Path

import pytest

from ffsi.scene import CASES, SceneError, boundaries, load_scene
from ffsi.scene.expressions import Expression
from ffsi.script.render import PYTHON_ONLY, is_runtime_parameter, parameters, render

EDP = Path(__file__).parents[2] / "edp"

OUTLET = "varf OutletXY"  # what it announces itself by


def script(case: str, *settings: str, mumps: bool = True, bundled: bool = True) -> str:
    return render(load_scene(case, settings), mumps=mumps, bundled=bundled)


def code(text: str) -> str:
    return re.sub(r"//.*", "", text)


@pytest.mark.parametrize("case", CASES)
def test_every_case_renders_completely_as_it_is_committed(case):
    text = script(case)
    assert text.endswith("\n") and not text.endswith("\n\n")
    assert not re.search(r"{{|{%|{#|\bNone\b|\bTrue\b|\bFalse\b|Undefined", text) and text.isascii()
    for opening, closing in ("()", "[]", "{}"):
        assert text.count(opening) == text.count(closing)
    assert f'string caseName = "{case}";' in text and script(case) == script(case)
    assert script(case) == render(load_scene(case, []).from_toml(load_scene(case, []).to_toml()))
    assert (EDP / f"{case}.edp").read_text(encoding="utf-8") == script(case, bundled=False), "run `make edp`"


def test_no_committed_script_is_stale():
    assert {path.name for path in EDP.iterdir()} == {f"{case}.edp" for case in CASES} | {"lib", "plain-fsi1.edp"}


@pytest.mark.parametrize("case", CASES)
def test_a_script_is_short_and_includes_the_library(case):
    lines = (EDP / f"{case}.edp").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= (400 if CASES[case].time else 300)
    included = [line for line in lines if line.startswith("include")]
    assert len(set(included)) == len(included) > 10 and all((EDP / line.split('"')[1]).is_file() for line in included)


def test_every_file_of_the_library_is_used():
    """Here or by scenes that the catalogue lacks."""
    others = [
        ("turek-cfd1", "fluid.law=power-law", "fluid.consistency=1.0", "fluid.exponent=0.7"),
        ("aneurysm", "fluid.law=casson", "fluid.yield_stress=0.004", "fluid.viscosity_infinity=0.0035"),
        ("turek-cfd1", "outlet.kind=pressure", "outlet.pressure=1"),
        ("aneurysm-pulsatile", "inflow.profile=womersley"),
        ("turek-fsi3", "mesh_motion.kind=hyperelastic"),
    ]
    texts = [script(*other, bundled=False) for other in others] + [script(case, bundled=False) for case in CASES]
    used = set(re.findall(r'^include "lib/(.*)"', "\n".join(texts), re.MULTILINE))
    assert {path.name for path in (EDP / "lib").iterdir()} - used == {
        "channel.idp", "initial.idp", "linear-elastic.idp", "mesh-file.idp",
        "moving-walls.idp", "openings.idp", "resistance-outlet.idp", "windkessel-outlet.idp",
    }  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_bundle_stands_alone(case):
    text = script(case)
    assert not re.search("^ *(include|IFMACRO|ENDIFMACRO)", text, re.MULTILINE)
    assert text.startswith(script(case, bundled=False).partition("include")[0])


@pytest.mark.parametrize("case", [case for case, scene in CASES.items() if scene.fluid])
def test_zero_traction_needs_no_outlet_term(case):
    assert OUTLET in script(case)
    text = script(case, "outlet.kind=zero-traction")
    assert OUTLET not in text and "= farViscosity" not in text


def test_gravity_only_where_the_scene_has_it():
    assert "gravity" not in code(script("turek-fsi1"))
    text = script("turek-fsi1", "gravity.y=-2")
    assert "fluidDensity*gravityY" in text and "gravityY, solidMass" in text


@pytest.mark.parametrize("case", ["turek-fsi1", "turek-cfd1", "turek-csm1"])
def test_without_mumps_the_script_uses_umfpack(case):
    usual = script(case)
    assert 'load "MUMPS_seq"' in usual
    for text in (script(case, mumps=False), script(case, "solver.linear_solver=umfpack")):
        assert "MUMPS" not in code(text) and "UMFPACK" in text


@pytest.mark.parametrize("text", ["one\ntwo", "one\rtwo", "one\u2028two", "a\x00b", "a\x85b", "tab\there", "\x1b[31m"])
def test_a_description_is_one_line(text):
    with pytest.raises(SceneError, match="description"):
        described(text)


@pytest.mark.parametrize(
    "text", ['"; exec("touch pwned"); //', "ends with \\", "'*/ exit(1); /*", "{{ 7 * 7 }} {% x %}"]
)
def test_a_description_stays_inside_its_comment(text):
    usual, changed = script("turek-csm1").splitlines(), render(described(text)).splitlines()
    assert changed[0] == f"// turek-csm1: {text}" and changed[1:] == usual[1:]


def described(text: str):
    scene = CASES["turek-csm1"]
    return type(scene).model_validate(scene.model_dump(exclude_none=True) | {"description": text})


@pytest.mark.parametrize("name", ['a"; exec("x"); "', "a b", "A", "a\\", "a\n", "../a", "a.b", "", "é"])
def test_names_with_anything_but_letters_and_digits_are_refused(name):
    scene = CASES["turek-csm1"]
    with pytest.raises(SceneError, match="name"):
        type(scene).model_validate(scene.model_dump(exclude_none=True) | {"name": name})


@pytest.mark.parametrize("name", ['beam"', "beam; exit(1)", "flap", "Beam"])
def test_solids_have_the_names_that_the_geometry_gives(name):
    scene = CASES["turek-csm1"].model_dump(exclude_none=True)
    with pytest.raises(SceneError, match="unknown solid"):
        type(CASES["turek-csm1"]).model_validate(scene | {"solid": {name: scene["solid"]["beam"]}})


def profile(text: str) -> str:
    return re.search(r"^  if \(j == 0\) return (.*);", text, re.MULTILINE)[1]


def test_the_profile_is_printed_from_the_parsed_tree():
    """What was typed never reaches the script: spaces, superfluous brackets and unit spellings are gone."""
    formula = "  ( ( 1 ))+ y*( H -y)  "
    printed = profile(script("turek-cfd1", f'inflow.profile="{formula}"'))
    assert printed == Expression.parse(formula).to_freefem({"y": "inletS"}) and formula.strip() not in printed
    values = {"inletS": 0.3, "H": 0.41}
    assert eval(printed.replace("^", "**"), {}, values) == pytest.approx(1 + 0.3 * 0.11, rel=1e-14)


@pytest.mark.parametrize(
    ("name", "at", "value"), [("parabolic", 0.1, 1.5 * 4 * 0.1 * 0.31 / 0.41**2), ("uniform", 0.1, 1)]
)
def test_the_built_in_profiles(name, at, value):
    printed = profile(script("turek-cfd1", f"inflow.profile={name}"))
    assert eval(printed.replace("^", "**"), {}, {"inletS": at, "H": 0.41}) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize("formula", ['exec("rm x")', "y; exit(1)", "x + y", "y //", '"y"', "y = 1", "system(1)", "y\\"])
def test_code_is_no_profile(formula):
    scene = CASES["turek-cfd1"].model_dump(exclude_none=True)
    with pytest.raises(SceneError, match=r"inflow\.profile"):
        type(CASES["turek-cfd1"]).model_validate(scene | {"inflow": {"mean_velocity": 1.0, "profile": formula}})


@pytest.mark.parametrize("case", CASES)
def test_the_flags_are_the_numbers_of_the_scene(case):
    scene = load_scene(case, [])
    flags = {parameter.flag: parameter.value for parameter in parameters(scene)}
    expected = {key.replace(".", "_"): value for key, value in scene.parameters().items() if key not in PYTHON_ONLY}
    assert flags == expected
    text = render(scene)
    for parameter in parameters(scene):
        place, kind = f"parameter[{parameter.index}]", "Number"
        if isinstance(parameter.value, int):
            place, kind = f"int({place})", "Integer"
        declared = f'NewMacro {parameter.variable}() {place} EndMacro {kind}("{parameter.key}", {parameter.value});'
        assert f"\n{declared}" in text
    assert len({parameter.variable for parameter in parameters(scene)}) == len(flags)


def test_values_are_defaults_of_the_script_but_the_time_limit():
    changed = script("turek-fsi1", "fluid.viscosity=2", "mesh.level=3")
    usual = script("turek-fsi1").splitlines()
    different = [line for line in changed.splitlines() if line not in usual]
    assert [line.partition("EndMacro ")[2] for line in different] == [
        'Integer("mesh.level", 3); AtLeast(0); AtMost(6);',
        'Number("fluid.viscosity", 2.0); Above(0); Unit(-1, 1, -1);',
    ]
    scene = load_scene("turek-csm1", ["solver.time_limit=5"])
    assert "solver_time_limit" not in {parameter.flag for parameter in parameters(scene)}
    assert render(scene) == script("turek-csm1")


@pytest.mark.parametrize(("case", "key", "runtime"), [
    ("flap-svk", "inflow.mean_velocity", True), ("flap-svk", "fluid.viscosity", True),
    ("flap-svk", "solid.flap.lame_mu", True), ("flap-svk", "mesh_motion.divergence_weight", True),
    ("turek-csm1", "gravity.y", True), ("flap-svk", "mesh.level", False), ("flap-svk", "mesh.root_size", False),
    ("flap-svk", "geometry.height", False), ("flap-svk", "solver.tolerance", False), ("flap-svk", "gravity.y", False),
    ("turek-csm1", "inflow.mean_velocity", False), ("flap-svk", "inflow.profile", False),
    ("flap-svk", "nothing", False),
])  # fmt: skip
def test_what_can_change_between_the_points_of_one_process(case, key, runtime):
    assert is_runtime_parameter(load_scene(case, []), key) is runtime


@pytest.mark.parametrize("case", [case for case, scene in CASES.items() if scene.geometry.kind != "aneurysm"])
def test_exact_areas_and_lengths_are_formulas_of_the_parameters(case):
    scene = CASES[case]
    names = {name: getattr(math, name) for name in ("sin", "cos", "asin", "sqrt")}
    names |= {parameter.variable: parameter.value for parameter in parameters(scene)}
    lines = re.findall(r"^(exact\w+)\[(\d+)\] = (.*);$", script(case), re.MULTILINE)
    found = {(name, int(number)): eval(text.replace("^", "**"), names) for name, number, text in lines}
    areas = enumerate(scene.exact_areas().values(), start=1 if scene.fluid else 2)
    expected = {("exactArea", number): area for number, area in areas}
    expected |= {("exactLength", side.label): side.exact_length for side in boundaries(scene)}
    assert found == pytest.approx(expected, rel=1e-14)
