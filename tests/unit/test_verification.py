"""The verification table: references, errors, Markdown, and the README's block."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipkinc

from ffsi.files.errors import InputError
from ffsi.freefem import FreeFEMError, FreeFEMNotFound
from ffsi.scene import load_scene
from studies.harness import Run, replaced
from studies.tables import Column, columns, number, percent, table, unsigned
from studies.verification import steady
from studies.verification.sources import ReferenceSet, reference_sets
from studies.verification.steady import CAVITY, Variant, cavity_table, error_table, measure, to_frame

README = "before\n<!-- verification:begin -->\nold\n<!-- verification:end -->\nafter\n"


def run(case: str = "turek-fsi1", level: int = 2, **changes: object) -> Run:
    data = {
        "case": case, "status": "converged", "failure": "", "reason": "", "level": level, "unknowns": 24000,
        "triangles": 2800, "newton": {"iterations": 6, "factorizations": 1},
        "quantities": {"drag": 1.01 * 14.29426, "lift": 1.01 * 0.763746, "tip_ux": 2.2681e-5, "tip_uy": 8.186e-4},
        "timings": {"script": 2.0, "total": 3.0}, "check": {"momentum": 2e-11, "drag_difference": None},
        "freefem": {"version": "4.9", "solver": "MUMPS"},
    }  # fmt: skip
    return Run(case, data | changes)


def variant_run(variant: Variant, level: int, **quantities: float) -> Run:
    return Run(variant.case, run(variant.case, level, quantities=quantities).data, variant.name)


def failed(variant: Variant, level: int) -> Run:
    data = {"status": "failed", "failure": "crash", "reason": "signal 11", "level": level}
    return Run(variant.case, data, variant.name)


@pytest.fixture
def calls(monkeypatch) -> list[tuple[str, str, int]]:
    calls: list[tuple[str, str, int]] = []

    def measure(variant: Variant, level: int) -> Run:
        calls.append((variant.case, variant.name, level))
        return Run(variant.case, run(variant.case, level).data, variant.name)

    monkeypatch.setattr(steady, "measure", measure)
    return calls


def test_columns_errors_references_and_the_short_table():
    assert [percent(error) for error in (0.01234567, -0.2, 1.5e-5, -2e-6)] == [
        "+1.235 %", "-20.000 %", "+0.0015 %", "-0.00020 %",
    ]  # fmt: skip
    assert percent(float("nan")) == number(None) == number(float("nan")) == unsigned(float("nan")) == "–"
    assert unsigned(-0.002) == unsigned(0.002) == "0.200 %"
    source = ReferenceSet("paper", {"tip_uy": -0.02})
    assert source.error("tip_uy", -0.018) == pytest.approx(0.1)
    assert source.error("drag", 1.0) != source.error("drag", 1.0)  # NaN
    published, independent = reference_sets("turek-fsi1")
    assert (published.source, published.values["drag"]) == ("Featflow", 14.29426)
    assert (independent.source, independent.values["lift"]) == ("hp", 0.76476)
    assert reference_sets("turek-fsi2") == reference_sets("turek-csm3") == reference_sets("flap-svk") == []
    cavity = reference_sets(CAVITY)
    assert sum(source.compared for source in cavity) == 2
    assert {"Tuković Δx 0.1", "solids4foam Δx 0.05"} < {source.source for source in cavity if not source.compared}
    found = columns("case | u_x in m = tip_ux :.2f | error :%")
    made = table([{"case": "a", "tip_ux": 1.234, "error": 0.01}, {"case": "b", "error": float("nan")}], found)
    assert made.markdown() == (
        "| case | u_x in m | error |\n| --- | ---: | ---: |\n| a | 1.23 | +1.000 % |\n| b | – | – |"
    )
    assert [Column("", "x", bound=1.5).cell({"x": x}) for x in (1.5, 1.51, -2, float("nan"), None, "text")] == [
        "1.5", "1.51 !", "-2 !", "– !", "–", "text",
    ]  # fmt: skip
    known = [run("turek-fsi1", level) for level in range(5)] + [run("turek-cfd1", level) for level in range(4)]
    known += [run("turek-csm1", 1), *(run(CAVITY, level) for level in range(4))]
    errors = steady.chosen(known)
    levels = list(dict.fromkeys((row[0], row[2]) for row in errors.body))
    fsi1 = [("turek-fsi1", str(level)) for level in range(5)]
    assert levels == [*fsi1, ("turek-cfd1", "2"), ("turek-csm1", "1"), (CAVITY, "2")]


def test_tables_and_frames_of_errors():
    table = error_table([run()])
    assert [row[1] for row in table.body] == ["Featflow", "hp"]
    first = dict(zip(table.head, table.body[0], strict=True))
    assert (first["drag"], first["lift"], first["Δp"]) == ("+1.000 %", "+1.000 %", "–")
    assert (first["seconds"], first["largest check"]) == ("3.0", "2e-11")
    assert dict(zip(table.head, table.body[1], strict=True))["u_x"] == "+0.000 %"
    assert dict(zip(table.head, error_table([run(CAVITY)]).body[0], strict=True))["drag"] == "–"  # nothing published
    (row,) = error_table([failed(Variant("turek-cfd1"), 1)]).body
    assert row[:5] == ["turek-cfd1", "Featflow", "1", "–", "failed (crash)"] and set(row[5:]) == {"–"}
    assert to_frame([failed(Variant("turek-cfd1"), 1), run()])["status"].tolist() == ["failed", "converged"]
    table = cavity_table([run(CAVITY, 3), run(), failed(Variant(CAVITY), 1)])
    assert table.body[0][0] == "this program, level 3, 24000 unknowns"
    assert len(table.body) == 1 + len(reference_sets(CAVITY))
    assert ["solids4foam Δx 0.025", "-0.23563", "-5.2563"] in table.body
    frame = to_frame([run(level=0), run("turek-cfd1")])
    assert frame["level"].tolist() == [0, 2] and frame.loc[0, "drag_error"] == pytest.approx(0.01)
    assert frame.loc[0, "tip_ux_second_error"] == pytest.approx(0) and frame.loc[1, "lift_reference"] == 1.11905
    columns = list(frame)
    assert columns.index("tip_ux") < columns.index("tip_ux_reference") < columns.index("tip_ux_error")
    flap = variant_run(steady.FLAPS[0], 2, tip_ux=0.03, tip_uy=1.0, drag=2.02, tip_x=5.0)
    frame = to_frame([run(), flap, variant_run(steady.LOADS[0], 2, tip_ux=-0.05, tip_uy=0.3)])
    assert frame["variant"].tolist() == ["", "inflow-0.055", "load-1"] and frame["drag"].tolist()[1] == 2.02
    assert frame.loc[2, "source"] == "elastica" and frame.loc[2, "tip_uy_reference"] == 0.301721
    assert "tip_x" not in frame


def test_a_block_is_replaced_and_the_rest_stays(tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    new = replaced(readme, "verification", "new\n")
    assert new == README.replace("old", "new")
    readme.write_text(new)
    assert replaced(readme, "verification", "old") == README


@pytest.mark.parametrize("text", [
    "nothing", README + README, "<!-- verification:end -->\n<!-- verification:begin -->",
], ids=["missing", "twice", "wrong order"])  # fmt: skip
def test_markers_must_be_there_once_and_in_order(tmp_path, text):
    (tmp_path / "README.md").write_text(text)
    with pytest.raises(InputError, match="one line <!-- verification:begin -->"):
        replaced(tmp_path / "README.md", "verification", "new")


def test_everything_is_written(tmp_path, calls, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    assert set(steady.main(out=tmp_path / "results", readme=readme)) == {""}
    levels = {key: [level for *found, level in calls if tuple(found) == key] for key in {call[:2] for call in calls}}
    assert levels["turek-fsi1", ""] == levels["flap-mooney-rivlin-roof", "inflow-0.055"] == [0, 1, 2, 3, 4]
    assert levels[CAVITY, ""] == levels["cook", "incompressible"] == levels["cantilever", "load-10"] == [0, 1, 2, 3]
    assert levels["cook", "linear"] == [0, 1, 2, 3] and levels["cook", "nearly-incompressible-displacement"] == [0]
    assert "flap-svk" not in {case for case, *_ in calls}
    text = readme.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    assert "| turek-fsi1 | hp | 4 | 24000 |" in text
    assert text.count("Written by `python -m studies verify` (FreeFEM 4.9 with MUMPS, one thread;") == 1
    assert "[verification.md](results/verification.md)" in text
    assert "elastica" not in text
    document = (tmp_path / "results/verification.md").read_text()
    assert "| turek-cfd2 | Featflow | 3 |" in document
    assert document.count("\n## ") == 3 and text.count("| this program, level ") == 2
    assert (tmp_path / "results/verification.csv").read_text().startswith("case,variant,level,status")
    shown = capsys.readouterr()
    assert "turek-csm2" in shown.out and "wrote the block verification" in shown.err


def test_a_failed_run_leaves_the_readme_alone(tmp_path, calls, monkeypatch, capsys):
    readme = tmp_path / "README.md"
    readme.write_text(README)
    monkeypatch.setattr(steady, "measure", failed)
    assert set(steady.main(readme=readme)) == {"crash"} and readme.read_text() == README
    assert "stays as it is" in capsys.readouterr().err


def test_outputs_are_refused_before_anything_runs(tmp_path, calls):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        steady.main(out=tmp_path / "file")
    with pytest.raises(InputError, match="there is no file"):
        steady.main(readme=tmp_path / "README.md")
    with pytest.raises(InputError, match="file: the text needs"):
        steady.main(readme=tmp_path / "file")
    assert calls == []


def test_a_process_that_dies_is_a_measurement_but_a_missing_freefem_ends_everything(monkeypatch, capsys):
    def dies(*_: object, **__: object) -> None:
        raise FreeFEMError("killed", "signal 9", log=Path("log"))

    def missing(*_: object, **__: object) -> None:
        raise FreeFEMNotFound("missing-binary", "no FreeFem++")

    monkeypatch.setattr("studies.harness.solve", dies)
    assert measure(Variant("turek-cfd1"), 0).failure == "crash"
    assert measure(steady.NEO_HOOKEAN, 0).variant == "neo-hookean"
    said = capsys.readouterr().err
    assert "turek-cfd1 level 0: FreeFEM, killed: signal 9" in said
    assert "cook neo-hookean level 0: FreeFEM, killed: signal 9" in said
    monkeypatch.setattr("studies.harness.solve", missing)
    with pytest.raises(FreeFEMNotFound):
        measure(Variant("turek-cfd1"), 0)


# Variants of cases ----------------------------------------------------------------------------------------------------

VARIANTS = [*steady.MEMBRANES, *steady.LOADS, *steady.FLAPS]


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda item: f"{item.case}-{item.name}")
def test_settings_of_every_variant_are_a_scene(variant):
    assert load_scene(variant.case, list(variant.settings)).name == variant.case


def test_variants_have_constants_and_references_of_their_own():
    scenes = {item.name: load_scene(item.case, list(item.settings)) for item in steady.MEMBRANES}
    solids = {name: scene.solid["membrane"] for name, scene in scenes.items()}
    constants = {name: solid.young_poisson for name, solid in solids.items()}
    assert constants["linear"] == pytest.approx((70.0, 1 / 3), rel=1e-15)
    assert constants["neo-hookean"] == (200.0, 0.35) and constants["incompressible"] == pytest.approx((3.0, 0.5))
    assert constants["nearly-incompressible"] == constants["nearly-incompressible-displacement"] == (240.565, 0.4999)
    assert solids.pop("linear").material == "linear-elastic"
    assert [solid.formulation for solid in solids.values()] == [
        "displacement", "incompressible", "mixed", "displacement",
    ]  # fmt: skip
    tractions = [scene.traction.y for scene in scenes.values()]
    assert tractions[0] * steady.LINEAR.times == 6.25 and tractions[1:] == [4.0, 0.05, 6.25, 6.25]
    assert reference_sets("cook") == reference_sets("cantilever") == []
    assert {variant.name for variant in VARIANTS if not reference_sets(variant.case, variant.name)} == {"inflow-0.055"}
    calculix, aster, *others = reference_sets("cook", "linear")
    assert (calculix.values["tip_uy"], aster.values["tip_uy"]) == (32.27, 32.20)
    assert [source.compared for source in others] == [False, False]


def elastica_tip(load: float) -> tuple[float, float]:
    """Deflection and shortening over the length for P L^2 / (E I) = load, by elliptic integrals.

    With s along the beam, t its slope and t1 that of the tip, t'' = -load cos t has the integral
    t' = sqrt(2 load (sin t1 - sin t)); sin t = 2 m sin^2 f - 1 with 2 m = 1 + sin t1 turns it into elliptic integrals.
    """

    def integrals(m):
        start = np.arcsin(1 / np.sqrt(2 * m))
        return ellipkinc(np.pi / 2, m) - ellipkinc(start, m), ellipeinc(np.pi / 2, m) - ellipeinc(start, m)

    m = brentq(lambda m: integrals(m)[0] - np.sqrt(load), 0.5 + 1e-9, 1 - 1e-12, xtol=1e-15)
    return 1 - 2 * integrals(m)[1] / np.sqrt(load), 1 - np.sqrt(2 * (2 * m - 1) / load)


@pytest.mark.parametrize("variant", steady.LOADS, ids=lambda item: item.name)
def test_values_of_the_elastica_are_its_elliptic_integrals(variant):
    (source,) = reference_sets(variant.case, variant.name)
    deflection, shortening = elastica_tip(float(variant.text))
    assert source.values == {
        "tip_uy": pytest.approx(deflection, abs=6e-7), "tip_ux": pytest.approx(-shortening, abs=6e-7),
    }  # fmt: skip


def test_linear_problems_and_membranes(monkeypatch):
    solved = variant_run(steady.LINEAR, 1, tip_uy=0.03227, tip_ux=1.0), failed(steady.LINEAR, 1)
    for run in solved:
        monkeypatch.setattr(steady, "solved", lambda *_, run=run: run)
        value = measure(steady.LINEAR, 1).value("tip_uy")
        assert value == pytest.approx(32.27, rel=1e-13) if not run.failure else value != value
    found = [
        variant_run(steady.NEARLY_INCOMPRESSIBLE, level, tip_uy=6.9083 * (1.004 - 0.001 * level)) for level in (0, 1)
    ]
    first, second = (
        dict(zip(steady.membrane_table(found).head, row, strict=True)) for row in steady.membrane_table(found).body
    )
    assert (first["change"], second["change"]) == ("–", "0.100 %") and second["error against"] == "published +0.300 %"
    other = [variant_run(steady.LINEAR, 0, tip_uy=32.27), failed(steady.LINEAR, 1)]
    assert (steady.LINEAR.text, "Elmer (hexahedra)", "32.2800") in steady.published_table().body
    assert "failed (crash)" in steady.membrane_table(other).body[1]


def test_cantilever_and_flaps_by_level():
    variant = steady.LOADS[1]
    coarse = variant_run(variant, 0, tip_ux=-0.2, tip_uy=0.5)
    fine = variant_run(variant, 1, tip_ux=1.01 * -0.160642, tip_uy=0.99 * 0.493457)
    first, second = steady.load_table([coarse, fine]).body
    assert first[:4] == ["2", "0", "24000", "3.0"]
    assert second[4:10] == ["0.488522", "0.493457", "-1.000 %", "0.162248", "0.160642", "+1.000 %"]
    variant, tips = steady.FLAPS[0], [(0.0, 1.01, 2.0), (0.0, 1.0, 2.02), (0.03, 1.0, 2.02)]
    found = [variant_run(variant, i, tip_ux=x, tip_uy=y, drag=drag) for i, (x, y, drag) in enumerate(tips)]
    assert steady.differences(*found[:2]) == pytest.approx({"tip": 0.01, "drag": 0.02 / 2.02})
    assert steady.differences(*found[1:])["tip"] == pytest.approx(0.03, rel=1e-3)
    assert [cells[7] for cells in steady.flap_table([*found, failed(variant, 3)]).body] == [
        "–", "1.000 %", "2.999 %", "–",
    ]  # fmt: skip
