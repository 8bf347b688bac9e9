"""The kernels tanh, sinh and cosh: a polynomial near 0, elsewhere e^x by `reduce_exponential`."""

from __future__ import annotations

from collections.abc import Callable

from compiler.kernels.routines.double_word import polynomial
from compiler.kernels.routines.exponential import (
    overflowed,
    reduce_exponential,
    scale_factors,
    small_power_of_two,
)
from compiler.kernels.tables.coefficients import (
    EXPONENTIAL_LIMITS,
    HYPERBOLIC_SINE,
    HYPERBOLIC_TANGENT,
    LN_2,
)
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.values import Real, Subroutine, Value, branch, select


def tiny(format: Format) -> float:
    """The |x| below which an odd function with derivative 1 at 0, such as sin, rounds to x itself
    in this format.
    """
    return 2.0 ** -((format.digits + 1) // 2)


def odd_near_zero(x: Real, coefficients: tuple[float, ...]) -> Real:
    """x + x·z·P(z) with z = x² and the polynomial P of these coefficients, constant term first."""
    square = x * x
    return x + x * (square * polynomial(square, coefficients))


def with_sign_of(x: Real, magnitude: Real) -> Real:
    """`magnitude`, negated where x < 0."""
    return select(x < 0.0, -magnitude, magnitude)


def odd_function(x: Real, near: Callable[[], Real], far: Callable[[Real], Real]) -> Real:
    """An odd function of x with derivative 1 at 0: x if |x| is tiny, `near()` for |x| < 1, else
    `far(|x|)` with the sign of x. `far` also receives NaN.
    """
    size = abs(x).named("size")

    def not_near() -> Real:
        return with_sign_of(x, far(size))

    def not_tiny() -> Real:
        return branch(size < 1.0, near, not_near, "value")

    return branch(size < tiny(x.format), lambda: x, not_tiny, "result")


def _tanh(x: Real) -> tuple[Value, ...]:
    # 1 − 2/(e^{2x} + 1) rounds to 1 beyond: half the logarithm of 2^(digits + 2)
    limit = (x.format.digits + 2) * sum(LN_2[x.format]) / 2.0
    largest_count = x.format.digits + 2

    def far(size: Real) -> Real:
        def inside() -> Real:
            count, s, _ = reduce_exponential(size + size)
            power = small_power_of_two(count, largest_count).named("power")
            return 1.0 - 2.0 / ((power + 1.0) + power * s)

        return branch(size <= limit, inside, lambda: select(size > limit, 1.0, x), "outer")

    def near() -> Real:
        # P is between −⅓ and −0.2: splitting off −¼, an exact factor, reduces its rounding error
        first, *others = HYPERBOLIC_TANGENT[x.format]
        square = x * x
        scaled = square * polynomial(square, (first + 0.25, *others))
        # tiny x round to x without a branch; + 0 keeps the sign of -0: -0 + (-0) * (+0) = -0
        return x + x * ((scaled - 0.25 * square) + 0.0)

    # below 0.92 the polynomial is more accurate in float than the quotient
    limit_near = 0.92 if x.format.digits == 24 else 0.55
    size = abs(x).named("size")
    return (branch(size < limit_near, near, lambda: with_sign_of(x, far(size)), "result"),)


def _half_exponential(x: Real) -> tuple[Real, Real]:
    """Returns e^x / 2 rounded, and its rounding error."""
    count, s, rest = reduce_exponential(x)
    first, second = scale_factors(count - 1.0)
    whole = 1.0 + s
    lost = s - (whole - 1.0)
    return whole * first * second, (lost + rest) * first * second


def _hyperbolic_limit(format: Format) -> float:
    """The x beyond which e^x / 2 is certainly infinite in this format."""
    return EXPONENTIAL_LIMITS[format][0] + 1.0


def _sinh(x: Real) -> tuple[Value, ...]:
    def far(size: Real) -> Real:
        def inside() -> Real:
            half, rest = _half_exponential(size)
            return half + (rest - 0.25 / half)

        limit = _hyperbolic_limit(x.format)
        return branch(size <= limit, inside, lambda: overflowed(size), "outer")

    def near() -> Real:
        return odd_near_zero(x, HYPERBOLIC_SINE[x.format])

    return (odd_function(x, near, far),)


def _cosh(x: Real) -> tuple[Value, ...]:
    size = abs(x).named("size")

    def inside() -> Real:
        half, rest = _half_exponential(size)
        return half + (rest + 0.25 / half)

    limit = _hyperbolic_limit(x.format)
    return (branch(size <= limit, inside, lambda: overflowed(size), "result"),)


TANH = Subroutine("tanh", ("x",), "Hyperbolic tangent.", _tanh)
SINH = Subroutine("sinh", ("x",), "Hyperbolic sine.", _sinh)
COSH = Subroutine("cosh", ("x",), "Hyperbolic cosine.", _cosh)
