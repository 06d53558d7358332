"""Outputs of freefem++ 4.11 that test_link.py cannot have it print, and what must be made of them."""
# The blanks and tabs are FreeFEM's.
# ruff: noqa: W291

import pickle
import signal
from pathlib import Path

import pytest

from ffsi.freefem.errors import Ending, FreeFEMError, FreeFEMNotFound, explain, script_position

IDENTIFIER = """init MUMPS_SEQ: MPI_Init
 The Identifier foo does not exist 

 Error line number 4, in file undef.edp, before  token foo

  current line = 4
Compile error : 
	line number :4, foo
error Compile error : 
	line number :4, foo
 code = 1 mpirank: 0
close  MUMPS_SEQ: MPI_Finalize"""

ASSERT = """init MUMPS_SEQ: MPI_Init
  current line = 4
 call f  at  line 16
Exec error : exec assert
   -- number :1
Exec error : exec assert
   -- number :1
 err code 8 ,  mpirank 0
close  MUMPS_SEQ: MPI_Finalize"""

MUMPS = """init MUMPS_SEQ: MPI_Init
 Erreur Mumps seq: number {code}
 Fatal Erreur  MUMPS_seq Factorize
  current line = 10
Exec error : MUMPS_seq Factorize
   -- number :0
close  MUMPS_SEQ: MPI_Finalize
 On return from DMUMPS, INFOG(1)=             {code}
 On return from DMUMPS, INFOG(2)=               0
  ** Instance Error 1 in DMUMPS_F77           2
 ** MPI_ABORT called"""

MUMPS_INTERNAL = """init MUMPS_SEQ: MPI_Init
close  MUMPS_SEQ: MPI_Finalize
 Internal error 3 in DMUMPS_ANA_DRIVER      361200           0
 ** MPI_ABORT called"""

UMFPACK = """ Error umpfack umfpack_di_numeric  status  {code}
 Error umpfack umfpack_di_solve  status  {code}
inf"""

CASES = [
    ("syntax", 1, IDENTIFIER, "identifier foo does not exist", 4), ("assert", 8, ASSERT, "assert", 4),
    ("singular-matrix", 0, MUMPS.format(code=-10), "MUMPS error -10", 10),
    ("mumps", 0, MUMPS.format(code=-13), "MUMPS error -13: an allocation failed", 10),
    ("mumps", 0, MUMPS.format(code=-9), "MUMPS error -9: the work array is too small", 10),
    ("mumps", 0, MUMPS.format(code=-99), "MUMPS error -99: see INFO", 10),
    ("mumps", 0, MUMPS_INTERNAL, "Internal error 3 in DMUMPS_ANA_DRIVER", 0),
    ("out-of-memory", 0, "ERROR: hgraphOrderCp: out of memory (1)\n" + MUMPS_INTERNAL, "out of memory", 0),
    ("singular-matrix", 0, UMFPACK.format(code=1), "UMFPACK status 1", 0),
    ("singular-matrix", 8, UMFPACK.format(code=1) + "\n" + ASSERT, "UMFPACK status 1", 4),
    ("out-of-memory", 0, UMFPACK.format(code=-1), "UMFPACK status -1", 0),
    ("crash", 0, UMFPACK.format(code=-8), "UMFPACK status -8", 0),
    ("out-of-memory", -6, "terminate called after throwing an instance of 'std::bad_alloc'", "bad_alloc", 0),
    ("floating-point", -signal.SIGFPE, "", "SIGFPE", 0), ("floating-point", 136, "", "SIGFPE", 0),
    ("crash", -signal.SIGSEGV, "", "SIGSEGV", 0), ("crash", -signal.SIGABRT, "", "SIGABRT", 0),
    ("killed", -signal.SIGKILL, "", "signal 9, SIGKILL", 0), ("killed", -signal.SIGTERM, "", "signal 15, SIGTERM", 0),
    ("missing-binary", 127, "setpriv: failed to execute /x/ff: No such file or directory", "/x/ff", 0),
    ("crash", 0, "hello\n", "without its end marker; its last line: hello", 0),
    ("crash", 0, "", "it printed nothing", 0),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "code", "output", "text", "line"), CASES)
def test_recorded_outputs(kind, code, output, text, line, tmp_path):
    error = explain(Ending(code, output.splitlines()), tmp_path / "case.edp")
    assert error.kind == kind and error.script_line == line and text in str(error)


def test_source_lines_come_from_script_or_included_file(tmp_path):
    script = tmp_path / "undef.edp"
    script.write_text("int a = 1;\n\n\n   int b = foo(a);\n")
    error = explain(Ending(1, IDENTIFIER.splitlines()), script, tmp_path / "freefem.log")
    assert error.source_line == "int b = foo(a);"
    assert str(error).splitlines() == [
        "FreeFEM, syntax: the identifier foo does not exist", "  line 4: int b = foo(a);",
        f"  log: {tmp_path / 'freefem.log'}",
    ]  # fmt: skip
    script.write_text("one line\n")
    assert explain(Ending(1, IDENTIFIER.splitlines()), script).source_line == ""
    script = tmp_path / "case.edp"
    script.write_text('include "undef.edp"\n')
    (tmp_path / "undef.edp").write_text("a\nb\nc\nd foo\n")
    error = explain(Ending(1, IDENTIFIER.splitlines()), script)
    assert error.source_line == "d foo" and "in the included file undef.edp" in error.message


def test_what_a_script_said_and_why_it_died():
    error = explain(Ending(2, ["exit(2);"], bad_input="unknown parameter -x"), Path("case.edp"))
    assert (error.kind, error.message, error.script_line) == ("bad-input", "unknown parameter -x", 0)
    error = explain(Ending(-9, memory_evidence="it used 15.9 of 16.0 GiB"), Path("case.edp"))
    assert error.kind == "out-of-memory" and "15.9 of 16.0 GiB" in error.message
    error = explain(Ending(-11, failed="J fell below zero"), Path("case.edp"))
    assert error.kind == "crash" and "J fell below zero" in error.message
    assert script_position(Ending(8, ASSERT.splitlines())) == (4, None)


@pytest.mark.parametrize("kind", [FreeFEMError, FreeFEMNotFound])
def test_errors_survive_pickling(kind):
    error = pickle.loads(pickle.dumps(kind("syntax", "text", 3, "int x", Path("log"))))
    assert type(error) is kind
    assert (error.kind, error.message, error.script_line, error.source_line, error.log) == (
        "syntax", "text", 3, "int x", Path("log"),
    )  # fmt: skip
