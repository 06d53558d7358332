"""Exit codes of the command line."""

from __future__ import annotations

from collections.abc import Sequence

CHECK_FAILED, BAD_INPUT, NOT_CONVERGED, NO_FREEFEM = 1, 2, 3, 4
FAULT = 70  # of ffsi itself: what a shell knows as "internal software error"
INTERRUPTED = 130
TEXT = (
    "Exit codes: 0 solved and checked, 1 the independent check failed or a result could not be evaluated as a whole, "
    "2 bad input (nothing was written), 3 not converged (partial results are kept), 4 FreeFEM missing or crashed or "
    "the machine out of disk, memory or time, 70 a fault of ffsi itself, 130 interrupted."
)
EXIT_OF = {
    "": 0,
    "check": CHECK_FAILED,
    "not-evaluated": CHECK_FAILED,
    "not-converged": NOT_CONVERGED,
    "not-reached": NOT_CONVERGED,
    "stopped": NOT_CONVERGED,
    "crash": NO_FREEFEM,
}


def worst(failures: Sequence[str]) -> int:
    """Return the exit code of several runs from their `Result.failure`, or "not-evaluated"."""
    codes = {EXIT_OF[failure] for failure in failures}
    return next((code for code in (NO_FREEFEM, NOT_CONVERGED, CHECK_FAILED) if code in codes), 0)
