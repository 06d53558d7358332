"""Newton's method as `newton.csv` tells it: quadratic from rest, kept factors, refused steps, continuation."""

import numpy as np
import pandas as pd
import pytest

COLUMNS = ["point", "load", "stage", "unknowns", "iteration", "residual", "correction", "step", "factorized"]
COLUMNS += ["min_jacobian", "seconds"]
LIMIT = 0.5


def final_stage(history: pd.DataFrame) -> pd.DataFrame:
    return history[history["stage"] == history["stage"].max()]


def orders(residuals: np.ndarray) -> np.ndarray:
    logs = np.log(residuals)
    falls = np.diff(logs)
    return falls[1:] / falls[:-1]


from_rest = pytest.fixture(lambda solved: solved("turek-fsi1"), scope="module")


def test_newton_converges_quadratically_with_own_jacobians(from_rest, solved):
    assert list(from_rest.history) == COLUMNS
    history = from_rest.history
    assert len(history) - 1 <= 7 and history["iteration"].tolist() == list(range(len(history)))
    assert from_rest.data["newton"]["iterations"] == len(history) - 1 and (history["load"] == 1).all()
    assert history["residual"].iloc[-1] <= from_rest.scene.solver.tolerance
    assert from_rest.history["factorized"].tolist() == [1] * (len(from_rest.history) - 1) + [0]
    assert (history["step"].iloc[-4:-1] == 1).all()
    assert_quadratic(history["residual"].to_numpy())
    # The test of the test.
    with pytest.raises(AssertionError):
        assert_quadratic(np.array([0.1, 1e-3, 1e-5, 1e-7]))
    with pytest.raises(AssertionError):
        assert_quadratic(np.array([0.1, 1e-2, 1e-3, 1e-4]))
    result = solved("turek-fsi1", "mesh.level=1", "solver.start=rest")
    assert result.converged and result.history["stage"].max() == 1 and len(result.history) - 1 <= 7
    assert_quadratic(result.history["residual"].to_numpy())


def assert_quadratic(residuals: np.ndarray) -> None:
    """The last three full steps: r <= 100 r^2, and at the end an order that no linear convergence reaches."""
    last = residuals[-4:]
    assert last[0] < 0.5 and (last[1:] <= 100 * last[:-1] ** 2).all() and orders(last)[-1] > 1.6


@pytest.mark.parametrize("level, stages", [(1, 2), (2, 3)])
def test_the_coarse_solution_saves_factorisations_on_the_fine_mesh(solved, level, stages):
    result = solved("turek-fsi1", f"mesh.level={level}")
    assert result.history["stage"].unique().tolist() == list(range(1, stages + 1))
    fine = final_stage(result.history)
    assert fine["residual"].iloc[0] < 0.9 and (fine["unknowns"] == result.data["unknowns"]).all()
    assert fine["factorized"].sum() <= 2
    assert result.data["newton"] == {"iterations": len(fine) - 1, "factorizations": fine["factorized"].sum()}


def test_start_and_reuse_do_not_change_the_solution(solved):
    coarse, rest = solved("turek-fsi1", "mesh.level=1"), solved("turek-fsi1", "mesh.level=1", "solver.start=rest")
    fresh = solved("turek-fsi1", "mesh.level=1", "solver.reuse_ratio=0")
    iterations = len(final_stage(fresh.history)) - 1
    assert final_stage(fresh.history)["factorized"].sum() == iterations >= 2
    for other in (rest, fresh):
        for quantity in ("drag", "lift", "tip_ux", "tip_uy"):
            assert other.quantities[quantity] == pytest.approx(coarse.quantities[quantity], rel=1e-7)
    history = solved("flap-svk").history
    steps = history["step"].iloc[:-1]
    assert (
        (steps > 0).all() and set(np.log2(steps)) <= set(-np.arange(10.0)) and 0.5 in set(steps)
    )  # halves, no quarters
    assert steps.iloc[-1] == 1


def test_steps_with_a_too_small_jacobian_are_refused(solved):
    """With harmonic mesh motion J falls to 0.4 in the fluid: a limit above it lets no such state pass."""
    harmonic = [f"mesh_motion.{value}" for value in ("kind=harmonic", "stiffness_exponent=2", "divergence_weight=10")]
    usual = solved("flap-svk", *harmonic)
    assert usual.quantities["min_jacobian"] < LIMIT - 0.05
    result = solved("flap-svk", *harmonic, f"solver.minimum_jacobian={LIMIT - 1e-9}")
    assert (result.status, result.failure) == ("failed", "not-converged")
    assert result.reached["min_jacobian"] > LIMIT - 1e-6
    accepted = result.history[result.history["step"] > 0]
    assert accepted["min_jacobian"].min() > LIMIT - 1e-6 and result.history["load"].iloc[-1] < 1


def test_continuation_and_the_last_good_state_without_convergence(solved):
    direct = solved("turek-cfd2")
    few = direct.data["newton"]["iterations"] - 3
    result = solved("turek-cfd2", f"solver.max_iterations={few}")
    assert result.converged
    loads = result.history["load"]
    assert 0 < loads.min() < 1 and loads.iloc[-1] == 1
    assert (result.history["iteration"] <= few).all()
    for quantity in ("drag", "lift", "pressure_drop"):
        assert result.quantities[quantity] == pytest.approx(direct.quantities[quantity], rel=1e-7)
    result = solved("turek-fsi1", "solver.max_iterations=1")
    assert (result.status, result.failure) == ("failed", "not-converged")
    assert "solver.max_iterations" in result.reason and (result.directory / "failed.bin").is_file()
    assert not (result.directory / "point-0001.json").exists()
    loads = result.history["load"].unique()
    assert loads[0] == 1 and (np.diff(loads) < 0).all() and loads[-1] < 0.01


def test_coarser_meshes_are_solved_to_the_accuracy_of_a_guess(solved):
    """Their last residual is far above the tolerance, and the finest mesh takes no more iterations for it."""
    result = solved("turek-fsi1", "mesh.level=1")
    assert result.converged
    coarse, fine = (part["residual"].to_numpy() for _, part in result.history.groupby("stage"))
    assert 1e-8 < coarse[-1] < 0.1 and fine[-1] <= result.scene.solver.tolerance and len(coarse) <= len(fine) <= 9
