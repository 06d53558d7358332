"""Sensitivities of steady scenes against differences of solutions, the checker, and what it must catch."""

import contextlib
import json
import re

import pandas as pd
import pytest
from conftest import scene_of

import ffsi
from ffsi.cli.main import main
from ffsi.files import folder
from ffsi.reference import check_run
from ffsi.run.chain import run_chain
from ffsi.run.sensitivities import refuse_unknown
from ffsi.scene import CASES

STEADY = [name for name, scene in CASES.items() if scene.time is None]
STEP = 3e-3
EXACT = "solver.tolerance=1e-12"
# Of the quantity, per relative change of the parameter: what is left of a solution's rounding over the step.
NOISE = 1e-9


@pytest.fixture(scope="module")
def differentiated(tmp_path_factory):
    def differentiated(case, *settings):
        out = tmp_path_factory.mktemp(case)
        return ffsi.solve(scene_of(case, *settings), out, sensitivities=True)

    return differentiated


@pytest.mark.parametrize("case", STEADY)
def test_they_are_those_of_differences_of_solutions(differentiated, tmp_path, case):
    result = differentiated(case, EXACT)
    assert result.checked and result.data["check"]["sensitivities_difference"] < 1e-8
    found, values = result.data["sensitivities"], result.parameters
    keys = [key for key in next(iter(found.values())) if values[key]][:8]  # with a size, for the step
    points = [
        {name: values[name] * (1 + place * STEP * (name == key)) for name in keys}
        for key in keys
        for place in (1, -1, 2, -2)
    ]
    solved = run_chain(result.scene, points, tmp_path / "chain", check=False, draw="none")
    assert len(keys) >= 4 and all(point.solved for point in solved)
    for number, key in enumerate(keys):
        for name, slopes in found.items():
            up, down, far, back = (point.quantities[name] for point in solved[4 * number : 4 * number + 4])
            exact = (8 * (up - down) - (far - back)) / (12 * STEP * values[key])
            noise = NOISE * abs(result.quantities[name] / values[key])
            assert slopes[key]["derivative"] == pytest.approx(exact, rel=1e-5, abs=noise), (name, key)


def test_wrong_ones_are_caught_and_the_run_is_as_it_was(differentiated, solved):
    result = differentiated("flap-svk")
    assert result.checked and result.data["check"]["sensitivities_difference"] < 1e-8
    path = result.directory / "sensitivities-0001.json"
    slopes = json.loads(path.read_text())
    slopes["fluid.viscosity"]["drag"] *= 1 + 1e-5
    path.write_text(json.dumps(slopes))
    (failure,) = check_run(result.directory, result.scene).failures
    assert failure.startswith("sensitivities_difference") and "drag by fluid.viscosity" in failure


def test_in_time_they_are_differences_of_runs(capsys, tmp_path):
    settings = ["--set", "mesh.level=0", "--set", "time.step=0.01", "--set", "time.end=0.1"]
    command = [
        "sensitivities", "turek-csm3", *settings, "--of", "tip_uy_last", "--to",
        "gravity.y,solid.beam.density,solid.beam.lame_mu",
    ]  # fmt: skip
    with pytest.raises(SystemExit) as stopped:
        main([*command, "--json", "--out", str(tmp_path / "runs")])
    found = json.loads(capsys.readouterr().out)["logarithmic"]
    assert stopped.value.code == 0 and (tmp_path / "runs" / "sweep.csv").is_file()
    # So small a motion is linear in its load, and of density and shear modulus their ratio alone counts.
    slopes = {key: of["tip_uy_last"] for key, of in found.items()}
    assert slopes["gravity.y"] == pytest.approx(1, abs=0.02)
    assert 0.1 < slopes["solid.beam.lame_mu"] == pytest.approx(-slopes["solid.beam.density"], abs=1e-3)
    with pytest.raises(SystemExit, match="2"):
        main(["sensitivities", "turek-csm3", *settings])
    assert "every number costs two runs" in capsys.readouterr().err


def test_nothing_of_the_run_is_moved(differentiated, solved):
    with_them, plain = differentiated("turek-fsi1"), solved("turek-fsi1")
    assert with_them.quantities == pytest.approx(plain.quantities, rel=1e-9)
    assert "sensitivities" not in plain.data and plain.data["check"]["sensitivities_difference"] is None
    assert not (plain.directory / folder.numbered(folder.SENSITIVITIES, 1)).exists()


def test_table(differentiated):
    result = differentiated("flap-svk")
    keys = ["fluid.viscosity", "inflow.mean_velocity"]
    table = ffsi.sensitivities(result, of=["drag"], to=(key for key in [*keys, *keys]))
    assert list(table.columns) == ["drag"] and list(table.index) == keys
    relative = ffsi.sensitivities(result, logarithmic=True)
    scaled = table["drag"] * pd.Series(result.parameters) / result.quantities["drag"]
    assert relative["drag"]["fluid.viscosity"] == pytest.approx(scaled["fluid.viscosity"], rel=1e-12)
    # A viscosity, a density, a velocity and moduli times what keeps Reynolds' and Cauchy's numbers: the force follows.
    keys = ["fluid.viscosity", "fluid.density", "solid.flap.lame_mu", "solid.flap.lame_lambda"]
    assert relative["drag"][keys].sum() == pytest.approx(1, abs=1e-6)
    with pytest.raises(ffsi.InputError, match=r'did you mean "tip_u[xy]"'):
        ffsi.sensitivities(result, of=["tip_u"])


def test_command_line(capsys):
    settings = ["--set", "mesh.level=0", "--of", "tip_uy", "--to", "traction.y", "--json"]
    with contextlib.suppress(SystemExit):
        main(["sensitivities", "cook", *settings])
    printed = json.loads(capsys.readouterr().out)
    assert printed["logarithmic"]["traction.y"]["tip_uy"] == pytest.approx(0.848, abs=1e-3)  # it stiffens


@pytest.mark.parametrize(("case", "names"), [
    ("turek-fsi1", ("--of", "drug")), ("turek-fsi1", ("--to", "fluid.viscosty")),
    ("turek-fsi3", ("--of", "drag", "--to", "fluid.viscosity")), ("turek-fsi3", ("--of", "tip_uy_lost")),
    ("turek-fsi1", ("--set", "inflow.mean_velocity=0", "--to", "inflow.mean_velocity")),
])  # fmt: skip
def test_unknown_names_are_refused_before_anything_is_written(tmp_path, case, names, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["sensitivities", case, *names, "--out", str(tmp_path / "out")])
    assert re.search("did you mean|= 0 is an end of what is accepted", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("case", [name for name in CASES if name not in STEADY])
def test_in_time_the_quantities_of_a_history_are_accepted_and_no_others(solved, case):
    scene = scene_of(case, "time.end=0.02", "time.step=0.01")
    names = set(solved(case, "time.end=0.02", "time.step=0.01").data["time"]["largest"]) - {"min_jacobian"}
    refuse_unknown(scene, [f"{name}_last" for name in names], [])
    for name in {"drag", "lift_coefficient", "tip_ux", "flow_rate_in", "flow_rate_out", "pressure_drop"} - names:
        with pytest.raises(ffsi.InputError, match=f"'{name}_last' is no quantity"):
            refuse_unknown(scene, [f"{name}_last"], [])
