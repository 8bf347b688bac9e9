"""Approximates quantiles of the χ² distribution."""

from __future__ import annotations

import math
from statistics import NormalDist


def chi_square_quantile(numbers: int, chance: float) -> float:
    """The quantile that χ² exceeds with probability `chance` (Wilson and Hilferty, PNAS 17,
    1931).
    """
    part = 2 / (9 * numbers)
    return numbers * (1 - part + NormalDist().inv_cdf(1 - chance) * math.sqrt(part)) ** 3
