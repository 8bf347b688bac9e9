"""e^x, and its reduced form, on which the hyperbolic and logistic kernels are built."""

from __future__ import annotations

from compiler.kernels.routines.double_word import polynomial
from compiler.kernels.tables.coefficients import EXPONENTIAL, EXPONENTIAL_LIMITS, INVERSE_LN_2, LN_2
from compiler.kernels.trace.operations import (
    branch,
    constant,
    integer,
    look_up,
    to_real,
    to_unsigned,
)
from compiler.kernels.trace.statements import Table, ValueKind
from compiler.kernels.trace.subroutine import Subroutine
from compiler.kernels.trace.values import Real, Value


def round_to_integer(x: Real) -> Real:
    """The nearest integer, ties to even, for |x| ≤ 2^(digits − 2)."""
    shift = 1.5 * 2.0 ** (x.format.digits - 1)
    # the sum has no fraction bits left; -ffast-math would break this, which the self-test finds
    return (x + shift) - shift


def reduce_exponential(x: Real) -> tuple[Real, Real, Real]:
    """n, s, rest with e^x = 2^n·(1 + s + rest), n an integer, |s| < 0.415, rest tiny.

    x = n·ln 2 + r, |r| ≤ ln 2 / 2, with n·(first word of ln 2) exact; s + rest = r + r²·P(r).
    """
    ln_2_high, ln_2_low = LN_2[x.format]
    count = round_to_integer(x * INVERSE_LN_2[x.format][0]).named("count")
    high = (x - count * ln_2_high).named("high")
    low = (count * ln_2_low).named("low")
    r = (high - low).named("r")
    # the exact rounding error of r, as |high| ≥ |low|
    lost = (high - r) - low
    tail = (r * r * polynomial(r, EXPONENTIAL[x.format]) + lost).named("tail")
    s = (r + tail).named("s")
    return count, s, (r - s) + tail


def small_power_of_two(count: Real, limit: int) -> Real:
    """2^count for an integer 0 ≤ count ≤ limit ≤ 62, by shifting the integer 1."""
    n = to_unsigned(count)
    if limit <= 31:
        return to_real(integer(count, 1) << n)
    # 1 << n has 32 bits only: two shifts, whose product is exact
    half = n >> 1
    return to_real(integer(count, 1) << half) * to_real(integer(count, 1) << (n - half))


def scale_factors(count: Real) -> tuple[Real, Real]:
    """Two powers of two with product 2^count, for integers count ≥ smallest exponent − 1.

    m·first is exact for m near 1, so that (m·first)·second rounds once, also if it is subnormal or
    infinite.
    """
    smallest = count.format.smallest_exponent
    n = to_unsigned(count + (1.0 - smallest))
    entries = (count.format.overflow_exponent - smallest) // 32 + 1
    powers = tuple(2.0 ** (smallest + 32 * i) for i in range(entries))
    table = Table("powers", ValueKind.REAL, powers)
    # n counts from the smallest exponent − 1: the half takes the 1 back
    first = to_real(integer(count, 1) << (n & 31)) * 0.5
    return first, look_up(table, n >> 5)


def overflowed(x: Real) -> Real:
    """Infinity with the sign of x for |x| ≥ 2; NaN stays NaN."""
    return x * 2.0 ** (x.format.overflow_exponent - 1)


def _exp(x: Real) -> tuple[Value, ...]:
    largest, smallest = EXPONENTIAL_LIMITS[x.format]

    def inside() -> Real:
        count, s, _ = reduce_exponential(x)
        first, second = scale_factors(count)
        return (1.0 + s) * first * second

    def in_range() -> Real:
        return branch(x >= smallest, inside, lambda: constant(x, 0.0), "power")

    # NaN fails the comparison, and `overflowed` keeps it
    return (branch(x <= largest, in_range, lambda: overflowed(x), "result"),)


EXP = Subroutine("exp", ("x",), "e^x", _exp)
