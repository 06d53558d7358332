"""Runs that the tests of this folder share: each is done once."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from studies.harness import PLAIN, Run
from studies.verification.steady import Variant, measure


@pytest.fixture(scope="session")
def measured() -> Callable[[Variant, int], Run]:
    """Run a variant of a case on a mesh level, once; a run that fails fails the test."""
    known: dict[tuple[Variant, int], Run] = {}

    def measured(variant: Variant, level: int) -> Run:
        if (variant, level) not in known:
            plain = replace(variant, settings=(*variant.settings, *PLAIN))
            known[variant, level] = measure(plain, level)
        run = known[variant, level]
        assert not run.failure, run.data["reason"]
        return run

    return measured
