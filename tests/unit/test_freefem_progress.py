import io

from rich.console import Console

from ffsi.cli.progress import ProgressDisplay
from ffsi.freefem import parse_event


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def terminal(is_terminal=True):
    stream = io.StringIO()
    return stream, Console(file=stream, force_terminal=is_terminal, width=200)


def feed(display, *lines):
    for line in lines:
        display(parse_event("@ffsi " + line))


def test_sweeps_single_runs_and_chains_show_their_own():
    clock = Clock()
    stream, console = terminal()
    with ProgressDisplay(console=console, clock=clock) as show:
        feed(show, "start case=flap-svk", "newton point=1 points=4 iteration=2 residual=1.25e-5 load=1 stages=1")
        assert show.seconds_left is None
        clock.now = 90.0
        feed(show, "point point=1 points=4 status=converged")
        assert show.seconds_left == 270.0
        feed(show, "newton point=2 points=4 iteration=3 residual=2e-7 stage=2 stages=2 load=0.5")
        assert show.state == "1/4 done · point 2/4 · mesh 2/2 · load 0.5 · Newton 3 · residual 2.0e-07"
    text = stream.getvalue()
    assert "flap-svk" in text and "residual 2.0e-07" in text and "about 4:30 left" in text
    _, console = terminal()
    with ProgressDisplay(console=console) as show:
        feed(show, "mesh stage=1 stages=2 level=1 triangles=10 unknowns=50")
        assert show.state == "mesh 1/2, 50 unknowns"
        feed(show, "newton point=1 points=1 iteration=5 residual=nan")
        assert show.state == "Newton 5 · residual nan"
        feed(show, "point point=1 points=1 status=converged")
        assert show.seconds_left is None
    clock = Clock()
    with ProgressDisplay("sweep", points=8, console=console, clock=clock) as show:
        clock.now = 10.0
        feed(show, "point point=1 points=4 status=converged", "point point=1 points=4 status=failed")
        assert show.finished == 2 and show.seconds_left == 30.0 and show.state.startswith("2/8 done")


def test_nothing_at_all_when_it_is_no_terminal(capsys):
    stream, console = terminal(is_terminal=False)
    with ProgressDisplay("case", console=console) as show:
        feed(show, "newton point=1 points=4 iteration=2 residual=1.25e-5", "point point=1 points=4 status=converged")
    assert stream.getvalue() == ""
    with ProgressDisplay("case") as show:  # pytest's stderr is no terminal
        feed(show, "newton point=1 points=4 iteration=2 residual=1.25e-5")
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err == ""
    _, console = terminal()
    with ProgressDisplay("case", console=console) as show:
        feed(show, "point point=1 points=4 status=converged")
        print("result")
    assert capsys.readouterr().out == "result\n"
