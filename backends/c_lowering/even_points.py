"""Finds the interval among evenly spaced points by one multiplication, verified for every float."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.c_language.literals import Dtype


@dataclass(frozen=True, slots=True)
class EvenPoints:
    """⌊(x − origin) · factor⌋ is the interval of x, for x from the first to below the last point.

    If it is not `exact`, it can be one too high just below the upper end of an interval.
    """

    origin: float
    factor: float
    exact: bool


def even_points(points: Sequence[float], dtype: Dtype) -> EvenPoints | None:
    """The factor that finds the interval in the arithmetic of `dtype`; None if none is reliable.

    Subtraction, multiplication and truncation are monotonic, so it suffices to check the lowest and
    the highest float of each interval.
    """
    real = np.dtype(dtype).type
    rounded = np.array(points, dtype)
    count = len(rounded) - 1
    if count < 2 or not np.all(np.diff(rounded) > 0):
        return None
    # the highest float below each upper end, which belongs to the next interval
    lowest, highest = rounded[:-1], np.nextafter(rounded[1:], real(-np.inf))
    intervals = np.arange(count)
    quotient = real(count) / (rounded[-1] - rounded[0])
    for larger in _LARGER:
        factor = quotient + real(larger) * np.spacing(quotient)
        first, last = (np.floor((x - rounded[0]) * factor) for x in (lowest, highest))
        # one comparison corrects a result that is too high; too low would need another one
        if np.all(first == intervals) and np.all(last <= intervals + 1):
            exact = bool(np.all(last == intervals))
            return EvenPoints(float(rounded[0]), float(factor), exact)
    return None


_LARGER = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Tried increments of the factor, in ulp."""
