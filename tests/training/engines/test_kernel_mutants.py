"""A part of `benchmarks/mutation/kernels.py`: changed rules are found, right kernels are not."""

from __future__ import annotations

import pytest

from benchmarks.mutation import kernels
from benchmarks.mutation.kernels import rules_score
from benchmarks.mutation.random_stages import random_stage
from benchmarks.mutation.right_kernels import check_stage
from tests.conditions import require_tool


def test_changed_rules_of_derivatives_are_found() -> None:
    score = rules_score(every=10)
    assert score.missed == ()
    assert score.found >= 6


def test_a_comparison_that_finds_the_right_rules_wrong_is_no_score(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else every change would count as found."""

    def finds_all_wrong(*_: object, **__: object) -> None:
        raise AssertionError("of a package that is missing")

    monkeypatch.setattr(kernels, "assert_slopes_agree", finds_all_wrong)
    with pytest.raises(AssertionError, match="what is right must agree"):
        rules_score(every=50)


@pytest.mark.parametrize("seed", range(6))
def test_kernels_of_random_stages_are_not_refused(seed: int) -> None:
    require_tool("gcc", install="apt install gcc")
    check_stage(random_stage(seed))
