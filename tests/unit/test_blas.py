"""Which BLAS FreeFEM is given, on machines made up in a folder."""

from pathlib import Path

import pytest

from ffsi.freefem import blas

FREEFEM = Path("/usr/bin/FreeFem++-nw")
AVX512 = "avx2 fma avx512f avx512cd avx512bw avx512dq avx512vl"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    for name in ("LD_LIBRARY_PATH", "OPENBLAS_CORETYPE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(blas, "LIBRARIES", tmp_path)
    monkeypatch.setattr(blas, "CPUINFO", tmp_path / "cpuinfo")
    return tmp_path


@pytest.mark.parametrize("kinds", ["pthread serial", "openmp serial", "serial pthread", "pthread openmp", "mkl serial"])
def test_one_thread_takes_the_library_without_locks(machine, monkeypatch, kinds):
    libraries = machine / "x86_64-linux-gnu"
    for kind in kinds.split():
        (libraries / f"openblas-{kind}").mkdir(parents=True)
        (libraries / f"openblas-{kind}/libopenblas.so.0").touch()
    (libraries / "libopenblas.so.0").symlink_to(libraries / f"openblas-{kinds.split()[0]}/libopenblas.so.0")
    wanted = {"LD_LIBRARY_PATH": f"{libraries}/openblas-serial"} if kinds in ("pthread serial", "openmp serial") else {}
    assert blas.blas_environment(FREEFEM) == wanted and blas.blas_environment(Path("/opt/bin/FreeFem++")) == {}
    monkeypatch.setenv("LD_LIBRARY_PATH", "/my/blas")
    assert blas.blas_environment(FREEFEM) == {}


@pytest.mark.parametrize(("processor", "kernels"), [
    (f"GenuineIntel {AVX512}", "SkylakeX"),
    ("GenuineIntel avx2 fma avx512f", "Haswell"),
    ("GenuineIntel avx", None),
    (f"AuthenticAMD {AVX512}", None),
])  # fmt: skip
def test_kernels_for_a_model_that_openblas_may_not_know(machine, monkeypatch, processor, kernels):
    vendor, flags = processor.split(" ", 1)
    (machine / "cpuinfo").write_text(f"processor: 0\nvendor_id\t: {vendor}\nflags\t\t: fpu {flags}\n\nprocessor: 1\n")
    assert blas.blas_environment(FREEFEM).get("OPENBLAS_CORETYPE") == kernels
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Zen")
    assert blas.blas_environment(FREEFEM) == {}
