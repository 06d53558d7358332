"""FreeFEM's failures, told apart by what this version prints (to stdout) and by how the process ended.

The texts are those of Debian 12's freefem++ 4.11. Its exit code alone proves nothing: after a fatal MUMPS error it
is 0.
"""

import re
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ffsi.text import printable

MUMPS_MEANING = {
    -1: "an error on another process",
    -2: "a wrong number of non-zeros",
    -5: "no memory for the analysis",
    -6: "the matrix is singular in structure",
    -7: "no memory for the analysis",
    -8: "the integer work array is too small",
    -9: "the work array is too small for the fill-in: the matrix is nearly singular, and its pivots were put off",
    -10: "the matrix is numerically singular",
    -13: "an allocation failed: not enough memory for the factors",
    -16: "the matrix has no rows",
    -17: "the internal send buffer is too small",
    -19: "the memory allowed is too small for the factorisation",
    -20: "the internal receive buffer is too small",
}
_CRASH_SIGNALS = {signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGILL, signal.SIGSYS}


class FreeFEMError(RuntimeError):
    """A FreeFEM run that did not reach its end marker.

    `kind` is one of `missing-binary`, `missing-plugin`, `syntax`, `assert`, `singular-matrix`, `mumps`,
    `out-of-memory`, `killed`, `floating-point`, `disk-full`, `time-limit`, `bad-input` and `crash`.
    `script_line` and `source_line` say where in the script (0 and "" when FreeFEM did not tell), `log` is the file
    with the whole output.
    """

    def __init__(
        self, kind: str, message: str, script_line: int = 0, source_line: str = "", log: Path | None = None
    ) -> None:
        """Keep the parts; `str` puts them on a few lines."""
        message, source_line = printable(message), printable(source_line)  # they may hold names from files
        # All arguments go to RuntimeError, so that the error survives pickling between processes.
        super().__init__(kind, message, script_line, source_line, log)
        self.kind = kind
        self.message = message
        self.script_line = script_line
        self.source_line = source_line
        self.log = log

    def __str__(self) -> str:
        """Kind and reason, then the script's line and the log, each on a line of its own."""
        lines = [f"FreeFEM, {self.kind}: {self.message}"]
        if self.script_line:
            lines.append(f"  line {self.script_line}: {self.source_line}".rstrip())
        if self.log is not None:
            lines.append(f"  log: {printable(self.log)}")
        return "\n".join(lines)


class FreeFEMNotFound(FreeFEMError):
    """No usable FreeFEM: kind `missing-binary` or `missing-plugin`; the message says what to install."""


@dataclass(frozen=True)
class Ending:
    """How a process ended: exit code (minus the signal's number when a signal ended it) and its last output.

    `bad_input` is the text of the script's own `@ffsi bad-input` line, `failed` that of its last `@ffsi failed`,
    `memory_evidence` says why a SIGKILL looks like the kernel's out-of-memory killer ("" when it does not), `limits`
    are those of the shell that may have ended it (`cpu`, `memory`).
    """

    exit_code: int
    tail: Sequence[str] = ()
    bad_input: str | None = None
    failed: str = ""
    memory_evidence: str = ""
    limits: Mapping[str, str] = field(default_factory=dict)

    @property
    def signal(self) -> int:
        """The number of the signal that ended the process, 0 when none did; a shell's 128 + N counts too."""
        if self.exit_code < 0:
            return -self.exit_code
        return self.exit_code - 128 if 128 < self.exit_code <= 128 + 31 else 0

    def search(self, pattern: str) -> re.Match[str] | None:
        """The first match of `pattern` in the last output, line by line."""
        return re.search(pattern, "\n".join(self.tail), re.MULTILINE)


_Finding = tuple[str, str] | None
"""Kind and message of what a rule has found."""


def explain(ending: Ending, script: Path, log: Path | None = None) -> FreeFEMError:
    """Turn the end of a run without an end marker into the error that names its reason."""
    kind, message = next(filter(None, (rule(ending) for rule in _RULES)), ("crash", _no_marker(ending)))
    if "memory" in ending.limits and kind in ("out-of-memory", "mumps", "crash", "killed"):
        message += f"; its memory is limited to {ending.limits['memory']}"
    if ending.failed and kind != "bad-input":
        message += f" (the script said before: {ending.failed})"
    line, file = script_position(ending)
    line = 0 if kind == "bad-input" else line
    if file is not None and Path(file).name != script.name:
        message += f" (in the included file {file})"
    return FreeFEMError(kind, message, line, _source_line(script, file, line), log)


def script_position(ending: Ending) -> tuple[int, str | None]:
    """Line number (0: unknown) and file, as FreeFEM names it (None: not said), where the script stopped."""
    match = ending.search(r"Error line number (\d+), in file (.*?), before +token")
    if match:
        return int(match[1]), match[2]
    match = ending.search(r"^\s*current line = (\d+)") or ending.search(r"at exec line +(\d+)")
    return (int(match[1]), None) if match else (0, None)


def _not_begun(ending: Ending) -> _Finding:
    if ending.bad_input is not None:
        return "bad-input", ending.bad_input
    match = ending.search(r"^setpriv: failed to execute (.*)")
    return ("missing-binary", f"cannot be started: {match[1]}") if match else None


def _missing_plugin(ending: Ending) -> _Finding:
    match = ending.search(r"^(?:error )?Load error ?: (\S+)")
    if match is None:
        return None
    found = ending.search(r"dlerror : (.*)")
    reason = found[1] if found else "no reason given"
    return "missing-plugin", f"the plugin {match[1]} does not load: {reason}"


def _mumps(ending: Ending) -> _Finding:
    match = ending.search(r"Erreur Mumps seq: number (-?\d+)") or ending.search(r"INFOG?\(1\)=\s*(-\d+)")
    if match:
        code = int(match[1])
        meaning = MUMPS_MEANING.get(code, "see INFO(1) in the MUMPS manual")
        return ("singular-matrix" if code in (-6, -10) else "mumps", f"MUMPS error {code}: {meaning}")
    match = ending.search(r"(Internal error .* in [DZSC]MUMPS\S*)") or ending.search(r"(\*\* MPI_ABORT called)")
    return ("mumps", f"MUMPS stopped: {match[1].strip()}") if match else None


def _allocation(ending: Ending) -> _Finding:
    if ending.search(r"std::bad_alloc"):
        return "out-of-memory", "an allocation failed (std::bad_alloc)"
    if ending.search(r"Strange catch exception"):  # FreeFEM's catch-all; an array of negative size ends here too
        return "out-of-memory", "an array cannot be allocated: no memory, or its size is negative or absurd"
    match = ending.search(r"(.*out of memory.*)")
    return ("out-of-memory", match[1].strip()) if match else None


def _syntax(ending: Ending) -> _Finding:
    if not ending.search(r"^(?:error )?Compile error ?:"):
        return None
    if unknown := ending.search(r"The Identifier (\S+) does not exist"):
        return "syntax", f"the identifier {unknown[1]} does not exist"
    if include := ending.search(r"Error opening file (.*?) in:"):
        return "syntax", f"the file {include[1]} cannot be opened"
    detail = ending.search(r"^\s*((?:unknown operator|Impossible to cast|error operator).*)")
    token = ending.search(r"before +token (.*)")
    near = f"before the token {token[1].strip()!r}" if token else "at an unknown place"
    return "syntax", f"{detail[1].strip()}, {near}" if detail else f"syntax error {near}"


def _execution(ending: Ending) -> _Finding:
    match = ending.search(r"^(Exec|Meshing) error ?: *(.*)")
    if match is None:
        return None
    text = match[2].strip()
    if text == "exec assert":
        return "assert", "an assert of the script does not hold"
    if text == "Div by 0":
        return "floating-point", "division by zero"
    bound = ending.search(r"(Out of bound +\d.*?) array type")
    opening = ending.search(r"^ ?(Error [Oo]pening file .*?)(?:,|$)")
    mesher = ending.search(r"^(.+)\n Fatal error in the mesh generator")
    more = next((found[1].strip() for found in (bound, opening, mesher) if found), "")
    return ("crash", f"{match[1].lower()} error: {text}" + (f" ({more})" if more else ""))


def _umfpack(ending: Ending) -> _Finding:
    match = ending.search(r"umfpack\w* +status +(-?\d+)")
    if match is None:
        return None
    kind, meaning = {
        "1": ("singular-matrix", "the matrix is singular"),
        "-1": ("out-of-memory", "not enough memory for the factors"),
    }.get(match[1], ("crash", "see its manual"))
    return kind, f"UMFPACK status {match[1]}: {meaning}"


def _signal(ending: Ending) -> _Finding:
    number = ending.signal
    if number == 0:
        return None
    name = signal_name(number)
    if number == signal.SIGFPE:
        return "floating-point", "SIGFPE: an integer division or remainder by zero"
    if number == signal.SIGXCPU or (number == signal.SIGKILL and "cpu" in ending.limits):
        limit = ending.limits.get("cpu", "what ulimit -t allows")
        return "time-limit", f"FreeFEM used up its processor time, {limit}: signal {number}, {name}"
    if number == signal.SIGXFSZ:
        return "disk-full", f"a file reached the largest size that ulimit -f allows: signal {number}, {name}"
    if number == signal.SIGKILL and ending.memory_evidence:
        return "out-of-memory", f"killed by the system ({name}): {ending.memory_evidence}"
    if number in _CRASH_SIGNALS:
        return "crash", f"FreeFEM crashed: signal {number}, {name}"
    return "killed", f"FreeFEM was killed from outside: signal {number}, {name}"


def signal_name(number: int) -> str:
    """`SIGKILL` for 9, and so on."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return "an unnamed signal"


def _no_marker(ending: Ending) -> str:
    last = next((line.strip() for line in reversed(ending.tail) if line.strip()), "")
    text = f"FreeFEM ended with exit code {ending.exit_code} and without its end marker"
    return f"{text}; its last line: {last[:200]}" if last else f"{text}; it printed nothing"


# The first rule that answers decides: what FreeFEM says before how it ended, causes before consequences.
_RULES: tuple[Callable[[Ending], _Finding], ...] = (
    _not_begun, _missing_plugin, _allocation, _mumps, _syntax, _umfpack, _execution, _signal,
)  # fmt: skip


def _source_line(script: Path, file: str | None, number: int) -> str:
    """The text of a line of the script, or of the included file that FreeFEM named; "" when it cannot be read."""
    path = script if file is None or Path(file).name == script.name else script.parent / file
    if number < 1 or not path.is_file():
        return ""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return lines[number - 1].strip() if number <= len(lines) else ""
