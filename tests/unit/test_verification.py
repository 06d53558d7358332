"""The verification table: references, errors, Markdown, and the README's block."""

from pathlib import Path

import pytest

from ffsi import verification
from ffsi.folder import InputError
from ffsi.freefem import FreeFEMError, FreeFEMNotFound
from ffsi.verification import (
    CAVITY,
    Measurement,
    ReferenceSet,
    TextTable,
    cavity_table,
    error_table,
    number,
    percent,
    reference_sets,
    replace_block,
    short,
    to_frame,
)

README = "before\n<!-- verification:begin -->\nold\n<!-- verification:end -->\nafter\n"


def run(case: str = "turek-fsi1", level: int = 2, **changes: object) -> Measurement:
    """A run whose drag and lift are 1 % above the published values of FSI1."""
    data = {
        "case": case, "status": "converged", "failure": "", "reason": "", "level": level, "unknowns": 24000,
        "triangles": 2800, "newton": {"iterations": 6, "factorizations": 1},
        "quantities": {"drag": 1.01 * 14.29426, "lift": 1.01 * 0.763746, "tip_ux": 2.2692e-5, "tip_uy": 8.186e-4},
        "timings": {"script": 2.0, "total": 3.0}, "check": {"momentum": 2e-11, "drag_difference": None},
        "freefem": {"version": "4.9", "solver": "MUMPS"},
    }  # fmt: skip
    return Measurement(case, level, data | changes)


def failed(case: str, level: int) -> Measurement:
    return Measurement(case, level, {"status": "failed", "failure": "crash", "reason": "signal 11", "level": level})


@pytest.fixture
def runs(monkeypatch) -> list[tuple[str, int]]:
    """Replace the runs by given ones; the calls are recorded."""
    calls: list[tuple[str, int]] = []

    def measure(case: str, level: int) -> Measurement:
        calls.append((case, level))
        return run(case, level)

    monkeypatch.setattr(verification, "measure", measure)
    return calls


def test_percent_shows_small_errors_with_more_digits():
    assert [percent(error) for error in (0.01234567, -0.2, 1.5e-5, -2e-6)] == [
        "+1.235 %",
        "-20.000 %",
        "+0.0015 %",
        "-0.00020 %",
    ]
    assert percent(float("nan")) == number(None) == number(float("nan")) == "–"


def test_the_error_is_relative_to_the_size_of_the_reference():
    source = ReferenceSet("paper", {"tip_uy": -0.02})
    assert source.error("tip_uy", -0.018) == pytest.approx(0.1)
    assert source.error("drag", 1.0) != source.error("drag", 1.0)  # NaN


def test_references_of_a_case_come_published_first_and_without_periodic_ones():
    published, independent = reference_sets("turek-fsi1")
    assert (published.source, published.values["drag"]) == ("Featflow", 14.29426)
    assert (independent.source, independent.values["lift"]) == ("hp", 0.76476)
    assert reference_sets("turek-fsi2") == reference_sets("turek-csm3") == reference_sets("flap-svk") == []
    cavity = reference_sets(CAVITY)
    assert sum(source.compared for source in cavity) == 2
    assert {"Tuković Δx 0.1", "solids4foam Δx 0.05"} < {source.source for source in cavity if not source.compared}


def test_text_tables_become_markdown_and_refuse_rows_of_another_width():
    table = TextTable(("case", "error"))
    table.add("a", "1")
    assert table.markdown() == "| case | error |\n| --- | ---: |\n| a | 1 |"
    with pytest.raises(ValueError, match="1 cells for 2 columns"):
        table.add("b")


def test_the_error_table_has_a_row_for_each_source():
    table = error_table([run()])
    assert [row[1] for row in table.body] == ["Featflow", "hp"]
    first = dict(zip(table.head, table.body[0], strict=True))
    assert (first["drag"], first["lift"], first["Δp"]) == ("+1.000 %", "+1.000 %", "–")
    assert (first["seconds"], first["largest check"]) == ("3.0", "2e-11")
    assert dict(zip(table.head, table.body[1], strict=True))["u_x"] == "+0.000 %"


def test_a_run_that_died_is_a_row_that_says_so():
    (row,) = error_table([failed("turek-cfd1", 1)]).body
    assert row[:5] == ["turek-cfd1", "Featflow", "1", "–", "failed (crash)"]
    assert set(row[5:]) == {"–"}
    assert to_frame([failed("turek-cfd1", 1), run()])["status"].tolist() == ["failed", "converged"]


def test_the_frame_holds_values_references_and_errors():
    frame = to_frame([run(level=0), run("turek-cfd1")])
    assert frame["level"].tolist() == [0, 2]
    assert frame.loc[0, "drag_error"] == pytest.approx(0.01)
    assert frame.loc[0, "tip_ux_second_error"] == pytest.approx(0)
    assert frame.loc[1, "lift_reference"] == 1.11905
    columns = list(frame)
    assert columns.index("tip_ux") < columns.index("tip_ux_reference") < columns.index("tip_ux_error")


def test_the_cavity_is_shown_beside_every_published_mesh():
    table = cavity_table([run(CAVITY, 3), run(), failed(CAVITY, 1)])
    assert table.body[0][0] == "this program, level 3, 24000 unknowns"
    assert len(table.body) == 1 + len(reference_sets(CAVITY))
    assert ["solids4foam Δx 0.025", "-0.23563", "-5.2563"] in table.body


def test_the_short_table_has_level_2_and_all_levels_of_fsi1():
    runs = [run("turek-fsi1", level) for level in range(5)] + [run("turek-cfd1", level) for level in range(4)]
    chosen = [(item.case, item.level) for item in short([*runs, run("turek-csm1", 1)])]
    assert chosen == [*(("turek-fsi1", level) for level in range(5)), ("turek-cfd1", 2), ("turek-csm1", 1)]


def test_a_block_is_replaced_and_the_rest_stays():
    new = replace_block(README, "verification", "new\n")
    assert new == README.replace("old", "new")
    assert replace_block(new, "verification", "old") == README


@pytest.mark.parametrize(
    "text",
    ["nothing", README + README, "<!-- verification:end -->\n<!-- verification:begin -->"],
    ids=["missing", "twice", "wrong order"],
)
def test_markers_must_be_there_once_and_in_order(text):
    with pytest.raises(InputError, match="one line <!-- verification:begin -->"):
        replace_block(text, "verification", "new")


def test_everything_is_written(tmp_path, runs, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    assert set(verification.main(None, tmp_path / "results", readme)) == {""}
    assert [level for case, level in runs if case == "turek-fsi1"] == [0, 1, 2, 3, 4]
    assert [level for case, level in runs if case == CAVITY] == [0, 1, 2, 3]
    assert "flap-svk" not in {case for case, _ in runs}
    text = readme.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| turek-fsi1 | hp | 4 | 24000 |" in text
    assert "Written by `ffsi verify` (FreeFEM 4.9 with MUMPS, one thread;" in text
    assert "[verification.md](results/verification.md)" in text
    assert "| turek-cfd2 | Featflow | 3 |" in (tmp_path / "results/verification.md").read_text()
    assert (tmp_path / "results/verification.csv").read_text().startswith("case,level,status")
    assert "turek-csm2" in capsys.readouterr().out


def test_chosen_levels_are_named_and_a_failed_run_leaves_the_readme_alone(tmp_path, runs, monkeypatch, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    assert set(verification.main([1], tmp_path, readme)) == {""}
    assert "`ffsi verify --levels 1`" in readme.read_text()
    readme.write_text(README)
    monkeypatch.setattr(verification, "measure", failed)
    assert set(verification.main([1], None, readme)) == {"crash"}
    assert readme.read_text() == README
    assert "stays as it is" in capsys.readouterr().err


def test_outputs_are_refused_before_anything_runs(tmp_path, runs):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        verification.main([0], tmp_path / "file")
    with pytest.raises(InputError, match="there is no file"):
        verification.main([0], None, tmp_path / "README.md")
    with pytest.raises(InputError, match="file: the text needs"):
        verification.main([0], None, tmp_path / "file")
    assert runs == []


def test_a_process_that_dies_is_a_measurement_but_a_missing_freefem_ends_everything(monkeypatch, capsys):
    def dies(*_: object, **__: object) -> None:
        raise FreeFEMError("killed", "signal 9", log=Path("log"))

    def missing(*_: object, **__: object) -> None:
        raise FreeFEMNotFound("missing-binary", "no FreeFem++")

    monkeypatch.setattr(verification, "solve", dies)
    assert verification.measure("turek-cfd1", 0).failure == "crash"
    assert "turek-cfd1 level 0: FreeFEM, killed: signal 9" in capsys.readouterr().err
    monkeypatch.setattr(verification, "solve", missing)
    with pytest.raises(FreeFEMNotFound):
        verification.measure("turek-cfd1", 0)
