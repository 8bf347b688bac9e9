"""Rounding keeps what is drawn within its bounds, and no key's draws are another's."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from msnn.features.comparison.variants import Draws, draw_axes


def drawn(count: int, seed: int = 0, **laws: str) -> list[tuple[float, ...]]:
    found = Draws(draw_axes(laws), count, seed).drawn
    assert found is not None
    return [tuple(map(float, row)) for row in found.rows]


@settings(deadline=None)
@given(low=st.floats(1e-6, 1e6), width=st.floats(1e-7, 10), law=st.sampled_from(("uniform", "log")))
def test_rounded_numbers_lie_within_bounds(low: float, width: float, law: str) -> None:
    high = low * (1 + width)
    for (number,) in drawn(5, k=f"{law}({low!r}, {high!r})"):
        assert low <= number <= high


def test_two_keys_are_drawn_apart() -> None:
    rows = np.array(drawn(400, a="uniform(0, 1)", b="uniform(0, 1)"))
    assert abs(np.corrcoef(rows.T)[0, 1]) < 0.2  # four standard errors of independent draws


def test_two_seeds_are_drawn_apart() -> None:
    one, other = (np.array(drawn(400, seed, a="uniform(0, 1)"))[:, 0] for seed in (0, 1))
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.2
