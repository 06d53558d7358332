"""A minute of the hard cases (`python -m studies verify --hard`): those marked quick, each as expected."""

from pathlib import Path

import pytest

from studies.verification.hard import GOOD, Outcome, judge, load, run, select

ENTRIES = load()[1]
QUICK = [name for name, entry in ENTRIES.items() if entry.quick]


@pytest.fixture(scope="module")
def outcome_of(tmp_path_factory):
    runs: Path = tmp_path_factory.mktemp("hard")
    known: dict[str, Outcome] = {}

    def outcome_of(name: str) -> Outcome:
        if name not in known:
            known[name] = run(ENTRIES[name], runs)
        return known[name]

    return outcome_of


@pytest.mark.parametrize("name", QUICK)
def test_quick_hard_cases(name, outcome_of):
    outcomes = {entry.id: outcome_of(entry.id) for entry in select(ENTRIES, name)}
    verdict = judge(outcomes[name], outcomes)
    assert verdict.word in GOOD, (verdict, outcomes[name])
