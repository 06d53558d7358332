"""The BLAS that MUMPS calls: which of those installed, and for which processor.

A solve with kept factors calls it some thousand times for products of a small matrix and one vector. OpenBLAS that can
use threads takes a lock in each of them, and one that does not know a processor's model takes the kernels of 2004.
"""

import os
from pathlib import Path

BINARIES, LIBRARIES = Path("/usr/bin"), Path("/usr/lib")
CPUINFO = Path("/proc/cpuinfo")


def blas_environment(freefem: Path) -> dict[str, str]:
    """What Debian's FreeFEM needs beside this process's environment for a fast OpenBLAS; nothing where the user chose.

    `LD_LIBRARY_PATH` names Debian's `openblas-serial` where another OpenBLAS is the machine's; `OPENBLAS_CORETYPE`
    the kernels that an Intel processor's instructions allow, as OpenBLAS's own table does for the models it knows.
    """
    return {**_library(), **_kernels()} if freefem.parent == BINARIES else {}


def _library() -> dict[str, str]:
    given = os.environ.get("LD_LIBRARY_PATH")
    for serial in LIBRARIES.glob("*/openblas-serial"):
        used = (serial.parent / "libopenblas.so.0").resolve().parent
        if not given and used.name in ("openblas-pthread", "openblas-openmp"):
            return {"LD_LIBRARY_PATH": str(serial)}
    return {}


def _kernels() -> dict[str, str]:
    if "OPENBLAS_CORETYPE" in os.environ:
        return {}
    try:
        with CPUINFO.open() as file:
            first = file.read(8192)
    except OSError:
        return {}
    words = set(first.split("\n\n")[0].split())
    if "GenuineIntel" not in words:
        return {}
    if words >= {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"}:
        return {"OPENBLAS_CORETYPE": "SkylakeX"}
    return {"OPENBLAS_CORETYPE": "Haswell"} if words >= {"avx2", "fma"} else {}
