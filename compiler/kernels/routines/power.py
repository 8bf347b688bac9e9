"""The kernel x^y = e^(y·ln x); ln x and y·ln x are sums of two reals, since one has too
few digits.
"""

from __future__ import annotations

from compiler.kernels.routines.double_word import exact_product, ordered_sum, polynomial
from compiler.kernels.routines.exponential import (
    overflowed,
    reduce_exponential,
    reduce_logarithm,
    scale_factors,
)
from compiler.kernels.routines.inverse_trigonometric import is_negative
from compiler.kernels.tables.coefficients import (
    EXPONENTIAL_LIMITS,
    LN_2,
    LOGARITHM_TAIL,
    TWO_THIRDS,
)
from compiler.kernels.trace.statements import ValueKind
from compiler.kernels.trace.values import (
    Real,
    Subroutine,
    Truth,
    Value,
    branch,
    branch_tuple,
    constant,
    select,
    to_real,
    to_unsigned,
)


def _logarithm_words(x: Real) -> tuple[Value, ...]:
    """ln x as a rounded sum and its remainder, for finite x > 0: 2s + s·(2/3·z + z²·P(z)) + e·ln 2
    with x = (1 + f)·2^e, s = f/(2 + f), z = s² and a polynomial P.
    """
    # e^(y·ln x) turns absolute into relative errors: for y·ln x in the hundreds, one word of ln x
    # would lose two digits
    f, exponent = reduce_logarithm(x)
    ln_2_high, ln_2_low = LN_2[x.format]
    third, third_rest = TWO_THIRDS[x.format]
    sum_, sum_rest = ordered_sum(constant(x, 2.0), f)
    s = (f / sum_).named("s")
    product, product_rest = exact_product(s, sum_)
    s_rest = (((f - product) - product_rest) - s * sum_rest) / sum_
    square, square_rest = exact_product(s, s)
    square_rest = square_rest + 2.0 * (s * s_rest)
    scaled, scaled_rest = exact_product(square, constant(x, third))
    scaled_rest = scaled_rest + (square * third_rest + square_rest * third)
    tail = square * square * polynomial(square, LOGARITHM_TAIL[x.format])
    factor, factor_rest = ordered_sum(scaled, tail)
    factor_rest = factor_rest + scaled_rest
    cubic, cubic_rest = exact_product(s, factor)
    cubic_rest = cubic_rest + (s * factor_rest + s_rest * factor)
    part, part_rest = ordered_sum(2.0 * s, cubic)
    part_rest = part_rest + (cubic_rest + 2.0 * s_rest)
    high, low = ordered_sum(exponent * ln_2_high, part)
    return ordered_sum(high, low + (part_rest + exponent * ln_2_low))


LOGARITHM_WORDS = Subroutine(
    "log_words",
    ("x",),
    "ln x as high + low, for finite x > 0.",
    _logarithm_words,
    results=("high", "low"),
)
"""A separate routine, since tests can try all floats for one argument, but not all pairs."""


def _exponential_of_words(high: Real, low: Real) -> Real:
    """e^(high + low); infinity beyond the format's range, and gradual underflow to 0."""
    largest, smallest = EXPONENTIAL_LIMITS[high.format]

    def inside() -> Real:
        count, s, rest = reduce_exponential(high)
        first, second = scale_factors(count)
        return (1.0 + (s + (rest + (low + low * s)))) * first * second

    def below() -> Real:
        return branch(high >= smallest, inside, lambda: constant(high, 0.0), "power")

    # slightly beyond the limit the result may still be finite; scaling decides
    return branch(high <= largest + 0.125, below, lambda: overflowed(high), "magnitude")


def _finite_power(base: Real, y: Real) -> Real:
    """base^y for finite base > 0. A y of huge magnitude is clamped: the result is 0, 1 or infinity
    anyway.
    """
    logarithm, logarithm_rest = LOGARITHM_WORDS(base)
    assert isinstance(logarithm, Real)
    assert isinstance(logarithm_rest, Real)
    largest = 2.0 ** (32 if y.format.digits == 24 else 64)
    exponent = select(y > largest, largest, select(y < -largest, -largest, y))
    product, rest = exact_product(exponent, logarithm)
    high, low = ordered_sum(product, rest + exponent * logarithm_rest)
    return _exponential_of_words(high, low)


def _split_exponent(size: Real) -> tuple[Truth, Truth]:
    """Returns two conditions on an exponent `size` ≥ 0: it is no integer, and it is an odd integer.
    Numbers from 2^digits on are even integers.
    """
    kind = ValueKind.UNSIGNED if size.format.digits < 32 else ValueKind.WIDE

    def small() -> tuple[Value, ...]:
        whole = to_unsigned(size, kind)
        return size - to_real(whole), to_real(whole & 1)

    def large() -> tuple[Value, ...]:
        # from 2^digits on, all numbers are even integers
        zero = constant(size, 0.0)
        return zero, zero

    fraction, parity = branch_tuple(
        size < 2.0**size.format.digits, small, large, ("fraction", "parity")
    )
    assert isinstance(fraction, Real)
    assert isinstance(parity, Real)
    fractional = fraction > 0.0
    return fractional, (parity > 0.0) & ~fractional


def _pow(x: Real, y: Real) -> tuple[Value, ...]:
    base = abs(x).named("base")

    def extreme() -> Real:
        # of 0, infinity or NaN; y is not 0
        return select(y < 0.0, 1.0 / base, select(y > 0.0, base, y))

    def general() -> Real:
        ordinary = (base > 0.0) & (base <= x.format.largest)
        magnitude = branch(ordinary, lambda: _finite_power(base, y), extreme, "magnitude")
        fractional, odd = _split_exponent(abs(y))
        # by the sign bit: (−0)³ is −0, and (−0)⁻³ is −∞
        signed = select(is_negative(x, "side") & odd, -magnitude, magnitude)
        no_real_power = ((x < 0.0) & (x >= -x.format.largest)) & fractional
        return branch(no_real_power, lambda: (x - x) / (x - x), lambda: signed, "signed_value")

    # also for NaN: C's pow(1, NaN) and pow(NaN, 0) are 1
    always_one = ((y <= 0.0) & (y >= 0.0)) | ((x <= 1.0) & (x >= 1.0))
    return (branch(always_one, lambda: constant(x, 1.0), general, "result"),)


POW = Subroutine("pow", ("x", "y"), "x to the power y, as C's pow.", _pow)
