"""Factors the covariance with which the window of an estimator begins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
_KNOWN = 1e-13
"""Relative conditional variance below which the remainder is rounding."""


def spread_of(covariance: Array, uncertain: Sequence[int]) -> Array:
    """S with S Sᵀ = P, the columns of the uncertain numbers; those of others are 0.

    P = U D Uᵀ by columns from the last on; S = U √D. A D that is 0 needs no quotient.
    """
    rest = np.array(covariance, float)
    size = len(rest)
    found = np.zeros((size, size))
    whole = np.diagonal(rest).copy()
    # from the last number on, so that what a number shares with those behind it is taken off first
    for j in range(size - 1, -1, -1):
        variance = rest[j, j]
        # not above, also where it is NaN: what rounding leaves of a variance is no uncertainty
        if not variance > _KNOWN * whole[j]:
            continue
        found[: j + 1, j] = rest[: j + 1, j] / np.sqrt(variance)
        # what this column explains of the numbers before it
        rest[: j + 1, : j + 1] -= np.outer(found[: j + 1, j], found[: j + 1, j])
    return found[:, list(uncertain)]
