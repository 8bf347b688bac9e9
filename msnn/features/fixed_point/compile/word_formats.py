"""Chooses the number format of a word, its fraction bits, from the range of its values."""

from __future__ import annotations

import math

_SMALLEST = 2.0**-96
"""Smallest range: float32, in which C converts words, has no finer scales."""


def finite(limits: tuple[float, float] | None) -> tuple[float, float] | None:
    """The limits if both are finite, else None."""
    return limits if limits is not None and all(map(math.isfinite, limits)) else None


def word_format(low: float, high: float, bits: int) -> tuple[int, int, int]:
    """The format of values low … high with this number of bits: fraction digits, and both limits as
    integers.
    """
    # what is always 0 has a format too
    reach = max(abs(low), abs(high), _SMALLEST) if low or high else 2.0**-bits
    # reach = m · 2^e with m in [1/2, 1): a bit for the sign, e before the point, the rest behind it
    fraction = bits - 1 - math.frexp(reach)[1]
    # just below a power of 2 rounding reaches it, one unit more than the bits can hold
    if round(math.ldexp(reach, fraction)) == 2 ** (bits - 1):
        fraction -= 1
    return fraction, round(math.ldexp(low, fraction)), round(math.ldexp(high, fraction))
