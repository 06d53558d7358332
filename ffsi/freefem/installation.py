"""Where FreeFEM, its plugins and its `.idp` files are.

Debian's binary looks for plugins in a folder that does not exist, so every `load` fails until `FF_LOADPATH` and
`FF_INCLUDEPATH` name the right ones. This module finds them.
"""

import logging
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ffsi.freefem.blas import blas_environment
from ffsi.freefem.errors import FreeFEMNotFound

logger = logging.getLogger(__name__)

PACKAGES = ("freefem++", "libfreefem++", "libfreefem++-dev", "libopenblas0-serial")
"""The Debian packages that a complete installation needs."""

REQUIRED_PLUGINS = ("Element_QF", "lapack", "bfstream")
OPTIONAL_PLUGINS = ("MUMPS_seq",)
NEEDED_PLUGINS = (*OPTIONAL_PLUGINS, *REQUIRED_PLUGINS)

PLUGIN_FOLDERS = (
    "/usr/lib/freefem++",
    "/usr/lib/*/freefem++",
    "/usr/lib/ff++/*/lib",
    "/usr/local/lib/ff++/*/lib",
    "/usr/local/ff++/*/lib/ff++/*/lib",
    "/opt/*/lib/ff++/*/lib",
)
INCLUDE_FOLDERS = (
    "/usr/include/freefem++/idp",
    "/usr/share/freefem++/idp",
    "/usr/lib/ff++/*/idp",
    "/usr/local/lib/ff++/*/idp",
    "/usr/local/ff++/*/lib/ff++/*/idp",
    "/opt/*/lib/ff++/*/idp",
)


@dataclass(frozen=True)
class Installation:
    """A FreeFEM that can run rendered scripts.

    `load_path` and `include_path` are the values for `FF_LOADPATH` and `FF_INCLUDEPATH`; `version` is what the
    binary calls itself (Debian's 4.11 says 4.9); `plugins` are those of the needed plugins whose file exists.
    """

    binary: Path
    version: str
    load_path: str
    include_path: str
    plugin_folder: Path
    plugins: frozenset[str]

    @property
    def has_mumps(self) -> bool:
        """Whether `load "MUMPS_seq"` can work; without it a script must use the slower UMFPACK."""
        return "MUMPS_seq" in self.plugins

    @property
    def solver(self) -> str:
        """The sparse direct solver to render: `MUMPS` or `UMFPACK`."""
        return "MUMPS" if self.has_mumps else "UMFPACK"

    def environment(self) -> dict[str, str]:
        """The environment for the FreeFEM process: this one's, plus the plugin paths, and the BLAS with one thread.

        MUMPS calls it on small matrices: more threads only wait for each other.
        """
        paths = {"FF_LOADPATH": self.load_path, "FF_INCLUDEPATH": self.include_path}
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        return {**os.environ, **blas_environment(self.binary), **paths, **threads}


def find_freefem() -> Installation:
    """Find FreeFEM, its plugins and its `.idp` files.

    The binary is `$FFSI_FREEFEM`, else `FreeFem++-nw` or `FreeFem++` on the path. `FF_LOADPATH` and `FF_INCLUDEPATH`
    are taken as they are when set; otherwise the folders are looked for beside the binary and where packages put them.
    Raises FreeFEMNotFound, kind `missing-binary` or `missing-plugin`, naming what is missing and how to install it.
    """
    binary = find_binary()
    load_path, folder = _find_plugins(binary)
    plugins = frozenset(name for name in NEEDED_PLUGINS if (folder / f"{name}.so").is_file())
    missing = [name for name in REQUIRED_PLUGINS if name not in plugins]
    if missing:
        raise _not_found("missing-plugin", f"{folder} holds no {' and no '.join(f'{name}.so' for name in missing)}.")
    if "MUMPS_seq" not in plugins:
        logger.warning("%s holds no MUMPS_seq.so: UMFPACK takes its place and is slower", folder)
    version = _read_version(binary, binary.stat().st_mtime_ns)
    return Installation(binary, version, load_path, _find_includes(binary), folder, plugins)


def find_binary() -> Path:
    """Find the FreeFEM executable; raises FreeFEMNotFound (kind `missing-binary`)."""
    wanted = os.environ.get("FFSI_FREEFEM")
    if wanted:
        found = shutil.which(Path(wanted).expanduser())
        if found is None:
            raise _not_found("missing-binary", f"FFSI_FREEFEM={wanted} is no executable file.")
        return Path(found).absolute()
    for name in ("FreeFem++-nw", "FreeFem++"):
        found = shutil.which(name)
        if found is not None:
            return Path(found).absolute()
    raise _not_found("missing-binary", "Neither FreeFem++-nw nor FreeFem++ is on the PATH; FFSI_FREEFEM is not set.")


def _find_plugins(binary: Path) -> tuple[str, Path]:
    """The value for FF_LOADPATH, and the folder in it that holds the plugins."""
    given = os.environ.get("FF_LOADPATH")
    if given:
        folder = _best_plugin_folder(Path(entry) for entry in given.split(";") if entry.strip())
        if folder is None:
            raise _not_found(
                "missing-plugin", f"FF_LOADPATH={given!r} is set, but none of its folders holds Element_QF.so."
            )
        return given, folder
    candidates = list(_candidates(binary, PLUGIN_FOLDERS, "lib"))
    folder = _best_plugin_folder(candidates)
    if folder is None:
        looked = ", ".join(str(path) for path in candidates) or "no such folder exists"
        raise _not_found("missing-plugin", f"FreeFEM's plugins (Element_QF.so) were not found; looked in: {looked}.")
    return f"{folder};;", folder


def _best_plugin_folder(folders: Iterable[Path]) -> Path | None:
    """The folder with most of the needed plugins, the first of them when several are equal."""
    best, most = None, 0
    for folder in folders:
        count = sum((folder / f"{name}.so").is_file() for name in NEEDED_PLUGINS)
        if count > most:
            best, most = folder, count
    return best


def _find_includes(binary: Path) -> str:
    """The value for FF_INCLUDEPATH; without any `.idp` folder it is `;;`, for rendered scripts need none."""
    given = os.environ.get("FF_INCLUDEPATH")
    if given:
        return given
    for folder in _candidates(binary, INCLUDE_FOLDERS, "idp"):
        if (folder / "getARGV.idp").is_file():
            return f"{folder};;"
    return ";;"


def _candidates(binary: Path, patterns: tuple[str, ...], leaf: str) -> Iterator[Path]:
    """The existing folders to look in: those beside the binary first, then where packages put them."""
    for prefix in dict.fromkeys((binary.parent.parent, binary.resolve().parent.parent)):
        for pattern in (f"lib/ff++/*/{leaf}", leaf):
            yield from sorted((path for path in prefix.glob(pattern) if path.is_dir()), reverse=True)
    for pattern in patterns:
        yield from sorted((path for path in Path("/").glob(pattern.lstrip("/")) if path.is_dir()), reverse=True)


@lru_cache(maxsize=8)
def _read_version(binary: Path, modified: int) -> str:
    """What the binary calls itself, from the banner of an empty run; `modified` only renews the cache."""
    with tempfile.TemporaryDirectory(prefix="ffsi-") as folder:
        script = Path(folder) / "version.edp"
        script.write_text("{}\n")
        try:
            done = subprocess.run(
                [binary, "-nw", "-ns", "-v", "1", script],
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                timeout=30, check=False, cwd=folder,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise _not_found("missing-binary", f"{binary} does not run: {error}.") from error
    output = done.stdout.decode(errors="replace")
    match = re.search(r"FreeFem\+\+ v?\s*(\d[\w.]*)", output)
    if match is None:
        start = " ".join(output.split())[:200] or f"nothing, exit code {done.returncode}"
        raise _not_found("missing-binary", f"{binary} does not call itself FreeFem++; it printed: {start}.")
    return match.group(1)


def _not_found(kind: str, message: str) -> FreeFEMNotFound:
    advice = f"On Debian or Ubuntu: apt-get install --no-install-recommends {' '.join(PACKAGES)}"
    return FreeFEMNotFound(kind, f"{message} {advice}")
