"""The kernels exp, log, sigmoid and softplus, and the reductions of e^x and ln x that other kernels
share.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from compiler.kernels.routines.double_word import exact_sum, ordered_sum, polynomial, reciprocal
from compiler.kernels.tables.coefficients import (
    EXPONENTIAL,
    EXPONENTIAL_LIMITS,
    INVERSE_LN_2,
    LN_2,
    LOGARITHM,
)
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import Table, ValueKind
from compiler.kernels.trace.values import (
    Real,
    Subroutine,
    Value,
    branch,
    call,
    constant,
    integer,
    look_up,
    select,
    to_real,
    to_unsigned,
)


def round_to_integer(x: Real) -> Real:
    """The integer nearest to x, the even one of two equally near ones, for |x| ≤ 2^(digits − 2),
    where `digits` is the number of significand bits.
    """
    shift = 1.5 * 2.0 ** (x.format.digits - 1)
    # the sum has no fraction bits left; -ffast-math would break this, which the self-test finds
    return (x + shift) - shift


def reduce_exponential(x: Real) -> tuple[Real, Real, Real]:
    """Returns n, s and rest with e^x = 2^n·(1 + s + rest): n an integer, |s| < 0.415, rest the
    small part that s lost by rounding.

    x = n·ln 2 + r with |r| ≤ ln 2 / 2, and s + rest = r + r²·P(r) with the polynomial P. The
    product of n and the first word of ln 2 is exact.
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
    """Two powers of two, first and second, with the product 2^count, for integers count ≥ smallest
    exponent − 1.

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
    """Infinity with the sign of x for |x| ≥ 2, by a product that overflows; NaN stays NaN."""
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


def normalise(x: Real) -> tuple[Real, Real]:
    """Returns m and e with x = m·2^e exactly, 1 ≤ m < 2 and e an integer, for finite x ≥ 1."""
    # portable C cannot read the bits of a float, so compare and scale
    mantissa = x
    parts: list[Real] = []
    step = x.format.overflow_exponent // 2
    while step >= 1:
        large = mantissa >= 2.0**step
        mantissa = mantissa * select(large, 2.0**-step, 1.0)
        parts.append(select(large, float(step), 0.0))
        step //= 2
    exponent = parts[0]
    for part in parts[1:]:
        exponent = exponent + part
    return mantissa, exponent


def reduce_logarithm(x: Real) -> tuple[Real, Real]:
    """Returns f and e with x = (1 + f)·2^e exactly, √½ ≤ 1 + f < √2 and e an integer, for finite x
    > 0, also subnormal x.
    """
    # two steps scale every positive number below 1 into the range of `normalise`
    half = x.format.overflow_exponent // 2
    lift = float(-x.format.smallest_exponent - half)
    very_small = x < 2.0**-half
    lifted = x * select(very_small, 2.0**lift, 1.0)
    small = x < 1.0
    lifted = lifted * select(small, 2.0**half, 1.0)
    offset = select(very_small, lift, 0.0) + select(small, float(half), 0.0)
    mantissa, exponent = normalise(lifted)
    upper = mantissa > math.sqrt(2.0)
    mantissa = mantissa * select(upper, 0.5, 1.0)
    exponent = (exponent + select(upper, 1.0, 0.0)) - offset
    return (mantissa - 1.0).named("f"), exponent


def log_1p_rest(f: Real, addend: Real) -> Real:
    """log(1 + f) + addend − f for −0.3 < f < 0.4143 and a small addend: the part of the logarithm
    without its leading term f.

    With s = f/(2 + f), h = f²/2 and log((1+s)/(1−s)) = 2s + s·R this is s·(h + R) − h + addend.
    """
    s = f / (2.0 + f)
    square = s * s
    half_square = 0.5 * f * f
    ratio = square * polynomial(square, LOGARITHM[f.format])
    return (s * (half_square + ratio) + addend) - half_square


def _log(x: Real) -> tuple[Value, ...]:
    ln_2_high, ln_2_low = LN_2[x.format]

    def inside() -> Real:
        f, exponent = reduce_logarithm(x)
        # add the small parts first: only the sum with the largest part rounds significantly
        return exponent * ln_2_high + (log_1p_rest(f, exponent * ln_2_low) + f)

    def not_finite_positive() -> Real:
        # −∞ at ±0; 0/0 is NaN below; +∞ and NaN stay
        return branch(
            x <= 0.0,
            lambda: branch(x < 0.0, lambda: (x - x) / (x - x), lambda: -1.0 / abs(x), "low"),
            lambda: x,
            "special",
        )

    finite_positive = (x > 0.0) & (x <= x.format.largest)
    return (branch(finite_positive, inside, not_finite_positive, "result"),)


LOG = Subroutine("log", ("x",), "Natural logarithm.", _log)


def _limit(format: Format) -> float:
    """The |x| beyond which e^−|x| is less than 1/16 of the last digit of 1 in this format."""
    return (format.digits + 3.0) * 0.6931471805599453


def _outside(x: Real, above: Callable[[], Real]) -> Real:
    """The value of sigmoid or softplus for |x| beyond `_limit`, and for NaN: e^x if x < 0, else
    `above()`.
    """
    return branch(x < 0.0, lambda: call(EXP, x), above, "outside")


def _sigmoid(x: Real) -> tuple[Value, ...]:
    largest_count = x.format.digits + 4
    size = abs(x).named("size")

    def inside() -> Real:
        # 1/(1 + e^|x|) with a denominator of two words: (power + 1) + power·s
        count, s, rest = reduce_exponential(size)
        power = small_power_of_two(count, largest_count).named("power")
        whole, lost = ordered_sum(power, constant(x, 1.0))
        high, low = ordered_sum(whole, power * s)
        small = reciprocal(high, low + (lost + power * rest)).named("small")
        return select(x < 0.0, small, 1.0 - small)

    def one() -> Real:
        return select(x > 0.0, 1.0, x)

    return (branch(size <= _limit(x.format), inside, lambda: _outside(x, one), "result"),)


def _softplus(x: Real) -> tuple[Value, ...]:
    largest_count = x.format.digits + 4
    ln_2 = sum(LN_2[x.format])
    size = abs(x).named("size")

    def inside() -> Real:
        # max(x, 0) + log(1 + e), e = e^−|x| in two words
        count, s, rest = reduce_exponential(-size)
        power = 1.0 / small_power_of_two(-count, largest_count)
        whole = 1.0 + s
        e = (power * whole).named("e")
        e_low = power * ((s - (whole - 1.0)) + rest)
        # log(1 + e) = log 2 + log(1 + (e − 1)/2) for the larger e
        large = e > 0.4142
        f_large, f_low = exact_sum(e, constant(x, -1.0))
        f = select(large, 0.5 * f_large, e)
        f_rest = select(large, 0.5 * (f_low + e_low), e_low)
        base = select(x > 0.0, x, 0.0)
        tail = log_1p_rest(f, f_rest / (1.0 + f)).named("tail")
        total = base + (f + tail)
        return select(large, total + ln_2, total)

    return (branch(size <= _limit(x.format), inside, lambda: _outside(x, lambda: x), "result"),)


SIGMOID = Subroutine("sigmoid", ("x",), "1 / (1 + e^−x).", _sigmoid)
SOFTPLUS = Subroutine("softplus", ("x",), "log(1 + e^x).", _softplus)
