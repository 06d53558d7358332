from pathlib import Path

import pytest

from ffsi.freefem import Event, FreeFEMError, FreeFEMNotFound, Installation, doctor


def install(tmp_path, plugins=("MUMPS_seq", "Element_QF", "lapack", "bfstream")):
    return Installation(tmp_path / "ff", "4.9", ";;", f"{tmp_path};;", tmp_path, frozenset(plugins))


@pytest.fixture
def works(monkeypatch, tmp_path):
    def run(script, *, on_event=None, **options):
        if on_event is not None:
            on_event(Event("solve", {"error": 1e-15}))

    (tmp_path / "getARGV.idp").touch()
    monkeypatch.setattr(doctor, "find_freefem", lambda: install(tmp_path))
    monkeypatch.setattr(doctor, "run_script", run)


def by_name(checks):
    return {check.name: check for check in checks}


def test_all_is_well(works):
    checks = doctor.diagnose()
    assert doctor.healthy(checks) and by_name(checks)["MUMPS solve"].status == "ok"
    assert {"Python", "FreeFEM", "plugin folder", "idp folder", "BLAS", "temporary folder"} <= set(by_name(checks))


def test_without_freefem(monkeypatch):
    def find():
        raise FreeFEMNotFound("missing-binary", "no FreeFem++-nw")

    monkeypatch.setattr(doctor, "find_freefem", find)
    checks = doctor.diagnose()
    assert not doctor.healthy(checks)
    found = by_name(checks)["FreeFEM"]
    assert (found.status, found.detail) == ("fail", "no FreeFem++-nw") and "libfreefem++" in found.advice


def test_without_mumps_it_is_a_warning(works, monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "find_freefem", lambda: install(tmp_path, ("Element_QF", "lapack", "bfstream")))
    checks = doctor.diagnose()
    assert doctor.healthy(checks) and by_name(checks)["plugin MUMPS_seq"].status == "warn"
    assert "UMFPACK" in by_name(checks)["plugin MUMPS_seq"].advice and "MUMPS solve" not in by_name(checks)


def test_a_plugin_that_does_not_load_fails(works, monkeypatch):
    def run(script, **options):
        if "bfstream" in Path(script).read_text():
            raise FreeFEMError("missing-plugin", "undefined symbol")

    monkeypatch.setattr(doctor, "run_script", run)
    checks = by_name(doctor.diagnose())
    assert checks["plugin bfstream"].status == "fail" and "undefined symbol" in checks["plugin bfstream"].detail
    assert checks["plugin Element_QF"].status == "ok"


@pytest.mark.parametrize("error", [1e-3, float("nan")])
def test_a_wrong_solution_fails(works, monkeypatch, error):
    def run(script, *, on_event=None, **options):
        if on_event is not None:
            on_event(Event("solve", {"error": error}))

    monkeypatch.setattr(doctor, "run_script", run)
    assert by_name(doctor.diagnose())["MUMPS solve"].status == "fail"


def test_missing_idp_folder_is_a_warning(works, tmp_path):
    (tmp_path / "getARGV.idp").unlink()
    assert by_name(doctor.diagnose())["idp folder"].status == "warn"


def test_a_temporary_folder_that_cannot_be_written(works, monkeypatch):
    def fail(**options):
        raise OSError("read-only")

    monkeypatch.setattr(doctor.tempfile, "NamedTemporaryFile", fail)
    monkeypatch.setattr(doctor, "_freefem", lambda installation: [])
    assert by_name(doctor.diagnose())["temporary folder"].status == "fail"
