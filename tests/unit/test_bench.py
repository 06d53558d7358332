"""The benchmark: ratios, medians, tables and what is written."""

import pandas as pd
import pytest

from ffsi import bench
from ffsi.bench import RATIOS, level_table, ratio_table, ratios, to_row
from ffsi.folder import InputError
from ffsi.verification import Measurement

TIMINGS = {
    "mesh": 0.1, "operators": 0.3, "residual": 0.05, "jacobian": 0.35, "factorize": 0.5, "solve": 0.1, "output": 0.15,
    "check": 0.05, "script": 2.0, "total": 3.0, "pictures": 0.7,
    "one_factorization": 0.5, "one_jacobian": 0.25, "one_residual": 0.005, "one_solve": 0.01,
}  # fmt: skip
README = "<!-- bench:begin -->\n<!-- bench:end -->\n"


def run(level: int = 2, factor: float = 1.0, case: str = "turek-fsi1") -> Measurement:
    """A run with these timings; `factor` multiplies all but those of a single factorisation, Jacobian, ..."""
    timings = {name: value if name.startswith("one_") else factor * value for name, value in TIMINGS.items()}
    return Measurement(
        case, level,
        {
            "case": case, "status": "converged", "failure": "", "level": level, "unknowns": 1000 * level + 5000,
            "triangles": 2800, "newton": {"iterations": 6, "factorizations": 1}, "timings": timings,
            "quantities": {"drag": 14.3, "lift": 0.76, "tip_ux": 2.2e-5, "tip_uy": 8.1e-4},
            "freefem": {"version": "4.9", "solver": "MUMPS"},
        },
    )  # fmt: skip


def failed(case: str, level: int) -> Measurement:
    return Measurement(case, level, {"status": "failed", "failure": "not-converged", "reason": "J too small"})


def test_ratios_are_sums_of_phases_over_one_factorisation():
    found = ratios(TIMINGS)
    assert found == pytest.approx({"newton": 2.0, "one_jacobian": 0.5, "one_residual": 0.01, "overhead": 1.2})
    assert {ratio.name: ratio.bound for ratio in RATIOS} == {
        "newton": 5,
        "one_jacobian": 1,
        "one_residual": 1 / 20,
        "overhead": 4,
    }


def test_a_phase_that_was_not_timed_gives_no_ratio():
    found = ratios({name: value for name, value in TIMINGS.items() if name != "check"})
    assert found["overhead"] != found["overhead"]  # NaN
    assert found["newton"] == pytest.approx(2)
    assert all(value != value for value in ratios({}).values())


def test_repeated_runs_give_medians():
    row = to_row([run(factor=1), run(factor=10), run(factor=2)])
    assert (row["seconds"], row["script_seconds"]) == (6.0, 4.0)
    assert row["ratio_newton"] == pytest.approx(4)
    assert (row["runs"], row["status"]) == (3, "converged")
    assert row["error_0_drag"] == pytest.approx((14.3 - 14.29426) / 14.29426)
    assert row["error_1_lift"] == pytest.approx((0.76 - 0.76476) / 0.76476)


def test_tables_mark_what_is_above_its_bound_and_stay_whole_after_a_failure():
    rows = [to_row([run()]), to_row([run(factor=3)]), to_row([failed("turek-fsi1", 3)])]
    table = ratio_table(rows)
    assert table.head[3] == "residual + Jacobian + factorise + solve (below 5)"
    assert table.body[0] == ["2", "7000", "0.500", "2.00", "0.50", "0.010", "1.20"]
    assert table.body[1][3] == "6.00 !"
    assert set(table.body[2][1:]) == {"–"}
    assert level_table(rows, "turek-fsi1").body[0][3:5] == ["2.00", "3.00"]


def test_a_case_without_published_values_still_has_times():
    rows = [to_row([run(case="flap-svk")])]
    assert level_table(rows, "flap-svk").body == [["2", "7000", "2800", "2.00", "3.00", "6", "1"]]
    assert bench.draw(rows, "flap-svk") is not None


def test_table_picture_and_readme_are_written(tmp_path, monkeypatch, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    monkeypatch.setattr(bench, "measure", lambda case, level: run(level, level + 1))
    assert bench.main([0, 1], repeat=2, out=tmp_path / "results", readme=readme) == ["", "", "", ""]
    frame = pd.read_csv(tmp_path / "results/bench-turek-fsi1.csv")
    assert frame["script_seconds"].tolist() == [2, 4]
    assert (tmp_path / "results/bench-turek-fsi1.png").read_bytes().startswith(b"\x89PNG")
    text = readme.read_text()
    assert "Written by `ffsi bench --levels 0,1 --repeat 2`" in text
    assert "(results/bench-turek-fsi1.png)" in text
    out = capsys.readouterr().out
    assert "errors against hp" in out
    assert "one residual (below 0.05)" in out


def test_a_failed_run_is_returned_and_leaves_the_readme_alone(tmp_path, monkeypatch):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    monkeypatch.setattr(bench, "measure", failed)
    assert bench.main([0], readme=readme) == ["not-converged"]
    assert readme.read_text() == README


def test_at_least_one_run():
    with pytest.raises(InputError, match="at least one run, not 0"):
        bench.main([0], repeat=0)
