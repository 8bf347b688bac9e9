"""Integer codes of floats: adjacent floats have codes that differ by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int64]


def codes_of(numbers: NDArray[Any]) -> Codes:
    """The index of each float in ascending order.

    0 and -0 have index 0, and negative floats have negative indices.
    """
    words = np.ascontiguousarray(numbers).view(f"i{numbers.itemsize}").astype(np.int64)
    # the bits increase with the magnitude; the sign bit gives the sign of the code
    magnitudes = words & _largest(numbers.dtype)
    return np.where(words < 0, -magnitudes, magnitudes)


def numbers_of(codes: Codes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The floats with these codes, the inverse of `codes_of`."""
    words = np.abs(codes).astype(f"i{dtype.itemsize}")
    return np.copysign(words.view(dtype), np.where(codes < 0, -1.0, 1.0).astype(dtype))


def between(left: Codes, right: Codes) -> Codes:
    """The middle of two codes, rounded towards the left one."""
    # the difference of two float64 codes may overflow
    half = right // 2 - left // 2
    # close codes need the exact half, as separately rounded halves may not change
    return left + np.where(np.abs(half) > 1, half, np.trunc((right - left) / 2).astype(np.int64))


def distance(left: Codes, right: Codes) -> NDArray[np.uint64]:
    """The number of adjacent floats from one code to the other."""
    # the distance of two float64 may exceed int64; the unsigned difference is exact
    return np.maximum(left, right).view(np.uint64) - np.minimum(left, right).view(np.uint64)


def _largest(dtype: np.dtype[Any]) -> int:
    return int(np.iinfo(f"i{dtype.itemsize}").max)
