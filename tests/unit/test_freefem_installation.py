"""Finding FreeFEM, and what `ffsi doctor` says of it."""

import stat
from pathlib import Path

import pytest

from ffsi.freefem import Event, FreeFEMError, FreeFEMNotFound, Installation, doctor, find_freefem, installation

PLUGINS = ("MUMPS_seq", "Element_QF", "lapack", "bfstream")


def executable(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def plugins(folder: Path, names: tuple[str, ...] = PLUGINS) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / f"{name}.so").touch()
    return folder


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """An empty machine under tmp_path: no FreeFEM, no variables."""
    for name in ("FF_LOADPATH", "FF_INCLUDEPATH", "FFSI_FREEFEM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", f"{tmp_path}/usr/bin")
    monkeypatch.setattr(installation, "PLUGIN_FOLDERS", (f"{tmp_path}/usr/lib/*/freefem++",))
    monkeypatch.setattr(installation, "INCLUDE_FOLDERS", (f"{tmp_path}/usr/include/freefem++/idp",))
    return tmp_path


@pytest.fixture
def binary(machine):
    return executable(machine / "usr/bin/FreeFem++-nw", "echo '-- FreeFem++ v4.9 ( - git no git)'")


def test_finds_debians_layout(machine, binary):
    folder = plugins(machine / "usr/lib/x86_64-linux-gnu/freefem++")
    idp = machine / "usr/include/freefem++/idp"
    idp.mkdir(parents=True)
    (idp / "getARGV.idp").touch()
    found = find_freefem()
    assert found.binary == binary and found.version == "4.9" and found.plugin_folder == folder
    assert found.load_path == f"{folder};;" and found.include_path == f"{idp};;" and found.plugins == set(PLUGINS)
    assert found.has_mumps and found.solver == "MUMPS"


def test_folders_beside_the_binary_win_over_those_of_packages(machine, binary):
    plugins(machine / "usr/lib/x86_64-linux-gnu/freefem++")
    own = executable(machine / "own/bin/FreeFem++-nw", "echo FreeFem++ v4.15")
    folder, link = plugins(machine / "own/lib/ff++/4.15/lib"), machine / "usr/bin/FreeFem++-nw"
    link.unlink()
    link.symlink_to(own)
    found = find_freefem()
    assert found.plugin_folder == folder and found.version == "4.15"


def test_a_folder_with_more_plugins_wins(machine, binary):
    plugins(machine / "usr/lib/a/freefem++", ("Element_QF",))
    complete = plugins(machine / "usr/lib/b/freefem++")
    plugins(machine / "usr/lib/c/freefem++", ("Element_QF", "lapack", "bfstream"))
    assert find_freefem().plugin_folder == complete


def test_variables_of_the_user_are_taken_as_they_are(machine, binary, monkeypatch):
    plugins(machine / "usr/lib/x86_64-linux-gnu/freefem++")
    mine = plugins(machine / "mine")
    monkeypatch.setenv("FF_LOADPATH", f"{machine}/nothing;{mine};;")
    monkeypatch.setenv("FF_INCLUDEPATH", "/my/idp;;")
    found = find_freefem()
    assert found.load_path == f"{machine}/nothing;{mine};;" and found.include_path == "/my/idp;;"
    assert found.plugin_folder == mine
    environment = found.environment()
    assert environment["FF_LOADPATH"] == found.load_path and environment["OPENBLAS_NUM_THREADS"] == "1"
    plugins(machine / "usr/lib/x/freefem++")
    monkeypatch.setenv("FF_LOADPATH", "/no/such;;")
    with pytest.raises(FreeFEMNotFound, match="FF_LOADPATH='/no/such;;'") as caught:
        find_freefem()
    assert caught.value.kind == "missing-plugin"


def test_binaries_that_are_named(machine, binary, monkeypatch):
    plugins(machine / "usr/lib/x/freefem++")
    other = executable(machine / "other/ff", "echo FreeFem++ v4.13")
    monkeypatch.setenv("FFSI_FREEFEM", str(other))
    found = find_freefem()
    assert (found.binary, found.version) == (other, "4.13")
    monkeypatch.setenv("FFSI_FREEFEM", "/no/such/ff")
    with pytest.raises(FreeFEMNotFound, match="FFSI_FREEFEM=/no/such/ff"):
        find_freefem()


def test_a_machine_without_freefem_is_told_what_to_install(machine):
    with pytest.raises(FreeFEMNotFound) as caught:
        find_freefem()
    assert isinstance(caught.value, FreeFEMError) and caught.value.kind == "missing-binary"
    for package in ("freefem++ ", "libfreefem++ ", "libfreefem++-dev", "libopenblas0-serial"):
        assert package in str(caught.value)


def test_the_graphical_binary_will_do(machine):
    plugins(machine / "usr/lib/x/freefem++")
    other = executable(machine / "usr/bin/FreeFem++", "echo FreeFem++ v4.9")
    assert find_freefem().binary == other


def test_what_is_missing_is_named(machine, binary):
    with pytest.raises(FreeFEMNotFound, match=r"Element_QF\.so.*were not found") as caught:
        find_freefem()
    assert caught.value.kind == "missing-plugin"
    plugins(machine / "usr/lib/x/freefem++", ("MUMPS_seq", "Element_QF", "lapack"))
    with pytest.raises(FreeFEMNotFound, match=r"holds no bfstream\.so\.") as caught:
        find_freefem()
    assert caught.value.kind == "missing-plugin"


def test_without_mumps_umfpack_and_a_warning(machine, binary, caplog):
    plugins(machine / "usr/lib/x/freefem++", ("Element_QF", "lapack", "bfstream"))
    found = find_freefem()
    assert not found.has_mumps and found.solver == "UMFPACK"
    assert "MUMPS_seq" in caplog.text


def test_something_else_under_the_name_is_refused(machine):
    plugins(machine / "usr/lib/x/freefem++")
    executable(machine / "usr/bin/FreeFem++-nw", "echo hello")
    with pytest.raises(FreeFEMNotFound, match="it printed: hello"):
        find_freefem()


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
