"""How two numbers are related, where they are equal and where one is NaN too."""

from __future__ import annotations

import math

import pytest

from compiler.ir.ops import Relation


@pytest.mark.parametrize(
    ("relation", "below", "equal", "above"),
    [
        (Relation.LESS, True, False, False),
        (Relation.LESS_EQUAL, True, True, False),
        (Relation.GREATER, False, False, True),
        (Relation.GREATER_EQUAL, False, True, True),
    ],
)
def test_a_relation_holds(relation: Relation, below: bool, equal: bool, above: bool) -> None:
    assert [relation.holds(left, 2.0) for left in (1.0, 2.0, 3.0)] == [below, equal, above]
    assert not relation.holds(math.nan, 2.0)
    assert not relation.holds(2.0, math.nan)
