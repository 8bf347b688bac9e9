"""Converts cells with a single rounding, exactly like numbers in a spec."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache
from typing import TypeAlias

import numpy as np

from msnn.data.dataset import FloatArray
from spec_schema.units.unit import DIGITS, UNCHANGED, Line, nearest_float

_REACH = 280
"""Decimal exponents within which no intermediate result overflows or underflows."""
_SPLIT = float(2**27 + 1)
_AT_ONCE = 1 << 14
"""Cells per block: intermediate results stay in the cache, which takes a fifth of the time."""

_Pair: TypeAlias = tuple[float, float]
"""The float nearest to a number, and the difference from the number."""


def converted_cells(cells: FloatArray, line: Line) -> FloatArray:
    """factor · cell + summand, with the cell as the decimal number that was written.

    3 mm must become 0.003 m, as in a spec, but 9 · 0.001 is 0.009000000000000001. Sums and products
    use pairs of floats (Dekker, Numer. Math. 18, 1971), so that only the result is rounded.
    Decibels are 20 log10 of a ratio: NaN if it is negative.
    """
    if line == UNCHANGED:
        return cells
    factor, summand = _pair(line.factor), _pair(line.summand)
    found = np.empty(len(cells))
    # infinities, differences below the smallest float, and logarithms of negative values
    with np.errstate(all="ignore"):
        for begin in range(0, len(cells), _AT_ONCE):
            some = slice(begin, begin + _AT_ONCE)
            found[some] = _on_line(cells[some], factor, summand)
        match line.level:
            case "to":
                return 20.0 * np.log10(found)
            case "from":
                return float(line.ratio) * 10.0 ** (found / 20.0)
            case None:
                return found


def _on_line(cells: FloatArray, factor: _Pair, summand: _Pair) -> FloatArray:
    product = cells * factor[0]
    rest = _product_rest(cells, factor[0], product)
    rest += _decimal_rest(cells) * factor[0] + cells * factor[1]
    total = product + summand[0]
    there = total - product
    rest += (product - (total - there)) + (summand[0] - there) + summand[1]
    found = total + rest
    return np.where(np.isfinite(found), found, total)


def _decimal_rest(cells: FloatArray) -> FloatArray:
    """The difference between the decimal number that was written and the cell; 0 if unknown."""
    size = np.abs(cells)
    inside = (size > 10.0**-_REACH) & (size < 10.0**_REACH)
    at = DIGITS - 1 - np.floor(np.log10(np.where(inside, size, 1.0))).astype(np.int64)
    powers, inverses, inverse_rests = _powers_of_ten()
    # the logarithm of a number beside a power of ten may be rounded to that of the power
    first = size * powers[at + _REACH + DIGITS]
    at += (first < 10.0 ** (DIGITS - 1)).astype(np.int64) - (first >= 10.0**DIGITS)
    at += _REACH + DIGITS
    digits = np.rint(cells * powers[at])
    nearest = digits * inverses[at]
    rest = _product_rest(digits, inverses[at], nearest) + digits * inverse_rests[at]
    rest += nearest - cells
    is_meant = inside & (np.abs(rest) <= np.spacing(size) / 2)
    return np.where(is_meant, rest, 0.0)


def _product_rest(left: FloatArray, right: FloatArray | float, product: FloatArray) -> FloatArray:
    """The rounding error of a product."""
    left_high = left * _SPLIT - (left * _SPLIT - left)
    right_high = right * _SPLIT - (right * _SPLIT - right)
    left_low, right_low = left - left_high, right - right_high
    most = (left_high * right_high - product) + left_high * right_low + left_low * right_high
    return np.asarray(most + left_low * right_low, np.float64)


@cache
def _powers_of_ten() -> tuple[FloatArray, FloatArray, FloatArray]:
    """10ᵏ as floats, and 10⁻ᵏ as pairs, for k ≥ -_REACH - DIGITS."""
    span = range(-_REACH - DIGITS, _REACH + DIGITS + 1)
    inverses = np.array([_pair(Fraction(10) ** -k) for k in span])
    return np.array([float(f"1e{k}") for k in span]), inverses[:, 0], inverses[:, 1]


def _pair(number: Fraction) -> _Pair:
    nearest = nearest_float(number)
    return nearest, float(number - Fraction(nearest)) if math.isfinite(nearest) else 0.0
