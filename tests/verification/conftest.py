"""Runs that the tests of this folder share: each is done once."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from studies.measurement import Measurement, Variant, measure

PLAIN = ("output.pictures=false", "output.vtu=false")


@pytest.fixture(scope="session")
def measured() -> Callable[[Variant, int], Measurement]:
    """Run a variant of a case on a mesh level, once; a run that fails fails the test."""
    known: dict[tuple[Variant, int], Measurement] = {}

    def measured(variant: Variant, level: int) -> Measurement:
        if (variant, level) not in known:
            plain = replace(variant, settings=(*variant.settings, *PLAIN))
            known[variant, level] = measure(variant.case, level, plain)
        run = known[variant, level]
        assert not run.failure, run.data["reason"]
        return run

    return measured
