"""The real FreeFEM, made to fail in every way that it can be made to fail quickly."""

from time import monotonic

import pytest

from ffsi.freefem import FreeFEMError, run_script
from ffsi.freefem.doctor import diagnose, healthy

SOLVE = """\
mesh Th = square(3, 3);
fespace Vh(Th, P1);
varf a(u, v) = int2d(Th)({form});
matrix A = a(Vh, Vh);
set(A, solver={solver});
real[int] b(Vh.ndof), x(Vh.ndof);
b = 1;
x = A^-1*b;
"""
MUMPS = 'load "MUMPS_seq"\n'
ZERO = "0.*u*v"
END = 'cout << "@ffsi end status=converged" << endl;\n'


@pytest.fixture
def run(installation, tmp_path):
    def run(text, arguments=None, **options):
        script = tmp_path / "case.edp"
        script.write_text(text)
        return run_script(
            script, arguments, installation=installation, log=tmp_path / "log", cwd=tmp_path,
            **{"time_limit": 30, **options},
        )  # fmt: skip

    return run


@pytest.fixture
def failure(run):
    def failure(text, **options):
        with pytest.raises(FreeFEMError) as caught:
            run(text, **options)
        return caught.value

    return failure


def test_this_machines_freefem_is_complete(installation):
    assert installation.plugins == {"MUMPS_seq", "Element_QF", "lapack", "bfstream"}
    assert installation.version[0].isdigit()
    checks = diagnose()
    assert healthy(checks), [check for check in checks if check.status == "fail"]


@pytest.mark.parametrize("ending, status, code", [("", "converged", 0), ("exit(3);", "failed", 3)])
def test_a_run_that_ends(run, ending, status, code):
    text = MUMPS + SOLVE.format(form="u*v", solver='"MUMPS"')
    text += f'cout << "@ffsi point point=1 status={status}" << endl;\n'
    text += f'cout << "@ffsi end status={status}" << endl;\n{ending}'
    done = run(text)
    assert (done.status, done.exit_code, done.points) == (status, code, {1: status})


def test_memory_arguments_and_progress_of_a_script(run):
    done = run('{ real[int] r(25000000); r = 1; exec("sleep 0.3"); }\n' + END)
    assert 200e6 < done.peak_memory < 400e6
    texts = []
    text = 'for (int i = 0; i < ARGV.n; ++i) cout << "@ffsi echo text=" << ARGV[i] << endl;\n' + END
    run(
        text, {"mesh_level": 2, "inflow_mean_velocity": 0.1, "out": "a b"},
        on_event=lambda event: texts.append(event.text),
    )  # fmt: skip
    assert texts[-7:-1] == ["-mesh_level", "2", "-inflow_mean_velocity", "0.1", "-out", "a b"]
    # `cout << flush` does not compile here, and `endl` does not flush a pipe; `cout.flush;` does.
    times = []
    text = 'cout << "@ffsi start case=x" << endl;\ncout.flush;\nexec("sleep 0.5");\n' + END
    run(text, on_event=lambda event: times.append(monotonic()))
    assert times[1] - times[0] > 0.3


def test_a_script_with_an_error(failure):
    error = failure("real f = 1.;\nreal g = f(2);\n" + END)
    assert (error.kind, error.script_line) == ("syntax", 2) and "unknown operator (" in error.message
    error = failure("int a = 1;\nint b = 2\nint c = 3;\n" + END)
    assert (error.kind, error.script_line, error.source_line) == ("syntax", 3, "int c = 3;")
    assert "before the token 'int'" in error.message
    error = failure("int a = 1;\n\nint b = foo(a);\n" + END)
    assert (error.kind, error.script_line, error.source_line) == ("syntax", 3, "int b = foo(a);")
    assert "identifier foo does not exist" in error.message
    error = failure('include "nothere.idp"\n' + END)
    assert (error.kind, error.script_line) == ("syntax", 1) and "nothere.idp cannot be opened" in error.message


def test_error_in_an_included_file(failure, tmp_path):
    (tmp_path / "part.idp").write_text("int q = 1;\nint x = yy;\n")
    error = failure('include "part.idp"\n' + END)
    assert (error.kind, error.script_line, error.source_line) == ("syntax", 2, "int x = yy;")
    assert "part.idp" in error.message


@pytest.mark.parametrize("before", ["", MUMPS + SOLVE.format(form="u*v", solver='"MUMPS"')])
def test_assert(failure, before):
    error = failure(before + "assert(1 == 2);\n" + END)
    assert (error.kind, error.source_line) == ("assert", "assert(1 == 2);")


def test_singular_matrices_failing_asserts_and_plugins(failure):
    error = failure("func int f(int i) {\n  assert(i > 1);\n  return i;\n}\nint k = f(0);\n" + END)
    assert (error.kind, error.script_line, error.source_line) == ("assert", 2, "assert(i > 1);")
    error = failure('load "NoSuchPlugin"\n' + END)
    assert error.kind == "missing-plugin" and error.source_line == 'load "NoSuchPlugin"'
    assert "NoSuchPlugin does not load: NoSuchPlugin.so: cannot open" in error.message
    error = failure(MUMPS + SOLVE.format(form=ZERO, solver='"MUMPS"') + END)
    assert (error.kind, error.source_line) == ("singular-matrix", "x = A^-1*b;") and "-10" in error.message
    error = failure(SOLVE.format(form=ZERO, solver="UMFPACK") + "assert(x.linfty < 1);\n" + END)
    assert error.kind == "singular-matrix"


def test_umfpack_goes_on_with_a_singular_matrix(run):
    done = run(SOLVE.format(form=ZERO, solver="UMFPACK") + END)
    assert any("UMFPACK" in warning for warning in done.warnings)


@pytest.mark.parametrize("operation", ["1/n", "1%n", "1./n"])
def test_division_by_zero(failure, operation):
    error = failure(f"int n = 0;\nreal r = {operation};\n" + END)
    assert (error.kind, error.script_line) == ("floating-point", 0 if "%" in operation else 2)


def test_what_ends_a_script(failure):
    error = failure("real[int] r(3);\n\nr(7) = 3;\n" + END)
    assert (error.kind, error.script_line) == ("crash", 3) and "0 <=7 < 3" in error.message
    error = failure("real[int] r(50000000000000);\n" + END)
    assert (error.kind, error.script_line) == ("out-of-memory", 1) and "cannot be allocated" in error.message
    error = failure("border a(t=0, 1){x=t; y=0;}\nmesh Th = buildmesh(a(10));\n" + END)
    assert error.kind == "crash" and "meshing error: Bamg (All the vertices are aline" in error.message
    error = failure('{ ofstream f("/no/such/dir/file"); f << 1 << endl; }\n' + END)
    assert error.kind == "crash" and "/no/such/dir/file" in error.message


@pytest.mark.parametrize("signal, kind", [("KILL", "killed"), ("TERM", "killed"), ("SEGV", "crash"), ("ABRT", "crash")])
def test_signals(failure, signal, kind):
    error = failure(f'exec("kill -{signal} $PPID");\nint a = 0;\nwhile (a < 1) a = 0;\n')
    assert error.kind == kind and f"SIG{signal}" in error.message


def test_what_is_not_finished(failure):
    error = failure("int a = 0;\nwhile (a < 1) a = 0;\n", time_limit=0.3)
    assert error.kind == "time-limit"
    error = failure('cout << "@ffsi bad-input text=speed must be positive" << endl;\nexit(2);\n')
    assert (error.kind, error.message) == ("bad-input", "speed must be positive")
    error = failure("exit(0);\n" + END)
    assert error.kind == "crash" and "end marker" in error.message
