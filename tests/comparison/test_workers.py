"""Which process of a comparison is given which trial."""

from __future__ import annotations

from pathlib import Path

from msnn.comparison.trial import Trial
from msnn.comparison.variants import Variant
from msnn.comparison.workers import Waiting

ONE, OTHER, THIRD = (Variant(Path("a.yaml"), (f"a={value}",), f"a={value}") for value in "123")


def trials(*variants: Variant) -> list[Trial]:
    return [Trial(variant, 0, fold) for variant in variants for fold in (1, 2, 3)]


def test_folds_of_a_variant_go_to_the_process_that_has_read_its_spec():
    waiting = Waiting(trials(ONE, OTHER))
    here, there = waiting.take(None), waiting.take(None)
    assert (here.variant, there.variant) == (ONE, OTHER)
    for fold in (2, 3):
        assert waiting.take(ONE) == Trial(ONE, 0, fold)
        assert waiting.take(OTHER) == Trial(OTHER, 0, fold)
    assert not waiting


def test_a_process_without_work_helps_another():
    waiting = Waiting(trials(ONE, OTHER))
    for last in (None, ONE, ONE, None, None):
        waiting.take(last)
    assert waiting.take(THIRD) == Trial(OTHER, 0, 3)
    waiting.put_back(Trial(ONE, 0, 2))
    assert waiting.take(THIRD) == Trial(ONE, 0, 2)
