"""`ffsi doctor`: is everything here that a run needs, does it work, and what to do if not."""

import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from ffsi.freefem import Event, FreeFEMError, FreeFEMNotFound, Installation, find_freefem, run_script
from ffsi.freefem.installation import NEEDED_PLUGINS, OPTIONAL_PLUGINS, PACKAGES

Status = Literal["ok", "warn", "fail"]

DISTRIBUTION = "freefem-fsi"
TEMPORARY_SPACE = 100 * 2**20

MUMPS_SCRIPT = """\
load "MUMPS_seq"
mesh Th = square(4, 4);
fespace Vh(Th, P1);
varf a(u, v) = int2d(Th)(dx(u)*dx(v) + dy(u)*dy(v) + u*v);
matrix A = a(Vh, Vh);
real[int] one(Vh.ndof), b(Vh.ndof), x(Vh.ndof);
one = 1.;
b = A*one;
set(A, solver="MUMPS");
x = A^-1*b;
x -= one;
cout << "@ffsi solve error=" << x.linfty << endl;
cout << "@ffsi end status=converged" << endl;
"""
LOAD_SCRIPT = 'load "{plugin}"\ncout << "@ffsi end status=converged" << endl;\n'


@dataclass(frozen=True)
class Check:
    """One finding: what was looked at, how it is, what was found, and what to do when it is not `ok`."""

    name: str
    status: Status
    detail: str
    advice: str = ""


def diagnose() -> list[Check]:
    """Check Python, its packages, FreeFEM, each plugin, a MUMPS solve, BLAS and the temporary folder; never raises."""
    python = Check("Python", "ok", f"{platform.python_version()}, {sys.executable}")
    checks = [python, *_packages(), _temporary()]
    try:
        installation = find_freefem()
    except FreeFEMNotFound as error:
        return [*checks, Check("FreeFEM", "fail", error.message, _install_advice(PACKAGES))]
    return [*checks, *_freefem(installation)]


def _freefem(installation: Installation) -> list[Check]:
    checks = [
        Check("FreeFEM", "ok", f"{installation.binary}, calls itself {installation.version}"),
        Check("plugin folder", "ok", str(installation.plugin_folder)),
        _includes(installation),
    ]
    checks += [_plugin(installation, plugin) for plugin in NEEDED_PLUGINS]
    if installation.has_mumps:
        checks.append(_mumps(installation))
    return [*checks, _blas(installation)]


def _packages() -> list[Check]:
    try:
        wanted = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        advice = "Install it: pip install -e . in the project's folder, or make setup."
        return [Check("packages", "warn", f"{DISTRIBUTION} is used without being installed", advice)]
    found, missing = [], []
    for requirement in wanted:
        if "extra ==" in requirement:
            continue
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        try:
            found.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            missing.append(name)
    checks = [Check("packages", "ok", ", ".join([f"{DISTRIBUTION} {metadata.version(DISTRIBUTION)}", *found]))]
    if missing:
        checks.append(Check("missing packages", "fail", ", ".join(missing), f"pip install {' '.join(missing)}"))
    return checks


def _temporary() -> Check:
    folder = Path(tempfile.gettempdir())
    try:
        with tempfile.NamedTemporaryFile(prefix="ffsi-") as file:
            file.write(b"x")
            file.flush()
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return Check("temporary folder", "fail", f"{folder}: {error}", "Set TMPDIR to a folder that can be written.")
    if free < TEMPORARY_SPACE:
        return Check("temporary folder", "warn", f"{folder}: {free >> 20} MB free", "Free some space or set TMPDIR.")
    return Check("temporary folder", "ok", f"{folder}: {free >> 20} MB free")


def _includes(installation: Installation) -> Check:
    folders = [Path(entry) for entry in installation.include_path.split(";") if entry]
    holding = [folder for folder in folders if (folder / "getARGV.idp").is_file()]
    if holding:
        return Check("idp folder", "ok", str(holding[0]))
    detail = f"no getARGV.idp in {installation.include_path!r}; the scripts of ffsi do not need it"
    return Check("idp folder", "warn", detail, _install_advice(["libfreefem++-dev"]))


def _plugin(installation: Installation, plugin: str) -> Check:
    name = f"plugin {plugin}"
    bad: Status = "warn" if plugin in OPTIONAL_PLUGINS else "fail"
    advice = _install_advice(["libfreefem++"])
    if plugin in OPTIONAL_PLUGINS:
        advice = f"UMFPACK takes its place and is slower. {advice}"
    if plugin not in installation.plugins:
        return Check(name, bad, f"{plugin}.so is not in {installation.plugin_folder}", advice)
    try:
        _run(installation, LOAD_SCRIPT.format(plugin=plugin))
    except FreeFEMError as error:
        # The file is there, so rendered scripts will load it: a plugin that does not load stops every run.
        return Check(name, "fail", f"{error.kind}: {error.message}", _install_advice(["libfreefem++"]))
    return Check(name, "ok", "loads")


def _mumps(installation: Installation) -> Check:
    events: list[Event] = []
    try:
        _run(installation, MUMPS_SCRIPT, events.append)
    except FreeFEMError as error:
        return Check("MUMPS solve", "fail", f"{error.kind}: {error.message}", _install_advice(["libfreefem++"]))
    error_size = next((event.number("error") for event in events if event.kind == "solve"), float("nan"))
    if not error_size < 1e-10:
        return Check("MUMPS solve", "fail", f"wrong by {error_size:g}", "Reinstall libfreefem++ and the BLAS library.")
    return Check("MUMPS solve", "ok", f"exact to {error_size:.1e}")


def _run(installation: Installation, text: str, on_event: Callable[[Event], None] | None = None) -> None:
    with tempfile.TemporaryDirectory(prefix="ffsi-") as folder:
        script = Path(folder) / "doctor.edp"
        script.write_text(text)
        run_script(script, installation=installation, cwd=folder, on_event=on_event, time_limit=60)


def _blas(installation: Installation) -> Check:
    """Which BLAS the dynamic linker gives to FreeFEM."""
    environment = installation.environment()
    try:
        done = subprocess.run(
            ["ldd", installation.binary], capture_output=True, text=True, timeout=30, check=False,
            stdin=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("BLAS", "warn", f"not known: ldd does not run ({error})", "Make sure that OpenBLAS is installed.")
    match = re.search(r"lib(?:open)?blas\S* => (\S+)", done.stdout)
    if match is None:
        return Check("BLAS", "warn", f"{installation.binary} shows no BLAS library", "Make sure that it uses OpenBLAS.")
    library = Path(match[1]).resolve()
    if "openblas" in str(library) or "mkl" in str(library) or "blis" in str(library):
        kernels = environment.get("OPENBLAS_CORETYPE", "")
        return Check("BLAS", "ok", f"{library}{kernels and f', {kernels}'}")
    detail = f"{library} is the slow reference BLAS"
    return Check("BLAS", "warn", detail, _install_advice(["libopenblas0-serial"]))


def _install_advice(packages: tuple[str, ...] | list[str]) -> str:
    return f"On Debian or Ubuntu: apt-get install --no-install-recommends {' '.join(packages)}"


def healthy(checks: list[Check]) -> bool:
    """Whether nothing failed; warnings are allowed."""
    return all(check.status != "fail" for check in checks)
