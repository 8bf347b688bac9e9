"""Shares inside prediction intervals and what they are called, counted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.validation.statistics.coverage import Counts, Coverage


def test_what_lies_inside_is_counted_with_both_variances():
    """Deviations 2, 3 and 2 of what is there; 0.674, 1.282 and 1.960 of them hold the levels."""
    counts = Counts(np.array(4.0))
    variance = np.array([0.0, 5.0, 12.0, 0.0])
    target = np.array([1.3, -3.2, np.nan, 3.95])
    counts.add(np.zeros(2), variance[:2], target[:2])
    counts.add(np.zeros(2), variance[2:], target[2:])
    found = counts.coverage([np.array([0.5, -0.5]), np.array([0.0, 0.0])])
    # 1.3 is inside of 1.35, 3.2 of 3.84 and not of 2.02, 3.95 of nothing but 3.92
    assert found.observed == pytest.approx((1 / 3, 2 / 3, 2 / 3))
    assert found.half_width == pytest.approx(1.959964 * 7 / 3, rel=1e-6)
    assert found.from_parameters == pytest.approx(5 / 9 / 3)
    assert found.count == 3
    # 1 + 2 Σ r² is 2 of the one element and 1 of the other
    assert found.effective == pytest.approx(3 / 1.5)


def test_elements_have_noise_of_their_own():
    counts = Counts(np.array([1.0, 100.0]))
    counts.add(np.zeros((1, 2)), np.zeros((1, 2)), np.array([[5.0, 5.0]]))
    found = counts.coverage([])
    assert found.elements.tolist() == [[0, 1], [0, 1], [0, 1]]
    assert found.effective == 2


@pytest.mark.parametrize(
    ("observed", "effective", "verdict"),
    [
        # a tenth of √(p (1 − p)): 0.05, 0.04 and 0.0218 may be missing
        ((0.549, 0.761, 0.971), 1e6, "as wide as they say"),
        ((0.449, 0.78, 0.94), 1e6, "too narrow: errors are larger here than in training"),
        ((0.48, 0.78, 0.928), 1e6, "too narrow: errors are larger here than in training"),
        ((0.52, 0.841, 0.96), 1e6, "too wide: errors are smaller here than in training"),
        ((0.56, 0.80, 0.92), 1e6, "errors are not normal: many small ones, some far out"),
        ((0.44, 0.80, 0.98), 1e6, "errors are not normal: most of them of one size"),
        # of 100 independent values chance does 2.58 deviations: 0.129, 0.103 and 0.056
        ((0.372, 0.70, 0.895), 100.0, "as wide as they say"),
        ((0.370, 0.70, 0.895), 100.0, "too narrow: errors are larger here than in training"),
    ],
)
def test_shares_are_judged_by_what_chance_does(
    observed: tuple[float, ...], effective: float, verdict: str
):
    found = Coverage(
        observed=observed,
        elements=np.array(observed),
        half_width=1.0,
        from_parameters=0.0,
        count=1_000_000,
        effective=effective,
    )
    assert found.verdict == verdict
