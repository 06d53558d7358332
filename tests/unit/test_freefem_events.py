import math

import pytest

from ffsi.freefem import Event, parse_event


def test_lines_have_typed_fields_and_a_text():
    event = parse_event(
        "@ffsi newton point=1 points=10 residual=1.2e-5 correction=3e-4 step=1 stage=.5 case=turek-fsi1\n"
    )
    assert event is not None and event.kind == "newton"
    assert event.fields == {
        "point": 1, "points": 10, "residual": 1.2e-5, "correction": 3e-4, "step": 1, "stage": 0.5, "case": "turek-fsi1",
    }  # fmt: skip
    assert isinstance(event.fields["point"], int) and isinstance(event.fields["residual"], float) and event.text == ""
    event = parse_event("@ffsi failed point=7 text=J = 0.1 at x=3, text=again")
    assert event == Event("failed", {"point": 7}, "J = 0.1 at x=3, text=again")
    assert parse_event("@ffsi warning text=") == Event("warning", {}, "")


@pytest.mark.parametrize("value", ["nan", "-nan", "inf", "-inf"])
def test_values_that_are_not_finite_are_numbers(value):
    event = parse_event(f"@ffsi newton residual={value}")
    assert event is not None and not math.isfinite(event.number("residual"))


@pytest.mark.parametrize("word", ["12abc", "1e", "1_000", "infinite", "3.1.1", "0x10"])
def test_what_only_starts_like_a_number_stays_text(word):
    event = parse_event(f"@ffsi start case={word}")
    assert event is not None and event.fields["case"] == word


@pytest.mark.parametrize(
    "line", ["", "init MUMPS_SEQ: MPI_Init", "@ffsinewton point=1", "see @ffsi end status=converged"]
)
def test_other_lines_are_no_events(line):
    assert parse_event(line) is None


@pytest.mark.parametrize("line", ["@ffsi", "@ffsi status=converged", "@ffsi point 7", "@ffsi point =7"])
def test_a_marked_line_that_breaks_the_format_raises(line):
    with pytest.raises(ValueError, match="progress line"):
        parse_event(line)


def test_accessors_fall_back_when_the_type_is_wrong():
    event = Event("newton", {"point": "x", "residual": 2})
    assert event.integer("point", 5) == 5 and event.number("residual") == 2.0 and math.isnan(event.number("case"))
    assert event.word("residual") == "2"
