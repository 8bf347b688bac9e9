"""A few hundred spoiled specs, the same every time; `tests.fuzz.check` tries as many as wanted."""

import pytest

from tests.fuzz.check import answer, specs
from tests.fuzz.mutations import spoiled

EACH = 40


@pytest.mark.parametrize("block", range(10))
def test_spoiled_specs_are_answered(block: int) -> None:
    good = specs()
    for seed in range(block * EACH, (block + 1) * EACH):
        answer(spoiled(seed, good))
