"""Interval arithmetic for all elements of a value, with the declared ranges that it follows from.

An unknown value has infinite ends and follows from no range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Interval:
    """low ≤ x ≤ high for every element."""

    low: float = -math.inf
    high: float = math.inf
    of: frozenset[str] = frozenset()
    """The names whose declared ranges the interval follows from."""
    nonzero: bool = False
    """True if no element is 0 although 0 may be between the ends."""

    def has(self, value: float) -> bool:
        """True if an element can have this value."""
        return self.low <= value <= self.high and not (value == 0 and self.nonzero)

    def within(self, other: Interval) -> Interval:
        """The intersection with another interval."""
        low, high = max(self.low, other.low), min(self.high, other.high)
        if low > high:  # an empty intersection: the declared ranges contradict each other
            return self
        return Interval(low, high, self.of | other.of, self.nonzero or other.nonzero)


ANYTHING = Interval()


def union(parts: Sequence[Interval]) -> Interval:
    """The interval of elements of any of the parts."""
    ends = [end for one in parts for end in (one.low, one.high)]
    return replace(_between(ends, *parts), nonzero=not any(one.has(0.0) for one in parts))


def negative(x: Interval) -> Interval:
    return replace(x, low=-x.high, high=-x.low)


def total(a: Interval, b: Interval) -> Interval:
    return _between([a.low + b.low, a.high + b.high], a, b)


def product(a: Interval, b: Interval) -> Interval:
    # minimum and maximum of the four products of ends
    ends = [_times(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    found = _between(ends, a, b)
    # the product is 0 if one factor is 0, however large the other
    zero = _of([one for one in (a, b) if one.has(0.0)])
    nonzero = not a.has(0.0) and not b.has(0.0)
    return replace(found, of=found.of or zero, nonzero=nonzero)


# not `product(x, x)`: for −1 … 1 that is −1 … 1, but a square is 0 … 1
def square(x: Interval) -> Interval:
    return product(magnitude(x), magnitude(x))


def quotient(a: Interval, b: Interval) -> Interval:
    # a divisor near 0 makes the quotient unbounded
    if b.low <= 0.0 <= b.high:
        return ANYTHING
    return product(a, _between([1.0 / b.low, 1.0 / b.high], b))


def magnitude(x: Interval) -> Interval:
    ends = (abs(x.low), abs(x.high))
    # the minimum magnitude is 0 if both signs are possible
    low = 0.0 if x.low <= 0.0 <= x.high else min(ends)
    return replace(_between([low, max(ends)], x), nonzero=x.nonzero)


def least(a: Interval, b: Interval) -> Interval:
    return _between([min(a.low, b.low), min(a.high, b.high)], a, b)


def largest(a: Interval, b: Interval) -> Interval:
    return _between([max(a.low, b.low), max(a.high, b.high)], a, b)


def clamped(x: Interval, low: Interval, high: Interval) -> Interval:
    return least(largest(x, low), high)


def repeated(x: Interval, count: int) -> Interval:
    """The sum of `count` values in the interval."""
    return _between([_times(count, x.low), _times(count, x.high)], x)


def of_function(function: str, x: Sequence[Interval]) -> Interval:
    """The interval of a scalar function."""
    if function == "abs":
        return magnitude(x[0])
    if function == "pow":
        return _power(*x)
    if function in _MONOTONE:
        low, high = _MONOTONE[function]
        meaning = SCALAR_FUNCTIONS[function].numpy
        # arguments outside the domain give NaN, which does not count as a value
        inside = [min(max(end, low), high) for end in (x[0].low, x[0].high)]
        with np.errstate(all="ignore"):
            ends = [float(meaning(np.float64(end))) for end in inside]
        return _between(ends, x[0])
    if function in _PEAKS:
        return _wave(function, x[0])
    return _between(_BOUNDED.get(function, (-math.inf, math.inf)), *x)


def _wave(function: str, x: Interval) -> Interval:
    """The interval of sine and cosine: values at the ends, and extrema between them."""
    # an infinite interval contains all phases
    if not math.isfinite(x.high - x.low):
        return Interval(-1.0, 1.0)
    ends = [float(SCALAR_FUNCTIONS[function].numpy(np.float64(end))) for end in (x.low, x.high)]
    for peak, value in ((_PEAKS[function], 1.0), (_PEAKS[function] + math.pi, -1.0)):
        # the first such phase at or after the start of the interval
        next_one = peak + math.ceil((x.low - peak) / (2.0 * math.pi)) * 2.0 * math.pi
        ends += [value] if next_one <= x.high else []
    return _between(ends, x)


_PEAKS = {"sin": math.pi / 2.0, "cos": 0.0}
"""Arguments of a maximum 1; the minimum −1 is half a turn further."""


_MONOTONE = {
    "exp": (-math.inf, math.inf),
    "sinh": (-math.inf, math.inf),
    "tanh": (-math.inf, math.inf),
    "atan": (-math.inf, math.inf),
    "sigmoid": (-math.inf, math.inf),
    "softplus": (-math.inf, math.inf),
    "sign": (-math.inf, math.inf),
    "sqrt": (0.0, math.inf),
    "log": (0.0, math.inf),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
}
"""Monotone functions and their domains."""

# not monotone, but bounded for any argument
_BOUNDED = {"atan2": (-math.pi, math.pi), "cosh": (1.0, math.inf)}


# with a variable exponent, a power of a nonnegative base is known to be ≥ 0 only
def _power(base: Interval, exponent: Interval) -> Interval:
    # x^y of a negative base is NaN for most y
    if exponent.low != exponent.high:
        return Interval(low=0.0) if base.low >= 0.0 else ANYTHING
    y = exponent.low
    if base.low < 0.0:
        # an even power depends on the magnitude only; other exponents are not analysed
        even = y > 0.0 and y % 2.0 == 0.0
        return _power(magnitude(base), exponent) if even else ANYTHING
    with np.errstate(all="ignore"):
        ends = [float(np.float64(end) ** y) for end in (base.low, base.high)]
    return _between(ends, base)


# 0 · ∞ is NaN in IEEE arithmetic; here an infinite end means arbitrarily large
def _times(a: float, b: float) -> float:
    """a · b, with 0 · ∞ = 0."""
    return 0.0 if a == 0.0 or b == 0.0 else a * b


def _between(ends: Sequence[float], *made_of: Interval) -> Interval:
    """The interval from the minimum to the maximum end; an unbounded one follows from no range."""
    # ∞ − ∞: the end is unknown
    if any(math.isnan(end) for end in ends):
        return ANYTHING
    low, high = min(ends), max(ends)
    bounded = math.isfinite(low) and math.isfinite(high)
    return Interval(low, high, _of(made_of) if bounded else frozenset())


def _of(parts: Sequence[Interval]) -> frozenset[str]:
    return frozenset[str]().union(*(one.of for one in parts))
