"""A part of `benchmarks/mutation/kernels.py`: changed rules are found, right kernels are not."""

from __future__ import annotations

import pytest

from benchmarks.mutation.kernels import rules_score
from benchmarks.mutation.random_stages import random_stage
from benchmarks.mutation.right_kernels import check_stage
from tests.conditions import require_tool


def test_changed_rules_of_derivatives_are_found() -> None:
    score = rules_score(every=10)
    assert score.missed == ()
    assert score.found >= 6


@pytest.mark.parametrize("seed", range(6))
def test_kernels_of_random_stages_are_not_refused(seed: int) -> None:
    require_tool("gcc", install="apt install gcc")
    check_stage(random_stage(seed))
