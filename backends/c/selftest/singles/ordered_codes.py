"""Counts the numbers of a float type: neighbours have codes that differ by one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int64]


def codes_of(numbers: NDArray[Any]) -> Codes:
    """The place of each number among all of its type; 0 and -0 are 0, negative ones below."""
    words = np.ascontiguousarray(numbers).view(f"i{numbers.itemsize}").astype(np.int64)
    # bits of floats rise with their magnitude; the sign decides on which side of 0 they count
    magnitudes = words & _largest(numbers.dtype)
    return np.where(words < 0, -magnitudes, magnitudes)


def numbers_of(codes: Codes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The numbers with these codes."""
    words = np.abs(codes).astype(f"i{dtype.itemsize}")
    return np.copysign(words.view(dtype), np.where(codes < 0, -1.0, 1.0).astype(dtype))


def between(left: Codes, right: Codes) -> Codes:
    """In the middle, towards the left ones."""
    # the difference of two codes of float64 may not fit
    half = right // 2 - left // 2
    # of neighbours the halves, each rounded by itself, could stand still
    return left + np.where(np.abs(half) > 1, half, np.trunc((right - left) / 2).astype(np.int64))


def distance(left: Codes, right: Codes) -> NDArray[np.uint64]:
    """The number of steps from neighbour to neighbour between numbers with these codes."""
    # of two numbers of float64 there may be more than an int64 counts to; an unsigned difference
    # of the larger from the smaller one is right modulo 2⁶⁴, and below that
    return np.maximum(left, right).view(np.uint64) - np.minimum(left, right).view(np.uint64)


def _largest(dtype: np.dtype[Any]) -> int:
    return int(np.iinfo(f"i{dtype.itemsize}").max)
