"""Which process of a comparison is given which trial."""

from __future__ import annotations

from pathlib import Path

from msnn.features.comparison.local_workers import Waiting
from msnn.features.comparison.trial import Trial
from msnn.features.comparison.variants import Variant

ONE, OTHER, THIRD = (Variant(Path("a.yaml"), (f"a={value}",), f"a={value}") for value in "123")


def trials(*variants: Variant) -> list[Trial]:
    return [Trial(variant, 0, fold) for variant in variants for fold in (1, 2, 3)]


def test_folds_of_a_variant_go_to_the_process_that_has_read_its_spec():
    waiting = Waiting(trials(ONE, OTHER))
    here, there = waiting.take(None), waiting.take(None)
    assert (here, there) == (Trial(ONE, 0, 1), Trial(OTHER, 0, 1))
    for fold in (2, 3):
        assert waiting.take(Trial(ONE, 0, 1)) == Trial(ONE, 0, fold)
        assert waiting.take(Trial(OTHER, 0, 1)) == Trial(OTHER, 0, fold)
    assert waiting.take(None) is None


def test_what_is_taken_together_is_of_one_variant():
    waiting = Waiting(trials(ONE, OTHER))
    assert len(waiting) == 6
    assert waiting.take_together(None, 2) == [Trial(ONE, 0, 1), Trial(ONE, 0, 2)]
    assert waiting.take_together(Trial(ONE, 0, 2), 9) == [Trial(ONE, 0, 3)]
    assert waiting.take_together(Trial(ONE, 0, 3), 9) == trials(OTHER)
    assert waiting.take_together(None, 9) == []
    assert len(waiting) == 0


def test_a_process_without_work_helps_another():
    waiting = Waiting(trials(ONE, OTHER))
    one = Trial(ONE, 0, 1)
    for last in (None, one, one, None, None):
        waiting.take(last)
    assert waiting.take(Trial(THIRD, 0, 1)) == Trial(OTHER, 0, 3)
    waiting.put_back(Trial(ONE, 0, 2))
    assert waiting.take(Trial(THIRD, 0, 1)) == Trial(ONE, 0, 2)
