"""The number of an exported estimator that is furthest off decides, and NaN is further than any."""

from __future__ import annotations

import numpy as np

from msnn.features.control.export.judged_estimator import EstimateShare


def _agrees(*found: float) -> bool:
    share = EstimateShare()
    for value in found:
        share.count()
        share.compare(np.array([value]), np.array([1.0]), np.array([0.1]), np.array([1.0]))
    return share.agreement(
        target="mpc", dtype="float64", has_failed=False, selftest=0, tested="filter"
    ).agrees


def test_the_furthest_number_decides() -> None:
    assert _agrees(1.0, 1.05, 0.95)
    assert not _agrees(1.0, 1.2, 1.0)


def test_a_number_that_is_none_is_not_forgotten_at_the_next_step() -> None:
    assert not _agrees(np.nan, 1.0)
    assert not _agrees(1.0, np.nan, 1.05)
