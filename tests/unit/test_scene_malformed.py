"""Every malformed scene is refused with a message that names key, value, what is accepted and the nearest name."""

import pickle
from pathlib import Path

import pytest

from ffsi.scene import CASES, Newtonian, Scene, SceneError, load_scene, with_values
from ffsi.scene.geometry import FlapChannel

# Case, override, fragments of the message. The first fragment is the start of the line: the key and the value.
OVERRIDES = [
    # unknown keys, at every depth
    ("flap-svk", "viscosity=1", ["viscosity = 1:", "unknown key", 'mean "fluid.viscosity"']),
    ("flap-svk", "fluidd.density=1", ["fluidd = a table", "unknown key", 'mean "fluid"']),
    ("flap-svk", "solid.flp.density=2", ["solid.flp:", 'holds "flap"', 'mean "solid.flap"']),
    ("cylinder-2d1", "geometry.beam.lenght=1", ["geometry.beam.lenght = 1:", 'mean "geometry.beam.length"']),
    ("flap-svk", "gravity.z=1", ["gravity.z = 1:", "unknown key", '"x", "y"']),
    # names out of a list
    ("flap-svk", "geometry.kind=channel-cavity", ["geometry.kind =", 'geometry "flap-channel"', "another scene"]),
    ("flap-svk", "fluid.law=newtonain", ['fluid.law = "newtonain":', 'mean "newtonian"']),
    ("flap-svk", "solid.flap.material=st-venant-kirchof", ["solid.flap.material =", 'mean "st-venant-kirchhoff"']),
    ("flap-svk", "solid.flap.material=neo-hooke", ['solid.flap.material = "neo-hooke":',
     '"st-venant-kirchhoff", "linear-elastic", "neo-hookean", "mooney-rivlin"', 'mean "neo-hookean"']),
    ("flap-mooney-rivlin", "solid.flap.material=rubber",
     ['solid.flap.material = "rubber":', '"st-venant-kirchhoff", "linear-elastic", "neo-hookean", "mooney-rivlin"']),
    ("flap-svk", "solid.flap.material=[1]", ["solid.flap.material = a list of 1:", '"mooney-rivlin"']),
    ("turek-fsi1", "mesh_motion.kind=linear_elastic",
     ["mesh_motion.kind =", '"harmonic", "linear-elastic", "hyperelastic"', 'mean "linear-elastic"']),
    ("cook", "solid.membrane.formulation=incompresible", ['solid.membrane.formulation = "incompresible":',
     '"displacement", "mixed", "incompressible"', 'mean "incompressible"']),
    ("flap-svk", "inflow.profile=parabolc", ["inflow.profile =", '"uniform"', 'mean "parabolic"']),
    # units
    ("flap-svk", "geometry.length=2.5 s", ['geometry.length = "2.5 s":', "wrong dimension", "> 0 in m", "20 cm"]),
    ("flap-svk", "geometry.length=2.5 g0", ["geometry.length =", '"g0" cannot be converted to m']),
    ("flap-svk", "geometry.length=2.5 foo", ["geometry.length =", '"foo" is not a known unit']),
    ("flap-svk", 'geometry.length="2.5"', ["geometry.length =", "unit is missing"]),
    ("flap-svk", "geometry.length=2,5 m", ["geometry.length =", "cannot be read as a unit"]),
    ("flap-svk", "fluid.viscosity=3.5 kg/m s", ["fluid.viscosity =", "cannot be read as a unit", '"kg/(m s)"']),
    ("flap-svk", "solver.time_limit=1 m", ["solver.time_limit =", "wrong dimension", "10 min"]),
    # numbers
    ("flap-svk", "geometry.length=-1", ["geometry.length = -1:", "out of range", "> 0 in m"]),
    ("flap-svk", "geometry.length=nan", ["geometry.length = nan:", "not a finite number"]),
    ("flap-svk", "geometry.length=true", ["geometry.length = true:", "not a number"]),
    ("flap-svk", "geometry.length=[1, 2]", ["geometry.length = a list of 2:", "not a number"]),
    ("flap-svk", "mesh.level=7", ["mesh.level = 7:", "whole number from 0 to 6"]),
    ("cook", "traction.y=4 N", ['traction.y = "4 N":', "wrong dimension", "a number in Pa"]),
    ("flap-svk", "solver.reuse_ratio=1", ["solver.reuse_ratio = 1:", ">= 0 and < 1"]),
    ("turek-csm1", "solid.beam.poisson_ratio=0.5", ["solid.beam.poisson_ratio = 0.5:", "> -1 and < 0.5"]),
    # elastic constants
    ("flap-svk", "solid.flap.young_modulus=5", ["solid.flap.young_modulus:", "uses the pair (lame_lambda, lame_mu)"]),
    ("turek-csm1", "solid.beam.lame_lambda=1", ["solid.beam.lame_lambda:", "uses the pair (lame_mu, poisson_ratio)"]),
    ("flap-svk", "solid.flap.lame_lambda=-2", ["solid.flap.lame_lambda = -2 Pa:", "-1.33333333 Pa"]),
    ("flap-mooney-rivlin", "solid.flap.material=neo-hookean",
     ["solid.flap.lame_lambda:", "missing", "(young_modulus, poisson_ratio)"]),
    # constants by formulation
    ("flap-neo-hookean",
     'solid.flap={material="neo-hookean", density=1, formulation="incompressible", lame_lambda=8, lame_mu=2}',
     ["solid.flap.lame_lambda = 8 Pa:", 'not accepted with formulation = "incompressible"',
     "Poisson's ratio is 1/2; give young_modulus or lame_mu"]),
    ("cook", 'solid.membrane={material="neo-hookean", density=1, formulation="incompressible", lame_lambda=8, '
     "poisson_ratio=0.3}",
     ["solid.membrane.lame_lambda = 8 Pa:", "\nsolid.membrane.poisson_ratio = 0.3: not accepted"]),
    ("cook", 'solid.membrane={material="neo-hookean", density=1, formulation="incompressible"}',
     ["solid.membrane.lame_mu: missing;", "exactly one of lame_mu, young_modulus"]),
    ("cook",
     'solid.membrane={material="neo-hookean", density=1, formulation="incompressible", lame_mu=1, young_modulus=3}',
     ["solid.membrane.young_modulus: given beside lame_mu;", "exactly one of lame_mu, young_modulus"]),
    ("cook", 'solid.membrane={material="neo-hookean", density=1, formulation="mixed", lame_mu=1}',
     ["solid.membrane.lame_lambda: missing beside lame_mu;", "exactly one pair"]),
    ("cook", 'solid.membrane={material="neo-hookean", density=1, formulation="mixed", lame_mu=1, lame_lambda=0}',
     ["solid.membrane.lame_lambda = 0 Pa:", 'greater than 0 Pa with formulation = "mixed"', "divides by lame_lambda"]),
    ("cook", 'solid.membrane={material="neo-hookean", density=1, formulation="mixed", lame_mu=1, lame_lambda=-1}',
     ["solid.membrane.lame_lambda = -1 Pa:", "-2/3 lame_mu"]),
    ("cook", 'solid.membrane={material="neo-hookean", density=1, formulation="mixed", lame_mu=1, poisson_ratio=-0.1}',
     ["solid.membrane.poisson_ratio = -0.1:", 'greater than 0 with formulation = "mixed"']),
    ("flap-mooney-rivlin",
     'solid.flap={material="mooney-rivlin", density=1, formulation="incompressible", c10=1, c01=1, bulk_modulus=5}',
     ["solid.flap.bulk_modulus = 5 Pa:", 'not accepted with formulation = "incompressible"', "leave it out"]),
    ("flap-mooney-rivlin", 'solid.flap={material="mooney-rivlin", density=1, formulation="mixed", c10=1, c01=1}',
     ["solid.flap.bulk_modulus: missing;", 'not needed with formulation = "incompressible"']),
    # one problem only: without a valid formulation nothing is said about the constants
    ("flap-mooney-rivlin", 'solid.flap={material="mooney-rivlin", density=1, formulation="mixt", c10=1, c01=1}',
     ['solid.flap.formulation = "mixt":', 'mean "mixed"']),
    ("flap-svk", "solid.flap.formulation=mixed",
     ['solid.flap.formulation = "mixed":', 'unknown key; "solid.flap" with the material "st-venant-kirchhoff" has']),
    # constants of Mooney-Rivlin
    ("flap-svk", "solid.flap.material=mooney-rivlin",
     ["solid.flap.c10: missing; constant C10", "\nsolid.flap.c01: missing;", "\nsolid.flap.bulk_modulus: missing;"]),
    ("flap-svk", 'solid.flap={material="mooney-rivlin", density=1, c10=75}',
     ["solid.flap.c01: missing", "\nsolid.flap.bulk_modulus: missing;"]),
    ("flap-mooney-rivlin", 'solid.flap={material="mooney-rivlin", density=1, c10=0, c01=0, bulk_modulus=1}',
     ["solid.flap.c10 = 0 Pa:", "c10 + c01 must be greater than 0 Pa"]),
    # keys of another material
    ("flap-svk", "solid.flap.c10=75",
     ["solid.flap.c10 = 75:", 'unknown key; "solid.flap" with the material "st-venant-kirchhoff" has', '"lame_mu"']),
    ("flap-neo-hookean", "solid.flap.bulk_modulus=5.6",
     ["solid.flap.bulk_modulus = 5.6:", 'with the material "neo-hookean" has', '"poisson_ratio"']),
    ("flap-mooney-rivlin", "solid.flap.young_modulus=5", ["solid.flap.young_modulus = 5:",
     'with the material "mooney-rivlin" has "density", "viscosity", "mass_damping", "formulation", '
     '"c10", "c01", "bulk_modulus", "material"']),
    ("flap-svk", "geometry.cylinder_x=1", ["geometry.cylinder_x = 1:", 'with the kind "flap-channel" has']),
    # geometry
    ("flap-svk", "geometry.flap_height=0.4", ["geometry.flap_height = 0.4 m:", "less than height = 0.4 m"]),
    ("flap-svk", "geometry.flap_left=2.49", ["geometry.flap_width = 0.04 m:", "length - flap_left = 0.01 m"]),
    ("turek-fsi1", "geometry.beam.thickness=0.1", ["geometry.beam.thickness = 0.1 m:", "diameter = 0.098 m"]),
    ("turek-fsi1", "geometry.beam.length=3", ["geometry.beam.length = 3 m:", "= 2.25 m"]),
    ("turek-fsi1", "geometry.cylinder_y=0.4", ["geometry.cylinder_y = 0.4 m:", "less than", "= 0.36 m"]),
    ("cavity-flexible-floor", "geometry.lip_radius=1", ["geometry.lip_radius = 1 m:", "cavity_depth = 1 m"]),
    ("cavity-flexible-floor", "geometry.cavity_width=12", ["geometry.cavity_width = 12 m:", "= 11.75 m"]),
    ("aneurysm", "geometry.wall_thickness=1 mm", ["geometry.wall_thickness"]),
    ("aneurysm", "geometry.dome_wall_thickness=0.4 mm", ["geometry.dome_wall_thickness"]),
    ("aneurysm", 'geometry.stent={count=10, diameter="0.2 mm"}', ["geometry.stent.diameter"]),
    ("aneurysm", "geometry.stent.count=21", ["geometry.stent.count"]),
    ("aneurysm", "geometry.diametre=1", ["geometry.diametre = 1:", 'did you mean "geometry.stent.diameter"']),
    ("aneurysm", "solid.flap.density=1", ["solid.flap"]),
    # tables that do not fit together
    ("turek-csm1", "inflow.mean_velocity=1", ["inflow:", "with a fluid"]),
    ("turek-cfd1", "mesh_motion.kind=harmonic", ["mesh_motion:", "a fluid and a solid"]),
    # the elastic roof
    ("flap-svk", "geometry.roof.thickness=0.02", ["solid.roof: missing;", 'a fluid and the solids "flap", "roof"']),
    # geometries without a fluid
    ("cook", "fluid={density=1, viscosity=1}", ["fluid: not accepted:", 'the geometry "cook" holds no fluid']),
    ("cantilever", "mesh_motion.kind=harmonic", ["mesh_motion: not accepted:", '"cantilever" holds no fluid']),
    # traction
    ("flap-svk", "traction.y=1", ["traction: not accepted:", '"flap-channel" has no loaded boundary']),
    ("flap-svk", "geometry.length.x=1", ["geometry.length.x:", "single value"]),
    ("flap-svk", "fluid={density=1}", ["fluid.viscosity:", "missing", "Pa s"]),
    # text
    ("flap-svk", "name=Flap", ['name = "Flap":', "small letter"]),
    ("flap-svk", f"name={'a' * 65}", ["name = ", "at most 64"]),
    ("flap-svk", 'description="a\\nb"', ['description = "a?b":', "one line of printable text"]),
    ("flap-svk", f'description="{"a" * 201}"', ["description = ", "at most 200"]),
    ("flap-svk", "output.pictures=yes", ['output.pictures = "yes":', "true or false"]),
    # formulas
    ("flap-svk", 'inflow={flow_rate=1, profile="y-H/2"}', ["inflow.flow_rate = 1:", "mean is positive, that of this"]),
    ("flap-svk", "solid.flap.hardness=none", ["solid.flap.hardness", "unknown key"]),
    ("flap-svk", "inflow.profile=1/y", ["inflow.profile =", "not finite at y = 0 m"]),
    ("flap-svk", 'inflow.profile=exec("rm -rf /")', ["inflow.profile =", "character '\"'", "not accepted"]),
    # time
    ("turek-fsi1", "time.step=1 ms", ["time.end: missing;", "ends, s"]),
    ("turek-fsi3", "time.end=1 ms", ["time.end = 0.001 s:", "at least step = 0.005 s"]),
    ("turek-fsi3", "time.output_interval=1 ms", ["time.output_interval = 0.001 s:", "at least step = 0.005 s"]),
    ("turek-fsi3", "time.smallest_step=1 ms", ["time.smallest_step = 0.001 s:", "only accepted with adaptive = true"]),
    ("turek-fsi3", "time={step=0.1, end=1, adaptive=true, smallest_step=0.2}",
     ["time.smallest_step = 0.2 s:", "at most step = 0.1 s"]),
    ("turek-fsi3", "time.shift=1 s", ["time.shift =", "wrong dimension", '"2 s^-1"']),
    ("turek-fsi3", "time.step=1e-9", ["time.step = 1e-09 s:", "at least end / 1e+09 = 1e-08 s"]),
    ("turek-fsi1", "inflow.ramp=2", ["inflow.ramp = 2 s:", "only accepted", "table time"]),
    ("turek-fsi1", "inflow.waveform=t", ['inflow.waveform = "t":', "only accepted", "table time"]),
    ("turek-fsi3", "inflow.waveform=y", ['inflow.waveform = "y":', 'unknown name "y"; accepted: "t", "pi"']),
    ("turek-fsi3", "inflow.waveform=exec(t)", ["inflow.waveform =", 'unknown function "exec"', "a formula in t"]),
    ("turek-fsi3", "inflow.waveform=1/(t - 3)", ["inflow.waveform =", "not finite at t = 3 s"]),
    ("turek-fsi3", "inflow.profile=t", ["inflow.profile =", 'unknown name "t"; accepted: "y", "H"']),
    # overrides themselves
    ("flap-svk", "mesh.level", ['override = "mesh.level":', "key=value"]),
    # cases that are none
    ("flapsvk", "", ['case = "flapsvk":', "no such case", 'mean "flap-svk"']),
    ("turek-fsi", "", ["case =", '"cylinder-2d1"', 'mean "turek-fsi3"']),
    ("flap-svk.toml", "", ["scene =", "no such file", 'mean "flap-svk"']),
    ("a\0b", "", ['case = "a?b":', "no such case"]),
    ("x" * 5000, "", ["scene =", "cannot be read"]),
]  # fmt: skip

FLAP = "name = 'a'\n[geometry]\nkind = 'flap-channel'\n"
FLOW = "[inflow]\nmean_velocity = 1\n[outlet]\nkind = 'do-nothing'\n"
COOK = "name = 'a'\n[geometry]\nkind = 'cook'\n"
CHANNEL = "name = 'a'\n[geometry]\nkind = 'channel'\nheight = "
SVK = "[solid.flap]\nmaterial = 'st-venant-kirchhoff'\ndensity = 1\n"

TEXTS = [
    ("", ["name:", "missing", "\ngeometry:"]),
    ("name = 'a'\nfluid = ", ["TOML:", "line 2"]),
    ("name = 'a'\nmesh == 3\n", ["TOML:", "line 2, column 7"]),
    ("name = 1" + 5000 * "0", ["TOML:", "too many digits"]),
    ("name = 'a'\n[geometry]\nlength = 1", ["geometry.kind:", "missing", '"channel-cavity"']),
    ("name = 'a'\n[geometry]\nkind = 'flap-chanel'", ['geometry.kind = "flap-chanel":', 'mean "flap-channel"']),
    ("name = 'a'\n[geometry]\nkind = 3", ["geometry.kind = 3:", '"flap-channel"']),
    ("name = 'a'\n[[geometry]]\nkind = 'flap-channel'", ["geometry = a list of 1:", "table"]),
    (FLAP, ["fluid:", "missing", "a fluid, a solid or both"]),
    (FLAP + FLOW, ["fluid:", "missing"]),
    (FLAP + "[fluid]\ndensity = 1\nviscosity = 1", ["inflow:", "missing", "\noutlet:"]),
    (FLAP + FLOW + "[fluid]\ndensity = 1\nviscosity = 1979-05-27", ["fluid.viscosity =", "not a number", "Pa s"]),
    (FLAP + SVK, ["solid.flap.lame_lambda:", "missing", "(young_modulus, poisson_ratio)"]),
    (FLAP + SVK + "young_modulus = 3", ["solid.flap.poisson_ratio:", "missing beside young_modulus"]),
    (FLAP + SVK + "lame_lambda = 1\nyoung_modulus = 3", ["solid.flap.young_modulus:", "exactly one pair"]),
    (FLAP + SVK + "lame_mu = 1\nyoung_modulus = 3\npoisson_ratio = 0.1", ["solid.flap.poisson_ratio:", "given beside"]),
    (FLAP + "[solid.flap]\nlame_mu = 1", ["solid.flap.material:", "missing", '"neo-hookean", "mooney-rivlin"']),
    (FLAP + SVK.replace("density = 1", "lame_mu = 1"), ["solid.flap.density:", "missing; density"]),
    (FLAP + SVK.replace("flap", "beam"), ["solid.beam:", "unknown solid", 'holds "flap"']),
    (FLAP + "[geometry.roof]\n" + SVK + "lame_lambda = 1\nlame_mu = 1", ["fluid: missing;", "\nsolid.roof: missing;"]),
    (FLAP + "[geometry.roof]\n" + FLOW + "[fluid]\ndensity = 1\nviscosity = 1",
     ["solid.flap: missing;", "\nsolid.roof: missing; a scene with geometry.roof needs a fluid and the solids"]),
    (FLAP + "[geometry.roof]\n" + FLOW + "[fluid]\ndensity = 1\nviscosity = 1\n" + SVK.replace("flap", "roof")
     + "lame_lambda = 1\nlame_mu = 1", ["solid.flap: missing;"]),
    (COOK, ["solid: missing;", '"cook" holds "membrane"', "\ntraction: missing; dead traction"]),
    (COOK + SVK.replace("flap", "membrane") + "lame_mu = 1\nlame_lambda = 1", ["traction: missing;", "in Pa"]),
    (COOK + FLOW, ["solid: missing;", "\ntraction: missing", "\ninflow: not accepted", "\noutlet: not accepted"]),
    (COOK.replace("cook", "coook"), ['geometry.kind = "coook":', '"cantilever"', 'mean "cook"']),
    (FLAP + "[sold.flap]\ndensity = 1", ["sold =", "unknown key", 'mean "solid"']),
    (CHANNEL + "1", ["geometry.length: missing;", "length of the channel, m"]),
    (CHANNEL + "-1\nlength = 1", ["geometry.height = -1:", "> 0 in m"]),
    (CHANNEL + "1\nlength = 1\nhieght = 1", ["geometry.hieght = 1:", 'mean "geometry.height"']),
    (CHANNEL + "1\nlength = 1\n[solid.flap]\ndensity = 1", ["solid.flap:", 'the geometry "channel" holds no solid']),
    (CHANNEL + "1\nlength = 1", ["fluid: missing;"]),
]  # fmt: skip


def check(error: SceneError, fragments: list[str]) -> None:
    """One problem, and one more for each fragment that begins a line: one mistake is one problem."""
    message = str(error)
    assert message.startswith(fragments[0])
    for fragment in fragments[1:]:
        assert fragment in message
    for jargon in ("pydantic", "http", "Value error", "Input should", "validation error", "Traceback", "type="):
        assert jargon not in message
    assert len(message.splitlines()) == len(error.problems) == 1 + sum("\n" in fragment for fragment in fragments)


@pytest.mark.parametrize(
    ("case", "override", "fragments"), OVERRIDES, ids=[f"{row[0][:9]} {row[1][:40]}" for row in OVERRIDES]
)
def test_override(case: str, override: str, fragments: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(case, [override] if override else [])
    check(caught.value, fragments)


@pytest.mark.parametrize(("text", "fragments"), TEXTS, ids=[str(number) for number in range(len(TEXTS))])
def test_text(text: str, fragments: list[str]) -> None:
    with pytest.raises(SceneError) as caught:
        Scene.from_toml(text)
    check(caught.value, fragments)


def test_files_and_many_problems_are_told(tmp_path: Path) -> None:
    good = tmp_path / "my-scene.toml"
    good.write_text(CASES["flap-svk"].to_toml())
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    broken = tmp_path / "broken.toml"
    broken.write_text("name = 'a'\n\n[mesh\n")
    huge = tmp_path / "huge.toml"
    huge.write_text("#" * 1_000_001)
    for path, fragments in [
        (tmp_path / "my-scen.toml", ["scene =", "no such file", "my-scene.toml"]), (tmp_path, ["scene =", "folder"]),
        (binary, ["scene =", "UTF-8"]), (broken, ["broken.toml:", "line 3"]), (huge, ["scene =", "1000000 bytes"]),
    ]:  # fmt: skip
        with pytest.raises(SceneError) as caught:
            load_scene(path)
        check(caught.value, fragments)
    with pytest.raises(SceneError) as caught:
        load_scene("flap-svk", ["fluid.density=-1", "mesh.level=9", "solver.start=x", "nme=a"])
    assert [problem.key for problem in caught.value.problems] == ["mesh.level", "fluid.density", "solver.start", "nme"]
    assert caught.value.problems[-1].nearest == "name" and caught.value.problems[0].value == "9"
    with pytest.raises(SceneError) as caught:
        load_scene("flap-mooney-rivlin", ["solid.flap.young_modulus=5"])
    assert [problem.nearest for problem in caught.value.problems] == [None]


def test_the_same_error_in_python_and_between_processes() -> None:
    with pytest.raises(SceneError, match=r"^viscosity = -1: out of range"):
        Newtonian(density=1, viscosity=-1)
    with pytest.raises(SceneError, match=r"^flap_height = 1 m: must be less than height = 0.4 m$"):
        FlapChannel(flap_height=1)
    with pytest.raises(SceneError, match=r"^fluid.viscosity = nan: not a finite"):
        with_values(CASES["flap-svk"], {"fluid.viscosity": float("nan")})
    with pytest.raises(SceneError) as caught:
        load_scene("flapsvk")
    copy = pickle.loads(pickle.dumps(caught.value))
    assert copy.problems == caught.value.problems and str(copy) == str(caught.value)
