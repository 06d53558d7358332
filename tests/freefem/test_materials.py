"""Every material in every form: FreeFEM's stress itself, and real runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import scene_of

from ffsi.files.arrays import read_mesh, read_state
from ffsi.freefem import run_script
from ffsi.hemodynamics.result import Result
from ffsi.reference.from_scene import problem_from_scene
from ffsi.reference.materials import IDENTITY, cofactor, determinant, dilatation
from ffsi.reference.system import System
from ffsi.result.quantities import CHECKED
from ffsi.scene import Scene
from ffsi.scene.materials import MATERIALS, WithFormulation
from ffsi.script.render import parameters, render

# Cook's membrane with a moderate Poisson's ratio, 0.35 or near it, where both forms work.
COMPRESSIBLE = {
    "st-venant-kirchhoff": {"young_modulus": 200.0, "poisson_ratio": 0.35},
    "linear-elastic": {"young_modulus": 200.0, "poisson_ratio": 0.35},
    "neo-hookean": {"young_modulus": 200.0, "poisson_ratio": 0.35},
    "mooney-rivlin": {"c10": 25.0, "c01": 12.0, "bulk_modulus": 222.0},
}
INCOMPRESSIBLE = {"neo-hookean": {"lame_mu": 70.0}, "mooney-rivlin": {"c10": 25.0, "c01": 12.0}}
FORMS = [
    (material, formulation) for material in COMPRESSIBLE for formulation in ("displacement", "mixed", "incompressible")
    if formulation == "displacement" or material in INCOMPRESSIBLE
]  # fmt: skip
# Other pairs of elastic constants, whose formulas stand in the scripts.
LAMBDA_MU, MU_NU = {"lame_lambda": 170.0, "lame_mu": 70.0}, {"lame_mu": 70.0, "poisson_ratio": 0.35}
PAIRS = [
    ("st-venant-kirchhoff", "displacement", LAMBDA_MU), ("st-venant-kirchhoff", "displacement", MU_NU),
    ("neo-hookean", "mixed", LAMBDA_MU), ("neo-hookean", "mixed", MU_NU),
    ("neo-hookean", "incompressible", {"young_modulus": 210.0}),
]  # fmt: skip
FRESH = ("solver.start=rest", "solver.reuse_ratio=0")


def test_all_forms_are_here_and_linear_convergence_is_not_quadratic():
    assert set(COMPRESSIBLE) == set(MATERIALS)
    assert set(INCOMPRESSIBLE) == {name for name, law in MATERIALS.items() if issubclass(law, WithFormulation)}
    # The test of the test.
    for corrections in ([1e-2, 1e-4, 1e-6, 1e-8, 0], [1e-1, 5e-2, 1e-4, 5e-7, 0]):
        with pytest.raises(AssertionError):
            assert_quadratic(pd.DataFrame({"step": 1.0, "correction": corrections}))
    assert_quadratic(pd.DataFrame({"step": 1.0, "correction": [1e-1, 1e-2, 1e-4, 1e-8, 0]}))


def constants_of(material: str, formulation: str) -> dict[str, float]:
    return (INCOMPRESSIBLE if formulation == "incompressible" else COMPRESSIBLE)[material]


def solid_table(material: str, formulation: str, constants: dict[str, float]) -> str:
    table = {"density": 1.0} | constants
    texts = {"material": material} | ({"formulation": formulation} if material in INCOMPRESSIBLE else {})
    entries = [f"{key}={value}" for key, value in table.items()] + [f'{key}="{text}"' for key, text in texts.items()]
    return "{" + ", ".join(entries) + "}"


def cook(material: str, formulation: str, constants: dict[str, float] | None = None) -> tuple[str, ...]:
    table = solid_table(material, formulation, constants or constants_of(material, formulation))
    return ("cook", f"solid.membrane={table}", "traction.y=2")


# FreeFEM's own flux functions -----------------------------------------------------------------------------------------


def rotations(angles: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)


GRADIENTS = np.random.default_rng(5).normal(size=(60, 2, 2)) * 0.3
GRADIENTS = GRADIENTS[determinant(IDENTITY + GRADIENTS) > 0.2][:40]
ANGLES = np.linspace(-3.1, 3.1, len(GRADIENTS))
PRESSURES = 50.0 * np.cos(np.arange(len(GRADIENTS)))
# Arguments grad u by rows and p of what the tests ask for.
ARGUMENTS = {
    "deformed": np.column_stack([GRADIENTS.reshape(-1, 4), PRESSURES]),
    "turned": np.column_stack([(rotations(ANGLES) @ (IDENTITY + GRADIENTS) - IDENTITY).reshape(-1, 4), PRESSURES]),
    "rest": np.zeros((1, 5)),
    "rotation": np.column_stack([(rotations(ANGLES) - IDENTITY).reshape(-1, 4), 0.0 * ANGLES]),
}  # fmt: skip


class Fluxes:
    """What the solid's part of a rendered script computes, alone in a script of a few lines."""

    def __init__(self, scene: Scene, installation: Any, folder: Path):
        """Evaluate all `ARGUMENTS` of the scene's only solid."""
        ((name, self.solid),) = scene.solid.items()
        self.material = problem_from_scene(scene).solids[2].material
        columns = 5 if self.solid.mixed else 4
        line, text = "// " + "-" * 64, render(scene)
        part = text.partition(f"{line} solids: at")[2].partition(f"{line} loads")[0].partition(f"{line} fluid")[0]
        logarithm = "func int LogarithmOfJ" + text.partition("func int LogarithmOfJ")[2].partition("\n}\n")[0] + "\n}"
        mixed, incompressible = int(self.solid.mixed), int(self.solid.incompressible)
        numbers = [f"real {p.variable} = {p.value!r};" for p in parameters(scene) if p.key.startswith(f"solid.{name}.")]
        rows = np.concatenate(list(ARGUMENTS.values()))
        np.savetxt(folder / "arguments.txt", rows[:, :columns], fmt="%.17g")
        script = folder / "case.edp"
        script.write_text("\n".join([
            *numbers, "int nSolids = 1; int[int][int] solidPoints(1);",
            f"int[int] solidMixed = [{mixed}], solidIncompressible = [{incompressible}];", logarithm, f"//{part}",
            f"int n = {len(rows)}, m = {columns};",
            "solidPoints[0].resize(n); ResizeSolids();",
            'ifstream in("arguments.txt");',
            "for (int i = 0; i < n; ++i) for (int j = 0; j < m; ++j) in >> solidArgument[0](i, j);",
            "SolidStress(0, solidArgument[0], solidFlux[0]);",
            'ofstream out("fluxes.txt"); out.precision(17);',
            "for (int i = 0; i < n; ++i) for (int j = 0; j < m; ++j) out << solidFlux[0](i, j) << endl;",
            "for (int i = 0; i < n; ++i) out << solidJ[0][i] << endl;",
            'cout << "@ffsi end status=converged" << endl;',
        ]))  # fmt: skip
        run_script(script, installation=installation, cwd=folder, time_limit=60)
        values = np.loadtxt(folder / "fluxes.txt")
        parts = np.cumsum([len(part) for part in ARGUMENTS.values()])[:-1]
        self.flux = dict(zip(ARGUMENTS, np.split(values[: -len(rows)].reshape(-1, columns), parts), strict=True))
        self.jacobian = dict(zip(ARGUMENTS, np.split(values[-len(rows) :], parts), strict=True))

    def stress(self, name: str) -> np.ndarray:
        """Return the first Piola-Kirchhoff stress, (n, 2, 2)."""
        return self.flux[name][:, :4].reshape(-1, 2, 2)


def name_of(form: tuple[Any, ...]) -> str:
    return ", ".join(" and ".join(part) for part in ([text] if isinstance(text, str) else text for text in form))


@pytest.fixture(scope="module", params=[*FORMS, *PAIRS], ids=name_of)
def fluxes(request, installation, tmp_path_factory) -> Fluxes:
    return Fluxes(scene_of(*cook(*request.param)), installation, tmp_path_factory.mktemp("flux"))


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def test_stress_and_volume_are_those_of_the_checker(fluxes):
    deformation, pressure = IDENTITY + GRADIENTS, PRESSURES[:, None, None]
    if fluxes.solid.mixed:
        expected = fluxes.material.base_stress(GRADIENTS) - pressure * cofactor(deformation)
    else:
        expected = fluxes.material.first_piola(GRADIENTS)
    close(fluxes.stress("deformed"), expected, 1e-12)
    close(fluxes.jacobian["deformed"], determinant(deformation), 1e-14)
    change = expected = dilatation(GRADIENTS)
    if not fluxes.solid.mixed:
        assert fluxes.flux["deformed"].shape[1] == 4
        return
    if not fluxes.solid.incompressible:
        expected = fluxes.material.volume_slope(change) + PRESSURES / fluxes.material.volume_modulus
    close(-fluxes.flux["deformed"][:, 4], expected, 1e-13)


@pytest.fixture
def objective(fluxes):
    if fluxes.solid.material == "linear-elastic":
        pytest.skip("a law of small rotations")
    return fluxes


@pytest.mark.usefixtures("objective")
def test_stress_is_objective_and_none_at_rest(fluxes):
    close(fluxes.stress("turned"), rotations(ANGLES) @ fluxes.stress("deformed"), 1e-12)
    np.testing.assert_allclose(fluxes.flux["turned"][:, 4:], fluxes.flux["deformed"][:, 4:], rtol=0, atol=1e-13)
    modulus = fluxes.solid.young_poisson[0]
    np.testing.assert_allclose(fluxes.flux["rest"], 0.0, atol=1e-15 * modulus)
    np.testing.assert_allclose(fluxes.flux["rotation"], 0.0, atol=5e-15 * modulus)


def assert_quadratic(history: pd.DataFrame) -> None:
    """The last three corrections, at full steps: each at most a multiple of the last one's square, or rounding."""
    assert (history["step"].iloc[-4:-1] == 1).all()
    found = history["correction"].to_numpy()[:-1][-3:]
    assert found[0] < 0.1 and found[-1] < 1e-5
    assert (found[1:] <= np.maximum(30 * found[:-1] ** 2, 1e-11)).all(), found


def assert_checked(result: Result) -> None:
    assert result.converged
    check = {name: result.data["check"][name] for name in CHECKED if result.data["check"][name] is not None}
    assert ("incompressibility" in check) == any(solid.mixed for solid in result.scene.solid.values())
    assert max(check.values()) < 1e-8, check


form = pytest.fixture(lambda request: request.param, params=FORMS, ids=name_of)
membrane = pytest.fixture(lambda form, solved: solved(*cook(*form), *FRESH))


def test_membrane_is_checked_and_converges_quadratically(membrane):
    assert_checked(membrane)
    assert membrane.quantities["tip_uy"] > 1.0, "the load shall be large"
    assert (membrane.history["factorized"].iloc[:-1] == 1).all()
    if membrane.scene.solid["membrane"].material == "linear-elastic":
        assert len(membrane.history) <= 3  # one correction, and its rounding
        return
    assert_quadratic(membrane.history)


@pytest.mark.parametrize("form", [form for form in FORMS if form[1] != "displacement"], ids=name_of)
def test_flap_with_a_pressure_is_checked_and_converges_quadratically(form, solved):
    """Without: test_cases.py."""
    soft = {key: value * (1 if key == "poisson_ratio" else 0.04) for key, value in constants_of(*form).items()}
    table = solid_table(*form, soft)
    result = solved("flap-neo-hookean", f"solid.flap={table}", "inflow.mean_velocity=0.04", *FRESH)
    assert_checked(result)
    assert_quadratic(result.history)


@pytest.mark.parametrize("material", [material for material, formulation in FORMS if formulation == "mixed"])
def test_mixed_form_converges_to_the_displacement_form(material, solved):
    distances = []
    for size in ("2", "1"):
        tips = []
        for formulation in ("displacement", "mixed"):
            found = solved(*cook(material, formulation), *FRESH, *([] if size == "1" else [f"mesh.size_factor={size}"]))
            tips.append([found.quantities["tip_ux"], found.quantities["tip_uy"]])
        distances.append(np.linalg.norm(np.subtract(*tips)) / np.linalg.norm(tips[0]))
    assert distances[1] < 0.7 * distances[0], distances
    assert distances[1] < 3e-3


def test_volume_and_no_displacement_without_a_load(form, membrane, solved):
    """Only where J = 1 in the mean of every vertex's triangles is the area the same."""
    mesh = read_mesh(membrane.directory / "mesh.bin")
    state = read_state(membrane.directory / "point-0001.bin", mesh)
    elements = System.build(problem_from_scene(membrane.scene), mesh).solids[2].elements
    deformation = IDENTITY + np.einsum("tai,tqaj->tqij", state.u[elements.nodes], elements.gradients)
    area, before = (determinant(deformation) * elements.weights).sum(), elements.weights.sum()
    assert before == pytest.approx(membrane.scene.geometry.areas["membrane"], rel=1e-12)
    if form[1] == "incompressible":
        assert abs(area - before) < 1e-9 * before
    else:
        assert abs(area - before) > 1e-3 * before
    result = solved(*cook(*form), "traction.y=0")
    assert result.converged and result.data["newton"] == {"iterations": 0, "factorizations": 0}
    state = read_state(result.directory / "point-0001.bin", read_mesh(result.directory / "mesh.bin"))
    assert (state.u == 0).all() and (state.ps == 0).all()
